"""`cmu-dd`: without gears decentralised PD fails at speed, and the model's torques make up for it."""

import numpy as np
import pytest

import armwright as aw

START, GOAL = np.array([-1.2, -0.5, 0.8, 0.0, 0.5, 0.0]), np.array([1.3, 0.3, -0.8, 0.4, -0.6, 0.9])
PD = aw.JointPID(kp=[800, 1800, 600, 300, 60, 40], kd=[80, 180, 60, 24, 6, 4], gravity=True)
CONTROLLERS = {
    "pd": PD,
    "own inertia": aw.FeedForward(PD, gravity=False, friction=True, inertia="joint"),
    "full": aw.FeedForward(PD, gravity=False, friction=True, inertia="full"),
    "computed torque": aw.ComputedTorque(kp=900.0, kd=60.0),
}
MASS = 0.1  # share by which a link's mass may differ from the model's


@pytest.fixture(scope="module")
def tool():
    """Largest distances [m] of the tool from its path, by motion and controller, over arms whose masses are drawn."""
    arm, generator = aw.load("cmu-dd"), np.random.default_rng(3)
    masses = {row.name: row.value for row in arm.parameters if row.name.endswith("mass_kg") and row.value > 0.0}
    lanes = {name: aw.Batch(mass * generator.uniform(1.0 - MASS, 1.0 + MASS, 4)) for name, mass in masses.items()}
    lanes = {name: aw.Batch(np.r_[masses[name], each.values]) for name, each in lanes.items()}  # the first is the model
    loop = aw.Loop(PD, period=1e-3, timing=aw.Timing("one-tick"))
    scenario = aw.Scenario(arm, duration=1.0, loop=loop, vary=lanes)
    motions = {"slow": aw.trajectories.Quintic(START, GOAL, 4.0), "fast": aw.trajectories.Quintic(START, GOAL, 0.8)}
    found = aw.loops.compare_controllers(scenario, CONTROLLERS, motions)
    return found.data["path_largest"].isel(payload=0)


@pytest.mark.study
def test_pd_follows_slowly_and_fails_at_speed(tool):
    assert tool.sel(controller="pd", motion="slow") < 5e-3
    assert tool.sel(controller="pd", motion="fast") > 20e-3
    assert tool.sel(controller="own inertia", motion="fast") > 0.7 * tool.sel(controller="pd", motion="fast")


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["full", "computed torque"])
def test_the_whole_model_follows_at_speed_though_masses_are_wrong(tool, name):
    assert tool.sel(controller=name, motion="fast") < 0.25 * tool.sel(controller="pd", motion="fast")

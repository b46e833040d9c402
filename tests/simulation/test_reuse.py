"""What was traced for an arm is used again for other lanes, other gains and another copy of the arm, and for nothing else."""

from __future__ import annotations

import pickle
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armwright as aw
from armwright.program import kept_programs
from simulation.sticking import sticking

LANES = 12


@pytest.fixture(autouse=True)
def nothing_kept(monkeypatch):
    """Every test begins with no program kept, and leaves none."""
    monkeypatch.setattr(kept_programs, "_made", type(kept_programs._made)())


def scenario(seed: int = 0, **changes: Any) -> aw.Scenario:
    rng = np.random.default_rng(seed)
    law = aw.JointPID(kp=aw.Batch(rng.uniform(40.0, 80.0, (LANES, 2))), kd=4.0)
    given = {
        "arm": aw.load("two-link"),
        "duration": 0.03,
        "loop": aw.Loop(law, aw.trajectories.Step([0.0, 0.0], [0.5, 0.2]), 1e-3),
        "start": aw.Start(aw.Batch(rng.uniform(-1.0, 1.0, (LANES, 2)))),
        "solver": aw.Solver("rk3"),
        "recording": aw.Recording(what="none", reduce=["rms_error", "peak_torque"]),
        "vary": {"forearm.mass_kg": aw.Batch(rng.uniform(3.0, 5.0, LANES))},
    }
    return aw.Scenario(**{**given, **changes})


def moving(found: aw.Scenario) -> Any:
    """The stage that moves the plant, whose program takes longest to trace."""
    return aw.simulation.Simulation(found).loop.loops[0].stages[-1]


def results(found: aw.Scenario) -> np.ndarray:
    run = aw.simulate(found)
    return np.concatenate([run[name].values for name in found.recording.reduce], axis=-1)


def alone(found: aw.Scenario) -> np.ndarray:
    """The same where nothing is kept."""
    kept_programs._made.clear()
    return results(found)


@pytest.mark.sample(1)
@pytest.mark.parametrize("rule", ["rk3", "auto"])
def test_other_lanes_trace_no_plant_and_have_the_bits_that_they_have_alone(rule):
    first, other = (scenario(seed, solver=aw.Solver(rule)) for seed in (0, 1))
    program = getattr(moving(first), "trial" if rule == "auto" else "step")
    assert getattr(moving(other), "trial" if rule == "auto" else "step") is program
    reused = results(other)
    np.testing.assert_array_equal(reused, alone(other))


def test_a_copy_of_the_arm_is_the_same_arm():
    """As a worker of a sweep gets one with every chunk."""
    first = scenario()
    copied = replace(first, arm=pickle.loads(pickle.dumps(first.arm)))
    assert moving(copied).step is moving(first).step


def other_arms() -> dict[str, aw.Scenario]:
    arm, first = aw.load("two-link"), scenario()
    heavy = {"forearm.mass_kg": 5.5}
    return {
        "another mass": scenario(arm=arm.with_values(heavy), vary={}),
        "another gravity": scenario(arm=arm.replace(gravity=[0.0, 0.0, -1.62])),
        "no gravity": scenario(arm=arm.replace(gravity=[0.0, 0.0, 0.0]), vary={}),
        "what sticks": scenario(arm=sticking(arm, np.array([0.5, 0.2])), vary={}),
        "another parameter": replace(first, vary={"upper_arm.mass_kg": aw.Batch(np.linspace(5.0, 7.0, LANES))}),
        "a payload": scenario(inputs=aw.Inputs(payload=aw.Payload(0.0, 0.5, [0.1, 0.0, 0.0], [0.0, 0.0, 0.0]))),
        "a wrench": scenario(inputs=aw.Inputs(wrench=[0.0, 1.0, 2.0, 0.0, 0.0, 0.0])),
        "another rule": scenario(solver=aw.Solver("rk4")),
        "other reducers": scenario(recording=aw.Recording(what="none", reduce=["peak_error", "peak_torque"])),
    }


@pytest.mark.sample(1)
@pytest.mark.parametrize("what", sorted(other_arms()))
def test_another_arm_or_structure_is_traced_anew(what):
    found, nominal = (
        other_arms()[what],
        scenario(vary={}) if what in ("another mass", "no gravity", "what sticks") else scenario(),
    )
    results(nominal)  # is kept
    beside = results(found)
    np.testing.assert_array_equal(beside, alone(found))


def test_a_controller_is_traced_every_time():
    """Its code may use what has changed since."""
    gain = [20.0]

    def law(t, r, y):
        return gain[0] * (r.q - y.q) - 2.0 * y.qd

    found = scenario(loop=aw.Loop(law, aw.trajectories.Step([0.0, 0.0], [0.5, 0.2]), 1e-3))
    before = results(found)
    gain[0] = 60.0
    after = results(found)
    assert (before != after).any()
    np.testing.assert_array_equal(after, alone(found))


def test_the_second_simulation_of_an_arm_that_sticks_starts_much_sooner():
    def seconds(seed: int) -> float:
        found = scenario(seed, arm=sticking(aw.load("two-link"), np.array([0.5, 0.2])), vary={})
        began = time.process_time()
        aw.simulation.Simulation(found)
        return time.process_time() - began

    first = seconds(0)
    assert 2.0 * min(seconds(1), seconds(2)) < first

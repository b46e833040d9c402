"""The step that a refusal recommends is accurate, of a length that people write, and divides what it must."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import armwright as aw
from actuators.drives import one_joint
from armwright.errors import ScenarioError
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.plant.recommended_step import recommended_step, step_of, written_step
from simulation.first_steps import geared_motor

LAG = np.array([[0.0, 1.0], [0.0, -50.0]])  # a position, and a speed that dies away in 20 ms
SWING = np.array([[0.0, 1.0], [-2500.0, 0.0]])  # 50 rad/s
NOTHING = np.zeros(0)


@pytest.mark.parametrize("slope", [LAG, SWING], ids=["first-order lag", "oscillator"])
@pytest.mark.parametrize("name", INTEGRATORS)
def test_one_step_is_wrong_by_a_hundredth_at_most_and_the_next_longer_by_more(name, slope):
    step = step_of(INTEGRATORS[name], slope, NOTHING, (), NOTHING)
    h = recommended_step(slope, step, 1.0)
    begins, scale = np.array([0.0, 1.0]), np.array([50.0, 1.0])  # positions count in speeds times 20 ms
    wrong = [np.abs(scale * (step(k * h) @ begins - expm(slope * k * h) @ begins)).max() for k in (1.0, 2.5)]
    assert wrong[0] < 0.01 < 3.0 * wrong[1]


def test_it_divides_and_is_a_number_that_people_write():
    assert written_step(0.0076) == 0.005
    assert written_step(0.002, [0.01, 1.0]) == 0.002
    assert written_step(0.005, [0.004]) == 0.002
    assert written_step(0.9e-3, [0.3]) == 0.5e-3
    third = written_step(1e-4, [1e-3 / 3.0])
    assert 1e-3 / 3.0 / third == pytest.approx(5.0)


def refused_with(scenario: aw.Scenario) -> float:
    """The step that the refusal of a scenario recommends."""
    with pytest.raises(ScenarioError) as refused:
        aw.simulate(scenario)
    return float(refused.value.expected.split()[0])


def test_a_geared_motor_with_the_recommended_step():
    """A lag of 2 ms to 2 rad/s: within 1 % of it at all times, and without overshoot."""
    arm = geared_motor()
    step = refused_with(aw.Scenario(arm, 0.07, command=[24.0], solver=aw.Solver("rk3", 0.01)))
    run = aw.simulate(aw.Scenario(arm, 0.07, command=[24.0], solver=aw.Solver("rk3", step)))
    exact = 2.0 * (1.0 - np.exp(-run.time.values / 2e-3))
    assert np.abs(run.qd.values[:, 0] - exact).max() < 0.02
    assert run.qd.values.max() <= 2.0 + 1e-9


@pytest.mark.parametrize("name", ["rk3", "rk4"])
def test_a_spring_with_the_recommended_step(name):
    """A swing of 100 rad/s: amplitude and phase within 1 % of it after each step."""
    spring = {"stiffness_n_m_per_rad": 1e4, "rest_rad": 0.0}
    arm = one_joint(None, {"gear_ratio": 1.0, "rotor_inertia_kg_m2": 0.0}, spring=spring).replace(gravity=[0, 0, 0])
    inertia = float(aw.compile(arm).mass_matrix(np.zeros(1))[0, 0])
    omega = np.sqrt(1e4 / inertia)
    start, duration = aw.Start([0.1]), 1.0
    step = refused_with(aw.Scenario(arm, duration, command=[0.0], start=start, solver=aw.Solver(name, 0.5)))
    run = aw.simulate(aw.Scenario(arm, duration, command=[0.0], start=start, solver=aw.Solver(name, step)))
    exact = 0.1 * np.cos(omega * run.time.values)
    wrong = np.abs(run.q.values[:, 0] - exact) / 0.1
    assert (wrong[1:] < 0.01 * np.arange(1, len(wrong))).all()


def test_it_divides_the_duration_and_the_recording_period():
    arm = geared_motor()
    recording = aw.Recording(period=0.0125)
    scenario = aw.Scenario(arm, 0.0375, command=[24.0], solver=aw.Solver("rk3", 0.0125), recording=recording)
    step = refused_with(scenario)
    assert step == 5e-4
    aw.simulate(aw.Scenario(arm, 0.0375, command=[24.0], solver=aw.Solver("rk3", step), recording=recording))

"""Steps in real time end when the clock says so, and move the arm as quick ones do."""

import time

import numpy as np
import pytest

import armwright as aw


@pytest.fixture
def simulation():
    scenario = aw.Scenario(aw.load("two-link"), duration=1.0, solver=aw.Solver(step=2e-3))
    simulation = aw.simulation.Simulation(scenario)
    simulation.step(np.zeros(2))  # compiled
    return simulation


def test_they_take_as_long_as_the_motion(simulation):
    state = simulation.state
    ends = []
    for real_time in (False, True):
        simulation.restore(state)
        began = time.perf_counter()
        for _ in range(60):
            simulation.step([0.5, -0.1], real_time=real_time)
        spent = time.perf_counter() - began
        ends.append(simulation.plant_state["q"])
    assert spent > 0.9 * 59 * simulation.period
    np.testing.assert_array_equal(*ends)


def test_after_a_halt_they_do_not_hurry(simulation):
    simulation.step(np.zeros(2), real_time=True)
    time.sleep(0.25)
    simulation.step(np.zeros(2), real_time=True)
    began = time.perf_counter()
    for _ in range(20):
        simulation.step(np.zeros(2), real_time=True)
    assert time.perf_counter() - began > 0.9 * 19 * simulation.period

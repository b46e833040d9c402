"""A simulation that is stepped: commanded from outside, kept, restored and handed over between two ticks."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import DivergenceError, ScenarioError
from physics.arms import arm
from raises_at import raises_at
from simulation.fields import scenario_of

PERIOD = 1e-3
SENSORS = aw.Sensors(velocity="difference", position_noise=1e-4)
COMMON = {"period": PERIOD, "sensors": SENSORS}
Q0 = np.random.default_rng(0).uniform(-0.2, 0.2, (600, 2))


def pd(t, r, y):
    return 20.0 * (r.q - y.q) - 2.0 * y.qd


def commanded(simulation, ticks):
    """Positions and measured speeds before each of so many ticks, commanded as by `pd` from outside."""
    rows = []
    for _ in range(ticks):
        y = simulation.measurement
        rows.append(np.concatenate([simulation.plant_state.q, y.qd], axis=-1))
        u = 20.0 * (0.1 - y.q) - 2.0 * y.qd
        simulation.step(u if u.ndim == 1 else aw.Batch(u))
    return np.array(rows)


@pytest.mark.parametrize("lanes", [None, 9])
def test_commands_from_outside_do_what_a_controller_does(lanes):
    q0 = aw.Batch(Q0[:lanes]) if lanes else Q0[0]
    run = aw.simulate(
        scenario_of(arm("two-link"), controller=pd, reference=[0.1, 0.1], q0=q0, duration=20 * PERIOD, **COMMON)
    )
    rows = commanded(aw.simulation.Simulation(scenario_of(arm("two-link"), q0=q0, **COMMON)), 21)
    expected = np.concatenate([run.q.values, run.qd_measured.values], axis=-1)
    np.testing.assert_allclose(rows, np.moveaxis(expected, -2, 0), rtol=0, atol=1e-10)


@pytest.mark.parametrize("measured", [False, True])
def test_a_state_goes_on_to_the_bit(measured):
    """Kept before or after the measurement of its tick, in this simulation or in another one."""
    scenario = scenario_of(arm("two-link"), q0=Q0[0], **COMMON)
    simulation = aw.simulation.Simulation(scenario)
    commanded(simulation, 5)
    if measured:
        _ = simulation.measurement
    state = simulation.state
    assert state.measured == measured
    expected = commanded(simulation, 10)
    simulation.restore(state)
    np.testing.assert_array_equal(commanded(simulation, 10), expected)
    other = aw.simulation.Simulation(scenario_of(arm("two-link"), start=state, **COMMON))
    np.testing.assert_array_equal(commanded(other, 10), expected)
    simulation.reset()
    assert simulation.tick == 0
    np.testing.assert_array_equal(commanded(simulation, 15)[5:], expected)


def test_a_measurement_is_not_taken_twice_by_who_takes_over():
    """A compiled controller measures in one go with what it commands: it takes over before the measurement, not after it."""
    simulation = aw.simulation.Simulation(scenario_of(arm("two-link"), q0=Q0[0], **COMMON))
    commanded(simulation, 5)
    before = simulation.state
    y = simulation.measurement
    taking = {"controller": pd, "reference": [0.1, 0.1], "duration": 5 * PERIOD, **COMMON}
    run = aw.simulate(scenario_of(arm("two-link"), start=before, **taking))
    np.testing.assert_array_equal(run.qd_measured.values[0], y.qd)
    with raises_at(ScenarioError, "start", "measurement already"):
        aw.simulation.Simulation(scenario_of(arm("two-link"), start=simulation.state, **taking))


class AtOnce:
    """All lanes at once, with a memory of any kind."""

    vectorised = True

    def init(self, arm, y):
        return {"i": np.zeros_like(y.q)}

    def step(self, t, r, y, s):
        i = s["i"] + 0.1 * (r.q - y.q)
        return 20.0 * (r.q - y.q) + i, {"i": i}


def test_all_lanes_at_once_are_all_lanes():
    """However they are run: hundreds of lanes, which a compiled loop takes in groups, have one memory."""
    scenario = scenario_of(
        arm("two-link"), controller=AtOnce(), reference=np.zeros(2), q0=aw.Batch(Q0), duration=10 * PERIOD, **COMMON
    )
    whole, simulation = aw.simulate(scenario), aw.simulation.Simulation(scenario)
    simulation.run(5 * PERIOD)
    for _ in range(2):
        simulation.step()
    np.testing.assert_array_equal(simulation.run(3 * PERIOD).q.values, whole.q.values[:, 7:])


def test_rows_of_a_reference_are_there_again_after_a_reset():
    rows = np.linspace(Q0[0], [0.1, 0.1], 11)
    scenario = scenario_of(arm("two-link"), controller=pd, reference=rows, q0=Q0[0], duration=10 * PERIOD, **COMMON)
    simulation = aw.simulation.Simulation(scenario)
    first = simulation.run()
    simulation.reset()
    np.testing.assert_array_equal(simulation.run().q.values, first.q.values)


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (None, "command: missing"),
        (np.zeros(3), r"command: shape \(3,\); expected \(2,\)"),
        ("much", "command = 'much': expected 2 numbers"),
        ([np.nan, 0.0], "command = nan"),
        (aw.Batch(np.zeros((3, 2))), "command: 3 lanes; .*1 or 1"),
    ],
)
def test_commands_that_are_none_are_refused(command, said):
    simulation = aw.simulation.Simulation(scenario_of(arm("two-link"), **COMMON))
    with pytest.raises(ScenarioError, match=said):
        simulation.step(command)


def test_what_does_not_fit_is_refused():
    simulation = aw.simulation.Simulation(aw.Scenario(arm("two-link"), command=np.zeros(2), duration=0.01))
    with raises_at(ScenarioError, "command", "^command: beside"):
        simulation.step(np.zeros(2))
    for name in ("measurement", "reference_now"):
        with raises_at(ScenarioError, name, "sampled"):
            getattr(simulation, name)
    with pytest.raises(ScenarioError, match="start = 3"):
        simulation.restore(3)
    three = aw.Scenario(arm("two-link"), command=np.zeros(2), duration=0.01, start=aw.Batch(Q0[:3]))
    with raises_at(ScenarioError, "state", "3 lanes; .* 1$"):
        simulation.restore(aw.simulation.Simulation(three).state)


def test_a_run_that_was_cut_is_no_start():
    """Its rows end elsewhere than the state that it carries."""
    common = {"command": np.zeros(2), "duration": 0.01}
    run = aw.simulate(scenario_of(arm("two-link"), qd0=[1.0, 1.0], **common))
    assert scenario_of(arm("two-link"), start=run.isel(time=slice(5, None)), **common).started.tick == 10
    with raises_at(ScenarioError, "start", r"t = 0\.004 s"):
        scenario_of(arm("two-link"), start=run.isel(time=slice(5)), **common)


def test_a_single_lane_that_diverges_says_so():
    two = arm("two-link")
    alone = aw.simulation.Simulation(
        aw.Scenario(two, command=np.zeros(2), duration=0.01, start=aw.Start(qd=[1e200, 0.0]))
    )
    with pytest.raises(DivergenceError, match="t = 0 s"):
        alone.step()
    many = aw.simulation.Simulation(
        aw.Scenario(two, command=np.zeros(2), duration=0.01, start=aw.Start(qd=aw.Batch([[1e200, 0.0], [0.1, 0.0]])))
    )
    for _ in range(3):
        many.step()
    assert many.plant_state.qd[1, 0] != 0.1
    assert many.state.blocks["frozen"][:, 0].tolist() == [0.0, -1.0]

"""Runs and simulations that continue, to the bit: by the run before, by the same simulation, by a saved state."""

from __future__ import annotations

import copy
import dataclasses
import pickle
import time
from functools import cache

import numpy as np
import pytest

import armwright as aw
from armwright.errors import RunError, ScenarioError
from armwright.results.aliases import LOOP_STATE
from frozen.runs import RUNS, controlled, stubborn, two_link
from physics.arms import arm
from raises_at import raises_at
from simulation.fields import scenario_of, with_fields
from simulation.plants import BRAKE, MANY, MOTOR, pendulum

OF_A_PART = {LOOP_STATE, "diverged_at", "stalled_at", "steps_tried", "event_count", "event_time"}  # not of single rows
NO_STATE = ("reduced", "continued")  # a run that records nothing, and one that starts from another
WITHOUT_BITS = [name for name in RUNS if "cvodes" in name]  # a multistep solver restarts at low order


@cache
def halved(name):
    """A reference run, the ticks of its first half, and the ticks of its second."""
    scenario = RUNS[name]()
    every = scenario.every or scenario.ticks
    first = scenario.ticks // every // 2 * every
    return scenario, first, scenario.ticks - first


def by_run(scenario, first, second, folder):
    """Halves of a run: the second starts from the first, which was read from a file."""
    if scenario.solver.rule == "auto":  # an accuracy is that of the whole run
        solver = dataclasses.replace(scenario.solver, horizon=scenario.duration)
        scenario = dataclasses.replace(scenario, solver=solver)
    a = aw.simulate(dataclasses.replace(scenario, duration=first * scenario.tick))
    aw.save(a, folder / "first.nc")
    start = aw.load_run(folder / "first.nc")
    return a, aw.simulate(dataclasses.replace(scenario, start=start, duration=second * scenario.tick))


def by_simulation(scenario, first, second, folder):
    """Halves of a run: one simulation runs twice."""
    simulation = aw.simulation.Simulation(scenario)
    return simulation.run(first * scenario.tick), simulation.run(second * scenario.tick)


def by_saved_state(scenario, first, second, folder):
    """Halves of a run: another simulation takes over the state from a file."""
    simulation, other = aw.simulation.Simulation(scenario), aw.simulation.Simulation(scenario)
    a = simulation.run(first * scenario.tick)
    simulation.state.save(folder / "middle.npz")
    other.restore(aw.simulation.LoopState.load(folder / "middle.npz"))
    return a, other.run(second * scenario.tick)


WAYS = (by_run, by_simulation, by_saved_state)
EACH = [(name, WAYS[k % 3]) for k, name in enumerate(RUNS) if name not in (*WITHOUT_BITS, *NO_STATE)]
ALL_WAYS = ["jitter and losses", "noise", "with memory", "in Python at once", "effect all", "rk45 all"]


@pytest.mark.parametrize(
    ("name", "way"),
    [*EACH, *((name, way) for name in ALL_WAYS for way in WAYS if (name, way) not in EACH)],
    ids=lambda value: value if isinstance(value, str) else value.__name__,
)
@pytest.mark.sample(1)
def test_two_halves_are_the_uninterrupted_run(name, way, tmp_path):
    whole, parts = aw.simulate(halved(name)[0]), way(*halved(name), tmp_path)
    for variable in set(whole.data_vars) - OF_A_PART:
        if "time" in whole[variable].dims:
            first, second = (part[variable].transpose("time", ...).values for part in parts)
            joined, expected = np.concatenate([first[:-1], second]), whole[variable].transpose("time", ...).values
            np.testing.assert_array_equal(joined, expected, err_msg=str(variable))
    np.testing.assert_allclose(np.concatenate([parts[0].time[:-1], parts[1].time]), whole.time, rtol=1e-12)
    np.testing.assert_array_equal(parts[1][LOOP_STATE].values, whole[LOOP_STATE].values)


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", WITHOUT_BITS)
def test_cvodes_continues_within_its_tolerance(name, tmp_path):
    scenario, first, second = halved(name)
    whole, (_, part) = aw.simulate(scenario), by_run(scenario, first, second, tmp_path)
    np.testing.assert_allclose(part.q[-1], whole.q[-1], rtol=1e-6, atol=1e-8)


STEPPED = [
    "puma560 rk3",
    "effect all",
    "schedule between ticks",
    "rk45",
    "in Python",
    "jitter and losses",
    "brake observer",
]


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", STEPPED)
def test_steps_are_the_run(name):
    scenario, first, second = halved(name)
    whole, simulation = aw.simulate(scenario), aw.simulation.Simulation(scenario)
    for _ in range(first + second):
        simulation.step()
    state = simulation.plant_state
    assert simulation.time == pytest.approx(float(whole.time[-1]))
    for signal in ("q", "qd"):
        np.testing.assert_array_equal(state[signal], whole[signal].isel(time=-1).values)


SENSORS = aw.Sensors(counts=4096, velocity="difference", position_noise=1e-4)
TIMING = aw.Timing("one-tick", command_delay=1.3e-3, measurement_loss=0.1)


@pytest.mark.sample(1)
@pytest.mark.parametrize("lanes", [None, 3])
def test_commands_from_outside_are_those_of_a_controller(lanes):
    """The same law in a loop around `step`, with encoders, noise, delays and losses."""
    law = aw.JointPID(kp=[90.0, 40.0], kd=[12.0, 6.0])
    q0 = [0.3, -0.5] if lanes is None else aw.Batch(np.linspace([0.3, -0.5], [0.1, 0.2], lanes))
    scenario = two_link(controller=law, q0=q0, sensors=SENSORS, timing=TIMING, seed=5)
    whole = aw.simulate(scenario)
    simulation = aw.simulation.Simulation(with_fields(scenario, controller=None))
    for k in range(scenario.ticks):
        y, r = simulation.measurement, simulation.reference_now
        np.testing.assert_array_equal(y.q, whole.q_measured.isel(time=k).values)
        u = np.array([90.0, 40.0]) * (r.q - y.q) - np.array([12.0, 6.0]) * y.qd
        simulation.step(u if lanes is None else aw.Batch(u))
    np.testing.assert_allclose(simulation.plant_state.q, whole.q.isel(time=-1).values, rtol=0, atol=1e-9)
    np.testing.assert_allclose(simulation.plant_state.qd, whole.qd.isel(time=-1).values, rtol=0, atol=1e-8)


def test_commands_of_a_python_controller_are_matched_to_the_bit():
    """A controller that is not compiled computes with the same NumPy operations as the loop around `step`."""
    scenario = controlled(controller=stubborn, sensors=SENSORS, timing=TIMING, duration=0.04)
    whole, simulation = aw.simulate(scenario), aw.simulation.Simulation(with_fields(scenario, controller=None))
    for _ in range(scenario.ticks):
        simulation.step(stubborn(simulation.time, simulation.reference_now, simulation.measurement))
    np.testing.assert_array_equal(simulation.plant_state.q, whole.q.values[-1])
    np.testing.assert_array_equal(simulation.plant_state.qd, whole.qd.values[-1])


def test_a_state_between_measurement_and_command_continues():
    simulation = aw.simulation.Simulation(two_link(controller=None, duration=None, sensors=SENSORS, timing=TIMING))
    simulation.step([1.0, 2.0])
    seen = simulation.measurement.q
    state = simulation.state
    ends = []
    for _ in range(2):
        np.testing.assert_array_equal(simulation.measurement.q, seen)
        simulation.step([3.0, -1.0])
        simulation.step([0.5, 0.5])
        ends.append(simulation.plant_state.q)
        simulation.restore(state)
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize("tick", [0, 3, 100])
def test_a_state_goes_on_at_another_tick_with_what_is_under_way(tick):
    """Commands and measurements in queues of 3 and 2 ticks, which no schedule and no noise tells the time."""
    timing = aw.Timing("one-tick", command_delay=2.0 * 4e-3, measurement_delay=2.0 * 4e-3)
    scenario = aw.Scenario(arm("two-link"), loop=aw.Loop(period=4e-3, timing=timing), start=[-1.2, 0.3])
    one, other = aw.simulation.Simulation(scenario), aw.simulation.Simulation(scenario)
    for k in range(7):
        one.step([20.0 * np.sin(k), 10.0 * np.cos(k)])
    other.restore(one.state.at_tick(tick))
    assert other.tick == tick
    for k in range(9):
        assert np.array_equal(one.measurement.q, other.measurement.q)
        assert np.array_equal(one.measurement.applied, other.measurement.applied)
        one.step([5.0 * k, 1.0])
        other.step([5.0 * k, 1.0])
    assert np.array_equal(one.plant_state.q, other.plant_state.q)


def test_steps_and_runs_mix_and_reset_returns_to_the_start():
    scenario = RUNS["jitter and losses"]()
    whole, simulation = aw.simulate(scenario), aw.simulation.Simulation(scenario)
    for _ in range(2):
        for _ in range(10):
            simulation.step()
        run = simulation.run((scenario.ticks - 10) * scenario.tick)
        np.testing.assert_array_equal(run.q.values, whole.q.values[:, 10:])
        np.testing.assert_array_equal(run.u.values, whole.u.values[:, 10:])
        simulation.reset()
        assert simulation.tick == 0


def test_rows_of_a_reference_belong_to_their_ticks():
    """Also after a reset, from a state, and beyond their end, where the last one stays."""
    rows = np.linspace([0.3, -0.5], [0.5, -0.4], 101)
    whole, simulation = aw.simulate(two_link(reference=rows)), aw.simulation.Simulation(two_link(reference=rows))
    simulation.run(0.05)
    state = simulation.state
    for _ in range(3):
        simulation.step()
    simulation.restore(state)
    np.testing.assert_array_equal(simulation.run(0.05).q.values, whole.q.values[50:])
    simulation.step()
    np.testing.assert_array_equal(simulation.reference_now.q, rows[-1])
    simulation.reset()
    np.testing.assert_array_equal(simulation.run(0.1).q.values, whole.q.values)
    with raises_at(ScenarioError, "loop.reference", r"\(7, 2\).* \(2,\)"):
        aw.simulation.Simulation(two_link(reference=rows[:7]))


@pytest.mark.parametrize("kept", [copy.deepcopy, copy.copy, lambda state: pickle.loads(pickle.dumps(state))])
def test_a_state_is_a_value(kept):
    """It does not change as the simulation goes on; copies and pickles of it are the same state."""
    scenario = RUNS["with memory"]()
    simulation = aw.simulation.Simulation(scenario)
    simulation.run(0.04)
    state = simulation.state
    before, other = {name: values.copy() for name, values in state.blocks.items()}, kept(state)
    ends = []
    for given in (state, other):
        simulation.restore(given)
        ends.append(simulation.run(0.02).q.values)
        for _ in range(3):
            simulation.step()
    np.testing.assert_array_equal(*ends)
    for name, values in before.items():
        np.testing.assert_array_equal(state.blocks[name], values)
    with pytest.raises(ValueError, match="read-only"):
        state.blocks["x"][:] = 0.0


def law(t, r, y):
    """PD."""
    return 300.0 * (r.q - y.q) + 30.0 * (r.qd - y.qd)


def another(t, r, y):
    """Holds the command that the drives realised."""
    return y.applied


@pytest.mark.study
def test_lanes_continue_under_another_controller():
    """The other controller measures first what the drives did with the last command that was in force."""
    model = arm("cmu-dd")
    q0 = aw.Batch(np.random.default_rng(0).uniform(-0.2, 0.2, (5, 6)))
    common = {"reference": np.full(6, 0.1), "period": 2e-3}
    first = aw.simulate(scenario_of(model, controller=law, q0=q0, duration=0.1, **common))
    second = aw.simulate(scenario_of(model, controller=law, start=first, duration=0.1, **common))
    held = aw.simulate(scenario_of(model, controller=another, start=first, duration=0.01, **common))
    np.testing.assert_allclose(held.u.values[:, 0], first.u.values[:, -2], rtol=1e-9, atol=1e-9)
    assert "controller 'another' began anew at t = 0.1 s, behind 'law'" in held.attrs["notes"]
    assert "began anew" not in second.attrs.get("notes", "")
    one = aw.simulate(scenario_of(model, controller=law, start=first.isel(lane=3), duration=0.1, **common))
    np.testing.assert_array_equal(one.q.values, second.q.values[3])
    spread = aw.simulate(
        scenario_of(model, controller=aw.JointPID(kp=aw.Batch([100.0, 200.0])), start=one, duration=0.01, **common)
    )
    np.testing.assert_array_equal(spread.q.values[:, 0], np.broadcast_to(one.q.values[-1], (2, 6)))
    assert spread.time.values[0] == pytest.approx(0.2)


def test_schedules_and_references_keep_their_own_times():
    rows = aw.Schedule([0.0, 0.03, 0.06], [[5, 1], [-5, 2], [0, 0]], ["shoulder", "elbow"])
    first = aw.simulate(aw.Scenario(arm("two-link"), command=rows, duration=0.05))
    second = aw.simulate(aw.Scenario(arm("two-link"), command=rows, start=first, duration=0.05))
    np.testing.assert_array_equal(second.u.values[[0, 9, 10]], [[-5, 2], [-5, 2], [0, 0]])
    np.testing.assert_allclose(second.time.values[[0, -1]], [0.05, 0.1])


def test_a_simulation_from_outside_continues_under_a_controller():
    scenario = two_link(controller=None, duration=None)
    simulation = aw.simulation.Simulation(scenario)
    for _ in range(20):
        simulation.step([1.0, -0.5])
    run = aw.simulate(two_link(start=simulation.state, q0=None, qd0=None, duration=0.02))
    np.testing.assert_array_equal(run.q.values[0], simulation.plant_state.q)
    assert "began anew" not in run.attrs.get("notes", "")


def test_a_brake_stays_as_bent_as_it_was():
    model = pendulum("torque", motor=MOTOR, brake=BRAKE)
    common = {"command": [3.0], "brake": 1, "step": 5e-4}
    whole = aw.simulate(scenario_of(model, duration=0.1, **common))
    first = aw.simulate(scenario_of(model, duration=0.05, **common))
    second = aw.simulate(scenario_of(model, start=first, duration=0.05, **common))
    np.testing.assert_array_equal(second.q.values, whole.q.values[100:])
    unbraked = aw.simulate(aw.Scenario(model, command=[3.0], duration=0.05, solver=aw.Solver(step=5e-4)))
    fresh = aw.simulate(scenario_of(model, start=unbraked, duration=0.05, **common))
    assert fresh.brake.values[0, 0] == 0.0
    np.testing.assert_array_equal(fresh.q.values[0], unbraked.q.values[-1])
    released = aw.simulate(aw.Scenario(model, start=first, command=[3.0], duration=0.05, solver=aw.Solver(step=5e-4)))
    np.testing.assert_array_equal(released.qd.values[0], first.qd.values[-1])


def test_a_run_in_real_time_takes_as_long_as_the_motion():
    simulation = aw.simulation.Simulation(two_link())
    simulation.run(1.0)
    began = time.monotonic()
    slow = simulation.run(0.3, real_time=True)
    took = time.monotonic() - began
    assert 0.25 < took < 2.0
    simulation.reset()
    simulation.run(1.0)
    np.testing.assert_array_equal(slow.q.values, simulation.run(0.3).q.values)


RUN = aw.simulate(aw.Scenario(arm("two-link"), command=[1.0, 1.0], duration=0.01))
STATE = aw.simulation.LoopState.of_run(RUN)
assert STATE is not None
RENAMED = dataclasses.replace(STATE, entries=("q a", *STATE.entries[1:]))


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"start": "run.nc"}, r"start\.q = 'run\.nc': expected 2 numbers"),
        (
            {"start": RUN.isel(time=slice(0))},
            "start: .*without rows; .* t = 0.01 s",
        ),
        ({"start": RUN.isel(time=slice(5))}, "start: .*to t = 0.004 s; "),
        ({"start": RUN.drop_vars(LOOP_STATE)}, "start: .*loop_state"),
        (
            {"start": RUN.assign_coords(joint=["a", "b"])},
            r"start = \['a', 'b'\]: .*other joints",
        ),
        ({"start": RENAMED}, "start: .*'q a'; .*4 numbers of two-link"),
        ({"start": RUN, "step": 5e-4}, r"solver\.step = 0\.0005: .*, 0\.001 s"),
        ({"start": RUN.isel(state_entry=[0])}, "loop_state cannot be read"),
    ],
)
def test_what_is_no_start_is_refused(fields, said):
    with pytest.raises(ScenarioError, match=said):
        scenario_of(arm("two-link"), command=[1.0, 1.0], duration=0.01, **fields)


def test_a_state_of_another_arm_or_of_other_lanes_is_refused():
    with raises_at(ScenarioError, "start", "12 numbers of puma560"):
        aw.Scenario(arm("puma560"), command=np.zeros(6), duration=0.01, start=STATE)
    bare = aw.simulate(
        aw.Scenario(
            MANY["elastic"],
            command=[1.0],
            duration=0.01,
            solver=aw.Solver(step=2e-4),
            recording=aw.Recording(what="state"),
        )
    )
    with raises_at(ScenarioError, "start", "loop_state"):
        aw.Scenario(MANY["elastic"], command=[1.0], duration=0.01, start=bare, solver=aw.Solver(step=2e-4))
    lanes = aw.simulation.Simulation(aw.Scenario(arm("two-link"), command=aw.Batch(np.zeros((3, 2))), duration=0.01))
    other = aw.simulation.Simulation(aw.Scenario(arm("two-link"), command=aw.Batch(np.zeros((4, 2))), duration=0.01))
    with raises_at(ScenarioError, "state", "3 lanes; .* 4"):
        other.restore(lanes.state)
    with raises_at(ScenarioError, "start", "3 lanes; .* 4, .* command"):
        dataclasses.replace(other.scenario, start=lanes.state)
    with raises_at(ScenarioError, "start", "'q elbow'.* 2 numbers of chain"):
        aw.simulation.Simulation(aw.Scenario(MANY["plain"], command=[0.0], duration=0.01)).restore(STATE)


def test_a_lane_that_diverged_is_no_start():
    qd0 = aw.Batch([[0.0, 0.0], [1e200, 0.0]])
    run = aw.simulate(aw.Scenario(arm("two-link"), command=np.zeros(2), duration=0.01, start=aw.Start(qd=qd0)))
    with raises_at(ScenarioError, "start", "lane 1 .* t = 0 s"):
        aw.Scenario(arm("two-link"), command=np.zeros(2), duration=0.01, start=run)
    aw.simulate(aw.Scenario(arm("two-link"), command=np.zeros(2), duration=0.01, start=run.isel(lane=0)))


def test_a_file_that_is_no_state_is_refused(tmp_path):
    (tmp_path / "text.npz").write_text("text")
    np.savez(tmp_path / "other.npz", q=np.zeros(2))
    for name in ("text.npz", "other.npz", "missing.npz"):
        with raises_at(RunError, file=tmp_path / name):
            aw.simulation.LoopState.load(tmp_path / name)


def test_commands_that_do_not_fit_are_refused():
    driven, outside = (
        aw.simulation.Simulation(two_link()),
        aw.simulation.Simulation(two_link(controller=None, duration=None)),
    )
    with raises_at(ScenarioError, "command", "^command: beside"):
        driven.step([0.0, 0.0])
    with raises_at(ScenarioError, "command", "missing"):
        outside.step()
    with raises_at(ScenarioError, "command", r"\(3,\).* \(2,\)"):
        outside.step([0.0, 0.0, 0.0])
    with raises_at(ScenarioError, "command", "nothing drives"):
        outside.run(0.01)


def test_statistics_and_tables_leave_the_state_out(tmp_path):
    run = aw.simulate(RUNS["two-link of 100 lanes"]())
    assert LOOP_STATE in run
    assert LOOP_STATE not in aw.statistics(run)
    aw.save(run, tmp_path / "run.csv")
    assert LOOP_STATE not in (tmp_path / "run.csv").read_text(encoding="utf-8").partition("\n")[0]

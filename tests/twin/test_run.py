"""Controllers over the bus: in lock-step exactly the simulation, in real time counted; and what is refused before it moves."""

import re
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import BusError, Interrupted, RunStopped
from armwright.twin.bus import BusLoad
from armwright.twin.faults import Fault
from armwright.twin.on_bus import scenario_on_bus
from armwright.twin.rehearsal import rehearse
from armwright.twin.run import run_controller
from armwright.twin.safety import Permission
from armwright.twin.state_machine import State
from armwright.twin.twin import Twin
from raises_at import raises_at

from .conftest import Client

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def lwa4p():
    """The tuned controller of the LWA 4P at 4 ms, which loses 2 % of the samples, with a planned motion that it follows."""
    scenario = aw.read_scenario(EXAMPLES / "bus-4ms.scenario.toml")
    motion = aw.trajectories.plan(EXAMPLES / "motions" / "throw.motion.toml").motion
    loop = replace(scenario.loop, reference=motion)
    return replace(scenario, lanes=None, vary={}, duration=1.2, start=motion.motions[0].start, loop=loop)


@pytest.mark.study
def test_in_lock_step_the_twin_is_the_simulation_to_the_bit(lwa4p, bus):
    expected = aw.simulate(scenario_on_bus(lwa4p))
    with Twin(lwa4p, bus) as twin:
        run = run_controller(lwa4p, bus)
    assert run.equal
    n = len(run.time)
    assert n == 300
    assert np.array_equal(run.u, expected["u_issued"].values[:n])
    assert np.array_equal(run.q, expected["q_measured"].values[:n])
    reference = expected["q_reference"].values[:n]
    assert np.array_equal(run.errors, reference - expected["q_measured"].values[:n])
    assert np.abs(run.errors).max() > 1e-3  # it did move
    assert np.any(run.rehearsal.recording.lost)
    assert np.any(np.abs(run.u) == run.rehearsal.units.limit)  # and was saturated
    assert [drive.state for drive in twin.drives] == [State.QUICK_STOP] * 6  # held: the record has no brakes
    assert run.cycles.incomplete == 0


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    "changes",
    [
        {"sensors": aw.Sensors(counts=20_000, side="link", velocity="filtered", cutoff_hz=30.0, position_noise=1e-4)},
        {"timing": aw.Timing("sync", measurement_delay=6e-3, command_loss=0.05)},
        {"timing": aw.Timing("sync", command_delay=3e-3, jitter=3e-3)},
        {"command_filter": aw.CommandFilter(limit=[60.0, 20.0], rate=[3000.0, 1000.0])},
        {
            "controller": aw.Cascade(
                15.0, [500.0, 120.0], position_every=3, position_phase=2, speed_every=2, delay_ticks=1
            )
        },
    ],
)
def test_whatever_the_loop_has_it_is_the_same(scenario, bus, changes):
    changed = replace(scenario, duration=0.4, loop=replace(scenario.loop, **changes), seed=5)
    with Twin(changed, bus):
        run = run_controller(changed, bus, following_error=1.0)
    assert run.first_difference is None
    assert run.equal


def test_a_twin_that_is_another_arm_is_not_the_simulation(scenario, bus):
    heavier = replace(scenario, vary={"forearm.mass_kg": 4.1})
    with Twin(heavier, bus):
        run = run_controller(scenario, bus)
    assert not run.equal
    found = run.first_difference
    assert (found.tick, found.joint, found.signal) == (0, "shoulder", "applied")  # what holds a heavier arm
    assert np.abs(run.errors).max() < 0.05


@pytest.mark.study
def test_in_real_time_cycles_are_counted(scenario, bus):
    """Two seconds by the clock; how many are late is the machine's, that all are counted is ours."""
    gentle = aw.Cascade(position_kp=3.0, speed_kp=[150.0, 40.0], speed_ki=[300.0, 80.0], delay_ticks=1)  # bears delays
    longer = replace(scenario, duration=2.0, loop=replace(scenario.loop, controller=gentle, reference=None))
    with Twin(longer, bus) as twin:
        started = time.perf_counter()
        try:
            run = run_controller(longer, bus, real_time=True, following_error=1.0, heartbeat=10.0, missing=5)
        except RunStopped as error:  # a machine that does other work for 20 ms
            run, why = error.run, str(error)
        spent = time.perf_counter() - started
    report = run.cycles
    assert run.complete or "has not answered since" in why
    assert spent >= 4e-3 * len(run.time) - 0.01
    assert run.complete == (len(run.time) == 500)
    assert 0 <= report.cycles - len(run.time) <= 1
    assert 0 <= report.incomplete <= 500
    assert 0 <= report.late <= 500
    assert 0.0 <= report.jitter <= report.worst
    assert report.work <= report.longest
    assert report.load > 0.0
    assert twin.cycles.report.cycles >= report.cycles
    assert all(drive.state is State.QUICK_STOP for drive in twin.drives)


def test_a_fault_ends_the_run_and_stops_the_other_drives(scenario, bus):
    with Twin(scenario, bus, faults=[Fault("stuck-encoder", "elbow", 0.2, 5.0)]) as twin:
        with pytest.raises(BusError) as error:
            run_controller(scenario, bus, following_error=1.0)
        assert twin.drives[1].state is State.FAULT
        assert twin.drives[0].state is State.QUICK_STOP
    assert "joint 'elbow': node 4 of elbow is in state" in str(error.value)
    assert "error 0x7305: encoder and commutation differ" in str(error.value)


def test_a_following_error_ends_the_run(scenario, bus):
    with Twin(scenario, bus) as twin:
        with raises_at(BusError, re.compile("joint '.*'"), r" 0\.008 s; .* quick stop"):
            run_controller(scenario, bus, following_error=1e-4)
        assert not any(drive.state is State.ENABLED for drive in twin.drives)


def test_letting_go_of_the_key_ends_the_run(scenario, bus):
    presses = iter([True] * 20)
    with Twin(scenario, bus) as twin:
        run = run_controller(scenario, bus, permission=Permission(may_move=lambda: next(presses, False)))
        assert all(drive.state is State.QUICK_STOP for drive in twin.drives)
    assert len(run.time) == 20


def test_an_interrupted_run_stops_the_arm_says_its_state_and_closes_the_bus(scenario, bus):
    presses = iter([True] * 20)

    def interrupt():
        if next(presses, False):
            return True
        raise KeyboardInterrupt

    before = threading.active_count()
    with Twin(scenario, bus) as twin:
        with pytest.raises(Interrupted) as stop:
            run_controller(scenario, bus, permission=Permission(may_move=interrupt))
        assert all(drive.state is State.QUICK_STOP for drive in twin.drives)
    run = stop.value.run
    assert len(run.time) == 20
    assert not run.complete
    assert run.ending.held
    assert str(run.ending) in str(stop.value)
    assert threading.active_count() == before


def test_an_arm_that_stands_elsewhere_is_refused(scenario, bus):
    with Twin(replace(scenario, start=[-1.0, 0.0]), bus) as twin:
        with pytest.raises(BusError) as error:
            run_controller(scenario, bus)
        assert twin.simulation.tick == 0
    assert str(error.value) == "start.q = -1.2: joint 'shoulder' stands at -1; expected where the arm stands"


def test_nodes_that_are_not_there(scenario, bus):
    with Twin(scenario, bus), pytest.raises(BusError) as error:
        run_controller(scenario, bus, nodes=[3, 9])
    assert str(error.value).startswith(f"nodes = 9: node 9 does not answer on {bus}; expected")


def test_foreign_data_sheets(scenario, bus, tmp_path):
    empty, foreign = tmp_path / "empty.eds", tmp_path / "foreign.eds"
    empty.write_text("no sheet", encoding="utf-8")
    foreign.write_text(
        "[DeviceInfo]\nVendorName=x\n[1000]\nParameterName=t\nDataType=7\nAccessType=ro\n", encoding="utf-8"
    )
    for path, message in (
        (empty, "no EDS"),
        (foreign, "lacks the objects 6007, 6040"),
        (tmp_path / "no", "no such file"),
    ):
        with pytest.raises(BusError) as error:
            run_controller(scenario, bus, eds=[str(path)])
        assert message in str(error.value)
        assert error.value.file == str(path)
        assert "\n" not in str(error.value)


def test_nodes_with_another_mapping(scenario, bus):
    with Twin(scenario, bus) as twin:
        twin.nodes[1].drive.values[0x1A00, 0] = 2
        with raises_at(BusError, "object 1A00", "node 4 of elbow .* 6041:0, 6077:0; .* 6041:0, 6077:0, 6064:0"):
            run_controller(scenario, bus)
        assert twin.simulation.tick == 0


def limited(scenario, **changes):
    return replace(scenario, loop=replace(scenario.loop, **changes))


def test_what_a_bus_does_not_carry_is_refused_early(scenario):
    refused = [
        (replace(scenario, loop=None, command=[0.0, 0.0]), "loop.controller: no controller"),
        (limited(scenario, sensors=aw.Sensors(side="link", current_noise=0.1)), "loop.sensors.current_noise = 0.1"),
        (limited(scenario, sensors=aw.Sensors(counts=100)), "loop.sensors.side = 'motor'"),
        (limited(scenario, period=1.0e-3), "loop.period = 0.001: 2 nodes load a bus"),
        (replace(scenario, lanes=2, seed=1, vary={"forearm.mass_kg": aw.Draw.uniform(4.0, 5.0)}), "lanes: 2 lanes"),
    ]
    for each, message in refused:
        with pytest.raises(BusError) as error:
            scenario_on_bus(each)
        assert str(error.value).startswith(message)
        assert "\n" not in str(error.value)


def test_all_that_is_wrong_is_said_at_once(scenario):
    """The period, the encoders' side, the nodes and the record, each with what mends it."""
    wrong = limited(replace(scenario, arm=aw.load("two-link")), period=1.0e-3, sensors=aw.Sensors(counts=100))
    with pytest.raises(BusError) as error:
        rehearse(wrong, nodes=[3, 3])
    said = [str(each) for each in error.value.problems]
    assert [problem.place for problem in error.value.problems] == [
        "loop.period",
        *["joint 'shoulder' limits"] * 2,
        *["joint 'elbow' limits"] * 2,
        "loop.sensors.side",
        "nodes",
    ]
    for text, remedy in zip(said, ["--bitrate", *["in the record"] * 4, "side = 'link'", "--nodes"], strict=True):
        assert remedy in text


@pytest.mark.parametrize(
    ("arguments", "places"),
    [
        ({"following_error": np.nan}, ["following_error"]),
        ({"following_error": np.inf}, ["following_error"]),
        ({"following_error": 0}, ["following_error"]),
        ({"following_error": -1.0}, ["following_error"]),
        ({"following_error": [0.1, 0.1, 0.1]}, ["following_error"]),
        ({"missing": 0}, ["missing"]),
        ({"missing": 6}, ["missing"]),  # 20 ms are 5 cycles
        ({"heartbeat": 0.0}, ["heartbeat"]),
        ({"heartbeat": 22.0}, ["heartbeat"]),
        ({"following_error": "no", "missing": 1.5, "heartbeat": np.nan}, ["following_error", "missing", "heartbeat"]),
        ({"bitrate": 0}, ["bitrate"]),
        ({"bus": None}, ["bus"]),
    ],
)
def test_monitors_are_numbers(scenario, bus, arguments, places):
    with Twin(scenario, bus) as twin:
        with pytest.raises(BusError) as error:
            run_controller(scenario, **{"bus": bus, "real_time": True, **arguments})
        assert twin.simulation.tick == 0
    assert [problem.place for problem in error.value.problems] == places
    assert all(problem.expected for problem in error.value.problems)


def test_servos_are_sent_to_their_own_line():
    loop = aw.Loop(aw.JointPID(kp=1.0), np.zeros(6), period=0.02)
    with pytest.raises(BusError) as caught:
        rehearse(aw.Scenario("so101", 0.1, loop=loop))
    assert all("--serial" in problem.expected for problem in caught.value.problems)


def test_drives_that_take_voltages_are_refused():
    loop = aw.Loop(lambda t, r, y: 0.0 * y.q, period=4e-3)
    with raises_at(BusError, "command", "puma560", value="voltage"):
        scenario_on_bus(aw.Scenario(aw.load("puma560"), duration=0.1, loop=loop))


def test_motions_beyond_the_limits_are_refused_before_they_happen(scenario):
    def far(t):
        return aw.scalar.array([-1.2 - 1.5 * t, 0.0 * t])

    def fast(t):
        return aw.scalar.array([-1.2 + 3.0 * t, 0.0 * t])

    with raises_at(BusError, "joint 'shoulder'", r"-2\.00.* -2 to 2"):
        rehearse(limited(scenario, reference=far))
    with raises_at(BusError, "joint 'shoulder'", r"speed .* at most 2, "):
        rehearse(replace(limited(scenario, reference=fast), duration=0.4))


def test_the_delay_is_the_bus_times(scenario):
    timing = scenario_on_bus(scenario).loop.timing
    assert timing.preset == "sync"
    assert timing.command_delay == pytest.approx(BusLoad(2, 4e-3).cycle(stuffed=True))


@pytest.mark.study
def test_a_second_run_begins_the_scenario_anew(scenario, bus):
    """The twin holds the arm between two runs; a wrench that acts from 0.2 s on acts in the second one from then on, too."""
    rows = [[0.0] * 6, [30.0, -20.0, 0.0, 0.0, 0.0, 5.0], [0.0] * 6]
    push = aw.Schedule([0.0, 0.2, 0.4], rows, ["fx", "fy", "fz", "mx", "my", "mz"])
    here = [-1.2, 0.0]
    pushed = replace(scenario, duration=0.6, loop=replace(scenario.loop, reference=here), inputs=aw.Inputs(wrench=push))
    with Twin(pushed, bus) as twin:
        first = run_controller(pushed, bus, following_error=1.5)
        with Client(twin) as client:  # the drives' position loops settle
            client.sync(300)
        stands = np.array([drive.true for drive in twin.drives]) * first.rehearsal.units.count
        second = run_controller(replace(pushed, start=stands), bus, following_error=1.5)
    moved = np.abs(np.diff(second.q[:, 0])).max()
    assert moved > 0.2 * np.abs(np.diff(first.q[:, 0])).max()

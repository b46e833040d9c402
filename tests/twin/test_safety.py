"""Nothing moves by a typing error: what a bus that leaves the process, and a real arm, require before they move."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import armwright as aw
from armwright.cli.dead_man import Key
from armwright.errors import BusError, RunStopped
from armwright.twin import objects as od
from armwright.twin.bus import node_numbers
from armwright.twin.rehearsal import rehearse
from armwright.twin.run import run_controller
from armwright.twin.safety import Permission, reduced
from armwright.twin.twin import Twin
from raises_at import raises_at


@pytest.fixture
def outside(monkeypatch):
    """Virtual buses count as ones that leave this process."""
    monkeypatch.setattr("armwright.twin.safety.is_virtual", lambda name: False)


@pytest.fixture(scope="module")
def short(scenario):
    """A run of 20 ms, slowed to 80 ms."""
    return reduced(replace(scenario, duration=0.02), 0.25, 0.5)


@pytest.fixture
def metal(scenario, bus, outside):
    """Drives that say that they are a real arm, with serial number 7."""
    with Twin(scenario, bus, serial=7) as twin:
        for drive in twin.drives:
            drive.values[od.VENDOR] = 0x1234
        yield twin


PASSED = SimpleNamespace(passed=True)
SLOW = {"serial": 7, "verdict": PASSED, "speed": 0.25, "torque": 0.5, "may_move": lambda: True}


def test_a_twin_outside_needs_its_number(scenario, short, bus, outside):
    with Twin(scenario, bus, serial=7) as twin:
        for permission, message in (
            (Permission(), "arm = None: the drives on this bus may be those of a real arm; expected its serial number"),
            (
                Permission(serial=8),
                "arm = 8: node 3 of shoulder has serial number 7; expected the number of every node",
            ),
        ):
            with pytest.raises(BusError) as error:
                run_controller(short, bus, permission=permission)
            assert str(error.value).startswith(message)
            assert twin.simulation.tick == 0
        assert run_controller(short, bus, permission=Permission(serial=7)).complete


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    ("changes", "real_time", "message"),
    [
        (
            {"verdict": None},
            True,
            "verdict: no verdict on this scenario; expected a passing one of `armwright validate",
        ),
        ({"verdict": SimpleNamespace(passed=False)}, True, "verdict: "),
        ({}, False, "real_time = False: a real arm runs in real time"),
        ({"may_move": None}, True, "may_move = None: no dead-man key"),
        ({"speed": 1.0}, True, "speed = 1.0: speed 1 and torque 0.5 before a reduced run that counts"),
        ({"torque": 1.0}, True, "speed = 0.25: speed 0.25 and torque 1 before a reduced run"),
    ],
)
def test_an_arm_of_metal_needs_all_of_it(short, metal, changes, real_time, message):
    with pytest.raises(BusError) as error:
        run_controller(short, metal.bus, real_time=real_time, permission=Permission(**SLOW | changes))
    assert str(error.value).startswith(message)
    assert metal.simulation.tick == 0
    assert [drive.machine.passed for drive in metal.drives] == [[0, 1], [0, 1]]  # nothing was enabled


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        (od.RATED_TORQUE, 150_000, "object 6076: node 3 of shoulder has a rated torque of 150 N m; expected 300 N m"),
        ((0x608F, 1), 4096, "object 608F: node 3 of shoulder has 4096 counts; expected 360000, loop.sensors.counts"),
    ],
)
def test_drives_with_other_units_are_refused(short, metal, key, value, message):
    metal.drives[0].values[key] = value
    with pytest.raises(BusError) as error:
        run_controller(short, metal.bus, real_time=True, permission=Permission(**SLOW))
    assert str(error.value).startswith(message)


def test_a_reduced_run_is_stored_and_lets_a_full_one_go(scenario, short, metal, tmp_path):
    path = tmp_path / "arm.scenario.toml"
    said = {**SLOW, "path": path, "sha256": "abc"}
    lenient = {"following_error": 1.0, "heartbeat": 10.0, "missing": 5}
    try:
        counts = run_controller(short, metal.bus, real_time=True, permission=Permission(**said), **lenient).counts
    except RunStopped:  # on a machine that was busy just then: a node's answers came too late
        counts = False
    assert counts == path.with_suffix(".bus.toml").exists()
    facts = {"bus": metal.bus, "bitrate": 500_000, "nodes": [3, 4]}
    facts |= {"vendors": [0x1234] * 2, "products": [od.TWIN_PRODUCT] * 2, "serials": [7, 7]}
    if not counts:
        Permission(**said).write_reduced(facts)
    full = Permission(**said | {"speed": 1.0, "torque": 1.0})
    assert full.has_run_reduced(facts)
    assert not replace(full, sha256="changed").has_run_reduced(facts)
    assert not replace(full, serial=8).has_run_reduced(facts)
    others = {"bus": "socketcan:can1", "bitrate": 250_000, "nodes": [4, 3], "vendors": [0x1234, 0x1235]}
    others |= {"products": [1, 2], "serials": [7, 8]}
    for name, value in others.items():
        assert not full.has_run_reduced({**facts, name: value}), name
    kept = path.with_suffix(".bus.toml").read_text(encoding="utf-8")
    path.with_suffix(".bus.toml").write_text(kept.replace("speed = 0.25", "speed = 0.5"), encoding="utf-8")
    assert not full.has_run_reduced(facts)
    assert metal.drives[0].values[od.CONSUMER] == 1 << 16 | 30_000
    assert metal.drives[0].values[od.ABORT_OPTION] == 3
    assert metal.drives[0].values[od.MAX_TORQUE] == 500


def test_the_verdict_is_the_scenarios_own(scenario, tmp_path):
    path = tmp_path / "arm.scenario.toml"
    path.write_text("x = 1\n", encoding="utf-8")
    permission = Permission.of(path, scenario, serial=3)
    assert permission.verdict is None
    assert permission.serial == 3
    assert len(permission.sha256) == 64


def test_a_step_at_the_start_is_said(scenario):
    began = scenario.initial_state[0, : scenario.arm.n]
    still = rehearse(replace(scenario, loop=replace(scenario.loop, reference=began)))
    away = rehearse(replace(scenario, loop=replace(scenario.loop, reference=began + 0.05 * np.eye(len(began))[0])))
    said = [line for line in away.sentences() if line not in still.sentences()]
    assert [line.partition(": ")[0] for line in said] == [scenario.arm.names[0]]
    assert "0.05 rad" in said[0]


def test_reduced_runs_are_slower_and_weaker(scenario):
    full, slow = rehearse(scenario), rehearse(reduced(scenario, 0.25, 0.3))
    assert slow.recording.ticks == 4 * full.recording.ticks
    assert np.all(slow.largest_speed < 0.4 * full.largest_speed)
    assert np.all(slow.largest_command <= 0.3)
    assert slow.reference[-1] == pytest.approx(full.reference[-1], abs=0.02)
    tick = 100  # positions at a quarter of the time, speeds a quarter, accelerations a sixteenth
    n = 2
    assert slow.recording.r[4 * tick, n : 2 * n] == pytest.approx(full.recording.r[tick, n : 2 * n] / 4.0)
    assert slow.recording.r[4 * tick, 2 * n :] == pytest.approx(full.recording.r[tick, 2 * n :] / 16.0)


@pytest.mark.parametrize(
    ("speed", "torque", "name"), [(0.0, 1.0, "speed"), (1.0, 1.5, "torque"), (np.nan, 1.0, "speed")]
)
def test_parts_that_are_none(scenario, speed, torque, name):
    with raises_at(BusError, name, "at most 1"):
        reduced(scenario, speed, torque)


def test_tables_are_not_slowed(scenario):
    rows = np.zeros((201, 2))
    with raises_at(BusError, "speed", "table", value=0.5):
        reduced(replace(scenario, loop=replace(scenario.loop, reference=rows)), 0.5)


def test_the_key_has_to_be_held():
    clock, typed = [0.0], [""]

    def at(time, characters=""):
        clock[0], typed[0] = time, characters
        return key()

    key = Key(lambda: typed[0], lambda: clock[0])
    assert not at(0.0)
    assert not at(1.0, "x")
    assert at(2.0, " ")  # pressed
    assert at(2.5)  # the terminal repeats after half a second
    assert at(2.6, " ")
    assert at(2.8)
    assert not at(2.9)  # let go
    assert not at(3.0, " ")  # and it stays so


def test_a_slower_run_has_its_bodies_and_forces_where_the_full_one_has_them(scenario):
    body, rows = aw.Payload(0.1, 2.0, [0.0, 0.0, 0.1], [1e-3] * 3), [[0.0] * 6, [30.0, -20.0, 0.0, 0.0, 0.0, 5.0]]
    push = aw.Schedule([0.0, 0.2], rows, ["fx", "fy", "fz", "mx", "my", "mz"])
    for given in (aw.Inputs(wrench=push, payload=body), aw.Inputs(wrench=aw.Batch([push]), payload=[body])):
        slow = reduced(replace(scenario, inputs=given), 0.25)
        assert slow.input_schedules["wrench"][0].times == pytest.approx([0.0, 0.8])
        assert slow.input_schedules["payload"].times == pytest.approx(np.array([[0.0, 0.4]]))
    of_a_lane = replace(body, time=aw.Batch([0.1]))
    assert reduced(replace(scenario, inputs=aw.Inputs(payload=of_a_lane)), 0.5).inputs.payload.time.values == [0.2]
    constant = aw.Inputs(wrench=rows[1])
    assert reduced(replace(scenario, inputs=constant), 0.5).inputs.wrench == rows[1]


def test_a_slower_or_weaker_run_has_the_supply_of_the_full_one(scenario):
    falling = aw.Schedule([0.0, 0.4], [[24.0], [20.0]], ["supply"])
    full = replace(scenario, inputs=aw.Inputs(supply=falling))
    slow, weak = reduced(full, 0.25).input_schedules["supply"][0], reduced(full, 1.0, 0.5).input_schedules["supply"][0]
    assert (list(slow.times), list(weak.times)) == ([0.0, 1.6], [0.0, 0.4])
    assert slow.commands.tolist() == weak.commands.tolist() == [[24.0], [20.0]]
    assert reduced(replace(full, inputs=aw.Inputs(supply=22.0)), 0.5).inputs.supply == 22.0


@pytest.mark.parametrize(("speed", "torque"), [(0.5, 1.0), (1.0, 0.5)])
def test_a_slower_or_weaker_run_grips_what_its_motion_grips(scenario, speed, torque):
    def motion(t):
        return scenario.loop.reference(t)

    motion.payloads = (aw.Payload(0.1, 2.0, [0.0, 0.0, 0.1], [1e-3] * 3), aw.Payload(0.2, 0.0))
    found = reduced(replace(scenario, loop=replace(scenario.loop, reference=motion)), speed, torque)
    assert [each.time for each in found.carried] == [0.1 / speed, 0.2 / speed]
    moved = replace(found, loop=replace(found.loop, reference=None))  # as where a limited move takes its place
    assert [each.time for each in moved.carried] == [0.1 / speed, 0.2 / speed]


@pytest.mark.parametrize(
    "nodes", [[[1], [2, 3]], 5, np.array(5), "ab", {}, [3.0, 4], [3, 3], [[3, 4]], [0, 1], [True, 3]]
)
def test_numbers_of_nodes_that_are_none(nodes: Any) -> None:
    with raises_at(BusError, "nodes", "2 .* 1 to 127"):
        node_numbers(nodes, 2)

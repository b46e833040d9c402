"""Monitors of the master, one by one: each trips where it must, when it must, and not before; on a bus whose time is counted."""

import contextlib
import os
import re
import sys
from dataclasses import replace
from types import SimpleNamespace

import can
import numpy as np
import pytest

import armwright as aw
from armwright.cli.dead_man import Key, _waiting
from armwright.errors import BusError, RunStopped
from armwright.model import Brake
from armwright.twin import objects as od
from armwright.twin.law import Law
from armwright.twin.master import Ending
from armwright.twin.rehearsal import _too_fast, rehearse
from armwright.twin.run import run_controller
from armwright.twin.safety import Permission, joints_without_brake
from armwright.twin.state_machine import State
from armwright.twin.twin import Twin
from raises_at import raises_at
from twin.simulated_bus import simulated

PERIOD = 4e-3
ENABLE, QUICK_STOP, SYNC = 0x0F, 0x02, 0x80
FAULT = 0x08


@pytest.fixture(scope="module")
def rehearsal(scenario):
    pytest.importorskip("canopen", reason='buses: pip install "armwright[twin]"')
    gentle = aw.Cascade(position_kp=3.0, speed_kp=[150.0, 40.0], speed_ki=[300.0, 80.0], delay_ticks=1)  # bears losses
    return rehearse(replace(scenario, loop=replace(scenario.loop, controller=gentle)))


@pytest.fixture
def outside(monkeypatch):
    """Virtual buses count as ones that leave this process."""
    monkeypatch.setattr("armwright.twin.safety.is_virtual", lambda name: False)


class Ticks:
    """A disturbance that knows the tick: 0 is the SYNC at which the drives are enabled. `change` returns what arrives."""

    def __init__(self, bus, change):
        self.bus, self.change, self.first = bus, change, None
        bus.disturbance = self

    def __call__(self, frame, sender, bus):
        if self.first is None and 0x200 <= frame.arbitration_id < 0x280 and frame.data[0] == ENABLE:
            self.first = bus.syncs + 1
        tick = -1 if self.first is None else bus.syncs - self.first
        return self.change(frame, sender is bus.ends[0], tick)


def disturbed(rehearsal, monkeypatch, change, name="virtual", metal=False, **options):
    """The run, the error that ended it or None, the bus, and the twin."""
    bus = simulated(monkeypatch)
    with Twin(rehearsal.source, "virtual", serial=7) as twin:
        for drive in twin.drives if metal else ():
            drive.values[od.VENDOR] = 0x1234
        change.bus = bus
        Ticks(bus, change)
        try:
            run = run_controller(rehearsal, name, **{"real_time": True, "following_error": 1.9, **options})
        except RunStopped as error:
            return error.run, error, bus, twin
        return run, None, bus, twin


def frame(can_id, data):
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


def answer(node, from_twin, each):
    return from_twin and each.arbitration_id == 0x180 + node


def moved(each, counts=0, status=None):
    """An answer with another position, or another statusword."""
    at = int.from_bytes(each.data[4:], "little", signed=True) + counts
    word = bytes(each.data[:2]) if status is None else status.to_bytes(2, "little")
    return frame(each.arbitration_id, word + bytes(each.data[2:4]) + at.to_bytes(4, "little", signed=True))


def late(bus):
    """Time [s] from the last command that enables to the first quick stop."""
    words = [(time, data[0]) for time, can_id, data in bus.sent if 0x200 <= can_id < 0x280]
    last = max(time for time, word in words if word == ENABLE)
    return next(time for time, word in words if word == QUICK_STOP and time >= last) - last


def test_without_a_disturbance_the_run_is_complete(rehearsal, monkeypatch):
    run, error, *_ = disturbed(rehearsal, monkeypatch, lambda each, from_twin, tick: [each])
    assert error is None
    assert run.complete
    assert run.counts


def test_three_heartbeats_that_are_missing(rehearsal, monkeypatch):
    def change(each, from_twin, tick):
        return [] if from_twin and each.arbitration_id == 0x703 and tick >= 20 else [each]

    run, error, bus, _ = disturbed(rehearsal, monkeypatch, change)
    assert "node 3 of shoulder sends no heartbeat; " in str(error)
    assert 0.19 < PERIOD * (len(run.time) - 20) <= 0.31  # the last one came up to 0.1 s before
    assert late(bus) <= 3 * PERIOD


def test_two_heartbeats_that_are_missing_are_not_enough(rehearsal, monkeypatch):
    def change(each, from_twin, tick):
        return [] if from_twin and each.arbitration_id == 0x703 and 20 <= tick < 68 else [each]

    assert disturbed(rehearsal, monkeypatch, change)[0].complete


def test_a_node_that_boots_up(rehearsal, monkeypatch):
    def change(each, from_twin, tick):
        return [each, frame(0x704, [0])] if tick == 50 and answer(4, from_twin, each) else [each]

    run, error, bus, _ = disturbed(rehearsal, monkeypatch, change)
    assert "node 4 of elbow has started anew" in str(error)
    assert len(run.time) == 50
    assert late(bus) <= 3 * PERIOD


def test_two_answers_in_a_cycle(rehearsal, monkeypatch):
    def change(each, from_twin, tick):
        return [each, moved(each, 1)] if tick >= 50 and answer(3, from_twin, each) else [each]

    run, error, *_ = disturbed(rehearsal, monkeypatch, change)
    assert "two devices have number 3" in str(error)
    assert 50 < len(run.time) <= 53


def test_an_answer_that_repeats_itself_while_the_command_changes(rehearsal, monkeypatch):
    last = {}

    def change(each, from_twin, tick):
        if not answer(3, from_twin, each):
            return [each]
        return [last.setdefault(3, each) if tick >= 50 else each]

    run, error, *_ = disturbed(rehearsal, monkeypatch, change)
    assert "node 3 of shoulder repeats its answer while its command changes" in str(error)
    sent = rehearsal.units.thousandths(run.u)[51:, 0]
    changed, before = np.ptp(sent), np.ptp(sent[:-2])
    assert changed > 20  # two per cent
    assert before <= 20 or len(run.time) - 51 <= 8  # and not much later than that, or than five cycles


def test_an_arm_at_rest_repeats_its_answers(rehearsal, monkeypatch):
    source = rehearsal.source
    rest = rehearse(replace(source, loop=replace(source.loop, reference=[-1.2, 0.0])))
    run, error, *_ = disturbed(rest, monkeypatch, lambda each, from_twin, tick: [each])
    assert error is None
    assert run.complete


@pytest.mark.parametrize("echo", [False, True])
@pytest.mark.parametrize("stranger", [False, True])
def test_another_master(rehearsal, monkeypatch, outside, echo, stranger):
    """One that sends as often as we do; udp_multicast brings back our own SYNCs as well."""
    name = "udp_multicast:239.74.163.2" if echo else "virtual"

    def change(each, from_twin, tick):
        for _ in range(echo + (stranger and tick >= 50) if each.arbitration_id == SYNC else 0):
            for listener in change.bus.ends[1].listeners:
                listener(frame(SYNC, []))
        return [each]

    run, error, *_ = disturbed(rehearsal, monkeypatch, change, name, permission=Permission(serial=7))
    if not stranger:
        assert error is None
        assert run.complete
        return
    assert "another master is on the bus" in str(error)
    assert 50 < len(run.time) <= 54


@pytest.mark.sample(1)
@pytest.mark.parametrize("missing", [1, 2, 4])
def test_as_many_answers_as_are_allowed_may_be_missing(rehearsal, monkeypatch, missing):
    def silence(cycles):
        return lambda each, from_twin, tick: [] if answer(4, from_twin, each) and 50 <= tick < 50 + cycles else [each]

    run, error, *_ = disturbed(rehearsal, monkeypatch, silence(missing - 1), missing=missing)
    assert error is None
    assert run.complete
    assert run.cycles.incomplete == missing - 1
    assert run.counts is (missing == 1)  # of 200 cycles, one is more than 0.1 %
    run, error, bus, _ = disturbed(rehearsal, monkeypatch, silence(missing), missing=missing)
    said = f"node 4 of elbow has not answered since {49 * PERIOD:.4g} s ({missing} cycles)"
    assert said in str(error)
    assert len(run.time) == 49 + missing
    assert late(bus) <= 3 * PERIOD
    assert (run.ending.still, run.ending.unknown) == (("shoulder",), ("elbow",))


def test_a_node_that_dies_as_it_is_enabled(rehearsal, monkeypatch):
    """The others are stopped as soon as later in a run, not after the patience of lock-step."""
    for first in range(3):

        def change(each, from_twin, tick, first=first):
            return [] if from_twin and each.arbitration_id & 0x7F == 4 and tick >= first else [each]

        run, error, bus, twin = disturbed(rehearsal, monkeypatch, change)
        assert f"node 4 of elbow has not answered since {max(first - 1, 0) * PERIOD:.4g} s (2 cycles)" in str(error)
        assert len(run.time) <= first + 2
        enabled = [time for time, can_id, data in bus.sent if 0x200 <= can_id < 0x280 and data[0] == ENABLE]
        assert late(bus) <= 3 * PERIOD
        assert enabled[-1] - enabled[0] <= 3 * PERIOD
        assert twin.drives[0].state is State.QUICK_STOP


def test_a_node_that_dies_before_it_is_enabled(rehearsal, monkeypatch):
    bus = simulated(monkeypatch)
    with Twin(rehearsal.source, "virtual") as twin:
        heard = []

        def change(each, from_twin, tick):
            heard.append(answer(4, from_twin, each))
            return [] if from_twin and each.arbitration_id & 0x7F == 4 and sum(heard) > 2 else [each]

        Ticks(bus, change)
        with pytest.raises(BusError, match="node 4 of elbow") as error:
            run_controller(rehearsal, "virtual", real_time=True)
    assert not isinstance(error.value, RunStopped)  # refused: nothing moved
    assert not any(0x200 <= can_id < 0x280 and data[0] == ENABLE for _, can_id, data in bus.sent)
    assert twin.simulation.tick == 0


def test_an_arm_that_holds_does_not_hide_who_is_silent(rehearsal, monkeypatch):
    """After a run both drives hold, and node 4 has gone before the next one."""
    bus = simulated(monkeypatch)
    with Twin(rehearsal.source, "virtual"):
        run_controller(rehearsal, "virtual", following_error=1.9)
        Ticks(bus, lambda each, from_twin, tick: [] if answer(4, from_twin, each) else [each])
        with pytest.raises(BusError, match="joint 'elbow': node 4"):
            run_controller(rehearsal, "virtual", following_error=1.9)


@pytest.mark.study
def test_the_following_error_by_default(scenario, monkeypatch):
    """Twice the largest of the simulated run, and at least a degree."""
    law = aw.Cascade(position_kp=[3.0, 15.0], speed_kp=[150.0, 160.0], speed_ki=[300.0, 1600.0], speed_feedforward=1.0)
    rehearsal = rehearse(replace(scenario, loop=replace(scenario.loop, controller=law)))
    most = np.maximum(2.0 * rehearsal.largest_error, 0.0175)
    assert most[1] == 0.0175 < most[0]  # one of either kind
    for joint, node in enumerate((3, 4)):
        counts = round(2.0 * most[joint] / rehearsal.units.count[joint])
        for sign in (1, -1):

            def moves(each, from_twin, tick, node=node, off=sign * counts):
                return [moved(each, off)] if answer(node, from_twin, each) and tick >= 100 else [each]

            error = disturbed(rehearsal, monkeypatch, moves, following_error=None)[1]
            found = re.search(r"following error .* at (.*) s; after.*expected at most (\S+)$", str(error))
            assert float(found[1]) <= 102 * PERIOD
            assert float(found[2]) == pytest.approx(most[joint], rel=1e-3)


def test_a_command_that_is_not_finite(rehearsal, monkeypatch):
    command = Law.command

    def broken(self, tick, *rest):
        return command(self, tick, *rest) * ([1.0, np.nan] if tick == 30 else 1.0)

    monkeypatch.setattr(Law, "command", broken)
    run, error, bus, _ = disturbed(rehearsal, monkeypatch, lambda each, from_twin, tick: [each])
    assert "joint 'elbow': the controller's command at 0.12 s is not finite" in str(error)
    assert len(run.time) == 30
    assert late(bus) <= 3 * PERIOD


def test_a_fault_in_the_very_last_answer(rehearsal, monkeypatch):
    ticks = rehearsal.recording.ticks

    def change(each, from_twin, tick):
        return [moved(each, status=FAULT)] if answer(3, from_twin, each) and tick == ticks else [each]

    run, error, *_ = disturbed(rehearsal, monkeypatch, change)
    assert "node 3 of shoulder is in state fault" in str(error)
    assert not run.complete
    assert len(run.time) == ticks


@pytest.mark.parametrize(
    ("unknown", "limp", "holds"), [((), ("a", "b"), False), (("b",), ("a",), False), ((), ("a",), True)]
)
def test_drives_without_torque_are_not_said_to_hold_the_arm(unknown, limp, holds):
    still = tuple(name for name in ("a", "b") if name not in unknown)
    text = str(Ending(still, (), unknown, True, ("a", "b"), 0.5, limp))
    assert ("hold the arm" in text) == holds
    assert ("no drive" in text) != holds


@pytest.mark.parametrize(("off", "refused"), [(1, False), (3, True)])
def test_the_arm_stands_where_the_scenario_starts_to_a_count(rehearsal, monkeypatch, off, refused):
    def change(each, from_twin, tick):
        return [moved(each, off)] if answer(4, from_twin, each) and tick < 0 else [each]

    with raises_at(BusError, "start.q", "'elbow'") if refused else contextlib.nullcontext():
        assert disturbed(rehearsal, monkeypatch, change)[1] is None


def test_a_joint_that_falls_in_spite_of_its_brake_is_not_at_rest(rehearsal, monkeypatch):
    """A drive in fault has no torque; that something holds its joint is seen by its position alone."""

    def change(each, from_twin, tick):
        return [moved(each, 20 * (tick - 50), FAULT)] if answer(4, from_twin, each) and tick >= 50 else [each]

    run, error, *_ = disturbed(rehearsal, monkeypatch, change)
    assert "node 4 of elbow is in state fault" in str(error)
    assert run.ending.moving == ("elbow",)
    assert run.ending.limp == ("elbow",)
    assert "shoulder at rest, elbow still moving; the drives hold the arm but for elbow, where the drive has no" in str(
        error
    )


def test_a_node_that_hears_and_cannot_answer_is_given_time_to_stop(rehearsal, monkeypatch):
    def change(each, from_twin, tick):
        return [] if answer(4, from_twin, each) and tick >= 100 else [each]

    run, _, bus, twin = disturbed(rehearsal, monkeypatch, change)
    assert run.ending.unknown == ("elbow",)
    assert run.ending.seconds >= 0.5
    assert twin.drives[1].state is State.QUICK_STOP
    assert twin.drives[1].demand_speed == 0.0
    words = [data[0] for _, can_id, data in bus.sent if can_id == 0x204]
    assert words[-100:] == [QUICK_STOP] * 100  # it goes on being told


@pytest.mark.parametrize(("holding", "without"), [(400.0, ()), (5.0, ("shoulder", "elbow"))])
def test_a_brake_holds_what_it_can(rehearsal, holding, without):
    arm = rehearsal.scenario.arm
    bodies = tuple(replace(body, brake=Brake(holding, None, None, None, on_motor=False)) for body in arm.bodies)
    assert joints_without_brake(replace(arm, bodies=bodies)) == without


# A real arm.

PASSED = SimpleNamespace(passed=True)
SLOW = {"serial": 7, "verdict": PASSED, "speed": 0.25, "torque": 0.5, "may_move": lambda: True}


@pytest.fixture(scope="module")
def slow(rehearsal):
    """The reduced run."""
    return rehearse(rehearsal.source, speed=0.25, torque=0.5)


@pytest.mark.parametrize(
    ("speed", "torque", "is_reduced"), [(0.25, 0.5, True), (0.26, 0.5, False), (0.25, 0.51, False)]
)
def test_what_is_reduced(speed, torque, is_reduced):
    assert Permission(speed=speed, torque=torque).reduced is is_reduced


@pytest.mark.sample(1)
@pytest.mark.parametrize("lost", [0, 1, 2])
def test_a_run_that_lost_more_than_a_thousandth_stores_nothing(slow, monkeypatch, outside, tmp_path, lost):
    """800 cycles: none may be incomplete, and none of isolated ones ends the run."""
    path = tmp_path / "arm.scenario.toml"

    def change(each, from_twin, tick):
        return [] if answer(3, from_twin, each) and tick in range(100, 100 + 50 * lost, 50) else [each]

    permission = Permission(**SLOW, path=path, sha256="abc")
    run, error, *_ = disturbed(slow, monkeypatch, change, metal=True, permission=permission)
    assert error is None
    assert run.complete
    assert run.cycles.incomplete == lost
    assert path.with_suffix(".bus.toml").exists() is (lost == 0)


def test_what_is_not_reduced_stores_nothing_and_needs_the_same_reference(slow, monkeypatch, outside, tmp_path):
    path = tmp_path / "arm.scenario.toml"
    kept = path.with_suffix(".bus.toml")

    def as_it_is(each, from_twin, tick):
        return [each]

    def go(rehearsal, **changes):
        permission = Permission(**SLOW | {"path": path, "sha256": "abc"} | changes)
        return disturbed(rehearsal, monkeypatch, as_it_is, metal=True, permission=permission)

    assert go(slow)[0].counts
    text = kept.read_text(encoding="utf-8")
    half = rehearse(slow.full.source, speed=0.5)
    assert half.reference_sha256 == slow.reference_sha256
    assert go(half, speed=0.5, torque=1.0)[0].counts
    assert kept.read_text(encoding="utf-8") == text
    source = slow.full.source

    def other(t):
        return source.loop.reference(1.01 * t)

    with raises_at(BusError, "speed", "that counts", value=1.0):
        go(rehearse(replace(source, loop=replace(source.loop, reference=other))), speed=1.0, torque=1.0)


def test_a_permission_for_a_reduced_run_does_not_cover_a_full_one(rehearsal, slow, monkeypatch, outside):
    for run, said, place in (
        (rehearsal, {}, "speed"),
        (slow, {"torque": 0.4}, "torque"),
        (slow, {"speed": 1.0}, "speed"),
    ):
        with raises_at(BusError, place, "rehearsed"):
            disturbed(run, monkeypatch, lambda each, *rest: [each], metal=True, permission=Permission(**SLOW | said))


def test_a_scenario_runs_at_the_speed_that_is_permitted(rehearsal, monkeypatch, outside):
    bus = simulated(monkeypatch)
    with Twin(rehearsal.source, "virtual", serial=7):
        run = run_controller(
            rehearsal.source, "virtual", permission=Permission(serial=7, speed=0.5), following_error=1.9
        )
    assert (run.rehearsal.speed, len(run.time)) == (0.5, 400)
    assert bus.syncs > 400


def test_a_rehearsal_that_cannot_be_stored_is_no_refusal(slow, monkeypatch, outside, tmp_path):
    permission = Permission(**SLOW, path=tmp_path / "gone" / "arm.scenario.toml", sha256="abc")
    run, error, *_ = disturbed(slow, monkeypatch, lambda each, *rest: [each], metal=True, permission=permission)
    assert run.complete
    assert "the run is complete, but not stored as a rehearsal: " in str(error)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda drive: drive.values.update({od.RATED_TORQUE: 101_500}),
            "object 6076: node 4 of elbow has a rated torque",
        ),
        (lambda drive: drive.values.update({od.RATED_TORQUE: 99_500}), ""),
        (lambda drive: drive.values.update({(0x608F, 1): 359_000}), "object 608F: node 4 of elbow has 359000 counts"),
        (lambda drive: drive.values.update({od.SERIAL: 8}), "arm = 7: node 4 of elbow has serial number 8"),
    ],
)
def test_drives_of_another_arm(slow, monkeypatch, outside, change, message):
    simulated(monkeypatch)
    with Twin(slow.source, "virtual", serial=7) as twin:
        twin.drives[1].values[od.VENDOR] = 0x1234  # one real drive makes the arm a real one
        change(twin.drives[1])
        with pytest.raises(BusError) as error:
            run_controller(slow, "virtual", permission=Permission(**SLOW))  # in lock-step, which metal never does
    assert str(error.value).startswith(message or "real_time = False")


def test_a_reduced_run_may_be_half_as_fast_again_as_in_proportion(slow):
    """And 2 % of the joint's limit besides, and what rounding to counts makes of standing still."""
    besides = 0.02 * 2.0 + 2.0 * slow.units.count / PERIOD
    full = (slow.largest_speed - besides) / (1.5 * 0.25)
    assert np.all(full > 0.0)
    assert _too_fast(slow, 0.98 * full, 0.25).all()
    assert not _too_fast(slow, 1.02 * full, 0.25).any()


@pytest.mark.study
def test_noise_does_not_hide_how_fast_an_arm_is(scenario):
    """A step that hardly slows down beside noise of about 0.5 rad/s."""
    goal = np.array([-1.1, 0.1])
    loop = replace(scenario.loop, reference=goal, sensors=replace(scenario.loop.joint_sensors, position_noise=3e-4))
    noisy = rehearse(replace(scenario, duration=1.0, loop=loop, seed=1), speed=0.25)
    quiet = rehearse(replace(scenario, duration=1.0, loop=replace(scenario.loop, reference=goal)), speed=0.25)
    assert noisy.reference == pytest.approx(quiet.reference, abs=1e-9)


# The key.


@pytest.mark.skipif(sys.platform == "win32", reason="no descriptors of terminals")
@pytest.mark.parametrize("make", [os.pipe, lambda: os.openpty()[::-1]])
def test_the_key_of_a_terminal_that_is_gone_is_let_go(make):
    """Its end can be read for ever, or is an error; neither keeps the key pressed, nor the master waiting."""
    terminal, keyboard = make()
    os.write(keyboard, b"  \n")
    now = 0.0
    key = Key(lambda: _waiting(terminal), lambda: now)
    assert key()
    os.close(keyboard)
    assert key()
    now = 1.0
    assert not key()
    os.close(terminal)

"""Simulated time: of frames alone in lock-step, of the wall clock in real time."""

import random
from collections.abc import Iterable

import pytest

import armwright as aw
from armwright.errors import BusError
from armwright.twin import clock
from armwright.twin.serial.frames import BROADCAST, DYNAMIXEL, FEETECH, Frame
from armwright.twin.serial.timing import CycleEnd, GoalSchedule, LockStep, RealTime
from twin.serial.conftest import BAUD, client

GOALS = CycleEnd("sync-write", 42)


def frame(number: int, code: int, data: Iterable[int] = ()):
    data = bytes(data)
    return Frame(number, code, data, 6 + len(data))


def cycle(timing, goal):
    """A read of three positions, and goals for them."""
    asked = timing.reply(frame(BROADCAST, 0x82, (56, 2, 1, 2, 3)), BAUD)
    timing.close(frame(BROADCAST, 0x82, (56, 2, 1, 2, 3)))
    data = b"\x2a\x02" + b"".join(bytes((k,)) + (goal + k).to_bytes(2, "little") for k in (1, 2, 3))
    sent = frame(BROADCAST, 0x83, data)
    timing.reply(sent, BAUD)
    timing.close(sent)
    return asked.data


def test_frames_take_their_bits_delays_and_answers():
    line = client("sts3215", return_delay_time=50)
    timing = LockStep(line.bus, 0.01, GOALS)
    timing.reply(frame(1, 1), BAUD)  # 6 bytes, 100 µs, 6 bytes
    assert timing.nanoseconds == 220_000
    timing.reply(frame(BROADCAST, 0x82, (56, 2, 1, 2, 3)), BAUD)  # 11 bytes, three times 100 µs and 8 bytes
    assert timing.nanoseconds == 220_000 + 110_000 + 540_000
    timing.reply(frame(9, 1), BAUD)  # nobody answers
    assert timing.nanoseconds == 930_000
    line.put(2, "return_delay_time", 0)
    assert line.bus.time == 930e-6
    cycle(timing, 2000)
    assert (timing.nanoseconds, timing.cycles, timing.overran, line.bus.time) == (10_000_000, 1, 0, 0.01)


def test_a_cycle_that_takes_longer_than_the_period_is_counted():
    line = client("sts3215")
    timing = LockStep(line.bus, 1e-3, GOALS)
    cycle(timing, 2000)
    assert (timing.nanoseconds, timing.overran) == (3_000_000, 1)
    timing.nanoseconds = 4_000_000 - 170_000  # the write ends exactly with a period
    sent = frame(BROADCAST, 0x83, b"\x2a\x02" + bytes(9))
    timing.reply(sent, BAUD)
    timing.close(sent)
    assert (timing.nanoseconds, timing.overran) == (4_000_000, 1)


def run(pauses, tmp_path, name):
    """Replies and the schedule of 60 cycles, with pauses of the client [s of the clock]."""
    line = client("sts3215")
    schedule, timing = GoalSchedule(line.bus, ["a", "b", "c"]), LockStep(line.bus, 0.02, GOALS)
    replies = []
    for k in range(60):
        next(pauses)
        replies.append(cycle(timing, 2000 + 7 * k))
        timing.idle()
    schedule.write(tmp_path / name)
    return replies, (tmp_path / name).read_bytes()


def test_lock_step_depends_on_frames_alone(tmp_path, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(clock, "now", lambda: now[0])

    def pauses(rng):
        while True:
            now[0] += rng.random()
            yield

    first, second = (run(pauses(random.Random(seed)), tmp_path, f"{seed}.csv") for seed in (1, 2))
    assert first == second
    assert len(set(first[0])) == 60
    schedule = aw.simulation.read_schedule(tmp_path / "1.csv", ["a", "b", "c"])
    assert schedule.commands.shape == (61, 3)
    read, write = 110 + 3 * (500 + 80), 170  # µs of a cycle's frames
    assert schedule.times[1:] == pytest.approx([0.02 * k + 1e-6 * (read + write) for k in range(60)], abs=1e-12)
    assert schedule.commands[0] == pytest.approx([(x / 4096 - 0.5) * 6.283185307179586 for x in (1000, 2000, 3000)])
    assert schedule.commands[5, 1] == pytest.approx((2030 / 4096 - 0.5) * 6.283185307179586)


@pytest.mark.parametrize(("text", "framing", "message"), [
    ("sync-writ:42", FEETECH, "sync-write"), ("bulk-write", FEETECH, "unknown instruction"),
    ("sync-write:4x", FEETECH, "expected sync-write:ADDRESS"), ("", DYNAMIXEL, "unknown instruction"),
])  # fmt: skip
def test_ticks_that_are_none(text, framing, message):
    with pytest.raises(BusError, match=message):
        CycleEnd.parse(text, framing)


@pytest.mark.parametrize(("text", "code", "data", "closes"), [
    ("sync-write:116", 0x83, "74000400", True), ("sync-write:116", 0x83, "84000400", False),
    ("sync-write", 0x83, "84000400", True), ("sync-write:116", 0x82, "74000400", False), ("action", 5, "", True),
    ("bulk-write:116", 0x93, "0174000400", True), ("write:116", 3, "7400", True), ("write:116", 3, "", False),
])  # fmt: skip
def test_ticks(text, code, data, closes):
    assert CycleEnd.parse(text, DYNAMIXEL).matches(frame(1, code, bytes.fromhex(data)), DYNAMIXEL) is closes


@pytest.mark.parametrize("period", [0.0, -1.0, float("nan"), float("inf")])
def test_periods_that_are_none(sts, period):
    with pytest.raises(BusError, match="period"):
        LockStep(sts.bus, period, GOALS)


def test_late_replies_end_lock_step_and_not_real_time(sts):
    RealTime(sts.bus).late(0.03)
    with pytest.raises(BusError, match="31 ms"):
        LockStep(sts.bus, 0.01, GOALS).late(0.031)


def test_real_time_follows_the_clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(clock, "now", lambda: now[0])
    line = client("sts3215", return_delay_time=50)
    timing = RealTime(line.bus)
    now[0] += 0.5
    timing.idle()
    assert line.bus.time == pytest.approx(0.5)
    reply = timing.reply(frame(1, 1), BAUD)
    assert (reply.wire, line.bus.time) == (pytest.approx(220e-6), pytest.approx(0.5 + 60e-6))
    assert reply.data == FEETECH.status(1, 0)

"""Bus servos of two makers: frames, registers, what instructions and time do to them, and several of them on one line."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armwright.errors import ArmwrightError
from armwright.twin.serial.__main__ import _arguments, _servos, _values
from armwright.twin.serial.bus import Losses, ServoBus, collide, make_servo, wire_time
from armwright.twin.serial.client import ServoClient
from armwright.twin.serial.frames import BROADCAST, COMMON, DYNAMIXEL, FEETECH, FRAMINGS, Frame, Framing, Parser, crc16
from armwright.twin.serial.plant import Goal, KinematicPlant, Measurement
from armwright.twin.serial.registers import model_names, servo_model
from armwright.twin.serial.terminal import serve
from armwright.twin.serial.timing import CycleEnd, GoalSchedule, LockStep, RealTime, Timing
from frozen.cases.twin import refusals
from frozen.texts import texts
from twin.serial.conftest import BAUD, VOLTAGES, Client, client
from twin.serial.test_servo import loaded
from twin.serial.test_timing import GOALS, cycle, frame

MODELS = tuple(VOLTAGES)
POWER_UP = ("power up",)
USUAL = 7.4  # [V] of a measurement that says nothing of the supply
ADDRESSES = (0, 3, 42, 56, 132)


# Frames.


def packed(framing: Framing) -> dict[str, Any]:
    """Bytes of frames, and what a parser makes of them in pieces, with bytes between them and with mistakes."""
    datas = (b"", b"\x01", bytes(range(250, 256)), b"\xff\xff\xfd\x00\xff\xff\xfd", b"\xff" * 9)
    frames = [
        framing.pack(number, code, data) for number, code in ((1, 1), (0xFC, 3), (BROADCAST, 0x83)) for data in datas
    ]
    frames += [framing.status(7, error, data) for error in (0, 0x24) for data in datas]
    stream = b"\x00\xff".join(frames)
    source = random.Random(2)
    broken = bytearray(stream)
    for _ in range(12):
        broken[source.randrange(len(broken))] ^= 1 << source.randrange(8)
    return {
        "frames": b"".join(frames).hex(),
        "parsed": parsed(framing, stream, 1000),
        "in pieces": parsed(framing, stream, 3),
        "broken": parsed(framing, bytes(broken), 7),
        "cut": parsed(framing, frames[3][:-4] + frames[4] + frames[0][:5], 2),
        "words": [framing.integers(bytes(range(1, 9)), k) for k in (1, 2)],
        "longest": framing.longest,
        "instructions": repr(framing.instructions),
        "header": framing.header.hex(),
    }


def parsed(framing: Framing, stream: bytes, step: int) -> str:
    """Frames of a stream that comes in pieces, what was skipped, and what a pause gives up."""
    parser = Parser(framing)
    found = [each for k in range(0, len(stream), step) for each in parser.feed(stream[k : k + step])]
    before = parser.skipped
    found += parser.drop()
    return repr(
        [(each.number, each.instruction, each.data.hex(), each.size) for each in found] + [before, parser.skipped]
    )


def lengths(framing: Framing) -> str:
    """What is made of headers with lengths that are none, that are at the end, and of ids that are none."""
    found = []
    for length in (0, 1, 2, 3, 4, 249, 250, 251, 1016, 1017, 1018):
        for number in (1, 0xFD, 0xFE, 0xFF):
            size = length.to_bytes(framing.word, "little") if length < 256**framing.word else b"\xff"
            head = framing.header + bytes((number,)) + size + bytes(4)
            found.append([framing.cut(bytearray(head[:k]), 0) for k in range(2, len(head) + 1)])
    return repr(found)


def fast() -> dict[str, Any]:
    """Parts of one answer of several servos, and checksums."""
    answers = [(1, 0, b"\x01\x02"), (2, 0x80, b"\xff\xff\xfd"), (9, 0, b"")]
    parts = [part.hex() for part in DYNAMIXEL.fast(answers)]
    return {"parts": parts, "sums": [crc16(bytes(range(k))) for k in (0, 1, 2, 9, 100, 256)], "common": repr(COMMON)}


def collisions() -> list[str]:
    """What is received of frames that are sent at the same time."""
    one, other = FEETECH.status(1, 0, b"\x10\x20"), FEETECH.status(1, 0, b"\x11\x7f\x00")
    groups = ([one], [one, one], [one, other], [other, one, other], [one, other[:3]], [b"\x00", b"\xff"])
    return [collide(group).hex() for group in groups]


# Registers.


def model_of(name: str) -> dict[str, Any]:
    """A table of registers, what they hold and allow, and which are touched."""
    model = servo_model(name)
    values = (0, 1, -1, 127, 128, -129, 2047, 2048, -2048, 4095, 32767, 32768, -32769, 2**31, -(2**31) - 1)
    coded = [
        (each.name, [each.encode(v).hex() for v in values], [each.allows(v) for v in values])
        for each in model.registers
    ]
    decoded = [
        (each.name, [each.decode(each.encode(v)) for v in values], each.end, each.largest, each.sign)
        for each in model.registers
    ]
    touched = [[each.name for each in model.touched(address, count)] for address in ADDRESSES for count in (1, 2, 5)]
    sizes = {
        "size": model.size,
        "eeprom": model.eeprom,
        "bauds": model.bauds,
        "counts": model.counts,
        "units": model.units,
    }
    return {
        "rows": repr(model.registers),
        "coded": repr(coded),
        "decoded": repr(decoded),
        "touched": repr(touched),
        **sizes,
    }


# Servos.


def every(line: Client, number: int = 1) -> dict[str, int]:
    """Values of all registers of a servo."""
    servo = next(each for each in line.bus.servos if each.number == number)
    servo.show()
    return {register.name: servo[register.name] for register in servo.model.registers}


def changed(line: Client, before: dict[str, int], number: int = 1) -> str:
    """Registers that are other than before."""
    return repr({name: value for name, value in every(line, number).items() if value != before[name]})


Step = tuple[Any, ...]


def walked(model: str, *steps: Step, **values: int) -> dict[str, Any]:
    """What a servo answers to steps, which registers each step changed, and what it commands its joint.

    A step is (register, value), `POWER_UP`, a number of seconds, (instruction, bytes), or a `Measurement`, of which position 0
    changes none.
    """
    line, plant = loaded(model, VOLTAGES[model], baud_rate=0 if model == "sts3215" else 3, **values)
    rows, goals = [], []
    for step in steps:
        before = every(line, line.bus.servos[0].number)
        number = line.bus.servos[0].number
        if isinstance(step, float):
            line.bus.advance(line.bus.time + step)
            said: Any = ""
        elif step == POWER_UP:
            line.bus.servos[0].power_up()
            line.bus.advance(line.bus.time + 1e-3)
            said = ""
        elif isinstance(step, Measurement):
            plant.now = replace(step, voltage=VOLTAGES[model] if step.voltage == USUAL else step.voltage)
            plant.positions[0] = step.position or plant.positions[0]
            line.bus.advance(line.bus.time + 1e-3)
            said = ""
        elif isinstance(step[1], bytes):
            said = [(each.number, each.instruction, each.data.hex()) for each in line.frames(step[0], number, step[1])]
        else:
            register = line.registers[step[0]]
            data = line.words(register.address) + register.encode(step[1])
            said = [(each.instruction, each.data.hex()) for each in line.frames("write", number, data)]
        rows.append(f"{step}: {said} {changed(line, before, line.bus.servos[0].number)}")
        goals.append(repr(line.bus.servos[0].goal))
    servo = line.bus.servos[0]
    return {"rows": rows, "goals": goals, "memory": servo.memory.hex(), "turns": servo.turns, "error": servo.error}


def stepped(model: str, *steps: Step, **values: int) -> Callable[[Path], dict[str, Any]]:
    """A case of `walked`."""
    return lambda _: walked(model, *steps, **values)


def instructions(model: str) -> dict[str, Any]:
    """Every instruction with data of many lengths, to one servo and to all, at each level of answers."""
    found = {}
    for level in (0, 1, 2):
        line = client(model)
        for servo in line.bus.servos:
            servo["status_return_level"] = level
        for name in line.bus.framing.instructions.values():
            said = []
            for number in (1, BROADCAST, 9):
                for data in (b"", b"\x01", b"\x02\x00\x01\x02", bytes(range(40, 52)), b"\x01\x44\x58\x4c\x22", b"\xff"):
                    said += [
                        (each.number, each.instruction, each.data.hex()) for each in line.frames(name, number, data)
                    ]
            found[f"{level} {name}"] = repr(said)
        found[f"{level} memory"] = "".join(servo.memory.hex() for servo in line.bus.servos)
        found[f"{level} counted"] = repr((line.bus.frames, line.bus.unknown))
    return found


def grouped(model: str) -> dict[str, Any]:
    """Reads and writes of several servos, and how late each answers."""
    line = client(model, return_delay_time=100)
    position, goal, words = line.registers["present_position"], line.registers["goal_position"], line.words
    framing, found = line.bus.framing, {}
    asks = {
        "sync-read": words(position.address, position.size) + bytes((3, 1, 9)),
        "fast-sync-read": words(position.address, position.size) + bytes((1, 2)),
        "bulk-read": bytes((3,)) + words(goal.address, 4) + bytes((1,)) + words(0, 2) + b"\x02",
        "fast-bulk-read": bytes((2,)) + words(goal.address, 4) + bytes((1,)) + words(0, 2),
        "sync-write": words(goal.address, goal.size) + b"".join(bytes((k,)) + goal.encode(1000 + k) for k in (2, 3, 9)),
        "bulk-write": bytes((1,))
        + words(goal.address, goal.size)
        + goal.encode(77)
        + bytes((2,))
        + words(64, 1)
        + b"\x01\x03",
        "ping": b"",
    }
    for name, data in asks.items():
        if name not in line.codes:
            continue
        for cut in (0, 1):
            sent = framing.pack(BROADCAST, line.codes[name], data[: len(data) - cut])
            answers = [a for each in line.bus.feed(sent, BAUD) for a in line.bus.answer(each, BAUD)]
            found[f"{name} less {cut}"] = repr([(a.delay, a.data.hex()) for a in answers])
    found["goals"] = repr([servo["goal_position"] for servo in line.bus.servos])
    found["another rate"] = repr(
        [a.data.hex() for each in line.bus.feed(framing.pack(1, 1), 57_600) for a in line.bus.answer(each, 57_600)]
    )
    found["same ids"] = repr(
        [(f.number, f.data.hex()) for f in client(model, numbers=(1, 1, 2)).frames("ping", BROADCAST)]
    )
    return found


def lossy(model: str) -> dict[str, Any]:
    """A line that loses bytes of either direction, with a client that tries again."""
    line = client(model)
    bus = ServoBus(line.bus.servos, line.plant, Losses(0.02, 3))
    asked = bus.framing.pack(1, line.codes["ping"])
    heard = [[a.data.hex() for each in bus.feed(asked, BAUD) for a in bus.answer(each, BAUD)] for _ in range(60)]
    return {"heard": repr(heard), "frames": bus.frames, "given up": len(list(bus.pause()))}


class Wire:
    """A port at whose other end servos answer at once, but for some instructions."""

    def __init__(self, line: Client, silent: tuple[int, ...] = ()):
        self.line, self.silent, self.count, self.waiting, self.sent = line, silent, 0, b"", list[str]()

    def write(self, data: bytes) -> None:
        """Takes an instruction."""
        self.sent.append(data.hex())
        self.count += 1
        frames = list(self.line.bus.feed(data, BAUD))
        if self.count not in self.silent:
            self.waiting += b"".join(a.data for each in frames for a in self.line.bus.answer(each, BAUD))

    def read(self, seconds: float) -> bytes:
        """All answers that wait."""
        found, self.waiting = self.waiting, b""
        return found


def asked(model: str) -> dict[str, Any]:
    """What a client reads and writes, and what it misses."""
    line = client(model)
    wire = Wire(line, silent=(3, 4, 8, 12, 13, 14))
    made = ServoClient(wire, servo_model(model), patience=1e-4)
    found: list[Any] = [made.read(1, "present_position"), made.read(2, "goal_position")]
    found += refusals(
        lambda *words: made.write(*words) or made.read(*words[:2]),
        (3, "goal_position", 2222),
        (1, "id", 7),
        (9, "id", 1),
    )
    found += [repr(made.sync_read([1, 7, 3, 9], ["present_velocity", "present_position"])), made.missed]
    made.sync_write("goal_position", {3: 1234, 2: -5})
    found += refusals(made.read, (3, "goal_position"), (2, "goal_position"), (3, "id"))
    return {"found": [str(each) for each in found], "missed": made.missed, "sent": wire.sent}


def refused(model: str) -> list[str]:
    """Values that a servo cannot begin with."""
    calls = (
        {"id": 254},
        {"id": -1},
        {"baud_rate": 200},
        {"goal_position": 5},
        {"none": 1},
        {"homing_offset": 10**6},
        {"return_delay_time": 3},
    )
    return refusals(
        lambda values: make_servo(servo_model(model), values.pop("id", 1), **values).memory.hex(),
        *((each,) for each in calls),
    )


# Time.


def locked(period: float, pause: float = 0.0, model: str = "sts3215") -> dict[str, Any]:
    """Cycles whose time is that of their frames."""
    line = client(model, return_delay_time=50)
    timing, rows = LockStep(line.bus, period, GOALS), []
    for k in range(12):
        rows.append(cycle(timing, 2000 + 30 * k).hex())
        timing.idle()
        rows.append(repr((timing.nanoseconds, timing.cycles, timing.overran, line.bus.time, line.plant.positions)))
    return {"rows": rows, "late": refusals(timing.late, (pause,))}


def scheduled(folder: Path) -> dict[str, Any]:
    """Goals that came, as a table."""
    line = client("sts3215")
    schedule, timing = GoalSchedule(line.bus, ["a", "b", "c"]), LockStep(line.bus, 0.02, GOALS)
    other = GoalSchedule(line.bus, ["a", "b", "c"], lambda k, counts: 0.1 * k + counts)
    for k in range(4):
        cycle(timing, 2000 + 100 * (k // 2))
    line.put(1, "operating_mode", 1)
    schedule.write(folder / "goals.csv")
    return {**texts(folder), "rows": other.rows, "first": schedule.rows}


def in_real_time() -> dict[str, Any]:
    """Replies by a clock that is given."""
    with pytest.MonkeyPatch.context() as patch:
        at = iter(0.01 * k for k in range(100))
        patch.setattr("armwright.twin.clock.now", lambda: next(at))
        line = client("sts3215", return_delay_time=50)
        timing = RealTime(line.bus)
        replies = [timing.reply(frame(1, 1), BAUD), timing.reply(frame(BROADCAST, 0x82, (56, 2, 1, 2, 3)), BAUD)]
        timing.idle()
        timing.close(frame(1, 1))
        timing.late(0.1)
        return {
            "wire": [each.wire for each in replies],
            "data": [each.data.hex() for each in replies],
            "time": line.bus.time,
        }


class Scripted:
    """A terminal from which bytes come as a script says: (seconds, bytes); it ends with the script."""

    device, path, unsent, baud = "tty", None, 0, BAUD

    def __init__(self, clock: SimpleNamespace, script: list[tuple[float, bytes]]):
        self.clock, self.script, self.written = clock, list(script), list[str]()

    def __enter__(self) -> Scripted:
        return self

    def __exit__(self, *exception: object) -> None:
        """Nothing."""

    def read(self, seconds: float) -> bytes:
        """The next bytes."""
        after, data = self.script.pop(0)
        self.clock.time += after
        return data

    def write(self, data: bytes) -> None:
        """Takes an answer."""
        self.written.append(f"{self.clock.time:.6f} {data.hex()}")


@contextmanager
def scripted(script: list[tuple[float, bytes]]) -> Iterator[Scripted]:
    """A terminal, and the time at its side."""
    clock = SimpleNamespace(time=0.0)
    clock.now = lambda: clock.time
    clock.sleep_until = lambda t: setattr(clock, "time", max(t, clock.time))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("armwright.twin.serial.terminal.clock", clock)
        patch.setattr("armwright.twin.clock.now", clock.now)
        yield Scripted(clock, script)


def pieces() -> list[tuple[float, bytes]]:
    """Instructions in pieces and with pauses, one of them late."""
    whole = FEETECH.pack(1, 2, b"\x38\x02")
    goals = FEETECH.pack(BROADCAST, 0x83, b"\x2a\x02\x01\xdc\x05\x02\xd0\x07")
    cut = [(0.001, whole[:5]), *[(0.005, b"")] * 5, (0.001, whole)]
    return [
        (0.002, whole),
        (0.001, whole[:3]),
        (0.001, whole[3:] + goals),
        *cut,
        (0.024, whole),
        (0.026, whole),
        (0.001, goals),
    ]


def served(timing: Callable[[ServoBus], Timing]) -> dict[str, Any]:
    """What is answered on a terminal, and what is counted."""
    line = client("sts3215", return_delay_time=50)
    with scripted(pieces()) as terminal:
        made, said = timing(line.bus), list[str]()
        try:
            counts = repr(
                serve(terminal, line.bus, made, lambda: not terminal.script, ready=lambda: said.append("ready"))
            )
        except ArmwrightError as error:
            counts = str(error)
        return {
            "written": terminal.written,
            "counts": counts,
            "said": said,
            "time": line.bus.time,
            "goals": repr(line.plant.goals),
        }


def words_of_a_line() -> dict[str, Any]:
    """Servos and values by texts, and what else a process of servos is told."""
    texts_of = (
        ["sts3215:1-3,7"],
        ["xl330-m288:1", "xl430-w250:5-6"],
        ["sts3215"],
        ["sts3215:a"],
        ["none:1"],
        ["sts3215:3-"],
    )
    given = vars(_arguments().parse_args(["--servo", "sts3215:1", "--set", "lock=0"]))
    return {
        "servos": refusals(
            lambda words: [(s.number, s.model.name) for s in _servos(words, {"return_delay_time": 9})],
            *((t,) for t in texts_of),
        ),
        "values": refusals(lambda words: _values(words), (["a=1", "b=-2"],), (["a"],), (["a=x"],), (["a=-"],)),
        "arguments": repr(sorted(given.items())),
    }


def cycle_ends() -> dict[str, Any]:
    """Instructions that close a cycle."""
    found = refusals(
        CycleEnd.parse,
        ("sync-write:42", FEETECH),
        ("action", FEETECH),
        ("none", FEETECH),
        ("action:x", FEETECH),
        ("bulk-write:1", FEETECH),
        ("bulk-write:116", DYNAMIXEL),
    )
    sync, bulk = (
        Frame(BROADCAST, code, data, 9) for code, data in ((0x83, b"\x2a\x00\x02\x00"), (0x93, b"\x01\x74\x00\x04\x00"))
    )
    ends = [
        CycleEnd("sync-write"),
        CycleEnd("sync-write", 42),
        CycleEnd("sync-write", 43),
        CycleEnd("bulk-write", 116),
        CycleEnd("bulk-write", 1),
    ]
    matched = [
        [end.matches(each, framing) for end in ends] for each in (sync, bulk) for framing in (FEETECH, DYNAMIXEL)
    ]
    return {
        "parsed": found,
        "matched": matched,
        "periods": refusals(
            lambda p: LockStep(client("sts3215").bus, p, ends[0]).period, (1e-6,), (9e-7,), (np.inf,), (0.02,)
        ),
    }


def kinematic() -> dict[str, Any]:
    """Joints without mass under goals of every mode."""
    plant = KinematicPlant([0.0] * 6, fastest=500.0)
    goals = (
        Goal(True, value=100.0, speed=80.0),
        Goal(True, value=-400.0),
        Goal(False, value=100.0),
        Goal(True, "speed", -60.0),
        Goal(True, "duty", 0.4),
        Goal(True, "speed", 0.0),
    )
    rows = []
    for k, goal in enumerate(goals):
        plant.command(k, goal)
    for until in (0.0, 0.5, 0.5, 1.0, 2.0):
        plant.advance(until)
        rows.append([*plant.positions, *plant.speeds])
    return {"rows": np.array(rows), "measured": [plant.measure(k) for k in range(6)]}


HOT, COLD = Measurement(0.0, temperature=90.0, voltage=7.4), Measurement(0.0, voltage=7.4)
MOVING = Measurement(0.0, speed=321.0, load=-0.3, current=-0.4, voltage=7.26, temperature=41.4)
STS: dict[str, tuple[Any, ...]] = {
    "goals": (
        ("goal_position", 1500),
        ("profile_velocity", 500),
        ("profile_acceleration", 20),
        0.1,
        ("torque_enable", 0),
        ("torque_enable", 1),
    ),
    "speed": (("torque_enable", 1), ("operating_mode", 1), ("profile_velocity", -70), ("phase", 0)),
    "duty": (("torque_enable", 1), ("operating_mode", 2), ("goal_pwm", -300)),
    "steps": (("operating_mode", 3), ("goal_position", 300), 0.1, ("goal_position", -50)),
    "damping": (("torque_enable", 2), ("torque_enable", 3), ("torque_enable", 0)),
    "the middle": (("torque_enable", 128), ("homing_offset", -100), ("phase", 16), ("homing_offset", 2000)),
    "limits": (
        ("min_position_limit", 900),
        ("max_position_limit", 1100),
        ("goal_position", 2000),
        ("goal_position", 5),
        ("min_position_limit", 0),
        ("max_position_limit", 0),
        ("goal_position", 3000),
    ),
    "what is measured": (MOVING, ("moving_threshold", 100), MOVING, ("phase", 4)),
    "heat": (("goal_position", 1200), HOT, 0.1, COLD, ("torque_enable", 1)),
    "supplies": (Measurement(0.0, voltage=4.0), Measurement(0.0, voltage=9.0), COLD),
    "overload": (
        ("goal_position", 1200),
        Measurement(0.0, load=0.95),
        1.9,
        0.2,
        ("goal_position", 900),
        2.5,
        ("torque_enable", 1),
    ),
    "overcurrent": (("goal_position", 1200), Measurement(0.0, current=-3.9), 1.9, 0.2, ("torque_enable", 1)),
    "a current that does not last": (Measurement(0.0, current=3.9), 1.9, COLD, Measurement(0.0, current=3.9), 0.3),
    "dead band and gains": (
        ("cw_dead_band", 3),
        ("ccw_dead_band", 5),
        ("position_p_gain", 20),
        ("position_i_gain", 2),
        ("position_d_gain", 30),
        ("torque_limit", 400),
    ),
    "no limit of speed": (("phase", 8), ("profile_velocity", 0), ("goal_position", 1400), ("phase", 0)),
    "ids": (("id", 5), ("lock", 1), ("id", 6), ("baud_rate", 0), ("return_delay_time", 9)),
    "the EEPROM": (
        ("lock", 0),
        ("id", 5),
        ("max_torque_limit", 700),
        ("lock", 1),
        ("id", 6),
        POWER_UP,
        ("goal_position", 1100),
        0.05,
        POWER_UP,
    ),
    "registered writes": (("action", b""), ("reg-write", b"\x2a\xdc\x05"), ("action", b""), ("action", b"")),
    "odd reads": (
        ("read", b"\x38\x02"),
        ("read", b"\x00\xff"),
        ("read", b"\xfe\x05"),
        ("read", b"\x01"),
        ("write", b"\x38\x01"),
        ("write", b"\x05\xff\xff\xff"),
        ("write", b""),
    ),
}
X: dict[str, tuple[Any, ...]] = {
    "goals": (
        ("goal_position", 1500),
        ("torque_enable", 1),
        ("goal_position", 1600),
        ("profile_velocity", 50),
        ("profile_acceleration", 20),
        0.1,
        ("torque_enable", 0),
    ),
    "speed": (
        ("operating_mode", 1),
        ("goal_velocity", -70),
        ("torque_enable", 1),
        ("goal_velocity", 2000),
        ("operating_mode", 3),
    ),
    "duty": (("operating_mode", 16), ("goal_pwm", -300), ("torque_enable", 1), ("goal_pwm", 886)),
    "currents": (
        ("operating_mode", 0),
        ("goal_current", -100),
        ("operating_mode", 5),
        ("goal_current", 50),
        ("operating_mode", 2),
    ),
    "turns": (
        ("operating_mode", 4),
        ("goal_position", 9000),
        ("homing_offset", 100),
        Measurement(9000.0),
        ("clear", b"\x01\x44\x58\x4c\x22"),
        ("clear", b"\x01"),
    ),
    "backwards": (("drive_mode", 1), MOVING, ("torque_enable", 1), ("goal_position", 900)),
    "profile by time": (("drive_mode", 4), ("profile_velocity", 50), ("profile_acceleration", 20)),
    "limits": (
        ("min_position_limit", 900),
        ("max_position_limit", 1100),
        ("goal_position", 2000),
        ("goal_position", 1100),
        ("velocity_limit", 10),
        ("goal_velocity", 11),
        ("goal_velocity", -10),
        ("pwm_limit", 100),
        ("goal_pwm", 101),
    ),
    "what is measured": (MOVING, ("moving_threshold", 100), MOVING, 1.5),
    "heat": (("torque_enable", 1), HOT, 0.1, COLD, ("torque_enable", 1), ("reboot", b""), ("torque_enable", 1)),
    "supplies": (Measurement(0.0, voltage=2.0), Measurement(0.0, voltage=20.0), COLD, ("ping", b"")),
    "watchdog": (
        ("torque_enable", 1),
        ("bus_watchdog", 5),
        0.05,
        ("led", 1),
        0.09,
        0.02,
        ("goal_position", 1200),
        ("bus_watchdog", 0),
        ("goal_position", 1200),
    ),
    "watchdog of a duty": (("operating_mode", 16), ("torque_enable", 1), ("goal_pwm", 200), ("bus_watchdog", 5), 0.11),
    "watchdog of a speed": (
        ("operating_mode", 1),
        ("torque_enable", 1),
        ("goal_velocity", 20),
        ("bus_watchdog", 1),
        0.03,
    ),
    "gains": (("position_p_gain", 900), ("position_i_gain", 2), ("position_d_gain", 30), ("goal_pwm", 400)),
    "ids": (("id", 5), ("torque_enable", 1), ("id", 6), ("return_delay_time", 9), ("baud_rate", 2)),
    "resets": (
        ("id", 5),
        ("baud_rate", 3),
        ("return_delay_time", 9),
        ("homing_offset", 3),
        ("reset", b"\x02"),
        ("reset", b"\x01"),
        ("reset", b"\x05"),
    ),
    "the EEPROM": (
        ("homing_offset", 50),
        ("goal_position", 1100),
        ("torque_enable", 1),
        0.05,
        POWER_UP,
        ("drive_mode", 1),
        POWER_UP,
    ),
    "turns while it moves": (("operating_mode", 4), MOVING, ("clear", b"\x01\x44\x58\x4c\x22")),
    "registered writes": (
        ("action", b""),
        ("reg-write", b"\x74\x00\xdc\x05\x00\x00"),
        ("action", b""),
        ("action", b""),
    ),
    "odd reads": (
        ("read", b"\x84\x00\x04\x00"),
        ("read", b"\x00\x00\x00\x00"),
        ("read", b"\x90\x00\xff\x00"),
        ("read", b"\x01"),
        ("write", b"\x84\x00\x01"),
        ("write", b"\x74\x00\x01\x00"),
        ("write", b"\x74\x00"),
        ("write", b"\x40\x00\x01\x01"),
    ),
}

CASES = {
    **{f"frames of {name}": lambda _, framing=framing: packed(framing) for name, framing in FRAMINGS.items()},
    **{
        f"lengths of {name}": lambda _, framing=framing: {"cuts": lengths(framing)}
        for name, framing in FRAMINGS.items()
    },
    "fast answers": lambda _: fast(),
    "collisions": lambda _: collisions(),
    "time on the wire": lambda _: [wire_time(size, baud) for size in (0, 1, 14) for baud in (1_000_000, 57_600)],
    **{f"registers of {name}": lambda _, name=name: model_of(name) for name in model_names()},
    "no such model": lambda _: refusals(servo_model, ("none",)),
    **{f"sts3215: {name}": stepped("sts3215", *steps) for name, steps in STS.items()},
    **{
        f"{model}: {name}": stepped(model, *steps)
        for model in MODELS[1:]
        for name, steps in X.items()
        if model == MODELS[1] or name != "currents"
    },
    **{f"instructions of {model}": lambda _, model=model: instructions(model) for model in MODELS},
    **{f"groups of {model}": lambda _, model=model: grouped(model) for model in MODELS},
    **{f"a lossy line of {model}": lambda _, model=model: lossy(model) for model in MODELS[:2]},
    **{f"a client of {model}": lambda _, model=model: asked(model) for model in MODELS},
    **{f"values that {model} refuses": lambda _, model=model: refused(model) for model in MODELS},
    "two makers": lambda _: refusals(
        lambda *names: (
            ServoBus([make_servo(servo_model(n), k) for k, n in enumerate(names)], KinematicPlant([0.0, 0.0])).frames
        ),
        MODELS[:2],
        MODELS[1:],
    ),
    **{f"lock-step of {1e3 * period:g} ms": lambda _, period=period: locked(period, 0.04) for period in (0.02, 0.0011)},
    "goals that came": scheduled,
    "real time": lambda _: in_real_time(),
    "ends of cycles": lambda _: cycle_ends(),
    "served in lock-step": lambda _: served(lambda bus: LockStep(bus, 0.02, GOALS)),
    "served in real time": lambda _: served(RealTime),
    "words of a line": lambda _: words_of_a_line(),
    "joints without mass": lambda _: kinematic(),
}

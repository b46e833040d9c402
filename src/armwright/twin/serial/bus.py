"""Servos on one line: instructions go to all of them, answers come one after another, or over each other.

An instruction is heard by the servos whose baud rate is the line's. Where several answer at the same time, a level is high
only if each of them holds it high, and the bytes are what a receiver makes of those levels.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from armwright.errors import BusError
from armwright.twin.serial.dynamixel import DynamixelServo
from armwright.twin.serial.feetech import FeetechServo
from armwright.twin.serial.frames import BROADCAST, DYNAMIXEL, FEETECH, Frame, Framing, Parser
from armwright.twin.serial.plant import Goal, Plant
from armwright.twin.serial.registers import ServoModel
from armwright.twin.serial.servo import Servo

BITS = 10  # of a byte on the line, with start and stop bit
KINDS: dict[int, Callable[..., Servo]] = {id(FEETECH): FeetechServo, id(DYNAMIXEL): DynamixelServo}
ALL = b"\xff"  # option of a reset, which no broadcast may have
Speakers = list[tuple[Servo, int, int, bytes]]  # that answer at the same time: servo, its id, error, data


@dataclass(frozen=True, slots=True)
class Answer:
    """Bytes that come back, `delay` [s] after the line is free."""

    delay: float
    data: bytes


@dataclass(frozen=True)
class Losses:
    """A line that loses bytes of both directions: each with probability `share`, drawn by `seed`."""

    share: float = 0.0
    seed: int = 0


def make_servo(model: ServoModel, number: int, **values: int) -> Servo:
    """A servo of a model, with id and other EEPROM values by name.

    Raises:
        BusError: values that the registers do not allow.
    """
    return KINDS[id(model.framing)](model, number, values)


def wire_time(size: int, baud: int) -> float:
    """Time [s] that bytes take on a line [bit/s]."""
    return BITS * size / baud


def collide(frames: Sequence[bytes]) -> bytes:
    """Bytes received when several frames are sent at the same time, the k-th one k bits late.

    Without the shift, equal frames would pass unharmed; two servos' clocks do not agree as well as that.
    """
    if len(frames) == 1:
        return frames[0]
    length = BITS * max(map(len, frames)) + BITS + len(frames)
    levels = (1 << length) - 1
    for late, frame in enumerate(frames):
        for k, byte in enumerate(frame):
            low = ~(byte << 1 | 0x200) & 0x3FF  # start bit, eight bits from the lowest, stop bit
            levels &= ~(low << BITS * k + late)
    received, at = bytearray(), 0
    while at < length:
        if levels >> at & 1:
            at += 1
            continue
        received.append(levels >> at + 1 & 0xFF)
        at += BITS
    return bytes(received)


class ServoBus:
    """All servos on a line, with the plant behind them.

    Args:
        servos: of one protocol.   plant: their joints, in the same order.   losses: of bytes.

    Attributes:
        time: [s] of the plant.   frames: that were heard.   unknown: instructions that nobody knows.
        commanded: called with (servo, goal) whenever a goal changes.
    Raises:
        BusError: no servos, or of several protocols.
    """

    def __init__(self, servos: Sequence[Servo], plant: Plant, losses: Losses | None = None):
        framings = {id(servo.model.framing) for servo in servos}
        if len(framings) != 1:
            names = [servo.model.name for servo in servos]
            raise BusError(place="servos", value=names, expected="one or more servos of the same protocol")
        self.servos, self.plant, self.losses = list(servos), plant, losses or Losses()
        self.framing: Framing = servos[0].model.framing
        self.time, self.frames, self.unknown = 0.0, 0, 0
        self.commanded: Callable[[int, Goal], None] = lambda servo, goal: None
        self._parser, self._baud = Parser(self.framing), 0
        self._random = random.Random(self.losses.seed)
        self._goals: list[Goal | None] = [None] * len(servos)
        self._states: list[object] = [None] * len(servos)
        self._measure(0.0)
        self._command()

    # Bytes.

    def feed(self, data: bytes, baud: int) -> Iterator[Frame]:
        """Whole frames, as bytes come at a baud rate."""
        if baud != self._baud:
            self._parser, self._baud = Parser(self.framing), baud
        yield from self._parser.feed(self._passed(data))

    def pause(self) -> Iterator[Frame]:
        """Gives up a frame that has begun, after a pause on the line; yields what it swallowed."""
        yield from self._parser.drop()

    def _passed(self, data: bytes) -> bytes:
        share = self.losses.share
        return data if not share else bytes(byte for byte in data if self._random.random() >= share)

    # Time.

    def advance(self, until: float) -> None:
        """Moves the joints on to a time [s], and lets the servos measure."""
        if until > self.time:
            seconds, self.time = until - self.time, until
            self.plant.advance(until)
            self._measure(seconds)
            self._command()

    def _measure(self, seconds: float) -> None:
        for k, servo in enumerate(self.servos):
            servo.measured(self.plant.measure(k), seconds)

    def _command(self) -> None:
        for k, servo in enumerate(self.servos):
            state = servo.state
            if state == self._states[k]:
                continue
            self._states[k], goal = state, servo.goal
            if goal != self._goals[k]:
                self._goals[k] = goal
                self.plant.command(k, goal)
                self.commanded(k, goal)

    # Frames.

    def answer(self, frame: Frame, baud: int) -> list[Answer]:
        """Does what an instruction says, at the present time, and returns the answers in their order."""
        name = self.framing.instructions.get(frame.instruction)
        heard = [servo for servo in self.servos if servo.baud == baud]
        self.frames += 1
        if name is None:
            self.unknown += 1
            return []
        for servo in heard:
            servo.hear()
        delays = {id(servo): servo.delay for servo in heard}  # an instruction that changes it is answered as before
        group = GROUPS.get(name)
        if group is None:
            slots = self._single(name, frame, heard)
        elif frame.number == BROADCAST:
            slots = group(self, frame.data, heard)
        else:
            slots = []
        if not name.endswith("read") and name != "ping":
            self._measure(0.0)
            self._command()
        pack = self._fast if name.startswith("fast-") else self._frames
        spoken = [(delays[id(slot[0][0])], data) for slot, data in zip(slots, pack(slots), strict=False)]
        return [Answer(delay, passed) for delay, data in spoken if (passed := self._passed(data))]

    def _frames(self, slots: list[Speakers]) -> list[bytes]:
        return [collide([self.framing.status(*spoken[1:]) for spoken in slot]) for slot in slots]

    def _fast(self, slots: list[Speakers]) -> list[bytes]:
        """Parts of one frame; a servo that is silent, or one of two with its id, breaks the frame."""
        assert self.framing is DYNAMIXEL
        parts = DYNAMIXEL.fast([slot[0][1:] if slot else (0, 0, b"") for slot in slots])
        whole = next((k for k, slot in enumerate(slots) if not slot), len(slots))
        return [collide([part] * len(slot)) for slot, part in zip(slots[:whole], parts, strict=False)]

    def _single(self, name: str, frame: Frame, heard: list[Servo]) -> list[Speakers]:
        """An instruction to the servos of one id, or to all; of those only ping is answered, in the order of ids."""
        broadcast = frame.number == BROADCAST
        if broadcast and (name == "read" or (name == "reset" and frame.data == ALL)):
            return []
        slots: dict[int, Speakers] = {}
        for servo in sorted(heard, key=lambda servo: servo.number):
            number = servo.number  # an instruction that changes it is answered with the old one
            if not broadcast and number != frame.number:
                continue
            answers = servo.answers(name)
            status = servo.execute(name, frame.data)
            if status is not None and answers and (not broadcast or name == "ping"):
                slots.setdefault(number, []).append((servo, number, *status))
        return list(slots.values())

    def _read_each(self, wanted: Sequence[tuple[int, int, int]], heard: list[Servo]) -> list[Speakers]:
        """Answers to reads of (id, address, count), in this order; an empty slot where nobody answers."""
        return [
            [(s, number, *s.read(address, count)) for s in heard if s.number == number and s.answers("sync-read")]
            for number, address, count in wanted
        ]

    def _sync_read(self, data: bytes, heard: list[Servo]) -> list[Speakers]:
        word = 2 * self.framing.word
        address, count = self.framing.integers(data, 2)
        return [slot for slot in self._read_each([(n, address, count) for n in data[word:]], heard) if slot]

    def _fast_sync_read(self, data: bytes, heard: list[Servo]) -> list[Speakers]:
        word = 2 * self.framing.word
        address, count = self.framing.integers(data, 2)
        if len(data[word:]) * (count + 4) >= self.framing.longest:
            return []
        return self._read_each([(n, address, count) for n in data[word:]], heard)

    def _fast_bulk_read(self, data: bytes, heard: list[Servo]) -> list[Speakers]:
        step = 1 + 2 * self.framing.word
        pieces = [data[at : at + step] for at in range(0, len(data) - step + 1, step)]
        areas = [self.framing.integers(piece[1:], 2) for piece in pieces]
        return self._read_each([(p[0], area[0], area[1]) for p, area in zip(pieces, areas, strict=True)], heard)

    def _bulk_read(self, data: bytes, heard: list[Servo]) -> list[Speakers]:
        return [slot for slot in self._fast_bulk_read(data, heard) if slot]

    def _sync_write(self, data: bytes, heard: list[Servo]) -> list[Speakers]:
        word = 2 * self.framing.word
        address, count = self.framing.integers(data, 2)
        for at in range(word, len(data) - count, count + 1):
            self._write(data[at], address, data[at + 1 : at + 1 + count], heard)
        return []

    def _bulk_write(self, data: bytes, heard: list[Servo]) -> list[Speakers]:
        word, at = 2 * self.framing.word, 0
        while at + 1 + word <= len(data):
            address, count = self.framing.integers(data[at + 1 :], 2)
            piece = data[at + 1 + word : at + 1 + word + count]
            if len(piece) == count:
                self._write(data[at], address, piece, heard)
            at += 1 + word + count
        return []

    def _write(self, number: int, address: int, data: bytes, heard: list[Servo]) -> None:
        for servo in [servo for servo in heard if servo.number == number]:
            servo.write(address, data)


# Instructions to several servos by id, which are broadcast.
GROUPS: dict[str, Callable[[ServoBus, bytes, list[Servo]], list[Speakers]]] = {
    "sync-read": ServoBus._sync_read,
    "sync-write": ServoBus._sync_write,
    "bulk-read": ServoBus._bulk_read,
    "bulk-write": ServoBus._bulk_write,
    "fast-sync-read": ServoBus._fast_sync_read,
    "fast-bulk-read": ServoBus._fast_bulk_read,
}

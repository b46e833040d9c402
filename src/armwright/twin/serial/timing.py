"""Time of the twin on a serial line: in lock-step it follows from the frames alone, in real time from the wall clock.

Lock-step, for every instruction, in this order:

    1. time goes on by the instruction's bytes on the wire; the plant is simulated up to there
    2. the servos do what it says: goals act from this time on, measurements are of this time
    3. time goes on by the return delays and the bytes of the answers
    4. after the instruction that closes a cycle: on to the next multiple of the period, plant included

Time is counted in whole nanoseconds, so that a sum of frames is the same whatever it is added to.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from armwright.errors import BusError
from armwright.output import write_whole
from armwright.twin import clock
from armwright.twin.serial.bus import ServoBus, wire_time
from armwright.twin.serial.frames import Frame, Framing
from armwright.twin.serial.plant import Goal

PATIENCE = 0.025  # [s] in which a reply must be ready: the makers' software gives up after 34 ms
SECOND = 1_000_000_000  # [ns]


@dataclass(frozen=True, slots=True)
class Reply:
    """Bytes of all answers to an instruction, and the wall time [s] from the instruction to the end of the last one."""

    data: bytes
    wire: float = 0.0


class Timing(Protocol):
    """A way for time to go on."""

    def reply(self, frame: Frame, baud: int) -> Reply:
        """Does what an instruction says, and returns what answers it."""
        ...

    def close(self, frame: Frame) -> None:
        """Is called when an instruction's reply is sent."""
        ...

    def idle(self) -> None:
        """Is called while no bytes come."""
        ...

    def late(self, seconds: float) -> None:
        """A reply was dropped because it was ready `seconds` after it was due."""
        ...


@dataclass(frozen=True)
class CycleEnd:
    """The instruction that closes a cycle: by name, and with the address it begins with (None: any)."""

    instruction: str
    address: int | None = None

    @classmethod
    def parse(cls, text: str, framing: Framing) -> CycleEnd:
        """Reads "sync-write:42" or "action".

        Raises:
            BusError: an instruction that the protocol does not have, or an address that is no whole number.
        """
        name, colon, address = text.partition(":")
        names = list(framing.instructions.values())
        if name not in names:
            raise BusError("unknown instruction", place="tick", value=text, choices=names)
        if colon and not address.isdecimal():
            raise BusError(place="tick", value=text, expected=f"{name}:ADDRESS, such as {name}:42")
        return cls(name, int(address) if colon else None)

    def matches(self, frame: Frame, framing: Framing) -> bool:
        """True for the instruction that closes a cycle."""
        if framing.instructions.get(frame.instruction) != self.instruction:
            return False
        skipped = 0 if not self.instruction.endswith(("bulk-read", "bulk-write")) else 1  # their data begins with an id
        return self.address is None or framing.integers(frame.data[skipped:], 1) == (self.address,)


class LockStep:
    """Time that follows from the sequence of frames alone, whatever the client's pauses.

    Args:
        bus: of the servos, at time 0.   period: [s] of a cycle.   end: instruction that closes one.

    Attributes:
        nanoseconds: present time.   cycles: that were closed.   overran: cycles whose frames took longer than the period.
    Raises:
        BusError: a period that is no positive number.
    """

    def __init__(self, bus: ServoBus, period: float, end: CycleEnd):
        if not (math.isfinite(period) and period >= 1e-6):
            raise BusError(place="period", value=period, expected="a time of at least 1e-6 s")
        self.bus, self.end = bus, end
        self.period = round(period * SECOND)
        self.nanoseconds = self.cycles = self.overran = 0
        self._closed = 0

    def _pass(self, seconds: float) -> None:
        self.nanoseconds += round(seconds * SECOND)

    def reply(self, frame: Frame, baud: int) -> Reply:
        """Does what an instruction says, and returns what answers it, without a wait."""
        self._pass(wire_time(frame.size, baud))
        self.bus.advance(self.nanoseconds / SECOND)
        answers = self.bus.answer(frame, baud)
        for answer in answers:
            self._pass(answer.delay)
            self._pass(wire_time(len(answer.data), baud))
        return Reply(b"".join(answer.data for answer in answers))

    def close(self, frame: Frame) -> None:
        """Goes on to the end of the cycle if the instruction closes one; to be called when its reply is sent."""
        if not self.end.matches(frame, self.bus.framing):
            return
        ends = -(-self.nanoseconds // self.period) * self.period
        self.cycles += 1
        self.overran += ends - self._closed > self.period
        self.nanoseconds = self._closed = ends
        self.bus.advance(ends / SECOND)

    def idle(self) -> None:
        """Nothing: time stands still."""

    def late(self, seconds: float) -> None:
        """Ends lock-step: the client has gone on without the answer.

        Raises:
            BusError: says how long it took.
        """
        what = f"a reply was ready after {1e3 * seconds:.0f} ms of wall time and was dropped; lock-step ends"
        at = f"t = {self.nanoseconds / SECOND:.9g} s"
        raise BusError(what, place=at, expected=f"at most {1e3 * PATIENCE:g} ms, on a machine without other work")


class RealTime:
    """Time that follows the wall clock. Bytes take their time on the wire, so a reply is held back until it has passed.

    Args:
        bus: of the servos, at time 0, which is the moment of this call.
    """

    def __init__(self, bus: ServoBus):
        self.bus, self._began = bus, clock.now()

    def reply(self, frame: Frame, baud: int) -> Reply:
        """Does what an instruction says, and returns what answers it."""
        wire = wire_time(frame.size, baud)
        self.bus.advance(clock.now() + wire - self._began)
        answers = self.bus.answer(frame, baud)
        wire += sum(answer.delay + wire_time(len(answer.data), baud) for answer in answers)
        return Reply(b"".join(answer.data for answer in answers), wire)

    def close(self, frame: Frame) -> None:
        """Nothing: cycles are the client's."""

    def idle(self) -> None:
        """Moves the joints on to the present time."""
        self.bus.advance(clock.now() - self._began)

    def late(self, seconds: float) -> None:
        """Nothing: the server counts it."""


class GoalSchedule:
    """Goal positions [rad] with the times at which they came, as a schedule file that `read_schedule` reads.

    Args:
        bus: whose goals are recorded from now on.   names: of the joints, one for each servo.
        radians: of a joint, from its number and the encoder's counts.
    """

    def __init__(self, bus: ServoBus, names: Sequence[str], radians: Callable[[int, float], float] | None = None):
        counts = [servo.model.counts for servo in bus.servos]
        self.names, self._bus = list(names), bus
        self._radians = radians or (lambda k, position: (position / counts[k] - 0.5) * math.tau)
        self._present = [self._radians(k, bus.plant.measure(k).position) for k in range(len(bus.servos))]
        self.rows: list[tuple[float, list[float]]] = [(0.0, list(self._present))]
        bus.commanded = self._commanded

    def _commanded(self, servo: int, goal: Goal) -> None:
        if goal.mode != "position":
            return
        self._present[servo] = self._radians(servo, goal.value)
        if self.rows[-1][0] == self._bus.time:
            self.rows.pop()
        if not self.rows or self.rows[-1][1] != self._present:
            self.rows.append((self._bus.time, list(self._present)))

    def write(self, path: str | Path) -> None:
        """Writes the file.

        Raises:
            OutputError: it cannot be written.
        """
        head = ",".join(["t [s]", *self.names])
        lines = [head, *(",".join(map(repr, [time, *goals])) for time, goals in self.rows)]
        write_whole(path, "\n".join(lines) + "\n", (".csv",))

"""Client of bus servos: registers by name, read and written over a serial port."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from armwright.errors import BusError
from armwright.twin import clock
from armwright.twin.serial.frames import BROADCAST, DYNAMIXEL, Frame, Parser
from armwright.twin.serial.registers import Register, ServoModel

PATIENCE = 0.05  # [s] for all answers to an instruction, beside their bytes
TRIES = 3  # of an instruction to one servo
INSTALL = 'pip install "armwright[twin]"'


class Port(Protocol):
    """A serial port."""

    def write(self, data: bytes) -> None:
        """Sends bytes."""
        ...

    def read(self, seconds: float) -> bytes:
        """Bytes that have come, as soon as there are any; none after a time [s]."""
        ...


class SerialPort:
    """A port of this computer, by pyserial; a context manager, which closes it at its end.

    Args:
        path: such as "/dev/ttyUSB0" or "COM3".   baud: [bit/s].
    Raises:
        BusError: pyserial is not installed, or the port cannot be opened.
    """

    def __init__(self, path: str, baud: int):
        try:
            import serial
        except ImportError:
            raise BusError("pyserial is not installed", expected=INSTALL) from None
        try:
            self._port: Any = serial.Serial(path, baud, timeout=0.0, write_timeout=1.0)
        except (OSError, ValueError) as error:
            raise BusError(f"cannot be opened: {error}", place="serial", value=path) from None

    def __enter__(self) -> SerialPort:
        return self

    def __exit__(self, *exception: object) -> None:
        self._port.close()

    def write(self, data: bytes) -> None:
        """Sends bytes.

        Raises:
            BusError: the port has gone.
        """
        try:
            self._port.write(data)
        except OSError as error:
            raise BusError(f"cannot be written: {error}", place="serial") from None

    def read(self, seconds: float) -> bytes:
        """Bytes that have come, as soon as there are any; none after a time [s].

        Raises:
            BusError: the port has gone.
        """
        try:
            self._port.timeout = seconds
            return self._port.read(1) + self._port.read(self._port.in_waiting)
        except OSError as error:
            raise BusError(f"cannot be read: {error}", place="serial") from None


class ServoClient:
    """Servos of one model on a port.

    Args:
        port: open.   model: of all servos.   patience: [s] for answers.

    Attributes:
        missed: answers that did not come.
    """

    def __init__(self, port: Port, model: ServoModel, patience: float = PATIENCE):
        self.port, self.model, self.patience, self.missed = port, model, patience, 0
        self._codes = {name: code for code, name in model.framing.instructions.items()}

    def read(self, number: int, name: str) -> int:
        """A register's value.

        Raises:
            BusError: no answer, or one with an error.
        """
        register = self.model.by_name[name]
        data = self._one(number, "read", self._words(register.address, register.size), f"{name} of servo {number}")
        return register.decode(data)

    def write(self, number: int, name: str, value: int) -> None:
        """Writes a register, and waits for the answer.

        Raises:
            BusError: no answer, or one with an error.
        """
        register = self.model.by_name[name]
        data = self._words(register.address) + register.encode(value)
        self._one(number, "write", data, f"{name} = {value} of servo {number}")

    def sync_read(self, numbers: Sequence[int], names: Sequence[str]) -> dict[int, dict[str, int]]:
        """Registers of several servos at once, by id; of those that answer without an error.

        Args:
            numbers: ids.   names: of registers; what lies between them is read too.
        """
        registers = [self.model.by_name[name] for name in names]
        first, end = min(each.address for each in registers), max(each.end for each in registers)
        data = self._words(first, end - first) + bytes(numbers)
        frames = self._transact(BROADCAST, "sync-read", data, len(numbers))
        found = {}
        for frame in frames:
            error, content = self._status(frame)
            if not error and len(content) == end - first and frame.number in numbers:
                found[frame.number] = {
                    name: _part(each, content, first) for name, each in zip(names, registers, strict=True)
                }
        self.missed += len(numbers) - len(found)
        return found

    def sync_write(self, name: str, values: Mapping[int, int]) -> None:
        """Writes a register of several servos, by id; nobody answers."""
        register = self.model.by_name[name]
        each = b"".join(bytes((number,)) + register.encode(value) for number, value in values.items())
        data = self._words(register.address, register.size) + each
        self.port.write(self.model.framing.pack(BROADCAST, self._codes["sync-write"], data))

    def _words(self, *values: int) -> bytes:
        return b"".join(value.to_bytes(self.model.framing.word, "little") for value in values)

    def _status(self, frame: Frame) -> tuple[int, bytes]:
        """Error and data of an answer."""
        if self.model.framing is DYNAMIXEL:
            return (frame.data[0], frame.data[1:]) if frame.data else (0, b"")
        return frame.instruction, frame.data

    def _one(self, number: int, instruction: str, data: bytes, what: str) -> bytes:
        for _ in range(TRIES):  # a read, or a write of one value, may be repeated
            frames = [each for each in self._transact(number, instruction, data, 1) if each.number == number]
            if frames:
                error, content = self._status(frames[0])
                if error:
                    raise BusError(f"was answered with the error {error:#04x}", place=what)
                return content
            self.missed += 1
        raise BusError(f"no answer to {TRIES} tries", place=what, expected="a servo with that id, at this baud rate")

    def _transact(self, number: int, instruction: str, data: bytes, answers: int) -> list[Frame]:
        """Sends an instruction; frames that come back, as many as are expected or until the time is over."""
        while self.port.read(0.0):  # what came too late for the instruction before
            pass
        self.port.write(self.model.framing.pack(number, self._codes[instruction], data))
        parser, frames, end = Parser(self.model.framing), list[Frame](), clock.now() + self.patience
        while len(frames) < answers:
            left = end - clock.now()
            data = self.port.read(max(left, 0.0))
            if not data and left <= 0.0:  # bytes that came while this process had to wait count
                break
            frames += parser.feed(data)
        return frames


def _part(register: Register, content: bytes, first: int) -> int:
    return register.decode(content[register.address - first : register.end - first])

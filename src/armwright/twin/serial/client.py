"""Client of bus servos: registers by name, read and written over a serial port."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from armwright.errors import BusError
from armwright.twin import clock
from armwright.twin.serial.frames import BROADCAST, DYNAMIXEL, FEETECH, Frame, Parser
from armwright.twin.serial.registers import Register, ServoModel

PATIENCE = 0.05  # [s] for all answers to an instruction, beside their bytes
TRIES = 3  # of an instruction to one servo
INSTALL = 'pip install "armwright[twin]"'
# Bits of an answer's error that tell a servo's condition: the instruction was carried out all the same.
FEETECH_ALARMS = {0x01: "voltage", 0x02: "encoder", 0x04: "temperature", 0x08: "current", 0x20: "overload"}
DYNAMIXEL_ALARMS = {0x80: "hardware error"}


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
        missed: answers that did not come.   alarms: error of each servo's last answer to `sync_read`, by id.
    """

    def __init__(self, port: Port, model: ServoModel, patience: float = PATIENCE):
        self.port, self.model, self.patience, self.missed = port, model, patience, 0
        self.alarms: dict[int, int] = {}
        self._longer = 0
        self._names = FEETECH_ALARMS if model.framing is FEETECH else DYNAMIXEL_ALARMS
        self._conditions = 0xFF if model.framing is FEETECH else 0x80  # a Feetech answer has no other errors
        self._codes = {name: code for code, name in model.framing.instructions.items()}

    def read(self, number: int, name: str, *, despite_alarm: bool = False) -> int:
        """A register's value.

        Args:
            number: id.   name: of the register.   despite_alarm: True: an alarm of the servo is no error.
        Raises:
            BusError: no answer, or one with an error.
        """
        register = self.model.by_name[name]
        data, what = self._words(register.address, register.size), f"{name} of servo {number}"
        return register.decode(self._one(number, "read", data, register.size, what, despite_alarm))

    def write(self, number: int, name: str, value: int, *, despite_alarm: bool = False) -> None:
        """Writes a register, and waits for the answer.

        Args:
            number: id.   name: of the register.   value: to be written.   despite_alarm: True: an alarm of the servo is no error.
        Raises:
            BusError: no answer, or one with an error.
        """
        register = self.model.by_name[name]
        data = self._words(register.address) + register.encode(value)
        self._one(number, "write", data, 0, f"{name} = {value} of servo {number}", despite_alarm)

    def sync_read(self, numbers: Sequence[int], names: Sequence[str]) -> dict[int, dict[str, int]]:
        """Registers of several servos at once, by id; of those that answer. `alarms` has the errors of these answers.

        Args:
            numbers: ids.   names: of registers; what lies between them is read too.
        """
        registers = [self.model.by_name[name] for name in names]
        first, end = min(each.address for each in registers), max(each.end for each in registers)
        # After a reading with silent servos the next one has another length, so that late answers are not taken for it.
        size = end - first + self._longer
        answers = self._transact(BROADCAST, "sync-read", self._words(first, size) + bytes(numbers), numbers, size)
        self.alarms = {number: error for number, (error, _) in answers.items() if error}
        found = {
            number: {name: _part(each, content, first) for name, each in zip(names, registers, strict=True)}
            for number, (_, content) in answers.items()
            if content
        }
        self.missed += len(numbers) - len(found)
        if len(found) < len(numbers):
            self._longer = (self._longer + 1) % 3
        return found

    def sync_write(self, name: str, values: Mapping[int, int]) -> None:
        """Writes a register of several servos, by id; nobody answers."""
        register = self.model.by_name[name]
        each = b"".join(bytes((number,)) + register.encode(value) for number, value in values.items())
        data = self._words(register.address, register.size) + each
        self.port.write(self.model.framing.pack(BROADCAST, self._codes["sync-write"], data))

    def _words(self, *values: int) -> bytes:
        return b"".join(value.to_bytes(self.model.framing.word, "little") for value in values)

    def alarm(self, error: int) -> str:
        """An answer's error in words."""
        names = [name for bit, name in self._names.items() if error & bit]
        return f"the error {error:#04x}{' (' if names else ''}{', '.join(names)}{')' if names else ''}"

    def _status(self, frame: Frame, size: int) -> tuple[int, bytes] | None:
        """Error and data of an answer with so many bytes of data; None of another frame."""
        if self.model.framing is DYNAMIXEL:
            if frame.instruction != DYNAMIXEL.reply or not frame.data:
                return None
            error, data = frame.data[0], frame.data[1:]
        else:
            error, data = frame.instruction, frame.data
        return (error, data) if len(data) == size or (error & ~self._conditions and not data) else None

    def _one(self, number: int, instruction: str, data: bytes, size: int, what: str, despite_alarm: bool) -> bytes:
        for tried in range(TRIES):  # a read, or a write of one value, may be repeated
            answers = self._transact(number, instruction, data, [number], size)
            if answers:
                self._drain(self.patience if tried else 0.0)  # the next instruction shall not take another try's answer
                error, content = answers[number]
                if error and not (despite_alarm and not error & ~self._conditions):
                    raise BusError(f"was answered with {self.alarm(error)}", place=what)
                return content
            self.missed += 1
        raise BusError(f"no answer to {TRIES} tries", place=what, expected="a servo with that id, at this baud rate")

    def _transact(
        self, number: int, instruction: str, data: bytes, numbers: Sequence[int], size: int
    ) -> dict[int, tuple[int, bytes]]:
        """Sends an instruction; error and data of the answers, by id, until all have come or the time is over.

        Frames that are no answers to it are skipped, such as its echo on a line whose adapter hears itself.
        """
        code = self._codes[instruction]
        self._drain(0.0)  # what came too late for the instruction before
        self.port.write(self.model.framing.pack(number, code, data))
        parser, found, end = Parser(self.model.framing), dict[int, tuple[int, bytes]](), clock.now() + self.patience
        while len(found) < len(numbers):
            left = end - clock.now()
            frames = parser.feed(self.port.read(max(left, 0.0)))
            if left <= 0.0:  # bytes that came while this process had to wait count, and frames behind a damaged one
                frames += parser.drop()
            for frame in frames:
                answer = self._status(frame, size)
                is_echo = (frame.number, frame.instruction, frame.data) == (number, code, data)
                if answer is not None and frame.number in numbers and not is_echo:
                    found.setdefault(frame.number, answer)
            if left <= 0.0:
                break
        return found

    def _drain(self, seconds: float) -> None:
        """Drops bytes that are there or come within a time [s]; those of a line that never is quiet until the patience ends."""
        began, data = clock.now(), b"-"
        while data and clock.now() - began < self.patience:
            data = self.port.read(max(began + seconds - clock.now(), 0.0))


def _part(register: Register, content: bytes, first: int) -> int:
    return register.decode(content[register.address - first : register.end - first])

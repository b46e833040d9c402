"""A servo's bank of registers and the rules that makers share: EEPROM and RAM, registered writes, power-up.

What makers do differently is in `feetech.py` and `dynamixel.py`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

from armwright.errors import BusError
from armwright.twin.serial.plant import Goal, Measurement
from armwright.twin.serial.registers import Register, ServoModel

Status = tuple[int, bytes]  # error and data of an answer
TICK = 2e-6  # [s] of one count of the return delay


class Servo(ABC):
    """A servo on a bus, as far as its firmware answers; the mechanics are a `Plant`'s.

    Args:
        model: its table.   number: its id.   values: of EEPROM registers that differ from the factory's, by name.

    Attributes:
        memory: the bytes of all registers.   goal: for the inner loop, as the registers say.
    Raises:
        BusError: values of registers that do not exist, are no EEPROM or do not allow them.
    """

    def __init__(self, model: ServoModel, number: int, values: Mapping[str, int] | None = None):
        self.model = model
        self.memory = bytearray(model.size)
        self.now = Measurement(0.0)
        shown = [each.address for each in model.registers if not each.writable]
        self._controls = min(address for address in shown if address > model.by_name["goal_position"].address)
        self.factory()
        for name, value in {"id": number, **(values or {})}.items():
            register = model.by_name.get(name)
            if register is None or register.address >= model.eeprom:
                names = [each.name for each in model.registers if each.address < model.eeprom]
                raise BusError("no EEPROM register", place=f"{model.name} registers", value=name, choices=names)
            if not register.allows(value) or register.decode(register.encode(value)) != value:
                expected = f"{register.low} to {register.high}"
                raise BusError(place=f"{model.name} {name}", value=value, expected=expected)
            self[name] = value
        self._kept = bytearray(self.memory[: model.eeprom])
        self.power_up()

    # Values.

    def __getitem__(self, name: str) -> int:
        register = self.model.by_name[name]
        return register.decode(self.memory[register.address : register.end])

    def __setitem__(self, name: str, value: int) -> None:
        register = self.model.by_name[name]
        self.memory[register.address : register.end] = register.encode(value)

    def __contains__(self, name: str) -> bool:
        return name in self.model.by_name

    @property
    def number(self) -> int:
        """Its id."""
        return self["id"]

    @property
    def baud(self) -> int:
        """Its speed on the line [bit/s]; 0 for a code without meaning."""
        code, bauds = self["baud_rate"], self.model.bauds
        return bauds[code] if code < len(bauds) else 0

    @property
    def delay(self) -> float:
        """Time [s] between an instruction and its answer."""
        return TICK * self["return_delay_time"]

    # What differs between makers.

    @property
    @abstractmethod
    def error(self) -> int:
        """Error byte of an answer to an instruction without mistakes."""

    @property
    @abstractmethod
    def goal(self) -> Goal:
        """Command to the inner loop, as the registers say."""

    @abstractmethod
    def answers(self, instruction: str) -> bool:
        """True if the status level lets the servo answer an instruction."""

    @abstractmethod
    def write(self, address: int, data: bytes) -> int:
        """Writes registers; returns the error byte."""

    @abstractmethod
    def read(self, address: int, count: int) -> Status:
        """Error byte and the bytes from an address on."""

    @abstractmethod
    def show(self) -> None:
        """Puts what was measured into the registers that show it, before they are read."""

    @abstractmethod
    def watch(self, seconds: float) -> None:
        """Checks limits that need time, `seconds` after the last check."""

    @abstractmethod
    def hear(self) -> None:
        """Notices that an instruction came, for this servo or another one."""

    @abstractmethod
    def started(self) -> None:
        """Fills RAM registers that begin with another register's value, and forgets what the firmware counted."""

    # Life.

    def power_up(self) -> None:
        """State after the supply comes: EEPROM as it was kept, RAM at its defaults, no torque."""
        self.memory[: self.model.eeprom] = self._kept
        self._ram()
        self.started()

    def measured(self, measurement: Measurement, seconds: float) -> None:
        """Takes what is measured now, `seconds` after the last time."""
        self.now = measurement
        if not self._settled:
            self._settled = True
            self.settle()
        self.watch(seconds)

    @property
    def state(self) -> tuple[bytes, int, int]:
        """All that the goal depends on; cheaper than the goal."""
        return bytes(self.memory[: self._controls]), self["hardware_error_status"], self.turns

    @property
    @abstractmethod
    def turns(self) -> int:
        """Whole turns [counts] that the position shown leaves out."""

    def settle(self) -> None:
        """First measurement after power-up: the goal is where the servo stands."""
        self.hold()

    def hold(self) -> None:
        """Makes the present position the goal."""
        self.show()
        self["goal_position"] = self["present_position"]
        self._goal_written = False

    def overlaid(self, address: int, data: bytes) -> list[tuple[Register, int]]:
        """Registers that a write touches, with the values they would have."""
        fresh = bytearray(self.memory)
        data = data[: max(len(fresh) - address, 0)]
        fresh[address : address + len(data)] = data
        touched = self.model.touched(address, len(data))
        return [(each, each.decode(fresh[each.address : each.end])) for each in touched]

    def store(self, values: Sequence[tuple[Register, int]]) -> None:
        """Puts values into registers, with what follows from each."""
        for register, value in values:
            old = self[register.name]
            self[register.name] = value
            if register.name in self.effects:
                self.effects[register.name](self, old)
        self.keep(*(register.name for register, _ in values))

    def torque_switched(self, old: int) -> None:
        """A motor that is switched on holds where it stands, unless a goal was written meanwhile."""
        if self["torque_enable"] and not old and not self._goal_written:
            self.hold()
        self._goal_written = False

    # what follows from a write, by register; takes the old value
    effects: ClassVar[Mapping[str, Callable[..., None]]] = {}

    def keep(self, *names: str) -> None:
        """Stores EEPROM registers, so that power-up finds their values."""
        for register in map(self.model.by_name.__getitem__, names):
            if register.address < self.model.eeprom:
                self._kept[register.address : register.end] = self.memory[register.address : register.end]

    def factory(self) -> None:
        """Puts the factory's values into all registers."""
        for register in self.model.registers:
            if register.address < self.model.eeprom:
                self[register.name] = register.default or 0
        self._ram()

    def _ram(self) -> None:
        for register in self.model.registers:
            if register.address >= self.model.eeprom:
                self[register.name] = register.default or 0
        self._settled, self._goal_written = False, False
        self._registered: tuple[int, bytes] | None = None

    # Instructions to one servo.

    def execute(self, instruction: str, data: bytes) -> Status | None:
        """Error byte and data that an instruction returns; None if it is not answered."""
        word, (action, words) = self.model.framing.word, self.actions[instruction]
        if len(data) < words * word:
            return None
        return action(self, *self.model.framing.integers(data, words), data[words * word :])

    def _ping(self, rest: bytes) -> Status:
        return self.error, b""

    def _read(self, address: int, count: int, rest: bytes) -> Status:
        return self.read(address, count)

    def _write(self, address: int, data: bytes) -> Status:
        return self.write(address, data), b""

    def _reg_write(self, address: int, data: bytes) -> Status:
        self._registered = address, data
        self["registered_instruction"] = 1
        return self.error, b""

    def _action(self, rest: bytes) -> Status | None:
        registered, self._registered = self._registered, None
        self["registered_instruction"] = 0
        if registered is None:
            return self.error | self.nothing_registered, b""
        return self.write(*registered), b""

    nothing_registered: ClassVar[int] = 0  # error of an action without a registered write
    # the function of each instruction, and how many addresses or counts its data begins with
    actions: ClassVar[Mapping[str, tuple[Callable[..., Status | None], int]]] = {
        "ping": (_ping, 0),
        "read": (_read, 2),
        "write": (_write, 1),
        "reg-write": (_reg_write, 1),
        "action": (_action, 0),
    }

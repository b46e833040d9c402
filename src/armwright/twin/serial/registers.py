"""Registers of bus servos: one table for each model, from the files in `models/`.

A row is: address, bytes, name, access, value at power-up (of EEPROM: from the factory), lowest, highest value, unit of one count
and form. A dash stands for none. Forms: `u` unsigned, `s` two's complement, `m11` sign and magnitude with the sign in bit 11.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

from armwright.errors import BusError, check_known
from armwright.twin.serial.frames import FRAMINGS, Framing

FOLDER = Path(__file__).parent / "models"


@dataclass(frozen=True)
class Register:
    """A row of the table.

    Attributes:
        address, size: [bytes].   name: the same for every maker where the meaning is.   writable: from the bus.
        default: value at power-up, None if measured.   low, high: what may be written, None if not limited.
        unit: of one count.   form: "u", "s" or "m" with the sign's bit.
    """

    address: int
    size: int
    name: str
    writable: bool
    default: int | None
    low: int | None
    high: int | None
    unit: str
    form: str

    @cached_property
    def end(self) -> int:
        """Address behind the register."""
        return self.address + self.size

    @cached_property
    def largest(self) -> int:
        """Largest magnitude that the bytes can hold."""
        bits = {"u": 8 * self.size, "s": 8 * self.size - 1}.get(self.form) or int(self.form[1:])
        return (1 << bits) - 1

    @cached_property
    def sign(self) -> int:
        """The bit that makes a value negative; 0 without one."""
        return {"u": 0, "s": 1 << 8 * self.size - 1}.get(self.form, self.largest + 1)

    def encode(self, value: int) -> bytes:
        """The register's bytes for a value, which is limited to what they can hold."""
        value = max(min(int(value), self.largest), 0 if self.form == "u" else -self.largest)
        if value < 0:
            value = (1 << 8 * self.size) + value if self.form == "s" else -value | (self.largest + 1)
        return value.to_bytes(self.size, "little")

    def decode(self, data: bytes | bytearray) -> int:
        """The value of the register's bytes."""
        raw = int.from_bytes(data, "little")
        if not raw & self.sign:
            return raw
        return raw - 2 * self.sign if self.form == "s" else -(raw & self.largest)

    def allows(self, value: int) -> bool:
        """True if the value lies within the table's range."""
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)


@dataclass(frozen=True)
class ServoModel:
    """A model of servos: its table and what the table's codes mean.

    Attributes:
        name: of the model.   framing: of its protocol.   eeprom: first address behind the EEPROM.
        bauds: [bit/s] by code.   counts: of one turn.   units: size of one count of speed [counts/s], acceleration
            [counts/s²], current [A] and duty [1], by name.   registers: in the order of addresses.   source: of the table.
    """

    name: str
    framing: Framing
    eeprom: int
    bauds: tuple[int, ...]
    counts: int
    units: dict[str, float]
    registers: tuple[Register, ...]
    source: str

    @cached_property
    def by_name(self) -> dict[str, Register]:
        """Registers by name."""
        return {register.name: register for register in self.registers}

    @cached_property
    def size(self) -> int:
        """Number of bytes of the table."""
        return self.registers[-1].end

    def touched(self, address: int, count: int) -> list[Register]:
        """Registers that have a byte among `count` ones from an address on."""
        return [each for each in self.registers if each.address < address + count and address < each.end]


def model_names() -> list[str]:
    """Models that there is a table for."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


@cache
def servo_model(name: str) -> ServoModel:
    """The model of that name, such as "sts3215".

    Raises:
        BusError: no such model; names those that there are.
    """
    check_known(BusError, name, model_names(), place="servo")
    table = tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))
    rows = [line.split() for line in table["registers"].splitlines() if line.strip()]
    registers = tuple(_register(row) for row in rows)
    framing, bauds = FRAMINGS[table["protocol"]], tuple(table["bauds"])
    return ServoModel(
        name, framing, table["eeprom"], bauds, table["counts"], table["units"], registers, table["source"]
    )


def _register(row: list[str]) -> Register:
    address, size, name, access, default, low, high, unit, form = row
    first, lowest, highest = (None if text == "-" else int(text) for text in (default, low, high))
    return Register(int(address), int(size), name, access == "rw", first, lowest, highest, unit, form)

"""The library of servos, `robots/modules/servos.library.toml`: a joint of a robot file takes an entry by `servo = "NAME"`.

Motor constants are published at the output shaft, behind the gear. With the gear ratio n the motor of a robot file is

    rotor_inertia = armature / n²,   torque_constant = Kt / n,   resistance as it is.

Friction and firmware are those of the output shaft, which is the joint.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib import resources
from typing import Any, Literal

from pydantic import Field, model_validator

from armwright.description.consistency import check_sources, check_unique
from armwright.description.drive import Command, RotaryFriction, RotaryLimits
from armwright.description.firmware import FirmwareRecord
from armwright.description.paths import path_name
from armwright.description.toml_file import read_record
from armwright.errors import DescriptionError, check_known
from armwright.quantity import NotNegative, NotZero, Positive, Quantity, Record, Source, optional
from armwright.validation import Invalid

LIBRARY = "servos.library.toml"
PARTS = ("motor", "friction", "limits", "firmware")  # tables of a joint that an entry fills in


class Shaft(Record):
    """Motor constants of a servo at its output shaft, behind the gear."""

    source: str | None = None
    gear_ratio: NotZero = Field(description="n, turns of the motor for one of the shaft.")
    armature_kg_m2: NotNegative = Field(description="Inertia of rotor and gear, n² times the rotor's.")
    torque_constant_n_m_per_a: Positive = Field(description="Kt, n times the motor's.")
    resistance_ohm: Positive = Field(description="R of the armature.")


class DataSheet(Record):
    """Values that the maker states, for comparison: the simulation does not use them."""

    source: str | None = None
    voltage_v: Positive = Field(description="Supply at which the others hold.")
    stall_torque_n_m: Positive = Field(description="At the output shaft.")
    no_load_speed_rad_per_s: Positive = Field(description="Of the output shaft.")
    stall_current_a: Positive | None = optional("Absent: not stated in a document that was read.")


class BusTiming(Record):
    """Serial bus of a new servo."""

    source: str | None = None
    protocol: Literal["feetech", "dynamixel-1", "dynamixel-2"] = Field(description="Its frames.")
    baud_bit_per_s: Positive = Field(description="Bits per second, with which it comes from the factory.")
    return_delay_s: NotNegative = Field(description="From the end of an instruction to the answer.")


class Servo(Record):
    """A servo: motor and gear, friction, limits, firmware with factory settings, and its bus."""

    source: str | None = optional("Source of every number of the servo that names none.")
    name: str = Field(min_length=1, description='`servo = "NAME"` in a joint.')
    title: str = Field(min_length=1, description="Maker and model.")
    notes: str = Field(min_length=1, description="What is doubtful, and what is not modelled.")
    command: Command = Field(description="Command of a joint, unless its file has one.")
    shaft: Shaft = Field(description="Motor constants at the output shaft.")
    friction: RotaryFriction = Field(description="At the output shaft.")
    limits: RotaryLimits = Field(description="Of supply, current and planned motions.")
    firmware: FirmwareRecord | None = optional("Factory settings; absent: none was published.")
    play_rad: NotNegative | None = optional("Play of the gear, from flank to flank; absent: unknown. Not simulated.")
    data_sheet: DataSheet | None = optional("Absent: no data sheet was found that can be cited.")
    disagrees: tuple[Literal["stall_torque_n_m", "no_load_speed_rad_per_s"], ...] = Field(
        default=(), description="Values of the data sheet that the motor and its friction do not reach or pass by far."
    )
    bus: BusTiming | None = optional("Absent: unknown.")

    @model_validator(mode="after")
    def _firmware_fits(self) -> Servo:
        if (self.command == "position") != (self.firmware is not None):
            raise Invalid('goes with firmware, and only command = "position" does', place="command", value=self.command)
        return self

    def motor(self) -> dict[str, dict[str, Any]]:
        """`[joints.motor]` of the servo: constants of its shaft, referred to the motor."""
        shaft, n = _entries(self.shaft, self.source), float(self.shaft.gear_ratio)
        return {
            "gear_ratio": shaft["gear_ratio"],
            "rotor_inertia_kg_m2": _divided(shaft["armature_kg_m2"], n**2),
            "torque_constant_n_m_per_a": _divided(shaft["torque_constant_n_m_per_a"], n),
            "resistance_ohm": shaft["resistance_ohm"],
        }

    def tables(self) -> dict[str, dict[str, Any]]:
        """Tables of a joint in a robot file, each number with its source: motor, friction, limits, firmware."""
        parts = {"friction": self.friction, "limits": self.limits, "firmware": self.firmware}
        tables = {name: _entries(part, self.source) for name, part in parts.items() if part is not None}
        return {"motor": self.motor(), **tables}


class ServoLibrary(Record):
    """Servos, each number with its source."""

    title: str = Field(min_length=1, description="One line for lists.")
    sources: dict[str, Source] = Field(description="[sources.KEY]: sources of numbers.")
    servos: tuple[Servo, ...] = Field(min_length=1, description="One table a servo.")

    @model_validator(mode="after")
    def _consistent(self) -> ServoLibrary:
        check_unique("servos", [servo.name for servo in self.servos])
        check_sources(self)
        return self


@cache
def servo_library() -> ServoLibrary:
    """The servos that come with Armwright, and the sources of their numbers."""
    with resources.as_file(resources.files("armwright.robots") / "modules" / LIBRARY) as path:
        return read_record(path, ServoLibrary)


def servos() -> dict[str, Servo]:
    """The servos that come with Armwright, as a joint of a robot file names them: `servo = "sts3215-7.4v"`.

    Returns:
        servos: motor constants at the output shaft, friction, limits, firmware with factory settings, bus and data sheet of
            each, by name.
    Example:
        >>> servo = aw.robotfiles.servos()["sts3215-12v"]
        >>> print(servo.title)
        Feetech STS3215-C018, 12 V, 1:345
    """
    return {servo.name: servo for servo in servo_library().servos}


def with_servos(document: dict[str, Any], file: Any) -> dict[str, Any]:
    """A document in which the library's tables, with their sources, stand for `servo = "NAME"` in its joints.

    Numbers of the document take the place of the library's, key by key; a friction with a `law` takes the place of all.

    Args:
        document: of a robot file, whose joints are a list, or of a drive file, where they go by name.   file: for errors.
    Raises:
        DescriptionError: no such servo, a joint that does not turn, or a source with a key of the library's.
    """
    joints = document.get("joints")
    rows = list(joints.items() if isinstance(joints, dict) else enumerate(joints) if isinstance(joints, list) else ())
    for k, (key, joint) in enumerate(rows):
        if not isinstance(joint, dict) or "servo" not in joint:
            continue
        place = f"joints.{path_name(key)}" if isinstance(key, str) else f"joint {joint.get('name')!r}"
        servo = _servo_of(joint, f"{place} servo" if place.endswith("'") else f"{place}.servo", file)
        made = _filled_in(joint, servo, joint.get("command", document.get("command", servo.command)))
        rows[k] = (key, made)
        document = {**document, "sources": _with_sources(document.get("sources", {}), made, file)}
    if isinstance(joints, (dict, list)):
        document = {**document, "joints": dict(rows) if isinstance(joints, dict) else [joint for _, joint in rows]}
    return document


def _servo_of(joint: dict[str, Any], place: str, file: Any) -> Servo:
    known, name, kind = servos(), joint["servo"], joint.get("type", "revolute")
    check_known(DescriptionError, name, known, "no such servo", place=place, file=file)
    if kind != "revolute":
        raise DescriptionError(
            f"on a joint of type {kind!r}", place=place, value=name, expected='"revolute"', file=file
        )
    return known[name]


def _filled_in(joint: dict[str, Any], servo: Servo, command: Any) -> dict[str, Any]:
    """The joint's table with the servo's below its own."""
    made = {key: value for key, value in joint.items() if key != "servo"} | {"command": command}
    for part, table in servo.tables().items():
        own = joint.get(part, {})
        if part == "firmware" and command != "position" and part not in joint:
            continue
        if isinstance(own, dict) and not (part == "friction" and "law" in own):
            made[part] = {**table, **own} if own else {"source": servo.source, **table}
    return made


def _with_sources(sources: Any, joint: dict[str, Any], file: Any) -> Any:
    """The document's sources, and those of the library that the joint's numbers name."""
    if not isinstance(sources, dict):
        return sources  # refused for that
    library, found = servo_library().sources, dict(sources)
    for key in dict.fromkeys(name for name in _named_sources(joint) if name in library):
        text = library[key].model_dump(exclude_none=True)
        if found.setdefault(key, text) != text:
            expected = "another key: this one is a source of the library of servos"
            raise DescriptionError("means something else", place=f"sources.{key}", expected=expected, file=file)
    return found


def _named_sources(joint: dict[str, Any]) -> Iterator[str]:
    for part in PARTS:
        for entry in joint[part].values() if isinstance(joint.get(part), dict) else ():
            if isinstance(entry, dict) and isinstance(entry.get("source"), str):
                yield entry["source"]


def _entries(table: Record, source: str | None) -> dict[str, Any]:
    """A table as a robot file has it, each number with a source of its own.

    Args:
        table: of the library.   source: of numbers for which neither they nor the table name one.
    """
    fields = {
        name: getattr(table, name) for name in type(table).model_fields if name in table.model_fields_set - {"source"}
    }
    around = getattr(table, "source", None) or source
    return {
        key: it.model_dump(exclude_none=True) | {"source": it.source or around} if isinstance(it, Quantity) else it
        for key, it in fields.items()
    }


def _divided(entry: dict[str, Any], ratio: float) -> dict[str, Any]:
    """An entry of a file with its value and standard deviation divided by a ratio."""
    return {key: it / ratio if key in ("value", "std") else it for key, it in entry.items()}

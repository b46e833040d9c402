"""Stored calibration of an arm's bus servos: ids, models, firmware, offsets and position limits, by joint, as a JSON file.

A joint has the keys of LeRobot's calibration files, and a file of LeRobot is read as it is:

    {"elbow_flex": {"id": 3, "drive_mode": 0, "homing_offset": -1021, "range_min": 830, "range_max": 3061}}

Files that `armwright capture --calibrate` writes have `model_number` and `firmware` too, and, where the user said them, the
count `zero` where the joint is at 0 and `reversed`, true for a joint that turns the other way than its encoder counts.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from armwright.errors import BusError, Problem
from armwright.output import write_whole
from armwright.quantity import Record
from armwright.reading import read_file
from armwright.twin.serial.registers import ServoModel
from armwright.validation import validated

WHAT, LARGEST = "a calibration, JSON", 1 << 20  # bytes of a file
# Key of a joint → the registers that hold it, of which a model has some; `firmware` is a version, major before minor.
STORED_IN = {
    "model_number": ("model_number",),
    "firmware": ("firmware_major", "firmware_minor", "firmware_version"),
    "drive_mode": ("drive_mode",),
    "homing_offset": ("homing_offset",),
    "range_min": ("min_position_limit",),
    "range_max": ("max_position_limit",),
}
Whole = Annotated[int, Field(strict=True)]


class StoredServo(Record):
    """A servo of the file. Counts are those that the servo shows, with its offset."""

    id: Annotated[Whole, Field(ge=0, le=253)]
    drive_mode: Whole = 0  # 0 of a model that has no such register
    homing_offset: Whole
    range_min: Whole
    range_max: Whole
    model_number: Whole | None = None
    firmware: str | None = None
    zero: float | None = None
    reversed: bool | None = None


@dataclass(frozen=True)
class Calibration:
    """Calibration of an arm's servos.

    Attributes:
        joints: by name.   file: that it was read from; "" of one that was read from the servos.
    """

    joints: Mapping[str, StoredServo]
    file: str = ""

    def check(self, found: Calibration) -> None:
        """Compares with what servos show. A key that the file does not have is not compared.

        Args:
            found: in the servos.
        Raises:
            BusError: names every difference: joint, register, stored and found value.
        """
        problems = []
        for name, servo in found.joints.items():
            stored = self.joints[name]
            for key in STORED_IN:
                ours, theirs = getattr(stored, key), getattr(servo, key)
                if ours is not None and ours != theirs:
                    place = f"{key} of joint {name!r}, servo {servo.id}"
                    expected = f"{ours}, as stored in {self.file}"
                    problems.append(Problem("differs from the calibration", place, theirs, expected))
        if problems:
            raise BusError.of(*problems)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes the file.

        Raises:
            OutputError: it cannot be written.
        """
        table = {name: servo.model_dump(exclude_none=True) for name, servo in self.joints.items()}
        write_whole(path, json.dumps(table, indent=2) + "\n", (".json",))


def read_calibration(path: str | os.PathLike[str]) -> Calibration:
    """Reads a calibration, as `Calibration.write` or LeRobot wrote it.

    Raises:
        BusError: no such file, no JSON, or a joint with keys that are missing, unknown or wrong.
    """
    text = read_file(path, WHAT, BusError, LARGEST)
    try:
        table: Any = json.loads(text)
    except ValueError as error:  # also of bytes that are not UTF-8
        raise BusError(f"no JSON: {error}", file=path, expected=WHAT) from None
    if not isinstance(table, dict) or not table:
        raise BusError(file=path, value=table, expected="a table of joints, by name")
    joints = {
        name: validated(StoredServo, servo, place=f"joint {name!r}", file=path, error=BusError)
        for name, servo in table.items()
    }
    numbers = [servo.id for servo in joints.values()]
    for name, servo in joints.items():
        if numbers.count(servo.id) > 1:
            raise BusError("of several joints", place=f"joint {name!r} id", value=servo.id, file=path)
        if servo.range_min >= servo.range_max:
            expected = f"above range_min = {servo.range_min}"
            raise BusError(place=f"joint {name!r} range_max", value=servo.range_max, expected=expected, file=path)
    return Calibration(joints, os.fsdecode(path))


def stored_servo(model: ServoModel, number: int, values: Mapping[str, int], **said: Any) -> StoredServo:
    """A servo of a calibration.

    Args:
        model: of the servo.   number: its id.   values: of `registers_of(model)`, by name.
        said: `zero` and `reversed`, of which the servo knows nothing.
    """
    found: dict[str, Any] = {}
    for key, names in STORED_IN.items():
        held = [values[name] for name in names if name in model.by_name]
        if held:
            found[key] = ".".join(map(str, held)) if key == "firmware" else held[0]
    return StoredServo(id=number, **found, **said)


def registers_of(model: ServoModel) -> list[str]:
    """Names of the registers that a calibration holds."""
    return [name for names in STORED_IN.values() for name in names if name in model.by_name]

"""Lengths and angles of joints and frames that look like another unit's: millimetres for metres, degrees for radians."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator
from math import pi
from typing import Any

import numpy as np

from armwright.description.robot import FixedJoint, PrismaticJoint, RobotDescription

LONGEST = 10.0  # [m] from one joint to the next
WIDEST = 4 * pi  # [rad]: an angle between two axes says no more beyond a turn, and few joints have four turns
DEGREES = 720.0  # a limit beyond it is how files write that there is none


def unit_doubts(robot: RobotDescription, told: Collection[str] = ()) -> list[str]:
    """Sentences about joints and frames whose numbers are too large for their units.

    Args:
        robot: the description.   told: links of which it is said already that they are too long.
    """
    found: dict[tuple[str, str], list[str]] = defaultdict(list)
    for joint in robot.joints:
        place = joint.frame or joint.dh or joint.modified_dh
        for sentence in _of_place(place, long=not {joint.parent, joint.child} & set(told)):
            found["joint", sentence].append(joint.name)
        if not isinstance(joint, FixedJoint):
            for sentence in _of_limits(joint):
                found["joint", sentence].append(joint.name)
    for frame in robot.frames:
        for sentence in _of_place(frame, long=frame.link not in told):
            found["frame", sentence].append(frame.name)
    return [f"{kind}{'s' * (len(names) > 1)} {', '.join(names)}: {why}" for (kind, why), names in found.items()]


def _of_place(place: Any, *, long: bool) -> Iterator[str]:
    """A frame or a Denavit-Hartenberg row."""
    for key in type(place).model_fields:
        if not key.endswith(("_m", "_rad")):
            continue
        values = np.atleast_1d(np.array(getattr(place, key)))
        if key.endswith("_m") and long and np.linalg.norm(values) > LONGEST:
            yield f"{key} = {_shown(values)}, {np.linalg.norm(values):.4g} m away: millimetres for metres?"
        if key.endswith("_rad") and np.abs(values).max() > WIDEST:
            yield f"{key} = {_shown(values)}, more than two turns: degrees for radians?"


def _of_limits(joint: Any) -> Iterator[str]:
    """Limits of position. Those in degrees are whole or half ones; a joint of many turns has others."""
    slides = isinstance(joint, PrismaticJoint)
    limits = joint.limits.position_m if slides else joint.limits.position_rad
    if limits is None:
        return
    values = np.array(limits)
    far = values[np.abs(values) > (LONGEST if slides else WIDEST)]
    if slides and len(far) and np.abs(far).max() <= 1000 * LONGEST:
        yield f"position_m = {_shown(values)}: millimetres for metres?"
    if not slides and len(far) and np.all(np.abs(far) <= DEGREES) and not np.any(np.mod(2 * far, 1)):
        yield f"position_rad = {_shown(values)}: degrees for radians?"


def _shown(values: np.ndarray) -> str:
    numbers = [f"{value:g}" for value in values]
    return numbers[0] if len(numbers) == 1 else f"[{', '.join(numbers)}]"

"""Limits of joints for motions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.entry import AnyArm, as_arm
from armwright.errors import ScenarioError, check_known
from armwright.model import Model
from armwright.model.joint_signals import UNITS

QUANTITIES = {  # and the signal whose unit they have
    "position": "q", "velocity": "qd", "acceleration": "qdd", "jerk": "jerk", "torque": "tau", "voltage": "voltage",
}  # fmt: skip
UNIT = UNITS | {"jerk": ("rad/s³", "m/s³")}
SMALLEST = 1e-30  # of a limit: the durations that follow, and their fifth powers, stay within the range of floats
LARGEST = 1.0 / SMALLEST  # of a limit that is known


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of every joint; infinite where unknown.

    Attributes:
        position: (n, 2) [rad | m], lower and upper.
        velocity, acceleration, jerk: (n,) largest magnitudes [rad/s | m/s], …/s², …/s³.
        torque: (n,) of the motors, referred to the joints [N m | N].   voltage: (n,) of the motors [V].
        names: (n,) of the joints.   prismatic: (n,) bool.
    """

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    torque: np.ndarray
    voltage: np.ndarray
    names: tuple[str, ...]
    prismatic: tuple[bool, ...]

    @classmethod
    def of(cls, arm: AnyArm, **overrides: Any) -> MotionLimits:
        """Limits of the record, or given ones in their place.

        A limit of the current is one of the torque as well, also beside a finite one that is given.

        Args:
            arm: the model.
            overrides: by quantity one number for all joints, (n,) numbers, or a mapping by joint whose others stay the
                record's; `position` one number to either side, (n, 2), or a mapping to such. None: the record's.
        Raises:
            ScenarioError: an unknown quantity or joint, a limit that is no number above 0, bounds that do not increase.
        """
        arm = as_arm(arm)
        limits = [body.limits for body in arm.coordinates]
        record = {name: np.array([getattr(each, name, np.inf) for each in limits], dtype=float) for name in QUANTITIES}
        record["torque"] = np.minimum(record["torque"], current_torques(arm))
        prismatic = tuple(body.kind.units.linear for body in arm.coordinates)
        found = cls(**record, names=tuple(arm.names), prismatic=prismatic)
        found = found.replace(**overrides)
        given = np.isfinite(found.torque)  # infinite: no limit of torque at all
        return replace(found, torque=np.where(given, np.minimum(found.torque, current_torques(arm)), np.inf))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.names)

    @property
    def unlimited(self) -> np.ndarray:
        """(n,) True for joints without limits of velocity, acceleration and jerk."""
        return np.isinf(self.velocity) & np.isinf(self.acceleration) & np.isinf(self.jerk)

    def replace(self, **overrides: Any) -> MotionLimits:
        """The limits with some replaced, as in `of`."""
        changed = {}
        for name, value in overrides.items():
            check_known(ScenarioError, name, QUANTITIES, "no quantity that has a limit", place="limits")
            if value is not None:
                changed[name] = self.read(f"limits.{name}", name, value)
        return replace(self, **changed)

    def read(self, place: str, quantity: str, value: Any) -> np.ndarray:
        """(n,) or (n, 2) limits of a quantity from what a user wrote at `place`; a mapping leaves other joints as they are here.

        Raises:
            ScenarioError: names the place, its value and what was expected.
        """
        record = getattr(self, quantity)
        if isinstance(value, Mapping):
            limits = record.copy()
            for name, each in value.items():
                check_known(ScenarioError, name, self.names, "no joint of the arm", place=place)
                limits[self.names.index(name)] = checked_limit(f"{place}[{name!r}]", each, quantity, 1)[0]
            return limits
        return checked_limit(place, value, quantity, self.n)

    def unit(self, quantity: str, joint: int) -> str:
        """Unit of a joint's limit."""
        return UNIT[QUANTITIES[quantity]][self.prismatic[joint]]

    def required(self, *quantities: str, moving: Any = None) -> MotionLimits:
        """The limits, if every moving joint has them; see `Raises`.

        Args:
            quantities: that a planner needs.   moving: (n,) bool, joints that need them; None: all.
        Raises:
            ScenarioError: names the quantity and the joints without it.
        """
        needed = np.ones(self.n, dtype=bool) if moving is None else np.asarray(moving)
        for quantity in quantities:
            free = [
                name for k, name in enumerate(self.names) if needed[k] and not np.isfinite(getattr(self, quantity)[k])
            ]
            if free:
                expected = "one in the record, or one of your own"
                what = f"no {quantity} limit of {', '.join(free)}"
                raise ScenarioError(what, place=f"limits.{quantity}", expected=expected)
        return self

    def check_position(self, place: str, q: np.ndarray) -> None:
        """Refuses positions outside the limits.

        Args:
            place: of them, for errors.   q: (…, n) [rad | m].
        Raises:
            ScenarioError: names the joint and how far it is outside, and asks where the number may be one of degrees.
        """
        rows = np.asarray(q, dtype=float).reshape(-1, self.n)
        beyond = np.maximum(self.position[:, 0] - rows, rows - self.position[:, 1])
        row, joint = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
        if beyond[row, joint] > 1e-9 * max(1.0, abs(rows[row, joint])):
            low, high = self.position[joint]
            at = f"{place}[{row}]" if np.ndim(q) > 1 else place
            unit = self.unit("position", int(joint))
            value, doubt = float(rows[row, joint]), ""
            if not self.prismatic[joint] and abs(value) > 2.0 * np.pi and low <= np.radians(value) <= high:
                doubt = f"; this looks like degrees: {value:g}° is {np.radians(value):.6g} rad"
            raise ScenarioError(
                f"{beyond[row, joint]:.4g} {unit} outside its limits{doubt}",
                place=f"{at} of {self.names[joint]}", value=value, expected=f"{low:.6g} … {high:.6g} {unit}",
            )  # fmt: skip

    def doubts_of_degrees(self, place: str, q: np.ndarray) -> list[str]:
        """Notes on angles beyond a turn that are whole degrees, of joints whose limits of position are not known.

        Args:
            place: of them.   q: (…, n) [rad | m].
        """
        rows = np.asarray(q, dtype=float).reshape(-1, self.n)
        is_free = np.isinf(self.position).all(axis=1) & ~np.array(self.prismatic)
        doubtful = (np.abs(rows) > 2.0 * np.pi) & (np.abs(rows) <= 360.0) & (rows == np.round(rows))
        found = np.flatnonzero(doubtful.any(axis=0) & is_free)
        values = [rows[doubtful[:, k], k][0] for k in found]
        return [
            f"{place} of {self.names[k]}: {value:g} rad looks like degrees; {value:g}° is {np.radians(value):.6g} rad"
            for k, value in zip(found, values, strict=True)
        ]


def current_torques(arm: Model) -> np.ndarray:
    """(n,) torque of the largest current of every joint, referred to it [N m | N]; infinite where the record has none."""
    torques = []
    for body in arm.coordinates:
        drive, current = body.drive, float(body.limits.current)
        known = drive.torque_constant is not None and np.isfinite(current)
        torques.append(
            abs(float(drive.gear_ratio) * float(drive.torque_constant or 0.0)) * current if known else np.inf
        )
    return np.array(torques)


def checked_limit(place: str, value: Any, quantity: str, n: int) -> np.ndarray:
    """(n,) limits of a quantity, or (n, 2) of position, from what a user wrote at `place`; see `MotionLimits.of`.

    Raises:
        ScenarioError: names the place, its value and what was expected.
    """
    values = scalar.numbers_or_nan(value)
    if quantity == "position":
        bounds = np.stack([-values, values], axis=-1) if values.ndim == 0 else values
        if bounds.shape not in ((2,), (n, 2)) or not ((bounds[..., 0] < bounds[..., 1]).all() and _is_in_range(bounds)):
            expected = f"a number to either side, or a lower and an upper bound for each of {n} joints"
            expected += "" if _is_in_range(bounds) else f", {LARGEST:g} at most"
            raise ScenarioError(place=place, value=value, expected=expected)
        return np.broadcast_to(bounds, (n, 2)).astype(float)
    if values.shape not in ((), (n,)) or not ((values >= SMALLEST).all() and _is_in_range(values)):
        least = f"of {SMALLEST:g} or more" if ((values > 0.0) & (values < SMALLEST)).any() else "above 0"
        least += "" if _is_in_range(values) else f" and of {LARGEST:g} at most"
        least += f" [{' | '.join(dict.fromkeys(UNIT[QUANTITIES[quantity]]))}]"
        expected = f"a number {least}" + (f", or one for each of {n} joints" if n > 1 else "")
        raise ScenarioError(place=place, value=value, expected=expected)
    return np.broadcast_to(values, (n,)).astype(float)


def _is_in_range(values: np.ndarray) -> bool:
    return bool((~np.isfinite(values) | (np.abs(values) <= LARGEST)).all())

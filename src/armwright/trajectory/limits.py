"""Limits that a motion has to keep, and how much of them a motion uses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.kernels.compiled import compile_arm
from armwright.model import Model
from armwright.model.joint_signals import UNITS
from armwright.simulation.inputs.payload import Payload
from armwright.trajectory.motion import Motion
from armwright.trajectory.piecewise import PiecewisePolynomial

QUANTITIES = {  # and the signal whose unit they have
    "position": "q", "velocity": "qd", "acceleration": "qdd", "jerk": "jerk", "torque": "tau", "voltage": "voltage",
}  # fmt: skip
UNIT = UNITS | {"jerk": ("rad/s³", "m/s³")}
SAMPLES = 2000  # of a report, at least, and …
IN_A_PIECE = 10  # … between two breaks


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
    def of(cls, arm: Model, **overrides: Any) -> MotionLimits:
        """Limits of the record, or others in their place.

        A limit of the current is one of the torque as well.

        Args:
            arm: the model.
            overrides: by quantity one number for all joints, (n,) numbers, or a mapping by joint whose others stay the
                record's; `position` one number to either side, (n, 2), or a mapping to such. None: the record's.
        Raises:
            ScenarioError: an unknown quantity or joint, a limit that is no number above 0, bounds that do not increase.
        """
        limits = [body.limits for body in arm.coordinates]
        record = {name: np.array([getattr(each, name, np.inf) for each in limits], dtype=float) for name in QUANTITIES}
        record["torque"] = np.minimum(record["torque"], _current_torques(arm))
        prismatic = tuple(body.kind == "prismatic" for body in arm.coordinates)
        found = cls(**record, names=tuple(arm.names), prismatic=prismatic)
        return found.replace(**overrides)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.names)

    def replace(self, **overrides: Any) -> MotionLimits:
        """The same limits but for those that are given, as in `of`."""
        changed = {}
        for name, value in overrides.items():
            if name not in QUANTITIES:
                raise ScenarioError("no quantity that has a limit", place="limits", value=name, choices=QUANTITIES)
            if value is not None:
                changed[name] = self._overridden(name, value)
        return replace(self, **changed)

    def _overridden(self, quantity: str, value: Any) -> np.ndarray:
        """(n,) or (n, 2) limits of a quantity from what a user wrote."""
        record = getattr(self, quantity)
        if isinstance(value, Mapping):
            limits = record.copy()
            for name, each in value.items():
                if name not in self.names:
                    raise ScenarioError(
                        "no joint of the arm", place=f"limits.{quantity}", value=name, choices=self.names
                    )
                limits[self.names.index(name)] = _checked(f"limits.{quantity}[{name!r}]", each, quantity, 1)[0]
            return limits
        return _checked(f"limits.{quantity}", value, quantity, self.n)

    def unit(self, quantity: str, joint: int) -> str:
        """Unit of a joint's limit."""
        return UNIT[QUANTITIES[quantity]][self.prismatic[joint]]

    def required(self, *quantities: str, moving: Any = None) -> MotionLimits:
        """The limits themselves, if every joint that moves has those; see `Raises`.

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
                expected = "one in the record, or as an argument"
                what = f"no {quantity} limit of {', '.join(free)}"
                raise ScenarioError(what, place=f"limits.{quantity}", expected=expected)
        return self

    def check_position(self, place: str, q: np.ndarray) -> None:
        """Refuses positions outside the limits.

        Args:
            place: of them, for errors.   q: (…, n) [rad | m].
        Raises:
            ScenarioError: names the joint and how far it is outside.
        """
        rows = np.asarray(q, dtype=float).reshape(-1, self.n)
        beyond = np.maximum(self.position[:, 0] - rows, rows - self.position[:, 1])
        row, joint = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
        if beyond[row, joint] > 1e-9 * max(1.0, abs(rows[row, joint])):
            low, high = self.position[joint]
            at = f"{place}[{row}]" if np.ndim(q) > 1 else place
            unit = self.unit("position", int(joint))
            raise ScenarioError(
                f"{beyond[row, joint]:.4g} {unit} outside its limits",
                place=f"{at} of {self.names[joint]}", value=float(rows[row, joint]), expected=f"{low:.6g} … {high:.6g} {unit}",
            )  # fmt: skip


def _current_torques(arm: Model) -> list[float]:
    """Torque of the largest current of every joint, referred to it [N m | N]; infinite where the record has none."""
    torques = []
    for body in arm.coordinates:
        drive, current = body.drive, float(body.limits.current)
        known = drive.torque_constant is not None and np.isfinite(current)
        torques.append(
            abs(float(drive.gear_ratio) * float(drive.torque_constant or 0.0)) * current if known else np.inf
        )
    return torques


def _checked(place: str, value: Any, quantity: str, n: int) -> np.ndarray:
    try:
        values = scalar.real_numbers(value)
    except ValueError:
        values = np.full(1, np.nan)
    if quantity == "position":
        bounds = np.stack([-values, values], axis=-1) if values.ndim == 0 else values
        if bounds.shape not in ((2,), (n, 2)) or not (bounds[..., 0] < bounds[..., 1]).all():
            expected = f"a number to either side, or a lower and an upper bound for each of {n} joints"
            raise ScenarioError(place=place, value=value, expected=expected)
        return np.broadcast_to(bounds, (n, 2)).astype(float)
    if values.shape not in ((), (n,)) or not (values > 0.0).all():
        expected = "a number above 0" + (f", or one for each of {n} joints" if n > 1 else "")
        raise ScenarioError(place=place, value=value, expected=expected)
    return np.broadcast_to(values, (n,)).astype(float)


@dataclass(frozen=True, eq=False)
class LimitsReport:
    """How much of its limits a motion uses; `str` gives the table.

    Attributes:
        limits: that were asked.
        lowest, highest: by quantity (n,) extreme values.   share: by quantity (n,) the largest part of the limit that is used,
            1: all of it; of positions the part of the way from the middle of the range to its ends; NaN without a limit.
        times: by quantity (n,) [s] of the largest share.
    """

    limits: MotionLimits
    lowest: dict[str, np.ndarray]
    highest: dict[str, np.ndarray]
    share: dict[str, np.ndarray]
    times: dict[str, np.ndarray]

    @property
    def largest(self) -> float:
        """The largest share of all joints and quantities; 0 where nothing has a limit."""
        return float(np.nanmax([0.0, *np.concatenate(list(self.share.values()))]))

    @property
    def kept(self) -> bool:
        """True if no limit is exceeded by more than 1e-6 of it."""
        return self.largest <= 1.0 + 1e-6

    def worst(self, quantity: str, joint: int) -> float:
        """The value that uses most of the limit; without one the largest."""
        low, high = self.lowest[quantity][joint], self.highest[quantity][joint]
        bounds = getattr(self.limits, quantity)[joint]
        centre = float(np.mean(bounds)) if quantity == "position" and np.isfinite(bounds).all() else 0.0
        return float(high if abs(high - centre) >= abs(low - centre) else low)

    def excesses(self) -> list[str]:
        """Sentences, one for each limit that is exceeded."""
        said = []
        for quantity, share in self.share.items():
            for k in np.flatnonzero(share > 1.0 + 1e-6):
                value, unit = self.worst(quantity, int(k)), self.limits.unit(quantity, int(k))
                name, at = self.limits.names[k], self.times[quantity][k]
                said.append(f"{name}: {quantity} {value:.4g} {unit} at {at:.4g} s, {share[k]:.1%} of its limit")
        return said

    def __str__(self) -> str:
        rows = [["joint", *self.share]]
        for k, name in enumerate(self.limits.names):
            cells = [name]
            for quantity, share in self.share.items():
                part = "no limit" if np.isnan(share[k]) else f"{share[k]:.1%}"
                cells.append(f"{self.worst(quantity, k):.3g} {self.limits.unit(quantity, k)} {part:>8}")
            rows.append(cells)
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = [
            "   ".join(
                [f"{row[0]:{widths[0]}}", *(f"{cell:>{w}}" for cell, w in zip(row[1:], widths[1:], strict=True))]
            )
            for row in rows
        ]
        return "\n".join(lines)


def limits_report(
    arm: Model,
    motion: Motion,
    limits: MotionLimits | None = None,
    *,
    payload: Payload | Sequence[Payload] | None = None,
    wrench: Any = None,
    samples: int = IN_A_PIECE,
) -> LimitsReport:
    """Largest use of every limit by a motion, on a dense grid between its breaks; exact extrema of piecewise polynomials.

    Torques and voltages are those of the compiled inverse dynamics and `motor_voltage`, where the record can tell them.

    Args:
        arm: the model.   motion: of its joints, with an end.   limits: None: the record's.
        payload: bodies in the hand, each from its time on.   wrench: (6,) [N, N m] on the tip, in base axes.
        samples: grid points between two breaks, at least.
    Returns:
        report: lowest and highest values, shares of limits and their times, by quantity and joint.
    Raises:
        ScenarioError: a motion of other joints, or one that does not end.
    """
    limits = MotionLimits.of(arm) if limits is None else limits
    if motion.n != arm.n or limits.n != arm.n:
        what = f"a motion of {motion.n} joints with limits of {limits.n}"
        raise ScenarioError(what, place=arm.name, expected=f"{arm.n} of both")
    t = dense_times(motion, samples)
    q, qd, qdd = motion.at(t)
    values = {"position": q, "velocity": qd, "acceleration": qdd, "jerk": _jerk(t, qdd)}
    values |= efforts(arm, t, q, qd, qdd, payload, wrench)
    found: list[dict[str, np.ndarray]] = [{}, {}, {}, {}]
    for quantity, rows in values.items():
        used = _shares(limits, quantity, rows)
        first = np.argmax(np.where(np.isnan(used), np.abs(rows), used), axis=0)
        low, high, at = rows.min(axis=0), rows.max(axis=0), t[first]
        order = {"position": 0, "velocity": 1, "acceleration": 2, "jerk": 3}.get(quantity)
        polynomial = motion if isinstance(motion, PiecewisePolynomial) else getattr(motion, "polynomial", None)
        if order is not None and polynomial is not None:
            low, high = (
                edge(part, axis=0) for edge, part in zip((np.min, np.max), polynomial.extrema(order), strict=True)
            )
        share = np.fmax(_shares(limits, quantity, low), _shares(limits, quantity, high))
        for store, value in zip(found, (low, high, share, at), strict=True):
            store[quantity] = value
    return LimitsReport(limits, *found)


def dense_times(motion: Motion, samples: int = IN_A_PIECE) -> np.ndarray:
    """(k,) [s] increasing times of a motion: in every piece both of its ends, seen from inside, and `samples` between.

    Raises:
        ScenarioError: a motion that does not end.
    """
    if not np.isfinite(motion.duration):
        raise ScenarioError("does not end", place=type(motion).__name__, expected="a motion with a duration")
    breaks = np.asarray(motion.breaks, dtype=float)
    samples = max(samples, -(-SAMPLES // max(len(breaks) - 1, 1)))
    begin, end = breaks[:-1, None], np.nextafter(breaks[1:, None], -np.inf)
    end[-1] = breaks[-1]
    return np.unique(begin + (end - begin) * np.linspace(0.0, 1.0, samples + 2))


def _jerk(t: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Differences of the acceleration; across a jump of it, where two times lie next to each other, those beside it."""
    steps = np.diff(t)[:, None]
    usual = steps > 1e-6 * np.median(steps)
    rate = np.divide(np.diff(qdd, axis=0), steps, out=np.zeros_like(qdd[1:]), where=usual)
    return np.concatenate([rate, rate[-1:]])


def efforts(
    arm: Model,
    t: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    payload: Payload | Sequence[Payload] | None = None,
    wrench: Any = None,
) -> dict[str, np.ndarray]:
    """Torques and voltages of the motors by quantity, (k, n) [N m | N] and [V], where the record can tell them.

    Args:
        arm: the model.   t: (k,) [s].   q, qd, qdd: (k, n) [rad | m, …/s, …/s²].
        payload: bodies in the hand, each from its time on.   wrench: (6,) [N, N m] on the tip, in base axes.
    """
    if arm.without_masses or not np.asarray(arm.inertial_parameters, dtype=float).any():
        return {}
    bodies = [payload] if isinstance(payload, Payload) else sorted(payload or (), key=lambda each: each.time)
    tau, known = (
        np.zeros_like(q),
        all(body.drive.resistance is not None and body.drive.torque_constant is not None for body in arm.coordinates),
    )
    voltage = np.zeros_like(q)
    begins = [-np.inf, *(float(each.time) for each in bodies), np.inf]
    for begin, end, body in zip(begins[:-1], begins[1:], [None, *bodies], strict=True):
        rows = (t >= begin) & (t < end)
        if not rows.any():
            continue
        loaded = arm
        if body is not None and float(body.mass) > 0.0:
            loaded = arm.with_payload(body.mass, body.com, body.inertia, body.frame)
        dyn = compile_arm(loaded)
        force = () if wrench is None else (np.asarray(wrench, dtype=float),)
        tau[rows] = dyn.inverse_dynamics(q[rows], qd[rows], qdd[rows], *force)
        if known:
            voltage[rows] = dyn.motor_voltage(qd[rows], tau[rows])
    return {"torque": tau, "voltage": voltage} if known else {"torque": tau}


def _shares(limits: MotionLimits, quantity: str, rows: np.ndarray) -> np.ndarray:
    """Part of the limit that each value uses, (…, n); NaN without a limit."""
    most = getattr(limits, quantity)
    if quantity == "position":
        low, high = most.T
        with np.errstate(invalid="ignore"):  # of a joint without limits
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            finite = np.isfinite(half)
            return np.where(finite, np.abs(rows - np.where(finite, middle, 0.0)) / np.where(finite, half, 1.0), np.nan)
    return np.where(np.isfinite(most), np.abs(rows) / np.where(np.isfinite(most), most, 1.0), np.nan)

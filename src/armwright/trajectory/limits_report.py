"""Report of the share of its limits that a motion uses, on a dense grid in time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.kernels.compiled import KERNELS, compile_arm
from armwright.model import Model
from armwright.simulation.inputs.payload import Payload
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.motion import Motion
from armwright.trajectory.piecewise import PiecewisePolynomial
from armwright.trajectory.rest import Torques, torques

SUPPORT = KERNELS.named("plan")

JUMP = 1e-6  # of the largest acceleration: what is more, is no rounding
SAMPLES = 2000  # of a report, at least, and …
IN_A_PIECE = 10  # … between two breaks
SHOWN = 4  # jumps that are listed


@dataclass(frozen=True, eq=False)
class LimitsReport:
    """Share of its limits that a motion uses; `str` gives the table.

    Attributes:
        limits: that were asked.
        lowest, highest: by quantity (n,) extreme values.   share: by quantity (n,) the largest part of the limit that is used,
            1: all of it; of positions the part of the way from the middle of the range to its ends; NaN without a limit.
        times: by quantity (n,) [s] of the largest share.
        bands: by quantity (n, 2) lowest and highest torque, or voltage, that holds a joint which stands all the time in its dry
            friction or gear loss; NaN for others. Of a band the part nearest to 0 is compared with the limit.
        jumps: (k,) [s] beside which the acceleration of a joint with a limit of jerk jumps: no such limit can be kept there,
            and the values of jerk are those between the jumps.
        notes: about effects of the record that torques and voltages approximate.
    """

    limits: MotionLimits
    lowest: dict[str, np.ndarray]
    highest: dict[str, np.ndarray]
    share: dict[str, np.ndarray]
    times: dict[str, np.ndarray]
    jumps: np.ndarray
    bands: dict[str, np.ndarray] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def largest(self) -> float:
        """The largest share over joints and quantities; 0 without any limit."""
        return float(np.nanmax([0.0, *np.concatenate(list(self.share.values()))]))

    @property
    def kept(self) -> bool:
        """True if no limit is exceeded by more than 1e-6 of it, and no acceleration jumps under a limit of jerk."""
        return self.largest <= 1.0 + 1e-6 and not self.jumps.size

    def worst(self, quantity: str, joint: int) -> float:
        """The value with the largest share of its limit; without a limit the largest value."""
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
        if self.jumps.size:
            times = ", ".join(dict.fromkeys(f"{t:.4g}" for t in self.jumps[:SHOWN]))
            more = ", …" if len(self.jumps) > SHOWN else ""
            said.append(f"acceleration jumps at {times}{more} s: no limit of jerk is kept there")
        return said

    def __str__(self) -> str:
        rows = [["joint", *self.share]]
        for k, name in enumerate(self.limits.names):
            cells = [name]
            for quantity, share in self.share.items():
                part = "no limit" if np.isnan(share[k]) else f"{share[k]:.1%}"
                low, high = self.bands[quantity][k] if quantity in self.bands else (np.nan, np.nan)
                value = f"{self.worst(quantity, k):.3g}" if np.isnan(low) else f"{low:.3g} … {high:.3g}"
                cells.append(f"{value} {self.limits.unit(quantity, k)} {part:>8}")
            rows.append(cells)
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = [
            "   ".join(
                [f"{row[0]:{widths[0]}}", *(f"{cell:>{w}}" for cell, w in zip(row[1:], widths[1:], strict=True))]
            )
            for row in rows
        ]
        if self.jumps.size:
            lines.append(self.excesses()[-1])
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
    """Largest share of every limit that a motion uses, on a dense grid between its breaks; exact for piecewise polynomials.

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
    known = _efforts(arm, t, q, qd, qdd, payload, wrench)
    values |= {quantity: each.least for quantity, each in known.items()}
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
    limited = np.isfinite(limits.jerk)
    jumps = jumps_of_acceleration(motion, limited) if limited.any() else np.empty(0)
    bands = {
        quantity: np.where(each.held.all(axis=0), [each.low.min(axis=0), each.high.max(axis=0)], np.nan).T
        for quantity, each in known.items()
    }
    notes = SUPPORT.notes(arm) if "torque" in values else ()
    return LimitsReport(limits, *found, jumps=jumps, bands=bands, notes=notes)


def dense_times(motion: Motion, samples: int = IN_A_PIECE) -> np.ndarray:
    """(k,) [s] increasing times of a motion: both ends of every piece, from inside, and `samples` between.

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


def jumps_of_acceleration(motion: Motion, joints: np.ndarray) -> np.ndarray:
    """Increasing times [s] of acceleration jumps, which violate any limit of jerk.

    Args:
        motion: one that ends; before and after it the arm stands.   joints: (n,) True for those that are asked about.
    """
    breaks = np.asarray(motion.breaks, dtype=float)
    after, before = (motion.at(t)[2][:, joints] for t in (breaks, np.nextafter(breaks, -np.inf)))
    before[0], after[-1] = 0.0, 0.0
    small = JUMP * np.abs(motion.at(dense_times(motion))[2][:, joints]).max(axis=0)
    jumps = np.abs(after - before) > small
    from_left, to_right = ((jumps & (np.abs(side) > small)).any(axis=1) for side in (before, after))
    return np.sort(np.concatenate([np.nextafter(breaks[from_left], -np.inf), breaks[to_right]]))


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
    """Torques and voltages of the motors by quantity, (k, n) [N m | N] and [V], as far as the record allows.

    Those of a joint at rest are without dry friction, also where its speed is the rounding of 0.

    Args:
        arm: the model.   t: (k,) [s] increasing.   q, qd, qdd: (k, n) [rad | m, …/s, …/s²].
        payload: bodies in the hand, each from its time on.   wrench: (6,) [N, N m] on the tip, in base axes.
    """
    return {quantity: each.tau for quantity, each in _efforts(arm, t, q, qd, qdd, payload, wrench).items()}


def _efforts(
    arm: Model,
    t: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    payload: Payload | Sequence[Payload] | None,
    wrench: Any,
) -> dict[str, Torques]:
    """Torques and voltages with their bands; see `efforts`."""
    if arm.without_masses or not np.asarray(arm.inertial_parameters, dtype=float).any():
        return {}
    bodies = [payload] if isinstance(payload, Payload) else sorted(payload or (), key=lambda each: each.time)
    force = () if wrench is None else (np.asarray(wrench, dtype=float),)
    begins = [-np.inf, *(float(each.time) for each in bodies), np.inf]
    fastest = np.abs(qd).max(axis=0, initial=0.0)
    parts = []
    for begin, end, body in zip(begins[:-1], begins[1:], [None, *bodies], strict=True):
        rows = (t >= begin) & (t < end)
        loaded = arm
        if body is not None and float(body.mass) > 0.0:
            loaded = arm.with_payload(body.mass, body.com, body.inertia, body.frame)
        if rows.any():
            parts.append(torques(arm, compile_arm(loaded), q[rows], qd[rows], qdd[rows], *force, fastest=fastest))
    found = Torques(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Torques)))
    if not all(b.drive.resistance is not None and b.drive.torque_constant is not None for b in arm.coordinates):
        return {"torque": found}
    dyn = compile_arm(arm)
    volts = [dyn.motor_voltage(found.qd, each) for each in (found.tau, found.low, found.high)]
    low, high = np.minimum(*volts[1:]), np.maximum(*volts[1:])  # swapped where the gear turns the motor the other way
    return {"torque": found, "voltage": Torques(found.qd, volts[0], low, high, found.held)}


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

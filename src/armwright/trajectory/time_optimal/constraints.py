"""Limits of an arm along a path: for a squared path speed x = ṡ² an interval of path accelerations s̈, and its tangents in x.

q̇ = q' √x,  q̈ = q' s̈ + q'' x.  [BobrowEtAl1985] At fixed x the inverse dynamics is affine in s̈; through lossy gears and with
friction by loads it bends. In x it is neither: viscous friction and back EMF add terms in √x [VerscheureEtAl2009], other friction
any function of it. So limits are computed at given x, through the compiled kernels, for all grid points at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armwright.actuators.friction import by_loads
from armwright.actuators.gear import loses_power
from armwright.kernels.compiled import CompiledArm
from armwright.kernels.speed_passes import CellLines
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.path import JointPath
from armwright.trajectory.rest import RESTING

FLAT = 1e-13  # of a joint's largest slope: below it the joint bounds x, not s̈
LINES = 12  # of a piecewise-linear torque that the search for a bound visits at most
STUCK = 4  # steps without a root: those that are left go on without an end, between two lines
SOLVED = 1e-11  # of the torques that are allowed
LARGEST = 1e3  # times the torques that are allowed: what M q' s̈ may be
NEAR = 1e-4  # of the accelerations that are allowed, over which a line's slope is measured
UNBOUNDED = 1e100  # finite, so that bounds can be interpolated
BESIDE, TINY = 1e-3, 1e-9  # of x: how far beside it a tangent is taken; of the largest x, where x is smaller

Shares = Mapping[str, np.ndarray]  # by quantity (m, n): part of its limit that a plan may use at each grid point


@dataclass(frozen=True, eq=False)
class PathLimits:
    """Limits of an arm at points of a path.

    Attributes:
        dyn: the compiled arm, with its payload.   limits: of the joints.
        q, first, second: (m, n) the path and its derivatives by s.
    """

    dyn: CompiledArm
    limits: MotionLimits
    q: np.ndarray
    first: np.ndarray
    second: np.ndarray

    @classmethod
    def at(cls, dyn: CompiledArm, limits: MotionLimits, path: JointPath, s: np.ndarray) -> PathLimits:
        """Limits of an arm at points s (m,) of a path."""
        q, first, second = path.at(s)
        # the sign of rounding is not that of dry friction
        moves = np.abs(first) > RESTING * np.abs(first).max(initial=0.0)
        return cls(dyn, limits, q, np.where(moves, first, 0.0), second)

    def largest_x(self, shares: Shares) -> np.ndarray:
        """(m,) x at which the first joint reaches its velocity limit; infinite without one."""
        with np.errstate(divide="ignore"):
            speed = (self.limits.velocity * shares["velocity"] / np.abs(self.first)).min(axis=1)
        return speed * speed

    def bounds(self, x: np.ndarray, shares: Shares) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest s̈ (m, j) that all joints allow at x (m, j); lowest above highest if none is allowed."""
        intervals = []
        if np.isfinite(self.limits.acceleration).any():
            most = (self.limits.acceleration * shares["acceleration"])[:, None]
            value = self.second[:, None] * x[..., None]
            intervals.append(_interval(value, self.first[:, None], -most, most))
        if self.has_torques:
            intervals.append(_interval(np.zeros(1), self._inertia, *self._inertial_torque_bounds(x, shares)))
        low, high = (np.clip(rows, -UNBOUNDED, UNBOUNDED).max(axis=(0, -1)) for rows in zip(
            *((low, -high) for low, high in intervals), strict=True))  # fmt: skip
        return low, -high

    def used(self, x: np.ndarray, sdd: np.ndarray) -> dict[str, np.ndarray]:
        """By quantity the share of its limit (m, j, n) that each joint uses at x and s̈ (m, j), signed; 0 without a limit."""
        qd, qdd = self._motion(x, sdd)
        values = {"velocity": qd, "acceleration": qdd}
        if self.has_torques:
            values["torque"] = self.torque(x, sdd)
        if self._has_voltages:
            values["voltage"] = self.dyn.motor_voltage(qd, values["torque"])
        return {name: value / getattr(self.limits, name) for name, value in values.items()}

    def torque_limits(self, x: np.ndarray, shares: Shares) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest torques of the motors (m, j, n) [N m | N] at x (m, j), by limits of torque and voltage."""
        most = (self.limits.torque * shares["torque"])[:, None] + np.zeros((*x.shape, 1))
        if not self._has_voltages:
            return -most, most
        qd = self._motion(x, x)[0]
        volts = (self.limits.voltage * shares["voltage"])[:, None] + np.zeros_like(qd)
        limited = np.isfinite(volts)
        volts = np.where(limited, volts, 0.0)
        ends = self.dyn.motor_torque(qd, -volts), self.dyn.motor_torque(qd, volts)  # swapped where n is negative
        least, greatest = np.minimum(*ends), np.maximum(*ends)
        least, greatest = np.where(limited, least, -np.inf), np.where(limited, greatest, np.inf)
        return np.maximum(-most, least), np.minimum(most, greatest)

    @cached_property
    def has_torques(self) -> bool:
        """True if torques or voltages are limited."""
        return bool(np.isfinite([self.limits.torque, self.limits.voltage]).any())

    @cached_property
    def _has_voltages(self) -> bool:
        return bool(np.isfinite(self.limits.voltage).any())

    @cached_property
    def _torque_is_nonlinear(self) -> bool:
        """True if a motor's torque is no straight line over s̈: through lossy gears, with friction by loads."""
        return any(loses_power(body) or by_loads(body) for body in self.dyn.arm.coordinates)

    @cached_property
    def _inertia(self) -> np.ndarray:
        """M q' (m, 1, n): torque of the motors per s̈ through gears without loss."""
        still = np.zeros_like(self.q)
        inertia = self.dyn.inverse_dynamics(self.q, still, self.first) - self.dyn.inverse_dynamics(self.q, still, still)
        return inertia[:, None]

    @cached_property
    def _flat_inertia(self) -> np.ndarray:
        """(n,) magnitude of M q' up to which it counts as 0."""
        return _flat(self._inertia)

    def _motion(self, x: np.ndarray, sdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """q̇ and q̈, each (m, j, n), at x and s̈ (m, j)."""
        first = self.first[:, None]
        return first * np.sqrt(x)[..., None], first * sdd[..., None] + self.second[:, None] * x[..., None]

    def torque(self, x: np.ndarray, sdd: np.ndarray) -> np.ndarray:
        """Torques of the motors (m, j, n) [N m | N] at x and s̈ (m, j)."""
        return self.dyn.inverse_dynamics(self.q[:, None], *self._motion(x, sdd))

    def _inertial_torque_bounds(self, x: np.ndarray, shares: Shares) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest values (m, j, n) of M q' s̈ at x (m, j) within the limits of torque and voltage."""
        least, most = self.torque_limits(x, shares)
        torque, inertia = self.torque(x, np.zeros_like(x)), self._inertia
        if not self._torque_is_nonlinear:
            return least - torque, most - torque
        low, high = _interval(torque, inertia, least, most)
        rising, size = inertia > 0.0, most - least
        low = self._root(x, low, np.where(rising, least, most), size)
        high = self._root(x, high, np.where(rising, most, least), size)
        flat = np.abs(inertia) <= self._flat_inertia
        ends = (
            np.where(flat | (np.abs(end) >= UNBOUNDED), allowed - torque, inertia * end)
            for end, allowed in ((np.where(rising, low, high), least), (np.where(rising, high, low), most))
        )
        # where M q' goes through 0, what the gear takes leaves almost anything, which rounding decides
        low, high = (np.clip(end, -LARGEST * size, LARGEST * size) for end in ends)
        return low, high

    @cached_property
    def _alone(self) -> list[PathLimits]:
        """With the limits of torque alone and with those of voltage alone, where there are any."""
        found = []
        for name, other in (("torque", "voltage"), ("voltage", "torque")):
            if np.isfinite(getattr(self.limits, name)).any():
                limits = replace(self.limits, **{other: np.full(self.limits.n, np.inf)})
                found.append(replace(self, limits=limits))
                vars(found[-1]).update(_inertia=self._inertia, _flat_inertia=self._flat_inertia)
        return found

    def of_points(self, k: np.ndarray) -> PathLimits:
        """The limits at some of the points."""
        part = PathLimits(self.dyn, self.limits, self.q[k], self.first[k], self.second[k])
        if self.has_torques:
            vars(part).update(_inertia=self._inertia[k], _flat_inertia=self._flat_inertia)
        return part

    def tangents(self, x: np.ndarray, shares: Shares, least: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Limits  a s̈ + b x ≤ c  that are true near x (m,), of which less than `least` counts as that: each (m, r)."""
        limited = np.isfinite(self.limits.acceleration)
        most = (self.limits.acceleration * shares["acceleration"])[:, limited]
        first, second = self.first[:, limited], self.second[:, limited]
        rows = [(first, second, most), (-first, -second, most)]
        if self.has_torques:
            rows.append(self.torque_tangents(x, shares, least))
        a, b, c = (np.concatenate(each, axis=1) for each in zip(*rows, strict=True))
        return a, b, c

    def torque_tangents(self, x: np.ndarray, shares: Shares, least: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of `tangents` those of torques, and those of voltages: one that allows more at x may allow less beside it."""
        beside = BESIDE * np.maximum(x, least)
        levels, rows = np.stack([np.maximum(x - beside, 0.0), x + beside], axis=1), []
        for alone in self._alone:
            for sign, room in zip((-1.0, 1.0), alone._inertial_torque_bounds(levels, shares), strict=True):
                inner = np.isfinite(room).all(axis=(0, 1))
                room = sign * room[..., inner]
                slope = (room[:, 1] - room[:, 0]) / np.diff(levels)
                rows.append((sign * self._inertia[:, 0, inner], -slope, room[:, 0] - slope * levels[:, :1]))
        a, b, c = (np.concatenate(each, axis=1) for each in zip(*rows, strict=True))
        return a, b, c

    def lines(self, s: np.ndarray, tangents: tuple[np.ndarray, ...], shares: Shares) -> CellLines:
        """Limits by tangents (m, r) at both ends of every cell of a grid s (m,), which share their s̈."""
        a, b, c = tangents
        steps = np.diff(s)
        flat = np.tile(np.maximum(FLAT * np.abs(a).max(axis=0), 1.0 / UNBOUNDED), 2)
        a = np.concatenate([a[:-1], a[1:] + 2.0 * steps[:, None] * b[1:]], axis=1)  # x goes to x + 2 Δ s̈
        b, c = (np.concatenate([each[:-1], each[1:]], axis=1) for each in (b, c))
        a = np.where(np.abs(a) > flat, a, flat)
        offset, slope, above = c / np.abs(a), -b / np.abs(a), a > 0.0
        return CellLines(
            np.where(above, offset, UNBOUNDED), np.where(above, slope, 0.0), np.where(above, UNBOUNDED, offset),
            np.where(above, 0.0, slope), np.minimum(self.largest_x(shares), UNBOUNDED), steps,
        )  # fmt: skip

    def _root(self, x: np.ndarray, sdd: np.ndarray, target: np.ndarray, size: np.ndarray) -> np.ndarray:
        """s̈ (m, j, n) at which each joint's own torque is the target, by Newton's method, exact on the last line."""
        sdd = np.broadcast_to(sdd, target.shape).copy()
        open_ = np.isfinite(sdd) & (np.abs(sdd) < UNBOUNDED) & (np.abs(self._inertia) > self._flat_inertia)
        rows = np.argwhere(open_)
        left: list[int] = []
        for _ in range(LINES):
            if not len(rows) or left[-STUCK:] == [len(rows)] * STUCK:
                break
            left.append(len(rows))
            k, j, i = rows.T
            error = self._own_torque(k, i, x[k, j], sdd[k, j, i]) - target[k, j, i]
            on = np.abs(error) > SOLVED * np.abs(size[k, j, i])
            rows, error = rows[on], error[on]
            k, j, i = rows.T
            near, inertia = NEAR * size[k, j, i] / np.abs(self._inertia[k, 0, i]), self._inertia[k, 0, i]
            beside = self._own_torque(k, i, x[k, j], sdd[k, j, i] + near) - target[k, j, i]
            slope = (beside - error) / near
            sdd[k, j, i] -= error / np.where(slope * inertia > 0.0, slope, inertia)
        return sdd

    def _own_torque(self, k: np.ndarray, i: np.ndarray, x: np.ndarray, sdd: np.ndarray) -> np.ndarray:
        """Torque (r,) of joint i at grid point k, x and s̈, all (r,)."""
        first = self.first[k]
        qdd = first * sdd[:, None] + self.second[k] * x[:, None]
        return self.dyn.inverse_dynamics(self.q[k], first * np.sqrt(x)[:, None], qdd)[np.arange(len(i)), i]


def _flat(slope: np.ndarray) -> np.ndarray:
    """(n,) magnitude of a slope (m, j, n) up to which a joint's line counts as flat."""
    return np.maximum(FLAT * np.abs(slope).max(axis=(0, 1)), 1.0 / UNBOUNDED)


def _interval(
    value: np.ndarray, slope: np.ndarray, least: np.ndarray, most: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Interval of u with  least ≤ value + slope u ≤ most,  by entry; a flat line bounds x, with u far beyond all others."""
    floor = _flat(slope)
    slope = np.where(np.abs(slope) > floor, slope, floor)
    with np.errstate(over="ignore"):
        a, b = (least - value) / slope, (most - value) / slope
    return np.where(slope > 0.0, a, b), np.where(slope > 0.0, b, a)

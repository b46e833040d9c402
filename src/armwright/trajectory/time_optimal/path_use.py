"""Parts of all limits that a smooth motion along a path uses at any time, and the slower motion that keeps them.

Velocity, acceleration and jerk fall with the first, second and third power of the time that the motion takes. Of a torque only a
part does: what carries the arm and overcomes dry friction stays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from armwright.kernels.compiled import CompiledArm
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.path import JointPath
from armwright.trajectory.time_optimal.constraints import TINY, PathLimits
from armwright.trajectory.time_optimal.planner import JUDGED
from armwright.trajectory.time_optimal.timing import PathTiming

ORDERS = {"velocity": 1, "acceleration": 2, "jerk": 3}
OF_MOTORS = ("torque", "voltage")
ALL: dict[str, float] = dict.fromkeys(OF_MOTORS, 1.0)  # of their limits
LOOKED = np.linspace(0.0, 1.0, 9)  # of a piece's time
ROUNDING = 1e-7  # of the duration
AROUND = 8  # pieces to either side that are passed slower
ZOOMS, ZOOM = 3, np.linspace(0.0, 1.0, 17)  # about each peak that may be the largest
SLOWER, SLOWEST, HALVINGS = 1.05, 100.0, 20  # times the duration: the next that is tried, the last, and of the interval
# of what a motion exceeds between the times that were looked at; times the rate at which it is slowed
ROUNDS, FASTER = 16, 4.0


@dataclass(frozen=True, eq=False)
class PathUse:
    """Limits along a path, in a unit of time.

    Attributes:
        path: C².   limits: of the joints, in the unit of time but for torques and voltages.
        dyn: the compiled arm where torques or voltages are limited; else None.   unit: [s].
    """

    path: JointPath
    limits: MotionLimits
    dyn: CompiledArm | None
    unit: float

    @classmethod
    def of(cls, path: JointPath, limits: MotionLimits, dyn: CompiledArm | None, unit: float) -> PathUse:
        """The limits [s] in a unit of time [s]."""
        scaled = {name: getattr(limits, name) * unit**order for name, order in ORDERS.items()}
        return cls(path, replace(limits, **scaled), dyn, unit)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Limited quantities."""
        return *ORDERS, *(name for name in OF_MOTORS if self.dyn and np.isfinite(getattr(self.limits, name)).any())

    def by_name(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Parts of limits (…, quantities × n) by quantity."""
        return dict(zip(self.names, np.split(rows, len(self.names), axis=-1), strict=True))

    def parts(
        self, s: np.ndarray, speed: np.ndarray, sdd: np.ndarray, jerk: np.ndarray, third: np.ndarray
    ) -> dict[str, np.ndarray]:
        """By quantity the part of its limit (…, n) that each joint uses; s, ṡ, s̈ and s⃛ (…), q''' (…, n)."""
        _, first, second = self.path.at(s)
        v, a, j, limits = speed[..., None], sdd[..., None], jerk[..., None], self.limits
        found = {
            "velocity": np.abs(first * v) / limits.velocity,
            "acceleration": np.abs(first * a + second * v**2) / limits.acceleration,
            "jerk": np.abs(first * j + 3.0 * second * v * a + third * v**3) / limits.jerk,
        }
        if len(self.names) > len(found):
            found |= self._of_motors(self.points(s), speed, sdd)
        return found

    def points(self, s: np.ndarray) -> PathLimits:
        """Limits of the arm at places s (…)."""
        assert self.dyn is not None
        return PathLimits.at(self.dyn, self.limits, self.path, s.ravel())

    def _of_motors(self, points: PathLimits, speed: np.ndarray, sdd: np.ndarray) -> dict[str, np.ndarray]:
        used = points.used((speed.reshape(-1, 1) / self.unit) ** 2, sdd.reshape(-1, 1) / self.unit**2)
        return {name: np.abs(used[name]).reshape(*speed.shape, -1) for name in self.names if name in OF_MOTORS}

    def slowing(
        self,
        s: np.ndarray,
        speed: np.ndarray,
        sdd: np.ndarray,
        jerk: np.ndarray,
        third: np.ndarray,
        *,
        shares: Mapping[str, Any] = ALL,
    ) -> float:
        """By how much slower the motion keeps all limits at places s (…), of the motors' `shares`; infinite if it never does."""
        found = self.parts(s, speed, sdd, jerk, third)
        factor = _factor(found)
        if len(found) == len(ORDERS):
            return factor
        points = self.points(s)

        def exceeds(factor: float) -> bool:
            parts = self._of_motors(points, speed / factor, sdd / factor**2)
            return any(bool((each > shares[name]).any()) for name, each in parts.items())

        above = factor
        while exceeds(above):
            factor, above = above, SLOWER * above
            if above > SLOWEST * factor or not np.isfinite(above) or above > SLOWEST:
                return np.inf
        for _ in range(HALVINGS if above > factor else 0):
            middle = 0.5 * (factor + above)
            factor, above = (middle, above) if exceeds(middle) else (factor, middle)
        return above

    def within(self, timing: PathTiming) -> PathTiming:
        """The timing, slower as a whole so that it keeps the limits at some times of every piece."""
        pieces = np.arange(len(timing.s) - 1)
        return timing.slowed(self.slowing(*self._motion(timing, pieces, np.tile(LOOKED, (len(pieces), 1)))))

    def sampled(self, timing: PathTiming) -> np.ndarray:
        """Largest parts of limits (m - 1, quantities × n) at some times of every piece."""
        return self._at(timing, np.arange(len(timing.s) - 1)).max(axis=1)

    def _at(self, timing: PathTiming, pieces: np.ndarray, parts: np.ndarray | None = None) -> np.ndarray:
        """Parts of limits (p, k, quantities × n) in pieces (p,) after parts (p, k) of their times; None: some."""
        parts = np.tile(LOOKED, (len(pieces), 1)) if parts is None else parts
        return np.concatenate(list(self.parts(*self._motion(timing, pieces, parts)).values()), axis=2)

    def _motion(self, timing: PathTiming, pieces: np.ndarray, parts: np.ndarray) -> tuple[np.ndarray, ...]:
        """s, ṡ, s̈ and s⃛ (p, k) and q''' (p, 1, n) in pieces (p,) after parts (p, k) of their times."""
        s, speed, sdd = timing.at(pieces[:, None], parts * timing.durations[pieces, None])
        third = self.path.derivative(0.5 * (timing.s[pieces] + timing.s[pieces + 1]), 3)[:, None]
        return s, speed, sdd, np.broadcast_to(timing.jerks[pieces, None], s.shape), third

    def locally_slower(self, rows: np.ndarray) -> np.ndarray:
        """(m - 1,) smooth factors of durations, above 1 where parts of limits (m - 1, quantities × n) are."""
        most = [part.max(axis=1) ** (1.0 / ORDERS.get(name, 1)) for name, part in self.by_name(rows).items()]
        excess = maximum_filter1d(np.maximum(np.max(most, axis=0) - 1.0, 0.0), 2 * AROUND + 1, mode="nearest")
        return 1.0 + uniform_filter1d(uniform_filter1d(excess, AROUND, mode="nearest"), AROUND, mode="nearest")

    def kept(self, timing: PathTiming) -> tuple[PathTiming, dict[str, np.ndarray]]:
        """The timing, slower as a whole so that it keeps the limits at all times, and its use of them, by quantity (m - 1, n)."""
        timing, before, rate = self.within(timing), np.inf, 1.0
        most = self.peaks(timing)
        for _ in range(ROUNDS):
            if not most.max() > 1.0:
                break
            used = self.by_name(most)
            excess = max((float(used[name].max()) - 1.0 for name in used if name in OF_MOTORS), default=0.0)
            # how much of a torque's excess slower motions take off, the round before tells
            if excess > 0.0 and np.isfinite(before):
                rate *= min(before / max(before - excess, TINY), FASTER)
            before = excess if excess > 0.0 else np.inf
            timing = timing.slowed(max(_factor(used), 1.0 + rate * excess) * (1.0 + ROUNDING))
            most = self.peaks(timing)
        return timing, self.by_name(most)

    def peaks(self, timing: PathTiming) -> np.ndarray:
        """Largest parts of limits (m - 1, quantities × n), between the times that were looked at too where they may exceed."""
        looked, pieces = LOOKED if self.dyn is None else JUDGED, np.arange(len(timing.s) - 1)
        rows = self._at(timing, pieces, np.tile(looked, (len(pieces), 1)))
        most = rows.max(axis=1)
        bent = np.abs(np.diff(rows, 2, axis=1)).max(axis=1)  # eight times what a parabola rises above its samples
        piece, column = np.nonzero(most + bent >= 1.0)
        k, count = rows.argmax(axis=1)[piece, column], np.arange(len(piece))
        begin, end = looked[np.maximum(k - 1, 0)], looked[np.minimum(k + 1, len(looked) - 1)]
        for _ in range(ZOOMS if len(piece) else 0):
            parts = begin[:, None] + (end - begin)[:, None] * ZOOM
            values = self._at(timing, piece, parts)[count, :, column]
            np.maximum.at(most, (piece, column), values.max(axis=1))
            k = values.argmax(axis=1)
            begin, end = parts[count, np.maximum(k - 1, 0)], parts[count, np.minimum(k + 1, parts.shape[1] - 1)]
        return most

    def lines(
        self, s: np.ndarray, speed: np.ndarray, shares: Mapping[str, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shares (p, n) of limits of torque and voltage  a s̈ + b ṡ² ≤ c  that are true near ṡ (p,), at s (p,): each (r, p)."""
        x = (speed / self.unit) ** 2
        a, b, c = (each.T for each in self.points(s).torque_tangents(x, shares, TINY * float(x.max())))
        return a / self.unit**2, b / self.unit**2, c


def _factor(found: dict[str, np.ndarray]) -> float:
    """By how much slower the largest parts of velocity, acceleration and jerk are 1."""
    return max(float(found[name].max()) ** (1.0 / order) for name, order in ORDERS.items())

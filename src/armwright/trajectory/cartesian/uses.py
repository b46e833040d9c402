"""Utilisation of joint and tool limits along a motion of the tool, and the slow-down factor that each requires."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright.trajectory.cartesian.motion import CartesianMotion
from armwright.trajectory.cartesian.solve import ToolPathSolution
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.piecewise import PiecewisePolynomial

SAMPLES, IN_A_PIECE = 2000, 8  # places where limits are looked at: on the whole way, between two nodes of its spline
ROUNDS, JUST = 12, 1e-10  # refinements of those near the largest use; of a time: just beside it
MARGIN = 1e-7  # of limits, for what lies between those places
ROUNDED = 1e-9  # of a limit


@dataclass(frozen=True, eq=False)
class LimitUse:
    """Utilisation of one limit at many times: the factor (k,) by which the motion must be slower for it."""

    what: str
    unit: str
    values: np.ndarray
    limit: float
    power: int  # of the time, in the quantity
    joint: bool

    @property
    def slower(self) -> np.ndarray:
        """(k,) at each time; at most 1 if the limit is kept."""
        return (self.values / self.limit) ** (1.0 / self.power)

    def said(self, k: int) -> str:
        """The value that the motion would need, and the limit, in words."""
        return f"{self.what.format(f'{self.values[k]:.4g} {self.unit}')}, its limit is {self.limit:.4g}"


@dataclass(frozen=True, eq=False)
class Uses:
    """Utilisation of all limits at places s (k,) [m] and times t (k,) [s] of a motion, the largest of all to 1e-8."""

    t: np.ndarray
    s: np.ndarray
    columns: list[LimitUse]

    @property
    def slower(self) -> np.ndarray:
        """(k,) factor by which the motion must be slower at each place for all of its limits."""
        return np.max([np.zeros(len(self.t)), *(column.slower for column in self.columns)], axis=0)

    def hardest(self) -> list[tuple[float, LimitUse, int]]:
        """For every exceeded limit the factor, the limit and its row, the largest factor first."""
        found = [(float(c.slower.max()), c, int(c.slower.argmax())) for c in self.columns]
        return sorted((each for each in found if each[0] > 1.0 + ROUNDED), key=lambda each: -each[0])

    def stretches(self) -> list[tuple[float, float, float, str]]:
        """Stretches beyond a limit: begin and end [m], the largest factor, and the value needed there."""
        over = np.concatenate([[False], self.slower > 1.0 + ROUNDED, [False]])
        begins, ends = np.flatnonzero(over[1:] & ~over[:-1]), np.flatnonzero(over[:-1] & ~over[1:]) - 1
        found = []
        for begin, end in zip(begins, ends, strict=True):
            rows = slice(begin, end + 1)
            worst = max(self.columns, key=lambda column: column.slower[rows].max())
            k = int(begin + worst.slower[rows].argmax())
            found.append((float(self.s[begin]), float(self.s[end]), float(worst.slower[k]), worst.said(k)))
        return found


def uses_of(
    solution: ToolPathSolution,
    profile: PiecewisePolynomial,
    limits: MotionLimits,
    values: dict[str, float],
    rounds: int = ROUNDS,
) -> Uses:
    """Utilisation of each limit by a motion along a path.

    Args:
        solution: joint positions along the path.   profile: s(t) [m].   limits: of the joints.
        values: by name the tool's limits [m/s², rad/s, rad/s²]; infinite: none.   rounds: refinements near the largest use.
    """
    motion = CartesianMotion(solution, profile, 1.0)
    places = [
        begin + np.linspace(run.breaks[:-1], run.breaks[1:], IN_A_PIECE).ravel()
        for (begin, _), run in zip(solution.path.runs, solution.runs, strict=True)
    ]
    begin, end = motion.time, motion.time + motion.duration
    t = np.concatenate([motion.times(np.concatenate(places)), np.linspace(begin, end, SAMPLES), motion.breaks])
    t = np.unique(np.concatenate([t, t * (1.0 - JUST), t * (1.0 + JUST)]).clip(begin, end))  # both sides of a jump
    columns = _columns(motion, limits, values, t)
    for _ in range(rounds if columns else 0):
        used = np.max([column.slower for column in columns], axis=0)
        bend = np.abs(np.diff(used, 2, prepend=used[0], append=used[-1]))
        reachable = np.maximum(used[:-1], used[1:]) + np.maximum(bend[:-1], bend[1:])  # between two points, by far
        coarse = np.flatnonzero((reachable > used.max() * (1.0 + 0.1 * MARGIN)) & (np.diff(t) > JUST * motion.duration))
        if not len(coarse):
            break
        coarse = coarse[np.argsort(-reachable[coarse])[:SAMPLES]]
        t = np.unique(np.concatenate([t, np.linspace(t[coarse], t[coarse + 1], 8)[1:-1].ravel()]))
        columns = _columns(motion, limits, values, t)
    return Uses(t, profile.at(t)[0][:, 0], columns)


def _columns(motion: CartesianMotion, limits: MotionLimits, values: dict[str, float], t: np.ndarray) -> list[LimitUse]:
    """Utilisation of all limits at times t (k,)."""
    s, rate, change = (each[:, 0] for each in motion.profile.at(t))
    _, qd, qdd = motion.at(t)
    qddd = motion.jerk(t)
    columns = []
    for power, quantity, rows in ((1, "velocity", qd), (2, "acceleration", qdd), (3, "jerk", qddd)):
        word = "speed" if quantity == "velocity" else quantity
        for joint in np.flatnonzero(np.isfinite(getattr(limits, quantity))):
            what = f"joint {limits.names[joint]!r} would need {{}} of {word}"
            unit, limit = limits.unit(quantity, int(joint)), float(getattr(limits, quantity)[joint])
            columns.append(LimitUse(what, unit, np.abs(rows[:, joint]), limit, power, True))
    points = motion.solution.twists(s, motion.path.points(s))
    twist = points.first * rate[:, None]
    accelerations = points.second * rate[:, None] ** 2 + points.first * change[:, None]
    tool = {
        "acceleration": (2, accelerations[:, :3], "m/s²"),
        "angular_speed": (1, twist[:, 3:], "rad/s"),
        "angular_acceleration": (2, accelerations[:, 3:], "rad/s²"),
    }
    for name, (power, rows, unit) in tool.items():
        if np.isfinite(values[name]):
            what = f"the tool's {name.replace('_', ' ')} would be {{}}"
            columns.append(LimitUse(what, unit, np.linalg.norm(rows, axis=1), values[name], power, False))
    return columns

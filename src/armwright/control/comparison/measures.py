"""Measures of a tracked motion: path accuracy and repeatability of the tool, settling, overshoot.  [ISO9283]

A point of the commanded path is compared with where the tool crosses the plane through it, normal to the path. A tool that is
late but on the path has no path deviation; how late it is stands in the errors of the joints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

POINTS = 200  # of a path, at equal lengths
STANDS = 1e-9  # [m] of a path, or parts of the largest speed of a joint: less is no motion


@dataclass(frozen=True, eq=False)
class ToolPath:
    """Points of a commanded path.

    Attributes:
        points: (m, 3) [m].   tangents: (m, 3) unit vectors.   times: (m,) [s] at which each point is commanded.
        length: [m] of the whole path.
    """

    points: np.ndarray
    tangents: np.ndarray
    times: np.ndarray
    length: float


@dataclass(frozen=True)
class PathErrors:
    """Path deviation of the tool: its distances from its path, all [m].

    Attributes:
        mean, largest: over all points and runs.
        accuracy: ISO 9283 AT_p, the largest distance of the runs' mean path from the commanded one.
        repeatability: ISO 9283 RT_p, the largest mean + 3 standard deviations of the runs' distances from their mean path;
            NaN of a single run.
    """

    mean: float
    largest: float
    accuracy: float
    repeatability: float


def tool_path(t: np.ndarray, tool: np.ndarray, count: int = POINTS) -> ToolPath | None:
    """Points at equal distances along a path; None if the tool does not move.

    Args:
        t: (k,) [s].   tool: (k, 3) [m] commanded positions.   count: of points, both ends left out.
    """
    steps = np.diff(tool, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    total = float(lengths.sum())
    if not total > STANDS:
        return None
    moving = lengths > 1e-12 * total  # a dwell has no direction
    steps, starts, lengths, times = steps[moving], tool[:-1][moving], lengths[moving], t[:-1][moving]
    durations = np.diff(t)[moving]
    ends = np.cumsum(lengths)
    at = (np.arange(count) + 0.5) / count * ends[-1]
    k = np.minimum(np.searchsorted(ends, at, side="right"), len(ends) - 1)
    part = (at - (ends[k] - lengths[k])) / lengths[k]
    return ToolPath(
        points=starts[k] + part[:, None] * steps[k],
        tangents=steps[k] / lengths[k, None],
        times=times[k] + part * durations[k],
        length=total,
    )


def attained_points(path: ToolPath, t: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """(runs, m, 3) [m] points at which each run's tool crosses the planes normal to the path, in forward direction.

    Of several crossings the one nearest in time counts, unless the commanded path itself crosses the plane again nearer to that
    time; where a tool crosses none, its point nearest to the path's.

    Args:
        path: m points.   t: (k,) [s].   tool: (runs, k, 3) [m].
    """
    runs, attained = np.arange(len(tool)), np.empty((len(tool), len(path.points), 3))
    for i, (point, tangent, time) in enumerate(zip(path.points, path.tangents, path.times, strict=True)):
        ahead = (tool - point) @ tangent  # (runs, k)
        crosses = (ahead[:, :-1] < 0.0) & (ahead[:, 1:] >= 0.0)
        k = np.where(crosses, np.abs(t[:-1] - time), np.inf).argmin(axis=1)
        before, after = ahead[runs, k], ahead[runs, k + 1]
        found = crosses[runs, k]
        own = (path.points - point) @ tangent
        again = path.times[1:][(own[:-1] < 0.0) & (own[1:] >= 0.0) & (np.arange(1, len(own)) != i)]
        if len(again):  # a tool that stops short of where the path turns crosses the plane on another of its ways
            found &= np.abs(t[k] - time) <= np.abs(t[k, None] - again).min(axis=1)
        part = np.where(found, before / np.where(found, before - after, 1.0), 0.0)
        attained[:, i] = tool[runs, k] + part[:, None] * (tool[runs, k + 1] - tool[runs, k])
        if not found.all():
            nearest = np.linalg.norm(tool - point, axis=2).argmin(axis=1)
            attained[~found, i] = tool[runs, nearest][~found]
    return attained


def path_errors(path: ToolPath, attained: np.ndarray) -> PathErrors:
    """Distances of some runs from a path.

    With x_ij where run j crosses the plane of point i, and x̄_i their mean:  AT_p = max_i |x̄_i - p_i|;
    l_ij = |x_ij - x̄_i|,  RT_p = max_i (mean_j l_ij + 3 std_j l_ij), the standard deviation with runs - 1.

    Args:
        path: m points p_i.   attained: (runs, m, 3) [m].
    """
    distances = np.linalg.norm(attained - path.points, axis=2)
    middle = attained[0] + (attained - attained[0]).mean(axis=0)  # runs that are the same have no spread by rounding
    spread = np.linalg.norm(attained - middle, axis=2)
    repeatability = np.nan
    if len(attained) > 1:
        repeatability = float((spread.mean(axis=0) + 3.0 * spread.std(axis=0, ddof=1)).max())
    return PathErrors(
        mean=float(distances.mean()),
        largest=float(distances.max()),
        accuracy=float(np.linalg.norm(middle - path.points, axis=1).max()),
        repeatability=repeatability,
    )


def settling_time(t: np.ndarray, error: np.ndarray, end: float, band: np.ndarray) -> np.ndarray:
    """(runs, n) [s] from the motion's end until a joint stays within its band; infinite if it never does.

    Args:
        t: (k,) [s].   error: (runs, k, n) [rad | m].   end: [s] of the motion.   band: (n,) [rad | m].
    """
    late = t >= end - 1e-9 * max(end, 1.0)
    outside = np.abs(error[:, late]) > band
    after = t[late] - end
    last = outside.shape[1] - 1 - outside[:, ::-1].argmax(axis=1)  # the last row outside, where there is one
    settled = np.append(np.maximum(after, 0.0), np.inf)[last + 1]
    return np.where(outside.any(axis=1), settled, 0.0)


def overshoot(q: np.ndarray, goal: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(runs, n) [rad | m] overshoot of the joints at the end of a motion.

    Args:
        q: (runs, k, n) after the motion's end.   goal: (n,).
        direction: (n,) -1 or 1, the sense in which each joint moved last; 0 where it did not.
    """
    return np.maximum((direction * (q - goal)).max(axis=1), 0.0)


def last_direction(qd: np.ndarray) -> np.ndarray:
    """(n,) direction of each joint's last movement: -1, 1, or 0 if it did not move.

    Args:
        qd: (k, n) commanded speeds over time.
    """
    moving = np.abs(qd) > STANDS * np.abs(qd).max(initial=0.0)
    last = len(qd) - 1 - moving[::-1].argmax(axis=0)
    return np.where(moving.any(axis=0), np.sign(qd[last, np.arange(qd.shape[1])]), 0.0)

"""Keyframes of a joint's motion: the fewest within a tolerance, at times that single precision represents exactly."""

from __future__ import annotations

from math import pi

import numpy as np

LARGEST_TURN = pi / 2  # [rad] from one keyframe to the next: well below π, where the shorter way would be the other one
ROUNDS = 60  # of shorter pieces: halves of a second are then nothing


def keyframes(t: np.ndarray, q: np.ndarray, tolerance: float, turn: bool) -> tuple[np.ndarray, np.ndarray]:
    """Times and positions between which a straight line stays within `tolerance` of the polyline (t, q).

    Times are single precision and positions are those of that very time, so rounding a time moves nothing. Segments are
    halved at their worst point until all are good, which is Douglas and Peucker's rule for errors along q.  [DouglasPeucker1973]

    Args:
        t: (k,) [s] increasing, from 0.   q: (k,) [rad | m].   tolerance: [rad | m].
        turn: True for an angle, which moves by at most `LARGEST_TURN` from one keyframe to the next.
    Returns:
        times: (m,) float32, strictly increasing.   positions: (m,) [rad | m].
    """
    kept = np.zeros(len(t), dtype=bool)
    kept[[0, -1]] = True
    while True:
        at = np.flatnonzero(kept)
        off = np.abs(q - np.interp(t, t[at], q[at]))
        if not (off > tolerance).any():
            break
        worst = np.maximum.reduceat(off, at[:-1])
        segment = np.searchsorted(at[1:], np.arange(len(t)), side="left")
        segment = np.minimum(segment, len(worst) - 1)
        kept |= (off == worst[segment]) & (off > tolerance)
    times = t[kept]
    for _ in range(ROUNDS if turn and len(times) > 1 else 0):
        positions = np.interp(times, t, q)  # the polyline's own, which may be steeper than the line between keyframes
        if (np.abs(np.diff(positions)) <= LARGEST_TURN).all():
            break
        times = _refined(times, positions)
    times = np.unique(times.astype(np.float32))
    return times, np.interp(times.astype(float), t, q)


def _refined(times: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Times with as many more in between as large turns need."""
    parts = np.maximum(np.ceil(np.abs(np.diff(q)) / LARGEST_TURN).astype(int), 1)
    step = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)  # 0, 1, … within each segment
    between = np.repeat(times[:-1], parts) + np.repeat(np.diff(times) / parts, parts) * step
    return np.append(between, times[-1])

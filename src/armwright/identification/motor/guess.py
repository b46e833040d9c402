"""A coarse first guess of a drive from its log: a first-order response with delay and dead band, by linear least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from armwright.fitting.measures import r_squared
from armwright.identification.motor.measured import Measured

CONSTANTS = 24  # of time that are tried
LEAST_BAND = 1e-3  # of the largest command: a record whose dry friction is 0 cannot stick, and a search that begins there neither


@dataclass(frozen=True)
class Guess:
    """τ ẇ + w = gain (u(t - d) - band sgn w) + rest of one joint.

    Attributes:
        gain: [rad/s per unit of u].   time: τ [s].   band: [unit of u].   delay: d, whole samples.   resistance, emf: of
        u = R i + Ke w, where both are logged.   r2: share of the speed that this explains.   r2_against: with a negative gain.
    """

    gain: float
    time: float
    band: float
    delay: int
    resistance: float | None = None
    emf: float | None = None
    r2: float = 0.0
    r2_against: float = 0.0


def guess(data: Measured, joint: int, most_delay: int, direction: float = 1.0) -> Guess:
    """The best of a grid of delays and time constants; gain, band and rest by least squares.

    Args:
        data: measurements.   joint: its number.   most_delay: [samples].
        direction: 1, or -1 where a gear turns the joint the other way than its motor.
    """
    if not {"q", "qd", "qd_mean"} & set(data.signals):
        return _of_locked(data, joint)
    u = [direction * s.inputs.command[:, joint] for s in data.stretches]
    w = [s.speed(joint) for s in data.stretches]
    best = first_order(u, w, data.period, most_delay)
    if data.command != "voltage" or "current" not in data.signals:
        return best
    matrix, target = [], []
    for each, speed, s in zip(u, w, data.stretches, strict=True):
        target.append(np.concatenate([np.full(best.delay, each[0]), each[: len(each) - best.delay]]))
        matrix.append(np.column_stack([direction * s.values["current"][:, joint], speed]))
    (resistance, emf), *_ = np.linalg.lstsq(np.concatenate(matrix), np.concatenate(target), rcond=None)
    return replace(best, resistance=max(float(resistance), 1e-6), emf=max(float(emf), 1e-9))


def first_order(u: Sequence[np.ndarray], w: Sequence[np.ndarray], period: float, most_delay: int) -> Guess:
    """The first-order response of w to u, both by stretch, with the least residual of a grid of delays and time constants."""
    length = max(len(each) for each in w)
    best: dict[bool, tuple[float, float, int, np.ndarray]] = {}
    for time in period * np.geomspace(1.0, max(length / 4, 2.0), CONSTANTS):
        a = np.exp(-period / time)
        filtered = [lfilter([1 - a], [1, -a], each - each[0]) + each[0] for each in u]
        rise = [1 - a ** np.arange(len(each)) for each in w]
        sides = [lfilter([1 - a], [1, -a], np.concatenate([[0.0], np.sign(each[:-1])])) for each in w]
        target = np.concatenate([each - each[0] * (1.0 - r) for each, r in zip(w, rise, strict=True)])
        for delay in range(most_delay + 1):
            rows = []
            for y, first, side, r in zip(filtered, u, sides, rise, strict=True):
                late = np.concatenate([np.full(delay + 1, first[0]), y[: len(y) - delay - 1]])
                rows.append(np.column_stack([late - first[0] * (1.0 - r), side, r]))
            matrix = np.concatenate(rows)
            solution, *_ = np.linalg.lstsq(matrix, target, rcond=None)
            rest, forward = float(((target - matrix @ solution) ** 2).sum()), bool(solution[0] > 0)
            if solution[0] != 0 and (forward not in best or rest < best[forward][0]):
                best[forward] = rest, float(time), delay, solution
    spread = sum(float(((each - each.mean()) ** 2).sum()) for each in w)
    r2 = {way: float(r_squared(found[0], spread)) for way, found in best.items()}
    if True not in best:
        return Guess(1.0, 20 * period, 0.0, 0, r2_against=r2.get(False, 0.0))
    _, time, delay, solution = best[True]
    least = LEAST_BAND * max(float(np.abs(each).max()) for each in u)
    gain, band = float(solution[0]), max(float(-solution[1] / solution[0]), least)
    return Guess(gain, time, band, delay, r2=r2[True], r2_against=r2.get(False, 0.0))


def _of_locked(data: Measured, joint: int) -> Guess:
    """R of a motor that stands:  u = R i."""
    u = np.concatenate([s.inputs.command[:, joint] for s in data.stretches])
    i = np.concatenate([s.values["current"][:, joint] for s in data.stretches])
    resistance = float(u @ i) / max(float(i @ i), 1e-300)
    return Guess(1.0, 20 * data.period, 0.0, 0, max(resistance, 1e-6), 1.0)

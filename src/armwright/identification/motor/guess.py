"""A coarse first guess of a drive from its log: a first-order response with delay and dead band, by linear least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from armwright.identification.motor.measured import Measured

CONSTANTS = 24  # of time that are tried


@dataclass(frozen=True)
class Guess:
    """τ ẇ + w = gain (u(t - d) - band sgn w) + rest of one joint.

    Attributes:
        gain: [rad/s per unit of u].   time: τ [s].   band: [unit of u].   delay: d, whole samples.   resistance, emf: of
        u = R i + Ke w, where both are logged.
    """

    gain: float
    time: float
    band: float
    delay: int
    resistance: float | None = None
    emf: float | None = None


def guess(data: Measured, joint: int, most_delay: int) -> Guess:
    """The best of a grid of delays and time constants; gain, band and rest by least squares."""
    if not {"q", "qd", "qd_mean"} & set(data.signals):
        return _of_locked(data, joint)
    stretches = [
        (_speed(s.values, s.inputs.period, joint), s.inputs.command[:, joint], s.inputs.period, s)
        for s in data.stretches
    ]
    length = max(len(w) for w, *_ in stretches)
    period = data.period
    best: tuple[float, float, int, np.ndarray] | None = None
    for time in period * np.geomspace(1.0, max(length / 4, 2.0), CONSTANTS):
        a = np.exp(-period / time)
        for delay in range(most_delay + 1):
            rows, targets = [], []
            for w, u, _, _ in stretches:
                held = np.concatenate([np.full(delay + 1, u[0]), u[: len(u) - delay - 1]])
                side = np.concatenate([[0.0], np.sign(w[:-1])])
                filtered = [lfilter([1 - a], [1, -a], column) for column in (held, side)]
                decay = w[0] * a ** np.arange(len(w))
                rows.append(np.column_stack([*filtered, 1 - a ** np.arange(len(w))]))
                targets.append(w - decay)
            matrix, target = np.concatenate(rows), np.concatenate(targets)
            solution, *_ = np.linalg.lstsq(matrix, target, rcond=None)
            rest = float(((target - matrix @ solution) ** 2).sum())
            if solution[0] > 0 and (best is None or rest < best[0]):
                best = rest, float(time), delay, solution
    if best is None:
        return Guess(1.0, 20 * period, 0.0, 0)
    _, time, delay, solution = best
    gain, band = float(solution[0]), max(float(-solution[1] / solution[0]), 0.0)
    if data.command != "voltage" or "current" not in data.signals:
        return Guess(gain, time, band, delay)
    matrix, target = [], []
    for w, u, _, s in stretches:
        held = np.concatenate([np.full(delay, u[0]), u[: len(u) - delay]])
        matrix.append(np.column_stack([s.values["current"][:, joint], w]))
        target.append(held)
    (resistance, emf), *_ = np.linalg.lstsq(np.concatenate(matrix), np.concatenate(target), rcond=None)
    return Guess(gain, time, band, delay, max(float(resistance), 1e-6), max(float(emf), 1e-9))


def _of_locked(data: Measured, joint: int) -> Guess:
    """R of a motor that stands:  u = R i."""
    u = np.concatenate([s.inputs.command[:, joint] for s in data.stretches])
    i = np.concatenate([s.values["current"][:, joint] for s in data.stretches])
    resistance = float(u @ i) / max(float(i @ i), 1e-300)
    return Guess(1.0, 20 * data.period, 0.0, 0, max(resistance, 1e-6), 1.0)


def _speed(values: dict[str, np.ndarray], period: np.ndarray, joint: int) -> np.ndarray:
    for name in ("qd", "qd_mean"):
        if name in values:
            return values[name][:, joint]
    q = values["q"][:, joint]
    return np.concatenate([[0.0], np.diff(q) / period[:-1]])

"""One filter for all signals of an arm; its states are the filtered signals and their derivatives, without differencing.

    ẍ = w² (u - x) - 2 w ẋ

Critically damped, exact for inputs that are straight from row to row: u = u_1 + s (t - t_1) leaves x = u - 2 s/w beside what dies
away. All signals are late by the same time, 2/w, so the equations of motion hold between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

SETTLED = 15.0  # time constants 1/w after which the start at rest is forgotten: 16 e^-15 = 5e-6 of it is left
SAME = 1e-9  # [s]; periods nearer to each other have the same transition matrix


@dataclass(frozen=True, eq=False)
class FilteredRows:
    """Filtered rows of one block.

    Attributes:
        q, qd, qdd, tau: (rows, n).   settled: (rows,) False while the filter's start is not forgotten yet.
    """

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    tau: np.ndarray
    settled: np.ndarray


class SignalFilter:
    """The filter with its state, fed with blocks of rows of any length.

    Args:
        hz: w / 2π.   held: whether torques act until the next row, as commands do; they are taken between two rows then.
    """

    def __init__(self, hz: float, held: bool = False):
        self._w, self._held = 2.0 * math.pi * hz, held
        self.delay = 2.0 / self._w  # [s] of every signal
        # (2, signals, n), signals and derivatives, and (signals, n) the last row; empty: not started
        self._x = self._u = np.zeros(0)
        self._last = self._started = math.inf
        self._tau: np.ndarray | None = None
        self._step, self._matrix = -1.0, ((1.0, 0.0), (0.0, 1.0))

    @property
    def settling(self) -> float:
        """[s] after a start."""
        return SETTLED / self._w

    def rows(
        self, t: np.ndarray, q: np.ndarray, tau: np.ndarray, qd: np.ndarray | None, begins: np.ndarray
    ) -> FilteredRows:
        """Filtered rows.

        Args:
            t: (rows,) [s] increasing from a beginning on.   q, tau: (rows, n), finite.
            qd: (rows, n) if it is measured; None: the derivative of q.   begins: (rows,) at which the filter starts again.
        """
        if self._held and len(tau):
            before = tau[:1] if self._tau is None else self._tau
            self._tau, tau = tau[-1:].copy(), 0.5 * (tau + np.concatenate([before, tau[:-1]]))
        inputs = np.stack([q, tau] if qd is None else [q, tau, qd], axis=1)
        states, settled = np.empty((len(t), 2, *inputs.shape[1:])), np.zeros(len(t), dtype=bool)
        for k, now in enumerate(t):
            states[k] = self._next(float(now), inputs[k], bool(begins[k]))
            settled[k] = now - self._started >= self.settling
        x, rate = states[:, 0], states[:, 1]
        if qd is None:
            acceleration = self._w**2 * (q - x[:, 0]) - 2.0 * self._w * rate[:, 0]
            return FilteredRows(x[:, 0], rate[:, 0], acceleration, x[:, 1], settled)
        return FilteredRows(x[:, 0], x[:, 2], rate[:, 2], x[:, 1], settled)

    def _next(self, now: float, u: np.ndarray, begins: bool) -> np.ndarray:
        """State (2, signals, n) at the next row."""
        if begins:
            self._x, self._started = np.stack([u, np.zeros_like(u)]), now
        else:
            gap = now - self._last
            if abs(gap - self._step) > SAME:
                self._step, self._matrix = gap, critically_damped(self._w, gap)
            (a, b), (c, d) = self._matrix
            slope = (u - self._u) / gap
            late = 2.0 / self._w * slope
            off, rate = self._x[0] - self._u + late, self._x[1] - slope
            self._x = np.array([u - late + a * off + b * rate, slope + c * off + d * rate])
        self._last, self._u = now, u
        return self._x


def critically_damped(w: float, step: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Matrix of (x, ẋ) over a step [s] of  ẍ + 2 w ẋ + w² x = 0."""
    decay, wt = math.exp(-w * step), w * step
    return (decay * (1.0 + wt), decay * step), (-decay * w * wt, decay * (1.0 - wt))

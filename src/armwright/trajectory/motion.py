"""Motions: positions, speeds and accelerations of all joints over time. Every reference of this room is one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from armwright.program import interpret, trace
from armwright.scalar import Array, Scalar


class Motion(ABC):
    """Motion of n joints from `time` on for `duration`; the arm stands before and after.

    A subclass is a frozen dataclass that has `n`, `duration` and `__call__`. A loop takes all ticks of a motion without
    batches from `at` at once.

    Attributes:
        time: [s] of the beginning.   duration: [s], without the time before it; infinite of a motion that does not end.
    """

    time: Any  # float; of the kinds that are a few numbers perhaps a Batch
    duration: Any

    @property
    @abstractmethod
    def n(self) -> int:
        """Number of joints."""

    @property
    def breaks(self) -> np.ndarray:
        """(k,) [s] times, increasing, at which a higher derivative may jump; the first is `time`, the last the end."""
        return np.array([self.time] if np.isinf(self.duration) else [self.time, self.time + self.duration], dtype=float)

    @abstractmethod
    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s], a number or a symbol."""

    def at(self, t: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, q̇ and q̈, each (…, n) [rad | m, …/s, …/s²], at times t (…) [s]; of a motion without batches."""
        times = np.asarray(t, dtype=float)
        if not times.size:
            empty = np.zeros((*times.shape, self.n))
            return empty, empty, empty
        program = trace("motion", lambda x: np.concatenate(self(x[0])), {"t": (1,)}, ("motion",))
        rows = np.asarray(interpret(program, times.reshape(-1, 1))).reshape(*times.shape, 3, self.n)
        return rows[..., 0, :], rows[..., 1, :], rows[..., 2, :]

"""Motions: positions, speeds and accelerations of all joints over time; base of every reference in this package."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Self, overload

import numpy as np

from armwright.entry import AnyArm, as_arm
from armwright.program import interpret, trace
from armwright.scalar import Array, Scalar

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from armwright.model import Model


class Motion(ABC):
    """Motion of n joints from `time` on for `duration`; the arm stands before and after.

    A subclass is a frozen dataclass that has `n`, `duration` and `__call__`. A loop takes all ticks of a motion without
    batches from `at` at once.

    Attributes:
        time: [s] of the beginning.   duration: [s], without the time before it; infinite of a motion that does not end.
        payloads: bodies that the hand takes up and puts down on the way, which a simulation that follows the motion has too.
        file: path of the motion file or the rows that it was read from; None of others.
    """

    time: Any  # float; of the kinds that are a few numbers perhaps a Batch
    duration: Any
    payloads: Any = ()
    file: Any = None

    def __repr__(self) -> str:
        """Kind, joints and duration; kinds that are a few numbers have the call that makes them."""
        return f"<{type(self).__name__} of {self.n} joints, {self.duration:.4g} s>"

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
        """q, q̇ and q̈, each (…, n) [rad | m, …/s, …/s²], at times t (…) [s], NaN at those that are NaN; without batches."""
        times = np.asarray(t, dtype=float)
        q, qd, qdd = self._at(times)
        unknown = np.isnan(times)[..., None]
        if unknown.any():  # clipped and compared, they would be times of rest
            q, qd, qdd = (np.where(unknown, np.nan, each) for each in (q, qd, qdd))
        return q, qd, qdd

    def _at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, q̇ and q̈, each (…, n), at times (…) [s] that may have any values at NaN: all of `at` that kinds differ in."""
        if not times.size:
            empty = np.zeros((*times.shape, self.n))
            return empty, empty, empty
        program = trace("motion", lambda x: np.concatenate(self(x[0])), {"t": (1,)}, ("motion",))
        rows = np.asarray(interpret(program, times.reshape(-1, 1))).reshape(*times.shape, 3, self.n)
        return rows[..., 0, :], rows[..., 1, :], rows[..., 2, :]

    def dataset(self, arm: Model, rate: float = 500.0, payload: Any = None) -> xr.Dataset:
        """Rows of the motion like those of a run: q, qd, qdd and, if the record is complete enough, torques and voltages.

        Args:
            arm: whose joints move.   rate: rows in a second [1/s]; the breaks of the motion are rows too.
            payload: bodies in the hand, each from its time on.
        Raises:
            ScenarioError: a motion of other joints, or one that does not end.
        """
        from armwright.trajectory.motion_rows import motion_dataset  # xarray takes a while to import

        return motion_dataset(arm, self, rate, payload)

    def save(self, arm: AnyArm, path: str | os.PathLike[str], rate: float = 500.0) -> None:
        """Writes the motion as .csv (t, q, qd, qdd of every joint) or .nc, for `load_motion`.

        Args:
            arm: whose joints move.   path: the file, replaced as a whole.   rate: rows in a second [1/s].
        Raises:
            ScenarioError: a motion of other joints, or one that does not end.   OutputError: it cannot be written.
        """
        from armwright.trajectory.motion_rows import save_motion

        save_motion(as_arm(arm), self, path, rate)

    def from_file(self, path: str | os.PathLike[str]) -> Self:
        """The motion, which knows from now on the file that it was read from."""
        object.__setattr__(self, "file", os.fspath(path))
        return self

    @overload
    def plot(self, arm: AnyArm, path: None = None, payload: Any = None) -> Figure: ...

    @overload
    def plot(self, arm: AnyArm, path: str | os.PathLike[str], payload: Any = None) -> None: ...

    def plot(self, arm: AnyArm, path: str | os.PathLike[str] | None = None, payload: Any = None) -> Figure | None:
        """Figure of positions, speeds, accelerations, torques and voltages, written to a path if one is given.

        Args:
            arm: whose joints move.   path: .png, .svg, .pdf, or .html to zoom into; None: the figure is returned.
            payload: bodies in the hand, each from its time on.
        Raises:
            ScenarioError: a motion of other joints, or one that does not end.   OutputError: it cannot be written.
        """
        from armwright.trajectory.motion_rows import plot_motion

        return plot_motion(as_arm(arm), self, path, payload)

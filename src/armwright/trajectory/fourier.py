"""A periodic motion: a finite Fourier series for each joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.parameters import Draw, Numbers, numbers_by_lane
from armwright.scalar import Array, Scalar
from armwright.trajectory.motion import Motion
from armwright.trajectory.poses import LARGEST, check_number, check_poses, joint_count


@dataclass(frozen=True, eq=False)
class Fourier(Motion):
    """q(t) = centre + Σ_k (sine_k sin kωs + cosine_k cos kωs),  ω = 2π / cycle, s = t - time.  [SweversEtAl1997]

    Before `time` the arm stands at q(time), and after `cycles` cycles too; speed and acceleration are then 0. A motion that
    starts and ends at rest is made by `Fourier.at_rest`: Σ k sine_k = 0 and Σ k² cosine_k = 0.

    Each field but `cycles` may be a `Batch`.

    Args:
        centre: (n,) [rad | m].   sine, cosine: (n, harmonics) [rad | m].   cycle: [s] after which it repeats itself.
        time: [s] of its beginning.   cycles: number of them; None: it goes on for good.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> sine, cosine = [[0.2], [0.1]], [[0.0], [0.1]]  # a row for each joint
        >>> motion = aw.trajectories.Fourier([0.0, 0.0], sine, cosine, cycle=4.0)
        >>> motion.at(1.0)[0].round(3)
        array([0.2, 0.1])
    """

    centre: Numbers
    sine: Numbers
    cosine: Numbers
    cycle: float
    time: float = 0.0
    cycles: int | None = None

    def __post_init__(self) -> None:
        check_poses("Fourier", centre=self.centre)
        check_number("Fourier", "cycle", self.cycle, above=0.0)
        check_number("Fourier", "time", self.time)
        if self.cycles is not None:
            check_number("Fourier", "cycles", self.cycles, above=0.0)
        shapes = {name: _coefficients(name, getattr(self, name)) for name in ("sine", "cosine")}
        shapes = {name: shape for name, shape in shapes.items() if shape}
        joints = None if isinstance(self.centre, Draw) else numbers_by_lane(self.centre).shape[-1]
        for name, shape in shapes.items():
            if joints not in (None, shape[0]) or shape != next(iter(shapes.values())):
                expected = f"({shape[0] if joints is None else joints}, harmonics), as many of sine as of cosine"
                raise ScenarioError(f"shape {shape}", place=f"Fourier.{name}", expected=expected)

    @classmethod
    def at_rest(
        cls, centre: Any, sine: Any, cosine: Any, cycle: float, time: float = 0.0, cycles: int | None = None
    ) -> Fourier:
        """The nearest series whose speed and acceleration are 0 at the beginning and the end of each cycle.

        Args:
            centre, sine, cosine, cycle, time, cycles: as of `Fourier`; of each joint two harmonics or more.
        Raises:
            ScenarioError: names the field, its value and what was expected.
        """
        series = cls(centre, sine, cosine, cycle, time, cycles)
        coefficients = [np.asarray(series.sine, dtype=float), np.asarray(series.cosine, dtype=float)]
        rows = rest_rows(coefficients[0].shape[1])
        sine, cosine = (a - np.outer(a @ row, row) / (row @ row) for a, row in zip(coefficients, rows, strict=True))
        return cls(centre, sine, cosine, cycle, time, cycles)

    @property
    def n(self) -> int:
        """Number of joints."""
        return joint_count(self.centre)

    @property
    def duration(self) -> float:
        """Duration of the motion [s], without the time before it; infinite for an endless one."""
        return np.inf if self.cycles is None else self.cycles * self.cycle

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s]."""
        centre, sine, cosine = (scalar.array(each) for each in (self.centre, self.sine, self.cosine))
        s, w = scalar.maximum(t - self.time, 0.0), 2.0 * np.pi / self.cycle
        moving = scalar.less_equal(self.time, t)
        if self.cycles is not None:
            end = self.cycles * self.cycle
            s, moving = scalar.minimum(s, end), moving * scalar.less_equal(t, self.time + end)
        q, qd, qdd = centre, 0.0 * centre, 0.0 * centre
        for k in range(1, sine.shape[1] + 1):
            a, b = sine[:, k - 1], cosine[:, k - 1]
            sin, cos = scalar.sin(k * w * s), scalar.cos(k * w * s)
            q = q + sin * a + cos * b
            qd = qd + k * w * (cos * a - sin * b)
            qdd = qdd - (k * w) ** 2 * (sin * a + cos * b)
        return scalar.array(q), scalar.array(moving * qd), scalar.array(moving * qdd)

    def _at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        s = np.clip(times - self.time, 0.0, self.duration)[..., None]
        moving = ((times >= self.time) & (times <= self.time + self.duration))[..., None]
        q, qd, qdd = series_matrices(np.asarray(self.sine).shape[1], self.cycle, s)
        coefficients = np.concatenate([np.asarray(self.sine), np.asarray(self.cosine)], axis=1).T
        return q @ coefficients + np.asarray(self.centre), moving * (qd @ coefficients), moving * (qdd @ coefficients)


def _coefficients(name: str, value: Any) -> tuple[int, ...] | None:
    """Shape (n, harmonics) of one lane's coefficients; None of draws, which are checked when they are drawn."""
    if isinstance(value, Draw):
        return None
    try:
        rows = numbers_by_lane(value)
    except ValueError:
        rows = np.zeros(0)
    if rows.ndim != 3 or not rows.size or not (np.abs(rows) < LARGEST).all():
        raise ScenarioError(place=f"Fourier.{name}", value=value, expected="finite numbers (n, harmonics)")
    return rows.shape[1:]


def rest_rows(harmonics: int) -> np.ndarray:
    """(2, harmonics) rows c of the conditions of rest:  c₀ · sine = 0 (no speed)  and  c₁ · cosine = 0 (no acceleration)."""
    k = np.arange(1.0, harmonics + 1.0)
    return np.stack([k, k * k])


def series_matrices(harmonics: int, cycle: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values of sines and cosines and their first and second derivatives, each (…, 2 harmonics).

    Args:
        harmonics: how many.   cycle: [s].   t: (…, 1) [s].
    """
    w = 2.0 * np.pi / cycle * np.arange(1.0, harmonics + 1.0)
    sin, cos = np.sin(w * t), np.cos(w * t)
    return (
        np.concatenate([sin, cos], axis=-1),
        np.concatenate([w * cos, -w * sin], axis=-1),
        np.concatenate([-w * w * sin, -w * w * cos], axis=-1),
    )

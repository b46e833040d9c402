"""Random limits and checks that every planned motion has to pass."""

from __future__ import annotations

import numpy as np

import armwright as aw
from armwright.trajectory.limits_report import dense_times

DENSER = 10  # times as many points as a report has between two breaks


def limits_of(
    velocity, acceleration=np.inf, jerk=np.inf, position=np.inf, n: int | None = None
) -> aw.trajectories.MotionLimits:
    """Limits without an arm."""
    n = n or max(np.size(velocity), np.size(acceleration), np.size(jerk), 1)
    low_high = np.broadcast_to(position, (n, 2)) if np.ndim(position) else np.tile([-position, position], (n, 1))
    names = tuple(f"joint{k + 1}" for k in range(n))
    each = [np.broadcast_to(np.asarray(a, dtype=float), (n,)) for a in (velocity, acceleration, jerk, np.inf, np.inf)]
    return aw.trajectories.MotionLimits(np.asarray(low_high, dtype=float), *each, names, (False,) * n)


def random_limits(draw: np.random.Generator, n: int) -> aw.trajectories.MotionLimits:
    """Speeds, accelerations and jerks over three decades."""
    return limits_of(*(10.0 ** draw.uniform(-1.0, 2.0, size=(3, n)) * np.array([[0.3], [1.0], [10.0]])))


def check_within(motion: aw.trajectories.Motion, limits: aw.trajectories.MotionLimits, *quantities: str) -> None:
    """Limits on a grid ten times as dense as a report's, to 1e-6."""
    t = dense_times(motion, DENSER * 10)
    q, qd, qdd = motion.at(t)
    values = {"velocity": qd, "acceleration": qdd}
    polynomial = getattr(motion, "polynomial", motion)
    if isinstance(polynomial, aw.trajectories.PiecewisePolynomial):
        values["jerk"] = polynomial.derivative().derivative().at(t)[1]
    else:  # closed forms: differences, which are coarser
        steps = np.diff(t)[:-1, None]
        values["jerk"] = np.diff(qdd[:-1], axis=0) / steps / (1.0 + 1e-4)
    for quantity in quantities:
        if quantity != "position":
            assert (np.abs(values[quantity]).max(axis=0) <= getattr(limits, quantity) * (1.0 + 1e-6)).all(), quantity
    low, high = limits.position.T
    assert ((q >= low - 1e-9) & (q <= high + 1e-9)).all()


def check_continuous(motion: aw.trajectories.Motion, derivatives: int) -> None:
    """No jump of q, qd, … at any break, but for rounding; `derivatives` of them."""
    breaks = np.asarray(motion.breaks)[1:-1]
    left, right = motion.at(np.nextafter(breaks, -np.inf)), motion.at(breaks)
    t = dense_times(motion, 20)
    shortest, rounding = np.diff(motion.breaks).min(), 0.0
    for before, after, rows in list(zip(left, right, motion.at(t), strict=True))[:derivatives]:
        # a rounding of time or of the derivative below is one of this derivative too
        size = np.abs(rows).max()
        np.testing.assert_allclose(before, after, rtol=0.0, atol=1e-9 * (size + 1e-12) + rounding)
        rounding = max(rounding, 1e-14 * size) / shortest

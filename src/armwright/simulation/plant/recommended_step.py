"""A step to recommend: accurate, of a length that people write, and a whole part of the times that it must divide."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import floor, log10

import numpy as np

from armwright.scalar import Array
from armwright.simulation.integrate.exponential import Split
from armwright.simulation.integrate.integrators import Integrator

WRONG = 0.01  # of the state after a step: rk3 follows a first-order lag of time constant T, or a swing of 1/T rad/s, to 0.7 T
WRITTEN = (5.0, 2.0, 1.0)  # times a power of ten
DECADES = 9  # below the largest step that are tried
WHOLE = 1e-6  # of a step: this near to a whole number of steps is one

Step = Callable[[float], np.ndarray]  # [s] → (size, size) matrix that takes a linear plant one step further


def step_of(integrator: Integrator, slope: np.ndarray, rate: np.ndarray, stiff: Sequence[int], u: np.ndarray) -> Step:
    """Step of a linear plant by a rule.

    Args:
        integrator: with the pairs of the plant's positions and speeds.   slope: (size, size) ∂(dx/dt)/∂x.
        rate: (k,) λ [1/s] of the entries at the places `stiff`, which are integrated exactly.   u: commands, held.
    """
    one = np.eye(len(slope))
    if not stiff:
        return lambda h: integrator.step(lambda x, u: slope @ x, one, u, h)
    split = Split.of(partial(_linear, slope, rate[:, None]), stiff)
    return lambda h: integrator.exponential(split, one, u, h)


def recommended_step(slope: np.ndarray, step: Step, largest: float, whole: Sequence[float] = ()) -> float:
    """The largest step [s] of 1, 2 or 5 times a power of ten that is wrong by at most `WRONG` of the state.

    The state is scaled so that rows and columns of the slope are alike in size, which makes the error free of units.

    Args:
        slope: (size, size) ∂(dx/dt)/∂x of a linear plant.   step: the rule's own.   largest: [s] that may be recommended.
        whole: [s] times that hold a whole number of steps; an equal part of the first where no step of 1, 2 or 5 divides all.
    """
    from scipy.linalg import expm, matrix_balance  # slow to import, and a step that is short enough needs none

    balanced, (scale, _) = matrix_balance(slope, permute=False, separate=True)

    def accurate(h: float) -> bool:
        error = step(h) * (scale / scale[:, None]) - expm(h * balanced)
        return bool(np.linalg.norm(error, 2) <= WRONG)

    return next((h for h in written_steps(largest, whole) if accurate(h)), written_step(largest, whole))


def written_step(largest: float, whole: Sequence[float] = ()) -> float:
    """The largest step [s] up to `largest` that `written_steps` has."""
    return next(iter(written_steps(largest, whole)))


def written_steps(largest: float, whole: Sequence[float] = ()) -> list[float]:
    """Steps [s] of 1, 2 or 5 times a power of ten up to `largest` that divide all those times, the largest first.

    Where none does, as of a period of 1/3 ms, equal parts of the first of these times, in such numbers.
    """
    top = floor(log10(largest))
    written = [float(f"{digit:g}e{k}") for k in range(top, top - DECADES, -1) for digit in WRITTEN]
    fitting = [h for h in written if h <= largest and all(_divides(h, time) for time in whole)]
    if fitting or not whole:
        return fitting
    counts = [digit * 10.0**k for k in range(DECADES) for digit in sorted(WRITTEN)]
    return [whole[0] / count for count in counts if count >= whole[0] / largest]


def _divides(step: float, time: float) -> bool:
    return round(time / step) >= 1 and abs(round(time / step) * step - time) <= WHOLE * step


def _linear(slope: np.ndarray, rate: np.ndarray, x: Array, u: Array) -> tuple[np.ndarray, np.ndarray]:
    """A linear plant, columns of x side by side."""
    return slope @ x, rate

"""Step control: how wrong a trial step is in units of what is allowed, and how long the next trial should be.

A rule gives the state after a step and an estimate e of its error, which shrinks with a power of the step. What each entry
of the state may be wrong by follows either from its size, or from its range: how far it has been from its start in the
lane's own run. The norm and the next step's length are those of [HairerNorsettWanner1993], II.4.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.scalar import Array, Scalar
from armwright.signals import Layout

SAFETY, SHRINK, GROW = 0.9, 0.2, 5.0  # of the step that would just do; and the most that a step changes
LEAST_ERROR = 1e-10  # in units of what is allowed: below it a step grows as much as it may anyway
SHARE = 0.03  # of the accuracy of a whole run, for the estimate of one step in a sampled loop
BUDGET = 0.03  # of the accuracy of a whole run, for the estimates of all its steps together where nothing is sampled
ROUNDING = 1e-15  # of a range: an estimate below it is none
FLOORS = {  # the least range of a quantity by its unit: what moves by less is as accurate as if it moved by that
    "rad": 1e-3,
    "m": 1e-4,
    "rad/s": 1e-2,
    "m/s": 1e-3,
    "A": 1e-2,
    "V": 1e-2,
    "1": 1e-3,
    "rad s": 1e-3,
    "°C": 1e-1,
}


@dataclass(frozen=True)
class Allowed:
    """Allowed error of a step: atol + rtol |x|, or a share of each quantity's range for a given accuracy.

    Attributes:
        rtol, atol: of each entry of the state, in its own unit.
        accuracy: of a run, in parts of every quantity's range; None: rtol and atol count.
    """

    rtol: float
    atol: float
    accuracy: float | None = None

    @property
    def attributes(self) -> dict[str, float]:
        """Attributes of a run about the allowed error."""
        return {"rtol": self.rtol, "atol": self.atol} if self.accuracy is None else {"accuracy": self.accuracy}

    def share(self, x: Array, new: Array, error: Array) -> Scalar:
        """Root mean square of the errors (nx,) of a step from x to `new`, in units of what is allowed; 1 or less is good."""
        allowed = self.atol + self.rtol * scalar.maximum(scalar.abs(x), scalar.abs(new))
        shares = error / allowed
        return scalar.sqrt(sum(entry * entry for entry in shares) / len(shares))

    def of_step(self, horizon: float | None) -> float:
        """Permitted error of a step, in parts of a range; with a horizon [s], that of one second of steps."""
        assert self.accuracy is not None
        return SHARE * self.accuracy if horizon is None else BUDGET * self.accuracy / horizon


def share_of_range(error: Array, ranges: Array, places: Sequence[int], part: Scalar) -> tuple[Scalar, Scalar]:
    """The largest error of a step in units of what its entry may be wrong by, NaN if any is not finite; and its place.

    An entry may be wrong by that part of its range.
    Of two entries, a/b and c/d are compared as a d and c b, so that one division is enough for all.
    """
    errors = scalar.abs(error)
    largest, beside, worst = errors[0], ranges[0], float(places[0])
    for k in range(1, len(errors)):
        more = scalar.less(largest * ranges[k], errors[k] * beside)
        largest, beside = scalar.where(more, errors[k], largest), scalar.where(more, ranges[k], beside)
        worst = scalar.where(more, float(places[k]), worst)
    # Comparisons lose a NaN, and an infinite range hides its error: the sum keeps both.
    finite = scalar.less_equal(sum(errors) + sum(ranges), sys.float_info.max)
    return scalar.where(finite, largest / (part * beside), np.nan), worst


def quick_growth(share: Scalar) -> Scalar:
    """`growth` at less cost: by the fourth root of an error that is small, and the square root of one that is too large."""
    root = scalar.sqrt(share + LEAST_ERROR)
    return scalar.clip(SAFETY / scalar.where(scalar.less(1.0, root), root, scalar.sqrt(root)), SHRINK, GROW)


def growth(share: Scalar, order: int) -> Scalar:
    """Factor by which the next step, or another trial of this one, should be longer, for an error that shrinks with h^order."""
    grow = SAFETY * scalar.exp((-1.0 / order) * scalar.log(share + LEAST_ERROR))
    return scalar.clip(grow, SHRINK, GROW)


def floors(layout: Layout) -> np.ndarray:
    """The least range (nx,) of every entry of a state, each in its own unit."""
    return np.array([FLOORS[unit] for signal in layout for unit in signal.units])

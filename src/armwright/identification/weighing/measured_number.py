"""A number that follows from readings by a formula, with the uncertainty of each reading propagated. [JCGM100]

u²(y) = Σ (∂f/∂x_i)² u²(x_i)      for y = f(x_1, x_2, …) and readings that do not depend on each other
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from armwright import scalar
from armwright.errors import IdentificationError
from armwright.identification.estimate import HALF_95
from armwright.results.result import Result
from armwright.results.table import Table, number
from armwright.scalar import real_number

ValueWithStd: TypeAlias = Any  # a number, or (value, standard deviation)


@dataclass(frozen=True)
class MeasuredNumber(Result):
    """A measured number with its standard deviation, and the share that each reading has in its variance.

    Attributes:
        quantity: what it is.   value, std: in `unit`.   unit: of both.   how: the formula and the readings, in one line.
        readings: name, value, standard deviation and share of the variance (0 to 1) of each.
        freedom: degrees of freedom of std: few where it is known from the scatter of a few readings alone.
    """

    quantity: str
    value: float
    std: float
    unit: str
    how: str
    readings: tuple[tuple[str, float, float, float], ...]
    freedom: float = np.inf

    @property
    def interval(self) -> tuple[float, float]:
        """Bounds of the 95 % interval, for normal errors: Student's t of the degrees of freedom. [JCGM100], annex G."""
        half = HALF_95
        if np.isfinite(self.freedom):
            from scipy.stats import t  # which takes long to import

            half = float(t.ppf(0.975, self.freedom))
        return self.value - half * self.std, self.value + half * self.std

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.quantity} = {self.value:.6g} ± {self.std:.2g} {self.unit}"

    def tables(self) -> list[Table]:
        """Readings and what their deviations contribute."""
        rows = [
            [name, number(v), number(s, ".3g"), number(100.0 * share, ".3g")] for name, v, s, share in self.readings
        ]
        return [Table(self.heading, ("reading", "value", "± std", "share of the variance [%]"), rows)]

    def sentences(self) -> list[str]:
        """The 95 % interval and the formula."""
        low, high = self.interval
        said = (
            f"95 %: {low:.6g} to {high:.6g} {self.unit}" if self.std > 0.0 else "no reading has a deviation, nor has it"
        )
        return [said, self.how]


def reading_of(
    place: str, reading: ValueWithStd, lowest: float = -np.inf, above: float = -np.inf
) -> tuple[float, float]:
    """Value and standard deviation of a reading.

    Args:
        place: its name.   reading: a number, which counts as exact, or (value, standard deviation).
        lowest: of the value.   above: the value is larger than that.
    Raises:
        IdentificationError: something else.
    """
    expected = "a number, or (value, standard deviation)"
    pair = tuple(reading) if isinstance(reading, (list, tuple, np.ndarray)) else (reading, 0.0)
    if len(pair) != 2:
        raise IdentificationError(place=place, value=reading, expected=expected)
    value, std = (real_number(each) for each in pair)
    if value is None or std is None or not np.isfinite([value, std]).all():
        raise IdentificationError(place=place, value=reading, expected=expected)
    if std < 0.0:
        raise IdentificationError(place=place, value=reading, expected="a standard deviation of 0 or more")
    if value < lowest or value <= above:
        expected = f"a value of {lowest:g} or more" if value < lowest else f"a value above {above:g}"
        raise IdentificationError(place=place, value=reading, expected=expected)
    return value, std


def propagated(
    quantity: str, unit: str, how: str, formula: Callable[..., Any], readings: Mapping[str, tuple[float, float]]
) -> MeasuredNumber:
    """The number that a formula makes of readings, and its deviation.

    Args:
        quantity, unit, how: as of `MeasuredNumber`.   formula: of the readings, in their order; it may be traced.
        readings: value and standard deviation by name.
    """
    values, stds = np.array([*readings.values()], dtype=float).T
    slopes = np.asarray(scalar.jacobian(lambda x: scalar.array([formula(*x)]), values), dtype=float)[0]
    parts = (slopes * stds) ** 2
    variance = float(parts.sum())
    shares = parts / variance if variance > 0.0 else np.zeros_like(parts)
    rows = zip(readings, values.tolist(), stds.tolist(), shares.tolist(), strict=True)
    return MeasuredNumber(quantity, float(formula(*values)), float(np.sqrt(variance)), unit, how, tuple(rows))

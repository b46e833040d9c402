"""Search space of gains: one value for each joint, logarithmic between bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError, check_known
from armwright.parameters import Batch
from armwright.simulation.scenario import Scenario

FACTOR = 10.0  # to either side of the start, where nothing else is said
DIGITS = 4  # of a gain; it is judged as it is written


@dataclass(frozen=True, eq=False)
class GainSpace:
    """Gains between bounds, as points x in [0, 1]^k:  g = low (high / low)^x.

    Attributes:
        control: the controller.   names: of its gains, in the order of its fields.   n: joints.
        start, low, high: (gains * n,) one gain after the other; entries that are 0 at the start stay 0.
    """

    control: Any
    names: tuple[str, ...]
    n: int
    start: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, scenario: Scenario, gains: Mapping[str, Any] | None) -> GainSpace:
        """The search space around a scenario's own gains.

        Args:
            scenario: with a controller.   gains: by name, a factor to either side or (low, high); None: all usual ones.
        Raises:
            ScenarioError: no controller, names that are no gains of it, bounds that do not hold the start.
        """
        control = scenario.controller
        if control is None:
            raise ScenarioError("has no controller", place="loop", expected="a scenario with a loop and its controller")
        n, own = scenario.arm.n, _numbers(control, scenario.arm.n)
        if gains is None:
            gains = {name: FACTOR for name in own if name.endswith(("kp", "ki", "kd")) and own[name].any()}
        if not isinstance(gains, Mapping) or not gains:
            raise ScenarioError(place="gains", value=gains, expected="bounds by name", choices=tuple(own))
        for name in gains:
            check_known(ScenarioError, name, own, "no gain of the controller", place="gains")
        names = tuple(name for name in own if name in gains)
        ends = [_bounds(name, gains[name], own[name]) for name in names]
        low, high = (np.concatenate([each[k] for each in ends]) for k in (0, 1))
        return cls(control, names, n, np.concatenate([own[name] for name in names]), low, high)

    @property
    def free(self) -> np.ndarray:
        """(gains * n,) True for the gains to search."""
        return self.start > 0.0

    def point(self, row: np.ndarray) -> np.ndarray:
        """(k,) point of gains (gains * n,)."""
        one = self.free
        return np.log(row[one] / self.low[one]) / np.log(self.high[one] / self.low[one])

    def gains(self, x: np.ndarray) -> np.ndarray:
        """(candidates, gains * n) of points (candidates, k), rounded to `DIGITS` digits."""
        one, rows = self.free, np.tile(self.start, (len(x), 1))
        values = self.low[one] * (self.high[one] / self.low[one]) ** x
        rows[:, one] = rounded(values)
        return np.clip(rows, self.low, self.high)

    def by_name(self, row: np.ndarray) -> dict[str, np.ndarray]:
        """One row of gains (gains * n,) as {name: (n,)}."""
        return dict(zip(self.names, row.reshape(len(self.names), self.n), strict=True))

    def controller(self, rows: np.ndarray) -> Any:
        """The controller with gains (lanes, gains * n), one row a lane; or with one row (gains * n,)."""
        parts = np.split(rows, len(self.names), axis=-1)
        values = {name: Batch(part) if rows.ndim == 2 else part for name, part in zip(self.names, parts, strict=True)}
        return replace(self.control, **values)


def rounded(values: np.ndarray) -> np.ndarray:
    """Gains of any shape with `DIGITS` digits."""
    return np.array([float(f"{value:.{DIGITS}g}") for value in values.ravel()]).reshape(values.shape)


def _numbers(control: Any, n: int) -> dict[str, np.ndarray]:
    """Gains of a controller by name, (n,) each: its fields that are numbers of 0 or more and no counts of ticks."""
    found: dict[str, np.ndarray] = {}
    for each in fields(control) if is_dataclass(control) else ():
        value = getattr(control, each.name)
        if isinstance(value, (bool, int)) and isinstance(each.default, int) and not each.name.endswith(("p", "i", "d")):
            continue
        if isinstance(value, (int, float, list, tuple, np.ndarray)) and not isinstance(value, bool):
            try:
                numbers = scalar.real_numbers(value)
            except ValueError:
                continue
            if numbers.shape in ((), (n,)) and np.isfinite(numbers).all() and (numbers >= 0.0).all():
                found[each.name] = np.array(np.broadcast_to(numbers, (n,)), dtype=float)
    if not found:
        raise ScenarioError(
            "has no gains", place="loop.controller", expected="fields that are numbers, one for all lanes"
        )
    return found


def _bounds(name: str, asked: Any, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds (n,) of a gain whose start is `own` (n,)."""
    place, n = f"gains[{name!r}]", len(own)
    if not own.any():
        raise ScenarioError("is 0 at the start", place=place, expected="a start above 0 for a joint at least")
    factor = scalar.real_number(asked)
    if factor is not None:
        if not 1.0 < factor < np.inf:
            raise ScenarioError(place=place, value=asked, expected="a factor above 1, or (low, high)")
        return own / factor, own * factor
    try:
        low, high = (np.broadcast_to(scalar.real_numbers(end), (n,)) for end in asked)
    except (TypeError, ValueError):
        raise ScenarioError(place=place, value=asked, expected="a factor above 1, or (low, high)") from None
    one = own > 0.0
    if not ((low > 0.0) & (low < high) & np.isfinite(high)).all():
        raise ScenarioError(place=place, value=asked, expected="0 < low < high")
    if not ((low <= own) & (own <= high))[one].all():
        what = f"the start {', '.join(f'{value:g}' for value in own)} lies outside"
        raise ScenarioError(what, place=place, value=asked, expected="bounds that hold the start")
    return np.where(one, low, 0.0), np.where(one, high, 0.0)

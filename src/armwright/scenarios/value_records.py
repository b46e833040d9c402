"""Numbers of scenario files, and values of a number in the lanes."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, Strict, model_validator

from armwright.parameters import Draw
from armwright.quantity import Record, optional

MOST_LANES = 10**8
Number = Annotated[float, Strict()]  # no text, and no true or false
Whole = Annotated[int, Strict()]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Numbers = tuple[Number, ...]


def counted(count: int, description: str) -> BeforeValidator:
    """Refuses a list of another length, in words."""

    def check(value: Any) -> Any:
        if isinstance(value, (list, tuple)) and len(value) != count:
            raise ValueError(f"expected {count} numbers, not {len(value)}: {description}")
        return value

    return BeforeValidator(check)


Pair = Annotated[tuple[Number, Number], counted(2, "where it is, and how wide it spreads")]
Bounds = Annotated[tuple[Number, Number], counted(2, "a lower and an upper bound")]


class LaneValues(Record):
    """Values of one number in the lanes, in one of these ways."""

    values: Numbers | None = optional("These, one a lane (or one a row of the grid).", min_length=1)
    start: Number | None = optional("From here …")
    stop: Number | None = optional("… to here …")
    count: Whole | None = optional("… in so many equal steps.", ge=1, le=MOST_LANES)
    normal: Pair | None = optional("Drawn: mean and standard deviation.")
    uniform: Bounds | None = optional("Drawn evenly between two bounds.")
    lognormal: Pair | None = optional("Drawn: median, and standard deviation of the logarithm.")

    @model_validator(mode="after")
    def _one_way(self) -> LaneValues:
        line = [name for name in ("start", "stop", "count") if getattr(self, name) is not None]
        if line and len(line) != 3:
            raise ValueError("start, stop and count go together")
        ways = [name for name in ("values", "normal", "uniform", "lognormal") if getattr(self, name) is not None]
        ways += ["start"] if line else []
        if len(ways) != 1:
            listed = " and ".join(ways) or "none"
            raise ValueError(
                f"expected one of values, start with stop and count, normal, uniform, lognormal, not {listed}"
            )
        for name in ("normal", "lognormal"):
            pair = getattr(self, name)
            if pair is not None and pair[1] < 0:
                raise ValueError(f"{name} = {list(pair)}: expected a standard deviation of 0 or more")
        if self.uniform is not None and not 0.0 <= self.uniform[1] - self.uniform[0] < np.inf:
            raise ValueError(
                f"uniform = {list(self.uniform)}: expected a lower and then an upper bound, a finite way apart"
            )
        return self

    @property
    def drawn(self) -> bool:
        """True for random values."""
        return self.values is None and self.start is None

    @property
    def size(self) -> int:
        """Number of values in the file."""
        return len(self.values) if self.values is not None else self.count or 1

    def listed(self) -> np.ndarray:
        """The values, where they are stated."""
        if self.values is not None:
            return np.array(self.values)
        return np.linspace(self.start or 0.0, self.stop or 0.0, self.count or 1)

    def draw(self) -> Draw:
        """The distribution, where chance has a say."""
        if self.normal is not None:
            return Draw.normal(*self.normal)
        if self.uniform is not None:
            return Draw.uniform(*self.uniform)
        assert self.lognormal is not None
        return Draw.lognormal(*self.lognormal)

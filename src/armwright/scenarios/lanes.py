"""Many runs from one file: numbers of it that take a list of values, a grid of them, or random draws."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, Strict, model_validator

from armwright.errors import ScenarioError
from armwright.parameters import Batch, Draw, lane_values
from armwright.quantity import Record

MOST_LANES = 10**8
Number = Annotated[float, Strict()]  # no text, and no true or false
Whole = Annotated[int, Strict()]
Numbers = tuple[Number, ...]


def counted(count: int, told: str) -> BeforeValidator:
    """Refuses a list of another length, in words."""

    def check(value: Any) -> Any:
        if isinstance(value, (list, tuple)) and len(value) != count:
            raise ValueError(f"expected {count} numbers, not {len(value)}: {told}")
        return value

    return BeforeValidator(check)


Pair = Annotated[tuple[Number, Number], counted(2, "where it is, and how wide it spreads")]
Bounds = Annotated[tuple[Number, Number], counted(2, "a lower and an upper bound")]


class Values(Record):
    """What one number is in the lanes: one of these ways."""

    values: Numbers | None = Field(
        default=None, min_length=1, description="These, one a lane (or one a row of the grid)."
    )
    start: Number | None = Field(default=None, description="From here …")
    stop: Number | None = Field(default=None, description="… to here …")
    count: Whole | None = Field(default=None, ge=1, le=MOST_LANES, description="… in so many equal steps.")
    normal: Pair | None = Field(default=None, description="Drawn: mean and standard deviation.")
    uniform: Bounds | None = Field(default=None, description="Drawn evenly between two bounds.")
    lognormal: Pair | None = Field(default=None, description="Drawn: median, and standard deviation of the logarithm.")

    @model_validator(mode="after")
    def _one_way(self) -> Values:
        line = [name for name in ("start", "stop", "count") if getattr(self, name) is not None]
        if line and len(line) != 3:
            raise ValueError("start, stop and count go together")
        ways = [name for name in ("values", "normal", "uniform", "lognormal") if getattr(self, name) is not None]
        ways += ["start"] if line else []
        if len(ways) != 1:
            told = " and ".join(ways) or "none"
            raise ValueError(
                f"expected one of values, start with stop and count, normal, uniform, lognormal, not {told}"
            )
        for name in ("normal", "lognormal"):
            given = getattr(self, name)
            if given is not None and given[1] < 0:
                raise ValueError(f"{name} = {list(given)}: expected a standard deviation of 0 or more")
        if self.uniform is not None and not 0.0 <= self.uniform[1] - self.uniform[0] < np.inf:
            raise ValueError(
                f"uniform = {list(self.uniform)}: expected a lower and then an upper bound, a finite way apart"
            )
        return self

    @property
    def drawn(self) -> bool:
        """Whether chance has a say."""
        return self.values is None and self.start is None

    @property
    def size(self) -> int:
        """How many values are stated."""
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


class Lanes(Record):
    """How numbers of the file vary from lane to lane."""

    kind: Literal["list", "grid", "draws"] = Field(
        description="'list': all lists are as long as there are lanes; 'grid': every combination; 'draws': at random."
    )
    count: Whole | None = Field(default=None, ge=1, le=MOST_LANES, description="Lanes to draw; goes with 'draws'.")
    seed: Whole | None = Field(default=None, ge=0, description="Of the draws; goes with 'draws'.")
    vary: dict[str, Values] = Field(
        min_length=1,
        description="By name: 'link6.mass_kg', 'controller.kp[2]', 'timing.command_delay_s', 'initial.q[1]'.",
    )

    @model_validator(mode="after")
    def _complete(self) -> Lanes:
        if (self.kind == "draws") != (self.count is not None) or (self.kind == "draws") != (self.seed is not None):
            raise ValueError("count and seed go with kind = 'draws', which needs both")
        if self.seed is not None and self.seed >= 2**63:
            raise ValueError(f"seed = {self.seed}: expected a whole number, 0 or more, of 63 bits")
        for name, values in self.vary.items():
            if values.drawn and self.kind != "draws":
                raise ValueError(f"{name} is drawn: expected kind = 'draws'")
        lengths = {name: v.size for name, v in self.vary.items() if not v.drawn}
        wanted = {self.count} if self.kind == "draws" else set(lengths.values())
        if self.kind != "grid" and (len(wanted) > 1 or any(length not in wanted for length in lengths.values())):
            told = ", ".join(f"{length} of {name}" for name, length in lengths.items())
            raise ValueError(f"lists of unequal length: {told}")
        if self.kind == "grid" and math.prod(lengths.values()) > MOST_LANES:
            raise ValueError(f"a grid of {math.prod(lengths.values()):.3g} lanes; expected at most {MOST_LANES:.0e}")
        return self

    def columns(self) -> Mapping[str, np.ndarray]:
        """(lanes,) values of every name, in the order of the file. A name's draws depend on the seed, the name and the lane."""
        if self.kind == "grid":
            axes = [values.listed() for values in self.vary.values()]
            grid = np.meshgrid(*axes, indexing="ij")
            return {name: part.ravel() for name, part in zip(self.vary, grid, strict=True)}
        columns: dict[str, np.ndarray] = {}
        for name, values in self.vary.items():
            with np.errstate(over="ignore"):
                drawn = values.draw().batch(self.seed or 0, name, range(self.count or 1)) if values.drawn else None
                columns[name] = values.listed() if drawn is None else drawn.values
            beyond = ~np.isfinite(columns[name])
            if beyond.any():
                lane = int(np.argmax(beyond))
                raise ScenarioError(
                    f"lanes.vary: {name} = {columns[name][lane]:g} in lane {lane}: expected a narrower distribution"
                )
        return columns


def placed(whole: Any, entry: int | None, column: np.ndarray) -> Batch:
    """A number, or one entry of several, that varies; the other entries stay as they are."""
    if entry is None:
        return Batch(column)
    rows = np.asarray(lane_values(whole), dtype=float)
    rows = np.repeat(rows, len(column), axis=0) if len(rows) == 1 else rows.copy()
    rows[:, entry] = column
    return Batch(rows)

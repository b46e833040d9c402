"""A number of a robot, with the source it came from."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import inf, isfinite
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from armwright.validation import Invalid, validated

SourceKind = Literal[
    "drawing",
    "cad",
    "datasheet",
    "measurement",
    "fit",
    "estimate",
    "publication",
    "definition",
    "import",  # another program's file, which does not say where it has its numbers from
]


class Record(BaseModel):
    """A table of a robot file: frozen, and refusing every key it does not know."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=False,
        allow_inf_nan=False,
        protected_namespaces=(),
        defer_build=True,  # a file's own record is built when one is read, and with it all that it holds: once, not each
    )

    def replace(self, **changes: Any) -> Any:
        """A copy with some fields changed, validated like the original.

        Raises:
            DescriptionError: the changed record is invalid.
        """
        fields = {name: getattr(self, name) for name in self.model_fields_set} | changes
        return validated(type(self), fields)


def optional(about: str, **constraints: Any) -> Any:
    """A key that a table may leave out, which is None then.

    Args:
        about: what it is, and what its absence means; for references and schemas.   constraints: as of pydantic's `Field`.
    """
    return Field(default=None, description=about, **constraints)


def check_together(record: Record, *keys: str) -> None:
    """Refuses a record with some but not all of these keys.

    Raises:
        Invalid: names one that is there and those that are missing.
    """
    missing = [key for key in keys if getattr(record, key) is None]
    if missing and len(missing) < len(keys):
        first = next(key for key in keys if key not in missing)
        raise Invalid(f"needs {' and '.join(missing)} beside it", place=first)


def _written_date(value: Any) -> Any:
    """A day, a month or a year as ISO 8601 writes them; TOML's dates need no quotes."""
    if isinstance(value, (datetime.date, datetime.datetime)):
        return value.isoformat()
    if isinstance(value, str):
        first = {4: f"{value}-01-01", 7: f"{value}-01"}.get(len(value), value)
        try:
            datetime.datetime.fromisoformat(first)
        except ValueError:
            raise Invalid(expected="a date such as 2026-05-04, 2026-05 or 2026") from None
    return value


Date = Annotated[str, BeforeValidator(_written_date)]


class Source(Record):
    """Source of numbers: `[sources.KEY]` of a robot file, named elsewhere as `source = "KEY"`."""

    kind: SourceKind = Field(description="What sort of evidence it is.")
    text: str = Field(min_length=1, description="The citation, drawing number or reasoning, for a reader to follow.")
    date: Date | None = optional("When it was measured, drawn or published.")
    licence: str | None = optional("What it may be used under.")
    url: str | None = optional("Where to find it.")


def _spread(value: Any) -> Any:
    """A standard deviation, or one for each of several numbers."""
    numbers = value if isinstance(value, (list, tuple)) else [value]
    if any(_is_number(v) and v < 0 for v in numbers):
        raise Invalid(expected="a standard deviation of 0 or more")
    return value


Spread = Annotated[float | tuple[float, ...], BeforeValidator(_spread)]


class Quantity(Record):
    """A value with its source. In a file either a bare number (the source of the enclosing table holds) or a table.

    `mass_kg = 3.9`  or  `mass_kg = { value = 3.9, std = 0.05, source = "scales", date = "2026-05-04" }`.
    The unit is the ending of the key.
    """

    value: float | tuple[float, ...] | tuple[tuple[float, ...], ...] = Field(
        description="The number, or as many as the key takes."
    )
    std: Spread | None = optional("Standard deviation, same unit.")
    source: str | None = optional("A key of [sources], or a kind of source such as 'estimate'.")
    date: Date | None = optional("When this number was found.")

    @property
    def number(self) -> Any:
        """The one number, or the symbol that stands for it in a trace."""
        return self.value

    @property
    def numbers(self) -> tuple[Any, ...]:
        """The several numbers, or symbols."""
        assert isinstance(self.value, tuple)
        return self.value

    def __float__(self) -> float:
        if isinstance(self.value, tuple):
            raise TypeError("a vector quantity has no single value")
        return self.value

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.value, dtype=dtype or float)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def _finite(value: Any) -> float:
    try:
        number = float(value)
    except OverflowError:  # an integer beyond the largest float
        number = inf
    if not isfinite(number):
        raise Invalid(expected="a finite number")
    return number


def one_number(value: Any) -> float:
    """One finite number of a file.

    Raises:
        Invalid: it is none, or several.
    """
    if isinstance(value, (list, tuple, np.ndarray)):
        raise Invalid(expected=f"one number, not {len(value)}")
    if not _is_number(value):
        raise Invalid(expected="a number")
    return _finite(value)


def _several(size: int, value: Any) -> tuple[float, ...]:
    if not isinstance(value, (list, tuple, np.ndarray)) or not all(_is_number(v) for v in value):
        raise Invalid(expected=f"{size} numbers")
    if len(value) != size:
        raise Invalid(expected=f"{size} numbers, not {len(value)}")
    return tuple(_finite(v) for v in value)


def _many(value: Any) -> tuple[float, ...]:
    if not isinstance(value, (list, tuple, np.ndarray)) or len(value) < 2 or not all(_is_number(v) for v in value):
        raise Invalid(expected="two numbers or more")
    return tuple(_finite(v) for v in value)


def _one_or_three(value: Any) -> tuple[float, ...]:
    return (_finite(value),) * 3 if _is_number(value) else _several(3, value)


def _one_or_more(value: Any) -> tuple[float, ...]:
    if not isinstance(value, (list, tuple, np.ndarray)) or not len(value) or not all(_is_number(v) for v in value):
        raise Invalid(expected="a list of numbers")
    return tuple(_finite(v) for v in value)


def _points(value: Any) -> tuple[tuple[float, ...], ...]:
    if not isinstance(value, (list, tuple, np.ndarray)):
        raise Invalid(expected="a list of points [x, y]")
    return tuple(_several(2, point) for point in value)


@dataclass(frozen=True)
class Reading:
    """Form of a quantity in files: `read` parses a value, `test` accepts or rejects it, `expected` describes it in errors.

    A single number's test takes arrays of them as well; `bounds` are those of what it allows.
    """

    expected: str
    read: Callable[[Any], Any]
    test: Callable[[Any], bool] = lambda value: True
    bounds: tuple[float, float] = (-inf, inf)

    def __get_pydantic_core_schema__(self, kind: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """A quantity that is read before it is checked; as `BeforeValidator`, which looks at signatures for a while first."""
        return core_schema.no_info_before_validator_function(self, handler(kind))

    def __call__(self, entry: Any) -> Any:
        """The value from a file as the fields of a quantity."""
        if isinstance(entry, dict) and "value" not in entry:
            return entry  # refused for that
        value = self.read(entry["value"] if isinstance(entry, dict) else getattr(entry, "value", entry))
        if not self.test(value):
            raise Invalid(expected=self.expected)
        if isinstance(entry, Quantity):
            return entry
        return {**entry, "value": value} if isinstance(entry, dict) else {"value": value}


Number = Annotated[Quantity, Reading("a number", one_number)]
Positive = Annotated[Quantity, Reading("a number above 0", one_number, lambda v: v > 0, (0.0, inf))]
NotNegative = Annotated[Quantity, Reading("a number of 0 or more", one_number, lambda v: v >= 0, (0.0, inf))]
NotPositive = Annotated[Quantity, Reading("a number of 0 or less", one_number, lambda v: v <= 0, (-inf, 0.0))]
NotZero = Annotated[Quantity, Reading("a number other than 0", one_number, lambda v: v != 0)]
Share = Annotated[
    Quantity, Reading("a number above 0, at most 1", one_number, lambda v: (v > 0) & (v <= 1), (0.0, 1.0))
]
BelowOne = Annotated[
    Quantity, Reading("a number of 0 or more, below 1", one_number, lambda v: (v >= 0) & (v < 1), (0.0, 1.0))
]
Shares = Annotated[
    Quantity, Reading("numbers above 0, at most 1", _one_or_more, lambda v: all(0 < share <= 1 for share in v))
]
LEAST_RISE = 1e-9  # of the largest: by how much numbers rise at least, since tables divide by the differences


def rise(values: Any) -> np.ndarray:
    """True where numbers (k, …) rise from each to the next, by more than rounding could take away; shape (…)."""
    values = np.asarray(values, dtype=float)
    size = np.maximum(np.abs(values).max(axis=0), np.finfo(float).tiny)
    return (np.diff(values / size, axis=0) > LEAST_RISE).all(axis=0)


RISING = Reading("numbers above 0, each above the one before", _one_or_more, lambda v: v[0] > 0 and bool(rise(v)))
Rising = Annotated[Quantity, RISING]
Vector3 = Annotated[Quantity, Reading("3 numbers", partial(_several, 3))]
Direction = Annotated[Quantity, Reading("a direction, 3 numbers not all 0", partial(_several, 3), any)]
Range = Annotated[Quantity, Reading("2 numbers", partial(_several, 2))]
Numbers = Annotated[Quantity, Reading("two numbers or more", _many)]
INCREASING = Reading("two numbers or more, each above the one before", _many, lambda v: bool(rise(v)))
Increasing = Annotated[Quantity, INCREASING]
Size3 = Annotated[Quantity, Reading("3 numbers above 0", partial(_several, 3), lambda v: all(k > 0 for k in v))]
Scale3 = Annotated[Quantity, Reading("a number other than 0, or 3 of them", _one_or_three, all)]
Outline = Annotated[Quantity, Reading("a list of points [x, y]", _points)]

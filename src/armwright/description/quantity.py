"""A number of a robot, with the source it came from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

SourceKind = Literal["drawing", "cad", "datasheet", "measurement", "fit", "estimate", "publication", "definition"]


class Record(BaseModel):
    """A table of a robot file: frozen, and refusing every key it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False, allow_inf_nan=False, protected_namespaces=())

    def replace(self, **changes: Any) -> Any:
        """A copy with some fields changed, validated like the original."""
        kept = {name: getattr(self, name) for name in type(self).model_fields if name in self.model_fields_set}
        return type(self)(**{**kept, **changes})


class Source(Record):
    """Where numbers come from: `[sources.KEY]` of a robot file, named elsewhere as `source = "KEY"`."""

    kind: SourceKind
    text: str = Field(min_length=1, description="The citation, drawing number or reasoning, for a reader to follow.")
    date: str | None = None
    licence: str | None = None
    url: str | None = None


class Quantity(Record):
    """A value with its source. In a file either a bare number (the source of the enclosing table holds) or a table.

    `mass_kg = 3.9`  or  `mass_kg = { value = 3.9, std = 0.05, source = "scales", date = "2026-05-04" }`.
    The unit is the ending of the key.
    """

    value: float | tuple[float, ...]
    std: float | tuple[float, ...] | None = Field(None, description="Standard deviation, same unit.")
    source: str | None = Field(None, description="A key of [sources], or a kind of source such as 'estimate'.")
    date: str | None = None

    def __float__(self) -> float:
        if isinstance(self.value, tuple):
            raise TypeError("a vector quantity has no single value")
        return self.value

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.value, dtype=dtype or float)


def _number(value: Any) -> Any:
    if isinstance(value, bool) or isinstance(value, str):
        raise ValueError("expected a number")
    if isinstance(value, Quantity):
        return value
    if isinstance(value, dict):
        return value
    return {"value": value}


def _sized(size: int | None):
    def check(quantity: Quantity) -> Quantity:
        length = len(quantity.value) if isinstance(quantity.value, tuple) else None
        if length != size:
            raise ValueError(f"expected {f'{size} numbers' if size else 'one number'}, not {length or 'one'}")
        return quantity

    return check


def _scalar(value: Any) -> Quantity:
    return _sized(None)(Quantity.model_validate(_number(value)))


def _bounded(test, expected: str):
    def check(value: Any) -> Quantity:
        quantity = _scalar(value)
        if not test(quantity.value):
            raise ValueError(f"expected {expected}")
        return quantity

    return check


def _vector(size: int):
    def check(value: Any) -> Quantity:
        if isinstance(value, (list, np.ndarray)):
            value = tuple(float(v) if isinstance(v, (int, float)) and not isinstance(v, bool) else v for v in value)
        return _sized(size)(Quantity.model_validate(_number(value)))

    return check


Number = Annotated[Quantity, BeforeValidator(_scalar)]
Positive = Annotated[Quantity, BeforeValidator(_bounded(lambda v: v > 0, "a number above 0"))]
NotNegative = Annotated[Quantity, BeforeValidator(_bounded(lambda v: v >= 0, "a number of 0 or more"))]
NotZero = Annotated[Quantity, BeforeValidator(_bounded(lambda v: v != 0, "a number other than 0"))]
Share = Annotated[Quantity, BeforeValidator(_bounded(lambda v: 0 < v <= 1, "a number above 0, at most 1"))]
Vector3 = Annotated[Quantity, BeforeValidator(_vector(3))]
Range = Annotated[Quantity, BeforeValidator(_vector(2))]


def quantities(record: Record, prefix: str = "") -> Iterator[tuple[str, Quantity, str | None]]:
    """Every quantity below a record: its dotted path, itself, and the source that holds for it."""

    def walk(value: Any, path: str, source: str | None) -> Iterator[tuple[str, Quantity, str | None]]:
        if isinstance(value, Quantity):
            yield path, value, value.source or source
        elif isinstance(value, Record):
            own = getattr(value, "source", None) or source
            for name in type(value).model_fields:
                yield from walk(getattr(value, name), f"{path}.{name}" if path else name, own)
        elif isinstance(value, tuple):
            for k, item in enumerate(value):
                named = getattr(item, "name", None)
                yield from walk(item, named if named else f"{path}[{k}]", source)

    yield from walk(record, prefix, None)

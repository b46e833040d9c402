"""Values that differ by lane: a `Batch`, wherever a scenario or one of its parts takes a number or an array."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError


@dataclass(frozen=True, eq=False)
class Batch:
    """One value for each lane: lane k takes `values[k]`.

    Everything else, arrays of any shape included, is one value that all lanes share.

    Args:
        values: (lanes, …) numbers, or a sequence of other values such as schedules.
    Raises:
        ScenarioError: no lanes, rows of unequal shape, or a batch inside.
    """

    values: Any

    def __post_init__(self) -> None:
        values = self.values
        if isinstance(values, (Batch, str, bytes)):
            raise ScenarioError(f"Batch({values!r:.60}): expected one value for each lane")
        if isinstance(values, (list, tuple)) and any(isinstance(each, Batch) for each in values):
            raise ScenarioError(f"Batch({values!r:.60}): holds a Batch; expected one value for each lane")
        try:
            array = np.array(values)
        except ValueError:
            raise ScenarioError(
                f"Batch({values!r:.60}): rows of unequal shape; expected one shape for all lanes"
            ) from None
        if array.ndim == 0 or not len(array):
            raise ScenarioError(f"Batch({values!r:.60}): expected one value for each lane, and at least one lane")
        object.__setattr__(self, "values", array if array.dtype.kind in "iufb" else tuple(values))

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        return f"<batch of {len(self)} lanes: {self.values[0]!r:.40}, …>"

    @property
    def shape(self) -> tuple[int, ...] | None:
        """Shape of one lane's value; None of values that are no numbers."""
        return self.values.shape[1:] if isinstance(self.values, np.ndarray) else None

    def __array__(self, *args: Any, **kwargs: Any) -> Any:
        raise ScenarioError(f"{self!r} used as one array; expected code that takes one lane's value")


def lane_values(value: Any) -> Any:
    """(lanes or 1, …): the values of a batch, or the only value of all lanes."""
    return value.values if isinstance(value, Batch) else np.asarray(value)[None]


def lane_counts(value: Any, path: str) -> dict[str, int]:
    """Number of lanes of every batch in a value, by its path; dataclasses, mappings and sequences are searched.

    Args:
        value: what may hold batches.   path: what errors call it.
    """
    return {place: len(batch) for place, batch in batches(value, path)}


def batches(value: Any, path: str) -> Iterator[tuple[str, Batch]]:
    """Every batch in a value, with its path such as `controller.kp` or `payload[1].mass`."""
    if isinstance(value, Batch):
        yield path, value
    elif is_dataclass(value) and not isinstance(value, type):
        for each in fields(value):
            yield from batches(getattr(value, each.name), f"{path}.{each.name}")
    elif isinstance(value, Mapping):
        for name, each in value.items():
            yield from batches(each, f"{path}[{name!r}]")
    elif isinstance(value, (list, tuple)):
        for k, each in enumerate(value):
            if not isinstance(each, (int, float)):
                yield from batches(each, f"{path}[{k}]")


def check_counts(counts: Mapping[str, int]) -> int | None:
    """The number of lanes that all batches share; None without batches.

    Args:
        counts: lanes by path, as `lane_counts` gives them.
    Raises:
        ScenarioError: different numbers of lanes; names them all.
    """
    if len(set(counts.values())) > 1:
        raise ScenarioError(f"lanes do not fit together: {', '.join(f'{v} of {k}' for k, v in counts.items())}")
    return next(iter(counts.values()), None)


@dataclass(frozen=True, eq=False)
class LaneFields:
    """An object whose fields may be batches, told apart: the fields that vary, and their values side by side.

    Attributes:
        owner: the object, such as a controller.   names: of its fields that are batches.   shapes: of one lane's value of each.
        values: (lanes, k) of them, side by side; (1, 0) where nothing varies.
    """

    owner: Any
    names: tuple[str, ...] = ()
    shapes: tuple[tuple[int, ...], ...] = ()
    values: np.ndarray = field(default_factory=lambda: np.zeros((1, 0)))

    @classmethod
    def of(cls, owner: Any, place: str) -> LaneFields:
        """The batches of a dataclass; of anything else, none.

        Args:
            owner: the object.   place: what errors call it.
        Raises:
            ScenarioError: a batch of no numbers, or batches of different numbers of lanes.
        """
        if not is_dataclass(owner) or isinstance(owner, type):
            return cls(owner)
        rows: dict[str, np.ndarray] = {}
        for each in fields(owner):
            value = getattr(owner, each.name)
            if isinstance(value, Batch):
                if value.shape is None:
                    raise ScenarioError(f"{place}: {each.name} = {value!r}: expected a batch of numbers")
                rows[each.name] = value.values.astype(float)
        inner = [path for path, _ in batches(owner, place) if path not in {f"{place}.{name}" for name in rows}]
        if inner:
            raise ScenarioError(f"{inner[0]} is a Batch: expected it as a field of the {place} itself")
        if not rows:
            return cls(owner)
        check_counts({f"{place}.{name}": len(value) for name, value in rows.items()})
        flat = [value.reshape(len(value), -1) for value in rows.values()]
        shapes = tuple(value.shape[1:] for value in rows.values())
        return cls(owner, tuple(rows), shapes, np.concatenate(flat, axis=1))

    @property
    def lanes(self) -> int | None:
        """Number of lanes; None where nothing varies."""
        return len(self.values) if self.names else None

    def with_values(self, rows: Any) -> Any:
        """The object with (…, k) values, numbers or symbols, in place of its batches; its own checks are not made again."""
        if not self.names:
            return self.owner
        rows = np.asarray(rows)
        ends = np.cumsum([math.prod(shape) for shape in self.shapes])
        changed = copy.copy(self.owner)
        for name, part, shape in zip(self.names, np.split(rows, ends[:-1], axis=-1), self.shapes, strict=True):
            value = scalar.array(part.reshape(*rows.shape[:-1], *shape))
            object.__setattr__(changed, name, value if value.ndim else value[()])
        return changed

"""Values that differ by lane: `Batch`, wherever a scenario or one of its parts takes a number or an array."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

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
        try:
            array = np.asarray(values)
        except ValueError:
            raise ScenarioError(
                f"Batch({values!r:.60}): rows of unequal shape; expected one shape for all lanes"
            ) from None
        if array.dtype.kind == "O" and any(isinstance(each, Batch) for each in array.flat):
            raise ScenarioError(f"Batch({values!r:.60}): holds a Batch; expected one value for each lane")
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

    def map(self, function: Callable[[Any], Any]) -> Batch:
        """The batch of `function(value)` of every lane."""
        return Batch([function(value) for value in self.values])


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
        for field in fields(value):
            yield from batches(getattr(value, field.name), f"{path}.{field.name}")
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

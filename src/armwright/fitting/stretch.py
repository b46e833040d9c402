"""A stretch of a log: successive rows of one run without a gap."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Self

import numpy as np


@dataclass(frozen=True, eq=False)
class LogStretch:
    """Rows of a run; each room adds what a row holds, as arrays (rows, …), mappings of these or data of these.

    Attributes:
        run: its name.
    """

    run: str

    def part(self, rows: slice | np.ndarray) -> Self:
        """Some of the rows."""
        return replace(self, **{each.name: _cut(getattr(self, each.name), rows) for each in fields(self)})


def _cut(value: Any, rows: slice | np.ndarray) -> Any:
    """The rows of a value; values that are no arrays stay."""
    if isinstance(value, np.ndarray):
        return value[rows]
    if isinstance(value, dict):
        return {name: _cut(each, rows) for name, each in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{each.name: _cut(getattr(value, each.name), rows) for each in fields(value)})
    return value

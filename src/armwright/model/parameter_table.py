"""Every number of a robot's record as a table: name, value, unit, standard deviation, bounds, source, scale."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from armwright.description.paths import quantities, reading_at, unit_at
from armwright.description.robot import RobotDescription
from armwright.errors import ModelError, check_known
from armwright.quantity import Reading


@dataclass(frozen=True)
class Parameter:
    """One number of the record.

    Attributes:
        path: such as "link6.com_m".   entry: which of several numbers it is; None of a single one.
        value: in the record.   unit: as its key states it, "1" of a ratio.   std: standard deviation; None if absent.
        bounds: between which the record allows it.   source: key or kind of its source; None if absent.
        reading: what may stand there.   scale: its typical size, for optimisers: |value|, or the largest of its fellow entries,
            or its standard deviation, or 1.
    """

    path: str
    entry: int | None
    reading: Reading = field(repr=False)
    value: float
    unit: str
    std: float | None
    source: str | None
    scale: float

    @property
    def name(self) -> str:
        """`link6.mass_kg`, or `link6.com_m[2]` for one of several numbers."""
        return self.path if self.entry is None else f"{self.path}[{self.entry}]"

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the value in the record."""
        return self.reading.bounds if self.entry is None else (-np.inf, np.inf)


class Parameters(Sequence[Parameter]):
    """The numbers of an arm's record as a table, by place or by name; `print(arm.parameters)` shows it."""

    def __init__(self, rows: Iterable[Parameter]):
        self._rows = tuple(rows)
        self._places = {row.name: k for k, row in enumerate(self._rows)}

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, which: Any) -> Any:
        if isinstance(which, slice):
            return Parameters(self._rows[which])
        if isinstance(which, str):
            check_known(ModelError, which, self._places, "no such parameter", place="parameters")
            which = self._places[which]
        return self._rows[which]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters."""
        return tuple(self._places)

    @property
    def values(self) -> np.ndarray:
        """(k,) values in the record."""
        return np.array([row.value for row in self._rows])

    def chosen(self, *parts: str) -> Parameters:
        """Those whose names hold all of some texts: `arm.parameters.chosen("friction", "viscous")`."""
        return Parameters(row for row in self._rows if all(part in row.name for part in parts))

    def __str__(self) -> str:
        heads = ("parameter", "value", "unit", "std", "bounds", "source")
        rows = [
            heads,
            *((p.name, f"{p.value:.6g}", p.unit, _shown(p.std), _span(p.bounds), p.source or "-") for p in self),
        ]
        widths = [max(len(row[k]) for row in rows) for k in range(len(heads))]
        return "\n".join("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows)


def _shown(std: float | None) -> str:
    return "-" if std is None else f"{std:.3g}"


def _span(bounds: tuple[float, float]) -> str:
    return "-" if not np.isfinite(bounds).any() else f"{bounds[0]:g} … {bounds[1]:g}"


def parameters_of(robot: RobotDescription) -> Parameters:
    """Every number of a record that may vary, one row each; what only pictures read is left out."""
    rows: list[Parameter] = []
    for path, quantity, source in quantities(robot, pictures=False):
        several, numbers = isinstance(quantity.value, tuple), np.asarray(quantity.value, dtype=float)
        if numbers.ndim > 1:
            continue  # points of an outline
        values = numbers.reshape(-1).tolist()
        spread = quantity.std if isinstance(quantity.std, tuple) else (quantity.std,) * len(values)
        largest = max(abs(value) for value in values)
        reading, unit = reading_at(robot, path), unit_at(path)
        for k, (value, std) in enumerate(zip(values, spread, strict=True)):
            scale = abs(value) or largest or std or 1.0
            entry = k if several else None
            rows.append(Parameter(path, entry, reading, float(value), unit, std, source, float(scale)))
    return Parameters(rows)

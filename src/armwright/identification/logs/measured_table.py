"""A measured file of any format as a table of columns, read in blocks of rows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from armwright.errors import ArmwrightError, LogError
from armwright.identification.logs.log_file import FileTable
from armwright.results.csv_tables import WITH_UNIT


class MeasuredTable(ABC):
    """A file that is read by columns, in blocks of rows.

    Attributes:
        path: of the file.   names: of all columns, without units; () where columns have numbers only.
        units: by name, where the header states one.
    """

    def __init__(self, path: Path, table: FileTable):
        self.path, self.table = path, table
        self.names: tuple[str, ...] = ()
        self.units: dict[str, str] = {}

    @abstractmethod
    def blocks(self, columns: Sequence[int | str], rows: int) -> Iterator[list[np.ndarray]]:
        """Numbers of some columns, `rows` rows at a time, NaN for empty cells.

        Args:
            columns: names, or numbers from 1.   rows: of a block; the last may have fewer.
        Raises:
            LogError: a column that is not there, a cell that holds no number; with file and line.
        """

    def place(self, row: int) -> str:
        """A row of the file in the reader's words, rows from 0."""
        return f"{self.path} row {row + 1}"

    def unit(self, column: int | str) -> str | None:
        """The unit of a column in the header; None if absent."""
        return self.units.get(self._name(column))

    def _name(self, column: int | str) -> str:
        """A column's name.

        Raises:
            LogError: there is no such column.
        """
        if isinstance(column, int):
            if not 1 <= column <= len(self.names):
                raise LogError(place="column", value=column, expected=f"1 to {len(self.names)}", file=self.path)
            return self.names[column - 1]
        match = WITH_UNIT.match(column)
        name = match["name"] if match else column
        if name not in self.names:
            raise LogError("no such column", place="column", value=column, choices=self.names, file=self.path)
        if self.names.count(name) > 1:
            raise LogError("several columns have that name: use its number", place="column", value=name, file=self.path)
        return name

    def _read_heads(self, heads: Sequence[str]) -> None:
        """Names and units of columns from their heads: `q_elbow [rad]`."""
        matches = [WITH_UNIT.match(head) for head in heads]
        self.names = tuple(m["name"] if m else head for m, head in zip(matches, heads, strict=True))
        self.units = {m["name"]: m["unit"].strip() for m in matches if m}


class as_log_error:
    """Converts what the Parquet and MCAP libraries raise into `LogError`: on damaged bytes that may be anything."""

    def __init__(self, path: Path):
        self.path = path

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        # OSError: `opened` has that
        if isinstance(error, Exception) and not isinstance(error, (ArmwrightError, OSError)):
            reason = " ".join(str(error).split()) or type(error).__name__
            raise LogError(f"cannot be read: {reason}", file=self.path) from error

"""CSV and its relatives as measured tables, parsed by pandas in blocks."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from armwright.errors import LogError
from armwright.identification.logs.log_file import FileTable
from armwright.identification.logs.measured_table import MeasuredTable
from armwright.reading import opened

LONGEST_LINE = 2**20  # bytes of the first line
DIGITS = 308  # that a finite float has before its point
COMMAS = str.maketrans({",": ".", ".": "?"})  # where a comma is the decimal mark, a point is none


class TextTable(MeasuredTable):
    """CSV and its relatives, parsed by pandas in blocks."""

    def __init__(self, path: Path, table: FileTable):
        super().__init__(path, table)
        with opened(path, "a text file of numbers", LogError) as file:
            for _ in range(table.skip_lines):
                if not _line(file):
                    break
            self._skipped, self._begin = table.skip_lines, file.tell()  # lines and bytes before the first row
            first = _line(file)
            if table.header:
                self._skipped, self._begin = self._skipped + 1, file.tell()
                while _line(file).isspace():  # pandas takes a blank first row for the end of the file
                    self._skipped, self._begin = self._skipped + 1, file.tell()
        line = self._decoded(first)
        if not line.strip():
            raise LogError("empty", file=f"{path}:{table.skip_lines + 1}", expected="a header, or a row of numbers")
        cells = self._cells(line)
        if table.header:
            self._check_header(cells, line)
            self._read_heads(cells)
        else:
            self.names = tuple(str(k + 1) for k in range(len(cells)))

    def place(self, row: int) -> str:
        """`file:line` of a row."""
        return f"{self.path}:{self._skipped + row + 1}"

    def blocks(self, columns: Sequence[int | str], rows: int) -> Iterator[list[np.ndarray]]:
        """See `MeasuredTable.blocks`."""
        import pandas

        names = [self._name(column) for column in columns]
        places = [self.names.index(name) for name in names]
        blank = self.table.delimiter == " "
        with opened(self.path, "a text file of numbers", LogError) as file:
            row, waiting = 0, []
            file.seek(self._begin)  # pandas itself would count skipped lines that end in a carriage return wrongly
            try:
                # all columns are parsed: with `usecols` pandas passes over cells too many, such as those of a decimal comma
                reader = pandas.read_csv(
                    file, chunksize=rows, header=None, sep=r"\s+" if blank else self.table.delimiter,
                    decimal=self.table.decimal, skipinitialspace=True, skip_blank_lines=False, encoding="utf-8-sig",
                    na_values=["-nan", "NaN", "nan"], low_memory=False,
                )  # fmt: skip
                for chunk in reader:
                    if chunk.shape[1] < len(self.names):
                        what, expected = f"{chunk.shape[1]} cells in a line", f"{len(self.names)}, as in the header"
                        raise LogError(what, file=self.place(row), expected=expected)
                    arrays = [self._numbers(chunk[k].to_numpy(), row, k) for k in places]
                    row += len(chunk)
                    if len(_without_blank_end(arrays)[0]):  # blank lines wait: at the end of the file they are no rows
                        yield from waiting
                        waiting = []
                    waiting.append(arrays)
                last = _without_blank_end(waiting[0]) if waiting else []
                if last and len(last[0]):
                    yield last
            except pandas.errors.EmptyDataError:
                return  # the caller says that there are no rows
            except (pandas.errors.ParserError, UnicodeDecodeError) as fault:
                reason = (str(fault).splitlines() or ["damaged"])[0].removeprefix("Error tokenizing data. C error: ")
                lines = re.sub(r"(?<=line )\d+", lambda number: str(int(number[0]) + self._skipped), reason)
                what = f"cannot be read as a table: {lines}"
                raise LogError(what, file=self.place(row), expected="as many cells in every line") from None

    def _numbers(self, values: np.ndarray, row: int, column: int) -> np.ndarray:
        """Cells as numbers.

        Raises:
            LogError: a cell holds text.
        """
        if values.dtype.kind in "iuf":
            return values
        import pandas

        cells = pandas.Series(values, dtype=object)
        if self.table.decimal == ",":  # one cell of text leaves the whole column as text, with its commas
            cells = cells.map(lambda cell: cell.translate(COMMAS) if isinstance(cell, str) else cell)
        try:
            numbers = np.asarray(pandas.to_numeric(cells, errors="coerce"), dtype=float)
            wrong = np.isnan(numbers) & ~pandas.isna(values)
        except OverflowError:  # an integer that no float holds
            numbers, wrong = values, np.array([len(str(value)) > DIGITS for value in values])
        if wrong.any():
            k = int(np.argmax(wrong))
            name = f"column {self.names[column]!r}"
            raise LogError(place=name, value=str(values[k]), expected="a number", file=self.place(row + k))
        return numbers

    def _decoded(self, line: bytes) -> str:
        try:
            return line.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            what = f"byte 0x{line[error.start]:02x} is not UTF-8"
            file = f"{self.path}:{self.table.skip_lines + 1}"
            raise LogError(what, file=file, expected="a text file of numbers in UTF-8") from None

    def _cells(self, line: str) -> list[str]:
        if self.table.delimiter == " ":
            return line.split()
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=self.table.delimiter))]
        except csv.Error as error:
            raise LogError(f"not CSV: {error}", file=f"{self.path}:{self.table.skip_lines + 1}") from None

    def _check_header(self, cells: list[str], line: str) -> None:
        """Refuses a header of numbers, and a first line that another delimiter would cut."""
        file = f"{self.path}:{self.table.skip_lines + 1}"
        if all(_is_number(cell.replace(self.table.decimal, ".")) for cell in cells):
            raise LogError("numbers where the header should be", file=file, expected="names, or header = false")
        others = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}
        for mark, name in others.items():
            if len(cells) == 1 and mark != self.table.delimiter and len(line.strip().split(mark)) > 1 and mark != " ":
                raise LogError(f"cells are separated by {name}", file=file, expected=f"delimiter = {mark!r}")


def _line(file: BinaryIO) -> bytes:
    r"""The next line with its end: \n, \r\n or, as pandas takes it too, a lone \r; empty at the end of the file."""
    start = file.tell()
    line = file.readline(LONGEST_LINE)
    head, mark, rest = line.partition(b"\r")
    if not mark or rest in (b"", b"\n"):
        return line
    file.seek(start + len(head) + 1)
    return head + mark


def _without_blank_end(arrays: list[np.ndarray]) -> list[np.ndarray]:
    """Columns without the blank lines at the end of a file."""
    filled = np.flatnonzero(~np.all([np.isnan(array) for array in arrays], axis=0))
    end = int(filled[-1]) + 1 if len(filled) else 0
    return [array[:end] for array in arrays]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True

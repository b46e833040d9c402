"""Measured tables in files of several formats, read in blocks of rows so that a long log never stands in memory as a whole.

| ending           | columns                                                                                   | needs  |
|------------------|-------------------------------------------------------------------------------------------|--------|
| .csv, .txt, .tsv | by the header's names, or by number                                                       |        |
| .parquet         | by name                                                                                   | `logs` |
| .mcap            | of sensor_msgs/JointState `position/JOINT`, `velocity/JOINT`, `effort/JOINT`, `stamp`, `log_time` | `logs` |
| .nc              | of our runs `q_JOINT` …, else variables of one dimension; read whole                      |        |

`logs` is the extra that brings pyarrow and mcap.
"""

from __future__ import annotations

import csv
import importlib.util
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from armwright.errors import LogError
from armwright.identification.logs.log_file import FileTable
from armwright.reading import opened, refuse_other_entries
from armwright.results.tables import WITH_UNIT

LONGEST_LINE = 2**20  # bytes of the first line of a text file
PARQUET_BUFFER = 2**16  # bytes of a column; this and no read-ahead, or all that was read stays in memory
EXTRAS = {".parquet": ("pyarrow",), ".mcap": ("mcap", "mcap_ros2")}  # ending → modules of the extra `logs`
JOINT_STATE = {"position": "position", "velocity": "velocity", "effort": "effort"}


class MeasuredTable(ABC):
    """A file whose columns are read in blocks of rows.

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
        """A row of the file in its reader's words, rows from 0."""
        return f"{self.path} row {row + 1}"

    def unit(self, column: int | str) -> str | None:
        """The unit that the header states of a column; None if absent."""
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

    def _take_heads(self, heads: Sequence[str]) -> None:
        """Names and units of columns from their heads: `q_elbow [rad]`."""
        matches = [WITH_UNIT.match(head) for head in heads]
        self.names = tuple(m["name"] if m else head for m, head in zip(matches, heads, strict=True))
        self.units = {m["name"]: m["unit"].strip() for m in matches if m}


class TextTable(MeasuredTable):
    """CSV and its relatives, parsed by pandas in blocks."""

    def __init__(self, path: Path, table: FileTable):
        super().__init__(path, table)
        with opened(path, "a text file of numbers", LogError) as file:
            for _ in range(table.skip_lines):
                file.readline(LONGEST_LINE)
            first = file.readline(LONGEST_LINE)
        self._skipped = table.skip_lines + table.header
        line = self._decoded(first)
        if not line.strip():
            raise LogError("empty", file=f"{path}:{table.skip_lines + 1}", expected="a header, or a row of numbers")
        cells = self._cells(line)
        if table.header:
            self._check_header(cells, line)
            self._take_heads(cells)
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
            try:
                # all columns are parsed: with `usecols` pandas passes over cells too many, such as those of a decimal comma
                reader = pandas.read_csv(
                    file, chunksize=rows, header=None, skiprows=self._skipped,
                    sep=r"\s+" if blank else self.table.delimiter, decimal=self.table.decimal, skipinitialspace=True,
                    skip_blank_lines=False, encoding="utf-8-sig", na_values=["-nan", "NaN", "nan"], low_memory=False,
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
                what = f"cannot be read as a table: {reason}"
                raise LogError(what, file=self.place(row), expected="as many cells in every line") from None

    def _numbers(self, values: np.ndarray, row: int, column: int) -> np.ndarray:
        """Cells as numbers.

        Raises:
            LogError: a cell holds text.
        """
        if values.dtype.kind in "iuf":
            return values
        import pandas

        try:
            numbers = np.asarray(pandas.to_numeric(pandas.Series(values, dtype=object), errors="coerce"), dtype=float)
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
        return [cell.strip() for cell in next(csv.reader([line], delimiter=self.table.delimiter))]

    def _check_header(self, cells: list[str], line: str) -> None:
        """Refuses a header of numbers, and a first line that another delimiter would cut."""
        file = f"{self.path}:{self.table.skip_lines + 1}"
        if all(_is_number(cell.replace(self.table.decimal, ".")) for cell in cells):
            raise LogError("numbers where the header should be", file=file, expected="names, or header = false")
        others = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}
        for mark, name in others.items():
            if len(cells) == 1 and mark != self.table.delimiter and len(line.strip().split(mark)) > 1 and mark != " ":
                raise LogError(f"cells are separated by {name}", file=file, expected=f"delimiter = {mark!r}")


class ParquetTable(MeasuredTable):
    """Apache Parquet, read by pyarrow a batch at a time."""

    def __init__(self, path: Path, table: FileTable):
        super().__init__(path, table)
        with opened(path, "a Parquet file", LogError) as file, _as_log_error(path):
            schema = _parquet(file).schema_arrow
        self._take_heads(schema.names)
        self._heads = dict(zip(self.names, schema.names, strict=True))

    def blocks(self, columns: Sequence[int | str], rows: int) -> Iterator[list[np.ndarray]]:
        """See `MeasuredTable.blocks`."""
        names = [self._name(column) for column in columns]
        row = 0
        with opened(self.path, "a Parquet file", LogError) as file, _as_log_error(self.path):
            heads = list(dict.fromkeys(self._heads[name] for name in names))
            for batch in _parquet(file).iter_batches(rows, columns=heads):
                yield [self._numbers(batch.column(self._heads[name]), name, row) for name in names]
                row += batch.num_rows

    def _numbers(self, array: Any, name: str, row: int) -> np.ndarray:
        values = np.asarray(array.to_numpy(zero_copy_only=False))
        if values.dtype.kind == "M":
            values = values.astype("datetime64[ns]").astype(np.int64)
        if values.dtype.kind not in "iuf":
            what = f"{array.type} values"
            raise LogError(what, place=f"column {name!r}", expected="numbers", file=self.place(row))
        return values


class NetcdfTable(MeasuredTable):
    """NetCDF, a run of ours or another's file of variables along one dimension; read whole."""

    def __init__(self, path: Path, table: FileTable):
        from armwright.errors import RunError
        from armwright.results.recording import wide
        from armwright.results.run_file import read_netcdf

        super().__init__(path, table)
        refuse_other_entries(path, "a NetCDF file", LogError)
        if not os.path.isfile(path):
            raise LogError("no such file", file=path)
        try:
            data = read_netcdf(path)
            if {"joint", "kind", "command"} <= set(data.coords):
                columns = wide(data.isel(lane=[self._lane(data.sizes["lane"])]) if "lane" in data.dims else data)
            else:
                columns = {str(n): v.values for n, v in data.variables.items() if v.ndim == 1 and v.dtype.kind in "iuf"}
        except RunError as error:
            raise LogError.of(*error.problems).within(file=path) from None
        self._take_heads(tuple(columns))
        self._columns = dict(zip(self.names, columns.values(), strict=True))

    def _lane(self, lanes: int) -> int:
        lane = self.table.lane or 0
        if lane >= lanes:
            raise LogError(place="lane", value=lane, expected=f"0 to {lanes - 1}", file=self.path)
        return lane

    def blocks(self, columns: Sequence[int | str], rows: int) -> Iterator[list[np.ndarray]]:
        """See `MeasuredTable.blocks`."""
        arrays = [np.asarray(self._columns[self._name(column)]) for column in columns]
        if len({len(array) for array in arrays}) > 1:
            expected = "columns of one length"
            raise LogError(f"{[len(array) for array in arrays]} values", file=self.path, expected=expected)
        for start in range(0, len(arrays[0]), rows):
            yield [array[start : start + rows] for array in arrays]


class McapTable(MeasuredTable):
    """Messages sensor_msgs/JointState of one topic in an MCAP recording, a row each."""

    def __init__(self, path: Path, table: FileTable):
        super().__init__(path, table)
        with opened(path, "an MCAP file", LogError) as file, _as_log_error(path):
            reader = self._reader(file)
            self._topic = self._chosen_topic(reader)
            first = next(iter(reader.iter_decoded_messages(topics=[self._topic])), None)
        if first is None:
            raise LogError("no messages", place="topic", value=self._topic, file=path)
        self._joints = list(first.decoded_message.name)
        fields = [field for field in JOINT_STATE if len(getattr(first.decoded_message, field))]
        self.names = ("stamp", "log_time", *(f"{field}/{joint}" for field in fields for joint in self._joints))
        self.units = {"stamp": "ns", "log_time": "ns"}

    def _reader(self, file: Any) -> Any:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory

        return make_reader(file, decoder_factories=[DecoderFactory()])

    def _chosen_topic(self, reader: Any) -> str:
        summary = reader.get_summary()
        channels = [] if summary is None else summary.channels.values()
        schemas = {} if summary is None else summary.schemas
        names = [
            c.topic for c in channels if c.schema_id in schemas and schemas[c.schema_id].name.endswith("JointState")
        ]
        topic = self.table.topic or (names[0] if len(names) == 1 else None)
        if topic is None:
            what = "several topics of sensor_msgs/JointState" if names else "no topic of sensor_msgs/JointState"
            raise LogError(what, place="topic", expected=f"one of {', '.join(names)}" if names else "", file=self.path)
        if topic not in names:
            raise LogError(
                "no topic of sensor_msgs/JointState", place="topic", value=topic, choices=names, file=self.path
            )
        return topic

    def blocks(self, columns: Sequence[int | str], rows: int) -> Iterator[list[np.ndarray]]:
        """See `MeasuredTable.blocks`."""
        names = [self._name(column) for column in columns]
        cells: list[list[float]] = []
        row = 0
        with opened(self.path, "an MCAP file", LogError) as file, _as_log_error(self.path):
            for each in self._reader(file).iter_decoded_messages(topics=[self._topic]):
                cells.append(self._row(each, names, row))
                row += 1
                if len(cells) == rows:
                    yield [np.array(column) for column in zip(*cells, strict=True)]
                    cells = []
        if cells:
            yield [np.array(column) for column in zip(*cells, strict=True)]

    def _row(self, each: Any, names: list[str], row: int) -> list[float]:
        """The cells of one message; joints may stand in another order in each."""
        message, stamp = each.decoded_message, each.decoded_message.header.stamp
        known = {"stamp": stamp.sec * 10**9 + stamp.nanosec, "log_time": each.message.log_time}
        order = {joint: k for k, joint in enumerate(message.name)}
        cells = []
        for name in names:
            if name in known:
                cells.append(known[name])
                continue
            field, _, joint = name.partition("/")
            values = getattr(message, field)
            if joint not in order or order[joint] >= len(values):
                cells.append(float("nan"))
                continue
            cells.append(values[order[joint]])
        return cells


DIGITS = 308  # that a finite float has before its point

FORMATS: dict[str, type[MeasuredTable]] = {
    **dict.fromkeys((".csv", ".txt", ".tsv"), TextTable),
    ".parquet": ParquetTable,
    ".nc": NetcdfTable,
    ".mcap": McapTable,
}


def open_table(path: Path, table: FileTable) -> MeasuredTable:
    """A measured file by its ending; its columns are known, its rows not read.

    Raises:
        LogError: no such file, an unknown ending, a format whose package is not installed.
    """
    ending = path.suffix.lower()
    if ending not in FORMATS:
        what = f"the ending {ending!r} is not offered" if ending else "has no ending"
        raise LogError(what, file=path, expected=", ".join(FORMATS))
    for module in EXTRAS.get(ending, ()):
        if importlib.util.find_spec(module) is None:
            raise LogError(f"{ending} needs {module}, which is not installed: pip install armwright[logs]", file=path)
    return FORMATS[ending](path, table)


class _as_log_error:
    """Errors of the libraries that parse Parquet and MCAP, as ours."""

    def __init__(self, path: Path):
        self.path = path

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        module = type(error).__module__.split(".")[0]
        if isinstance(error, Exception) and (
            module in ("pyarrow", "mcap", "mcap_ros2", "lz4", "zstandard") or _is_damage(error)
        ):
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise LogError(f"cannot be read: {reason}", file=self.path) from error


def _is_damage(error: Exception) -> bool:
    """True for what a parser raises in the middle of damaged bytes."""
    return not isinstance(error, LogError) and isinstance(
        error, (ValueError, LookupError, AttributeError, TypeError, EOFError)
    )


def _parquet(file: Any) -> Any:
    import pyarrow.parquet

    return pyarrow.parquet.ParquetFile(file, buffer_size=PARQUET_BUFFER, pre_buffer=False)


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

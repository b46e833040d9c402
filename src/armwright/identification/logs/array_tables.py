"""Parquet and NetCDF files as measured tables."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from armwright.errors import LogError
from armwright.identification.logs.log_file import FileTable
from armwright.identification.logs.measured_table import MeasuredTable, as_log_error
from armwright.reading import opened, refuse_other_entries

PARQUET_BUFFER = 2**16  # bytes of a column; this and no read-ahead, or all that was read stays in memory


class ParquetTable(MeasuredTable):
    """Apache Parquet, read by pyarrow a batch at a time."""

    def __init__(self, path: Path, table: FileTable):
        super().__init__(path, table)
        with opened(path, "a Parquet file", LogError) as file, as_log_error(path):
            schema = _parquet(file).schema_arrow
        self._read_heads(schema.names)
        self._heads = dict(zip(self.names, schema.names, strict=True))

    def blocks(self, columns: Sequence[int | str], rows: int) -> Iterator[list[np.ndarray]]:
        """See `MeasuredTable.blocks`."""
        names = [self._name(column) for column in columns]
        row = 0
        with opened(self.path, "a Parquet file", LogError) as file, as_log_error(self.path):
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
        return values.astype(float) if values.dtype.kind == "f" else values  # limits are beyond the range of float16


def _parquet(file: Any) -> Any:
    import pyarrow.parquet

    return pyarrow.parquet.ParquetFile(file, buffer_size=PARQUET_BUFFER, pre_buffer=False)


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
        self._read_heads(tuple(columns))
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

"""Measured files of several formats, read in blocks of rows, so that long logs need little memory.

| ending           | columns                                                                                   | needs  |
|------------------|-------------------------------------------------------------------------------------------|--------|
| .csv, .txt, .tsv | by the header's names, or by number                                                       |        |
| .parquet         | by name                                                                                   | `logs` |
| .mcap            | of sensor_msgs/JointState `position/JOINT`, `velocity/JOINT`, `effort/JOINT`, `stamp`, `log_time` | `logs` |
| .nc              | of our runs `q_JOINT` …, else variables of one dimension; read whole                      |        |

`logs` is the extra that brings pyarrow and mcap.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

from armwright.errors import LogError
from armwright.identification.logs.array_tables import NetcdfTable, ParquetTable
from armwright.identification.logs.log_file import FileTable
from armwright.identification.logs.mcap_table import McapTable
from armwright.identification.logs.measured_table import MeasuredTable
from armwright.identification.logs.text_table import TextTable

EXTRAS = {".parquet": ("pyarrow",), ".mcap": ("mcap", "mcap_ros2")}  # ending → modules of the extra `logs`
FORMATS: dict[str, type[MeasuredTable]] = {
    **dict.fromkeys((".csv", ".txt", ".tsv"), TextTable),
    ".parquet": ParquetTable,
    ".nc": NetcdfTable,
    ".mcap": McapTable,
}


def open_table(path: Path, table: FileTable) -> MeasuredTable:
    """A measured file, opened by its ending; its columns are known, its rows unread.

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

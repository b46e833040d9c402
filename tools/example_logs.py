"""Writes examples/logs/tx40/tx40.parquet from the two CSV files of FIGAROH's examples, value by value.

python tools/example_logs.py FOLDER_OF_THE_CSV_FILES
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas
import pyarrow
import pyarrow.parquet

LOGS = Path(__file__).parents[1] / "examples" / "logs"
FILES = {"position": "pos_read_data.csv", "torque": "curr_data.csv"}


def main(folder: Path) -> None:
    """Writes the file from the CSV files in a folder."""
    columns = {
        f"{quantity}_{k}": values.to_numpy(float)
        for quantity, name in FILES.items()
        for k, (_, values) in enumerate(pandas.read_csv(folder / name).items(), 1)
    }
    target = LOGS / "tx40" / "tx40.parquet"
    table = pyarrow.table(columns)
    pyarrow.parquet.write_table(table, target, compression="zstd", compression_level=19, use_dictionary=False)
    print(f"wrote {target}: {table.num_rows} rows, {target.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1]))

"""Measured files: dialects of CSV, cells that are no numbers, and formats whose package is absent."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import LogError
from armwright.identification.logs.log_file import FileTable
from armwright.identification.logs.tables import open_table
from armwright.identification.logs.units import QUANTITIES
from identification.logs.example_logs import ALL, columns, written
from raises_at import raises_at

NUMBERS = [[0.0, 1.5, -2.0], [0.1, 2.5, 1e-3], [0.2, 3.5, 7.0]]
DIALECTS = {  # text, how it is described
    "plain": ("t,a,b\n0,1.5,-2\n0.1,2.5,1e-3\n0.2,3.5,7\n", {}),
    "blank lines at the end": ("t,a,b\n0,1.5,-2\n0.1,2.5,1e-3\n0.2,3.5,7\n\n\n", {}),
    "Windows, with a byte order mark": ("\ufefft,a,b\r\n0,1.5,-2\r\n0.1,2.5,1e-3\r\n0.2,3.5,7\r\n", {}),
    "no header": ("0,1.5,-2\n0.1,2.5,1e-3\n0.2,3.5,7", {"header": False}),
    "German": ("t;a;b\n0;1,5;-2\n0,1;2,5;1e-3\n0,2;3,5;7\n", {"delimiter": ";", "decimal": ","}),
    "tabs": ("t\ta\tb\n0\t1.5\t-2\n0.1\t2.5\t1e-3\n0.2\t3.5\t7\n", {"delimiter": "\t"}),
    "blanks, aligned": ("  t   a    b\n 0.0 1.5   -2\n 0.1 2.5 1e-3\n 0.2 3.5    7\n", {"delimiter": " "}),
    "a preamble": ("logger 3\nserial 17\nt,a,b\n0,1.5,-2\n0.1,2.5,1e-3\n0.2,3.5,7\n", {"skip_lines": 2}),
    "old Mac, lines end in a carriage return": ("t,a,b\r0,1.5,-2\r0.1,2.5,1e-3\r0.2,3.5,7\r", {}),
    "carriage returns, a preamble": ("logger 3\r\rt,a,b\r0,1.5,-2\r0.1,2.5,1e-3\r0.2,3.5,7", {"skip_lines": 2}),
    "several line ends": ("t,a,b\r0,1.5,-2\r\n0.1,2.5,1e-3\n0.2,3.5,7", {}),
    "blank lines behind the header": ("t,a,b\n\n\r\n0,1.5,-2\n0.1,2.5,1e-3\n0.2,3.5,7\n", {}),
    "units in the header": ('t [s],"a [rad]",b [N m]\n0,1.5,-2\n0.1,2.5,1e-3\n0.2,3.5,7\n', {}),
}


def read(path: Path, wanted, **about) -> list[list[float]]:
    blocks = list(open_table(path, FileTable(path=path.name, **about)).blocks(wanted, 2))
    return np.concatenate([np.stack(block, axis=1) for block in blocks]).tolist()


@pytest.mark.parametrize("name", DIALECTS)
def test_dialects(tmp_path, name):
    text, about = DIALECTS[name]
    path = tmp_path / "x.csv"
    path.write_bytes(text.encode())
    assert read(path, [1, 2, 3], **about) == NUMBERS
    if about.get("header", True):
        assert read(path, ["b", "t"], **about) == [[row[2], row[0]] for row in NUMBERS]


MISTAKES = {
    "text in a cell": ("t,a\n0,1\n1,two\n2,3\n", {}, r"x.csv:3: column 'a' = 'two': expected a number"),
    "text far down": ("t,a\n" + "0,1\n" * 500 + "0,off\n", {}, r"x.csv:502: column 'a' = 'off'"),
    "the wrong delimiter": ("t;a\n0;1\n", {}, r"x.csv:1: cells are separated by semicolons; expected delimiter = ';'"),
    "a header that is none": ("0,1\n1,2\n", {}, r"x.csv:1: numbers where the header should be"),
    "no header where one is": ("t,a\n0,1\n", {"header": False}, r"x.csv:1: column '1' = 't': expected a number"),
    "a line too long": ("t,a\n0,1\n1,2,3\n", {}, r"Expected 2 fields in line 3, saw 3"),
    "empty": ("", {}, r"x.csv:1: empty"),
    "two columns of a name": ("t,a,a\n0,1,2\n", {}, r"column = 'a': several columns have that name: use its number"),
    "a cell of all letters": ("x" * 200_000 + ",a\n0,1\n", {}, r"x.csv:1: not CSV: field larger than field limit"),
    "text behind carriage returns": ("t,a\r\r0,1\r1,two\r", {}, r"x.csv:4: column 'a' = 'two': expected a number"),
    "text below decimal commas": (
        "t;a\n0;1,5\n1;two\n",
        {"delimiter": ";", "decimal": ","},
        r"x.csv:3: column 'a' = 'two': expected a number",
    ),
    "a point among decimal commas": (
        "t;a\n0;1,5\n1;2.5\n",
        {"delimiter": ";", "decimal": ","},
        r"x.csv:3: column 'a' = '2.5': expected a number",
    ),
    "bytes that are no text": (b"t,\xff\n0,1\n", {}, r"x.csv:1: byte 0xff is not UTF-8"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_name_line_and_column(tmp_path, name):
    text, about, said = MISTAKES[name]
    path = tmp_path / "x.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(LogError, match=said):
        read(path, [1, 2] if about else ["t", "a"], **about)


def test_empty_cells_are_nan_and_a_cut(tmp_path):
    path = written(tmp_path, ALL)
    lines = (tmp_path / "arm.csv").read_text().splitlines()
    for line in (500, 501, 3000):
        cells = lines[line].split(",")
        cells[4] = "" if line == 500 else "NaN"
        lines[line] = ",".join(cells)
    (tmp_path / "arm.csv").write_text("\n".join(lines))
    log = aw.identification.read_log(path)
    assert [(stretch.rows, stretch.pieces) for stretch in log.runs[0].stretches] == [(4001, 3)]
    (note,) = [each for each in log.notes if "empty" in str(each)]
    assert "qd elbow" in str(note)
    assert "arm.csv:501" in str(note)
    what = "3 cells are empty or not finite: row 500, row 501, row 3000; first at"
    assert f"{what} {tmp_path / 'arm.csv'}:501, column 'v2'" in str(note)


CELLS = """joints = ["a", "b"]
[files.log]
path = "log.ENDING"
[files.slow]
path = "slow.csv"
time = { column = "s", unit = "s" }
[time]
column = "t"
unit = "s"
file = "log"
[gears]
matrix = [[50, 0], [10, 40]]
[[signals]]
quantity = "position"
columns = ["m1", "m2"]
unit = "rad"
side = "motor"
file = "log"
[[signals]]
quantity = "torque"
columns = ["f1", "f2"]
unit = "N m"
side = "joint"
file = "log"
[[signals]]
quantity = "temperature"
columns = "c"
unit = "°C"
file = "slow"
"""


@pytest.mark.study
@pytest.mark.parametrize("ending", ["csv", "parquet", "nc"])
def test_a_cell_that_is_no_number_is_named(tmp_path, ending):
    """Column, and line or row, also of motors that turn several joints, and of a file with a clock of its own."""
    pandas = pytest.importorskip("pandas")
    t = np.arange(400) / 100
    table = {"t": t, "m1": 9 * np.sin(t), "m2": 5 * np.cos(2 * t), "f1": np.sin(3 * t), "f2": np.cos(t)}
    table["m2"][100], table["f1"][250], table["t"][300] = np.inf, np.nan, np.nan
    path = tmp_path / f"log.{ending}"
    if ending == "nc":
        xarray = pytest.importorskip("xarray")
        xarray.Dataset({name: ("row", values) for name, values in table.items()}).to_netcdf(path, engine="h5netcdf")
    else:
        frame = pandas.DataFrame(table)
        frame.to_csv(path, index=False) if ending == "csv" else frame.to_parquet(path)
    slow = np.arange(41) / 10
    cells = {"s": slow, "c": np.where(slow == 0.7, np.nan, 20 + slow)}
    pandas.DataFrame(cells).to_csv(tmp_path / "slow.csv", index=False)
    (tmp_path / "x.log.toml").write_text(CELLS.replace("ENDING", ending), encoding="utf-8")
    said = "\n".join(
        str(each) for each in aw.identification.read_log(tmp_path / "x.log.toml", on_error="keep").findings
    )

    def place(row):
        return f"{path}:{row + 2}" if ending == "csv" else f"{path} row {row + 1}"

    assert f"1 cell is empty or not finite: row 101; first at {place(100)}, column 'm2' = inf" in said
    assert f"1 cell is empty or not finite: row 251; first at {place(250)}, column 'f1'" in said
    assert f"1 row without time left out: row 301; first at {place(300)}, column 't'" in said
    assert f"first at {tmp_path / 'slow.csv'}:9, column 'c'" in said


@pytest.mark.parametrize(("column", "value"), [("v1", 1e300), ("t", -3e200)])
def test_absurd_numbers_are_refused_with_their_line(tmp_path, column, value):
    table = columns()
    table[column][1234] = value
    with raises_at(LogError, f"column '{column}'", r"e\+[23]00: ", file=f"{tmp_path / 'arm.csv'}:1236"):
        aw.identification.read_log(written(tmp_path, ALL, {"arm.csv": table}))


@pytest.mark.parametrize("counts", ["1e-160", "[1e-290, 1e-300]"])
def test_units_that_make_absurd_numbers_are_refused(tmp_path, counts):
    log = """
robot = "two-link"
files.bench.path = "bench.csv"
time = { column = "t", unit = "s" }
gears.matrix = [[1e-9, 1e-9], [-1e-9, 1e-9]]
[[signals]]
quantity = "position"
columns = ["c1", "c2"]
unit = "counts"
side = "motor"
counts_per_turn = """
    (tmp_path / "x.log.toml").write_text(log + counts)
    (tmp_path / "bench.csv").write_text("t,c1,c2\n" + "".join(f"{0.01 * k},{1e15 + k},{2e15 + k}\n" for k in range(50)))
    with raises_at(LogError, "column 'c1'", r"at most 1e\+30 in SI", file=f"{tmp_path / 'bench.csv'}:2"):
        aw.identification.read_log(tmp_path / "x.log.toml")


@pytest.mark.parametrize(("ending", "module"), [("parquet", "pyarrow"), ("mcap", "mcap")])
def test_a_format_whose_package_is_absent(tmp_path, monkeypatch, ending, module):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == module else find(name))
    with pytest.raises(LogError, match=rf"{module}, .* pip install armwright\[logs\]"):
        aw.identification.read_log(written(tmp_path, ALL.replace("arm.csv", f"arm.{ending}")))


def test_damaged_parquet_and_netcdf(tmp_path):
    pytest.importorskip("pyarrow")
    for ending in ("parquet", "nc"):
        (tmp_path / f"arm.{ending}").write_bytes(b"PAR1 is not enough")
        with pytest.raises(LogError, match=rf"arm.{ending}"):
            aw.identification.read_log(written(tmp_path, ALL.replace("arm.csv", f"arm.{ending}")))


def test_columns_of_parquet_are_read_in_blocks(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    import pyarrow

    table = columns()
    parquet.write_table(pyarrow.table(table), tmp_path / "arm.parquet", row_group_size=300)
    blocks = list(open_table(tmp_path / "arm.parquet", FileTable(path="x")).blocks(["q1"], 1000))
    assert [len(block[0]) for block in blocks] == [1000, 1000, 1000, 1000, 1]
    assert np.array_equal(np.concatenate([block[0] for block in blocks]), table["q1"])


def test_units_of_columns_are_those_of_the_international_system():
    """By name with its prefix: what is turning in radians, what is sliding in metres."""
    prefixes = {"m": 1e-3, "k": 1e3}
    for kind in QUANTITIES.values():
        for units, unit in ((kind.turning, kind.unit), (kind.sliding, kind.sliding_unit)):
            assert units[unit] == 1.0
            for prefix, factor in prefixes.items():
                if prefix + unit in units:
                    assert units[prefix + unit] == factor

"""Log files of simulated runs: what `identify` and `validate` read of a run that `simulate` wrote."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomlkit

from armwright.description import builtin_names
from armwright.description.toml_file import read_text
from armwright.entry import AnyArm, AnyRun, as_arm, as_path, as_run
from armwright.errors import LogError
from armwright.identification.logs.log_file import LogTable
from armwright.model import Model
from armwright.output import check_destination, whole_file
from armwright.toml_text import TomlText
from armwright.validation import validated

if TYPE_CHECKING:
    import xarray as xr

ROWS = (".csv", ".nc", ".parquet")  # of runs, whose columns are named alike
FILE = "run"  # key of the runs' file


def write_log(
    run: AnyRun, rows: str | os.PathLike[str], path: str | os.PathLike[str], arm: AnyArm, *, hold_out: bool = False
) -> Path:
    """Writes the log file of a simulated run, or adds the run to one that is there.

    It has measured positions and currents where the run's sensors gave some, else the true ones; torques of drives that take no
    current and have no torque constant.

    Args:
        run: as `simulate` returned it.   rows: file that it was saved as, .csv, .nc or .parquet, below the log's folder.
        path: of the `*.log.toml`.   arm: that was simulated, built in or from a file below that folder.
        hold_out: True for a run that the verdict is about, and no fit.
    Returns:
        path: where it is.
    Raises:
        LogError: rows or an arm that the log cannot name, or a log of other signals.   OutputError: it cannot be written.
    Example:
        >>> arm = aw.load("two-link")
        >>> run = aw.simulate(aw.Scenario(arm, 1.0, command=[3.0, 1.0], start=[-1.0, 0.5]))
        >>> aw.save(run, "swing.csv")
        >>> path = aw.identification.write_log(run, "swing.csv", "swing.log.toml", arm)
        >>> aw.identification.read_log(path).joints
        ('shoulder', 'elbow')
    """
    run = as_run(run)
    arm = as_arm(arm)
    name = Path(as_path(rows, "rows", LogError))
    path = check_destination(path, (".toml",), read=(rows,))
    if name.suffix.lower() not in ROWS:
        raise LogError(place="rows", value=os.fspath(rows), expected=f"a run saved as {', '.join(ROWS)}")
    if "lane" in run.dims:
        raise LogError(f"a run of {run.sizes['lane']} lanes", place="run", expected="one lane: a log is of one arm")
    table = {"robot": _robot(path, arm), **_tables(run, arm)}
    return _with_run(path, table, rows, hold_out=hold_out)


def write_measured(
    rows: str | os.PathLike[str], path: str | os.PathLike[str], arm: AnyArm, quantities: Mapping[str, str]
) -> Path:
    """Writes the log file of measured rows, in place of one that is there; the log names the arm where it can.

    Args:
        rows: CSV with columns "t [s]" and, for each quantity, NAME_JOINT with its unit, below the log's folder.
        path: of the `*.log.toml`.   arm: built in or from a file below that folder, or another one, which the log does not name.
        quantities: NAME of the columns by quantity: {"position": "q"}, on the joints' side.
    Returns:
        path: where it is.
    Raises:
        LogError: rows that the log cannot name.   OutputError: it cannot be written.
    """
    arm = as_arm(arm)
    path = check_destination(path, (".toml",), read=(rows,))
    signals = []
    for quantity, column in quantities.items():
        side = {"side": "joint"} if quantity == "position" else {}
        signals.append({"quantity": quantity, "columns": [f"{column}_{name}" for name in arm.names], **side})
    table = {"files": {FILE: {}}, "time": {"column": "t"}, "signals": signals}
    with contextlib.suppress(LogError):  # the command's ROBOT names it then
        table = {"robot": _robot(path, arm), **table}
    return _with_run(path, table, rows, anew=True)


def _with_run(
    path: Path, table: dict[str, Any], rows: str | os.PathLike[str], *, hold_out: bool = False, anew: bool = False
) -> Path:
    """Writes a log's tables and a run of it, beside those that are there, or `anew` in their place.

    Raises:
        LogError: a log of other signals, or rows that it cannot name.   OutputError: it cannot be written.
    """
    name = Path(rows)
    entry: dict[str, Any] = {"name": name.stem, "files": {FILE: _below(path, rows, "rows")}}
    if hold_out:
        entry["use"] = "hold-out"
    added = path.exists() and not anew
    document = tomlkit.parse(read_text(path, LogError)) if added else tomlkit.document()
    if added:
        _check_same(path, document, table)
        others = [each for each in document.get("runs", []) if each.get("name") != name.stem]
        del document["runs"]
    else:
        others = []
        document.update(table)
    runs = tomlkit.aot()
    for each in (*others, entry):
        row = tomlkit.table()
        row.update(each)
        runs.append(row)
    document["runs"] = runs
    text = tomlkit.dumps(document)
    validated(LogTable, TomlText(text, path).tables, file=path, error=LogError)
    with whole_file(path, (".toml",)) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    return path


def _check_same(path: Path, document: Any, table: dict[str, Any]) -> None:
    """Refuses a log of another robot or of other signals.

    Raises:
        LogError: names the key.
    """
    for key, value in table.items():
        if document.get(key) != value:
            expected = "a log of the same robot and signals, as this command writes it, or a new file"
            raise LogError("is a log of others", place=key, file=path, expected=expected)


def _robot(path: Path, arm: Model) -> str:
    if arm.file is None:
        raise LogError("neither built in nor from a file", place="arm", value=arm.name, expected="an arm of aw.load")
    return arm.file if arm.file in builtin_names() else _below(path, arm.file, "arm")


def _below(path: Path, file: str | os.PathLike[str], place: str) -> str:
    """A file's name in the log's folder."""
    name = Path(os.path.relpath(file, path.parent)).as_posix()
    if name.startswith("../"):
        raise LogError("not below the log's folder", place=place, value=os.fspath(file), expected="a file below it")
    return name


def _tables(run: xr.Dataset, arm: Model) -> dict[str, Any]:
    """Clock, files and signals of a run."""
    drives = [body.drive for body in arm.coordinates]
    electric = all(each.torque_constant is not None and each.command != "torque" for each in drives)
    effort = "current" if electric else "tau"
    effort = f"{effort}_measured" if f"{effort}_measured" in run else effort
    position = "q_measured" if "q_measured" in run else "q"
    signals: list[dict[str, Any]] = [
        {"quantity": "position", "columns": [f"{position}_{name}" for name in arm.names], "side": "joint"},
        {
            "quantity": "current" if electric else "torque",
            "columns": [f"{effort}_{name}" for name in arm.names],
            **({} if electric else {"side": "joint"}),
        },
    ]
    sampled = "q_measured" in run or "u_issued" in run
    if sampled and effort in run and not effort.endswith("_measured") and all(d.command != "voltage" for d in drives):
        signals[1]["held"] = True  # what acts from a row's instant to the next
    return {"files": {FILE: {}}, "time": {"column": "t"}, "signals": signals}

"""Reading of logs: a `*.log.toml`, its robot, the measured files of every run, and the checks."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from armwright.description import builtin_names
from armwright.description.toml_file import toml_tables
from armwright.errors import ArmwrightError, LogError, Problem
from armwright.identification.logs.census import census_of
from armwright.identification.logs.checks import check_log
from armwright.identification.logs.columns import check_gears, gears_of, layout_of, to_joints
from armwright.identification.logs.findings import LEVELS
from armwright.identification.logs.log import Log, LogRun
from armwright.identification.logs.log_file import GearsTable, LogTable, SignalTable
from armwright.identification.logs.tables import open_table
from armwright.identification.logs.units import QUANTITIES
from armwright.model import Model
from armwright.model.load import load
from armwright.progress import Shown, automatic
from armwright.reading import opened
from armwright.validation import legible, validated

Made = TypeVar("Made")
STAND_INS: dict[str, Any] = {  # for tables that cannot be read
    "signals": [{"quantity": "current", "columns": ["a"]}],
    "runs": [{}],
    "time": {"rate_hz": 1.0},
    "gears": {"ratios": [1.0]},
}
LEAST = {"joints": ["a"], "files": {"a": {"path": "a"}}, "time": STAND_INS["time"], "signals": STAND_INS["signals"]}


def read_log(
    path: str | os.PathLike[str], *, on_error: Literal["raise", "keep"] = "raise", progress: Shown = None
) -> Log:
    """A log of measurements, read once completely and checked.

    Args:
        path: of the `*.log.toml` that maps columns of files to signals of joints.
        on_error: "raise" refuses a log that contradicts itself or its arm; "keep" returns it with these findings, to be shown.
        progress: True or None: a bar where it is seen; False: none; a function is called with runs read, and all.
    Returns:
        log: frozen; `findings` has what the checks found, `blocks` and `dataset` the signals.
    Raises:
        LogError: no such file, a key or a column that is not there, a cell that holds no number; and with "raise" all
            errors of the checks in `problems`.   DescriptionError: the robot's file is invalid.
    Example:
        >>> log = aw.identification.read_log("examples/logs/dc_motor/dc_motor.log.toml")
        >>> [run.name for run in log.runs]
        ['prbs', 'step']
    """
    if on_error not in ("raise", "keep"):
        raise LogError(place="on_error", value=on_error, expected='"raise" or "keep"')
    log, begun = open_log(path), []
    log = log if log.table.hold_out is None else replace(log, runs=tuple(_with_hold_outs(log, log.table.hold_out)))
    with automatic(progress, f"reading {log.path.name}") as tell:
        for k, run in enumerate(log.runs):
            tell(k, len(log.runs))
            sums = {key: _sha256(file) for key, file in run.paths.items()}
            begun.append(replace(run, sha256=sums, census=census_of(log, run)))
        tell(len(log.runs), len(log.runs))
    log = replace(log, runs=tuple(begun))
    findings = sorted(check_log(log), key=lambda each: LEVELS.index(each.level))
    log = replace(log, findings=tuple(findings))
    if on_error == "raise" and log.errors:
        problems = [each.problem.within(each.run and f"run {each.run!r}") for each in log.errors]
        raise LogError.of(*problems).within(file=log.path)
    return log


def open_log(path: str | os.PathLike[str]) -> Log:
    """A log with a checked file and unread rows.

    Raises:
        LogError, DescriptionError: as `read_log`.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise LogError(value=path, expected="the path of a *.log.toml file")
    path = Path(path)
    with toml_tables(path, LogError) as tables:
        try:
            table = validated(LogTable, tables, file=path, error=LogError)
        except LogError as error:
            table = legible(LogTable, tables, LEAST, STAND_INS)
            raise error if table is None else _with_others(error, path, table) from None
        return _opened(path, table)


def _with_others(error: LogError, path: Path, table: LogTable) -> LogError:
    """The error with what is wrong in a log besides.

    Args:
        error: the first.   path: of the file.   table: what could be read of it.
    """
    try:
        _opened(path, table)
    except ArmwrightError as further:
        # of a table of signals that has mistakes itself, which may stand for another, nothing further is said
        known = {re.sub(r"^(signals\[\d+\]).*", r"\1", problem.place) for problem in error.problems}
        return error.joined(
            *(each for each in further.problems if known.isdisjoint((each.place, each.place.partition(".")[0])))
        )
    return error


def _opened(path: Path, table: LogTable) -> Log:
    """The log that a file's table describes, its rows not read yet."""
    found = [problem.within(file=path) for problem in table.contradictions()]
    if found:
        raise LogError.of(*found)

    def part(made: Callable[[], Made]) -> Made | None:
        try:
            return made()
        except LogError as error:
            found.extend(error.within(file=path).problems)
            return None

    arm = None if table.robot is None else _robot(path, table)
    joints = tuple(table.joints or (() if arm is None else arm.names))
    if arm is not None:
        part(lambda: _check_names(joints, arm))
    table = table.model_copy(update={"signals": tuple(_for_all(signal, joints) for signal in table.signals)})
    gears = part(lambda: _gears(table.gears, joints, arm))
    runs = part(lambda: _runs(table, path.parent))
    if runs is None:
        raise LogError.of(*found)
    files = {key: part(partial(open_table, file, table.files[key])) for key, file in runs[0].paths.items()}
    measured = {key: each for key, each in files.items() if each is not None}
    layout = part(lambda: layout_of(table, joints, arm, measured)) if files.keys() == measured.keys() else None
    if found or layout is None:
        raise LogError.of(*found)
    held = frozenset(QUANTITIES[each.quantity].signal for each in table.signals if each.held)
    log = Log(path, table, joints, arm, gears, layout, held, runs)
    _check_sides(log)
    if arm is not None:
        check_gears(log, arm)
    return log


def _check_names(joints: tuple[str, ...], arm: Model) -> None:
    """Refuses names that are no joints of the robot."""
    wrong = [name for name in joints if name not in arm.names]
    if wrong:
        raise LogError.of(
            *(Problem("no joint of the robot", "joints", name, choices=tuple(arm.names)) for name in wrong)
        )


def _robot(path: Path, table: LogTable) -> Model:
    """The arm that a log names: a built-in one, or a file from the log's folder on."""
    name = str(table.robot)
    where = name if name in builtin_names() else path.parent / name
    return load(where, kinematics_only=True) if table.kinematics_only else load(where)


def _for_all(signal: SignalTable, joints: tuple[str, ...]) -> SignalTable:
    """A single temperature as that of all joints."""
    if signal.quantity != "temperature" or len(signal.columns) > 1 or signal.joints is not None:
        return signal
    return signal.model_copy(update={"columns": signal.columns * len(joints)})


def _gears(table: GearsTable | None, joints: tuple[str, ...], arm: Model | None) -> np.ndarray | None:
    """(n, n) N of the log's joints: from the file, else from the robot's motors; None where neither has them."""
    if table is not None:
        numbers = table.numbers()
        if len(numbers) != len(joints):
            place = "gears.ratios" if table.ratios is not None else "gears.matrix"
            raise LogError(f"{len(numbers)} motors", place=place, expected=f"{len(joints)}: {', '.join(joints)}")
        return numbers
    return None if arm is None else gears_of(arm, joints)


def _runs(table: LogTable, folder: Path) -> tuple[LogRun, ...]:
    """All runs of a file, each with a name of its own."""
    runs: list[LogRun] = []
    for number, each in enumerate(table.runs, start=1):
        for part in each.folder:
            name = each.name or (Path(part).name or f"run{number}")
            if any(run.name == name for run in runs):
                raise LogError(
                    "a second run of that name", place=f"runs[{number - 1}]", value=name, expected="a name of its own"
                )
            paths = {key: folder / part / (each.files.get(key) or str(file.path)) for key, file in table.files.items()}
            end = inf if each.to_s is None else each.to_s
            runs.append(LogRun(name, each.use, paths, begin=each.from_s, end=end))
    return tuple(runs)


def _with_hold_outs(log: Log, share: float) -> Iterator[LogRun]:
    """Every run cut in two: its beginning to be fitted, and a share of its time, at its end, to be held out."""
    for run in log.runs:
        duration = max((float(np.nanmax(b.t, initial=0.0)) for b in log.blocks(run.name)), default=0.0)
        cut = run.begin + (1.0 - share) * duration
        yield replace(run, end=cut)
        yield replace(run, name=f"{run.name}-held", use="hold-out", begin=cut)


def _check_sides(log: Log) -> None:
    """Refuses motor-side columns without gears, and some of the motors of a coupled wrist.

    Raises:
        LogError: with the table.
    """
    for k, signal in enumerate(log.table.signals):
        if signal.side == "motor":
            to_joints(log, signal, k)


def _sha256(path: Path) -> str:
    """Checksum of a file, read in parts."""
    digest = hashlib.sha256()
    with opened(path, "a measured file", LogError) as file:
        while part := file.read(2**20):
            digest.update(part)
    return digest.hexdigest()

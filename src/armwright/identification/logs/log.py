"""Logs of measurements: columns of files as signals of joints, in SI units, in blocks of rows or whole.

A log is described by a `*.log.toml` (`log_file`), its files are opened by `log_tables`, and `read_log` checks it (`log_checks`).
Nothing of the rows stays in memory but a census of them: `blocks` reads them again.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from armwright.description import builtin_names
from armwright.description.toml_file import read_document
from armwright.errors import DescriptionError, LogError, Problem
from armwright.identification.logs.clocks import Clock, Interpolated
from armwright.identification.logs.log_file import GearsTable, LogTable, SignalTable
from armwright.identification.logs.tables import MeasuredTable, open_table
from armwright.identification.logs.units import COUNTS, OF_SIGNAL, QUANTITIES, SHARES, plain_unit
from armwright.model import Model
from armwright.model.load import load
from armwright.reading import opened
from armwright.signals import Layout, Signal
from armwright.validation import validated

if TYPE_CHECKING:
    import xarray as xr

    from armwright.identification.logs.census import Census

ROWS = 65536  # of a block: a few megabytes for a whole arm
MOST_VALUES = 200_000_000  # of a run in memory: 1.6 GB
# Larger numbers are damage, and their squares would overflow.
LARGEST = 1e30  # of a signal in SI units
LATEST = 1e12  # [s] of a time
LEVELS = ("error", "note")


@dataclass(frozen=True)
class Finding:
    """One result of the checks of a log.

    Attributes:
        level: "error" where the log cannot be used as its file describes it, "note" for what a user should know.
        check: name of the check.   run: name of the run; "" of the whole log.   problem: what it is, and where.
    """

    level: Literal["error", "note"]
    check: str
    run: str
    problem: Problem

    def __str__(self) -> str:
        return f"{self.level}: {self.run}: {self.problem}" if self.run else f"{self.level}: {self.problem}"


@dataclass(frozen=True)
class Stretch:
    """Rows of a run without gap: `begin` to `end` (not included), at times `start` to `stop` [s]."""

    begin: int
    end: int
    start: float
    stop: float

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.end - self.begin

    @property
    def period(self) -> float:
        """Mean time from row to row [s]."""
        return (self.stop - self.start) / (self.rows - 1) if self.rows > 1 else 0.0


@dataclass(frozen=True)
class LogRun:
    """One run of a log.

    Attributes:
        name, use: "fit" or "hold-out".   paths: of its files, by key.   sha256: of each file, by key.
        census: numbers about all of its rows; None before the log was checked.
    """

    name: str
    use: Literal["fit", "hold-out"]
    paths: Mapping[str, Path]
    sha256: Mapping[str, str] = field(default_factory=dict)
    census: Census | None = None

    @property
    def rows(self) -> int:
        """Number of rows."""
        return 0 if self.census is None else self.census.rows

    @property
    def stretches(self) -> tuple[Stretch, ...]:
        """Rows without gaps."""
        return () if self.census is None else self.census.stretches

    @property
    def duration(self) -> float:
        """From the first row to the last [s]."""
        return 0.0 if self.census is None else self.census.last - self.census.first

    @property
    def period(self) -> float:
        """Usual time from row to row [s]."""
        return 0.0 if self.census is None else self.census.period


@dataclass(frozen=True, eq=False)
class Block:
    """Some rows of a run.

    Attributes:
        row: number of the first, from 0.   t: (rows,) [s] since the run's first row.
        values: signal → (rows, joints that have it), in the units of the log's layout.
    """

    row: int
    t: np.ndarray
    values: Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Log:
    """Measurements of an arm or of a motor, mapped to signals; `armwright.read_log` reads and checks one.

    Attributes:
        path: of the `*.log.toml`.   title: from it.   joints: names.   arm: the robot; None if the file names none.
        gears: (n, n) θ_motor = gears q; None if unknown.   layout: its signals with units and joints.
        runs: in the order of the file.   findings: of the checks, errors first.   sha256: of the file and all it names.
    """

    path: Path
    table: LogTable
    joints: tuple[str, ...]
    arm: Model | None
    gears: np.ndarray | None
    layout: Layout
    runs: tuple[LogRun, ...]
    findings: tuple[Finding, ...] = ()

    @property
    def title(self) -> str:
        """The file's title, or its name."""
        return self.table.title or self.path.name

    @property
    def sha256(self) -> str:
        """Checksum of the log: of its description and of every measured file."""
        digest = hashlib.sha256(self.table.model_dump_json().encode())
        for run in self.runs:
            for key in sorted(run.sha256):
                digest.update(f"{run.name}/{key}/{run.sha256[key]}".encode())
        return digest.hexdigest()

    @property
    def fit(self) -> tuple[str, ...]:
        """Names of the runs to fit."""
        return tuple(run.name for run in self.runs if run.use == "fit")

    @property
    def hold_out(self) -> tuple[str, ...]:
        """Names of the runs that are kept for the verdict."""
        return tuple(run.name for run in self.runs if run.use == "hold-out")

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Findings for which the log cannot be used."""
        return tuple(each for each in self.findings if each.level == "error")

    @property
    def notes(self) -> tuple[Finding, ...]:
        """All other findings."""
        return tuple(each for each in self.findings if each.level == "note")

    def run(self, name: str | None = None) -> LogRun:
        """A run by its name; None: the first.

        Raises:
            LogError: no such run.
        """
        names = [run.name for run in self.runs]
        if name is not None and name not in names:
            raise LogError("no such run", place="run", value=name, choices=names, file=self.path)
        return self.runs[0 if name is None else names.index(name)]

    def place(self, run: LogRun, signal: str, joint: int, row: int) -> str:
        """A row in its reader's words: `file.csv:12`, or `row 11` where the file has a clock of its own.

        Args:
            run: one of the log's.   signal: "time" or a name of the layout.   joint: its number.   row: from 0.
        """
        keys = (
            [self.table.only(self.table.time.file)] if signal == "time" and self.table.time.column is not None else []
        )
        for k, each in enumerate(self.table.signals):
            if QUANTITIES[each.quantity].signal == signal and joint in joint_numbers(
                each, self.joints, f"signals[{k}]"
            ):
                keys.append(self.table.only(each.file))
        if not keys or self.table.files[keys[0]].time is not None:
            return f"row {row + 1}"
        return open_table(run.paths[keys[0]], self.table.files[keys[0]]).place(row)

    def blocks(self, run: str | None = None, rows: int = ROWS) -> Iterator[Block]:
        """Rows of a run, block by block, read from its files: a log of any length in bounded memory.

        Args:
            run: its name; None: the first.   rows: of a block; the last may have fewer.
        Raises:
            LogError: as `read_log`.
        """
        return run_blocks(self, self.run(run), rows)

    def dataset(self, run: str | None = None) -> xr.Dataset:
        """A run in memory: coordinates time [s] and joint, variables of the log's signals, NaN for joints without.

        Args:
            run: its name; None: the first.
        Raises:
            LogError: as `read_log`, or a run too long: `blocks` reads it in parts.
        """
        import xarray as xr

        chosen = self.run(run)
        if chosen.rows * self.layout.size > MOST_VALUES:
            what = f"{chosen.rows} rows of {self.layout.size} values"
            raise LogError(
                what, place=f"run {chosen.name!r}", expected="Log.blocks for a run this long", file=self.path
            )
        blocks = list(self.blocks(chosen.name))
        time = ("time", np.concatenate([b.t for b in blocks]), {"units": "s", "long_name": "time"})
        variables = {}
        for signal in self.layout:
            values = np.full((len(time[1]), len(self.joints)), np.nan)
            values[:, list(signal.joints or ())] = np.concatenate([b.values[signal.name] for b in blocks])
            variables[signal.name] = (("time", "joint"), values, {"units": signal.unit, "long_name": signal.about})
        about = {"log": self.path.name, "run": chosen.name, "use": chosen.use, "log_sha256": self.sha256}
        if self.arm is not None:
            about["robot"] = self.arm.name
        return xr.Dataset(variables, {"time": time, "joint": ("joint", list(self.joints))}, about)


def read_log(
    path: str | os.PathLike[str],
    *,
    on_error: Literal["raise", "keep"] = "raise",
    progress: Callable[[int, int], object] | None = None,
) -> Log:
    """A log of measurements, read once from beginning to end and checked.

    Args:
        path: of the `*.log.toml` that maps columns of files to signals of joints.
        on_error: "raise" refuses a log that contradicts itself or its arm; "keep" returns it with these findings, to be shown.
        progress: called with the number of runs that are read, and of all.
    Returns:
        log: frozen; `findings` has what the checks found, `blocks` and `dataset` the signals.
    Raises:
        LogError: no such file, a key or a column that is not there, a cell that holds no number; and with "raise" all
            errors of the checks in `problems`.   DescriptionError: the robot's file cannot be believed.
    """
    from armwright.identification.logs.census import census_of
    from armwright.identification.logs.checks import check_log

    if on_error not in ("raise", "keep"):
        raise LogError(place="on_error", value=on_error, expected='"raise" or "keep"')
    log, begun = open_log(path), []
    for k, run in enumerate(log.runs):
        if progress is not None:
            progress(k, len(log.runs))
        sums = {key: _sha256(file) for key, file in run.paths.items()}
        begun.append(replace(run, sha256=sums, census=census_of(log, run)))
    log = replace(log, runs=tuple(begun))
    findings = sorted(check_log(log), key=lambda each: LEVELS.index(each.level))
    log = replace(log, findings=tuple(findings))
    if on_error == "raise" and log.errors:
        problems = [each.problem.within(each.run and f"run {each.run!r}") for each in log.errors]
        raise LogError.of(*problems).within(file=log.path)
    if progress is not None:
        progress(len(log.runs), len(log.runs))
    return log


def open_log(path: str | os.PathLike[str]) -> Log:
    """A log whose file is checked and whose rows are not read yet.

    Raises:
        LogError, DescriptionError: as `read_log`.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise LogError(value=path, expected="the path of a *.log.toml file")
    path = Path(path)
    try:
        document = read_document(path)
    except DescriptionError as error:
        raise LogError.of(*error.problems) from None
    table = validated(LogTable, document, file=path, error=LogError)
    arm = None if table.robot is None else _robot(path, table)
    joints = tuple(table.joints or (() if arm is None else arm.names))
    try:
        gears = _gears(table.gears, joints, arm)
        runs = _runs(table, path.parent)
        layout = _layout(
            table, joints, arm, {key: open_table(file, table.files[key]) for key, file in runs[0].paths.items()}
        )
    except LogError as error:
        raise error.within(file=path) from None
    log = Log(path, table, joints, arm, gears, layout, runs)
    _check_sides(log)
    return log


def _robot(path: Path, table: LogTable) -> Model:
    """The arm that a log names: a built-in one, or a file from the log's folder on."""
    name = str(table.robot)
    where = name if name in builtin_names() else path.parent / name
    arm = load(where, kinematics_only=True) if table.kinematics_only else load(where)
    for joint in table.joints or ():
        if joint not in arm.names:
            raise LogError("no joint of the robot", place="joints", value=joint, choices=arm.names, file=path)
    return arm


def _gears(table: GearsTable | None, joints: tuple[str, ...], arm: Model | None) -> np.ndarray | None:
    """(n, n) N of the log's joints: from the file, else from the robot's motors; None where neither has them."""
    if table is not None:
        numbers = table.numbers()
        if len(numbers) != len(joints):
            place = "gears.ratios" if table.ratios is not None else "gears.matrix"
            raise LogError(f"{len(numbers)} motors", place=place, expected=f"{len(joints)}: {', '.join(joints)}")
        return numbers
    bodies = [] if arm is None else [body for body in arm.coordinates if body.joint in joints]
    if not bodies or all(body.drive.torque_constant is None and body.drive.gear_ratio == 1.0 for body in bodies):
        return None
    numbers = np.zeros((len(joints), len(joints)))
    for body in bodies:
        row = joints.index(body.joint)
        numbers[row, row] = body.drive.gear_ratio
        for other, ratio in body.drive.coupling:
            if other in joints:
                numbers[row, joints.index(other)] = ratio
    return numbers


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
            runs.append(LogRun(name, each.use, paths))
    return tuple(runs)


def _layout(table: LogTable, joints: tuple[str, ...], arm: Model | None, tables: Mapping[str, MeasuredTable]) -> Layout:
    """The signals of a log with their units.

    Raises:
        LogError: a joint twice or none of the log's, a unit that is missing, contradicts the header, or is not the joint's.
    """
    kinds = {} if arm is None else {body.joint: body.kind for body in arm.coordinates}
    sliding: dict[int, bool] = {
        joints.index(name): kind == "prismatic" for name, kind in kinds.items() if name in joints
    }
    found: dict[str, list[int]] = {}
    for k, signal in enumerate(table.signals):
        place, kind = f"signals[{k}]", QUANTITIES[signal.quantity]
        numbers = joint_numbers(signal, joints, place)
        unit = unit_of(signal, tables[table.only(signal.file)], place)
        places = found.setdefault(kind.signal, [])
        twice = [joints[j] for j in numbers if j in places]
        if twice:
            raise LogError(f"a second {signal.quantity}", place=f"{place}.joints", value=twice[0], expected="one")
        places += numbers
        slides = kind.sided and unit in kind.sliding and unit not in kind.turning
        for j in numbers if kind.sided and signal.side == "joint" and unit not in SHARES else ():
            if sliding.setdefault(j, slides) != slides:
                expected = f"a unit of a {'prismatic' if sliding[j] else 'revolute'} joint"
                raise LogError(f"joint {joints[j]!r}", place=f"{place}.unit", value=unit, expected=expected)
    signals = []
    for name, places in found.items():
        kind = OF_SIGNAL[name]
        order = tuple(sorted(places))
        units = tuple(kind.sliding_unit if sliding.get(j, False) else kind.unit for j in order)
        signals.append(Signal(name, units, (len(order),), order, about=kind.about))
    return Layout.of(signals)


def joint_numbers(signal: SignalTable, joints: tuple[str, ...], place: str) -> list[int]:
    """Numbers of the joints whose columns a table has.

    Raises:
        LogError: an unknown joint, or one column too many or too few.
    """
    names = joints if signal.joints is None else signal.joints
    if len(names) != len(signal.columns):
        expected = f"{len(names)}, for {', '.join(names)}; or joints = [...]"
        raise LogError(f"{len(signal.columns)} columns", place=f"{place}.columns", expected=expected)
    for name in names:
        if name not in joints:
            raise LogError("no joint of the log", place=f"{place}.joints", value=name, choices=joints)
    return [joints.index(name) for name in names]


def unit_of(signal: SignalTable, table: MeasuredTable, place: str) -> str:
    """The unit of a table's columns, from the file or from the header; where both state it they agree.

    Raises:
        LogError: none, two that differ, or one that the quantity does not have.
    """
    kind, units = QUANTITIES[signal.quantity], set()
    for column in signal.columns:
        stated = plain_unit(table.unit(column) or "")
        if stated and signal.unit and stated != signal.unit:
            what = f"the header of column {column!r} says {stated!r}"
            raise LogError(what, place=f"{place}.unit", value=signal.unit, expected="one of the two", file=table.path)
        units.add(stated or signal.unit or "")
    if len(units) > 1 or "" in units:
        what = "missing" if "" in units else f"columns in {' and '.join(sorted(units))}: a table for each unit"
        raise LogError(what, place=f"{place}.unit", expected=f"one of {', '.join(kind.units)}")
    unit = units.pop()
    if unit not in kind.units:
        raise LogError(f"no unit of a {signal.quantity}", place=f"{place}.unit", value=unit, choices=kind.units)
    for name, those in (("counts_per_turn", COUNTS), ("rated", tuple(SHARES))):
        if unit in those and getattr(signal, name) is None:
            raise LogError("missing", place=f"{place}.{name}", expected=f"numbers, as the unit is {unit}")
    return unit


def _check_sides(log: Log) -> None:
    """Refuses motor-side columns without gears, and some of the motors of a coupled wrist.

    Raises:
        LogError: with the table.
    """
    for k, signal in enumerate(log.table.signals):
        if signal.side == "motor":
            _to_joints(log, signal, k)


def converted(log: Log, signal: SignalTable, number: int, values: np.ndarray, unit: str) -> np.ndarray:
    """Columns of a table as the joints' signal in SI units: q = N⁻¹ θ_motor, tau = Nᵀ tau_motor.

    Args:
        log: whose gears these are.   signal: the table, the `number`-th.   values: (rows, columns).   unit: of the columns.
    Returns:
        values: (rows, columns), columns still in the table's order.
    Raises:
        LogError: columns of the motor side and no gears, or not all motors that turn a joint.
    """
    kind = QUANTITIES[signal.quantity]
    factor: Any = kind.turning[unit] if unit in kind.turning else kind.sliding[unit]
    if unit in COUNTS:
        factor = factor / signal.per_column("counts_per_turn", 1.0)
    if unit in SHARES:
        factor = factor * signal.per_column("rated", 1.0)
    with np.errstate(over="ignore", invalid="ignore"):  # cells may hold inf; the census refuses what is too large
        values = values * (factor * signal.per_column("signs", 1.0))
        if signal.side == "motor":
            values = values @ _to_joints(log, signal, number)
        return values + signal.per_column("offsets", 0.0)


def _to_joints(log: Log, signal: SignalTable, number: int) -> np.ndarray:
    """(columns, columns) matrix that turns rows of motor values into rows of joint values."""
    place = f"signals[{number}]"
    if log.gears is None:
        expected = "[gears] with ratios or matrix, or a robot with motors"
        raise LogError("gears are not known", place=f"{place}.side", value="motor", expected=expected, file=log.path)
    chosen = joint_numbers(signal, log.joints, place)
    others = [j for j in range(len(log.joints)) if j not in chosen]
    torque = QUANTITIES[signal.quantity].signal in ("tau", "tau_link")
    matrix = log.gears.T if torque else np.linalg.inv(log.gears)  # joint values from motor values
    open_ends = np.argwhere(np.abs(matrix[np.ix_(chosen, others)]) > 1e-12 * np.abs(matrix).max())
    if len(open_ends):
        joint, motor = log.joints[chosen[open_ends[0][0]]], log.joints[others[open_ends[0][1]]]
        what = f"joint {joint!r} is coupled with the motor of {motor!r}, whose column is not among them"
        raise LogError(what, place=f"{place}.columns", file=log.path)
    return matrix[np.ix_(chosen, chosen)].T


def run_blocks(log: Log, run: LogRun, rows: int) -> Iterator[Block]:
    """Rows of a run with time and signals: the files in step, those with a clock of their own interpolated."""
    tables = {key: open_table(path, log.table.files[key]) for key, path in run.paths.items()}
    try:
        yield from _blocks(log, run, tables, rows)
    except LogError as error:
        raise error.within(f"run {run.name!r}" if not error.file else "", file=log.path) from None


def _blocks(log: Log, run: LogRun, tables: Mapping[str, MeasuredTable], rows: int) -> Iterator[Block]:
    table = log.table
    groups = {key: [(k, s) for k, s in enumerate(table.signals) if table.only(s.file) == key] for key in tables}
    units = {k: unit_of(s, tables[key], f"signals[{k}]") for key, group in groups.items() for k, s in group}
    columns = {key: [column for _, s in group for column in s.columns] for key, group in groups.items()}
    clock = Clock(table.time, None if table.time.column is None else tables[table.only(table.time.file)])
    timed = table.only(table.time.file) if table.time.column is not None else None
    in_step: dict[str, Iterator[list[np.ndarray]]] = {}
    interpolated: dict[str, Interpolated] = {}
    for key, source in tables.items():
        own = table.files[key].time
        if own is not None:
            interpolated[key] = Interpolated(source, Clock(own, source), columns[key], rows, clock)
        elif columns[key] or key == timed:
            ahead = [] if key != timed or table.time.column is None else [table.time.column]
            in_step[key] = source.blocks([*ahead, *columns[key]], rows)
    row = 0
    for parts in _in_step(in_step, tables, rows):
        times = parts[timed].pop(0) if timed is not None else None
        count = len(times) if times is not None else len(next(iter(parts.values()))[0])
        t = clock.seconds(times, row, count)
        if timed is not None:
            t = np.where(np.isfinite(t), t, np.nan)
            _refuse_absurd(t, LATEST, "s", tables[timed], table.time.column, row)
        for key, each in interpolated.items():
            parts[key] = each.at(t)
        yield Block(row, t, _signals(log, groups, units, parts, tables, row))
        row += count
    if row == 0:
        raise LogError("has no rows", file=next(iter(run.paths.values())), expected="at least two")


def _signals(
    log: Log,
    groups: Mapping[str, list[tuple[int, SignalTable]]],
    units: Mapping[int, str],
    parts: Mapping[str, list[np.ndarray]],
    tables: Mapping[str, MeasuredTable],
    row: int,
) -> dict[str, np.ndarray]:
    """Every signal (rows, joints) from the columns of the files."""
    found: dict[str, list[tuple[int, np.ndarray]]] = {}
    for key, group in groups.items():
        at = 0
        for k, signal in group:
            columns = parts[key][at : at + len(signal.columns)]
            at += len(signal.columns)
            raw = np.stack(columns, axis=1).astype(float)
            raw[~np.isfinite(raw)] = np.nan
            for values, column in zip(raw.T, signal.columns, strict=True):
                _refuse_absurd(values, LARGEST, units[k], tables[key], column, row)
            values = converted(log, signal, k, raw, units[k])
            numbers = joint_numbers(signal, log.joints, f"signals[{k}]")
            found.setdefault(QUANTITIES[signal.quantity].signal, []).extend(zip(numbers, values.T, strict=True))
    return {
        signal.name: np.stack([column for _, column in sorted(found[signal.name], key=lambda each: each[0])], axis=1)
        for signal in log.layout
    }


def _refuse_absurd(
    values: np.ndarray, most: float, unit: str, table: MeasuredTable, column: int | str | None, row: int
) -> None:
    """Refuses numbers that nothing measures, before squares of them overflow.

    Raises:
        LogError: with file and line.
    """
    absurd = np.isfinite(values) & (np.abs(values) > most)
    if absurd.any():
        k = int(np.argmax(absurd))
        expected = f"at most {most:g} {unit}"
        raise LogError(place=f"column {column!r}", value=float(values[k]), expected=expected, file=table.place(row + k))


def _in_step(
    sources: Mapping[str, Iterator[list[np.ndarray]]], tables: Mapping[str, MeasuredTable], rows: int
) -> Iterator[dict[str, list[np.ndarray]]]:
    """Blocks of several files whose rows belong together; one may have one row fewer, as inputs between samples have.

    Raises:
        LogError: files of different length.
    """
    if not sources:
        raise LogError("every file has a clock of its own", place="files", expected="one file with the log's clock")
    total = dict.fromkeys(sources, 0)
    ended = False
    while True:
        parts = {key: next(source, None) for key, source in sources.items()}
        for key, part in parts.items():
            total[key] += 0 if part is None else len(part[0])
        if max(total.values()) - min(total.values()) > 1:
            for key, source in sources.items():
                total[key] += sum(len(part[0]) for part in source)
            listed = ", ".join(f"{tables[key].path.name} {count}" for key, count in total.items())
            expected = "files with a row for each sample, or [files.KEY.time] for one with a clock of its own"
            raise LogError(f"files of different length: {listed} rows", expected=expected)
        count = min(0 if part is None else len(part[0]) for part in parts.values())
        if count and not ended:
            yield {key: [column[:count] for column in part or ()] for key, part in parts.items()}
        ended = ended or count < rows
        if all(part is None for part in parts.values()):
            return


def _sha256(path: Path) -> str:
    """Checksum of a file, read in parts."""
    digest = hashlib.sha256()
    with opened(path, "a measured file", LogError) as file:
        while part := file.read(2**20):
            digest.update(part)
    return digest.hexdigest()

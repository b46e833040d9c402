"""Logs of measurements: runs of an arm or a motor as signals of joints, in SI units, in blocks of rows or whole.

`read_log` (read.py) makes one of the `*.log.toml` that describes it. No rows stay in memory but a census of them: `blocks` reads
them again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from armwright.errors import LogError
from armwright.identification.logs.blocks import ROWS, Block, run_blocks
from armwright.identification.logs.census import Census
from armwright.identification.logs.columns import joint_numbers
from armwright.identification.logs.findings import LogFinding
from armwright.identification.logs.log_file import LogTable
from armwright.identification.logs.stretches import EvenRows, Span
from armwright.identification.logs.tables import open_table
from armwright.identification.logs.units import QUANTITIES
from armwright.model import Model
from armwright.signals import Layout

if TYPE_CHECKING:
    import xarray as xr

MOST_VALUES = 200_000_000  # of a run in memory: 1.6 GB


@dataclass(frozen=True)
class LogRun:
    """One run of a log.

    Attributes:
        name, use: "fit" or "hold-out".   paths: of its files, by key.   sha256: of each file, by key.
        census: numbers about all of its rows; of none before the log was read.
        begin, end: of its part of the files [s], from their first row.
    """

    name: str
    use: Literal["fit", "hold-out"]
    paths: Mapping[str, Path]
    sha256: Mapping[str, str] = field(default_factory=dict)
    census: Census = field(default_factory=lambda: Census({}))
    begin: float = 0.0
    end: float = inf

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.census.rows

    @property
    def stretches(self) -> tuple[Span, ...]:
        """Rows without gaps but those that are bridged."""
        return tuple(self.census.stretches)

    @property
    def even(self) -> tuple[EvenRows, ...]:
        """Its rows as preparation takes them, stretch by stretch."""
        return tuple(EvenRows.of(each, self.period) for each in self.stretches)

    @property
    def duration(self) -> float:
        """From the first row to the last [s]."""
        return self.census.last - self.census.first

    @property
    def period(self) -> float:
        """Usual time from row to row [s]."""
        return self.census.period


@dataclass(frozen=True, eq=False)
class Log:
    """Measurements of an arm or of a motor, mapped to signals; `aw.identification.read_log` reads and checks one.

    Attributes:
        path: of the `*.log.toml`.   title: from it.   joints: names.   arm: the robot; None if the file names none.
        gears: (n, n) θ_motor = gears q; None if unknown.   layout: its signals with units and joints.
        held: signals that are constant until the next row, as commands are.
        runs: in the order of the file.   findings: of the checks, errors first.   sha256: of the file and all it names.
    """

    path: Path
    table: LogTable
    joints: tuple[str, ...]
    arm: Model | None
    gears: np.ndarray | None
    layout: Layout
    held: frozenset[str]
    runs: tuple[LogRun, ...]
    findings: tuple[LogFinding, ...] = ()

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
        """Names of the runs reserved for validation."""
        return tuple(run.name for run in self.runs if run.use == "hold-out")

    @property
    def lacks(self) -> tuple[str, ...]:
        """Terms that its torques are without, such as "gravity"."""
        return tuple(dict.fromkeys(term for signal in self.table.signals for term in signal.lacks))

    @property
    def errors(self) -> tuple[LogFinding, ...]:
        """Findings that make the log unusable."""
        return tuple(each for each in self.findings if each.level == "error")

    @property
    def warnings(self) -> tuple[LogFinding, ...]:
        """Findings that may falsify the numbers of a fit; every fit repeats them among its remarks."""
        return tuple(each for each in self.findings if each.level == "warning")

    @property
    def notes(self) -> tuple[LogFinding, ...]:
        """All findings but errors."""
        return tuple(each for each in self.findings if each.level != "error")

    def run(self, name: str | None = None) -> LogRun:
        """A run by its name; None: the first.

        Raises:
            LogError: no such run.
        """
        names = [run.name for run in self.runs]
        if name is not None and name not in names:
            raise LogError("no such run", place="run", value=name, choices=names, file=self.path)
        return self.runs[0 if name is None else names.index(name)]

    def place(self, run: LogRun, row: int) -> str:
        """The row of a run's clock in the reader's words: `file.csv:12`, or `row 11` where the clock is a rate.

        Args:
            run: one of the log's.   row: from 0.
        """
        if self.table.time.column is None:
            return f"row {row + 1}"
        key = self.table.only(self.table.time.file)
        table = open_table(run.paths[key], self.table.files[key])
        return f"{table.place(run.census.excerpt.before + row)}, column {self.table.time.column!r}"

    def missing_cell(self, run: LogRun, signal: str, joint: int, row: int) -> str:
        """The cell that leaves a signal without a number: `file.csv:12, column 'q1'`, with its value where that is infinite.

        Args:
            run: one of the log's.   signal: a name of the layout.   joint: its number.   row: from 0, of the log's clock; in a
                file with its own clock the cell is the first without a number.
        """
        for k, each in enumerate(self.table.signals):
            numbers = joint_numbers(each, self.joints, f"signals[{k}]")
            if QUANTITIES[each.quantity].signal == signal and joint in numbers:
                break
        else:
            return f"row {row + 1}"
        key = self.table.only(each.file)
        mixes = each.side == "motor" and self.gears is not None and np.count_nonzero(self.gears) > len(self.gears)
        columns = each.columns if mixes else (each.columns[numbers.index(joint)],)
        table, own = open_table(run.paths[key], self.table.files[key]), self.table.files[key].time is not None
        first = 0 if own else run.census.excerpt.before + row
        at = 0
        for block in table.blocks(columns, ROWS):
            cells = np.stack(block, axis=1).astype(float)[max(first - at, 0) :]
            rows, places = np.nonzero(~np.isfinite(cells))
            if len(rows) and (own or rows[0] == 0):
                value = cells[rows[0], places[0]]
                shown = "" if np.isnan(value) else f" = {value:g}"
                return f"{table.place(max(first, at) + int(rows[0]))}, column {columns[int(places[0])]!r}{shown}"
            at += len(block[0])
            if not own and at > first:
                break
        return f"row {row + 1}, for which {table.path} has no time"

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

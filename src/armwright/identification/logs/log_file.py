"""Records of a log file, `*.log.toml`, which maps columns of measured files to signals of joints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, model_validator

from armwright.errors import Problem
from armwright.identification.logs.units import COUNTS, QUANTITIES, SHARES, plain_unit
from armwright.quantity import Record
from armwright.validation import SEEN, Invalid

Text = Annotated[str, Field(min_length=1)]
Seen = Annotated[str, Field(min_length=1, pattern=SEEN)]
Whole = Annotated[int, Field(strict=True, ge=0)]
Above0 = Annotated[float, Field(gt=0)]


def _listed(value: Any) -> Any:
    """One value as a list of one."""
    return value if isinstance(value, (list, tuple)) else (value,)


def _delimiter(value: str) -> str:
    """A mark that is part of no number, name or quotation."""
    if value != "\t" and (not value.isascii() or not value.isprintable() or value.isalnum() or value in "\"'.+-_\\"):
        raise Invalid(value=value, expected='a mark such as ",", ";", "|", ":", a tab or a blank')
    return value


def _known_unit(value: Any) -> Any:
    units = sorted({unit for kind in QUANTITIES.values() for unit in kind.units})
    if isinstance(value, str):
        value = plain_unit(value)
        if value not in units:
            raise Invalid(expected="a unit of the quantity", choices=units)
    return value


def _column(value: Any) -> Any:
    """A column's name, or its number from 1."""
    if isinstance(value, bool) or not isinstance(value, (str, int)) or value == "":
        raise Invalid(expected="the name of a column, or its number from 1")
    if isinstance(value, int) and value < 1:
        raise Invalid(expected="a column's number from 1")
    return value


Column = Annotated[int | str, BeforeValidator(_column)]
Numbers = Annotated[tuple[float, ...], Field(min_length=1), BeforeValidator(_listed)]


class OwnTime(Record):
    """Clock of one file, if it differs from the log's: its signals are interpolated at the log's times."""

    column: Column | None = Field(default=None, description="Name of the column, or its number from 1.")
    unit: Literal["s", "ms", "us", "µs", "ns", "min"] | None = Field(
        default=None, description="Of the column; absent where its header states it."
    )
    rate_hz: Above0 | None = Field(default=None, description="Rows in a second, where no column holds the time.")

    @model_validator(mode="after")
    def _one_way(self) -> OwnTime:
        if (self.column is None) == (self.rate_hz is None):
            raise Invalid(expected="either column (with unit) or rate_hz")
        for key in ("unit", "file"):
            if self.rate_hz is not None and getattr(self, key, None) is not None:
                raise Invalid("goes with column, not with rate_hz", place=key)
        return self


class TimeTable(OwnTime):
    """Sampling times: a column with its unit, or a constant rate."""

    file: Text | None = Field(default=None, description="Key of the file that has the column; absent: the only one.")


class FileTable(Record):
    """A file of every run, and its text format."""

    path: Text | None = Field(default=None, description="In the run's folder; absent: each run names its own.")
    header: bool = Field(
        default=True, description="false: the first line has numbers already, and columns have numbers."
    )
    delimiter: Annotated[str, Field(min_length=1, max_length=1), AfterValidator(_delimiter)] = Field(
        default=",", description="What separates the cells of a text file; a blank stands for any number of blanks."
    )
    decimal: Literal[".", ","] = Field(default=".", description="The decimal mark of a text file.")
    skip_lines: Whole = Field(default=0, description="Lines before the header, or before the first row.")
    topic: Text | None = Field(
        default=None, description="Of an MCAP file: whose messages (sensor_msgs/JointState) are rows."
    )
    lane: Whole | None = Field(default=None, description="Of a simulated run with lanes: which; absent: the first.")
    time: OwnTime | None = Field(default=None, description="Its own clock; absent: its rows are the rows of the log.")

    @model_validator(mode="after")
    def _apart(self) -> FileTable:
        if self.decimal == self.delimiter and "decimal" in self.model_fields_set:
            raise Invalid("is the delimiter too", place="decimal", value=self.decimal, expected="another delimiter")
        return self


class RunTable(Record):
    """One run, or several of the same kind in separate folders."""

    name: Seen | None = Field(default=None, description="What results call it; absent: its folder, or a number.")
    folder: Annotated[tuple[Text, ...], BeforeValidator(_listed)] = Field(
        default=(".",),
        min_length=1,
        description="Where its files are, from this file; a list is a run for each folder.",
    )
    files: dict[str, Text] = Field(default_factory=dict, description="KEY = path, where runs name files differently.")
    use: Literal["fit", "hold-out"] = Field(default="fit", description="For fitting, or kept for the verdict.")
    from_s: Annotated[float, Field(ge=0)] = Field(
        default=0.0,
        description="Begins at the first row so long after the file's first, or later; for a part of a file.",
    )
    to_s: Above0 | None = Field(default=None, description="Ends before the row so long after the file's first.")

    @model_validator(mode="after")
    def _in_order(self) -> RunTable:
        if self.to_s is not None and self.to_s <= self.from_s:
            raise Invalid(place="to_s", value=self.to_s, expected=f"above from_s, {self.from_s:g} s")
        return self

    @model_validator(mode="after")
    def _named(self) -> RunTable:
        if self.name is not None and len(self.folder) > 1:
            raise Invalid("one name for several runs", place="name", value=self.name, expected="one folder, or no name")
        return self

    def overlaps(self, other: RunTable) -> bool:
        """True of a run that shares rows with another."""
        same = bool(set(self.folder) & set(other.folder)) and self.files == other.files
        ends = [float("inf") if each.to_s is None else each.to_s for each in (self, other)]
        return same and self.from_s < ends[1] and other.from_s < ends[0]


class SignalTable(Record):
    """Columns of one quantity, one for each joint."""

    quantity: Literal[
        "position", "speed", "acceleration", "torque", "link torque", "current", "voltage", "temperature"
    ] = Field(description="What the columns hold.")
    columns: Annotated[tuple[Column, ...], BeforeValidator(_listed)] = Field(
        min_length=1,
        description="Names, or numbers from 1, in the order of the joints; one temperature may stand for all.",
    )
    file: Text | None = Field(default=None, description="Key of the file that has them; absent: the only one.")
    joints: Annotated[tuple[Seen, ...], BeforeValidator(_listed)] | None = Field(
        default=None, description="Whose they are; absent: all joints in order."
    )
    unit: Annotated[str, BeforeValidator(_known_unit)] | None = Field(
        default=None, description="Of all the columns; absent where their headers state it."
    )
    side: Literal["joint", "motor"] | None = Field(
        default=None,
        description="Behind the gear or before it; needed but for voltage, current and temperature, which are the motor's.",
    )
    signs: Numbers | None = Field(default=None, description="1 or -1 for each column, or for all; absent: 1.")
    counts_per_turn: Numbers | None = Field(default=None, description="Of an encoder whose columns are in counts.")
    rated: Numbers | None = Field(
        default=None, description="What 100 % stands for, in N m, N, A or V on the column's side."
    )
    offsets: Numbers | None = Field(
        default=None, description="Added at the joint after all else, in the SI unit; absent: 0."
    )
    lacks: tuple[Literal["gravity", "springs", "rotors", "viscous", "coulomb", "offset"], ...] = Field(
        default=(),
        description="Of a torque: terms that were taken off it before it was logged, as of gravity compensation.",
    )

    held: bool = Field(
        default=False,
        description="true: each value holds until the next row, as of a command; false: it is that of its row's instant.",
    )

    @model_validator(mode="after")
    def _consistent(self) -> SignalTable:
        found = tuple(self._contradictions())
        if found:
            raise Invalid.of(*found)
        return self

    def _contradictions(self) -> Iterator[Problem]:
        """Keys that do not go together."""
        kind = QUANTITIES[self.quantity]
        if self.held and kind.signal not in ("tau", "current", "voltage"):
            yield Problem("goes with a torque, current or voltage", "held", True)
        if self.joints is not None and len(self.joints) != len(self.columns):
            yield Problem("", "joints", self.joints, f"{len(self.columns)}, one for each column")
        if self.lacks and kind.signal not in ("tau", "tau_link"):
            yield Problem("goes with a torque", "lacks", self.lacks[0])
        if self.unit is not None and self.unit not in kind.units:
            yield Problem(f"no unit of a {self.quantity}", "unit", self.unit, choices=tuple(kind.units))
        if kind.sided != (self.side is not None):
            expected = '"joint" or "motor"' if kind.sided else f"no side: a {self.quantity} is always the motor's"
            yield Problem("missing" if kind.sided else "", "side", expected=expected)
        for name in ("signs", "counts_per_turn", "rated", "offsets"):
            values = getattr(self, name)
            if values is not None and len(values) not in (1, len(self.columns)):
                yield Problem("", name, values, f"one number, or {len(self.columns)}")
        if self.signs is not None and any(abs(sign) != 1 for sign in self.signs):
            yield Problem("", "signs", self.signs, "1 or -1")
        for name, units in (("counts_per_turn", COUNTS), ("rated", tuple(SHARES))):
            values = getattr(self, name)
            if values is not None and min(values) <= 0:
                yield Problem("", name, values, "numbers above 0 (a direction is a matter of signs)")
            if self.unit is not None and (self.unit in units) != (values is not None):
                what = f"needed with unit {self.unit}" if values is None else f"goes with {' or '.join(units)}"
                yield Problem(what, name)

    def per_column(self, name: str, otherwise: float) -> np.ndarray:
        """(columns,) the numbers of a key; a single number is used for all columns."""
        values = getattr(self, name)
        return np.broadcast_to(np.array(otherwise if values is None else values, dtype=float), len(self.columns))


MOST_JOINTS = 1000  # the rank of a larger matrix would take minutes


class GearsTable(Record):
    """Gears between motor and joint columns: θ_motor = N q, tau_joint = Nᵀ tau_motor; absent: those of the robot's record."""

    ratios: Annotated[tuple[float, ...], Field(min_length=1, max_length=MOST_JOINTS)] | None = Field(
        default=None, description="The diagonal of N, one for each joint [motor rad / joint rad, or rad/m], signed."
    )
    matrix: Annotated[tuple[tuple[float, ...], ...], Field(max_length=MOST_JOINTS)] | None = Field(
        default=None, description="All of N, a row for each motor: coupled wrists have numbers beside the diagonal."
    )

    @model_validator(mode="after")
    def _invertible(self) -> GearsTable:
        if (self.ratios is None) == (self.matrix is None):
            raise Invalid(expected="either ratios or matrix")
        if self.matrix is not None and any(len(row) != len(self.matrix) for row in self.matrix):
            raise Invalid(place="matrix", expected=f"{len(self.matrix)} rows of {len(self.matrix)} numbers")
        matrix = self.numbers()
        if not np.isfinite(matrix).all() or np.linalg.matrix_rank(matrix) < len(matrix):
            place = "ratios" if self.matrix is None else "matrix"
            raise Invalid("cannot be inverted", place=place, expected="gears that turn each joint")
        return self

    def numbers(self) -> np.ndarray:
        """N (n, n)."""
        return np.diag(self.ratios) if self.ratios is not None else np.array(self.matrix, dtype=float)


class LogTable(Record):
    """A whole log: files, runs, clock, gears and signals."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    title: str | None = Field(default=None, description="One line for whoever reads the file.")
    robot: Text | None = Field(
        default=None, description="A built-in arm, or a robot file beside this one, which also gives gears and limits."
    )
    kinematics_only: bool = Field(default=False, description="true: links of the robot file may lack mass properties.")
    joints: tuple[Text, ...] | None = Field(
        default=None, min_length=1, description="Names in order; absent: the robot's. A log without a robot needs them."
    )
    files: dict[str, FileTable] = Field(min_length=1, description="[files.KEY]: one table for each file of a run.")
    runs: tuple[RunTable, ...] = Field(default=(RunTable(),), min_length=1, description="[[runs]]; absent: one run.")
    hold_out: Annotated[float, Field(gt=0, lt=1)] | None = Field(
        default=None, description="Share of every run's time, at its end, that becomes a hold-out run of its own."
    )
    time: TimeTable = Field(description="The log's clock.")
    gears: GearsTable | None = Field(default=None, description="Between motor and joint side.")
    signals: tuple[SignalTable, ...] = Field(
        min_length=1, description="[[signals]]: one table for each quantity and file."
    )

    def contradictions(self) -> Iterator[Problem]:
        """Contradictions in the file: joints without columns, keys of undeclared files, files without a path, two clocks."""
        if self.robot is None and self.joints is None:
            yield Problem("missing", "joints", expected="names of the joints, or robot")
        if self.joints is not None and len(set(self.joints)) < len(self.joints):
            yield Problem("a name twice", "joints", self.joints)
        if self.hold_out is not None and any(run.use == "hold-out" for run in self.runs):
            yield Problem("goes with runs that are all to be fitted", "hold_out", self.hold_out)
        for k, run in enumerate(self.runs):
            if run.use == "hold-out" and any(run.overlaps(each) for each in self.runs if each.use == "fit"):
                yield Problem(
                    "holds out rows that are fitted", f"runs[{k}]", expected="from_s, to_s or files of its own"
                )
        if self.kinematics_only and self.robot is None:
            yield Problem("goes with robot", "kinematics_only")
        places = [(f"signals[{k}].file", signal.file) for k, signal in enumerate(self.signals)]
        if self.time.column is not None:
            places.append(("time.file", self.time.file))
        for place, key in places:
            if key is None and len(self.files) > 1:
                yield Problem("missing", place, expected=f"one of {', '.join(self.files)}")
            if key is not None and key not in self.files:
                yield Problem("no such file", place, key, choices=tuple(self.files))
        for k, run in enumerate(self.runs):
            for key in run.files:
                if key not in self.files:
                    yield Problem("no such file", f"runs[{k}].files", key, choices=tuple(self.files))
            for key, file in self.files.items():
                if file.path is None and key not in run.files:
                    yield Problem("missing", f"files.{key}.path", expected=f"a path here or in runs[{k}].files")
        clock = None if self.time.column is None else self.files.get(self.only(self.time.file))
        if clock is not None and clock.time is not None:
            yield Problem("has a clock of its own", "time.file", expected="a file without [files.KEY.time]")

    def only(self, key: str | None) -> str:
        """A file's key; if absent, that of the only file."""
        return next(iter(self.files)) if key is None else key

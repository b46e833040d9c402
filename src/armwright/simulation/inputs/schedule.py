"""Drive commands against time, held from row to row: the report's voltage schedule, in each joint's own unit."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.errors import Problem, ScheduleError
from armwright.results.csv_tables import CsvColumn, parse_numbers, table_text

COMMAND_UNITS = ("V", "A", "N m", "N")


@dataclass(frozen=True, eq=False)
class Schedule:
    """Commands that each hold from their time until the next one's; the last one holds for good.

    Args:
        times: (k,) [s], increasing from 0.
        commands: (k, n) [V | A | N m | N], each in the unit of its joint's drive command.
        names: (n,) the joints.
    Raises:
        ScheduleError: shapes that do not fit, numbers that are not finite, times that do not increase from 0.
    Example:
        >>> pulse = aw.Schedule([0.0, 0.1], [[5.0, 0.0], [0.0, 0.0]], ("shoulder", "elbow"))
        >>> run = aw.simulate(aw.Scenario("two-link", 0.2, command=pulse))
        >>> run.u.values[[0, -1]]
        array([[5., 0.],
               [0., 0.]])
    """

    times: np.ndarray
    commands: np.ndarray
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        names = _texts(self.names)
        times, commands = _frozen(self.times, "times"), _frozen(self.commands, "commands")
        if times.ndim != 1 or not len(times):
            raise ScheduleError(f"shape {times.shape}", place="times", expected="(k,) with at least one row")
        if commands.shape != (len(times), len(names)):
            expected = f"{(len(times), len(names))}: one row a time, one column for each of {', '.join(names)}"
            raise ScheduleError(f"shape {commands.shape}", place="commands", expected=expected)
        for name, values in (("times", times), ("commands", commands)):
            if not np.isfinite(values).all():
                at = tuple(int(k) for k in np.argwhere(~np.isfinite(values))[0])
                place = f"{name}[{', '.join(map(str, at))}]"
                raise ScheduleError(place=place, value=float(values[at]), expected="finite numbers")
        row = out_of_order(times)
        if row is not None:
            raise ScheduleError.of(time_problem(times, row).within(f"times[{row}]"))
        for field, value in (("times", times), ("commands", commands), ("names", names)):
            object.__setattr__(self, field, value)

    @classmethod
    def constant(cls, names: Sequence[str], values: Sequence[float] | np.ndarray) -> Schedule:
        """One command, (n,) in each joint's own unit, that holds from the beginning."""
        return cls(np.zeros(1), np.asarray(values, dtype=float)[None], tuple(names))

    def at(self, time: float) -> np.ndarray:
        """(n,) the command that holds from `time` [s] on; a row's own time counts to the row.

        Raises:
            ScheduleError: no time, several, or NaN.
        """
        number = scalar.numbers_or_nan(time)
        if number.ndim or np.isnan(number):
            raise ScheduleError(place="time", value=time, expected="one number [s]")
        return self.commands[max(int(np.searchsorted(self.times, number, side="right")) - 1, 0)]

    def __repr__(self) -> str:
        rows = "1 row" if len(self.times) == 1 else f"{len(self.times)} rows until {self.times[-1]:g} s"
        return f"<schedule for {', '.join(self.names)}: {rows}>"


def _texts(names: Sequence[str]) -> tuple[str, ...]:
    """The names, if they are texts in a list."""
    is_list = isinstance(names, (list, tuple)) or (isinstance(names, np.ndarray) and names.ndim == 1)
    texts = tuple(names) if is_list else (None,)
    if not all(isinstance(text, str) for text in texts):
        raise ScheduleError(place="names", value=names, expected="a list of the joints' names")
    return texts  # type: ignore[return-value]


def _frozen(values: np.ndarray, name: str) -> np.ndarray:
    try:
        array = scalar.real_numbers(values).copy()
    except ValueError:
        raise ScheduleError(place=name, value=values, expected="an array of numbers") from None
    array.flags.writeable = False
    return array


def out_of_order(times: np.ndarray) -> int | None:
    """The first row that breaks the rule: 0 first, then increasing."""
    if times[0] != 0.0:
        return 0
    late = np.flatnonzero(np.diff(times) <= 0)
    return int(late[0]) + 1 if len(late) else None


def time_problem(times: np.ndarray, row: int) -> Problem:
    """The problem of a row that is out of order, without its place."""
    value = float(times[row])
    if row == 0:
        return Problem(value=value, expected="the first time to be 0")
    before = float(times[row - 1])
    what = "repeats the time before it" if value == before else f"earlier than {before:.10g} before it"
    return Problem(what, value=value, expected="times to increase")


def read_schedule(path: str | os.PathLike[str], names: Sequence[str], units: Sequence[str] | None = None) -> Schedule:
    """A schedule from a CSV file: `t` [s] and one column a motor, held between rows.

    With a header row the columns are `t` and the joints' names in any order; without one they are `t` and the joints in
    the order of `names`. A header may state units, `elbow [V]`, which are then compared.

    Args:
        path: the file.   names: (n,) the joints.   units: (n,) the unit of each joint's command, if known.
    Returns:
        schedule: commands (k, n) in the order of `names`.
    Raises:
        ScheduleError: a file that is no such table (see `read_numbers`), or times that do not increase from 0; one line
            that names file, line, column, value and what was expected.
    Example:
        >>> arm = aw.load("cmu-dd")
        >>> schedule = aw.simulation.read_schedule("examples/cmu-dd-steps.csv", arm.names)
        >>> schedule.times
        array([0. , 0.6, 1.2])
    """
    return parse_schedule(table_text(path), os.fspath(path), names, units)


def parse_schedule(text: str, place: str, names: Sequence[str], units: Sequence[str] | None = None) -> Schedule:
    """A schedule from the text of a CSV file; `place` is what errors call it. See `read_schedule`."""
    names = _texts(names)
    if units is not None and len(units) != len(names):
        raise ScheduleError(place="units", value=list(units), expected=f"one for each of {len(names)} joints")
    stated = [COMMAND_UNITS] * len(names) if units is None else [(unit,) for unit in units]
    columns = [CsvColumn("t", ("s",)), *(CsvColumn(name, unit) for name, unit in zip(names, stated, strict=True))]
    table = parse_numbers(text, place, columns)
    times = table.values[:, 0]
    row = out_of_order(times)
    if row is not None:
        raise ScheduleError.of(time_problem(times, row).within("column 't'", file=f"{place}:{table.lines[row]}"))
    return Schedule(times, table.values[:, 1:], tuple(names))

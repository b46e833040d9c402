"""Inputs of an arm over time, each row from its time until the next: commands, a wrench on its tip, its brakes.

Each is a `Schedule`, or constant numbers; a `Batch` of either for lanes. In ticks of a loop, a row within rounding of a tick is
moved onto it; the integrator lands on other rows inside a tick.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.kernels.loop import Schedules
from armwright.model import Model
from armwright.parameters import Batch, numbers_by_lane
from armwright.simulation.inputs.schedule import Schedule

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")  # [N] and [N m], in base axes
LANDING = 1e-9  # of a tick: a row this near to one is meant to be on it


@dataclass(frozen=True, eq=False)
class LaneRows:
    """As many rows for every lane, each from its time on; of rows that come together the last one holds.

    Attributes:
        times: (lanes or 1, rows) [s], from 0, none before the one before it.   values: (lanes or 1, rows, entries).
    """

    times: np.ndarray
    values: np.ndarray


# Of all lanes or one a lane; an array (lanes or 1, entries) is constant.
InputSchedule = list[Schedule] | np.ndarray | LaneRows


def lane_numbers(place: str, value: Any, columns: Sequence[str]) -> np.ndarray:
    """(lanes or 1, k) finite numbers, one for each of k columns; a row a lane of a `Batch`.

    Raises:
        ScenarioError: names the field, and its columns.
    """
    n = len(columns)
    try:
        rows = numbers_by_lane(value)
    except ValueError:
        raise ScenarioError(place=place, value=value, expected=f"{n} numbers: {', '.join(columns)}") from None
    if rows.shape[1:] != (n,):
        batch = "; rows that differ by lane are a Batch" if rows.ndim == 3 and rows.shape[2] == n else ""
        what = f"shape {rows.shape[1:]}{' in each lane' if isinstance(value, Batch) else ''}"
        raise ScenarioError(what, place=place, expected=f"({n},): {', '.join(columns)}{batch}")
    if not np.isfinite(rows).all():
        raise ScenarioError(place=place, value=rows[~np.isfinite(rows)][0], expected="finite numbers")
    return rows


def input_schedule(place: str, value: Any, columns: Sequence[str]) -> InputSchedule:
    """An input over time, for all lanes or a lane each.

    Args:
        place: of the field, for errors.   value: numbers, a schedule or a `Batch` of either.
        columns: names of its entries; schedules may have them in any order.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    """
    if isinstance(value, Batch) and value.shape is None:
        return [in_order(place, each, columns) for each in value.values]
    return [in_order(place, value, columns)] if isinstance(value, Schedule) else lane_numbers(place, value, columns)


def in_order(place: str, schedule: Any, columns: Sequence[str]) -> Schedule:
    """The schedule with its columns in this order.

    Raises:
        ScenarioError: no schedule, or one with other columns.
    """
    if not isinstance(schedule, Schedule):
        expected = "an aw.Schedule, as Schedule(…) or read_schedule(path, names) gives, or a Batch of such"
        raise ScenarioError(place=place, value=schedule, expected=expected)
    if tuple(schedule.names) == tuple(columns):
        return schedule
    if sorted(schedule.names) != sorted(columns):
        raise ScenarioError(
            "columns of the schedule", place=place, value=list(schedule.names), expected=", ".join(columns)
        )
    order = [schedule.names.index(column) for column in columns]
    return Schedule(schedule.times, schedule.commands[:, order], tuple(columns))


def wrench_schedule(arm: Model, value: Any) -> InputSchedule:
    """The wrench on the tip, six columns in base axes.

    Raises:
        ScenarioError: as `input_schedule`.   ModelError: an arm without a tip, where the wrench would act.
    """
    arm.frame()
    return input_schedule("wrench", value, WRENCH)


def brake_schedule(arm: Model, value: Any) -> InputSchedule:
    """1 where a brake is applied, else 0: a column for every joint that has one; a single number is for all of them.

    Raises:
        ScenarioError: an arm without brakes, or other numbers.
    """
    joints = [body.joint for body in arm.coordinates if body.brake is not None]
    if not joints:
        raise ScenarioError(f"no joint of {arm.name} has a brake in its record", place="brake")
    return _switches("brake", value, joints, "1, applied, or 0, released")


def enabled_schedule(arm: Model, value: Any) -> InputSchedule:
    """1 where a servo is on, else 0: a column for every joint that follows a goal; a single number is for all of them.

    Raises:
        ScenarioError: an arm without servos, or one with an inductance, whose current an open bridge would cut; other numbers.
    """
    servos = [body for body in arm.coordinates if body.drive.firmware is not None]
    if not servos:
        raise ScenarioError(f"no joint of {arm.name} has a servo's firmware in its record", place="enabled")
    for body in servos:
        if body.drive.inductance is not None:
            what, expected = (
                f"{body.joint} has an inductance",
                "a motor without inductance_h, whose current is 0 at once",
            )
            raise ScenarioError(what, place="enabled", expected=expected)
    return _switches("enabled", value, [body.joint for body in servos], "1, on, or 0, off")


def supply_schedule(arm: Model, value: Any) -> InputSchedule:
    """The voltage of the supply of all drives [V].

    Raises:
        ScenarioError: a record with a supply of its own; voltages that are not above 0.
    """
    if arm.supply is not None:
        what, expected = f"{arm.name} has a [supply], whose voltage is computed", "an arm without it"
        raise ScenarioError(what, place="supply", expected=expected)
    if not isinstance(value, (Batch, Schedule)) and np.ndim(value) == 0:
        value = [value]
    elif isinstance(value, Batch) and value.shape == ():
        value = Batch(value.values[:, None])
    schedule = input_schedule("supply", value, ("supply",))
    rows = all_rows(schedule)
    if not (rows > 0.0).all():
        raise ScenarioError(place="supply", value=float(rows.min()), expected="voltages above 0 [V]")
    return schedule


def _switches(name: str, value: Any, joints: list[str], expected: str) -> InputSchedule:
    """Rows of 0 and 1, a column for each of these joints; a single number is for all of them."""
    if isinstance(value, Batch) and value.shape == ():
        value = Batch(np.repeat(value.values[:, None], len(joints), axis=1))
    elif not isinstance(value, (Batch, Schedule)) and np.ndim(value) == 0:
        value = [value] * len(joints)
    schedule = input_schedule(name, value, joints)
    rows = all_rows(schedule)
    wrong = (rows != 0.0) & (rows != 1.0)
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        raise ScenarioError(place=f"{name} of {joints[column]}", value=float(rows[row, column]), expected=expected)
    return schedule


def all_rows(schedule: InputSchedule) -> np.ndarray:
    """(rows, entries) values of all lanes and times; those of a schedule that lanes share come once."""
    if isinstance(schedule, LaneRows):
        return schedule.values.reshape(-1, schedule.values.shape[2])
    if isinstance(schedule, np.ndarray):
        return schedule
    return np.concatenate([each.commands for each in _distinct(schedule)[0]])


def _distinct(schedules: Sequence[Schedule]) -> tuple[list[Schedule], list[int]]:
    """The schedules without repetition, and which of them each lane has."""
    places: dict[int, int] = {}
    of_lane = [places.setdefault(id(each), len(places)) for each in schedules]
    return [schedules[of_lane.index(k)] for k in range(len(places))], of_lane


def landing_times(times: np.ndarray, tick: float) -> tuple[np.ndarray, np.ndarray]:
    """Ticks, and offsets [s] behind them, at which a schedule's rows come.

    Args:
        times: (rows,) [s].   tick: [s].
    """
    ticks = np.rint(times / tick)
    on = np.abs(times - ticks * tick) <= LANDING * tick
    ticks = np.where(on, ticks, np.floor(times / tick))
    return ticks, np.where(on, 0.0, times - ticks * tick)


def landing_rows(schedule: InputSchedule, tick: float) -> Schedules:
    """Rows of all lanes with their ticks; lanes of constant values, or with the same times, share their times."""
    if isinstance(schedule, np.ndarray):
        count, zeros = np.arange(len(schedule)), np.zeros(len(schedule))
        return Schedules(zeros, zeros, np.ascontiguousarray(schedule), count, count + 1)
    if isinstance(schedule, LaneRows):
        ticks, offset = landing_times(schedule.times.ravel(), tick)
        first = np.arange(len(schedule.times)) * schedule.times.shape[1]
        return Schedules(ticks, offset, all_rows(schedule), first, first + schedule.times.shape[1])
    distinct, of_lane = _distinct(schedule)
    by_times = {each.times.tobytes(): each.times for each in distinct}
    landings = {key: landing_times(times, tick) for key, times in by_times.items()}
    rows = [landings[each.times.tobytes()] for each in distinct]
    starts = np.cumsum([0, *(len(ticks) for ticks, _ in rows)])
    ticks, offset = (np.concatenate([row[k] for row in rows]) for k in (0, 1))
    values = np.ascontiguousarray(all_rows(schedule))
    return Schedules(ticks, offset, values, starts[:-1][of_lane], starts[1:][of_lane])


def values_at_ticks(schedule: InputSchedule, ticks: np.ndarray, tick: float) -> np.ndarray:
    """Values in force just behind some ticks: (lanes or 1, ticks, entries), or (…, 1, entries) where they are constant.

    Args:
        schedule: for all lanes, or a lane each.   ticks: (k,) whole numbers.   tick: [s].
    """
    if isinstance(schedule, np.ndarray):
        return schedule[:, None, :]
    if isinstance(schedule, LaneRows):
        row = (_first_ticks(schedule.times, tick)[:, None, :] <= ticks[:, None]).sum(axis=2) - 1
        return np.take_along_axis(schedule.values, row[:, :, None], axis=1)
    if all(len(each.times) == 1 for each in schedule):
        return np.stack([each.commands for each in schedule])
    distinct, of_lane = _distinct(schedule)
    rows = [np.searchsorted(_first_ticks(each.times, tick), ticks, side="right") - 1 for each in distinct]
    return np.stack([each.commands[row] for each, row in zip(distinct, rows, strict=True)])[of_lane]


def _first_ticks(times: np.ndarray, tick: float) -> np.ndarray:
    """The first tick behind which each row holds; one that comes inside a tick does so from the next on."""
    ticks, offset = landing_times(times, tick)
    return np.where(offset > 0, ticks + 1, ticks)

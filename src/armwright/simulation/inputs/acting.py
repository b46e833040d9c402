"""What is done to an arm over time, held from row to row: commands, a wrench on its tip, its brakes.

Each is given in one of the same ways: a `Schedule`, or constant numbers; a `Batch` of either for lanes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.parameters import Batch, lane_values
from armwright.simulation.inputs.schedule import Schedule


@dataclass(frozen=True, eq=False)
class LaneRows:
    """As many rows for every lane, each from its time on; of rows that come together the last one holds.

    Attributes:
        times: (lanes or 1, rows) [s], from 0, none before the one before it.   values: (lanes or 1, rows, entries).
    """

    times: np.ndarray
    values: np.ndarray


Told = list[Schedule] | np.ndarray  # one for all lanes or one a lane; (lanes or 1, entries) of what never changes
Held = Told | LaneRows
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")  # [N] and [N m], in base axes


def numbers_of(name: str, value: Any, columns: Sequence[str]) -> np.ndarray:
    """(lanes or 1, k) finite numbers, one for each of k columns; a row a lane of a `Batch`.

    Raises:
        ScenarioError: names the field, and what its columns are.
    """
    n, told = len(columns), ", ".join(columns)
    try:
        rows = np.asarray(lane_values(value), dtype=float)
    except (TypeError, ValueError):
        raise ScenarioError(f"{name} = {value!r}: expected {n} numbers") from None
    if rows.shape[1:] != (n,):
        more = "; rows that differ by lane are a Batch" if rows.ndim == 3 and rows.shape[2] == n else ""
        lane = " in each lane" if isinstance(value, Batch) else ""
        raise ScenarioError(f"{name} has shape {rows.shape[1:]}{lane}, expected ({n},): {told}{more}")
    if not np.isfinite(rows).all():
        raise ScenarioError(f"{name} holds {rows[~np.isfinite(rows)][0]}, expected finite numbers")
    return rows


def is_scheduled(value: Any) -> bool:
    """Whether an input is given by a schedule or a batch of schedules, not by numbers."""
    return isinstance(value, Schedule) or (isinstance(value, Batch) and value.shape is None)


def held(name: str, value: Any, columns: Sequence[str]) -> Told:
    """What an input is over time: for all lanes, or a lane each.

    Args:
        name: of the field.   value: as told above.   columns: what its numbers are of; schedules may have them in any order.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    """
    if not is_scheduled(value):
        return numbers_of(name, value, columns)
    return schedules_of(name, value, columns)


def schedules_of(name: str, value: Any, columns: Sequence[str]) -> list[Schedule]:
    """One schedule for all lanes, or one a lane of a `Batch`, with their columns in this order.

    Raises:
        ScenarioError: anything else.
    """
    return [by_name(name, each, columns) for each in (value.values if isinstance(value, Batch) else [value])]


def rows_of(held: Held) -> np.ndarray:
    """(rows, entries) all that ever holds, of all lanes."""
    if isinstance(held, LaneRows):
        return held.values.reshape(-1, held.values.shape[2])
    return held if isinstance(held, np.ndarray) else np.concatenate([schedule.commands for schedule in held])


def by_name(name: str, schedule: Any, columns: Sequence[str]) -> Schedule:
    """The schedule with its columns in their order.

    Raises:
        ScenarioError: no schedule, or one of something else.
    """
    if not isinstance(schedule, Schedule):
        raise ScenarioError(
            f"{name} = {schedule!r}: expected a Schedule, as Schedule(...) or read_schedule(path, names) make, or a Batch of such"
        )
    if tuple(schedule.names) == tuple(columns):
        return schedule
    if sorted(schedule.names) != sorted(columns):
        raise ScenarioError(f"{name}: the schedule is for {', '.join(schedule.names)}; expected {', '.join(columns)}")
    order = [schedule.names.index(column) for column in columns]
    return Schedule(schedule.times, schedule.commands[:, order], tuple(columns))


def wrench_of(arm: Model, value: Any) -> Told:
    """The wrench on the tip, six columns in base axes.

    Raises:
        ScenarioError: as `held`.   ModelError: an arm without a tip, which has no place where it could act.
    """
    arm.frame()
    return held("wrench", value, WRENCH)


def brake_of(arm: Model, value: Any) -> Told:
    """Which brakes are applied: a column for every joint that has one; a single number is for all of them.

    Raises:
        ScenarioError: an arm without brakes, or numbers other than 1, applied, and 0, released.
    """
    braked = [body.joint for body in arm.coordinates if body.brake is not None]
    if not braked:
        raise ScenarioError(f"brake: no joint of {arm.name} has a brake in its record")
    if isinstance(value, Batch) and value.shape == ():
        value = Batch(np.repeat(value.values[:, None], len(braked), axis=1))
    elif not isinstance(value, (Batch, Schedule)) and np.ndim(value) == 0:
        value = [value] * len(braked)
    applied = held("brake", value, braked)
    rows = rows_of(applied)
    odd = (rows != 0.0) & (rows != 1.0)
    if odd.any():
        row, column = np.argwhere(odd)[0]
        raise ScenarioError(f"brake: {braked[column]} is {rows[row, column]:g}; expected 1, applied, or 0, released")
    return applied

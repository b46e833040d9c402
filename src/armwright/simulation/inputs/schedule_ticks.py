"""When the rows of schedules come, in ticks: a row next to a tick is put on it, others are landed on inside one."""

from __future__ import annotations

import numpy as np

from armwright.kernels.loop import Schedules
from armwright.simulation.inputs.acting import Held, LaneRows, rows_of
from armwright.simulation.inputs.schedule import Schedule

LANDING = 1e-9  # of a tick: a schedule row this near one is meant to be on it


def landing_times(times: np.ndarray, tick: float) -> tuple[np.ndarray, np.ndarray]:
    """Ticks, and offsets [s] behind them, at which a schedule's rows come.

    Args:
        times: (rows,) [s].   tick: [s].
    """
    ticks = np.rint(times / tick)
    on = np.abs(times - ticks * tick) <= LANDING * tick
    ticks = np.where(on, ticks, np.floor(times / tick))
    return ticks, np.where(on, 0.0, times - ticks * tick)


def landing_rows(schedules: Held, tick: float) -> Schedules:
    """Rows of all lanes' schedules; lanes of constant values, or of one clock, share their times."""
    if isinstance(schedules, np.ndarray):
        count, zeros = np.arange(len(schedules)), np.zeros(len(schedules))
        return Schedules(zeros, zeros, np.ascontiguousarray(schedules), count, count + 1)
    if isinstance(schedules, LaneRows):
        ticks, offset = landing_times(schedules.times.ravel(), tick)
        first = np.arange(len(schedules.times)) * schedules.times.shape[1]
        return Schedules(ticks, offset, rows_of(schedules), first, first + schedules.times.shape[1])
    seen: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    for schedule in schedules:
        if schedule.times.tobytes() not in seen:
            seen[schedule.times.tobytes()] = landing_times(schedule.times, tick)
    rows = [seen[schedule.times.tobytes()] for schedule in schedules]
    starts = np.cumsum([0, *(len(ticks) for ticks, _ in rows)])
    ticks, offset = (np.concatenate([row[k] for row in rows]) for k in (0, 1))
    values = np.ascontiguousarray(np.concatenate([schedule.commands for schedule in schedules]))
    return Schedules(ticks, offset, values, starts[:-1], starts[1:])


def held_values(schedules: Held, ticks: np.ndarray, tick: float) -> np.ndarray:
    """What holds just behind some ticks: (lanes or 1, ticks, entries), or (…, 1, entries) where it never changes.

    Args:
        schedules: for all lanes, or a lane each.   ticks: (k,) whole numbers.   tick: [s].
    """
    if isinstance(schedules, np.ndarray):
        return schedules[:, None, :]
    if isinstance(schedules, LaneRows):
        row = (_started(schedules.times, tick)[:, None, :] <= ticks[:, None]).sum(axis=2) - 1
        return np.take_along_axis(schedules.values, row[:, :, None], axis=1)
    if all(len(schedule.times) == 1 for schedule in schedules):
        return np.stack([schedule.commands for schedule in schedules])
    return np.stack([_held(schedule, ticks, tick) for schedule in schedules])


def _held(schedule: Schedule, ticks: np.ndarray, tick: float) -> np.ndarray:
    return schedule.commands[np.searchsorted(_started(schedule.times, tick), ticks, side="right") - 1]


def _started(times: np.ndarray, tick: float) -> np.ndarray:
    """The first tick behind which each row holds; one that comes inside a tick does so from the next on."""
    ticks, offset = landing_times(times, tick)
    return np.where(offset > 0, ticks + 1, ticks)

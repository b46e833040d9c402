"""When the rows of schedules come, in ticks: a row next to a tick is put on it, others are landed on inside one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armwright.kernels.loop import Schedules
from armwright.simulation.schedule import Schedule

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


def landing_rows(schedules: Sequence[Schedule], tick: float) -> Schedules:
    """Rows of all lanes' schedules; lanes of constant values, or of one clock, share their times."""
    seen: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    for schedule in schedules:
        if schedule.times.tobytes() not in seen:
            seen[schedule.times.tobytes()] = landing_times(schedule.times, tick)
    rows = [seen[schedule.times.tobytes()] for schedule in schedules]
    starts = np.cumsum([0, *(len(ticks) for ticks, _ in rows)])
    ticks, offset = (np.concatenate([row[k] for row in rows]) for k in (0, 1))
    values = np.ascontiguousarray(np.concatenate([schedule.commands for schedule in schedules]))
    return Schedules(ticks, offset, values, starts[:-1], starts[1:])

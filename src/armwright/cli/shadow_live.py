"""Residuals of a shadow shown as they came, at the pace of the log."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.cli.tables import console_for_tables, table
from armwright.identification.validation.prediction import units_of
from armwright.shadow.alarms import limits_at

if TYPE_CHECKING:
    from armwright.shadow.shadow import Shadow, ShadowRun

PERIOD = 0.1  # [s] from table to table
HEADS = ("joint", "unit", "residual", "limit", "", "position", "largest")
BAR = 20  # letters


def replay(shadow: Shadow, pace: float = 1.0) -> None:
    """Shows one table for each joint's residuals, renewed ten times a second, run by run.

    Args:
        shadow: what `shadow_log` returned.   pace: times faster than the log.
    """
    from rich.live import Live

    console = console_for_tables()
    for run in shadow.runs:
        t = run.residuals.t
        begin = time.monotonic()
        with Live(console=console, auto_refresh=False, transient=True) as live:
            for now in np.arange(t[0], t[-1], PERIOD):
                time.sleep(max(0.0, begin + (now - t[0]) / pace - time.monotonic()))
                live.update(frame(shadow, run, int(np.searchsorted(t, now))), refresh=True)


def frame(shadow: Shadow, run: ShadowRun, row: int) -> Any:
    """Table of the residuals of one row.

    Args:
        shadow: what `shadow_log` returned.   run: one of its runs.   row: number of the row.
    """
    rows, t = run.residuals, run.residuals.t[row]
    alarms = [each for each in run.alarms if each.t <= t and (each.end is None or t <= each.end)]
    limits, cells = limits_at(shadow.limits, rows)[row], []
    for k, (name, unit) in enumerate(zip(shadow.arm.names, units_of(shadow.arm, "torque"), strict=True)):
        residual, limit, position = rows.torque[row, k], limits[k], rows.position[row, k]
        share = abs(residual) / limit if np.isfinite(limit) and np.isfinite(residual) else 0.0
        bar = "█" * min(round(share * BAR), BAR) + (" !" if share > 1.0 else "")
        largest = np.nanmax(np.abs(rows.torque[: row + 1, k]), initial=0.0)
        numbers = ["-" if np.isnan(each) else f"{each:.3g}" for each in (residual, limit)]
        cells.append([name, unit, *numbers, bar, "-" if np.isnan(position) else f"{position:.3g}", f"{largest:.3g}"])
    state = str(alarms[-1]) if alarms else "no alarm"
    return table(f"{run.run}, {t:.1f} s: {state}", HEADS, cells, (HEADS[0], HEADS[1], HEADS[4]))

"""Residuals of a shadow shown live in the terminal, at the pace of a log or of a bus."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.cli.tables import console_for_tables, table
from armwright.identification.validation.prediction import units_of
from armwright.shadow.alarms import ShadowAlarm, limits_at
from armwright.terminal import say

if TYPE_CHECKING:
    from armwright.model import Model
    from armwright.shadow.shadow import Shadow, ShadowRun

PERIOD = 0.1  # [s] from table to table
HEADS = ("joint", "unit", "residual", "limit", "", "position", "largest")
BAR = 20  # letters


def replay(shadow: Shadow) -> None:
    """Shows a table of every joint's residuals, run by run, renewed ten times a second.

    Args:
        shadow: what `shadow_log` returned.
    """
    from rich.live import Live

    console = console_for_tables()
    for run in shadow.runs:
        t = np.cumsum(np.diff(run.residuals.t, prepend=run.residuals.t[:1]).clip(0.0))  # a clock may have been set back
        begin = time.monotonic()
        with Live(console=console, auto_refresh=False, transient=True) as live:
            for now in np.arange(0.0, t[-1], PERIOD):
                time.sleep(max(0.0, begin + now - time.monotonic()))
                live.update(_of_run(shadow, run, int(np.searchsorted(t, now))), refresh=True)


def _of_run(shadow: Shadow, run: ShadowRun, row: int) -> Any:
    """Table of one row of a run."""
    rows, t = run.residuals, float(run.residuals.t[row])
    alarms = [each for each in run.alarms if each.t <= t and (each.end is None or t <= each.end)]
    largest = np.nanmax(np.abs(rows.torque[: row + 1]), axis=0, initial=0.0)
    limits = limits_at(shadow.limits, rows)[row]
    return frame(shadow.arm, run.run, t, rows.torque[row], limits, rows.position[row], largest, alarms)


def frame(
    arm: Model,
    run: str,
    t: float,
    torque: np.ndarray,
    limits: np.ndarray,
    position: np.ndarray,
    largest: np.ndarray,
    alarms: list[ShadowAlarm],
) -> Any:
    """Table of the residuals at one row.

    Args:
        arm: the model.   run: its name.   t: [s].   torque: (n,) [N m | N] residuals.   limits: (n,) [N m | N].
        position: (n,) [rad | m] residuals.   largest: (n,) [N m | N] residuals until now.   alarms: that last.
    """
    cells = []
    for k, (name, unit) in enumerate(zip(arm.names, units_of(arm, "torque"), strict=True)):
        share = abs(torque[k]) / limits[k] if np.isfinite(limits[k]) and np.isfinite(torque[k]) else 0.0
        bar = "█" * min(round(share * BAR), BAR) + (" !" if share > 1.0 else "")
        first, last = ([_number(each[k]) for each in both] for both in ((torque, limits), (position, largest)))
        cells.append([name, unit, *first, bar, *last])
    judged = np.isfinite(torque) & np.isfinite(limits)
    state = str(alarms[-1]) if alarms else "no alarm" if judged.all() else "not judged"
    return table(f"{run}, {t:.1f} s: {state}", HEADS, cells, (HEADS[0], HEADS[1], HEADS[4]))


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.3g}"


def listen(
    robot: str,
    bus: str,
    deviation: Any,
    factor: float,
    duration: float | None,
    nodes: list[int] | None,
    counts: float | None,
    period: float | None,
    output: Path | None,
) -> bool:
    """Shows a table of the last residuals on a bus, and each alarm that they raise; True if the verdict is "no alarm".

    Args:
        robot: path or name.   bus: its name.   deviation, factor: as of `ArmShadow`.   duration, nodes, counts, period: as of
            `BusListener`.   output: where rows and residuals are saved.
    """
    from rich.live import Live

    from armwright.results.recording import check_recording, save
    from armwright.shadow.rows import event_lines
    from armwright.shadow.shadow import ArmShadow
    from armwright.twin.listen import BusListener, bus_recording, shadow_bus

    if output is not None:
        check_recording(output)

    shadow = ArmShadow(robot, deviation=deviation, factor=factor)
    listener = BusListener(shadow.arm, bus, nodes=nodes, counts=counts, period=period)
    console, shown, largest = console_for_tables(), -np.inf, np.zeros(shadow.arm.n)
    rows, residuals, count = [], [], 0
    last: Any = None
    with listener, Live(console=console, auto_refresh=False, transient=True) as live:
        for heard, raised in shadow_bus(shadow, listener, duration):
            row, count = shadow.last, count + 1
            assert row is not None
            if output is not None:
                rows.append(heard)
                residuals.append(row)
            largest = np.fmax(largest, np.abs(row.torque[0]))
            limits = limits_at(shadow.limits, row)[0]
            lasting = [each for each in shadow.alarms if each.end is None]
            last = (shadow.arm, bus, float(row.t[0]), row.torque[0], limits, row.position[0], largest, lasting)
            for alarm in raised:
                live.console.print(str(alarm), soft_wrap=True, markup=False, highlight=False)
            if row.t[0] - shown >= PERIOD:
                shown = row.t[0]
                live.update(frame(*last), refresh=True)
    if last is not None:
        console.print(frame(*last))
    say("")
    for alarm in shadow.alarms:
        say(str(alarm))
    found = shadow.verdict
    for line in (*event_lines([(bus, each) for each in shadow.events]), *found.lines):
        say(line)
    say(f"standard deviations of the residuals: {shadow.deviations.source}")
    say(f"{count} rows, {listener.incomplete} cycles without all answers")
    if output is not None and rows:
        save(bus_recording(shadow.arm, rows, residuals), output)
        say(f"wrote {output}")
    return found.clean

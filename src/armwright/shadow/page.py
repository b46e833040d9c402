"""Page of a shadow: residuals and limits of every joint over time, alarms, and the sources of the limits."""

from __future__ import annotations

import os
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armwright.identification.validation.prediction import units_of
from armwright.results.page_parts import bullets, plotted, said, section, sentence, shown_table, write_page
from armwright.results.svg import INK, PREDICTED, QUIET, RESIDUAL, SIZE, curve, page_svg, words
from armwright.results.table import Table, number
from armwright.shadow.alarms import limits_at
from armwright.shadow.rows import event_lines

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from armwright.shadow.shadow import Shadow, ShadowRun

DRAWN = 6  # runs of each page that are drawn; those with alarms first
SIZE_OF_PICTURE = (9.2, 3.6)  # [inch]
ALARM = ("run", "time [s]", "until [s]", "joint", "residual", "limit", "cause")


def write_shadow(path: str | os.PathLike[str], shadow: Shadow) -> Path:
    """The page; see `Shadow.report`."""
    body = [section("Alarms", _alarms(shadow)), section("Every joint", shown_table(shadow.tables()[0]))]
    body.append(section("Where limits come from", bullets(map(sentence, shadow.notes))))
    runs = sorted(shadow.runs, key=lambda each: not each.alarms)[:DRAWN]
    for k, joint in enumerate(shadow.arm.names):
        body.append(
            section(
                joint, "".join(f"<h3>Run {escape(run.run)}</h3>{plotted(_picture(shadow, run, k))}" for run in runs)
            )
        )
    return write_page(path, shadow.heading, body)


def _alarms(shadow: Shadow) -> str:
    words = said(shadow.verdict.lines, shadow.verdict.clean) + bullets(event_lines(shadow.events))
    rows = [
        [
            run,
            number(alarm.t, ".3f"),
            number(alarm.end, ".3f"),
            alarm.joint,
            number(alarm.residual, "+.3g"),
            number(alarm.limit, ".3g"),
            alarm.cause,
        ]
        for run, alarm in shadow.alarms
    ]
    return words + (shown_table(Table(None, ALARM, rows, ("joint", "cause"))) if rows else "")


def _picture(shadow: Shadow, run: ShadowRun, k: int) -> str:
    """SVG of one joint's residuals of torque, with its limits, and of position."""
    rows, limits = run.residuals, limits_at(shadow.limits, run.residuals)
    torque, position = units_of(shadow.arm, "torque")[k], units_of(shadow.arm, "position")[k]

    def draw(figure: Figure) -> None:
        above, below = figure.subplots(2, 1, sharex=True)
        curve(above, rows.t, rows.torque[:, k], RESIDUAL, "residual torque")
        if np.isfinite(shadow.limits[k]):
            for side in (1.0, -1.0):
                curve(above, rows.t, side * limits[:, k], QUIET, "limits" if side > 0.0 else None)
        for count, alarm in enumerate(run.alarms):
            end = rows.t[-1] if alarm.end is None else alarm.end
            label = "alarm" if count == 0 else None
            above.axvspan(alarm.t, end, color=RESIDUAL, alpha=0.15, linewidth=0, label=label)
        above.axhline(0.0, color=INK, linewidth=0.5)
        curve(below, rows.t, 1e3 * rows.position[:, k], PREDICTED, "residual position")
        below.axhline(0.0, color=INK, linewidth=0.5)
        words(above, "", f"torque [{torque}]")
        words(below, "time [s]", f"position [m{position}]")
        figure.align_ylabels()
        figure.legend(loc="upper left", ncols=4, borderaxespad=0.1, frameon=False, labelcolor=INK, fontsize=SIZE)

    return page_svg(draw, SIZE_OF_PICTURE)

"""Page of a shadow: residuals and limits of every joint over time, alarms, and the sources of the limits."""

from __future__ import annotations

import os
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armwright.entry import expect
from armwright.errors import LogError
from armwright.identification.validation.pictures import INK, PREDICTED, QUIET, RESIDUAL, SIZE, curve, page_svg, words
from armwright.identification.validation.prediction import units_of
from armwright.identification.validation.report import html_table, write_report
from armwright.shadow.alarms import limits_at
from armwright.shadow.shadow import HEADS, Shadow, ShadowRun, event_lines

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWN = 6  # runs of each page that are drawn; those with alarms first
SIZE_OF_PICTURE = (9.2, 3.6)  # [inch]


def write_shadow(path: str | os.PathLike[str], shadow: Shadow) -> Path:
    """Writes the page of a shadow as one offline file.

    Args:
        path: ending in .html.   shadow: what `shadow_log` returned.
    Returns:
        path: of the page.
    Raises:
        OutputError: the file cannot be written.
    """
    expect(shadow, Shadow, "shadow", "what aw.shadow.shadow_log returns", LogError)
    sections = [("Alarms", _alarms(shadow)), ("Every joint", html_table(HEADS, _escaped(shadow.rows()), (0, 1)))]
    sections.append(("Where limits come from", _list(shadow.notes)))
    runs = sorted(shadow.runs, key=lambda each: not each.alarms)[:DRAWN]
    for k, joint in enumerate(shadow.arm.names):
        pictures = [f'<h3>Run {escape(run.run)}</h3><div class="plot">{_picture(shadow, run, k)}</div>' for run in runs]
        sections.append((joint, "".join(pictures)))
    return write_report(path, f"{shadow.arm.name}: shadow of {shadow.log.title}", sections=sections)


def _list(notes: Sequence[str]) -> str:
    items = (f"<li>{escape(note[:1].upper() + note[1:])}.</li>" for note in notes)
    return f"<ul>{''.join(items)}</ul>"


def _escaped(rows: list[list[str]]) -> list[list[str]]:
    return [[escape(cell) for cell in row] for row in rows]


def _alarms(shadow: Shadow) -> str:
    found = shadow.verdict
    first, *others = (escape(line) for line in found.lines)
    said = f'<p class="verdict{" good" * found.clean}">{first[:1].upper()}{first[1:]}</p>' + "".join(
        f"<p>{line}</p>" for line in others
    )
    if shadow.events:
        said += f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in event_lines(shadow.events))}</ul>"
    if not shadow.alarms:
        return said
    table = html_table(
        ("run", "time [s]", "until [s]", "joint", "residual", "limit", "cause"),
        [
            [
                escape(run),
                f"{alarm.t:.3f}",
                "" if alarm.end is None else f"{alarm.end:.3f}",
                escape(alarm.joint),
                f"{alarm.residual:+.3g}",
                f"{alarm.limit:.3g}",
                escape(alarm.cause),
            ]
            for run, alarm in shadow.alarms
        ],
        (0, 3, 6),
    )
    return said + table


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
        for number, alarm in enumerate(run.alarms):
            end = rows.t[-1] if alarm.end is None else alarm.end
            label = "alarm" if number == 0 else None
            above.axvspan(alarm.t, end, color=RESIDUAL, alpha=0.15, linewidth=0, label=label)
        above.axhline(0.0, color=INK, linewidth=0.5)
        curve(below, rows.t, 1e3 * rows.position[:, k], PREDICTED, "residual position")
        below.axhline(0.0, color=INK, linewidth=0.5)
        words(above, "", f"torque [{torque}]")
        words(below, "time [s]", f"position [m{position}]")
        figure.align_ylabels()
        figure.legend(loc="upper left", ncols=4, borderaxespad=0.1, frameon=False, labelcolor=INK, fontsize=SIZE)

    return page_svg(draw, SIZE_OF_PICTURE)

"""Runs in the terminal: a strip of braille dots for each joint, with its first, least, greatest and last value."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from armwright.results.plot_curves import HUGE, INK, Curve, describe

if TYPE_CHECKING:
    import xarray as xr
    from rich.console import Console

EMPTY = 0x2800  # the braille character without dots
DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])  # of a character, from the top
ROWS = 2  # characters that a strip is high
WIDEST, NARROWEST = 100, 16  # characters that a strip may be wide
NUMBERS = 46  # characters that four numbers need


def show_runs(
    runs: xr.Dataset | Mapping[str, xr.Dataset],
    console: Console,
    *,
    joints: Sequence[str] | None = None,
    quantities: Sequence[str] | None = None,
) -> None:
    """Prints a table for each panel of the plot, with a row for each joint and run.

    A strip of a few lanes covers all of them, a strip of many the band with nine out of ten.

    Args:
        runs, joints, quantities: as `plot` takes them.   console: where to.
    Raises:
        RunError: as `plot`.
    """
    from rich.table import Table
    from rich.text import Text

    plot = describe(runs, joints, quantities)
    whole = (min(t[0] for t in plot.times), max(t[-1] for t in plot.times))
    if plot.note:
        console.print(Text(f"{plot.note}\n"))
    for k, panel in enumerate(plot.panels):
        rows = _rows(panel.curves)
        scales = _scales(rows)
        several_runs = len({curve.series for curve in rows}) > 1
        wide = max(len(curve.joint) for curve in rows) + several_runs * (2 + max(len(curve.series) for curve in rows))
        width = int(np.clip(console.width - NUMBERS - 2 - wide, NARROWEST, WIDEST))
        table = Table(box=None, header_style="dim", pad_edge=False, padding=(0, 2, 0, 0))
        for head in ("joint", *(["run"] if several_runs else []), f"{whole[0]:g} … {whole[1]:g} s"):
            table.add_column(head, no_wrap=True)
        for head in ("first", "least", "greatest", "last"):
            table.add_column(head, justify="right", vertical="middle", no_wrap=True)
        for curve in rows:
            colour = "" if curve.style.colour == INK else curve.style.colour
            lines = strip(plot.times[curve.run], *_extent(curve), whole, width, scales[curve.joint])
            known = curve.values[np.isfinite(curve.values)]
            low, high = _extent(curve)
            ends = (known[0], np.nanmin(low), np.nanmax(high), known[-1])
            names = [Text(curve.joint), *([Text(curve.series)] if several_runs else [])]
            table.add_row(*names, Text("\n".join(lines), style=colour), *map(_number, ends))
        if k:
            console.print()
        console.print(Text(f"{panel.title} [{panel.unit}]", style="bold"))
        console.print(table)


def _number(value: float) -> str:
    return f"{value + 0.0:.4g}".replace("-", "−")


def _rows(curves: Sequence[Curve]) -> list[Curve]:
    """Curves, with the few lanes of a joint and run joined to one: their median, and a band from the least to the greatest."""
    rows: dict[tuple[str, str], list[Curve]] = {}
    for curve in curves:
        rows.setdefault((curve.joint, curve.series), []).append(curve)
    joined = []
    for lanes in rows.values():
        if len(lanes) == 1:
            joined.append(lanes[0])
            continue
        values = np.array([curve.values for curve in lanes])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # a time at which no lane is finite stays NaN
            low, middle, high = np.nanmin(values, axis=0), np.nanmedian(values, axis=0), np.nanmax(values, axis=0)
        joined.append(replace(lanes[0], values=middle, bands=((low, high),)))
    return joined


def _extent(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper edge of the drawn curve or band, (k,) each."""
    return curve.bands[0] if curve.bands else (curve.values, curve.values)


def _scales(rows: list[Curve]) -> dict[str, tuple[float, float]]:
    """Joint → the least and the greatest value of all its rows, so that these can be compared by eye."""
    scales: dict[str, tuple[float, float]] = {}
    for curve in rows:
        known = [edge[np.abs(edge) < HUGE] for edge in _extent(curve)]
        least, most = scales.get(curve.joint, (np.inf, -np.inf))
        if len(known[0]) and len(known[1]):
            least, most = min(least, float(known[0].min())), max(most, float(known[1].max()))
        scales[curve.joint] = (least, most)
    return scales


def strip(
    t: np.ndarray, low: np.ndarray, high: np.ndarray, span: tuple[float, float], width: int,
    scale: tuple[float, float] | None = None,
) -> list[str]:  # fmt: skip
    """A curve, or the band between two, as lines of braille characters, each two dots wide and four high.

    Args:
        t: (k,) [s].   low, high: (k,); the same for a curve.   span: times [s] at the strip's ends.   width: [characters].
        scale: values at the bottom and at the top; None: the least and the greatest there are.
    Returns:
        lines: `ROWS` of them, from the top.
    """
    columns, height = 2 * width, 4 * ROWS
    known = (np.abs(low) < HUGE) & (np.abs(high) < HUGE)  # false for what is not known, too
    t, low, high = t[known], low[known], high[known]
    if not len(t):
        return ROWS * [" " * width]
    least, most = scale or (float(low.min()), float(high.max()))
    level = most - least < 1e-9 * max(abs(least), abs(most), 1e-300)
    dots = np.zeros((height, columns), dtype=bool)
    at = np.clip((t - span[0]) / ((span[1] - span[0]) or 1.0) * columns, 0, columns - 1).astype(int)
    shares = (np.full(len(edge), 0.5) if level else (edge - least) / (most - least) for edge in (low, high))
    up = [np.rint(share * (height - 1)).astype(int) for share in shares]
    before: tuple[int, int, int] | None = None
    for column in np.unique(at):
        here = at == column
        bottom, top = int(up[0][here].min()), int(up[1][here].max())
        if before is not None and column - before[0] > 1:  # few rows: straight from one to the next
            between = np.arange(before[0] + 1, column)
            share = (between - before[0]) / (column - before[0])
            for k, s in zip(between, share, strict=True):
                ends = [round(a + (b - a) * s) for a, b in ((before[1], bottom), (before[2], top))]
                dots[ends[0] : ends[1] + 1, k] = True
        joined_low = min(bottom, before[2] + 1) if before is not None and column - before[0] == 1 else bottom
        joined_high = max(top, before[1] - 1) if before is not None and column - before[0] == 1 else top
        dots[joined_low : joined_high + 1, column] = True
        before = (int(column), bottom, top)
    cells = dots[::-1].reshape(ROWS, 4, width, 2)
    codes = EMPTY + np.einsum("rdwc,dc->rw", cells.astype(int), DOTS)
    return ["".join(map(chr, row)) for row in codes]

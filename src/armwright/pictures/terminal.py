"""Runs in the terminal: a strip of braille dots for each joint, with where it begins, how far it goes and where it ends."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from armwright.pictures.curves import Curve, curve_panels, places, selected
from armwright.simulation.results.plot import COLOURS
from armwright.simulation.results.spoken import variables

if TYPE_CHECKING:
    import xarray as xr
    from rich.console import Console

EMPTY = 0x2800  # the braille character without dots
DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])  # of a character, from the top
ROWS = 2  # characters that a strip is high
WIDEST, NARROWEST = 100, 16  # characters that a strip may be wide
HUGE = 1e300  # a diverging run's values beyond it have no place in a picture
NUMBERS = 46  # characters that four numbers need


def show_runs(
    runs: Mapping[str, xr.Dataset],
    console: Console,
    *,
    joints: Sequence[str] | None = None,
    quantities: Sequence[str] | None = None,
) -> None:
    """Prints a table a quantity, a row a joint and run. Of lanes the whole breadth is filled.

    Args:
        runs: what each is called → the run.   console: where to.
        joints: names; None: all.   quantities: such as ("q", "tau"); None: what `plot` draws.
    Raises:
        RunError: no run, a joint or a quantity that it has not, runs of arms with different joints.
    """
    from rich.table import Table
    from rich.text import Text

    chosen, quantities = selected(runs, joints, quantities), variables(quantities)
    times = [run["time"].values for run in chosen.values()]
    first = next(iter(chosen.values()))
    names, spans = [str(joint) for joint in first["joint"].values], [(t[0], t[-1]) for t in times]
    whole = (min(t for t, _ in spans), max(t for _, t in spans))
    for k, panel in enumerate(curve_panels(chosen, quantities)):
        rows = _rows(panel.curves)
        scales = _scales(rows)
        who = [_who(curve, list(chosen)) for curve in rows]
        room = console.width - NUMBERS - max(map(len, names)) - 2 - (max(map(len, who)) + 2 if any(who) else 0)
        width = int(np.clip(room, NARROWEST, WIDEST))
        table = Table(box=None, header_style="dim", pad_edge=False, padding=(0, 2, 0, 0))
        for head in ("joint", *(["run"] if any(who) else []), f"{whole[0]:g} … {whole[1]:g} s"):
            table.add_column(head, no_wrap=True)
        for head in ("first", "least", "greatest", "last"):
            table.add_column(head, justify="right", vertical="middle", no_wrap=True)
        for curve, called in zip(rows, who, strict=True):
            colour = COLOURS[places(first)[curve.joint] % len(COLOURS)]
            lines = strip(times[curve.run], _low(curve), _high(curve), whole, width, scales[curve.joint])
            known = curve.values[np.isfinite(curve.values)]
            ends = (known[0], np.nanmin(_low(curve)), np.nanmax(_high(curve)), known[-1])
            picture = Text("\n".join(lines), style="" if colour == "#000000" else colour)
            table.add_row(Text(names[curve.joint]), *([Text(called)] if any(who) else []), picture, *map(_number, ends))
        if k:
            console.print()
        console.print(Text(f"{panel.title} [{panel.unit}]", style="bold"))
        console.print(table)


def _number(value: float) -> str:
    return f"{value + 0.0:.4g}".replace("-", "−")


def _who(curve: Curve, runs: list[str]) -> str:
    """What tells this row from the others of its joint."""
    named = runs[curve.run] if len(runs) > 1 else ""
    return " ".join(filter(None, (named, "reference" if curve.kind == "reference" else "")))


def _rows(curves: list[Curve]) -> list[Curve]:
    """A curve a joint and run, lanes joined to a band; joints stay together."""
    rows: dict[tuple[int, int, str], list[Curve]] = {}
    for curve in curves:
        rows.setdefault((curve.joint, curve.run, curve.kind), []).append(curve)
    found = []
    for own in rows.values():
        lanes = np.array([curve.values for curve in own])
        if len(own) > 1:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # a row that no lane knows stays unknown
                low, middle, high = np.nanmin(lanes, axis=0), np.nanmedian(lanes, axis=0), np.nanmax(lanes, axis=0)
            found.append(replace(own[0], values=middle, low=low, high=high))
        else:
            found.append(own[0])
    return sorted(found, key=lambda curve: (curve.joint, curve.run, curve.kind == "reference"))


def _low(curve: Curve) -> np.ndarray:
    return curve.values if curve.low is None else curve.low


def _high(curve: Curve) -> np.ndarray:
    return curve.values if curve.high is None else curve.high


def _scales(rows: list[Curve]) -> dict[int, tuple[float, float]]:
    """Joint → the least and the greatest value of all its rows, so that these can be compared by eye."""
    scales: dict[int, tuple[float, float]] = {}
    for curve in rows:
        known = [own[np.abs(own) < HUGE] for own in (_low(curve), _high(curve))]
        if len(known[0]) and len(known[1]):
            least, most = scales.get(curve.joint, (np.inf, -np.inf))
            scales[curve.joint] = (min(least, float(known[0].min())), max(most, float(known[1].max())))
        else:
            scales.setdefault(curve.joint, (np.inf, -np.inf))
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
    up = [(np.full(len(own), 0.5) if level else (own - least) / (most - least)) * (height - 1) for own in (low, high)]
    up = [np.rint(own).astype(int) for own in up]
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

"""Choice of the low-pass's cut-off by what it is for: the error of the torques as they were measured, on parts held out.

A lower cut-off loses motion, a higher one lets noise of accelerations in. Of a grid of cut-offs, each fit to all parts of the log
but one predicts the unfiltered torques of that part. As good as the best one are those around it whose unexplained share of the
variance, summed over the joints, is larger by no more than 1 %, or by no more than one standard error of the difference, as the
parts tell it; chosen is one third of the way from the highest of them to the lowest, as a low one leaves few rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from armwright.errors import ArmwrightError
from armwright.identification.arm.base import base_parameters, regrouped_further
from armwright.identification.arm.equations import equations_of, part_seconds
from armwright.identification.arm.fit import cross_validated, fit_arm
from armwright.identification.arm.samples import Stream
from armwright.identification.arm.torque_model import TorqueModel
from armwright.identification.logs.preparation import ROOM
from armwright.identification.logs.spectrum import HIGHEST, LOWEST
from armwright.progress import Progress
from armwright.results.table import Table, number as as_text

STEP, WIDEST = 1.6, 2.0  # from one cut-off of the grid to the next; the highest by that of the motion's band
MOST_CUTOFFS = 12
ROWS = 5_000  # that the errors are taken from, nearly
LEFT = 0.5  # of the rows that the highest cut-off leaves, at least
FEWEST, MANY = 100, 400  # rows that the lowest cut-off leaves, for intervals that hold, and that the highest one leaves
NEAR = 1.01  # times the least error is as good


@dataclass(frozen=True, eq=False)
class CutoffCurve:
    """Held-out errors of the unfiltered torques by the cut-off.

    Attributes:
        hz: (k,) cut-offs, falling.   unexplained: (k, n) 1 − R² of the joints; NaN of those without torques.   chosen: in Hz.
    """

    hz: np.ndarray
    unexplained: np.ndarray
    chosen: float

    @property
    def total(self) -> np.ndarray:
        """(k,) sums over the joints."""
        return np.nansum(self.unexplained, axis=1)

    def table(self, joints: Sequence[str]) -> Table:
        """A row for each cut-off, for a page."""
        rows = [
            [f"{hz:.3g}", *map(as_text, row), "chosen" if hz == self.chosen else ""]
            for hz, row in zip(self.hz, self.unexplained, strict=True)
        ]
        title = "1 - R² of the unfiltered torques on parts held out, by the cut-off"
        return Table(title, ("cut-off [Hz]", *(f"held-out 1 - R² of {each}" for each in joints), ""), rows, ("",))

    @property
    def reason(self) -> str:
        """The choice in words."""
        low, high = self.hz.min(), self.hz.max()
        least = self.total[self.hz == self.chosen][0]
        return (
            f"of {len(self.hz)} from {low:.3g} to {high:.3g} Hz one of those that predict the unfiltered torques of held-out "
            f"parts best, 1 - R² {least:.3g} over all joints"
        )


def cutoff_curve(stream: Stream, model: TorqueModel, progress: Progress, after: int) -> CutoffCurve | None:
    """The curve of a stream's excerpts; None where the log is too short to hold parts out.

    Args:
        stream: with the cut-off of the motion's band.   model: the columns.
        progress: called with cut-offs done, and all and what follows.   after: steps that follow.
    """
    grid = _grid(stream)
    if len(grid) < 2:
        return None
    rows = sum(len(each.t) for run in stream.filters for each in stream.log.run(run).census.even)
    decimate = max(next(iter(stream.at(grid[0]).filters.values())).narrow.decimate, ceil(rows / ROWS))
    lowest = stream.at(grid[-1]).filters
    structural, found = base_parameters(model), []
    excerpts = sum(stream.log.run(run).census.excerpt_seconds for run in stream.filters)
    seconds = part_seconds(list(stream.filters), excerpts)
    for number, cutoff in enumerate(grid):
        progress(number, len(grid) + after)
        filters = {}
        for run, each in stream.at(cutoff).filters.items():
            narrow = replace(each.narrow, decimate=decimate, edge=lowest[run].narrow.edge)
            filters[run] = replace(each, narrow=narrow)
        try:
            equations = equations_of(replace(stream, filters=filters).as_measured(model), model, part_seconds=seconds)
            fit = fit_arm(equations, regrouped_further(structural, equations.factor))
            squares = np.array([each.squares for each in cross_validated(fit)])
        except ArmwrightError:
            return None
        spread = np.array([each.sum_of_squares - each.total**2 / max(each.rows, 1) for each in equations.factors])
        found.append(squares / np.where(spread > 0.0, spread, np.nan))
    shares = np.array(found)  # (cut-offs, parts, joints)
    if not np.isfinite(shares).any(axis=2).all():
        return None
    return CutoffCurve(np.array(grid), shares.sum(axis=1), float(grid[_chosen(np.nansum(shares, axis=2))]))


def _chosen(errors: np.ndarray) -> int:
    """Number of the cut-off to take, by the errors (cut-offs, parts)."""
    total = errors.sum(axis=1)
    best = int(np.argmin(total))
    spread = np.sqrt(errors.shape[1]) * (errors - errors[best]).std(axis=1, ddof=1)
    poor = np.flatnonzero(total - total[best] > np.maximum((NEAR - 1.0) * total[best], spread))
    first, last = poor[poor < best].max(initial=-1) + 1, poor[poor > best].min(initial=len(total)) - 1
    return int(2 * first + last) // 3


def _grid(stream: Stream) -> list[float]:
    """Falling cut-offs in Hz that leave at least half of the rows that the highest one leaves."""
    highest = max(each.narrow.cutoff for each in stream.filters.values())
    slowest = min(each.narrow.rate for each in stream.filters.values())
    rows = sum(len(each.t) for run in stream.filters for each in stream.log.run(run).census.even)
    highest = max(WIDEST * highest, MANY * slowest / (ROOM * max(rows, 1)))
    cutoff, found, most = _three_digits(min(highest, HIGHEST * slowest)), [], 0
    while len(found) < MOST_CUTOFFS and cutoff > LOWEST * slowest:
        left = 0
        for run, each in stream.at(cutoff).filters.items():
            lengths = [len(rows.t) for rows in stream.log.run(run).census.even]
            left += sum(max(length - 2 * each.narrow.edge, 0) for length in lengths)
        most = most or left
        if left < LEFT * most or left * ROOM * cutoff < FEWEST * slowest:
            break
        found.append(cutoff)
        cutoff = _three_digits(cutoff / STEP)
    return found


def _three_digits(value: float) -> float:
    return float(f"{value:.3g}")

"""A fit of a servo as a result: its numbers, the friction models that were compared, and every log as measured and simulated."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armwright.description.robot import RobotDescription
from armwright.identification.estimate import Estimate, EstimateResult, write_into
from armwright.identification.servo.bench_log import BenchLog
from armwright.results.table import Table, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class OrderErrors:
    """Errors of a friction model.

    Attributes:
        order: "M1" … "M6".   unknowns: how many numbers it has.   fitted: mean error on the logs that it was fitted to [rad].
        held_out: mean error of all logs, each by a fit without it [rad]; NaN of a single log.   chosen: True of the result's.
    """

    order: str
    unknowns: int
    fitted: float
    held_out: float
    chosen: bool


@dataclass(frozen=True, eq=False)
class ServoFit(EstimateResult):
    """Numbers of a servo from logs of its bench.

    Attributes:
        order: friction model, "M1" … "M6".   estimate: its numbers with their uncertainty, by paths of `robot`.
        robot: the bench of the first log as a record with these numbers.   orders: the models that were compared.
        logs: what was fitted.   simulated: positions at the rows of each log [rad].
    """

    order: str
    estimate: Estimate
    robot: RobotDescription
    orders: tuple[OrderErrors, ...]
    logs: tuple[BenchLog, ...]
    simulated: tuple[np.ndarray, ...]

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return (
            f"{self.logs[0].servo or 'servo'}: {len(self.logs)} log{'s' * (len(self.logs) > 1)}, friction {self.order}"
        )

    @property
    def error(self) -> float:
        """Mean over the logs of the mean absolute error of the position [rad]."""
        return float(np.mean(self._errors))

    @property
    def _errors(self) -> list[float]:
        return [mean_error(log, own) for log, own in zip(self.logs, self.simulated, strict=True)]

    def tables(self) -> list[Table]:
        """Numbers with standard deviations; friction models; logs."""
        numbers = self.estimate.tables()[0]
        orders = [
            [x.order, x.unknowns, number(x.fitted, ".4f"), number(x.held_out, ".4f"), "chosen" * x.chosen]
            for x in self.orders
        ]
        heads = ("model", "numbers", "fitted logs [rad]", "logs held out [rad]", "")
        logs = [
            [log.name, number(log.p, "g"), number(log.mass, "g"), number(log.length, "g"), number(error, ".4f")]
            for log, error in zip(self.logs, self._errors, strict=True)
        ]
        return [
            replace(numbers, title=self.heading),
            Table("Mean errors of friction models", heads, orders, ("model", "")),
            Table("Logs", ("log", "P", "mass [kg]", "length [m]", "mean error [rad]"), logs, ("log",)),
        ]

    def draw(self, figure: Figure, ink: str, quiet: str) -> None:
        """Draws every log's position as measured and as simulated over time."""
        draw_logs(figure, self.logs, self.simulated, ink, quiet)

    @property
    def height(self) -> float:
        """Of its picture [inch]."""
        return 1.9 * max(1, -(-len(self.logs) // ACROSS))

    def write(self, output: str | os.PathLike[str], key: str = "fit") -> Path:
        """Writes the bench as a robot's file, its numbers with source `fit` and deviations, as `write_into`.

        Args:
            output: path of the file.   key: of source and fit in it.
        Returns:
            path: of the file.
        Raises:
            OutputError, DescriptionError: as `write_into`.
        """
        return write_into(self.robot, self.estimate, output, key)


ACROSS = 4  # pictures in a row


def mean_error(log: BenchLog, simulated: np.ndarray) -> float:
    """Mean absolute error of a log's position [rad]."""
    return float(np.abs(log.position - simulated).mean())


def draw_logs(figure: Figure, logs: Sequence[BenchLog], simulated: Sequence[np.ndarray], ink: str, quiet: str) -> None:
    """Positions over time, measured in `quiet`, broad, and simulated in blue, one picture a log."""
    from armwright.results.result import BLUE
    from armwright.results.svg import ink_axes

    across = min(ACROSS, len(logs))
    axes = np.atleast_1d(figure.subplots(-(-len(logs) // across), across, squeeze=False)).ravel()
    for axis in axes[len(logs) :]:
        axis.remove()
    for axis, log, own in zip(axes, logs, simulated, strict=False):
        ink_axes(axis, ink)
        axis.plot(log.t, log.position, color=quiet, linewidth=2.4, alpha=0.6)
        axis.plot(log.t, own, color=BLUE, linewidth=0.9)
        axis.set_title(escape(log.name.removesuffix(".json")), fontsize=6, color=ink)
        axis.tick_params(labelsize=6)
    figure.supxlabel("time [s]", fontsize=7, color=ink)
    figure.supylabel("position [rad]", fontsize=7, color=ink)
    places = {"loc": "outside upper right", "ncols": 2, "frameon": False, "fontsize": 7, "labelcolor": ink}
    figure.legend(axes[0].get_lines(), ["measured", "simulated"], **places)

"""A fit of drives as a result: tables, a page with every signal of every run as measured and as predicted, and the record."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.description.robot import RobotDescription
from armwright.identification.estimate import Estimate, EstimateResult, write_into
from armwright.identification.motor.predictions import MARK
from armwright.identification.validation.prediction import Prediction
from armwright.results.table import Table

if TYPE_CHECKING:
    import xarray as xr

    from armwright.identification.validation.comparison import RecordComparison

QUANTITIES = {"q": "position", "qd": "speed", "current": "current", "tau": "torque"}
UNITS = {"q": ("rad", "m"), "qd": ("rad/s", "m/s"), "current": ("A", "A"), "tau": ("N m", "N")}
GAP = 1.5  # usual steps of time behind which a curve begins anew


@dataclass(frozen=True, eq=False)
class MotorFit(EstimateResult):
    """A fit of drives: `estimate` with its uncertainty, the `robot` with first guesses and given numbers, `predictions` by run.

    Attributes:
        estimate: the numbers.   robot: the record before the estimate is written into it.   predictions: by run, datasets with
            every compared signal as measured and as `<signal>_predicted`, time and joint as in `Log.dataset`.
            Of runs that were held out, too.
        source: what the robot's file was, for `write`.   cost: half the sum of squares of scaled residuals.
        hold_out: the record judged on the runs that the log holds out, by the measures of `validate`; None where it is not.
    """

    estimate: Estimate
    robot: RobotDescription
    predictions: Mapping[str, xr.Dataset]
    source: Any
    cost: float
    hold_out: RecordComparison | None = None

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.estimate.log}: motor"

    def tables(self) -> list[Table]:
        """Numbers with standard deviations; then measures of the fit."""
        return self.estimate.tables()

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Writes a page: verdict, what to do next, parameters, correlations, fits, and every run as measured and as predicted.

        Args:
            path: ending in .html.
        Returns:
            path: of the page.
        Raises:
            OutputError: the file cannot be written.
        """
        from armwright.identification.validation.report import write_report  # which draws

        return write_report(path, self.heading, self.estimate, sections=plots(self))

    def write(self, output: str | os.PathLike[str], key: str = "fit") -> Path:
        """Writes the robot's file with the estimate in it, as `write_into`.

        Args:
            output: path of the file.   key: of source and fit in it.
        Returns:
            path: of the file.
        Raises:
            OutputError, DescriptionError: as `write_into`.
        """
        return write_into(self.robot if self.source is None else self.source, self.estimate, output, key)


def plots(fit: MotorFit) -> list[tuple[str, str]]:
    """Sections of `write_report`, one for each run: heading and HTML."""
    from armwright.identification.validation.pictures import over_time

    linear = {each.name: each.kind.units.linear for each in fit.robot.moving_joints}
    found = []
    for run, data in fit.predictions.items():
        use = "held out" if any(name.startswith(f"{run}{MARK}") for name in fit.estimate.fit) else "fitted"
        parts = []
        for name, quantity in QUANTITIES.items():
            for k, joint in enumerate(str(each) for each in data.joint.values):
                if name not in data or not np.isfinite(data[name].values[:, k]).any():
                    continue
                of = f" of {escape(joint)}" if data.sizes["joint"] > 1 else ""
                parts.append(f"<h3>{quantity.capitalize()}{of}</h3>")
                parts.append(f'<div class="plot">{over_time(_prediction(run, use, name, data, linear), k)}</div>')
        found.append((f"Run {escape(run)}, {use}", "\n".join(parts)))
    return found


def _prediction(run: str, use: str, name: str, data: Any, linear: dict[str, bool]) -> Prediction:
    """One signal of a run as pictures draw it; rows that were not compared are left out of the curves."""
    t, joints = data.time.values, tuple(str(each) for each in data.joint.values)
    measured, predicted = data[name].values, data[f"{name}_predicted"].values
    kept = np.isfinite(measured).any(axis=1)
    t, measured, predicted = t[kept], measured[kept], predicted[kept]
    steps = np.diff(t, prepend=t[:1])
    usual = float(np.median(steps[1:])) if len(t) > 1 else 1.0
    part = np.cumsum((steps > GAP * usual) | (steps < 0.0))
    units = tuple(UNITS[name][linear.get(joint, False)] for joint in joints)
    quantity: Any = QUANTITIES[name]
    how = "free simulation of the record's own drives"
    return Prediction(quantity, how, run, use, joints, units, 1.0 / usual, 1, t, part, measured, predicted)

"""Plots of a motor fit for its report: every signal of every run as measured and as predicted."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from armwright.identification.motor.held_out import MARK
from armwright.identification.motor.report import MotorFit
from armwright.identification.validation.pictures import over_time
from armwright.identification.validation.prediction import Prediction

QUANTITIES = {"q": "position", "qd": "speed", "current": "current", "tau": "torque"}
UNITS = {"q": ("rad", "m"), "qd": ("rad/s", "m/s"), "current": ("A", "A"), "tau": ("N m", "N")}
GAP = 1.5  # usual steps of time behind which a curve begins anew


def plots(fit: MotorFit) -> list[tuple[str, str]]:
    """Sections of `write_report`, one for each run: heading and HTML."""
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

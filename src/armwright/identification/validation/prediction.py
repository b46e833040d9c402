"""Predictions beside measurements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from armwright.identification.logs.log import LogRun
from armwright.model import Model

Quantity = Literal["torque", "position", "speed"]
SIGNALS: dict[Quantity, str] = {"torque": "tau", "position": "q", "speed": "qd"}


@dataclass(frozen=True, eq=False)
class Prediction:
    """One quantity of all joints over one run of a log, measured and predicted.

    Attributes:
        quantity: "torque", "position" or "speed".   how: it was predicted, in words.   run, use: of the log.
        joints, units: (n,) of the columns.   rate: rows in a second, in Hz.   every: rows of the log to one row.
        t: (rows,) [s].   part: (rows,) number of the stretch, or of the window that was simulated.
        measured, predicted: (rows, n); NaN where the log has none, or a simulation diverged.
        speed, acceleration: (rows, n) of the joints, where they are known.
        inputs: (rows, n) what drove the prediction, for the cross-correlation; `input_name` in words.
        diverged: windows whose simulation diverged.
        direction: (rows, n) sign of the speed, through the filter that measured torques have passed.
    """

    quantity: Quantity
    how: str
    run: str
    use: str
    joints: tuple[str, ...]
    units: tuple[str, ...]
    rate: float
    every: int
    t: np.ndarray
    part: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    speed: np.ndarray | None = None
    acceleration: np.ndarray | None = None
    inputs: np.ndarray | None = None
    input_name: str = ""
    diverged: int = 0
    direction: np.ndarray | None = None

    @classmethod
    def of(
        cls, arm: Model, run: LogRun, quantity: Quantity, how: str, t: np.ndarray, part: np.ndarray, measured: np.ndarray,
        predicted: np.ndarray, *, rate: float | None = None, every: int = 1, **more: Any,
    ) -> Prediction:  # fmt: skip
        """A prediction at every row of a run, or at every so many; `rate` of the rows in Hz, None: that of the run."""
        names, units = tuple(arm.names), units_of(arm, quantity)
        head = (quantity, how, run.name, run.use, names, units, rate or 1.0 / run.period, every)
        return cls(*head, t, part, measured, predicted, **more)


def units_of(arm: Model, quantity: Quantity) -> tuple[str, ...]:
    """(n,) units of a quantity, one for each joint."""
    return tuple(getattr(body.kind.units, quantity) for body in arm.coordinates)

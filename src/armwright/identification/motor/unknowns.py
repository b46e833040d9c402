"""Unknowns of a fit: numbers of the record, delay, offsets and initial states, each with its bounds and its scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armwright.description.paths import unit_at

RANGE = 1e4  # by which a number that is above 0 may leave its guess either way


@dataclass(frozen=True)
class Unknown:
    """One fitted number; its coordinate is log(value), or value / scale if it may be 0 or change sign.

    Attributes:
        name: path in the record, or "delay", "PRBS: offset_v".   paths: of the record's numbers that have this value.
        label: "joint:name" with its short name, "delay", "offset" or "start".   run: the only run that it is of; "" of all.
        guess: to begin with.   low, high: bounds.   scale: its size.
        logarithmic: whether its coordinate is the logarithm.   nuisance: whether it is of the log rather than the robot.
    """

    name: str
    guess: float
    low: float
    high: float
    scale: float
    paths: tuple[str, ...] = ()
    run: str = ""
    logarithmic: bool = False
    nuisance: bool = False
    unit: str = ""
    label: str = ""

    @property
    def short(self) -> str:
        """Short name: "Kt" of "joint1:Kt"."""
        return self.label.split(":")[-1]

    @property
    def shown_unit(self) -> str:
        """The unit in reports."""
        return self.unit or unit_at(self.paths[0] if self.paths else self.name)

    def to_coordinate(self, value: float) -> float:
        """Coordinate of a value."""
        value = min(max(value, self.low), self.high)
        return float(np.log(value)) if self.logarithmic else value / self.scale

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the coordinate."""
        return self.to_coordinate(self.low), self.to_coordinate(self.high)


def values_of(unknowns: Sequence[Unknown], z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values of coordinates (…, k), and their derivatives by them."""
    logs = np.array([each.logarithmic for each in unknowns], dtype=bool)
    scales = np.array([each.scale for each in unknowns])
    with np.errstate(over="ignore"):
        values = np.where(logs, np.exp(np.where(logs, z, 0.0)), z * scales)
    return values, np.where(logs, values, scales)

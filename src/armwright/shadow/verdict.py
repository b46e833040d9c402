"""Verdict of a shadow: "no alarm" only where every joint was judged practically all the time and the model went with the arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armwright.fitting.directions import listed
from armwright.identification.validation.prediction import units_of
from armwright.model import Model
from armwright.shadow.observer import Residuals

PRACTICALLY_ALL = 0.99  # share of the time
FAR = {False: 0.5, True: 0.1}  # [rad | m] of the position residual; the model no longer shows the motion


@dataclass(frozen=True, eq=False)
class Judged:
    """For how long joints were judged; of several runs the sum.

    Attributes:
        time: [s] of all rows after the filter's first settling.   lost: (n,) [s] without residual or limit.
        farthest: (n,) [rad | m] largest position residual.
    """

    time: float
    lost: np.ndarray
    farthest: np.ndarray

    @classmethod
    def of(cls, n: int) -> Judged:
        """Of no rows."""
        return cls(0.0, np.zeros(n), np.zeros(n))

    @classmethod
    def along(cls, rows: Residuals, limits: np.ndarray) -> Judged:
        """Of rows with limits (rows, n) [N m | N]."""
        without = ~(np.isfinite(rows.torque) & np.isfinite(limits))
        farthest = np.fmax.reduce(np.abs(rows.position), axis=0, initial=0.0)
        return cls(float(rows.step.sum()), rows.step @ without, farthest)

    def __add__(self, other: Judged) -> Judged:
        return Judged(self.time + other.time, self.lost + other.lost, np.maximum(self.farthest, other.farthest))

    @property
    def unjudged(self) -> np.ndarray:
        """(n,) share of the time in which each joint was not judged; 1 without any time."""
        return self.lost / self.time if self.time > 0.0 else np.ones_like(self.lost)


@dataclass(frozen=True)
class Verdict:
    """Result of a shadow.

    Attributes:
        clean: no alarm, every joint judged for PRACTICALLY_ALL of the time, and no position residual is far.
        lines: in words.
    """

    clean: bool
    lines: tuple[str, ...]


def verdict(arm: Model, judged: Judged, alarms: int) -> Verdict:
    """Verdict on rows of an arm.

    Args:
        arm: the model.   judged: of its rows.   alarms: their number.
    """
    share = judged.unjudged
    lost = share > 1.0 - PRACTICALLY_ALL
    far = np.array([FAR[body.kind.units.linear] for body in arm.coordinates])
    away = judged.farthest > far
    lines = []
    if alarms:
        lines.append(f"{alarms} alarm{'s' * (alarms != 1)}")
    elif lost.all():
        lines.append(
            "no verdict: no joint was judged" if (share == 1.0).all() else "no verdict: too much was not judged"
        )
    elif lost.any():
        lines.append(
            f"no verdict on {listed([arm.names[k] for k in np.flatnonzero(lost)])}; nothing raised by the others"
        )
    elif away.any():
        lines.append("no torque residual beyond its limit, but position residuals are far:")
    else:
        lines.append("no alarm")
    if share.any():
        lines.append(f"not judged: {_shares(arm.names, share)} of the time")
    units = units_of(arm, "position")
    lines += [
        f"{arm.names[k]}: the position residual reached {judged.farthest[k]:.3g} {units[k]}, beyond {far[k]:g}: "
        f"torques within the limit move it so far from the model, and smaller contacts are not seen"
        for k in np.flatnonzero(away)
    ]
    return Verdict(not alarms and not lost.any() and not away.any(), tuple(lines))


def _shares(names: Sequence[str], share: np.ndarray) -> str:
    """ "all joints 3.2 %", or each joint with its share."""
    if np.ptp(share) == 0.0:
        return f"all joints {_percent(share[0])}"
    return ", ".join(f"{name} {_percent(each)}" for name, each in zip(names, share, strict=True) if each)


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"

"""Torques of joints at rest: dry friction and gear loss hold a joint within a band, whatever the sign of its rounding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.kernels.compiled import CompiledArm
from armwright.model import Model

RESTING = 1e-9  # of the largest speed, or of the limit of speed: what is slower, stands
WIDE = 1e-6  # of the largest torque: a narrower band is that of a smoothed law


@dataclass(frozen=True, eq=False)
class Torques:
    """Torques of a motion with their bands, (k, n) [N m | N]; where a joint moves, `low` and `high` are the torque itself.

    Attributes:
        qd: speeds, 0 for joints that stand.   tau: of a joint that stands that at a speed of just 0.
        low, high: ends of the band.   held: True where a joint stands and any torque of a band holds it.
    """

    qd: np.ndarray
    tau: np.ndarray
    low: np.ndarray
    high: np.ndarray
    held: np.ndarray

    @property
    def least(self) -> np.ndarray:
        """The torque of least magnitude that does: the one which a limit must allow."""
        return np.where(self.held, np.clip(0.0, self.low, self.high), self.tau)

    def notes(self, names: Sequence[str], units: Sequence[str], row: str = "row {}") -> list[str]:
        """A sentence for every joint that stands in its friction: the band of the first row, and the number of others."""
        said = []
        for k in map(int, np.flatnonzero(self.held.any(axis=0))):
            first, *others = map(int, np.flatnonzero(self.held[:, k]))
            where = " in ".join(filter(None, [f"{names[k]} stands", row.format(first + 1)]))
            band = f"{self.low[first, k]:.5g} … {self.high[first, k]:.5g} {units[k]}"
            more = f"; so it does in {len(others)} more" if others else ""
            said.append(f"{where}: any torque of {band} holds it, by dry friction or gear loss{more}")
        return said


def torques(
    arm: Model, dyn: CompiledArm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, *wrench: Any, fastest: Any = None
) -> Torques:
    """Torques of inverse dynamics; the band of a joint at rest ends at those of the slowest motion either way.

    Args:
        arm: the model.   dyn: compiled, of it or of it with a payload.   q, qd, qdd: (k, n).   wrench: as `inverse_dynamics`.
        fastest: largest speeds of the motion that the rows are of; None: of the rows.
    """
    fastest = np.abs(qd) if fastest is None else np.asarray(fastest)
    limits = np.array([body.limits.velocity for body in arm.coordinates], dtype=float)
    slowest = RESTING * np.maximum(fastest.max(initial=0.0), np.where(np.isfinite(limits), limits, 0.0))
    still = np.abs(qd) <= slowest
    speeds = np.where(still, 0.0, qd)
    tau = np.asarray(dyn.inverse_dynamics(q, speeds, qdd, *wrench))
    low, high, rows = tau.copy(), tau.copy(), still.any(axis=1)
    if rows.any():
        # joints of a coupled wrist creep at different speeds, or their motors would stand all the same
        creep = np.where(slowest > 0.0, slowest, RESTING) * (1.0 + np.arange(arm.n) / (2.0 * arm.n))
        for way in (-1.0, 1.0):
            end = dyn.inverse_dynamics(q[rows], np.where(still, way * creep, qd)[rows], qdd[rows], *wrench)
            end = np.where(still[rows], end, tau[rows])
            low[rows], high[rows] = np.minimum(low[rows], end), np.maximum(high[rows], end)
    held = high - low > WIDE * np.abs([low, high]).max(initial=0.0)
    return Torques(speeds, tau, low, high, held)

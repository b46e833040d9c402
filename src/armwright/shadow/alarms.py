"""Alarms: residuals beyond their limits, explained by another payload or a contact.  [HaddadinEtAl2017]

A limit is `factor` standard deviations of the residual, and SHARE of the torques that motion asks for: inertias are known
to some percent, and filters blur what changes fast. An alarm begins where any joint has been beyond its limit for HOLD, and
ends where all joints have been below half of it for REST.

In its first half second the residuals are compared with those that 1 kg more at the tip would leave, g: the mass that explains
them best is Δm = Σ r·g / Σ g·g, both in units of the limits, and it explains the share (Σ r·g)² / (Σ r·r Σ g·g) of their power.
A contact at a link leaves residuals at the joints between the base and that link alone.

The time of rows without residuals counts neither for HOLD nor for REST.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armwright.shadow.observer import Residuals
from armwright.shadow.verdict import Judged

FACTOR = 8.0  # standard deviations: peaks of model error where joints turn back are 5 in simulation
SHARE = 0.05  # of Σ |M_ij q̈_j| + |C_ij q̇_j|
HOLD, REST = 0.02, 0.2  # [s]
# [s] from the beginning, over which the cause is looked for: later on joints stand still in their friction
JUDGED = 0.5
PAYLOAD = 0.9  # share of the residuals that another payload has to explain


@dataclass(frozen=True)
class ShadowAlarm:
    """Residuals beyond their limits.

    Attributes:
        t: [s] when it was raised.   end: [s] when it was over; None: it lasts.   joint: the one farthest beyond its limit then.
        residual, limit: of that joint [N m | N].   outermost: the last joint from the base that was beyond its limit.
        mass: [kg] more at the tip that explains the residuals best, negative where there is less.   share: that this explains.
    """

    t: float
    end: float | None
    joint: str
    residual: float
    limit: float
    outermost: str
    mass: float = 0.0
    share: float = 0.0

    @property
    def kind(self) -> str:
        """ "payload" or "contact"."""
        return "payload" if self.share >= PAYLOAD else "contact"

    @property
    def cause(self) -> str:
        """The kind in words."""
        if self.kind == "payload":
            return f"payload: {self.mass:+.3g} kg at the tip explains {100 * self.share:.0f} %"
        return f"contact at or beyond the link of {self.outermost}"

    def __str__(self) -> str:
        until = "" if self.end is None else f" to {self.end:.3f} s"
        return f"{self.t:.3f} s{until}: {self.joint} {self.residual:+.3g} beyond ±{self.limit:.3g}; {self.cause}"


def limits_at(limits: np.ndarray, rows: Residuals) -> np.ndarray:
    """(rows, n) [N m | N] limits of the torque residual: limits (n,) at rest, plus a part that grows with motion."""
    return limits + SHARE * rows.moving


class AlarmWatch:
    """Alarms of a stream of residuals.

    Args:
        joints: names, from the base on.   limits: (n,) [N m | N]; NaN: nothing is raised for that joint.

    Attributes:
        alarms: all so far.   judged: for how long each joint was.
    """

    def __init__(self, joints: tuple[str, ...], limits: np.ndarray):
        self._joints, self._limits = joints, np.asarray(limits, dtype=float)
        self.alarms: list[ShadowAlarm] = []
        self.judged = Judged.of(len(joints))
        self._beyond = self._below = np.inf  # since when [s]
        self._sums, self._far = np.zeros(3), np.zeros(len(joints), dtype=bool)

    @property
    def active(self) -> bool:
        """True while an alarm lasts."""
        return bool(self.alarms) and self.alarms[-1].end is None

    def update(self, rows: Residuals) -> list[ShadowAlarm]:
        """New alarms raised by further rows; `alarms` holds all alarms with their later course."""
        raised = []
        with np.errstate(invalid="ignore"):
            limits = limits_at(self._limits, rows)
            ratio, other = np.nan_to_num(rows.torque / limits), np.nan_to_num(rows.kilogram / limits)
        most, without = np.abs(ratio).max(axis=1, initial=0.0), np.any(np.isnan(rows.torque), axis=1)
        self.judged += Judged.along(rows, limits)
        for k, t in enumerate(rows.t):
            if without[k]:
                self._below += rows.step[k]
                self._beyond += rows.step[k]
                continue
            if not self.active:
                if most[k] <= 1.0:
                    self._beyond = np.inf
                    continue
                if self._beyond == np.inf:
                    self._beyond, self._below = t, np.inf
                    self._sums, self._far = np.zeros(3), np.zeros(len(self._joints), dtype=bool)
            if t - self._beyond <= JUDGED:
                self._count(ratio[k], other[k], rows.resting[k] == 0.0)
            if self.active:
                self._continue(t, most[k])
            elif t - self._beyond >= HOLD:
                self.alarms.append(self._raised(t, rows.torque[k], limits[k], ratio[k]))
                raised.append(len(self.alarms) - 1)
        return [self.alarms[k] for k in raised]

    def _count(self, r: np.ndarray, g: np.ndarray, certain: np.ndarray) -> None:
        of_r, of_g = r * certain, g * certain  # where friction may hide a part, the size of a residual says nothing
        self._sums += (of_r @ of_g, of_g @ of_g, of_r @ of_r)
        self._far |= np.abs(r) > 1.0

    def _raised(self, t: float, residual: np.ndarray, limits: np.ndarray, ratio: np.ndarray) -> ShadowAlarm:
        k = int(np.abs(ratio).argmax())
        return self._explained(
            ShadowAlarm(float(t), None, self._joints[k], float(residual[k]), float(limits[k]), self._joints[k])
        )

    def _explained(self, alarm: ShadowAlarm) -> ShadowAlarm:
        """The alarm with what is known of its cause by now."""
        both, of_mass, of_all = self._sums
        mass = both / of_mass if of_mass > 0.0 else 0.0
        share = both**2 / (of_mass * of_all) if of_mass > 0.0 and of_all > 0.0 else 0.0
        outermost = self._joints[int(np.flatnonzero(self._far)[-1])]
        return replace(alarm, mass=float(mass), share=float(share), outermost=outermost)

    def _continue(self, t: float, most: float) -> None:
        self._below = min(self._below, t) if most < 0.5 else np.inf
        over = t - self._below >= REST
        self.alarms[-1] = replace(self._explained(self.alarms[-1]), end=float(t) if over else None)
        if over:
            self._beyond = np.inf

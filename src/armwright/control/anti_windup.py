"""A proportional-integral stage with output limits and anti-windup.  [AstromHagglund2006]

u = clip(kp e + I + feedforward, ±limit); then the integrator goes on by one of

    none              I⁺ = I + ki e T
    clamping          the same, but not while the output is cut off and the error would drive it further
    back-calculation  I⁺ = I + ki e T + (T / Tt) (what was realised - what was asked)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.scalar import Array

RULES = ("none", "clamping", "back-calculation")
ROUNDING = 1e-6  # of a command: a drive that realised it but for this did realise it


def shortfall(applied: Array, asked: Array, slack: Array) -> Array:
    """(n,) difference of the drive's output from its command; 0 within `slack` and rounding."""
    missing = applied - asked
    least = scalar.maximum(slack, ROUNDING * scalar.abs(asked))
    return scalar.where(scalar.less(least, scalar.abs(missing)), missing, 0.0 * missing)


def within(values: Array, limit: Array) -> Array:
    """The values (n,) clipped to ±limit (n,); unchanged for an infinite limit."""
    rows = zip(values, limit, strict=True)
    return scalar.array([v if not scalar.is_symbolic(m) and np.isinf(m) else scalar.clip(v, -m, m) for v, m in rows])


@dataclass(frozen=True, eq=False)
class StageOutput:
    """Result of a stage: output (n,), saturation (n,) as -1, 0 or 1, and the integrator's next value (n,)."""

    output: Array
    cut: Array
    integral: Array


@dataclass(frozen=True, eq=False)
class LimitedStage:
    """A stage of n joints.

    Attributes:
        kp, ki, limit: (n,).   period: [s] from tick to tick.   rule: one of `RULES`.
        tracking_time: [s] Tt of back-calculation.
    """

    kp: Array
    ki: Array
    limit: Array
    period: float
    rule: str
    tracking_time: float | None = None

    def step(
        self,
        error: Array,
        integral: Array,
        *,
        feedforward: Array | float = 0.0,
        missing: Array | float = 0.0,
        ahead: Array | float = 0.0,
    ) -> StageOutput:
        """One tick.

        Args:
            error: (n,).   integral: (n,), in units of the output.   feedforward: (n,) added to the output.
            missing: (n,) by how much the output was not realised the last time, as `shortfall` tells.
            ahead: (n,) where a stage behind this one is cut off, -1, 0 or 1: its limit is this one's too.
        """
        asked = self.kp * error + integral + feedforward
        output = within(asked, self.limit)
        lost = (output - asked) + missing
        cut = scalar.sign(-1.0 * lost)
        limited = scalar.where(scalar.equal(cut, 0.0), ahead + 0.0 * cut, cut)
        step = self.ki * error * self.period
        if self.rule == "none":
            following = integral + step
        else:
            outward = scalar.less(0.0, limited * error)
            if self.rule == "clamping":
                following = integral + scalar.where(outward, 0.0 * step, step)
            else:
                assert self.tracking_time is not None
                blocked = scalar.less(0.0, ahead * error)
                back = (self.period / self.tracking_time) * lost
                following = integral + scalar.where(blocked, 0.0 * step, step) + back
        return StageOutput(scalar.array(output), scalar.array(limited), scalar.array(following))

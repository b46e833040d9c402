"""Limits of a designed motion, and the share of them that a motion uses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from armwright.entry import expect
from armwright.errors import ScenarioError
from armwright.kernels.compiled import CompiledArm, compile_arm
from armwright.model import Model
from armwright.model.changes import without_servos
from armwright.trajectory.efforts import is_massless, without_constants
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.rest import torques

WHOLE_TURN = np.pi  # [rad] to either side, of revolute joints without limits


@dataclass(frozen=True, eq=False)
class ExcitationLimits:
    """Limits for a designed motion, with the model that checks them; infinite if absent.

    Attributes:
        arm: the model.   low, high: (n,) positions.
        most: by quantity (n,) the largest magnitude: "velocity", "acceleration", "torque", "voltage".
        box: (2, 3) lowest and highest x, y, z of the tip in base axes [m].   reasons: sentences on what is not honoured.
    """

    arm: Model
    low: np.ndarray
    high: np.ndarray
    most: dict[str, np.ndarray]
    box: np.ndarray
    reasons: tuple[str, ...] = ()

    @cached_property
    def dyn(self) -> CompiledArm:
        """The compiled arm."""
        return compile_arm(without_servos(self.arm))

    @property
    def middle(self) -> np.ndarray:
        """(n,) middle of the range of positions."""
        return 0.5 * (self.low + self.high)

    @property
    def has_box(self) -> bool:
        """True if the tip is bounded."""
        return bool(np.isfinite(self.box).any())

    @property
    def used_names(self) -> tuple[str, ...]:
        """Names of the quantities of `used`."""
        return ("position", *self.most)

    def bounded(self, quantity: str) -> np.ndarray:
        """(n,) True for a joint with a limit of that quantity."""
        return np.isfinite(self.most[quantity])

    def used(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> dict[str, np.ndarray]:
        """By quantity (n,) the largest share of its limit that a motion uses, 1: all of it; NaN without a limit.

        Args:
            q, qd, qdd: (rows, n) states of the motion.
        """
        peaks = {"velocity": np.abs(qd).max(axis=0), "acceleration": np.abs(qdd).max(axis=0)}
        if self.bounded("torque").any() or self.bounded("voltage").any():
            found = torques(self.arm, self.dyn, q, qd, qdd)
            qd, tau = found.qd, found.least
            peaks["torque"] = np.abs(tau).max(axis=0)
            if self.bounded("voltage").any():
                peaks["voltage"] = np.abs(self.dyn.motor_voltage(qd, tau)).max(axis=0)
        half = 0.5 * (self.high - self.low)
        found = {"position": np.abs(q - self.middle).max(axis=0) / half}
        for quantity, most in self.most.items():
            limited = np.isfinite(most)
            found[quantity] = np.full(self.arm.n, np.nan)
            found[quantity][limited] = (peaks[quantity] / most)[limited] if limited.any() else []
        return found

    def outside_box(self, q: np.ndarray) -> float:
        """Distance of the tip from the box [m]; 0 inside."""
        if not self.has_box:
            return 0.0
        tip = self.dyn.forward_kinematics(q)[:, :3, 3]
        return float(max((self.box[0] - tip).max(), (tip - self.box[1]).max(), 0.0))


def excitation_limits(arm: Model, limits: MotionLimits | None = None, box: Any = None) -> ExcitationLimits:
    """Limits for a designed motion, without those that the record is not complete enough to check.

    Args:
        arm: the model.   limits: None: the record's.
        box: (2, 3) lowest and highest x, y, z of the tip in base axes [m]; infinite where free.
    Raises:
        ScenarioError: a limit that is none, or a joint that nothing bounds.
    """
    record = MotionLimits.of(arm)
    limits = record if limits is None else limits
    expect(limits, MotionLimits, "limits", "MotionLimits.of(arm, velocity=…)", ScenarioError)
    reasons = ["jerk limits are not honoured"] * bool(np.isfinite(limits.jerk).any())
    low, high = _positions(arm, limits, reasons).T
    most = {name: getattr(limits, name) for name in ("velocity", "acceleration", "torque", "voltage")}
    _drop_unknown(arm, most, record, reasons)
    free = [name for k, name in enumerate(arm.names) if not any(np.isfinite(each[k]) for each in most.values())]
    if free:
        raise ScenarioError(
            f"nothing bounds the speed of {', '.join(map(repr, free))}", place=arm.name,
            expected="a velocity, acceleration, torque or voltage limit, in the record or as an argument",
        )  # fmt: skip
    return ExcitationLimits(arm, low, high, most, _box(box), tuple(reasons))


def _positions(arm: Model, limits: MotionLimits, reasons: list[str]) -> np.ndarray:
    """(n, 2) bounds of the positions; half a turn to either side of a joint that turns without end."""
    bounds = limits.position.copy()
    for k, body in enumerate(arm.coordinates):
        if not np.isfinite(bounds[k]).all():
            if body.kind.slides:
                expected = "position limits, in the record or as an argument"
                raise ScenarioError("slides without bounds", place=f"joint {body.joint!r}", expected=expected)
            bounds[k] = [-WHOLE_TURN, WHOLE_TURN]
            reasons.append(f"{body.joint} has no position limits: it stays within half a turn to either side")
    return bounds


def _drop_unknown(arm: Model, most: dict[str, np.ndarray], record: MotionLimits, reasons: list[str]) -> None:
    """Removes torque and voltage limits that the record is not complete enough to check, and says why."""
    massless, dark = is_massless(arm), without_constants(arm)
    for quantity, unknown in (("torque", massless), ("voltage", massless or bool(dark))):
        if not unknown:
            continue
        what = "links without masses" if massless else f"no motor constants of {', '.join(dark)}"
        own = getattr(record, quantity)
        if not np.array_equal(most[quantity], own) and np.isfinite(most[quantity]).any():
            expected = "a record with all numbers for it"
            raise ScenarioError(
                f"the record has {what}", place=f"limits.{quantity}", value=most[quantity], expected=expected
            )
        if massless or np.isfinite(own).any():
            reasons.append(f"{quantity} limits are not honoured: the record has {what}")
        most[quantity] = np.full(arm.n, np.inf)


def _box(box: Any) -> np.ndarray:
    if box is None:
        return np.array([[-np.inf] * 3, [np.inf] * 3])
    try:
        values = np.asarray(box, dtype=float)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape != (2, 3) or not (values[0] < values[1]).all():
        raise ScenarioError(place="box", value=box, expected="(2, 3): lowest and highest x, y, z of the tip [m]")
    return values

"""A rule of linear control applied to a scenario's controller: gains at a bandwidth, and the highest that keeps the margins."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from armwright.control.analysis.linear_loop import LinearLoop
from armwright.control.cascade import Cascade
from armwright.control.computed_torque import ComputedTorque
from armwright.control.design.joint_plants import JointPlants, current_lag
from armwright.control.design.rules import RULES, SYMMETRIC, DesignTask, JointGains
from armwright.control.joint_pid import JointPID
from armwright.errors import ScenarioError
from armwright.parameters import Batch, numbers_by_lane
from armwright.simulation.scenario import Scenario

DESIGNED = (JointPID, Cascade, ComputedTorque)
STEPS = {"lqr": 9}  # bandwidths of a grid; each regulator takes a while
SLOWEST = 1e-2  # of them, as a share of the fastest
SHORTER, HALVINGS = 0.8, 3  # from one common factor of the coupled loop to the next


@dataclass(frozen=True, eq=False)
class Designer:
    """A rule applied to the controller of a scenario, and the margins of what it gives.

    Attributes:
        law: the controller that is designed.   bare: the scenario with it alone, without what wraps it.
        loop: linear, of the bare scenario.   task: conditions of the rule.   asked: gain and phase margin [rad].
    """

    scenario: Scenario
    bare: Scenario
    law: Any
    method: str
    loop: LinearLoop
    task: DesignTask
    asked: tuple[float, float]
    order: list[int]  # of the poses: those where candidates failed come first
    known: dict[tuple[tuple[int, ...], bytes], JointGains] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        law: Any,
        method: str,
        zeta: float,
        drawn: tuple[int, int],
        asked: tuple[float, float],
        period: float | None = None,
    ) -> Designer:
        """Args:
        drawn: how many poses, and their seed.   period: [s] in place of the loop's own.
        """
        assert scenario.loop is not None
        law = law if getattr(law, "current_kp", None) is None else replace(law, **current_gains(scenario, period))
        bare = replace(scenario, loop=replace(scenario.loop, controller=law))
        loop = LinearLoop(bare, period)
        joints = JointPlants.of(loop, law, *drawn)
        if isinstance(law, ComputedTorque):  # the model's inverse dynamics leaves double integrators
            joints = replace(joints, inertia=np.ones_like(joints.inertia), damping=0.0 * joints.damping)
        integral = bool(np.any(numbers_by_lane(law.speed_ki if isinstance(law, Cascade) else law.ki) > 0.0))
        task = DesignTask(scenario.arm, joints, zeta, integral, loop.period, loop.delay)
        return cls(scenario, bare, law, method, loop, task, asked, list(range(len(joints.poses))))

    @property
    def highest(self) -> np.ndarray:
        """(n,) [rad/s] highest bandwidth to try."""
        return 1.0 / ((SYMMETRIC if self.method == "symmetric-optimum" else 1.0) * self.task.joints.lag)

    def found(self, bandwidth: np.ndarray) -> JointGains:
        """Result of the rule at bandwidths (…, n), cached."""
        key = (bandwidth.shape, bandwidth.tobytes())
        if key not in self.known:
            self.known[key] = RULES[self.method](self.task, bandwidth)
        return self.known[key]

    def gains(self, bandwidth: np.ndarray) -> dict[str, np.ndarray]:
        """Gains by name, (…, n) each, at bandwidths (…, n); NaN if the rule gives none."""
        found = self.found(bandwidth)
        if isinstance(self.law, Cascade):
            gains = {"position_kp": found.position, "speed_kp": found.speed, "speed_ki": found.integral}
        else:
            kp, ki = found.speed * found.position + found.integral, found.integral * found.position
            gains = {"kp": kp, "ki": ki, "kd": found.speed}
        if not self.task.integral:
            gains.pop("speed_ki" if isinstance(self.law, Cascade) else "ki")
        return gains

    def stiffness(self, bandwidth: np.ndarray) -> np.ndarray:
        """(k, n) stiffness k_s k_p [U/rad | U/m] against a load at bandwidths (k, n), without the integral."""
        found = self.found(bandwidth)
        return np.nan_to_num(found.speed * found.position)

    @cached_property
    def batched(self) -> LinearLoop:
        """The unwrapped loop with gains as batches."""
        rows = {name: Batch(np.atleast_2d(each)) for name, each in self.gains(0.5 * self.highest).items()}
        ones = {name: Batch(np.ones_like(each.values)) for name, each in rows.items()}  # any finite numbers
        assert self.bare.loop is not None
        bare = replace(self.bare, loop=replace(self.bare.loop, controller=replace(self.law, **ones)))
        return LinearLoop(bare, self.loop.period, self.loop.plant)

    def keeping(self, bandwidth: np.ndarray, joint: int | None = None) -> np.ndarray:
        """(k,) True if bandwidths (k, n) keep the margins at all poses; or those of one joint, all others fixed."""
        gains = self.gains(bandwidth)
        ordered = [gains[each.name] for each in fields(self.law) if each.name in gains]
        known = [np.isfinite(each if joint is None else each[:, [joint]]).all(axis=-1) for each in ordered]
        active, kept = np.flatnonzero(np.all(known, axis=0)), np.zeros(len(bandwidth), dtype=bool)
        rows = np.nan_to_num(np.concatenate(ordered, axis=-1))
        for k in list(self.order):
            if not active.size:
                break
            passed = self.batched.keeps(
                self.batched.slopes(self.task.joints.poses[k], rows[active], joint), *self.asked
            )
            if not passed.any():  # the next candidates will most probably fail here too
                self.order.remove(k)
                self.order.insert(0, k)
            active = active[passed]
        kept[active] = True
        return kept

    def alone(self, from_: np.ndarray | None = None) -> np.ndarray | None:
        """(n,) [rad/s] bandwidth with the greatest stiffness that keeps each joint's margins; None if one of them has none.

        Args:
            from_: (n,) [rad/s] lowest of them that are tried, and taken where no other does; None: `SLOWEST` of the highest,
                and that share again where none of those keeps them.
        """
        n, steps = self.scenario.arm.n, STEPS.get(self.method, 25)
        low = SLOWEST * self.highest if from_ is None else np.minimum(from_, self.highest)
        grid, chosen = np.geomspace(self.highest, low, steps), np.zeros(n)
        slower = [SLOWEST * grid] if from_ is None else []  # where inertia varies much and delays are short
        for joint in range(n):
            for tried in (grid, *slower):
                kept = np.flatnonzero(self.keeping(tried, joint))
                if kept.size:
                    chosen[joint] = tried[kept[self.stiffness(tried[kept])[:, joint].argmax()], joint]
                    break
            else:
                if from_ is None:
                    return None
                chosen[joint] = from_[joint]
        return chosen

    def together(self, alone: np.ndarray) -> np.ndarray | None:
        """(n,) [rad/s] bandwidths (n,) of all joints, slowed by one factor until the coupled loop keeps the margins; or None."""
        scale, failing = 1.0, 1.0
        while not self.keeping(scale * alone[None])[0]:
            scale, failing = SHORTER * scale, scale
            if scale < SLOWEST:
                return None
        for _ in range(HALVINGS):
            middle = 0.5 * (scale + failing)
            scale, failing = (middle, failing) if self.keeping(middle * alone[None])[0] else (scale, middle)
        return scale * alone

    def fastest(self) -> np.ndarray | None:
        """(n,) [rad/s] bandwidths with the greatest stiffness that keep all margins; None if no bandwidth keeps them."""
        alone = self.alone()
        return None if alone is None else self.together(alone)


def designed_controller(scenario: Scenario) -> Any:
    """The controller to design: the scenario's own, or the inner one of a wrapper.

    Raises:
        ScenarioError: there is none.
    """
    law = scenario.controller if isinstance(scenario, Scenario) else None
    while law is not None and not isinstance(law, DESIGNED) and hasattr(law, "inner"):
        law = law.inner
    if not isinstance(law, DESIGNED):
        expected = "aw.JointPID, aw.Cascade or aw.ComputedTorque, or one of these within another"
        found = "has no controller" if law is None else "no rule designs its gains"
        raise ScenarioError(found, place="loop.controller", expected=expected)
    return law


def with_gains(control: Any, gains: dict[str, Any]) -> Any:
    """A controller with other gains, (n,) each or a batch; for a wrapper, with other gains of its inner controller."""
    if isinstance(control, DESIGNED):
        return replace(control, **gains)
    return replace(control, inner=with_gains(control.inner, gains))


def current_gains(scenario: Scenario, period: float | None = None) -> dict[str, np.ndarray]:
    """Gains of a cascade's current loop by the magnitude optimum:  kp = L / (2 T),  ki = R / (2 T),  T its small delays.

    Args:
        scenario: whose drives take voltages.   period: [s] in place of the loop's own.
    Raises:
        ScenarioError: the record has no resistance or no inductance of a winding.
    """
    loop = LinearLoop(scenario, period)
    rows = []
    for body in scenario.arm.coordinates:
        if body.drive.resistance is None or body.drive.inductance is None:
            what = f"the file of {scenario.arm.name} gives no winding resistance and inductance of joint {body.joint!r}"
            raise ScenarioError(what, place="current_kp", expected="both, to design a current loop")
        rows.append((body.drive.inductance, body.drive.resistance))
    kp, ki = np.array(rows, dtype=float).T / (2.0 * current_lag(loop))
    return {"current_kp": kp, "current_ki": ki}

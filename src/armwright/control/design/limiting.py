"""Limits of designed joints: the design again without one cause at a time, and how much faster each joint is then.

    factor of a cause = bandwidth of the joint by itself without it / with it

A joint by itself is one whose neighbours are held still. Causes that are not there have no factor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from armwright.control.analysis.linear_loop import LinearLoop
from armwright.control.commands import torque_commands
from armwright.control.design.designer import Designer, designed_controller
from armwright.control.design.joint_plants import current_driven
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.parameters import numbers_by_lane
from armwright.simulation.loop.sensors import Sensors
from armwright.simulation.loop.timing import Timing
from armwright.simulation.scenario import Scenario
from armwright.trajectory.limits import MotionLimits

FINER = 8.0  # sampling that counts as none
MATTERS = 1.1  # factor from which a cause is named
Again = Callable[[Scenario, float | None], Designer]


@dataclass(frozen=True)
class JointLimit:
    """Limit of one joint's bandwidth.

    Attributes:
        joint: its name.   bandwidth: [rad/s] of the design.
        causes: by name, how many times faster the joint could be without it, the largest first.
        saturates: [rad | m] error from which the drive is at its limit of current, torque or voltage; infinite without one.
        unit: of it.   spread: largest inertia over the workspace by the least.
    """

    joint: str
    bandwidth: float
    causes: dict[str, float]
    saturates: float
    unit: str
    spread: float

    @property
    def slow(self) -> bool:
        """True where a cause makes the joint slower by a tenth or more."""
        return any(factor >= MATTERS for factor in self.causes.values())

    def __str__(self) -> str:
        named = [f"{cause} (×{factor:.3g} without)" for cause, factor in self.causes.items() if factor >= MATTERS]
        limited = f"limited by {', '.join(named)}" if named else "no single cause limits it by a tenth"
        inertia = f"; its inertia varies ×{self.spread:.3g} over the workspace" if self.spread >= MATTERS else ""
        drive = f"; its drive is at its limit from an error of {self.saturates:.3g} {self.unit} on"
        return f"{self.joint}: {self.bandwidth:.3g} rad/s, {limited}{inertia}{drive if np.isfinite(self.saturates) else ''}"


def joint_limits(
    scenario: Scenario, bandwidth: np.ndarray, alone: np.ndarray | None, again: Again
) -> tuple[JointLimit, ...]:
    """Limits of every joint of a design, in the order of the joints.

    Args:
        scenario, bandwidth, alone: of the `GainDesign`.   again: its rule for another scenario, and period [s] of its loop.
    """
    arm, designer = scenario.arm, again(scenario, None)
    own = bandwidth if alone is None else alone
    factors = [{"the other joints": float(a / b)} for a, b in zip(own, bandwidth, strict=True)]
    for cause, changed, period in _without(scenario, designer.loop):
        faster = _alone(again, changed, period, own)
        for row, a, b in zip(factors, faster, own, strict=True):
            row[cause] = max(float(a / b), 1.0)
    inertia = designer.task.joints.inertia
    stiffness = designer.stiffness(bandwidth[None])[0]
    errors = _commands(arm, designer) / stiffness
    return tuple(
        JointLimit(
            body.joint,
            float(bandwidth[j]),
            dict(sorted(factors[j].items(), key=lambda pair: -pair[1])),
            float(errors[j]),
            body.kind.units.position,
            float(inertia[:, j].max() / inertia[:, j].min()),
        )
        for j, body in enumerate(arm.coordinates)
    )


def _without(scenario: Scenario, linear: LinearLoop) -> Iterator[tuple[str, Scenario, float | None]]:
    """Causes that are there, by name, with the scenario and perhaps the period [s] without them."""
    loop = scenario.loop
    assert loop is not None
    if linear.delay > 0.0:
        name = f"the delay of {1e3 * linear.delay:.3g} ms"
        yield name, replace(scenario, loop=replace(loop, timing=Timing())), None
    same = replace(scenario, loop=replace(loop, timing=Timing(command_delay=linear.delay)))
    yield f"the sample period of {1e3 * linear.period:.3g} ms", same, linear.period / FINER
    sensors = loop.joint_sensors
    if sensors.velocity != "exact":
        slow = "" if sensors.cutoff_hz is None else f", {float(numbers_by_lane(sensors.cutoff_hz).min()):.3g} Hz"
        exact = replace(sensors, velocity="exact", cutoff_hz=None)
        others = [exact if isinstance(each, Sensors) else each for each in loop.sensor_list]
        yield (
            f"the encoder's speed ({sensors.velocity}{slow})",
            replace(scenario, loop=replace(loop, sensors=others)),
            None,
        )
    arm = scenario.arm
    if any(body.elasticity is not None for body in arm.coordinates):
        rigid = tuple(replace(body, elasticity=None) for body in arm.bodies)
        yield "the elasticity of gears", replace(scenario, arm=replace(arm, bodies=rigid)), None
    inner = getattr(designed_controller(scenario), "current_kp", None) is not None
    if not inner and any(_has_inductance(body.drive) for body in arm.coordinates):
        quick = tuple(replace(body, drive=replace(body.drive, inductance=None)) for body in arm.bodies)
        yield "the inductance of windings", replace(scenario, arm=replace(arm, bodies=quick)), None


def _has_inductance(drive: object) -> bool:
    return getattr(drive, "command", "") == "voltage" and getattr(drive, "inductance", None) is not None


def _alone(again: Again, scenario: Scenario, period: float | None, own: np.ndarray) -> np.ndarray:
    """(n,) [rad/s] bandwidths of the joints by themselves in a changed scenario, from their own on."""
    try:
        found = again(scenario, period).alone(own)
    except ScenarioError:  # a loop that there is none of, such as a current loop without an inductance
        return own
    assert found is not None
    return found


def _commands(arm: Model, designer: Designer) -> np.ndarray:
    """(n,) commands at which the drives are at their limits of torque, current or voltage; infinite without one."""
    driven = arm if getattr(designer.law, "current_kp", None) is None else current_driven(arm)
    limits, zero = MotionLimits.of(arm), np.zeros(arm.n)
    torque = np.where(np.isfinite(limits.torque), limits.torque, 0.0)
    of_torque = np.abs(np.asarray(torque_commands(driven, zero, torque), dtype=float))
    found = np.where(np.isfinite(limits.torque), of_torque, np.inf)
    volts = [body.drive.command == "voltage" for body in driven.coordinates]
    return np.where(volts, np.minimum(found, limits.voltage), found)

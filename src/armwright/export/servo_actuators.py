"""A servo's loop as an actuator of simulators: one gain with damping and a limit, or MuJoCo's DC motor.

At the joint, with K = n Kt, K_e = n Ke, a supply of V volts and the firmware's gains k_p, k_i, k_d:

    τ = within(k (g - q) - k' q̇, effort) - (d + d_e) q̇ - friction,  k = K V k_p / R, k' = K V k_d / R, effort = K V limit / R,
    d_e = K K_e / R of the back-EMF, d of viscous friction

for a loop that gives a duty; for one that gives a current V / R is 1 and d_e is 0. Steps of the loop, counts, the dead band, the
speed of the goal, friction by load and Stribeck's are not in it: a fit makes up for them over a motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright.description.paths import path_name, quantities, split_path
from armwright.description.robot import RobotDescription
from armwright.errors import ModelError
from armwright.model import Body, build_model
from armwright.model.variants.values import with_values

KINDS = {"position": "3.0", "dcmotor": "4.0"}  # of MuJoCo's elements: the first version that reads what is written
DELAYS = "3.14"  # the oldest version at hand that reads a delay; 3.3 does not
LEAST_DRY = 1e-3  # of the limit
FITTED = ("stiffness", "damping", "armature", "friction", "effort")


@dataclass(frozen=True)
class ServoActuator:
    """Numbers of a joint's actuator.

    Attributes:
        stiffness: torque by error of position [N m/rad | N/m].   derivative: by speed, within the limit [N m s/rad | N s/m].
        damping: of back-EMF and viscous friction together, without a limit [N m s/rad | N s/m].
        armature: inertia of the rotor at the joint [kg m² | kg].   friction: dry [N m | N].   effort: limit [N m | N].
        delay: of goals [s].   play: whole width [rad | m], for other simulators.
        emf: part of `damping` that is back-EMF's [N m s/rad | N s/m].   constant: K [N m/A | N/A].   resistance: R [Ω].
        integral: torque by error and time [N m/(rad s) | N/(m s)].   goal_speed: [rad/s | m/s], infinite without one.
    """

    stiffness: float
    derivative: float
    damping: float
    armature: float
    friction: float
    effort: float
    delay: float
    play: float
    emf: float
    constant: float
    resistance: float
    integral: float
    goal_speed: float

    def scaled(self, factors: Any) -> ServoActuator:
        """With the fitted numbers times (5,) factors, in the order of `FITTED`."""
        return replace(self, **{name: getattr(self, name) * float(f) for name, f in zip(FITTED, factors, strict=True)})


def servo_actuators(robot: RobotDescription) -> dict[str, ServoActuator]:
    """Actuators of all joints that are driven, by name, from the record alone.

    Raises:
        ModelError: a joint whose drive does not follow goals, or whose motor others turn too; names it.
    """
    arm = build_model(robot)
    found = {}
    for body in arm.coordinates:
        _check(body)
        found[body.joint] = _actuator(body, float(body.limits.voltage if arm.supply is None else arm.supply.voltage))
    return found


def spreads(robot: RobotDescription) -> dict[str, dict[str, float]]:
    """Relative standard deviations of the fitted numbers of each joint, as those of the record make them.

    To first order: the root of the sum over the record's numbers of the squares of what one deviation of each changes.
    """
    known = servo_actuators(robot)
    squares = {name: dict.fromkeys(FITTED, 0.0) for name in known}
    places = {path_name(name): name for name in known}
    for path, quantity, _ in quantities(robot, pictures=False):
        name = places.get(path_name(split_path(path)[0]))
        if name is None or not isinstance(quantity.std, float) or not quantity.std:
            continue
        moved = with_values(robot, {path: float(quantity) + quantity.std})
        changed = servo_actuators(moved)[name]
        for each in FITTED:
            before = getattr(known[name], each)
            squares[name][each] += ((getattr(changed, each) - before) / before) ** 2 if before else 0.0
    return {name: {each: float(np.sqrt(value)) for each, value in found.items()} for name, found in squares.items()}


def _check(body: Body) -> None:
    place = f"joint {body.joint!r}"
    if body.drive.firmware is None:
        what = f"is commanded by {body.drive.command}, so that nothing follows goals"
        raise ModelError(what, place=place, expected='command = "position" and the firmware of a servo')
    if body.drive.coupling:
        raise ModelError(f"its motor is turned by {body.drive.coupling[0][0]!r} too", place=place)
    if body.drive.efficiency is not None:
        raise ModelError("no actuator has the efficiency of a gear", place=f"{place} motor.gear_efficiency")


def _actuator(body: Body, supply: float) -> ServoActuator:
    drive, friction, firmware = body.drive, body.friction, body.drive.firmware
    assert firmware is not None
    ratio, resistance = abs(float(drive.gear_ratio)), float(drive.resistance or 0.0)
    constant = ratio * float(drive.torque_constant or 0.0)
    emf = ratio * float(
        drive.back_emf_constant if drive.back_emf_constant is not None else drive.torque_constant or 0.0
    )
    is_duty = firmware.output == "duty"
    by_output = constant * supply / resistance if is_duty else constant
    braking = constant * emf / resistance if is_duty else 0.0
    limits = [float(firmware.limit) * by_output, float(body.limits.torque), float(body.limits.current) * constant]
    play = 0.0 if body.elasticity is None else float(body.elasticity.backlash or 0.0)
    effort = min(limits)
    dry = 0.0 if friction is None else 0.5 * float(friction.coulomb_positive + friction.coulomb_negative)
    if friction is not None and friction.is_dry and not dry:
        dry = LEAST_DRY * effort  # of friction by load alone: a fit finds its mean
    viscous = 0.0 if friction is None else float(friction.viscous)
    return ServoActuator(
        stiffness=by_output * float(firmware.proportional),
        derivative=by_output * float(firmware.derivative or 0.0),
        damping=braking + viscous,
        armature=float(drive.reflected),
        friction=dry,
        effort=effort,
        delay=firmware.period * (firmware.latency + 0.5),
        play=play,
        emf=braking,
        constant=constant,
        resistance=resistance,
        integral=by_output * float(firmware.integral or 0.0),
        goal_speed=np.inf if firmware.speed is None else float(firmware.speed),
    )


def joint_values(kind: str, each: ServoActuator) -> dict[str, float]:
    """Attributes of MuJoCo's joint: armature, damping, frictionloss."""
    damping = each.damping if kind == "position" else max(each.damping - each.emf, 0.0)
    return {"armature": each.armature, "damping": damping, "frictionloss": each.friction}


def element(kind: str, joint: str, each: ServoActuator, step: float) -> tuple[str, dict[str, str]]:
    """MuJoCo's actuator: its tag and attributes.

    Args:
        kind: of `KINDS`.   joint: its name.   each: the numbers.
        step: of the simulation, in whole ones of which delays are [s].
    """
    values = {"name": f"{joint}_servo", "joint": joint}
    if kind == "position":
        values |= {"kp": repr(each.stiffness)} | ({"kv": repr(each.derivative)} if each.derivative else {})
        if np.isfinite(each.effort):
            values |= {"forcelimited": "true", "forcerange": f"{-each.effort!r} {each.effort!r}"}
    else:  # its drive adds K q̇ to R τ / K, which k' of the back-EMF takes away again
        most = each.effort * each.resistance / each.constant if each.emf else 0.0
        held = each.effort / each.integral if each.integral and np.isfinite(each.effort) else 0.0
        slew = each.goal_speed if np.isfinite(each.goal_speed) else 0.0
        gains = (each.stiffness, each.integral, each.derivative + each.emf, slew, held, most)
        values |= {"input": "pos", "motorconst": repr(each.constant), "resistance": repr(each.resistance)}
        values |= {"controller": " ".join(repr(float(gain)) for gain in gains)}
        if not each.emf and np.isfinite(each.effort):
            values |= {"saturation": repr(each.effort)}
    late = whole_steps(each, step)
    return kind, {**values, **({"delay": repr(late * step), "nsample": str(late)} if late else {})}


def whole_steps(each: ServoActuator, step: float) -> int:
    """Of the delay; a step of the simulation itself is half of one late on average."""
    return max(int(np.floor(each.delay / step)), 0)

"""Losses: properties of a description that another format cannot represent, one sentence each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import Any

from armwright.description.drive_file import PARTS
from armwright.description.friction import BY_TEMPERATURE
from armwright.description.paths import quantities
from armwright.description.robot import RobotDescription
from armwright.export.joints import is_of_coupled_motor
from armwright.friction_laws import LAWS


class Losses:
    """Losses of a conversion, collected by kind."""

    def __init__(self) -> None:
        self._names: dict[tuple[str, str], list[str]] = defaultdict(list)

    def add(self, what: str, name: str, word: str = "joint") -> None:
        """Adds one joint or link to a loss."""
        self._names[what, word].append(name)

    def sentences(self) -> list[str]:
        """One for each kind."""
        return [loss_of(what, names, word) for (what, word), names in self._names.items()]


EFFECTS = ("inductance_h", "current_loop_hz", "pwm", "dead_zone_v", "thermal", "cogging", "coupling")


def of_all_formats(robot: RobotDescription, kept: str = "", servos: bool = False) -> list[str]:
    """Properties that neither URDF nor MJCF can represent.

    Args:
        robot: the description.   kept: what is said behind those that a drive file keeps.
        servos: True if actuators stand for the servos' loops, with electrical constants and limits.
    """
    moving = robot.moving_joints
    motors = [(joint.name, joint.motor) for joint in moving if joint.motor is not None]
    electric = [name for name, motor in motors if motor.torque_constant_n_m_per_a is not None]
    lossy, by_load = (
        [name for name, motor in motors if getattr(motor, key) is not None]
        for key in ("gear_efficiency", "gear_efficiency_table")
    )
    driven = [joint.name for joint in moving if (joint.command or robot.command) != "torque"]
    supply = [j.name for j in moving if j.limits.voltage_v is not None or j.limits.current_a is not None]
    planned = [j.name for j in moving if j.limit("acceleration") is not None]
    numbers = list(quantities(robot))
    spread = sum(quantity.std is not None for _, quantity, _ in numbers)
    dh = [joint.name for joint in robot.joints if joint.dh is not None or joint.modified_dh is not None]
    accepted = [link.name for link in robot.links if link.accept_impossible is not None]
    parts = {
        part: [joint.name for joint in moving if getattr(joint, part) is not None] for part in PARTS if part != "spring"
    }
    within = {key: [name for name, motor in motors if getattr(motor, key) not in (None, ())] for key in EFFECTS}
    elastic = [(joint.name, joint.elasticity) for joint in moving if joint.elasticity is not None]
    play, error = (
        [name for name, each in elastic if getattr(each, each.units.key(stem, "position")) is not None]
        for stem in ("backlash", "error")
    )
    if servos:
        electric, supply, driven = [], [], []
        parts["steps, counts and dead band of the firmware"] = parts.pop("firmware")
    counted = [] if servos else [each.name for each in moving if each.firmware and each.firmware.counts_per_turn]
    of_drives = [
        loss_of("electrical constants", electric),
        loss_of("gear efficiency", lossy),
        loss_of("gear efficiency by load", by_load),
        loss_of("voltage and current limits", supply),
        loss_of("acceleration limits", planned),
        *(loss_of(part, names) for part, names in parts.items()),
        loss_of("play of the elasticity", play),
        loss_of("kinematic error of the elasticity", error),
        loss_of("counts of servos", counted),
        *(loss_of(f"{key} of the motor", names) for key, names in within.items()),
        "supply" if robot.supply is not None and not servos else "",
        loss_of("commands other than torque", driven),
    ]
    others = [
        loss_of("Denavit-Hartenberg rows (frames are written instead)", dh),
        loss_of("the reasons why impossible inertias are accepted", accepted, "link"),
        f"the sources of {len(numbers)} numbers",
        f"{spread} standard deviations" if spread else "",
        "title and notes" if robot.title or robot.notes else "",
    ]
    return [*(f"{sentence}{kept}" for sentence in of_drives if sentence), *filter(None, others)]


def of_friction(robot: RobotDescription) -> list[str]:
    """Properties of the friction records beyond damping and one magnitude of dry friction."""
    lost: dict[str, list[str]] = {}
    for joint in robot.moving_joints:
        if joint.friction is None:
            continue
        coupled = is_of_coupled_motor(joint)
        for what in ["friction of coupled motors"] if coupled else _beyond_coulomb(joint.friction):
            lost.setdefault(what, []).append(joint.name)
    return [loss_of(what, names) for what, names in lost.items()]


def _beyond_coulomb(friction: Any) -> list[str]:
    key = friction.units.key
    plus, minus, offset, level = (
        getattr(friction, key(stem, "torque"))
        for stem in ("coulomb_positive", "coulomb_negative", "offset", "stribeck_torque")
    )
    lost = [LAWS[friction.law].lost] if LAWS[friction.law].lost else []
    if friction.side == "motor":
        lost.append("that friction is the motor's (written as the joint's, by n² and |n|)")
    if plus is not None and minus is not None:
        if getattr(friction, key("smoothing", "speed")) is not None:
            lost.append("the speed that smooths dry friction")
        if float(plus) != float(minus):
            lost.append("dry friction that differs by direction (the mean is written)")
    if offset is not None and float(offset):
        lost.append("friction offset")
    lost += [
        f"{each} of the friction"
        for each in ("load_coefficient", *BY_TEMPERATURE)
        if getattr(friction, each, None) is not None
    ]
    if level is not None:
        lost.append("Stribeck friction")
    return lost


def loss_of(what: str, names: Iterable[str], word: str = "joint") -> str:
    """One loss with the names of its joints or links; empty without any."""
    names = list(dict.fromkeys(names))
    return f"{what}: {word}{'s' if len(names) > 1 else ''} {', '.join(names)}" if names else ""

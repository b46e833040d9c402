"""Checks of a whole robot: one joint, link or table cannot see what another one needs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from armwright.description.drive import COMMAND_NEEDS
from armwright.description.friction import BY_TEMPERATURE
from armwright.description.paths import quantities
from armwright.quantity import SourceKind
from armwright.validation import Invalid

KINDS: tuple[str, ...] = SourceKind.__args__  # type: ignore[attr-defined]
LARGEST_RATIO = 1e9  # of a gear: squares and products with torques stay far from overflow
WORST_COUPLING = 1e6  # condition of the motors' ratios
OF_A_DRIVE = (
    "command",
    "bus_period_s",
    "elasticity",
    "stops",
    "brake",
)  # a joint that mimics another has none of these
OF_A_ROTOR = ("gear_ratio", "rotor_inertia_kg_m2", "source", "basis")  # all that the motor of such a joint may have
OF_DRIVEN = ("load_coefficient", *BY_TEMPERATURE)  # friction that needs a drive's torque or temperature


def check_robot(robot: Any) -> None:
    """Refuses what does not go together.

    Args:
        robot: a RobotDescription.
    Raises:
        Invalid: names the joint, link or frame, the key and what it needs.
    """
    _check_names(robot)
    _check_tree(robot)
    _check_cylinders(robot)
    moving = [joint for joint in robot.joints if joint.type != "fixed"]
    independent = [joint.name for joint in moving if joint.mimic is None]
    for joint in moving:
        try:
            _check_command(robot, joint)
            if joint.mimic is not None:
                _check_mimic(joint, {other.name: other for other in moving})
            _check_effects(robot, joint)
            _check_coupling(joint, independent)
        except Invalid as error:
            raise Invalid.of(error.problem.within(f"joint {joint.name!r}")) from None
    _check_motors_move_joints([joint for joint in moving if joint.mimic is None])
    check_sources(robot)
    _check_fits(robot)


def _check_fits(robot: Any) -> None:
    """Refuses a fit whose numbers or whose source are not in the file."""
    if not robot.fits:
        return
    paths = {path for path, _, _ in quantities(robot)}
    for key, fit in robot.fits.items():
        if fit.source not in robot.sources:
            raise Invalid(
                "no key of [sources]", place=f"fits.{key}.source", value=fit.source, choices=tuple(robot.sources)
            )
        for path in fit.names:
            if path.partition("[")[0] not in paths:
                raise Invalid("no number has this path", place=f"fits.{key}.names", value=path, choices=tuple(paths))


def check_sources(robot: Any) -> None:
    """Refuses numbers of a file that have no source; `robot` is a record with its [sources].

    Raises:
        Invalid: names the number.
    """
    for path, _, source in quantities(robot):
        if source is None:
            raise Invalid(
                "has no source", place=path, expected="source = ... beside it, in its table or for the whole file"
            )
        if source not in robot.sources and source not in KINDS:
            raise Invalid("no key of [sources]", place=f"{path} source", value=source, choices=(*robot.sources, *KINDS))


def _check_names(robot: Any) -> None:
    if not robot.joints:
        raise Invalid(place="joints", expected="at least one joint")
    check_unique("joints", [joint.name for joint in robot.joints])
    if any(joint.name == "t" for joint in robot.joints):
        raise Invalid("the time in schedules", place="joint 't' name", value="t", expected="another name")
    links = [link.name for link in robot.links]
    check_unique("links", links)
    check_unique("frames or links", [*links, *(frame.name for frame in robot.frames), robot.base])
    with_base = [*links, robot.base]
    for joint in robot.joints:
        _check_known(f"joint {joint.name!r} parent", joint.parent, with_base)
        _check_known(f"joint {joint.name!r} child", joint.child, links)
    for frame in robot.frames:
        _check_known(f"frame {frame.name!r} link", frame.link, with_base)
    if robot.tip is not None:
        _check_known("tip", robot.tip, [*with_base, *(frame.name for frame in robot.frames)], "no frame or link")


def check_unique(kind: str, names: list[str]) -> None:
    """Refuses a name that occurs twice; `kind` is the plural of the things."""
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise Invalid(f"two {kind} have this name", place="name", value=twice[0], expected="every name once")


def _check_known(place: str, name: str, known: Iterable[str], what: str = "no link") -> None:
    if name not in known:
        raise Invalid(what, place=place, value=name, choices=known)


def _check_tree(robot: Any) -> None:
    parent = {}
    for joint in robot.joints:
        if joint.child in parent:
            raise Invalid("moved by two joints: closed chains are not offered", place=f"link {joint.child!r}")
        parent[joint.child] = joint.parent
    for link in robot.links:
        if link.name not in parent:
            raise Invalid(
                "hangs on no joint", place=f"link {link.name!r}", expected="every link to be the child of one"
            )
    for link in robot.links:
        seen, at = {link.name}, parent[link.name]
        while at != robot.base:
            if at in seen:
                raise Invalid("carries itself", place=f"link {at!r}", expected=f"a tree that starts at {robot.base!r}")
            seen.add(at)
            at = parent[at]


def _check_cylinders(robot: Any) -> None:
    """Cylinders have names of their own and ends that move with respect to each other."""
    taken = [thing.name for things in (robot.joints, robot.links, robot.frames) for thing in things]
    check_unique("cylinders", [cylinder.name for cylinder in robot.cylinders])
    for cylinder in robot.cylinders:
        place = f"cylinder {cylinder.name!r}"
        if cylinder.name in (*taken, robot.base):
            raise Invalid("a joint, link or frame has this name", place="cylinders name", value=cylinder.name)
        for key in ("link_a", "link_b"):
            _check_known(f"{place} {key}", getattr(cylinder, key), [*(link.name for link in robot.links), robot.base])
        if carrier(robot, cylinder.link_a) == carrier(robot, cylinder.link_b):
            what = f"does not move with respect to {cylinder.link_a!r}"
            raise Invalid(what, place=f"{place} link_b", value=cylinder.link_b, expected="a link that does")


def carrier(robot: Any, link: str) -> str:
    """The link nearest to the base that moves as one body with a link, or the base."""
    fixed = {joint.child: joint.parent for joint in robot.joints if joint.type == "fixed"}
    while link in fixed:
        link = fixed[link]
    return link


def _check_command(robot: Any, joint: Any) -> None:
    """The numbers of the motor that a command needs, and the units of its gear's table."""
    motor, friction = joint.motor, joint.friction
    command = joint.command or robot.command if joint.mimic is None else "torque"
    if command is None:
        raise Invalid("missing", place="command", expected="voltage, current or torque")
    for key in COMMAND_NEEDS.get(command, ()):
        if motor is None or getattr(motor, key) is None:
            raise Invalid(f"needs motor.{key}", place="command", value=command)
    if motor is None and friction is not None and friction.side == "motor":
        raise Invalid("needs a [joints.motor] with its gear_ratio", place="friction.side", value="motor")
    if motor is not None and motor.gear_efficiency_table is not None:
        motor.gear_efficiency_table.check_units("motor.gear_efficiency_table", joint.type == "prismatic")


def _check_mimic(joint: Any, moving: dict[str, Any]) -> None:
    """A joint follows one that moves, not itself, and has no drive: only friction and a rotor that is carried along."""
    others = [name for name in moving if name != joint.name]
    if joint.mimic.joint not in moving:
        raise Invalid("does not move or is not there", place="mimic.joint", value=joint.mimic.joint, choices=others)
    seen, master = {joint.name}, moving[joint.mimic.joint]
    while master.mimic is not None and master.mimic.joint in moving:
        if master.name in seen:
            raise Invalid("the joint follows itself", place="mimic", expected="a chain that ends at a driven joint")
        seen.add(master.name)
        master = moving[master.mimic.joint]
    wrong = [key for key in OF_A_DRIVE if getattr(joint, key) is not None]
    motor, friction = joint.motor, joint.friction
    if motor is not None:
        defaults = {
            key: field.get_default(call_default_factory=True) for key, field in type(motor).model_fields.items()
        }
        drive = (key for key in defaults if key not in OF_A_ROTOR)
        wrong += [f"motor.{key}" for key in drive if getattr(motor, key) != defaults[key]]
    if friction is not None:
        wrong += [f"friction.{key}" for key in OF_DRIVEN if getattr(friction, key) is not None]
        wrong += ["friction.law"] if friction.law == "lugre" else []
    if wrong:
        what = f"the joint mimics {joint.mimic.joint!r} and has no drive"
        raise Invalid(what, place=wrong[0], expected="only friction and a motor's gear_ratio and rotor_inertia_kg_m2")


def _check_effects(robot: Any, joint: Any) -> None:
    """Effects of a drive need what they rest on."""
    motor, friction, command = joint.motor, joint.friction, joint.command or robot.command
    limit = "position_rad" if joint.type == "revolute" else "position_m"
    if joint.stops is not None and getattr(joint.limits, limit) is None:
        raise Invalid(f"needs limits.{limit}, where they stand", place="stops")
    if joint.elasticity is not None and (motor is None or float(motor.rotor_inertia_kg_m2) == 0):
        raise Invalid("needs motor.rotor_inertia_kg_m2 above 0: the mass before the spring", place="elasticity")
    if joint.brake is not None and joint.brake.side == "motor" and motor is None:
        raise Invalid("needs a [joints.motor] with its gear_ratio", place="brake.side", value="motor")
    on_slide = joint.brake is not None and joint.type == "prismatic" and joint.brake.side == "joint"
    if on_slide and hasattr(joint.brake, "holding_torque_n_m"):
        expected = 'side = "motor", or keys in N'
        raise Invalid("in N m on a prismatic joint, it is its motor's", place="brake", expected=expected)
    by_temperature = [key for key in BY_TEMPERATURE if getattr(friction, key, None) is not None]
    if by_temperature and (motor is None or motor.thermal is None):
        raise Invalid("needs motor.thermal, which knows the temperature", place=f"friction.{by_temperature[0]}")
    if motor is None:
        return
    if abs(float(motor.gear_ratio)) > LARGEST_RATIO:
        expected = f"a number of at most {LARGEST_RATIO:g} in size"
        raise Invalid(place="motor.gear_ratio", value=float(motor.gear_ratio), expected=expected)
    if robot.supply is not None and motor.basis != "dc":
        what = "[supply] goes with basis = 'dc': the bus clips DC-equivalent volts"
        raise Invalid(what, place="motor.basis", value=motor.basis)
    if motor.current_loop_hz is not None and command == "voltage":
        expected = 'command = "current" or "torque": a voltage needs no current loop'
        raise Invalid(place="motor.current_loop_hz", expected=expected)
    if motor.pwm == "coast":
        if command != "voltage":
            raise Invalid(place="motor.pwm", value="coast", expected=f'command = "voltage", not {command!r}')
        if robot.supply is None and joint.limits.voltage_v is None:
            what = "needs limits.voltage_v or [supply], the voltage that is switched"
            raise Invalid(what, place="motor.pwm", value="coast")


def _check_coupling(joint: Any, names: list[str]) -> None:
    """Motors are coupled to other joints that move by themselves, each once."""
    others = [] if joint.motor is None else [coupling.joint for coupling in joint.motor.coupling]
    for k, other in enumerate(others):
        place = f"motor.coupling[{k}].joint"
        if other not in names:
            raise Invalid("does not move by itself or is not there", place=place, value=other, choices=names)
        if other == joint.name:
            raise Invalid("the joint itself, whose share is gear_ratio", place=place, value=other)
        if others.count(other) > 1:
            raise Invalid("named twice", place=place, value=other)


def _check_motors_move_joints(joints: list[Any]) -> None:
    """The speeds of coupled motors, N q̇, say those of the joints: N is not singular, nor nearly so."""
    coupled = [joint for joint in joints if joint.motor is not None and joint.motor.coupling]
    if not coupled:
        return
    place = {joint.name: k for k, joint in enumerate(joints)}
    ratios = np.eye(len(joints))
    for joint in coupled:
        row = ratios[place[joint.name]]
        row[place[joint.name]] = float(joint.motor.gear_ratio)
        for each in joint.motor.coupling:
            row[place[each.joint]] = float(each.ratio)
    for axis in (1, 0):  # units and sizes of motors and joints do not count
        ratios /= np.abs(ratios).max(axis=axis, keepdims=True)
    if not np.linalg.cond(ratios) < WORST_COUPLING:
        raise Invalid(
            "these motors cannot turn every joint by itself: their ratios depend on each other",
            place=f"joint {coupled[0].name!r} motor.coupling",
            expected="gear_ratio and coupling that make an invertible matrix",
        )

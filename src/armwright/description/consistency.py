"""Checks of a whole robot: one joint, link or table cannot see what another one needs."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import Any

import numpy as np

from armwright.description.drive import COMMAND_NEEDS
from armwright.description.friction import BY_TEMPERATURE
from armwright.description.paths import quantities, split_path
from armwright.errors import Problem
from armwright.friction_laws import LAWS
from armwright.quantity import SourceKind
from armwright.validation import Invalid

KINDS: tuple[str, ...] = SourceKind.__args__  # type: ignore[attr-defined]
LARGEST_RATIO = 1e9  # of a gear: squares and products with torques stay far from overflow
WORST_COUPLING = 1e6  # condition of the motors' ratios
WHOLE = 1e-9  # how near to a whole number a ratio of periods is one
# none of these has a joint that mimics another
OF_A_DRIVE = ("command", "bus_period_s", "elasticity", "stops", "brake", "firmware")
OF_A_ROTOR = ("gear_ratio", "rotor_inertia_kg_m2", "source", "basis")  # all that the motor of such a joint may have
OF_DRIVEN = ("load_coefficient", *BY_TEMPERATURE)  # friction that needs a drive's torque or temperature


def check_robot(robot: Any) -> None:
    """Refuses what does not go together.

    Args:
        robot: a RobotDescription.
    Raises:
        Invalid: names the joint, link or frame, the key and what it needs, for everything that is wrong.
    """
    _refuse(robot_problems(robot))


def _refuse(problems: Iterable[Problem]) -> None:
    if found := list(problems):
        raise Invalid.of(*found)


def robot_problems(robot: Any, unread: Collection[str] = ()) -> Iterator[Problem]:
    """Contradictions in a robot.

    Args:
        robot: a RobotDescription.   unread: joints of which only the names of their links are known.
    """
    basic = [*_names(robot)] or [*_tree(robot)]
    yield from basic or _cylinders(robot)
    moving = list(robot.moving_joints)
    independent = [joint.name for joint in moving if joint.mimic is None]
    of_joints = [
        problem.within(f"joint {joint.name!r}")
        for joint in moving
        if joint.name not in unread
        for problem in _joint(robot, joint, moving, independent)
    ]
    yield from of_joints
    if not of_joints and not unread:
        yield from _singular_motors([joint for joint in moving if joint.mimic is None])
    yield from source_problems(robot)
    yield from _fits(robot)


def _joint(robot: Any, joint: Any, moving: list[Any], independent: list[str]) -> Iterator[Problem]:
    """Contradictions in a moving joint, with places as seen from the joint."""
    yield from _command(robot, joint)
    if joint.mimic is not None:
        yield from _mimic(joint, {other.name: other for other in moving})
    yield from _effects(robot, joint)
    yield from _coupling(joint, independent)


def _fits(robot: Any) -> Iterator[Problem]:
    """Fits whose numbers or whose source are not in the file."""
    if not robot.fits:
        return
    paths = {path for path, _, _ in quantities(robot)}
    for key, fit in robot.fits.items():
        if fit.source not in robot.sources:
            yield Problem(
                "no key of [sources]", place=f"fits.{key}.source", value=fit.source, choices=tuple(robot.sources)
            )
        for path in fit.names:
            if path.partition("[")[0] not in paths:
                yield Problem("no number has this path", place=f"fits.{key}.names", value=path, choices=tuple(paths))


def check_sources(robot: Any) -> None:
    """Refuses numbers of a file that have no source; `robot` is a record with its [sources].

    Raises:
        Invalid: names the number.
    """
    _refuse(source_problems(robot))


def source_problems(robot: Any) -> Iterator[Problem]:
    """Sources that are missing, once for each joint, link or other table, and names that are not in [sources], once each."""
    known, reported = (*robot.sources, *KINDS), set()
    expected = "source = ... beside it, in its table or for the whole file"
    for path, _, source in quantities(robot):
        subject = split_path(path)[0] if source is None else source
        if source in known or subject in reported:
            continue
        reported.add(subject)
        if source is None:
            yield Problem("has no source", place=path, expected=expected)
        else:
            yield Problem("no key of [sources]", place=f"{path} source", value=source, choices=known)


def _names(robot: Any) -> Iterator[Problem]:
    if not robot.joints:
        yield Problem(place="joints", expected="at least one joint")
    yield from twice("joints", [joint.name for joint in robot.joints])
    if any(joint.name == "t" for joint in robot.joints):
        yield Problem("the time in schedules", place="joint 't' name", value="t", expected="another name")
    links = [link.name for link in robot.links]
    yield from twice("links", links)
    yield from twice("frames or links", [*dict.fromkeys(links), *(frame.name for frame in robot.frames), robot.base])
    with_base = [*links, robot.base]
    for joint in robot.joints:
        yield from _unknown(f"joint {joint.name!r} parent", joint.parent, with_base)
        yield from _unknown(f"joint {joint.name!r} child", joint.child, links)
    for frame in robot.frames:
        yield from _unknown(f"frame {frame.name!r} link", frame.link, with_base)
    if robot.tip is not None:
        yield from _unknown("tip", robot.tip, [*with_base, *(frame.name for frame in robot.frames)], "no frame or link")


def check_unique(kind: str, names: list[str]) -> None:
    """Refuses a name that occurs twice; `kind` is the plural of the things."""
    _refuse(twice(kind, names))


def twice(kind: str, names: list[str]) -> Iterator[Problem]:
    """Names that occur twice; `kind` is the plural of the things."""
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield Problem(f"two {kind} have this name", place="name", value=name, expected="every name once")


def _unknown(place: str, name: str, known: Iterable[str], what: str = "no link") -> Iterator[Problem]:
    if name not in known:
        yield Problem(what, place=place, value=name, choices=tuple(known))


def _tree(robot: Any) -> Iterator[Problem]:
    """Links that are moved by two joints, by none, or carry themselves."""
    parent: dict[str, Any] = {}
    for joint in robot.joints:
        if joint.child in parent:
            yield Problem("moved by two joints: closed chains are not offered", place=f"link {joint.child!r}")
        parent[joint.child] = joint.parent
    for link in robot.links:
        if link.name not in parent:
            yield Problem(
                "hangs on no joint", place=f"link {link.name!r}", expected="every link to be the child of one"
            )
    for link in robot.links:
        seen, at = {link.name}, parent.get(link.name, robot.base)
        while at != robot.base and at not in seen:
            seen.add(at)
            at = parent.get(at, robot.base)
        if at == link.name:
            yield Problem("carries itself", place=f"link {at!r}", expected=f"a tree that starts at {robot.base!r}")
            return


def _cylinders(robot: Any) -> Iterator[Problem]:
    """Cylinders have names of their own and ends that move with respect to each other."""
    taken = [thing.name for things in (robot.joints, robot.links, robot.frames) for thing in things]
    yield from twice("cylinders", [cylinder.name for cylinder in robot.cylinders])
    for cylinder in robot.cylinders:
        place = f"cylinder {cylinder.name!r}"
        if cylinder.name in (*taken, robot.base):
            yield Problem("a joint, link or frame has this name", place="cylinders name", value=cylinder.name)
        for key in ("link_a", "link_b"):
            yield from _unknown(
                f"{place} {key}", getattr(cylinder, key), [*(link.name for link in robot.links), robot.base]
            )
        if carrier(robot.joints, cylinder.link_a) == carrier(robot.joints, cylinder.link_b):
            what = f"does not move with respect to {cylinder.link_a!r}"
            yield Problem(what, place=f"{place} link_b", value=cylinder.link_b, expected="a link that does")


def carrier(joints: Iterable[Any], link: str) -> str:
    """The link nearest to the base that moves as one body with a link, or the base."""
    fixed = {joint.child: joint.parent for joint in joints if not joint.kind.moves}
    while link in fixed:
        link = fixed[link]
    return link


def _command(robot: Any, joint: Any) -> Iterator[Problem]:
    """The numbers of the motor that a command needs, and the units of its gear's table."""
    motor, friction = joint.motor, joint.friction
    command = joint.command or robot.command if joint.mimic is None else "torque"
    if command is None:
        yield Problem("missing", place="command", expected="voltage, current, torque or position")
    for key in COMMAND_NEEDS.get(command or "", ()):
        if motor is None or getattr(motor, key) is None:
            yield Problem(f"needs motor.{key}", place="command", value=command)
    if motor is None and friction is not None and friction.side == "motor":
        yield Problem("needs a [joints.motor] with its gear_ratio", place="friction.side", value="motor")
    if motor is not None and motor.gear_efficiency_table is not None:
        try:
            motor.gear_efficiency_table.check_units("motor.gear_efficiency_table", joint.kind)
        except Invalid as error:
            yield from error.problems


def _mimic(joint: Any, moving: dict[str, Any]) -> Iterator[Problem]:
    """A joint follows one that moves, not itself, and has no drive: only friction and a rotor that is carried along."""
    others = [name for name in moving if name != joint.name]
    if joint.mimic.joint not in moving:
        yield Problem(
            "does not move or is not there", place="mimic.joint", value=joint.mimic.joint, choices=tuple(others)
        )
        return
    seen, master = {joint.name}, moving[joint.mimic.joint]
    while master.mimic is not None and master.mimic.joint in moving:
        if master.name in seen:
            yield Problem("the joint follows itself", place="mimic", expected="a chain that ends at a driven joint")
            return
        seen.add(master.name)
        master = moving[master.mimic.joint]
    wrong = [key for key in OF_A_DRIVE if getattr(joint, key) is not None]
    motor, friction = joint.motor, joint.friction
    if motor is not None:
        defaults = {
            key: field.get_default(call_default_factory=True, validated_data={})
            for key, field in type(motor).model_fields.items()
        }
        drive = (key for key in defaults if key not in OF_A_ROTOR)
        wrong += [f"motor.{key}" for key in drive if getattr(motor, key) != defaults[key]]
    if friction is not None:
        wrong += [f"friction.{key}" for key in OF_DRIVEN if getattr(friction, key) is not None]
        wrong += ["friction.law"] if LAWS[friction.law].bristles or LAWS[friction.law].by_loads else []
    if wrong:
        what = f"the joint mimics {joint.mimic.joint!r} and has no drive"
        yield Problem(what, place=wrong[0], expected="only friction and a motor's gear_ratio and rotor_inertia_kg_m2")


def _effects(robot: Any, joint: Any) -> Iterator[Problem]:
    """Effects of a drive need what they rest on."""
    motor, friction, command = joint.motor, joint.friction, joint.command or robot.command
    yield from _firmware(robot, joint, command)
    if friction is not None and LAWS[friction.law].by_loads and motor is not None:
        for key in ("gear_efficiency", "gear_efficiency_table"):
            if getattr(motor, key) is not None:
                what = f'does not go with friction.law = "{friction.law}", whose level is the loss of the gear'
                yield Problem(what, place=f"motor.{key}", expected="none of it, or another law")
    if joint.stops is not None and joint.limit("position") is None:
        yield Problem(f"needs limits.{joint.limit_key('position')}, where they stand", place="stops")
    if joint.elasticity is not None and (motor is None or float(motor.rotor_inertia_kg_m2) == 0):
        yield Problem("needs motor.rotor_inertia_kg_m2 above 0: the mass before the spring", place="elasticity")
    if joint.brake is not None and joint.brake.side == "motor" and motor is None:
        yield Problem("needs a [joints.motor] with its gear_ratio", place="brake.side", value="motor")
    brake = joint.brake
    if brake is not None and brake.side == "joint" and brake.units is not joint.kind.units:
        expected = 'side = "motor", or keys in N'
        yield Problem(f"in N m on a {joint.type} joint, it is its motor's", place="brake", expected=expected)
    by_temperature = [key for key in BY_TEMPERATURE if getattr(friction, key, None) is not None]
    if by_temperature and (motor is None or motor.thermal is None):
        yield Problem("needs motor.thermal, which knows the temperature", place=f"friction.{by_temperature[0]}")
    if motor is None:
        return
    if abs(float(motor.gear_ratio)) > LARGEST_RATIO:
        expected = f"a number of at most {LARGEST_RATIO:g} in size"
        yield Problem(place="motor.gear_ratio", value=float(motor.gear_ratio), expected=expected)
    if robot.supply is not None and motor.basis != "dc":
        what = "[supply] goes with basis = 'dc': the bus clips DC-equivalent volts"
        yield Problem(what, place="motor.basis", value=motor.basis)
    if motor.current_loop_hz is not None and command == "voltage":
        expected = 'command = "current" or "torque": a voltage needs no current loop'
        yield Problem(place="motor.current_loop_hz", expected=expected)
    if motor.dead_zone_v is not None and command != "voltage":
        yield Problem(place="motor.dead_zone_v", expected=f'command = "voltage", not {command!r}')
    if motor.pwm == "coast":
        if command != "voltage":
            yield Problem(place="motor.pwm", value="coast", expected=f'command = "voltage", not {command!r}')
        if robot.supply is None and joint.limits.voltage_v is None:
            what = "needs limits.voltage_v or [supply], the voltage that is switched"
            yield Problem(what, place="motor.pwm", value="coast")


def _firmware(robot: Any, joint: Any, command: str | None) -> Iterator[Problem]:
    """A command of position and the loop that follows it go together, with what its output rests on."""
    firmware, motor = joint.firmware, joint.motor
    if (command == "position") != (firmware is not None):
        expected = "a [joints.firmware] beside it" if firmware is None else 'command = "position" beside it'
        yield Problem(
            "missing" if firmware is None else f"beside command = {command!r}", place="firmware", expected=expected
        )
    if firmware is None:
        return
    if joint.kind.units.linear or not joint.kind.turns or joint.kind.slides:
        yield Problem(f"on a {joint.type} joint", place="firmware", expected="a revolute joint, whose turns it counts")
    if motor is None:
        return
    others = (each.joint for other in robot.moving_joints if other.motor for each in other.motor.coupling)
    if motor.coupling or joint.name in others:
        yield Problem("beside motors that several joints turn", place="firmware", expected="a motor of the joint's own")
    if firmware.output == "duty":
        if motor.resistance_ohm is None:
            yield Problem("needs motor.resistance_ohm", place="firmware.output", value="duty")
        if robot.supply is None and joint.limits.voltage_v is None:
            what = "needs limits.voltage_v or [supply], the voltage that it is a share of"
            yield Problem(what, place="firmware.output", value="duty")
        if motor.basis != "dc":
            yield Problem("goes with basis = 'dc'", place="motor.basis", value=motor.basis)
    periods = [float(each.firmware.period_s) for each in robot.moving_joints if each.firmware is not None]
    parts = float(firmware.period_s) / min(periods)
    if abs(parts - round(parts)) > WHOLE * parts:
        expected = f"a multiple of {min(periods):g} s, the shortest of this arm"
        yield Problem(place="firmware.period_s", value=float(firmware.period_s), expected=expected)


def _coupling(joint: Any, names: list[str]) -> Iterator[Problem]:
    """Motors are coupled to other joints that move by themselves, each once."""
    others = [] if joint.motor is None else [coupling.joint for coupling in joint.motor.coupling]
    for k, other in enumerate(others):
        place = f"motor.coupling[{k}].joint"
        if other not in names:
            yield Problem("does not move by itself or is not there", place=place, value=other, choices=tuple(names))
        if other == joint.name:
            yield Problem("the joint itself, whose share is gear_ratio", place=place, value=other)
        if others.count(other) > 1:
            yield Problem("named twice", place=place, value=other)


def _singular_motors(joints: list[Any]) -> Iterator[Problem]:
    """The speeds of coupled motors, N q̇, say those of the joints: N is not singular, nor nearly so."""
    coupled = [joint for joint in joints if joint.motor is not None and joint.motor.coupling]
    if not coupled:
        return
    together = {each.joint for joint in coupled for each in joint.motor.coupling} | {joint.name for joint in coupled}
    for joint in joints:
        if joint.name in together and joint.friction is not None and LAWS[joint.friction.law].by_loads:
            expected = "another law: of motors that turn several joints no torque is that of this joint alone"
            yield Problem(place=f"joint {joint.name!r} friction.law", value=joint.friction.law, expected=expected)
    place = {joint.name: k for k, joint in enumerate(joints)}
    ratios = np.eye(len(joints))
    for joint in coupled:
        row = ratios[place[joint.name]]
        row[place[joint.name]] = float(joint.motor.gear_ratio)
        for each in joint.motor.coupling:
            row[place[each.joint]] = float(each.ratio)
    for axis in (1, 0):  # units and sizes of motors and joints do not count
        with np.errstate(invalid="ignore"):  # a motor of zeros is refused below
            ratios /= np.abs(ratios).max(axis=axis, keepdims=True)
    if not np.all(np.isfinite(ratios)) or not np.linalg.cond(ratios) < WORST_COUPLING:
        yield Problem(
            "these motors cannot turn every joint by itself: their ratios depend on each other",
            place=f"joint {coupled[0].name!r} motor.coupling",
            expected="gear_ratio and coupling that make an invertible matrix",
        )

"""RobotDescription: where all readers meet. Plain, frozen, validated data with units in the names and sources."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from armwright.description.drive import (
    COMMAND_NEEDS,
    Command,
    LinearFriction,
    LinearLimits,
    Motor,
    RotaryFriction,
    RotaryLimits,
)
from armwright.description.drive_effects import check_drive_effects
from armwright.description.mimic import LinearMimic, RotaryMimic, check_mimics
from armwright.description.paths import quantities
from armwright.errors import DescriptionError, nearest
from armwright.lazy_schema import imported_later
from armwright.quantity import (
    Direction,
    NotNegative,
    Number,
    Positive,
    Record,
    Source,
    SourceKind,
    Vector3,
)

if TYPE_CHECKING:
    from armwright.description.built_from import BuiltFrom
    from armwright.description.compliance import (
        LinearElasticity,
        LinearStops,
        RotaryBrake,
        RotaryElasticity,
        RotaryStops,
        SlideBrake,
    )
    from armwright.description.supply import Supply
    from armwright.solids.visual import Visual
else:
    LinearElasticity, LinearStops, RotaryBrake, RotaryElasticity, RotaryStops, SlideBrake = imported_later(
        "armwright.description.compliance",
        *("LinearElasticity", "LinearStops", "RotaryBrake", "RotaryElasticity", "RotaryStops", "SlideBrake"),
    )
    (BuiltFrom,) = imported_later("armwright.description.built_from", "BuiltFrom")
    (Visual,) = imported_later("armwright.solids.visual", "Visual")
    (Supply,) = imported_later("armwright.description.supply", "Supply")

Name = Annotated[str, Field(min_length=1, pattern=r"^[^\s.\[\]]+$")]
KINDS: tuple[str, ...] = SourceKind.__args__  # type: ignore[attr-defined]


class RevoluteDH(Record):
    """Denavit-Hartenberg row of a revolute joint: θ = q + offset."""

    source: str | None = None
    alpha_rad: Number = Field(description="Twist about x.")
    r_m: Number = Field(description="Offset along z, which others call d.")
    a_m: Number = Field(description="Length along x.")
    offset_rad: Number = Field(description="θ at q = 0.")


class PrismaticDH(Record):
    """Denavit-Hartenberg row of a prismatic joint: r = q + offset."""

    source: str | None = None
    alpha_rad: Number = Field(description="Twist about x.")
    theta_rad: Number = Field(description="Angle about z.")
    a_m: Number = Field(description="Length along x.")
    offset_m: Number = Field(description="r at q = 0.")


class FixedDH(Record):
    """Denavit-Hartenberg row of a joint that does not move."""

    source: str | None = None
    alpha_rad: Number = Field(description="Twist about x.")
    r_m: Number = Field(description="Offset along z.")
    a_m: Number = Field(description="Length along x.")
    theta_rad: Number = Field(description="Angle about z.")


class JointFrame(Record):
    """Joint frame in the parent link's frame, as URDF has it: fixed-axis angles roll, pitch, yaw."""

    source: str | None = None
    xyz_m: Vector3 = Field(description="Origin.")
    rpy_rad: Vector3 = Field(description="Angles about fixed x, then y, then z.")


class _Joint(Record):
    source: str | None = None
    name: Name = Field(description="What q, schedules and results call it; not t, which is the time.")
    parent: Name = Field(description="The link that carries the joint.")
    child: Name = Field(description="The link that the joint moves.")
    frame: JointFrame | None = Field(default=None, description="Where the joint stands: this, dh or modified_dh.")

    @model_validator(mode="after")
    def _one_placement(self) -> Any:
        ways = [way for way in ("dh", "modified_dh", "frame") if getattr(self, way) is not None]
        if len(ways) != 1:
            raise ValueError(f"expected exactly one of dh, modified_dh, frame, not {' and '.join(ways) or 'none'}")
        axis = getattr(self, "axis", None)
        if axis is not None and ways != ["frame"]:
            raise ValueError("axis goes with frame (the axis of a DH joint is z)")
        if axis is None and ways == ["frame"] and "axis" in type(self).model_fields:
            raise ValueError("expected axis = [x, y, z] beside frame, the joint's direction in it")
        return self


def _friction_kind(value: Any) -> str:
    """Whose friction a slide's record tells: its motor's in N m and radians, or its own in N and metres."""
    if isinstance(value, dict):
        rotary = value.get("side") == "motor" or any(
            "_n_m" in key or key.endswith("per_rad") for key in map(str, value)
        )
        return "RotaryFriction" if rotary else "LinearFriction"
    return type(value).__name__ if isinstance(value, RotaryFriction) else "LinearFriction"


SlideFriction = Annotated[
    Annotated[LinearFriction, Tag("LinearFriction")] | Annotated[RotaryFriction, Tag("RotaryFriction")],
    Discriminator(_friction_kind),
]


class RevoluteJoint(_Joint):
    """A joint that turns about the z axis of its frame (DH), or about `axis` in its frame."""

    type: Literal["revolute"] = Field(description="Kind of joint.")
    dh: RevoluteDH | None = Field(default=None, description="Classic Denavit-Hartenberg row.")
    modified_dh: RevoluteDH | None = Field(default=None, description="Modified (Craig's) row.")
    axis: Direction | None = Field(
        default=None, description="Direction of the joint in its frame; goes with frame only."
    )
    mimic: RotaryMimic | None = Field(default=None, description="Whom it follows; absent: it has an entry in q.")
    command: Command | None = Field(default=None, description="What its drive is told; absent: the robot's.")
    bus_period_s: Positive | None = Field(default=None, description="Time between two commands on the drive's bus.")
    motor: Motor | None = Field(default=None, description="Motor and gear.")
    friction: RotaryFriction | None = Field(default=None, description="Absent: none.")
    limits: RotaryLimits = Field(default=RotaryLimits.model_construct(), description="Absent: none known.")
    elasticity: RotaryElasticity | None = Field(default=None, description="Of the gear; absent: it is rigid.")
    stops: RotaryStops | None = Field(
        default=None, description="End stops; absent: nothing stops the joint at its limits."
    )
    brake: RotaryBrake | None = Field(default=None, description="A holding brake; absent: none.")


class PrismaticJoint(_Joint):
    """A joint that slides along the z axis of its frame (DH), or along `axis` in its frame."""

    type: Literal["prismatic"] = Field(description="Kind of joint.")
    dh: PrismaticDH | None = Field(default=None, description="Classic Denavit-Hartenberg row.")
    modified_dh: PrismaticDH | None = Field(default=None, description="Modified (Craig's) row.")
    axis: Direction | None = Field(
        default=None, description="Direction of the joint in its frame; goes with frame only."
    )
    mimic: LinearMimic | None = Field(default=None, description="Whom it follows; absent: it has an entry in q.")
    command: Command | None = Field(default=None, description="What its drive is told; absent: the robot's.")
    bus_period_s: Positive | None = Field(default=None, description="Time between two commands on the drive's bus.")
    motor: Motor | None = Field(default=None, description="Motor and gear.")
    friction: SlideFriction | None = Field(default=None, description="Absent: none.")
    limits: LinearLimits = Field(default=LinearLimits.model_construct(), description="Absent: none known.")
    elasticity: LinearElasticity | None = Field(default=None, description="Of the gear; absent: it is rigid.")
    stops: LinearStops | None = Field(
        default=None, description="End stops; absent: nothing stops the joint at its limits."
    )
    brake: SlideBrake | None = Field(default=None, description="A holding brake; absent: none.")

    @model_validator(mode="after")
    def _friction_side(self) -> PrismaticJoint:
        if isinstance(self.friction, RotaryFriction) and self.friction.side != "motor":
            raise ValueError(
                'friction of a prismatic joint in N m is its motor\'s: expected side = "motor", or keys in N'
            )
        return self


class FixedJoint(_Joint):
    """A joint that does not move: its child is one body with its parent."""

    type: Literal["fixed"] = Field(description="Kind of joint.")
    dh: FixedDH | None = Field(default=None, description="Classic Denavit-Hartenberg row.")
    modified_dh: FixedDH | None = Field(default=None, description="Modified (Craig's) row.")


Joint = Annotated[RevoluteJoint | PrismaticJoint | FixedJoint, Field(discriminator="type")]
MovingJoint = RevoluteJoint | PrismaticJoint


class Inertia(Record):
    """Tensor of inertia about the link's centre of mass, in link axes."""

    source: str | None = None
    xx: NotNegative = Field(description="∫ (y² + z²) dm, and yy, zz likewise.")
    xy: Number = Field(description="−∫ x y dm, and xz, yz likewise.")
    xz: Number = Field(description="As xy.")
    yy: NotNegative = Field(description="As xx.")
    yz: Number = Field(description="As xy.")
    zz: NotNegative = Field(description="As xx.")

    def matrix(self) -> np.ndarray:
        """(3, 3) [kg m²]."""
        xx, xy, xz, yy, yz, zz = (v.number for v in (self.xx, self.xy, self.xz, self.yy, self.yz, self.zz))
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class Link(Record):
    """A body. Its frame is that of the joint that moves it: after the motion (frame, modified DH), or the DH frame."""

    source: str | None = None
    name: Name = Field(description="What joints and errors call it.")
    mass_kg: NotNegative = Field(description="0 is allowed where it is written.")
    com_m: Vector3 = Field(description="Centre of mass in the link's frame.")
    inertia_kg_m2: Inertia = Field(description="About the centre of mass, in link axes.")
    accept_impossible: str | None = Field(
        default=None, min_length=1, description="Why an impossible inertia is accepted."
    )
    visuals: tuple[Visual, ...] = Field(default=(), description="What it looks like; the dynamics do not read it.")


class NamedFrame(Record):
    """A frame of interest, such as the tool: fixed in a link."""

    source: str | None = None
    name: Name = Field(description="What tip and errors call it.")
    link: Name = Field(description="The link (or the base) that carries it.")
    xyz_m: Vector3 = Field(description="Origin in the link's frame.")
    rpy_rad: Vector3 = Field(description="Angles about the link's fixed x, then y, then z.")


class RobotDescription(Record):
    """A robot arm on paper: joints and links in a tree, drives, limits, frames; each number with its source."""

    name: Name = Field(description="What the arm is called.")
    title: str | None = Field(default=None, description="One line for the catalogue.")
    notes: str | None = Field(default=None, description="What a user should know, in a few sentences.")
    source: str | None = Field(default=None, description="Source of every number below that names none of its own.")
    sources: dict[str, Source] = Field(default_factory=dict, description="[sources.KEY]: where numbers come from.")
    gravity_m_s2: Vector3 | None = Field(default=None, description="In base axes; absent: standard gravity along -z.")
    base: Name = Field(default="base", description="What the joints' parents call the base.")
    command: Command | None = Field(default=None, description="What drives the joints that do not say it themselves.")
    supply: Supply | None = Field(
        default=None, description="What feeds all drives of the simulator; absent: one that never sags."
    )
    tip: Name | None = Field(
        default=None,
        description="The frame or link that kinematics and wrench are about; absent: the last link of a chain.",
    )
    built_from: BuiltFrom | None = Field(default=None, description="Where the links were computed from.")
    remarks: tuple[str, ...] = Field(
        default=(), description="What was left out or doubtful where it was read from another format; told on load."
    )
    joints: tuple[Joint, ...] = Field(
        description="One table a joint, in the order of q, in which those that mimic others have no entry."
    )
    links: tuple[Link, ...] = Field(description="One table a link.")
    frames: tuple[NamedFrame, ...] = Field(default=(), description="One table a named frame.")

    @model_validator(mode="after")
    def _consistent(self) -> RobotDescription:
        _check_names(self)
        _check_tree(self)
        _check_commands(self)
        check_mimics(self)
        check_drive_effects(self)
        check_sources(self)
        return self

    def link(self, name: str) -> Link:
        """The link of that name."""
        for link in self.links:
            if link.name == name:
                return link
        raise DescriptionError(f"{self.name}: no link {name!r}; {nearest(name, [link.name for link in self.links])}")

    @property
    def total_mass(self) -> float:
        """Mass of all links, those that stand still included [kg]."""
        return sum(float(link.mass_kg) for link in self.links)

    def provenance(self, path: str) -> Source:
        """Where a number comes from: `provenance("link3.mass_kg")`.

        Raises:
            DescriptionError: there is no number at that path.
        """
        known = {where: source for where, _, source in quantities(self)}
        if path not in known:
            raise DescriptionError(f"{self.name}: no number at {path!r}; {nearest(str(path), known)}")
        return self.source_of(known[path] or "")

    def source_of(self, key: str) -> Source:
        """The source that a `source = "..."` names: a key of [sources], or a kind of source by itself."""
        if key in self.sources:
            return self.sources[key]
        return Source(kind=key, text=key)  # type: ignore[arg-type]


def _unique(what: str, names: list[str]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"two {what} are called {twice[0]!r}: expected every name once")


def _check_names(robot: RobotDescription) -> None:
    if not robot.joints:
        raise ValueError("expected at least one joint")
    _unique("joints", [joint.name for joint in robot.joints])
    if any(joint.name == "t" for joint in robot.joints):
        raise ValueError("a joint is called 't': expected another name, t is the time in schedules")
    links = [link.name for link in robot.links]
    _unique("links", links)
    _unique("frames or links", [*links, *(frame.name for frame in robot.frames), robot.base])
    for joint in robot.joints:
        for side in ("parent", "child"):
            name = getattr(joint, side)
            if name not in links and not (side == "parent" and name == robot.base):
                known = [*links, robot.base] if side == "parent" else links
                raise ValueError(f"joint {joint.name!r}: {side} = {name!r} is no link; {nearest(name, known)}")
    known = [*links, robot.base]
    for frame in robot.frames:
        if frame.link not in known:
            raise ValueError(f"frame {frame.name!r}: link = {frame.link!r} is no link; {nearest(frame.link, known)}")
    ends = [*known, *(frame.name for frame in robot.frames)]
    if robot.tip is not None and robot.tip not in ends:
        raise ValueError(f"tip = {robot.tip!r} is no frame; {nearest(robot.tip, ends)}")


def _check_tree(robot: RobotDescription) -> None:
    parent = {}
    for joint in robot.joints:
        if joint.child in parent:
            raise ValueError(f"link {joint.child!r} is moved by two joints: closed chains are not offered")
        parent[joint.child] = joint.parent
    for link in robot.links:
        if link.name not in parent:
            raise ValueError(f"link {link.name!r} hangs on no joint: expected every link to be the child of one")
    for link in robot.links:
        seen, at = {link.name}, parent[link.name]
        while at != robot.base:
            if at in seen:
                raise ValueError(f"link {at!r} carries itself: expected a tree that starts at {robot.base!r}")
            seen.add(at)
            at = parent[at]


def _check_commands(robot: RobotDescription) -> None:
    for joint in robot.joints:
        if isinstance(joint, FixedJoint):
            continue
        command = joint.command or robot.command if joint.mimic is None else "torque"
        if command is None:
            raise ValueError(f"joint {joint.name!r} has no command: expected voltage, current or torque")
        for key in COMMAND_NEEDS[command]:
            if joint.motor is None or getattr(joint.motor, key) is None:
                raise ValueError(f"joint {joint.name!r}: command = {command!r} needs motor.{key}")
        on_motor_side = joint.friction is not None and joint.friction.side == "motor"
        if on_motor_side and joint.motor is None:
            raise ValueError(
                f"joint {joint.name!r}: friction on the motor side needs a [joints.motor] with its gear_ratio"
            )
        if (
            joint.motor is not None
            and joint.motor.gear_efficiency is not None
            and float(joint.motor.gear_efficiency) < 1
        ):
            linear = isinstance(joint, PrismaticJoint) and not isinstance(joint.friction, RotaryFriction)
            key = "smoothing_m_per_s" if linear else "smoothing_rad_per_s"
            if getattr(joint.friction, key, None) is None:
                raise ValueError(
                    f"joint {joint.name!r}: motor.gear_efficiency needs friction.{key}, the speed its loss is smoothed over"
                )


def check_sources(robot: Any) -> None:
    """Refuses numbers of a file that have no source; `robot` is a record with its [sources].

    Raises:
        ValueError: names the number.
    """
    for path, _, source in quantities(robot):
        if source is None:
            raise ValueError(
                f"{path} has no source: expected source = ... beside it, in its table or for the whole file"
            )
        if source not in robot.sources and source not in KINDS:
            raise ValueError(
                f"{path}: source = {source!r} is no key of [sources]; {nearest(source, [*robot.sources, *KINDS])}"
            )

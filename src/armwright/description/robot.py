"""RobotDescription: where all readers meet. Plain, frozen, validated data with units in the names and sources."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Union

import numpy as np
from pydantic import Discriminator, Field, PrivateAttr, Tag, create_model, model_validator

from armwright.description.consistency import check_robot
from armwright.description.drive import Command, LinearFriction, LinearLimits, Motor, RotaryFriction, RotaryLimits
from armwright.description.paths import quantities
from armwright.description.twins import twin_of
from armwright.errors import DescriptionError, check_known
from armwright.joint_kinds import KINDS, LINEAR, ROTARY, JointKind, JointUnits, moving_kinds
from armwright.lazy_schema import imported_later
from armwright.quantity import (
    Direction,
    NotNegative,
    NotZero,
    Number,
    Positive,
    Quantity,
    Record,
    Source,
    Vector3,
    optional,
)
from armwright.spatial import TENSOR
from armwright.validation import NAME, NAMEABLE, Invalid

if TYPE_CHECKING:
    from armwright.description.built_from import BuiltFrom
    from armwright.description.defaults import Defaults
    from armwright.description.drive_effects import SupplyRecord
    from armwright.description.firmware import FirmwareRecord
    from armwright.description.fits import FitRecord
    from armwright.description.springs import CylinderRecord
    from armwright.solids.visual import Visual
else:
    (SupplyRecord,) = imported_later("armwright.description.drive_effects", "SupplyRecord")
    (FirmwareRecord,) = imported_later("armwright.description.firmware", "FirmwareRecord")
    (Defaults,) = imported_later("armwright.description.defaults", "Defaults")
    (BuiltFrom,) = imported_later("armwright.description.built_from", "BuiltFrom")
    (FitRecord,) = imported_later("armwright.description.fits", "FitRecord")
    (CylinderRecord,) = imported_later("armwright.description.springs", "CylinderRecord")
    (Visual,) = imported_later("armwright.solids.visual", "Visual")

Name = Annotated[str, Field(min_length=1, pattern=NAME)]
FileName = Annotated[str, Field(min_length=1, pattern=NAMEABLE)]  # of joints, links and frames, as their file has it
MASTER = "The joint that it follows; that may follow another in turn."
LimitName = Literal["position", "velocity", "acceleration", "torque"]
MULTIPLIER = "How far it moves by the master's 1 rad or m, in its own unit."


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
    xyz_m: Vector3 = Field(description="Position of the joint's origin in the parent link's frame: x, y, z.")
    rpy_rad: Vector3 = Field(description="Angles about fixed x, then y, then z.")


class _Mimic(Record):
    units: ClassVar[JointUnits]

    @property
    def offset(self) -> Any:
        """[rad | m]."""
        return getattr(self, self.units.key("offset", "position")).number


class RotaryMimic(_Mimic):
    """A revolute joint without a drive of its own:  q = multiplier · q_master + offset; torques go to the master, by power."""

    units = ROTARY
    source: str | None = None
    joint: str = Field(min_length=1, description=MASTER)
    multiplier: NotZero = Field(description=MULTIPLIER)
    offset_rad: Number = Field(description="Where it stands while its master is at 0.")


@twin_of(RotaryMimic)
class LinearMimic(_Mimic):
    """`RotaryMimic` of a prismatic joint."""

    units = LINEAR
    source: str | None = None


class _Joint(Record):
    source: str | None = None
    name: FileName = Field(description="What q, schedules and results call it; not t, which is the time.")
    parent: FileName = Field(description="The link that carries the joint.")
    child: FileName = Field(description="The link that the joint moves.")
    frame: JointFrame | None = optional("Where the joint stands: this, dh or modified_dh.")
    type: Any = Field(description="Kind of joint.")
    dh: Any = optional("Classic Denavit-Hartenberg row.")
    modified_dh: Any = optional("Modified (Craig's) row.")

    @property
    def kind(self) -> JointKind:
        """The motion that it allows, and its units."""
        return KINDS[self.type].of(self)

    @model_validator(mode="after")
    def _one_placement(self) -> Any:
        ways = [way for way in ("dh", "modified_dh", "frame") if getattr(self, way) is not None]
        if len(ways) != 1:
            raise Invalid(expected=f"exactly one of dh, modified_dh, frame, not {' and '.join(ways) or 'none'}")
        axis = getattr(self, "axis", None)
        if axis is not None and ways != ["frame"]:
            raise Invalid("goes with frame (the axis of a DH joint is z)", place="axis", value=axis.value)
        if axis is None and ways == ["frame"] and "axis" in type(self).model_fields:
            raise Invalid("missing", place="axis", expected="[x, y, z] beside frame, the joint's direction in it")
        return self


def friction_kind(value: Any) -> str:
    """The type of a slide's friction: its motor's in N m and radians, or its own in N and metres."""
    if isinstance(value, dict):
        rotary = value.get("side") == "motor" or any(
            "_n_m" in key or key.endswith("per_rad") for key in map(str, value)
        )
        return "RotaryFriction" if rotary else "LinearFriction"
    return type(value).__name__ if isinstance(value, RotaryFriction) else "LinearFriction"


SlideFriction = Annotated[
    Annotated[LinearFriction, Tag("LinearFriction")] | Annotated[RotaryFriction, Tag("RotaryFriction")],
    Discriminator(friction_kind),
]


class MovingJoint(_Joint):
    """Keys of all joints that move. Every kind has a record of its own, `JOINTS`, with parts in its units."""

    axis: Direction | None = optional("Direction of the joint in its frame; goes with frame only.")
    mimic: Any = optional("Whom it follows; absent: it has an entry in q.")
    command: Command | None = optional("Kind of command that its drive takes; absent: the robot's.")
    bus_period_s: Positive | None = optional("Time between two commands on the drive's bus.")
    motor: Motor | None = optional("Motor and gear.")
    friction: Any = optional("Absent: none.")
    limits: Any = optional("Absent: none known.")
    elasticity: Any = optional("Of the gear; absent: it is rigid.")
    stops: Any = optional("End stops; absent: nothing stops the joint at its limits.")
    brake: Any = optional("A holding brake; absent: none.")
    firmware: FirmwareRecord | None = optional('The loop of a servo, for command = "position".')
    spring: Any = optional("A spring at the joint; absent: none.")

    @model_validator(mode="after")
    def _friction_side(self) -> Any:
        if self.kind.units.linear and isinstance(self.friction, RotaryFriction) and self.friction.side != "motor":
            expected = 'side = "motor", or keys in N'
            raise Invalid(f"in N m on a {self.type} joint, it is its motor's", place="friction", expected=expected)
        return self

    def limit_key(self, quantity: LimitName) -> str:
        """Key of one of its limits, with its unit: `joint.limit_key("velocity")` → "velocity_rad_per_s"."""
        return self.kind.units.key(quantity, "speed" if quantity == "velocity" else quantity)

    def limit(self, quantity: LimitName) -> Quantity | None:
        """One of its limits; None where it is not known."""
        return getattr(self.limits, self.limit_key(quantity))


class FixedJoint(_Joint):
    """A joint that does not move: its child is one body with its parent."""

    type: Literal["fixed"] = Field(description="Kind of joint.")
    dh: FixedDH | None = optional("Classic Denavit-Hartenberg row.")
    modified_dh: FixedDH | None = optional("Modified (Craig's) row.")


PARTS: dict[str, tuple[Any, Any]] = {  # of a joint whose coordinate is an angle, and of one where it is a length
    "mimic": (RotaryMimic, LinearMimic),
    "friction": (RotaryFriction, SlideFriction),
    "limits": (RotaryLimits, LinearLimits),
    "elasticity": imported_later("armwright.description.drive_effects", "RotaryElasticity", "LinearElasticity"),
    "stops": imported_later("armwright.description.drive_effects", "RotaryStops", "LinearStops"),
    "brake": imported_later("armwright.description.drive_effects", "RotaryBrake", "SlideBrake"),
    "spring": imported_later("armwright.description.springs", "RotarySpringRecord", "LinearSpringRecord"),
}


def _joint_record(kind: type[JointKind]) -> type[MovingJoint]:
    """The record of a kind: the keys of all joints, with parts in its units, and its own numbers."""
    row = RevoluteDH if kind.turns else PrismaticDH
    parts = {key: pair[kind.units.linear] for key, pair in PARTS.items()}
    fields: dict[str, Any] = {"type": (Literal[kind.name], Field(description="Kind of joint."))}
    fields |= {key: (NotZero, Field(description=about)) for key, about in kind.numbers.items()}
    for key, part in {"dh": row, "modified_dh": row, **parts}.items():
        field = copy(MovingJoint.model_fields[key])
        if key == "limits":
            field.default = part.model_construct()
        fields[key] = (part if key == "limits" else part | None, field)
    name = f"{kind.name.capitalize()}Joint"
    return create_model(name, __base__=MovingJoint, __module__=__name__, __doc__=kind.about, **fields)


JOINTS = {name: _joint_record(kind) for name, kind in moving_kinds().items()}
globals().update({record.__name__: record for record in JOINTS.values()})  # pickles look them up by name
if TYPE_CHECKING:
    Joint = MovingJoint | FixedJoint
else:
    Joint = Annotated[Union[(*JOINTS.values(), FixedJoint)], Field(discriminator="type")]


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
    name: FileName = Field(description="What joints and errors call it.")
    mass_kg: NotNegative = Field(description="0 is allowed where it is written.")
    com_m: Vector3 = Field(description="Centre of mass in the link's frame.")
    inertia_kg_m2: Inertia = Field(description="About the centre of mass, in link axes.")
    accept_impossible: str | None = Field(
        default=None, min_length=1, description="Why an impossible inertia is accepted."
    )
    visuals: tuple[Visual, ...] = Field(default=(), description="What it looks like; the dynamics do not read it.")


MASSLESS: Any = {"mass_kg": 0.0, "com_m": (0.0, 0.0, 0.0), "inertia_kg_m2": dict.fromkeys(TENSOR, 0.0)}  # of a link


class NamedFrame(Record):
    """A frame of interest, such as the tool: fixed in a link."""

    source: str | None = None
    name: FileName = Field(description="What tip and errors call it.")
    link: FileName = Field(description="The link (or the base) that carries it.")
    xyz_m: Vector3 = Field(description="Position of the frame's origin in the link's frame: x, y, z.")
    rpy_rad: Vector3 = Field(description="Angles about the link's fixed x, then y, then z.")


class RobotDescription(Record):
    """A robot arm on paper: joints and links in a tree, drives, limits, frames; each number with its source."""

    name: FileName = Field(description="What the arm is called.")
    title: str | None = optional("One line for the catalogue.")
    notes: str | None = optional("What a user should know, in a few sentences.")
    source: str | None = optional("Source of every number below that names none of its own.")
    sources: dict[str, Source] = Field(default_factory=dict, description="[sources.KEY]: where numbers come from.")
    gravity_m_s2: Vector3 | None = optional("In base axes; absent: standard gravity along -z.")
    base: FileName = Field(default="base", description="What the joints' parents call the base.")
    command: Command | None = optional("What drives the joints that do not say it themselves.")
    supply: SupplyRecord | None = optional("What feeds all drives of the simulator; absent: one that never sags.")
    tip: FileName | None = optional(
        "The frame or link that kinematics and wrench are about; absent: the last link of a chain."
    )
    defaults: Defaults | None = optional("What all joints have that do not say otherwise; absent once a file is read.")
    built_from: BuiltFrom | None = optional("Where the links were computed from.")
    fits: dict[str, FitRecord] = Field(
        default_factory=dict, description="[fits.KEY]: the fits that numbers of the kind fit came from."
    )
    remarks: tuple[str, ...] = Field(
        default=(), description="What was left out or doubtful when read from another format; reported on loading."
    )
    without_masses: tuple[FileName, ...] = Field(
        default=(), description="Links whose mass properties are not known and stand as 0: dynamics are refused."
    )
    joints: tuple[Joint, ...] = Field(
        description="One table a joint, in the order of q, in which those that mimic others have no entry."
    )
    links: tuple[Link, ...] = Field(description="One table a link.")
    frames: tuple[NamedFrame, ...] = Field(default=(), description="One table a named frame.")
    cylinders: tuple[CylinderRecord, ...] = Field(default=(), description="Gas springs and counterbalance cylinders.")
    _gear_ratios: Mapping[str, float] = PrivateAttr(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _with_defaults(cls, data: Any) -> Any:
        if isinstance(data, Mapping) and data.get("defaults") is not None:
            from armwright.description.defaults import with_defaults

            return with_defaults(data, "")
        return data

    @model_validator(mode="after")
    def _consistent(self) -> RobotDescription:
        check_robot(self)
        return self

    @property
    def moving_joints(self) -> tuple[MovingJoint, ...]:
        """The joints that move, in the file's order."""
        return tuple(joint for joint in self.joints if isinstance(joint, MovingJoint))

    @property
    def gear_ratios(self) -> Mapping[str, float]:
        """Gear ratios, by joint, that a URDF states of joints without a motor."""
        return self._gear_ratios

    def with_gear_ratios(self, ratios: Mapping[str, float]) -> RobotDescription:
        """The same with gear ratios of joints without a motor."""
        robot = self.model_copy()
        robot._gear_ratios = dict(ratios)
        return robot

    @property
    def end_of_chain(self) -> str | None:
        """The last link of a chain; None of a tree."""
        parents = {joint.parent for joint in self.joints}
        ends = [link.name for link in self.links if link.name not in parents]
        return ends[0] if len(ends) == 1 else None

    def link(self, name: str) -> Link:
        """The link of that name."""
        for link in self.links:
            if link.name == name:
                return link
        names = [link.name for link in self.links]
        raise DescriptionError("no link", place="link", value=name, choices=names, file=self.name)

    @property
    def total_mass(self) -> float:
        """Mass of all links, those that stand still included [kg]."""
        return sum(float(link.mass_kg) for link in self.links)

    def provenance(self, path: str) -> Source:
        """Source of a number: `provenance("link3.mass_kg")`.

        Raises:
            DescriptionError: there is no number at that path.
        """
        known = {where: source for where, _, source in quantities(self)}
        check_known(DescriptionError, path, known, "no number has this path", place="path", file=self.name)
        return self.source_of(known[path] or "")

    def source_of(self, key: str) -> Source:
        """The source that a `source = "..."` names: a key of [sources], or a kind of source by itself."""
        if key in self.sources:
            return self.sources[key]
        return Source(kind=key, text=key)  # type: ignore[arg-type]

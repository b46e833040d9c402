"""Module library, `*.modules.toml`. A module is a unit of an arm: bodies, joints with drives, connectors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Union

import numpy as np
from pydantic import Field, create_model, model_validator

from armwright.description.consistency import check_sources, check_unique
from armwright.description.drive import Command
from armwright.description.robot import JOINTS as MOVING_JOINTS, FixedJoint, Inertia, JointFrame, MovingJoint, Name
from armwright.errors import DescriptionError, Problem, check_known
from armwright.lint.feasibility import impossible
from armwright.quantity import NotNegative, Record, Source, Vector3, optional
from armwright.solids.visual import Visual, placement_of
from armwright.spatial import Placement, rotation_x
from armwright.validation import Invalid

Gender = Literal["m", "f", "n"]
HALF_TURN = 3.141592653589793  # [rad]


class ModuleBody(Record):
    """A rigid body of a module, in a frame of its own."""

    source: str | None = None
    name: Name = Field(description="Name in joints and connectors of the module.")
    mass_kg: NotNegative = Field(description="0 is allowed where it is written.")
    com_m: Vector3 = Field(description="Centre of mass in the body's frame.")
    inertia_kg_m2: Inertia = Field(description="About the point that inertia_about names, in the body's axes.")
    inertia_about: Literal["com", "frame"] = Field(
        description="The point that the tensor is about: the centre of mass, or the origin of the body's frame."
    )
    accept_impossible: str | None = Field(
        default=None, min_length=1, description="Why an impossible inertia is accepted."
    )
    visuals: tuple[Visual, ...] = Field(default=(), description="Solids in the body's frame, for pictures.")

    @model_validator(mode="before")
    @classmethod
    def _point_is_stated(cls, data: Any) -> Any:
        if isinstance(data, dict) and "inertia_about" not in data:
            what = "missing; there is no default, since reading one for the other counts m c² twice or not at all"
            expected = '"com" or "frame", the point that the tensor is about'
            raise Invalid(what, place=" inertia_about", expected=expected)
        return data


class _ModuleJoint(Record):
    child_frame: JointFrame | None = optional(
        "The child's own frame in the joint's, which has moved; absent: the same."
    )

    @model_validator(mode="after")
    def _stands_in_its_parent(self) -> Any:
        if getattr(self, "frame", None) is None:
            raise Invalid("a module's joint stands in its parent body", expected="frame, not dh or modified_dh")
        if getattr(self, "mimic", None) is not None:
            raise Invalid("a module's joint moves by itself", expected="no mimic")
        return self


class ModuleFixed(_ModuleJoint, FixedJoint):
    """Two bodies of a module that are one."""


def _joint_record(name: str, record: type[MovingJoint]) -> Any:
    about = f"A joint of a module. {record.__doc__}"
    return create_model(
        f"Module{name.capitalize()}", __base__=(_ModuleJoint, record), __module__=__name__, __doc__=about
    )


JOINTS = {name: _joint_record(name, record) for name, record in MOVING_JOINTS.items()}
globals().update({record.__name__: record for record in JOINTS.values()})  # pickles look them up by name
if TYPE_CHECKING:
    ModuleJoint = Any
else:
    ModuleJoint = Annotated[Union[(*JOINTS.values(), ModuleFixed)], Field(discriminator="type")]


class Connector(Record):
    """A face where modules meet. Its frame's z axis points out of the module; the faces' z axes oppose each other.

    At the angle 0 the x axes of both faces agree, at another the module that is put on is turned about the z axis of
    the face that carries it.
    """

    source: str | None = None
    name: Name = Field(description="Name in assemblies and errors.")
    body: Name = Field(description="The body of the module that it is a part of.")
    kind: str = Field(min_length=1, description="Only connectors of one kind fit.")
    size: str = Field(min_length=1, description="Only connectors of one size fit.")
    gender: Gender = Field(description="m fits f, n fits n.")
    frame: JointFrame = Field(description="Its pose in the body.")
    flipped: bool = Field(
        default=False, description="The frame is given with z into the module: it is turned by π about its x axis."
    )
    angle_steps: int = Field(
        ge=1, le=360, description="Number of equal steps a turn at which it can be put on; 1: one way only."
    )

    def placement(self) -> Placement:
        """Placement of the face in its body, z out of the module."""
        placed = placement_of(self.frame)
        return placed @ Placement(rotation_x(HALF_TURN), 0.0 * placed.position) if self.flipped else placed


class Module(Record):
    """A unit of an arm: bodies in a tree, the joints between them, and connectors."""

    source: str | None = optional("Source of every number of the module that names none.")
    name: Name = Field(description="Name in assemblies.")
    title: str | None = optional("One line for lists.")
    ground: Name | None = optional("The connector that stands on the ground, of a module that an arm begins with.")
    available: int | None = Field(default=None, ge=1, description="Number of them; absent: any.")
    bodies: tuple[ModuleBody, ...] = Field(min_length=1, description="One table a body.")
    joints: tuple[ModuleJoint, ...] = Field(default=(), description="One table a joint.")
    connectors: tuple[Connector, ...] = Field(min_length=1, description="One table a connector.")

    @model_validator(mode="after")
    def _consistent(self) -> Module:
        bodies, connectors = ([item.name for item in items] for items in (self.bodies, self.connectors))
        check_unique("bodies", bodies)
        check_unique("joints", [joint.name for joint in self.joints])
        check_unique("connectors", connectors)
        for connector in self.connectors:
            check_known(Invalid, connector.body, bodies, place=f" connector {connector.name!r} body")
        if self.ground is not None and self.ground not in connectors:
            raise Invalid("no connector", place=" ground", value=self.ground, choices=connectors)
        if len(bodies) > 1 and set(bodies) & set(connectors):
            both = min(set(bodies) & set(connectors))
            raise Invalid(f"a body and a connector are both called {both!r}", expected="different names")
        _check_tree(self.joints, bodies)
        return self

    def connector(self, name: str) -> Connector:
        """The connector of that name.

        Raises:
            DescriptionError: there is none.
        """
        known = {connector.name: connector for connector in self.connectors}
        if name not in known:
            place = f"connector of module {self.name!r}"
            raise DescriptionError("no such connector", place=place, value=name, choices=known)
        return known[name]

    @property
    def root(self) -> str:
        """The body that no joint of the module moves."""
        children = {joint.child for joint in self.joints}
        return next(body.name for body in self.bodies if body.name not in children)

    @property
    def mass(self) -> float:
        """Sum of the bodies' masses [kg]."""
        return sum(float(body.mass_kg) for body in self.bodies)

    @property
    def moving_joints(self) -> int:
        """Number of joints that are not fixed."""
        return sum(joint.kind.moves for joint in self.joints)

    def impossible_body(self) -> Problem | None:
        """The first body that no real one can be and that is not accepted with a reason; None where all can be."""
        for body in self.bodies:
            about, tensor = body.inertia_about, body.inertia_kg_m2.matrix()
            fault = impossible(float(body.mass_kg), np.array(body.com_m), tensor, about)
            if fault is not None and body.accept_impossible is None:
                place = f"module {self.name!r} body {body.name!r}"
                expected = 'a real body, or accept_impossible = "reason" in it'
                return Problem(f"impossible: {fault}", place, expected=expected)
        return None

    def crossings(self, start: str) -> Iterator[Crossing]:
        """The joints from a body outward, the near ones first, each with the bodies and frames on its two sides."""
        reached = [start]
        for near in reached:  # grows meanwhile
            for joint in self.joints:
                far = joint.child if joint.parent == near else joint.parent
                if near not in (joint.parent, joint.child) or far in reached:
                    continue
                forward = joint.parent == near
                before, after = placement_of(joint.frame), placement_of(joint.child_frame)
                if not forward:  # T⁻¹ = after⁻¹ R(axis, -q) before⁻¹
                    before, after = after.inverse(), before.inverse()
                reached.append(far)
                yield Crossing(joint, near, far, forward, before, after)


class Crossing(NamedTuple):
    """A joint of a module on the way outward from one of its bodies."""

    joint: Any
    near: str  # the body on this side
    far: str
    forward: bool  # from the joint's parent to its child
    before: Placement  # of the joint in the near body
    after: Placement  # of the far body in the joint, which has moved


class ModuleLibrary(Record):
    """Modules that fit each other, each number with its source."""

    name: Name = Field(description="Name of the library.")
    title: str | None = optional("One line for lists.")
    notes: str | None = optional("Notes for users, in a few sentences.")
    source: str | None = optional("Source of every number below that names none of its own.")
    sources: dict[str, Source] = Field(default_factory=dict, description="[sources.KEY]: sources of numbers.")
    command: Command | None = optional("Command of the joints that name none.")
    modules: tuple[Module, ...] = Field(min_length=1, description="One table a module.")

    @model_validator(mode="after")
    def _consistent(self) -> ModuleLibrary:
        check_unique("modules", [module.name for module in self.modules])
        check_sources(self)
        return self

    def module(self, name: str) -> Module:
        """The module of that name.

        Raises:
            DescriptionError: there is none.
        """
        known = {module.name: module for module in self.modules}
        check_known(DescriptionError, name, known, "no such module", place=f"module of {self.name}")
        return known[name]


def _check_tree(joints: tuple[Any, ...], bodies: list[str]) -> None:
    """Bodies hang together in one tree: each but one is the child of one joint, and none carries itself."""
    parent: dict[str, str] = {}
    for joint in joints:
        for side in ("parent", "child"):
            name = getattr(joint, side)
            check_known(Invalid, name, bodies, "no body", place=f" joint {joint.name!r} {side}")
        if joint.child in parent:
            raise Invalid(f"body {joint.child!r} is moved by two joints: closed chains are not supported")
        parent[joint.child] = joint.parent
    roots = [name for name in bodies if name not in parent]
    if len(roots) > 1:
        raise Invalid(f"bodies {roots[0]!r} and {roots[1]!r} both hang on no joint", expected="one root")
    for name in bodies:
        seen: set[str] = set()
        while name in parent:
            if name in seen:
                raise Invalid(f"body {name!r} carries itself: closed chains are not supported")
            seen.add(name)
            name = parent[name]

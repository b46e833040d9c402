"""The frozen numeric tree: bodies with their joints, named frames, gravity."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Self

from armwright import scalar
from armwright.errors import ModelError, check_known
from armwright.friction_laws import linear_parameters
from armwright.joint_kinds import JointKind
from armwright.model.drive import Brake, Drive, DriveLimits, Elasticity, Friction, Stops, Supply
from armwright.model.mimics import Mimics
from armwright.model.springs import Spring, SpringCylinder
from armwright.scalar import Array, Scalar
from armwright.spatial import TENSOR, Frozen, Placement, displaced_inertia, parallel_axes, rotated

BASE = -1  # the parent of bodies that stand on the base


@dataclass(frozen=True, eq=False)
class Body(Frozen):
    """A moving joint and the body it carries.

    The body's frame has the joint's axis as its z axis, whatever the file's convention; at q = 0 it stands in the
    parent body's frame at `placement`, turned about z by `offset`. `link_frame` is where the link's own frame (DH or
    URDF) stands in it.
    """

    joint: str
    link: str
    kind: JointKind
    parent: int  # index of a body, or BASE
    placement: Placement
    link_frame: Placement
    mass: Scalar  # m [kg], fixed links and their masses merged
    first_moment: Array  # m c (3,) [kg m], c the centre of mass in the body's frame
    inertia: Array  # (3, 3) [kg m²], about the body's origin, in the body's axes
    drive: Drive
    friction: Friction | None = None
    limits: DriveLimits = field(default_factory=DriveLimits)
    elasticity: Elasticity | None = None
    stops: Stops | None = None
    brake: Brake | None = None
    offset: Scalar = 0.0  # [rad], what the angle of a joint that turns is beyond q
    spring: Spring | None = None

    @property
    def sampled_range(self) -> tuple[float, float]:
        """Lowest and highest position [rad | m] of samples: the limits, or where they are more than a turn one about 0.

        The turn is as near to 0 as the limits allow. What slides has no turns: its limits count as they are.
        """
        low, high = self.limits.position
        turn, known = 2.0 * math.pi, math.isfinite(low) and math.isfinite(high)
        if known and (self.kind.slides or high - low <= turn):
            return low, high
        low = min(max(-math.pi, low), high - turn)
        return low, low + turn

    @property
    def com(self) -> Array:
        """Centre of mass (3,) [m] in the body's frame; the origin where the body has no mass."""
        return (
            self.first_moment / self.mass if scalar.is_symbolic(self.mass) or self.mass > 0 else 0.0 * self.first_moment
        )

    @property
    def inertia_com(self) -> Array:
        """Tensor of inertia about the centre of mass (3, 3) [kg m²], in the body's axes."""
        return self.inertia - parallel_axes(self.mass, self.com)

    @property
    def inertial_parameters(self) -> Array:
        """[m, m c_x, m c_y, m c_z, Ixx, Ixy, Ixz, Iyy, Iyz, Izz]  (10,), about the link frame's origin, in its axes."""
        back, p = self.link_frame.rotation.T, self.link_frame.position
        first = rotated(back, self.first_moment - self.mass * p)
        tensor = back @ (self.inertia + displaced_inertia(self.mass, self.first_moment, -p)) @ back.T
        return scalar.array([self.mass, *first, *(tensor[place] for place in TENSOR.values())])

    def with_inertial_parameters(self, parameters: Array) -> Body:
        """The body with other `inertial_parameters` (10,), numbers or symbols."""
        tensor = scalar.zeros(3, 3)
        for (i, j), entry in zip(TENSOR.values(), parameters[4:], strict=True):
            tensor[i, j] = tensor[j, i] = entry
        m, rotation, p = parameters[0], self.link_frame.rotation, self.link_frame.position
        h = rotation @ parameters[1:4]
        return dataclasses.replace(
            self, mass=m, first_moment=h + m * p, inertia=rotation @ tensor @ rotation.T + displaced_inertia(m, h, p)
        )


@dataclass(frozen=True, eq=False)
class Frame:
    """A named frame: its pose in the body that carries it (BASE: in the base)."""

    body: int
    placement: Placement


@dataclass(frozen=True, eq=False)
class Tree(Frozen):
    """A robot arm as numbers: bodies in an order in which parents come before children, gravity, named frames, tip.

    Every joint that moves has its body in `bodies`. Those that follow others stand in `mimics` and have no entry in q.
    """

    name: str
    bodies: tuple[Body, ...]
    gravity: Array  # (3,) acceleration in base axes [m/s²], pointing down
    frames: Mapping[str, Frame] = field(default_factory=dict)
    tip: str | None = None
    supply: Supply | None = None
    mimics: Mimics | None = None  # None: every joint moves by itself
    cylinders: tuple[SpringCylinder, ...] = ()  # between bodies
    without_masses: tuple[str, ...] = ()  # links whose mass properties are not known, and stand as 0

    @property
    def n(self) -> int:
        """Number of coordinates q: moving joints that follow no other."""
        return len(self.coordinates)

    @property
    def coordinates(self) -> tuple[Body, ...]:
        """The joints of q, each with its body and drive, in the order of q."""
        return self.bodies if self.mimics is None else tuple(self.bodies[i] for i in self.mimics.drivers)

    @property
    def is_sprung(self) -> bool:
        """True if springs act on the arm."""
        return bool(self.cylinders) or any(body.spring is not None for body in self.bodies)

    @property
    def tree(self) -> Self:
        """The arm with every joint moving by itself, q having all of them: what the recursions are written for."""
        return self if self.mimics is None else dataclasses.replace(self, mimics=None)

    @property
    def names(self) -> list[str]:
        """Names of the joints in the order of q."""
        return [body.joint for body in self.coordinates]

    @property
    def inertial_parameters(self) -> Array:
        """Mass properties of all moving links (10 N,), fixed links merged: what `regressor` multiplies.

        For each, in the order of `bodies`, [m, m c_x, m c_y, m c_z, Ixx, Ixy, Ixz, Iyy, Iyz, Izz]  [kg, kg m, kg m²];
        the tensor is about the origin of the link's frame, in its axes.
        """
        return scalar.array([p for body in self.bodies for p in body.inertial_parameters])

    @property
    def drive_parameters(self) -> Array:
        """Rotors and friction of all joints (7 N,): what `regressor_drive` multiplies; 0 where the record has none.

        For each joint of `bodies` [n² J_m, viscous, offset, Coulomb where q̇ > 0, Coulomb where q̇ < 0, Stribeck, sigmoid
        amplitude], joint side, in [kg m² | kg, N m s/rad | N s/m, then N m | N].
        """
        rows = []
        for body in self.bodies:
            f = Friction() if body.friction is None else body.friction
            rows += [body.drive.armature, f.viscous, f.offset, f.coulomb_positive, f.coulomb_negative]
            rows += [0.0 if f.stribeck is None else f.stribeck]
            rows += [f.parameters[k] if f.law == law else 0.0 for law, k in linear_parameters()]
        return scalar.array(rows)

    def __repr__(self) -> str:
        return f"<arm {self.name}: {self.n} joints {', '.join(self.names)}>"

    def outward(self) -> Iterator[tuple[int, Body]]:
        """Bodies from the base to the tips: parents before children."""
        return iter(enumerate(self.bodies))

    def inward(self) -> Iterator[tuple[int, Body]]:
        """Bodies from the tips to the base: children before parents."""
        return reversed(list(enumerate(self.bodies)))

    def path(self, body: int) -> list[int]:
        """Bodies from the base to that one, itself included."""
        steps = []
        while body != BASE:
            steps.append(body)
            body = self.bodies[body].parent
        return steps[::-1]

    def frame(self, name: str | None = None) -> Frame:
        """A named frame; without a name the tip.

        Raises:
            ModelError: there is no such frame, or no tip was named on an arm that branches.
        """
        if name is None:
            if self.tip is None:
                raise ModelError(
                    "the arm names no tip", place="tip", expected=f"replace(tip=…), one of {', '.join(self.frames)}"
                )
            name = self.tip
        check_known(ModelError, name, self.frames, f"{self.name} has no such frame", place="frame")
        return self.frames[name]

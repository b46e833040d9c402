"""Model: the frozen numeric tree that the algorithms read. Variants are made with `replace`, never by mutation."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from armwright import scalar
from armwright.description.friction import LINEAR, LawName
from armwright.description.robot import RobotDescription, Source
from armwright.errors import ModelError, nearest
from armwright.model.mimics import Mimics
from armwright.scalar import Array, Scalar
from armwright.spatial import Frozen, Placement, displaced_inertia, parallel_axes, rotated

TENSOR = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))  # entries of a symmetric tensor, in the regressor's order
BASE = -1  # the parent of bodies that stand on the base

if TYPE_CHECKING:
    from armwright.model.vary import Parameters


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction of a joint against its speed, all numbers referred to the joint side; equations in `actuators.friction`."""

    viscous: Scalar = 0.0  # [N m s/rad | N s/m]
    coulomb_positive: Scalar = 0.0  # [N m | N], magnitude where q̇ > 0
    coulomb_negative: Scalar = 0.0  # [N m | N], magnitude where q̇ < 0
    offset: Scalar = 0.0  # [N m | N]
    stribeck: Scalar | None = None  # [N m | N], level at standstill; None: Coulomb only
    stribeck_speed: Scalar = 1.0  # [rad/s | m/s]
    smoothing: Scalar | None = None  # [rad/s | m/s]; None where nothing is smoothed
    law: LawName = "coulomb"
    parameters: tuple[Scalar, ...] = ()  # the law's own, in the order of `description.friction.LAWS`
    on_motor: bool = False  # whose speed it acts on, where the gear gives way or the motor turns several joints
    load_coefficient: Scalar | None = None  # what Coulomb's levels gain of the torque through the gear [-]
    viscous_fall: Scalar | None = None  # warming over which viscous falls to 1/e [K]


@dataclass(frozen=True, eq=False)
class Thermal:
    """Temperatures of a motor; one body where there is no housing. Equations in `actuators.thermal`."""

    ambient: Scalar  # [°C]
    reference: Scalar  # [°C] at which the constants were measured
    winding: tuple[Scalar, Scalar]  # heat capacity [J/K], resistance to housing or ambient [K/W]
    housing: tuple[Scalar, Scalar] | None = None  # heat capacity [J/K], resistance to the ambient [K/W]
    resistance_temperature_coefficient: Scalar | None = None  # relative change of R [1/K]
    magnet_temperature_coefficient: Scalar | None = None  # of Kt and Ke, at most 0 [1/K]


@dataclass(frozen=True, eq=False)
class Cogging:
    """Torque of the magnets on the slots, motor side. Equation in `actuators.cogging`."""

    amplitude: Scalar  # [N m]
    periods: Scalar  # of a turn of the motor
    phase: Scalar  # [rad]


@dataclass(frozen=True, eq=False)
class Elasticity:
    """A gear that gives way, joint side. Equations in `actuators.elasticity`."""

    stiffness: Scalar  # [N m/rad | N/m]
    damping: Scalar  # [N m s/rad | N s/m]
    cubic: Scalar | None = None  # [N m/rad³ | N/m³]
    backlash: Scalar | None = None  # width of the gap [rad | m]
    error: tuple[Scalar, Scalar] | None = None  # amplitude [rad | m] and phase [rad] at twice a turn of the motor


@dataclass(frozen=True, eq=False)
class Stops:
    """End stops at the joint's position limits. Equation in `actuators.stops`."""

    stiffness: Scalar  # [N m/rad | N/m]
    damping: Scalar  # [N m s/rad | N s/m]


@dataclass(frozen=True, eq=False)
class Brake:
    """A holding brake, joint side. Equations in `actuators.brake`."""

    holding: Scalar  # [N m | N]
    stiffness: Scalar  # [N m/rad | N/m]
    damping: Scalar  # [N m s/rad | N s/m]
    release_time: Scalar  # [s]
    on_motor: bool  # whose speed it acts on


@dataclass(frozen=True, eq=False)
class Supply:
    """What feeds all drives. Equations in `actuators.supply`."""

    voltage: Scalar  # [V] without load
    resistance: Scalar  # of the source [Ω]
    capacitance: Scalar  # of the bus [F]
    chopper: tuple[Scalar, Scalar, Scalar] | None = None  # from [V], over [V], resistor [Ω]


@dataclass(frozen=True, eq=False)
class Drive:
    """Motor and gear of a joint. θ_motor = gear_ratio q; constants are DC-equivalent; None where the record is silent."""

    command: Literal["voltage", "current", "torque"]
    gear_ratio: Scalar = 1.0  # n [motor rad / rad | rad/m], signed
    rotor_inertia: Scalar = 0.0  # J_m [kg m²], motor side
    efficiency: Scalar | None = None  # η [-]; None: 1, no loss
    smoothing: Scalar | None = None  # speed over which the gear's loss is smoothed [rad/s | m/s]
    torque_constant: Scalar | None = None  # Kt [N m/A]
    back_emf_constant: Scalar | None = None  # Ke [V s/rad]
    resistance: Scalar | None = None  # R [Ω]
    inductance: Scalar | None = None  # L [H]
    current_loop: Scalar | None = None  # bandwidth of the current controller [Hz]
    coasts: bool = False  # the bridge opens while it is off, in place of shorting the motor
    thermal: Thermal | None = None
    cogging: Cogging | None = None
    coupling: tuple[tuple[str, Scalar], ...] = ()  # other joints that turn the motor [motor rad / rad | rad/m]

    @property
    def armature(self) -> Scalar:
        """n² J_m: the rotor's inertia referred to the joint [kg m² | kg].

        Raises:
            ModelError: a motor that other joints turn as well, whose inertia is no number of one joint.
        """
        if self.coupling:
            raise ModelError(
                f"a motor that {self.coupling[0][0]!r} turns as well has its inertia between joints: "
                "only the simulator (Plant) knows coupled motors"
            )
        return self.reflected

    @property
    def reflected(self) -> Scalar:
        """n² J_m of the motor's own gear ratio, whatever else turns it [kg m² | kg]."""
        return self.gear_ratio * self.gear_ratio * self.rotor_inertia


@dataclass(frozen=True, eq=False)
class Limits:
    """What a joint and its drive can do; infinite where no limit is known."""

    position: tuple[float, float] = (-np.inf, np.inf)  # [rad | m]
    velocity: float = np.inf  # [rad/s | m/s]
    acceleration: float = np.inf  # [rad/s² | m/s²], of planned motions
    torque: float = np.inf  # motor torque referred to the joint [N m | N]
    voltage: float = np.inf  # [V]
    current: float = np.inf  # [A]


@dataclass(frozen=True, eq=False)
class Body(Frozen):
    """A moving joint and the body it carries.

    The body's frame has the joint's axis as its z axis, whatever the file's convention; at q = 0 it stands in the
    parent body's frame at `placement`, turned about z by `offset`. `link_frame` is where the link's own frame (DH or
    URDF) stands in it.
    """

    joint: str
    link: str
    kind: Literal["revolute", "prismatic"]
    parent: int  # index of a body, or BASE
    placement: Placement
    link_frame: Placement
    mass: Scalar  # m [kg], fixed links and their masses merged
    first_moment: Array  # m c (3,) [kg m], c the centre of mass in the body's frame
    inertia: Array  # (3, 3) [kg m²], about the body's origin, in the body's axes
    drive: Drive
    friction: Friction | None = None
    limits: Limits = Limits()
    elasticity: Elasticity | None = None
    stops: Stops | None = None
    brake: Brake | None = None
    offset: Scalar = 0.0  # [rad], what a revolute joint's angle is beyond q

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
        return scalar.array([self.mass, *first, *(tensor[i, j] for i, j in TENSOR)])

    def with_inertial_parameters(self, parameters: Array) -> Body:
        """The body with other `inertial_parameters` (10,), numbers or symbols."""
        tensor = scalar.zeros(3, 3)
        for (i, j), entry in zip(TENSOR, parameters[4:], strict=True):
            tensor[i, j] = tensor[j, i] = entry
        m, rotation, p = parameters[0], self.link_frame.rotation, self.link_frame.position
        h = rotation @ parameters[1:4]
        return dataclasses.replace(
            self,
            mass=m,
            first_moment=h + m * p,
            inertia=rotation @ tensor @ rotation.T + displaced_inertia(m, h, p),
        )


@dataclass(frozen=True, eq=False)
class Frame:
    """A named frame: where it stands in the body that carries it (BASE: in the base)."""

    body: int
    placement: Placement


@dataclass(frozen=True, eq=False)
class Model(Frozen):
    """A robot arm as numbers: bodies in an order in which parents come before children, gravity, named frames, tip.

    Every joint that moves has its body in `bodies`. Those that follow others are told by `mimics` and have no entry in q.
    `changes` are those that `replace` made to what the description says.
    """

    name: str
    bodies: tuple[Body, ...]
    gravity: Array  # (3,) acceleration in base axes [m/s²], pointing down
    frames: Mapping[str, Frame] = field(default_factory=dict)
    tip: str | None = None
    description: RobotDescription | None = field(default=None, repr=False)
    warnings: tuple[str, ...] = ()
    changes: Mapping[str, Any] = field(default_factory=dict, repr=False)
    supply: Supply | None = None
    mimics: Mimics | None = None  # None: every joint moves by itself

    @property
    def n(self) -> int:
        """Number of coordinates q: moving joints that follow no other."""
        return len(self.coordinates)

    @property
    def coordinates(self) -> tuple[Body, ...]:
        """The joints of q, each with its body and drive, in the order of q."""
        return self.bodies if self.mimics is None else tuple(self.bodies[i] for i in self.mimics.drivers)

    @property
    def tree(self) -> Model:
        """The arm with every joint moving by itself, q having all of them: what the recursions are written for."""
        return self if self.mimics is None else dataclasses.replace(self, mimics=None)

    @property
    def names(self) -> list[str]:
        """Names of the joints in the order of q."""
        return [body.joint for body in self.coordinates]

    @property
    def parameters(self) -> Parameters:
        """Every number of the record as a table: name, value, unit, standard deviation, bounds, source, scale.

        Raises:
            ModelError: a model that was not made from a description.
        """
        from armwright.model.variants.of_arm import told
        from armwright.model.vary import parameters_of

        return parameters_of(told(self))

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
            rows += [f.parameters[k] if f.law == law else 0.0 for law, k in LINEAR]
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
                raise ModelError(f"{self.name}: the arm names no tip; replace(tip=...) can be {', '.join(self.frames)}")
            name = self.tip
        if not isinstance(name, str) or name not in self.frames:
            raise ModelError(f"{self.name}: no frame {name!r}; {nearest(str(name), self.frames)}")
        return self.frames[name]

    def provenance(self, path: str) -> Source:
        """Where a number of the record comes from: `arm.provenance("link3.mass_kg")`."""
        if self.description is None:
            raise ModelError(f"{self.name}: this model was not made from a description, its numbers have no sources")
        return self.description.provenance(path)

    def replace(self, **changes: Any) -> Model:
        """A variant of the arm; the arm itself stays as it is.

        Args:
            friction: None takes all joint friction away.   rotors: None takes the rotors' inertia away.
            efficiency: None makes the gears lossless.   gravity: (3,) [m/s²].   tip: name of a frame.   name: str.
        Raises:
            ModelError: an unknown change, or a value that is none.
        """
        from armwright.model.changes import changed

        return changed(self, changes)

    def with_payload(self, mass: Any, com: Any, inertia: Any, frame: str | None = None, **told: Any) -> Model:
        """The arm with a body in its hand: a link "payload" fixed to a frame. What `replace` changed stays changed.

        Args:
            mass: () [kg].   com: (3,) [m] centre of mass, in the frame.
            inertia: (3, 3) [kg m²] about the centre of mass, in the frame's axes, or three principal moments.
            frame: name of a frame; by default the tip.   told: name of the link, source of its numbers.
        Raises:
            DescriptionError: a body that cannot be, a name that is taken, no such frame.   ModelError: no description.
        """
        from armwright.model.variants import with_payload

        return self._variant(with_payload, mass, com, inertia, self.tip if frame is None else frame, **told)

    def with_locked(self, positions: Mapping[str, Any]) -> Model:
        """The arm with joints held, `{"joint3": 0.4}` [rad | m]: q has the others only, the dynamics are the same.

        Raises:
            DescriptionError: no such joint, a position that is none, or no joint left.   ModelError: no description.
        """
        from armwright.model.variants import with_locked

        return self._variant(with_locked, positions)

    def with_values(self, values: Mapping[str, Any], source: str = "definition") -> Model:
        """The arm with other numbers in its record, `{"link6.mass_kg": 2.0, "link6.com_m[2]": 0.1}`, checked like a file's.

        Raises:
            DescriptionError: no such number, or a value that cannot stand there.   ModelError: no description.
        """
        from armwright.model.variants import with_values

        return self._variant(with_values, values, source)

    def subchain(self, base: str, tip: str) -> Model:
        """The part of the arm from one frame or link to another, its new base and tip. What is fixed to it stays, what moves
        beside it is left out, with a warning. Gravity is turned into the new base's axes, joints before the base at 0.

        Raises:
            DescriptionError: no such frame, or nothing moves between the two.   ModelError: no description.
        """
        from armwright.model.variants.of_arm import subchain_of

        return subchain_of(self, base, tip)

    def _variant(self, transform: Any, *arguments: Any, **named: Any) -> Model:
        from armwright.model.variants.of_arm import told, variant

        return variant(self, transform(told(self), *arguments, **named))

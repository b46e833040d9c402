"""Derivative of a plant's state: every joint's drive by itself, then the arm that they move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armwright import scalar
from armwright.actuators.coupling import Shares, shares_of, to_motors
from armwright.actuators.friction import friction_torques
from armwright.actuators.supply import Bus, bus, drive_voltage
from armwright.actuators.winding import is_ideal
from armwright.dynamics import mass_matrix
from armwright.dynamics.forward import accelerations
from armwright.dynamics.gears import Gear, lossy_gears, without_rotors
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.scalar import Array, Scalar
from armwright.signals import Layout
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.joint_drive import (
    DrivenJoint,
    JointMotion,
    JointStates,
    SwitchingFunction,
    driven_joint,
    standing,
)
from armwright.simulation.plant.state import contacts_of
from armwright.simulation.plant.sticking import Sticking, sticking_places

STIFF = ("current", "bristle", "brake", "bus_voltage")  # linear in themselves, and integrated exactly


@dataclass(frozen=True, eq=False)
class Flow:
    """All that happens in one state."""

    qdd: Array  # (n,) [rad/s² | m/s²]
    holding: (
        Array | None
    )  # (n,) torques by which what sticks holds the joints [N m | N]; None of an arm that never sticks
    joints: list[DrivenJoint]
    change: dict[str, list[Scalar]]  # d/dt of each signal of the state
    rates: list[Scalar]  # [1/s] of the stiff entries, in the order of x
    fed: Bus | None  # what happens on the bus, where the arm has one


@dataclass(frozen=True, eq=False)
class Loads:
    """Torques of the drives on the links, as `forward.accelerations` takes them."""

    joints: list[DrivenJoint]
    links: Model  # without the rotors of `gears`
    driven: Array  # (n,) [N m | N]
    resisting: Array  # (n,) [N m | N]
    gears: list[Gear]  # with loss, behind rotors


@dataclass(frozen=True, eq=False)
class PlantFlow:
    """The equations of an arm with its drives.

    Attributes:
        model: the arm.   layout: of the state x.   brakes: whether the brakes take part.
    """

    model: Model
    layout: Layout
    brakes: bool = False

    @property
    def size(self) -> int:
        """Entries of x."""
        return self.layout.size

    @cached_property
    def stiff(self) -> tuple[int, ...]:
        """Places in x of the states that are integrated exactly."""
        places = [self.layout.place(name) for name in self.layout.names if name in STIFF]
        return tuple(k for place in places for k in range(place.start, place.stop))

    def part(self, x: Array, name: str) -> Array:
        """Entries of x (…, size) by the name of their part.

        Raises:
            ScenarioError: the plant has no such part.
        """
        if name not in self.layout:
            raise ScenarioError("no such state", value=name, choices=self.layout.names, file=self.model.name)
        return x[..., self.layout.place(name)]

    def settled(self, x: Array) -> Array:
        """State (size,) with a bus of at least 0 V, which a rule may pass within a step: the diodes hold it there."""
        if self.model.supply is None:
            return x
        place, settled = self.layout.place("bus_voltage").start, list(x)
        settled[place] = scalar.maximum(settled[place], 0.0)
        return scalar.array(settled)

    @cached_property
    def contacts(self) -> tuple[int, ...]:
        """Number of contacts that each joint can make: two of its stops, two of a gear with play."""
        return tuple(contacts_of(body) for body in self.model.coordinates)

    @cached_property
    def braked(self) -> tuple[int, ...]:
        """Joints whose brakes take part, in the order of `brake`."""
        return tuple(i for i, body in enumerate(self.model.coordinates) if self.brakes and body.brake is not None)

    def _flow(self, x: Array, inputs: PlantInputs) -> Flow:
        """Every joint's drive, then the arm they move, then what all that makes of the state."""
        n, holding = self.model.n, None
        q, qd = x[:n], x[n : 2 * n]
        if self.sticking is not None and inputs.directions is None:
            inputs = replace(inputs, directions=self.sticking.present(x, inputs))
        loads = self.loads(x, inputs)
        if self.sticking is None:
            qdd = accelerations(loads.links, q, qd, loads.driven, loads.resisting, inputs.wrench, loads.gears)
        else:
            qdd, holding = self.sticking.accelerations(x, inputs, loads.joints)
        joints = self._with_gear_loss(loads.joints, to_motors(self.shares, qd), to_motors(self.shares, qdd))
        change, rates, fed = self._of_drives(x, joints)
        return Flow(qdd, holding, joints, {"q": list(qd), "qd": list(qdd), **change}, rates, fed)

    def loads(self, x: Array, inputs: PlantInputs) -> Loads:
        """Torques of the drives on the links in a state."""
        directions = None
        if self.sticking is not None and inputs.directions is not None:
            directions = self.sticking.of_joints(inputs.directions)
        joints = self.driven(x, inputs, directions)
        losses = [joint.gear_loss for joint in joints]
        links, driven, gears = lossy_gears(self.rigid, scalar.array([joint.gear for joint in joints]), losses)
        resisting = scalar.array([joint.resisting for joint in joints])
        if self.model.mimics is not None:
            resisting = resisting + friction_torques(self._followers, x[self.model.n : 2 * self.model.n])
        return Loads(joints, links, driven, resisting, gears)

    def drive_rates(self, x: Array, inputs: PlantInputs) -> np.ndarray:
        """Derivatives of the state's entries behind q and q̇, without the arm's dynamics."""
        change, _, _ = self._of_drives(x, self.loads(x, inputs).joints)
        return scalar.array([value for name in self.layout.names[2:] for value in change[name]])

    def _with_gear_loss(self, joints: list[DrivenJoint], w: Array, wd: Array) -> list[DrivenJoint]:
        """The joints with the loss (t - G(t)) w of rigid gears and where they bend; w, ẇ of the motors (n,)."""
        done = []
        for i, (body, joint) in enumerate(zip(self.model.coordinates, joints, strict=True)):
            if joint.gear_loss is not None:
                t = joint.gear - body.drive.reflected * wd[i]
                bends = [SwitchingFunction(w[i], standing(body.drive.smoothing))]
                bends += [SwitchingFunction(t - knot) for knot in joint.gear_loss.knots]
                loss = joint.loss + (t - joint.gear_loss.output(t)) * w[i]
                joint = replace(joint, loss=loss, switching=[*joint.switching, *bends])
            done.append(joint)
        return done

    @cached_property
    def sticking(self) -> Sticking | None:
        """The arm's set-valued laws; None where all are smooth."""
        places = sticking_places(self.model, self.brakes)
        return Sticking(self, places) if places else None

    def driven(
        self, x: Array, inputs: PlantInputs, directions: Sequence[tuple[Scalar, Scalar]] | None = None
    ) -> list[DrivenJoint]:
        """Every joint's drive by itself; directions of joints and motors that stick are by default the signs of their speeds."""
        u, touching, brake = inputs.command, inputs.contacts, inputs.brake
        ends = np.cumsum(self.contacts)
        of = [None if touching is None else touching[end - k : end] for end, k in zip(ends, self.contacts, strict=True)]
        supply = self.model.supply
        volts = None if supply is None else drive_voltage(supply, self.part(x, "bus_voltage")[0])
        applied = dict.fromkeys(self.braked, 0.0) if brake is None else dict(zip(self.braked, brake, strict=True))
        return [
            driven_joint(
                body,
                self._states(x, i),
                at,
                u[i],
                volts,
                applied.get(i),
                of[i],
                None if directions is None else directions[i],
            )
            for (i, body), at in zip(enumerate(self.model.coordinates), self.motions(x), strict=True)
        ]

    def _of_drives(
        self, x: Array, joints: list[DrivenJoint]
    ) -> tuple[dict[str, list[Scalar]], list[Scalar], Bus | None]:
        """Derivatives of the parts of the state behind q and q̇, λ of the stiff ones, and the state of the bus."""
        change: dict[str, list[Scalar]] = {}
        rates: list[Scalar] = []
        fed = None
        for part in self.layout.signals[2:]:
            joints_of = part.joints or ()
            if part.name == "bus_voltage":
                assert self.model.supply is not None
                drawn = [joint.power for joint in joints]
                unlimited = [
                    power for power, body in zip(drawn, self.model.coordinates, strict=True) if is_ideal(body.drive)
                ]
                fed = bus(self.model.supply, self.part(x, "bus_voltage")[0], sum(drawn), sum(unlimited))
                change[part.name], rates = [fed.speed], [*rates, fed.rate]
            elif part.name == "motor_q":
                change[part.name] = list(self.part(x, "motor_qd"))
            elif part.name == "motor_qd":
                change[part.name] = [joints[i].acceleration for i in joints_of]
            else:
                change[part.name] = [joints[i].change[part.name] for i in joints_of]
                rates += [joints[i].rates[part.name] for i in joints_of if part.name in STIFF]
        return change, rates, fed

    def inertia(self, q: Array) -> np.ndarray:
        """The mass matrix of links and of the rotors of rigid gears.

        Args:
            q: (n,) [rad | m].
        Returns:
            M: (n, n) [kg m² | kg m | kg].
        """
        return mass_matrix(self.rigid, q)

    @cached_property
    def shares(self) -> Shares:
        """Other joints that turn each motor."""
        return shares_of(self.model)

    def _motors(self, x: Array) -> tuple[Array, Array]:
        """Positions and speeds of all motors, θ_motor / n."""
        n = self.model.n
        q, qd = to_motors(self.shares, x[:n]), to_motors(self.shares, x[n : 2 * n])
        if "motor_q" not in self.layout:
            return q, qd
        q, qd = list(q), list(qd)
        for name, values in (("motor_q", q), ("motor_qd", qd)):
            for i, value in zip(self.layout[name].joints or (), self.part(x, name), strict=True):
                values[i] = value / self.model.coordinates[i].drive.gear_ratio
        return scalar.array(q), scalar.array(qd)

    def motions(self, x: Array) -> list[JointMotion]:
        """Positions and speeds of every joint and its motor."""
        n = self.model.n
        q, qd = x[:n], x[n : 2 * n]
        columns = (q, qd, *self._motors(x), to_motors(self.shares, q), to_motors(self.shares, qd))
        return [JointMotion(*row) for row in zip(*columns, strict=True)]

    def _states(self, x: Array, joint: int) -> JointStates:
        """The state of one joint's drive."""
        entries = {
            part.name: self.part(x, part.name)[part.joints.index(joint)]
            for part in self.layout.signals[2:]
            if part.joints is not None and joint in part.joints and not part.name.startswith("motor")
        }
        return JointStates(**entries)

    @cached_property
    def rigid(self) -> Model:
        """The arm without the rotors of motors behind elastic gears, which move by themselves."""
        elastic = {body.joint for body in self.model.coordinates if body.elasticity is not None}
        return without_rotors(self.model, elastic) if elastic else self.model

    @cached_property
    def _followers(self) -> Model:
        """The arm with friction in those joints only that follow others."""
        names = set(self.model.names)
        bodies = (replace(body, friction=None) if body.joint in names else body for body in self.model.bodies)
        return replace(self.model, bodies=tuple(bodies))

"""The plant: an arm with its drives as one system of first order,  dx/dt = f(x, u),  whatever each joint's drive has.

x holds q and q̇, then only what the arm's record asks for: positions and speeds of motors behind elastic gears, winding
currents, bristles, temperatures, the bus. What is absent has neither state nor operations. With B the motors' speeds by
the joints' (B = 1 but for coupled motors, θ_motor / n = B q) and a rigid gear,

    ( M_links + Bᵀ n² J_m B ) q̈ = Bᵀ ( e tau_m - f_m ) - C q̇ - g - f + Jᵀ wrench,   tau_m = n Kt i + n cogging;

an elastic one has its motor's own  n² J_m θ̈ = e tau_m - f_m - ∂δ/∂θ · spring  and gives Bᵀ spring to the links. [Spong1987]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from armwright import scalar
from armwright.actuators import DriveOutput, friction_torques, limited_drive, told_command
from armwright.actuators.coupling import Shares, reflected_inertia, shares_of, to_joints, to_motors
from armwright.actuators.supply import Bus, bus
from armwright.dynamics import bias_torques, energy, forward_dynamics, mass_matrix
from armwright.errors import ModelError, ScenarioError
from armwright.kinematics import jacobian
from armwright.model import Body, Model
from armwright.scalar import Array, Scalar
from armwright.simulation.integrators import Integrator
from armwright.simulation.joint_drive import DrivenJoint, JointMotion, JointStates, at_rest, driven_joint, stored
from armwright.simulation.plant_program import PlantProgram
from armwright.simulation.plant_state import StatePart, has_extra, parts_of

STIFF = ("current", "bristle", "brake", "bus_voltage")  # linear in themselves, and integrated exactly


@dataclass(frozen=True, eq=False)
class Flow:
    """All that happens in one state."""

    qdd: Array  # (n,) [rad/s² | m/s²]
    joints: list[DrivenJoint]
    change: dict[str, list[Scalar]]  # d/dt of each part of the state
    rates: list[Scalar]  # [1/s] of the stiff entries, in the order of x
    fed: Bus | None  # what happens on the bus, where the arm has one


@dataclass(frozen=True, eq=False)
class Plant:
    """An arm with its drives, as its record describes them.

    Attributes:
        model: the arm.   parts: of the state x, in order.   brakes: whether `brake` is an input of derivative and step.
    """

    model: Model
    parts: tuple[StatePart, ...]
    brakes: bool = False

    @classmethod
    def of(cls, model: Model, *, brakes: bool = False) -> Plant:
        """The plant of an arm.

        Args:
            model: the arm; numbers may be symbols.
            brakes: whether the holding brakes of its record take part; else they stay released and cost nothing.
        Raises:
            ModelError: a motor behind an elastic gear that has lost its inertia, by `arm.replace(rotors=None)`.
        """
        for body in model.coordinates:
            if body.elasticity is not None and _is_zero(body.drive.rotor_inertia):
                raise ModelError(
                    f"{model.name}: the motor of joint {body.joint!r} has no inertia before its elastic gear; "
                    "expected an arm with its rotors"
                )
        own = brakes and any(body.brake is not None for body in model.coordinates)
        return cls(model, parts_of(model, own), own)

    @property
    def size(self) -> int:
        """Entries of x."""
        return sum(len(part.units) for part in self.parts)

    @cached_property
    def is_plain(self) -> bool:
        """Whether x is (q, q̇) and each drive acts on its joint alone: then `forward_dynamics` says all."""
        return len(self.parts) == 2 and not any(has_extra(body) for body in self.model.coordinates)

    @cached_property
    def stiff(self) -> tuple[int, ...]:
        """Places in x of what is integrated exactly."""
        return tuple(k for part in self.parts if part.name in STIFF for k in range(part.start, part.place.stop))

    def part(self, x: Array, name: str) -> Array:
        """Entries of x (…, size) by the name of their part.

        Raises:
            ScenarioError: the plant has no such part.
        """
        for part in self.parts:
            if part.name == name:
                return x[..., part.place]
        raise ScenarioError(
            f"{self.model.name}: no state {name!r}; it has {', '.join(part.name for part in self.parts)}"
        )

    def derivative(self, x: Array, u: Array, wrench: Array | None = None, brake: Array | None = None) -> np.ndarray:
        """dx/dt of all states.

        Args:
            x: (size,).   u: (n,) commands [V | A | N m | N].   wrench: (6,) [N, N m] on the tip, in base axes.
            brake: (brakes,) 1 where a brake is applied, 0 where it is released; absent: all released.
        Returns:
            xd: (size,), units of x a second.
        Raises:
            ModelError: a drive without the constants that its command needs.
        """
        return self.split(x, u, wrench, brake)[0]

    def split(
        self, x: Array, u: Array, wrench: Array | None = None, brake: Array | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """dx/dt (size,), and λ [1/s] of the entries `stiff`, which have  ż = λ z + what does not depend on z."""
        if self.is_plain:
            n = self.model.n
            q, qd = x[:n], x[n:]
            qdd = forward_dynamics(self.model, q, qd, limited_drive(self.model, qd, u).tau, wrench)
            return scalar.array(np.concatenate([qd, qdd])), scalar.zeros(0)
        flow = self._flow(x, u, wrench, brake)
        return scalar.array([value for part in self.parts for value in flow.change[part.name]]), scalar.array(
            flow.rates
        )

    def step(
        self,
        rule: Integrator,
        x: Array,
        u: Array,
        h: Scalar,
        wrench: Array | None = None,
        brake: Array | None = None,
    ) -> np.ndarray:
        """The state one step later, u, wrench and brakes held: stiff parts exactly, the rest by the rule.

        In a trace the derivative is one program that the rule calls at each of its stages.

        Args:
            rule: of `integrators.INTEGRATORS`.   x: (size,).   u: (n,).   h: () [s].   wrench, brake: as `derivative`.
        Returns:
            x_next: (size,).
        Raises:
            ScenarioError: a rule that has no form for stiff parts.
        """
        traced = scalar.is_symbolic(x, u, h)
        split = self.program(wrench is not None, brake is not None).split if traced else self.split
        if not self.stiff:
            return rule.step(lambda at, command: split(at, command, wrench, brake)[0], x, u, h)
        if rule.exponential is None:
            parts = [part.name for part in self.parts if part.name in STIFF]
            raise ScenarioError(
                f"{self.model.name}: {', '.join(parts)} change faster than a step, and this rule cannot integrate them "
                "exactly; expected rk3 or rk4"
            )
        return rule.exponential(lambda at, command: split(at, command, wrench, brake), self.stiff, x, u, h)

    def program(self, wrench: bool = False, brake: bool = False) -> PlantProgram:
        """The derivative as one program that traces call, not copy; with those inputs beside x and u."""
        if (wrench, brake) not in self._programs:
            sizes = {"x": self.size, "u": self.model.n}
            more = {"wrench": 6 * wrench, "brake": len(self.braked) * brake}
            self._programs[wrench, brake] = PlantProgram(self, sizes | {name: k for name, k in more.items() if k})
        return self._programs[wrench, brake]

    @cached_property
    def _programs(self) -> dict[tuple[bool, bool], PlantProgram]:
        return {}

    def outputs(
        self, x: Array, u: Array, wrench: Array | None = None, brake: Array | None = None
    ) -> dict[str, np.ndarray]:
        """What is known beside the state, each (n,) but for the bus; NaN for joints whose record cannot say it.

        Args:
            x: (size,).   u: (n,) [V | A | N m | N].   wrench, brake: as `derivative`.
        Returns:
            qdd [rad/s² | m/s²], tau: Nᵀ Kt i [N m | N], voltage [V] averaged over the PWM, current [A].
            tau_link [N m | N]: what leaves the gear, as a torque sensor reads it; friction of rigid gears before it,
            behind an elastic one the joint's own friction, brake and stops behind it.
            heat [W] of the windings, friction_loss [W] of all that rubs or dampens, electrical_power [W] into the drives.
            winding_temperature, housing_temperature [°C], bus_voltage [V]: where they are states.
        """
        model = self.model
        flow = self._flow(x, u, wrench, brake)
        joints, gear = flow.joints, self._link_torques(flow)
        rows = {
            "qdd": flow.qdd,
            "tau": to_joints(self._shares, [joint.tau for joint in joints]),
            "voltage": [joint.voltage for joint in joints],
            "current": [joint.current for joint in joints],
            "tau_link": gear,
            "heat": [np.nan if joint.heat is None else joint.heat for joint in joints],
            "friction_loss": [joint.loss + loss for joint, loss in zip(joints, self._followers_loss(x), strict=True)],
            "electrical_power": [joint.power for joint in joints],
        }
        states = {part.name: part for part in self.parts}
        for name in ("winding_temperature", "housing_temperature"):
            if name in states:
                values = dict(zip(states[name].joints, self.part(x, name), strict=True))
                rows[name] = [values.get(i, np.nan) for i in range(model.n)]
        if "bus_voltage" in states:
            rows["bus_voltage"] = self.part(x, "bus_voltage")
        return {name: scalar.array(list(values)) for name, values in rows.items()}

    def initial(self, q: Any, qd: Any) -> np.ndarray:
        """A state to begin in: motors where their links are, no current, ambient temperature, the bus full; bristles bent as
        in steady sliding, straight at rest, brakes unloaded.

        Args:
            q: (…, n) [rad | m].   qd: (…, n) [rad/s | m/s].
        Returns:
            x: (…, size).
        """
        q, qd = np.broadcast_arrays(np.asarray(q, dtype=float), np.asarray(qd, dtype=float))
        if len(self.parts) == 2:
            return np.concatenate([q, qd], axis=-1)
        q, qd = np.moveaxis(q, -1, 0), np.moveaxis(qd, -1, 0)
        values = at_rest(self.model, q, qd, to_motors(self._shares, q), to_motors(self._shares, qd))
        rows = [values[part.name][k] for part in self.parts for k in part.joints or (0,)]
        return np.stack([np.broadcast_to(np.asarray(row, dtype=float), q.shape[1:]) for row in rows], axis=-1)

    def measured(self, x: Array, u: Array, side: str = "link") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What exact sensors would see.

        Args:
            x: (size,).   u: (n,) commands, which decide the currents of motors without inductance.
            side: "link", or "motor": positions and speeds of the motors, θ_motor / n, referred to their joints.
        Returns:
            q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].   current: (n,) [A], NaN where the record cannot say it.
        """
        n = self.model.n
        q, qd = (x[:n], x[n : 2 * n]) if side == "link" else self._motors(x)
        return scalar.array(list(q)), scalar.array(list(qd)), self._done(x, u).current

    def applied(self, x: Array, u: Array) -> np.ndarray:
        """What the drives really do with their commands, within limits and supply.

        Args:
            x: (size,).   u: (n,) commands.
        Returns:
            applied: (n,) [V | A | N m | N], each in its joint's own unit.
        """
        return told_command(self.model, self._done(x, u))

    def _done(self, x: Array, u: Array) -> DriveOutput:
        """Torques, voltages and currents of the motors."""
        if self.is_plain:
            return limited_drive(self.model, x[self.model.n :], u)
        joints = self._driven(x, u, None)
        columns = zip(*((joint.tau, joint.voltage, joint.current) for joint in joints), strict=True)
        return DriveOutput(*(scalar.array(list(column)) for column in columns))

    def energy_rates(
        self, x: Array, u: Array, wrench: Array | None = None, brake: Array | None = None
    ) -> dict[str, Scalar]:
        """Powers [W]; what comes in is  electrical = heat + friction + mechanical + d/dt `stored_energy`.

        Returns:
            electrical: out of the supply's source, or into the drives where it is not told.
            heat: in windings, source and braking resistor.   friction: in all that rubs, dampens or slips, bent bristles
            included.   mechanical: into the environment, against the wrench.
        """
        flow = self._flow(x, u, wrench, brake)
        n = self.model.n
        heat = sum(joint.heat for joint in flow.joints if joint.heat is not None)
        power = sum(joint.power for joint in flow.joints)
        mechanical: Scalar = 0.0
        if wrench is not None:
            mechanical = -(wrench @ (jacobian(self.model, x[:n]) @ x[n : 2 * n]))
        if flow.fed is not None:
            power, heat = flow.fed.source, heat + flow.fed.loss
        return {
            "electrical": power,
            "heat": heat,
            "friction": sum(joint.loss for joint in flow.joints) + sum(self._followers_loss(x)),
            "mechanical": mechanical,
        }

    def _followers_loss(self, x: Array) -> list[Scalar]:
        """Power [W] that rubs in the joints that follow each coordinate."""
        n = self.model.n
        if self.model.mimics is None:
            return [0.0] * n
        qd = x[n : 2 * n]
        return list(friction_torques(self._links(rotors=False), qd) * qd)

    def stored_energy(self, x: Array) -> Scalar:
        """Energy [J] that the plant can give back: motion, height, springs, magnets, windings' fields, the bus capacitor."""
        n, model = self.model.n, self.model
        total = sum(energy(self._links(rotors=False), x[:n], x[n : 2 * n]))
        motions = self._motions(x)
        for i, body in enumerate(model.coordinates):
            total = total + stored(body, self._states(x, i), motions[i])
        if model.supply is not None:
            volts = self.part(x, "bus_voltage")[0]
            total = total + 0.5 * model.supply.capacitance * volts * volts
        return total

    @cached_property
    def _shares(self) -> Shares:
        """Which other joints turn each motor."""
        return shares_of(self.model)

    def _motors(self, x: Array) -> tuple[Array, Array]:
        """Positions and speeds of all motors, θ_motor / n."""
        n = self.model.n
        q, qd = to_motors(self._shares, x[:n]), to_motors(self._shares, x[n : 2 * n])
        if not any(part.name == "motor_q" for part in self.parts):
            return q, qd
        q, qd = list(q), list(qd)
        for part in self.parts:
            for k, i in enumerate(part.joints):
                if part.name in ("motor_q", "motor_qd"):
                    value = x[part.start + k] / self.model.coordinates[i].drive.gear_ratio
                    (q if part.name == "motor_q" else qd)[i] = value
        return scalar.array(q), scalar.array(qd)

    def _motions(self, x: Array) -> list[JointMotion]:
        """How every joint stands and moves."""
        n = self.model.n
        q, qd = x[:n], x[n : 2 * n]
        columns = (q, qd, *self._motors(x), to_motors(self._shares, q), to_motors(self._shares, qd))
        return [JointMotion(*row) for row in zip(*columns, strict=True)]

    def _states(self, x: Array, joint: int) -> JointStates:
        """What the drive of one joint has of the state."""
        own = {
            part.name: x[part.start + part.joints.index(joint)]
            for part in self.parts[2:]
            if joint in part.joints and not part.name.startswith("motor")
        }
        return JointStates(**own)

    def _links(self, *, rotors: bool) -> Model:
        """The arm without drives but for the rotors of rigid gears, which `forward_dynamics` can carry where none is coupled."""
        carried = rotors and not any(self._shares)

        def bare(body: Body) -> Body:
            inertia = body.drive.rotor_inertia if carried and body.elasticity is None else 0.0
            return replace(
                body, friction=None, drive=replace(body.drive, efficiency=None, rotor_inertia=inertia, coupling=())
            )

        own = set(self.model.names)  # joints that follow others keep what they have
        bodies = tuple(bare(body) if body.joint in own else body for body in self.model.bodies)
        return replace(self.model, bodies=bodies)

    def _flow(self, x: Array, u: Array, wrench: Array | None, brake: Array | None) -> Flow:
        """Every joint's drive, then the arm they move, then what all that makes of the state."""
        model, n = self.model, self.model.n
        q, qd = x[:n], x[n : 2 * n]
        joints = self._driven(x, u, brake)
        if self.is_plain:
            qdd = forward_dynamics(model, q, qd, scalar.array([joint.tau for joint in joints]), wrench)
        else:
            pushed = to_joints(self._shares, [joint.gear for joint in joints])
            qdd = self._accelerations(q, qd, pushed + scalar.array([joint.direct for joint in joints]), wrench)
        change, rates, fed = {"q": list(qd), "qd": list(qdd)}, [], None
        for part in self.parts[2:]:
            if part.name == "bus_voltage":
                assert model.supply is not None
                fed = bus(model.supply, self.part(x, "bus_voltage")[0], sum(joint.power for joint in joints))
                change[part.name], rates = [fed.speed], [*rates, fed.rate]
            elif part.name == "motor_q":
                change[part.name] = list(self.part(x, "motor_qd"))
            elif part.name == "motor_qd":
                change[part.name] = [joints[i].acceleration for i in part.joints]
            else:
                change[part.name] = [joints[i].change[part.name] for i in part.joints]
                rates += [joints[i].rates[part.name] for i in part.joints if part.name in STIFF]
        return Flow(qdd, joints, change, rates, fed)

    @cached_property
    def braked(self) -> tuple[int, ...]:
        """Joints whose brakes take part, in the order of `brake`."""
        return tuple(i for i, body in enumerate(self.model.coordinates) if self.brakes and body.brake is not None)

    def _driven(self, x: Array, u: Array, brake: Array | None) -> list[DrivenJoint]:
        """Every joint's drive by itself."""
        volts = self.part(x, "bus_voltage")[0] if self.model.supply is not None else None
        applied = dict.fromkeys(self.braked, 0.0) if brake is None else dict(zip(self.braked, brake, strict=True))
        return [
            driven_joint(self.model, body, self._states(x, i), at, u[i], volts, applied.get(i))
            for (i, body), at in zip(enumerate(self.model.coordinates), self._motions(x), strict=True)
        ]

    def _accelerations(self, q: Array, qd: Array, torque: Array, wrench: Array | None) -> Array:
        """q̈ for torques on the joints [N m | N], the rotors of rigid gears carried along."""
        links = self._links(rotors=True)
        if not any(self._shares):
            return forward_dynamics(links, q, qd, torque, wrench)
        inertia = mass_matrix(links, q) + reflected_inertia(self.model, self._shares)
        return scalar.solve_symmetric(scalar.array(inertia), torque - bias_torques(links, q, qd, wrench))

    def _link_torques(self, flow: Flow) -> Array:
        """What leaves the gears (n,), referred to the joints."""
        motors = to_motors(self._shares, flow.qdd)
        rigid = [body.elasticity is None for body in self.model.coordinates]
        leaves = [
            joint.gear - body.drive.reflected * motors[i] if rigid[i] else joint.gear
            for i, (joint, body) in enumerate(zip(flow.joints, self.model.coordinates, strict=True))
        ]
        own = [joint.friction if rigid[i] else 0.0 for i, joint in enumerate(flow.joints)]
        return to_joints(self._shares, leaves) - scalar.array(own)


def _is_zero(value: Scalar) -> bool:
    return not scalar.is_symbolic(value) and value == 0


def plant_derivative(model: Model, x: Array, u: Array) -> np.ndarray:
    """dx/dt of the arm with its motors, as `Plant.derivative`.

    Args:
        model: the arm.   x: (size,) positions, speeds, then what else the plant has.   u: (n,) commands [V | A | N m | N].
    Returns:
        xd: (size,), units of x a second.
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    return Plant.of(model).derivative(x, u)


def plant_outputs(model: Model, x: Array, u: Array) -> tuple[np.ndarray, ...]:
    """What is recorded beside the state: q̈, motor torque, and voltage and current of the motors.

    Args:
        model: the arm.   x: (size,).   u: (n,) [V | A | N m | N].
    Returns:
        qdd: (n,) [rad/s² | m/s²].   tau: (n,) [N m | N].   voltage: (n,) [V].   current: (n,) [A].
    """
    outputs = Plant.of(model).outputs(x, u)
    return outputs["qdd"], outputs["tau"], outputs["voltage"], outputs["current"]

"""The drives of a plant, every joint's by itself: states, motors, contacts, what they make of commands, and exact sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from armwright import scalar
from armwright.actuators import DriveOutput, in_command_units
from armwright.actuators.coupling import Shares, from_motors, shares_of, to_motors
from armwright.actuators.firmware import FirmwareState, turned
from armwright.actuators.supply import Bus, bus, drive_voltage
from armwright.actuators.winding import is_ideal
from armwright.dynamics.inverse import external_torques
from armwright.errors import ModelError, ScenarioError
from armwright.model import Model
from armwright.scalar import Array, Scalar
from armwright.signals import Layout
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.joint_drive import (
    DriveMotion,
    DrivenJoint,
    JointStates,
    at_rest,
    contact_depths,
    driven_joint,
    followed_command,
)
from armwright.simulation.plant.state import KEPT, OUTPUTS, WAITING, contacts_of, is_kept, state_layout

STIFF = ("current", "bristle", "brake", "bus_voltage")  # linear in themselves, and integrated exactly


@dataclass(frozen=True, eq=False)
class PlantDrives:
    """The drives of an arm.

    Attributes:
        model: the arm.   layout: of the state x.   brakes: whether the brakes take part.
    """

    model: Model
    layout: Layout
    brakes: bool = False

    @classmethod
    def of(cls, model: Model, *, brakes: bool = False) -> Self:
        """The plant of an arm.

        Args:
            model: the arm; numbers may be symbols.
            brakes: whether the holding brakes of its record take part; else they stay released and cost nothing.
        Raises:
            ModelError: a motor behind an elastic gear that has lost its inertia, by `arm.replace(rotors=None)`.
        """
        for body in model.coordinates:
            inertia = body.drive.rotor_inertia
            if body.elasticity is not None and not scalar.is_symbolic(inertia) and inertia == 0:
                raise ModelError(
                    "its motor has no inertia before its elastic gear",
                    place=f"joint {body.joint!r}",
                    expected="an arm with its rotors",
                    file=model.name,
                )
        braked = brakes and any(body.brake is not None for body in model.coordinates)
        return cls(model, state_layout(model, braked), braked)

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
            choices = self.layout.names
            raise ScenarioError("no such state", place="name", value=name, choices=choices, file=self.model.name)
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

    @cached_property
    def shares(self) -> Shares:
        """Other joints that turn each motor."""
        return shares_of(self.model)

    def initial(self, q: Array, qd: Array) -> np.ndarray:
        """A state to begin in: motors where their links are, no current, ambient temperature, the bus full; bristles bent as
        in steady sliding, straight at rest, brakes unloaded.

        Args:
            q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        Returns:
            x: (size,).
        """
        motor, motor_speed = to_motors(self.shares, q), to_motors(self.shares, qd)
        values = at_rest(self.model, q, qd, motor, motor_speed)
        return scalar.array([values[part.name][k] for part in self.layout for k in part.joints or (0,)])

    def contact_depths(self, x: Array) -> np.ndarray:
        """Depth of every contact, (contacts,) [rad | m]: a joint in its stops, flanks in each other; below 0 outside."""
        pairs = zip(self.model.coordinates, self.motions(x), strict=True)
        return scalar.array([depth for body, at in pairs for depth in contact_depths(body, at)])

    def active_contacts(self, x: Array) -> np.ndarray:
        """Active contacts of a state, (contacts,): 1 where the depth is not below 0, else 0."""
        return scalar.array([scalar.less_equal(0.0, depth) for depth in self.contact_depths(x)])

    def driven(
        self, x: Array, inputs: PlantInputs, directions: Sequence[tuple[Scalar, Scalar]] | None = None
    ) -> list[DrivenJoint]:
        """Every joint's drive by itself; directions of joints and motors that stick are by default the signs of their speeds."""
        u, touching, brake = inputs.command, inputs.contacts, inputs.brake
        ends = np.cumsum(self.contacts)
        of = [None if touching is None else touching[end - k : end] for end, k in zip(ends, self.contacts, strict=True)]
        volts = self._supply_voltage(x, inputs)
        enabled = {} if inputs.enabled is None else dict(zip(self.servos, inputs.enabled, strict=True))
        external = self._external(x, inputs)
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
                external[i],
                enabled.get(i),
            )
            for (i, body), at in zip(enumerate(self.model.coordinates), self.motions(x), strict=True)
        ]

    def _supply_voltage(self, x: Array, inputs: PlantInputs) -> Scalar | None:
        """[V] that the inputs' supply or the bus gives the drives; None: the supply never sags."""
        if inputs.supply is not None:
            return inputs.supply[0]
        supply = self.model.supply
        return None if supply is None else drive_voltage(supply, self.part(x, "bus_voltage")[0])

    def _external(self, x: Array, inputs: PlantInputs) -> Array:
        """-(C q̇ + g + s) + Jᵀ wrench (n,) [N m | N], for friction that depends on it; else 0."""
        n = self.model.n
        external = external_torques(self.model, x[:n], x[n : 2 * n], inputs.wrench)
        return scalar.zeros(n) if external is None else external

    def motions(self, x: Array) -> list[DriveMotion]:
        """Positions and speeds of every joint and its motor."""
        n = self.model.n
        q, qd = x[:n], x[n : 2 * n]
        columns = (q, qd, *self._motors(x), to_motors(self.shares, q), to_motors(self.shares, qd))
        return [DriveMotion(*row) for row in zip(*columns, strict=True)]

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

    def _states(self, x: Array, joint: int) -> JointStates:
        """The state of one joint's drive."""
        entries = {
            part.name: self.part(x, part.name)[part.joints.index(joint)]
            for part in self.layout.signals[2:]
            if part.joints is not None and joint in part.joints and not part.name.startswith("motor")
        }
        kept = {name: entries.pop(name) for name in list(entries) if is_kept(name)}
        if not kept:
            return JointStates(**entries)
        waiting = tuple(value for name, value in kept.items() if name.startswith(WAITING))
        output = next(kept[name] for name in OUTPUTS if name in kept)
        others = {name: value for name, value in kept.items() if name in KEPT and name not in OUTPUTS}
        return JointStates(**entries, servo=FirmwareState(output=output, waiting=waiting, **others))

    @cached_property
    def servos(self) -> tuple[int, ...]:
        """Joints that follow goals by themselves, in the order of `enabled`."""
        return tuple(i for i, body in enumerate(self.model.coordinates) if body.drive.firmware is not None)

    @cached_property
    def turn(self) -> float | None:
        """[s] from one turn of the fastest servo's loop to the next; None without servos."""
        loops = [self.model.coordinates[i].drive.firmware for i in self.servos]
        return min((loop.period / loop.every for loop in loops if loop is not None), default=None)

    def turned(self, x: Array, inputs: PlantInputs, number: Scalar) -> np.ndarray:
        """The state (size,) when servos' loops turn.

        Args:
            x: (size,) just before.   inputs: in force.   number: of the turns of the fastest loop so far: those of others that
                are not due stay as they are.
        """
        after = list(x)
        on = dict.fromkeys(self.servos, 1.0)
        on |= {} if inputs.enabled is None else dict(zip(self.servos, inputs.enabled, strict=True))
        for i in self.servos:
            firmware, before = self.model.coordinates[i].drive.firmware, self._states(x, i).servo
            assert firmware is not None
            assert before is not None
            new = turned(firmware, before, x[i], inputs.command[i], on[i])
            due = (
                scalar.equal(number, firmware.every * scalar.floor(number / firmware.every))
                if firmware.every > 1
                else 1.0
            )
            values = {name: getattr(new, name) for name in KEPT if name not in OUTPUTS}
            values |= dict.fromkeys(OUTPUTS, new.output)
            values |= {f"{WAITING}{k}": value for k, value in enumerate(new.waiting, 1)}
            for part in self.layout.signals[2:]:
                if is_kept(part.name) and i in (part.joints or ()):
                    place = self.layout.place(part.name).start + (part.joints or ()).index(i)
                    after[place] = scalar.where(due, values[part.name], x[place])
        return scalar.array(after)

    def fast(self, x: Array, inputs: PlantInputs | Array) -> tuple[np.ndarray, np.ndarray]:
        """ż and λ [1/s] of the entries `stiff` alone: what `split` says of them, without the arm's dynamics."""
        change, rates, _ = self._of_drives(x, self.driven(x, PlantInputs.of(inputs)))
        fast = [value for name in self.layout.names if name in STIFF for value in change[name]]
        return scalar.array(fast), scalar.array(rates)

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
            elif is_kept(part.name):
                change[part.name] = [0.0 * joints[0].tau] * len(joints_of)
            elif part.name == "motor_q":
                change[part.name] = list(self.part(x, "motor_qd"))
            elif part.name == "motor_qd":
                change[part.name] = [joints[i].acceleration for i in joints_of]
            else:
                change[part.name] = [joints[i].change[part.name] for i in joints_of]
                rates += [joints[i].rates[part.name] for i in joints_of if part.name in STIFF]
        return change, rates, fed

    def measured(
        self, x: Array, inputs: PlantInputs | Array, side: str = "link"
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values of exact sensors.

        Args:
            x: (size,).   inputs: commands, supply and enabled servos, which decide the currents of motors without inductance; or
                commands alone.
            side: "link", or "motor": positions and speeds of the motors, θ_motor / n, referred to their joints.
        Returns:
            q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].   current: (n,) [A], NaN where the record cannot say it.
        """
        n = self.model.n
        q, qd = (x[:n], x[n : 2 * n]) if side == "link" else self._motors(x)
        inputs = PlantInputs.of(inputs)
        of_drives = PlantInputs(inputs.command, supply=inputs.supply, enabled=inputs.enabled)
        return scalar.array(list(q)), scalar.array(list(qd)), self._done(x, of_drives).current

    def of_joints(self, q: Array, qd: Array, side: str) -> tuple[Array, Array]:
        """Joint values from sensors of that side: encoders of coupled motors measure several joints together.

        Args:
            q: (n,) [rad | m], qd: (n,) [rad/s | m/s]: as `measured`.   side: "link" or "motor".
        Returns:
            q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        """
        shares = self.shares if side == "motor" else []
        return from_motors(shares, q), from_motors(shares, qd)

    def applied(self, x: Array, inputs: PlantInputs | Array) -> np.ndarray:
        """Commands that the drives follow: what they produce for theirs in the end, within limits and supply.

        A command within a dead zone is followed: it gives nothing, but no limit has changed it. So is one that a winding or its
        current loop reaches a moment later, or one of torque that warm magnets fall short of.

        Args:
            x: (size,).   inputs: commands, and a supply that takes the place of the record's; or commands alone.
        Returns:
            applied: (n,) [V | A | N m | N | rad], each in its joint's own unit; of a servo the goal that it follows.
        """
        inputs = PlantInputs.of(inputs)
        u, volts, speeds = inputs.command, self._supply_voltage(x, inputs), self._motors(x)[1]
        applied = list(in_command_units(self.model, self._done(x, PlantInputs(u, supply=inputs.supply))))
        for i, body in enumerate(self.model.coordinates):
            width, states = body.drive.dead_zone, self._states(x, i)
            if states.servo is not None:
                applied[i] = states.servo.goal
            elif states.current is not None or states.winding_temperature is not None:
                applied[i] = followed_command(body, states, speeds[i], u[i], volts)
            if width is not None:
                applied[i] = scalar.where(scalar.less_equal(scalar.abs(u[i]), width), u[i], applied[i])
        return scalar.array(applied)

    def _done(self, x: Array, inputs: PlantInputs | Array) -> DriveOutput:
        """Torques, voltages and currents of the motors."""
        joints = self.driven(x, PlantInputs.of(inputs))
        columns = zip(*((joint.tau, joint.voltage, joint.current) for joint in joints), strict=True)
        return DriveOutput(*(scalar.array(list(column)) for column in columns))

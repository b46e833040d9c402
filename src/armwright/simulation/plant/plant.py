"""The plant: an arm with its drives as one system of first order,  dx/dt = f(x, u),  whatever each joint's drive has.

x holds q and q̇, then only what the arm's record asks for: positions and speeds of motors behind elastic gears, winding
currents, bristles, temperatures, the bus. What is absent has neither state nor operations. With B the motors' speeds by
the joints' (B = 1 but for coupled motors, θ_motor / n = B q) and a rigid gear,

    ( M_links + Bᵀ n² J_m B ) q̈ = Bᵀ ( e tau_m - f_m ) - C q̇ - g - f + Jᵀ wrench,   tau_m = n Kt i + n cogging;

an elastic one has its motor's own  n² J_m θ̈ = e tau_m - f_m - ∂δ/∂θ · spring  and gives Bᵀ spring to the links. [Spong1987]
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armwright import scalar
from armwright.actuators import limited_drive
from armwright.actuators.coupling import to_motors
from armwright.dynamics import forward_dynamics
from armwright.errors import ModelError
from armwright.model import Model
from armwright.scalar import Array, Scalar
from armwright.simulation.integration.exponential import Split
from armwright.simulation.integration.integrators import Integrator
from armwright.simulation.plant.flow import STIFF
from armwright.simulation.plant.joint_drive import at_rest, contact_depths
from armwright.simulation.plant.program import PlantProgram
from armwright.simulation.plant.readings import PlantReadings
from armwright.simulation.plant.state import parts_of


@dataclass(frozen=True, eq=False)
class Plant(PlantReadings):
    """An arm with its drives, as its record describes them.

    Attributes:
        model: the arm.   parts: of the state x, in order.   brakes: whether `brake` is an input of derivative and step.
    """

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

    def depths(self, x: Array) -> np.ndarray:
        """How deep every contact is, (contacts,) [rad | m]: a joint in its stops, flanks in each other; below 0 outside."""
        pairs = zip(self.model.coordinates, self._motions(x), strict=True)
        return scalar.array([depth for body, at in pairs for depth in contact_depths(body, at)])

    def touching(self, x: Array) -> np.ndarray:
        """Which contacts there are in a state, (contacts,): 1 where the depth is not below 0, else 0."""
        return scalar.array([scalar.less_equal(0.0, depth) for depth in self.depths(x)])

    def corners(
        self, x: Array, u: Array, brake: Array | None = None, touching: Array | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Numbers that change their sign where the derivative bends: beside `depths`, which make it jump.

        Args:
            x, u, brake, touching: as `derivative`.
        Returns:
            corners: (k,) how hard contacts push that there are [N m | N]; speeds of joints and motors whose friction has a corner
            at rest [rad/s | m/s].   least: (k,) in their units: one changes from a to b where a b < -least².
        """
        found = [corner for joint in self._driven(x, u, brake, touching) for corner in joint.corners]
        return scalar.array([corner.value for corner in found]), scalar.array([corner.least for corner in found])

    def derivative(
        self,
        x: Array,
        u: Array,
        wrench: Array | None = None,
        brake: Array | None = None,
        touching: Array | None = None,
    ) -> np.ndarray:
        """dx/dt of all states.

        Args:
            x: (size,).   u: (n,) commands [V | A | N m | N].   wrench: (6,) [N, N m] on the tip, in base axes.
            brake: (brakes,) 1 where a brake is applied, 0 where it is released; absent: all released.
            touching: (contacts,) 1 where a contact counts as made; absent: as `touching` says of x.
        Returns:
            xd: (size,), units of x a second.
        Raises:
            ModelError: a drive without the constants that its command needs.
        """
        return self.split(x, u, wrench, brake, touching)[0]

    def split(
        self,
        x: Array,
        u: Array,
        wrench: Array | None = None,
        brake: Array | None = None,
        touching: Array | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """dx/dt (size,), and λ [1/s] of the entries `stiff`, which have  ż = λ z + what does not depend on z."""
        if self.is_plain:
            n = self.model.n
            q, qd = x[:n], x[n:]
            qdd = forward_dynamics(self.model, q, qd, limited_drive(self.model, qd, u).tau, wrench)
            return scalar.array(np.concatenate([qd, qdd])), scalar.zeros(0)
        flow = self._flow(x, u, wrench, brake, touching)
        return scalar.array([value for part in self.parts for value in flow.change[part.name]]), scalar.array(
            flow.rates
        )

    def fast(
        self,
        x: Array,
        u: Array,
        wrench: Array | None = None,
        brake: Array | None = None,
        touching: Array | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """ż and λ [1/s] of the entries `stiff` alone: what `split` says of them, without the arm's dynamics."""
        change, rates, _ = self._of_drives(x, self._driven(x, u, brake, touching))
        fast = [value for part in self.parts if part.name in STIFF for value in change[part.name]]
        return scalar.array(fast), scalar.array(rates)

    def step(
        self,
        rule: Integrator,
        x: Array,
        u: Array,
        h: Scalar,
        wrench: Array | None = None,
        brake: Array | None = None,
        touching: Array | None = None,
    ) -> np.ndarray:
        """The state one step later, u, wrench and brakes held: stiff parts exactly, the rest by the rule.

        In a trace the derivative is one program that the rule calls at each of its stages. Contacts are held too, so that no
        stage sees another side of them; `switching` ends steps where they change.

        Args:
            rule: of `integrators.INTEGRATORS`.   x: (size,).   u: (n,).   h: () [s].
            wrench, brake, touching: as `derivative`.
        Returns:
            x_next: (size,).
        """
        traced = scalar.is_symbolic(x, u, h)
        split = self.program(wrench is not None, brake is not None).split if traced else self.split
        if touching is None and any(self.contacts):
            touching = self.touching(x)
        held = (wrench, brake, touching)
        if not self.stiff:
            return rule.step(lambda at, command: split(at, command, *held)[0], x, u, h)

        def fast(at: Array, command: Array) -> tuple[Array, Array]:
            return self.fast(at, command, *held)

        return rule.exponential(Split(lambda at, command: split(at, command, *held), fast, self.stiff), x, u, h)

    def program(self, wrench: bool = False, brake: bool = False) -> PlantProgram:
        """The derivative as one program that traces call, not copy; with those inputs beside x and u."""
        if (wrench, brake) not in self._programs:
            sizes = {"x": self.size, "u": self.model.n}
            more = {"wrench": 6 * wrench, "brake": len(self.braked) * brake, "touching": sum(self.contacts)}
            self._programs[wrench, brake] = PlantProgram(self, sizes | {name: k for name, k in more.items() if k})
        return self._programs[wrench, brake]

    @cached_property
    def _programs(self) -> dict[tuple[bool, bool], PlantProgram]:
        return {}

    def initial(self, q: Array, qd: Array) -> np.ndarray:
        """A state to begin in: motors where their links are, no current, ambient temperature, the bus full; bristles bent as
        in steady sliding, straight at rest, brakes unloaded.

        Args:
            q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        Returns:
            x: (size,).
        """
        motor, motor_speed = to_motors(self._shares, q), to_motors(self._shares, qd)
        values = at_rest(self.model, q, qd, motor, motor_speed)
        return scalar.array([values[part.name][k] for part in self.parts for k in part.joints or (0,)])


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

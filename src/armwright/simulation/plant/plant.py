"""The plant: an arm with its drives as one system of first order,  dx/dt = f(x, u),  whatever each joint's drive has.

x holds q and q̇, then only what the arm's record asks for: positions and speeds of motors behind elastic gears, winding
currents, bristles, temperatures, the bus. What is absent has neither state nor operations. With B the motors' speeds by
the joints' (B = 1 but for coupled motors, θ_motor / n = B q), G the torque that leaves a gear (`actuators.gear`; the identity
without loss) and f, f_m the friction of joints and motors with their brakes and stops, a rigid gear has

    M_links q̈ + C q̇ + g + s + f - Jᵀ wrench = Bᵀ G(tau_m - n² J_m B q̈ - f_m),   tau_m = n Kt i + n cogging;

an elastic one has its motor's own  n² J_m θ̈ = tau_m - f_m - G⁻¹(∂δ/∂θ · spring)  and gives Bᵀ spring to the links. [Spong1987]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from armwright import scalar
from armwright.model import Model
from armwright.scalar import Array, Scalar
from armwright.simulation.integrate.exponential import Split
from armwright.simulation.integrate.integrators import Integrator
from armwright.simulation.plant.inputs import HELD, PlantInputs
from armwright.simulation.plant.outputs import PlantOutputs
from armwright.simulation.plant.program import PlantProgram


@dataclass(frozen=True, eq=False)
class Plant(PlantOutputs):
    """An arm with its drives, as its record describes them.

    Attributes:
        model: the arm.   layout: of the state x.   brakes: whether the brakes take part.
    """

    def switching_functions(self, x: Array, inputs: PlantInputs | Array) -> tuple[np.ndarray, np.ndarray]:
        """Numbers that change their sign where the derivative bends: beside `contact_depths`, which make it jump.

        Args:
            x, inputs: as `derivative`.
        Returns:
            values: (k,) how hard contacts push that there are [N m | N]; speeds of joints and motors whose friction has a corner
            at rest [rad/s | m/s].   least: (k,) in their units: one changes from a to b where a b < -least².
        """
        functions = [each for joint in self._flow(x, PlantInputs.of(inputs)).joints for each in joint.switching]
        return scalar.array([each.value for each in functions]), scalar.array([each.least for each in functions])

    def derivative(self, x: Array, inputs: PlantInputs | Array) -> np.ndarray:
        """dx/dt of all states.

        Args:
            x: (size,).   inputs: what acts on the plant; an array (n,) stands for commands alone.
        Returns:
            xd: (size,), units of x a second.
        Raises:
            ModelError: a drive without the constants that its command needs.
        """
        return self.split(x, inputs)[0]

    def split(self, x: Array, inputs: PlantInputs | Array) -> tuple[np.ndarray, np.ndarray]:
        """dx/dt (size,), and λ [1/s] of the entries `stiff`, which have  ż = λ z + what does not depend on z."""
        inputs = PlantInputs.of(inputs)
        flow = self._flow(x, inputs)
        change = [value for name in self.layout.names for value in flow.change[name]]
        return scalar.array(change), scalar.array(flow.rates)

    def step(self, rule: Integrator, x: Array, inputs: PlantInputs | Array, h: Scalar) -> np.ndarray:
        """The state one step later, inputs held: stiff parts exactly, the rest by the rule.

        In a trace the derivative is one program that the rule calls at each of its stages. Contacts are held too, so that no
        stage sees another side of them; `switching` ends steps where they change. So are directions, where the inputs hold some.

        Args:
            rule: of `integrators.INTEGRATORS`.   x: (size,).   inputs: as `derivative`.   h: () [s].
        Returns:
            x_next: (size,).
        """
        inputs = self._held(x, inputs)
        if self.sticking is not None and inputs.directions is not None:
            # A speed of 0 that has a derivative has none here.
            x = self.sticking.at_rest(x, inputs.directions)
        if self.sticking is None or inputs.directions is not None:
            return self.settled(self._stepped(rule, x, inputs, h))

        def moved(directions: Array) -> Any:
            return self._stepped(rule, x, replace(inputs, directions=directions), h)

        return self.settled(self.sticking.step(x, inputs, h, moved))

    def step_with_error(
        self, rule: Integrator, x: Array, inputs: PlantInputs | Array, h: Scalar
    ) -> tuple[np.ndarray, np.ndarray]:
        """`step` by a rule that tells its error: the state one step later, and how wrong it may be, (size,) each.

        Of an arm that sticks the inputs hold the directions of motion, and the state keeps to them.
        """
        new, error = self._stepped(rule, x, self._held(x, inputs), h)
        return self.settled(new), error

    def _held(self, x: Array, inputs: PlantInputs | Array) -> PlantInputs:
        """The inputs, with the contacts of a state where they hold none."""
        inputs = PlantInputs.of(inputs)
        if inputs.contacts is None and any(self.contacts):
            inputs = replace(inputs, contacts=self.active_contacts(x))
        return inputs

    def _stepped(self, rule: Integrator, x: Array, inputs: PlantInputs, h: Scalar) -> Any:
        """Result of a rule for one step, inputs held."""
        split = self.program(inputs).split if scalar.is_symbolic(x, inputs.command, h) else self.split

        def inputs_at(command: Array) -> PlantInputs:
            return replace(inputs, command=command)

        if not self.stiff:
            return rule.step(lambda at, command: split(at, inputs_at(command))[0], x, inputs.command, h)
        exact = Split(
            lambda at, command: split(at, inputs_at(command)),
            lambda at, command: self.fast(at, inputs_at(command)),
            self.stiff,
        )
        return rule.exponential(exact, x, inputs.command, h)

    def program(self, inputs: PlantInputs) -> PlantProgram:
        """The derivative as one program that traces call, not copy, with those inputs that are given."""
        names = tuple(name for name in HELD if getattr(inputs, name) is not None)
        if names not in self._programs:
            sizes = {"x": self.size, "command": self.model.n}
            self._programs[names] = PlantProgram(self, sizes | {name: len(getattr(inputs, name)) for name in names})
        return self._programs[names]

    @cached_property
    def _programs(self) -> dict[tuple[str, ...], PlantProgram]:
        return {}


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
    """Recorded values beside the state: q̈, motor torque, and voltage and current of the motors.

    Args:
        model: the arm.   x: (size,).   u: (n,) [V | A | N m | N].
    Returns:
        qdd: (n,) [rad/s² | m/s²].   tau: (n,) [N m | N].   voltage: (n,) [V].   current: (n,) [A].
    """
    outputs = Plant.of(model).outputs(x, u)
    return outputs["qdd"], outputs["tau"], outputs["voltage"], outputs["current"]

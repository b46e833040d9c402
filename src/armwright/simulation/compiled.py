"""A tick and what follows from its rows as native code, to be run by any scenario that asks for the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright.kernels.batch import Kernel
from armwright.kernels.loop import Loop
from armwright.kernels.stages import Integrate
from armwright.kernels.target import select_target
from armwright.model import Model
from armwright.model.vary import Varied
from armwright.program import Program, trace
from armwright.scalar import Array
from armwright.simulation.integration.stepping import Adaptivity
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.stability import Stability
from armwright.simulation.sampling.cycle import Cycle, make_cycle, plant_derivative, plant_step
from armwright.simulation.sampling.tick_parts import Parts

USUAL = ("qdd", "tau", "voltage", "current")  # what is told of every arm


@dataclass(frozen=True, eq=False)
class Simulator:
    """An arm, its loop compiled.

    Attributes:
        parts: what it was made of.   target: processor level, as in `compile`.   cycle: the stages of a tick.
        loops: one, or two with the controller's Python between them.   stability: which steps are too large for the arm.
        outputs: (x, u, …) → what is told beside the state, by `names`; None where only the state is.
    """

    parts: Parts
    target: str | None
    cycle: Cycle
    loops: tuple[Loop, ...]
    stability: Stability
    outputs: Kernel | None
    names: tuple[str, ...]

    @classmethod
    def of(cls, parts: Parts, target: str | None, *, told: bool = True) -> Simulator:
        """Compiles a tick; `told`: and what follows from its rows.

        Raises:
            ModelError: a drive without the constants that its command needs.
        """
        cycle, chosen = make_cycle(parts), select_target(target)
        stages = [cycle.before, cycle.after] if cycle.untraced is not None else [(*cycle.before, *cycle.after)]
        loops = tuple(Loop(part, chosen.doubled()) for part in stages)
        program, names = plant_outputs(parts) if told else (None, ())
        outputs = None if program is None else Kernel(program, chosen)
        return cls(parts, target, cycle, loops, Stability(parts.arm), outputs, names)

    @property
    def arm(self) -> Model:
        """The arm that it was compiled for."""
        return self.parts.arm

    @property
    def step(self) -> Program:
        """One step of the plant:  (x, u, …, h) → x_next; rules that choose their steps have none."""
        stage = next(stage for stage in self.loops[-1].stages if isinstance(stage, Integrate))
        return plant_step(self.parts) if stage.landing else stage.step


def compile_simulator(
    arm: Model,
    integrator: str = "rk3",
    target: str | None = None,
    adaptivity: Adaptivity | None = None,
    varied: Varied | None = None,
) -> Simulator:
    """The loop of an arm under commands over time, for any scenario with the same arm, integrator and target.

    Args:
        arm: the model.   integrator: a name of `integrators.RULES`.   target: processor level, as in `compile`.
        adaptivity: how "rk45" chooses its steps, as `Scenario.adaptivity` says.
        varied: the same arm with parameters left open, which are then a block "p" of the loop.
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    recorded = {"x": Plant.of(arm).size}
    return Simulator.of(Parts(arm, varied, integrator, adaptivity, recorded=recorded), target)


def plant_outputs(parts: Parts) -> tuple[Program, tuple[str, ...]]:
    """What follows from state, commands, inputs and parameters, for all recorded rows at once; and its names."""
    names: list[str] = []

    def outputs(x: Array, u: Array, *rest: Array) -> tuple[Array, ...]:
        told = dict(zip(parts.more, rest, strict=True))
        plant = parts.plant(told, simple=True)
        found = plant.outputs(x, u, told.get("wrench"), told.get("brake"))
        if parts.sampling is None and plant.is_plain:  # the motors alone: what else there is follows from these
            found = {name: values for name, values in found.items() if name in USUAL}
        names[:] = found
        return tuple(found.values())

    _, shapes = plant_derivative(parts)
    n = parts.arm.n
    given = {name: np.zeros(shape) for name, shape in shapes.items()} | {
        "x": parts.bare.initial(np.zeros(n), np.zeros(n))
    }
    if parts.varied is not None:
        given["p"] = parts.varied.nominal
    outputs(*given.values())
    return trace("outputs", outputs, shapes, tuple(names)), tuple(names)

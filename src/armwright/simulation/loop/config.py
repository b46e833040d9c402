"""Configuration of a tick: the arm, its inputs, the integration rule, and the parts of a sampled loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from armwright.model import Model
from armwright.model.add_load import add_load
from armwright.model.simplify import simplified
from armwright.model.vary import Varied
from armwright.results.reducers import Reduction
from armwright.scalar import Array
from armwright.signals import Layout
from armwright.simulation.integrate.stepping import Adaptivity
from armwright.simulation.loop.command_filter import CommandFilter
from armwright.simulation.loop.controller import ControllerAdapter
from armwright.simulation.loop.references import LoopReference
from armwright.simulation.loop.sensor_set import SensorSet
from armwright.simulation.loop.timing import Delays
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant


@dataclass(frozen=True, eq=False)
class Sampling:
    """Parts of a tick that only a sampled loop has.

    Attributes:
        controller: the adapter.   states: entries of its state.   sensors: all of them.
        command_filter, delays: of commands.   period: [s].
        untraced: why the controller runs in Python, where that is known before.
    """

    controller: ControllerAdapter
    states: int
    sensors: SensorSet
    command_filter: CommandFilter
    delays: Delays
    period: float
    untraced: str | None = None


@dataclass(frozen=True, eq=False)
class LoopConfig:
    """Configuration of a tick.

    Attributes:
        arm: the model.   varied: the same with parameters left open, where some vary.
        integrator, adaptivity: the rule that moves the plant.
        inputs: of the plant beside its commands: blocks and their entries.
        payload_frames: names of the frames that payloads hang on, ten entries of block "payload" each.
        recorded: blocks that are stored, with their layouts.   reduction: what is computed along the way.
        reference: what is followed; None where nobody asks.   sampling: None where commands come from a schedule.
        lands: whether steps of a fixed length end where something begins to stick or breaks loose, too, in a state whose
            derivative is right there.
    """

    arm: Model
    varied: Varied | None
    integrator: str
    adaptivity: Adaptivity | None = None
    inputs: Mapping[str, int] = field(default_factory=dict)
    payload_frames: tuple[str, ...] = ()
    recorded: Mapping[str, Layout] = field(default_factory=dict)
    reduction: Reduction | None = None
    reference: LoopReference | None = None
    sampling: Sampling | None = None
    lands: bool = False

    @property
    def plant_blocks(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the blocks that programs of the plant take behind x and u: its inputs, then the varied parameters."""
        varying = {} if self.varied is None else {"p": (len(self.varied.parameters),)}
        return {name: (entries,) for name, entries in self.inputs.items()} | varying

    @property
    def plant_shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the arguments (x, u, …) of the plant's programs, by name."""
        return {"x": (self.bare.size,), "u": (self.arm.n,)} | self.plant_blocks

    @cached_property
    def structure(self) -> tuple[Any, ...]:
        """All that the plant's programs depend on, but no values of lanes: the arm by its content, what varies, inputs, rule."""
        names = None if self.varied is None else self.varied.names
        inputs = tuple(self.inputs.items()), self.payload_frames
        return self.arm.sha256, names, self.integrator, *inputs, self.lands

    @property
    def is_ahead(self) -> bool:
        """True if "auto" keeps the sum of all steps' errors below an accuracy, in steps that go on beyond their tick.

        That is where it is "rk45", as nothing is sampled; rows are then read from the path within the step.
        """
        by_range = self.adaptivity is not None and self.adaptivity.allowed.accuracy is not None
        return by_range and self.integrator == "rk45"

    @property
    def bare(self) -> Plant:
        """The plant with the numbers of the record."""
        return Plant.of(self.arm, brakes="brake" in self.inputs)

    def plant(self, values: Mapping[str, Array], *, simple: bool = False) -> Plant:
        """The plant of one lane, with its parameters and payloads.

        Args:
            values: of the `plant_blocks` by name.   simple: rewritten into one with the same motion and fewer operations.
        """
        arm = self.varied.model(values["p"]) if self.varied is not None and "p" in values else self.arm
        for k, frame in enumerate(self.payload_frames if "payload" in values else ()):
            arm = add_load(arm, frame, values["payload"][10 * k : 10 * k + 10])
        return Plant.of(simplified(arm) if simple else arm, brakes="brake" in self.inputs)

    def plant_inputs(self, command: Array, values: Mapping[str, Array]) -> PlantInputs:
        """Inputs of the plant from commands (n,) and the blocks of the tick."""
        return PlantInputs.named(command, values)

    def plant_call(self, u: Array, rest: Sequence[Array]) -> tuple[Plant, PlantInputs]:
        """A lane's plant and its inputs, from commands and what follows: `plant_blocks`, then contacts and directions if held."""
        held = [*(["contacts"] if sum(self.bare.contacts) else []), "directions"]
        values = dict(zip([*self.plant_blocks, *held], rest, strict=False))
        return self.plant(values, simple=True), PlantInputs.named(u, values)

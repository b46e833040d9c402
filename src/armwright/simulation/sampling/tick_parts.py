"""What a tick is made of: the arm, what acts on it, the rule that moves it, and what a controller adds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from armwright.model import Model
from armwright.model.carried import carrying
from armwright.model.simplify import simplified
from armwright.model.vary import Varied
from armwright.scalar import Array
from armwright.simulation.integration.stepping import Adaptivity
from armwright.simulation.plant.plant import Plant
from armwright.simulation.results.reducers import Reduction
from armwright.simulation.sampling.law import Law
from armwright.simulation.sampling.sensors import Sensors
from armwright.simulation.sampling.shaping import Shaping
from armwright.simulation.sampling.timing import Delays


@dataclass(frozen=True, eq=False)
class Sampling:
    """What a controller adds to a tick."""

    law: Law
    states: int  # of the controller
    sensors: Sensors
    shaping: Shaping
    delays: Delays
    period: float
    untraced: str | None = None  # why the controller runs in Python, where that is known before


@dataclass(frozen=True, eq=False)
class Parts:
    """What a tick is made of.

    Attributes:
        arm: the model.   varied: the same with parameters left open, where some vary.
        integrator, adaptivity, substeps: the rule that moves the plant.
        inputs: what acts on the plant beside its commands, held from row to row: blocks and their entries.
        hands: frames that payloads hang on, ten entries of block "payload" each.
        recorded: blocks and their entries.   reduction: what is worked out along the way.
        sampling: None where commands come from a schedule.   apart: whether every lane has a reference of its own.
    """

    arm: Model
    varied: Varied | None
    integrator: str
    adaptivity: Adaptivity | None = None
    substeps: int = 1
    inputs: Mapping[str, int] = field(default_factory=dict)
    hands: tuple[str, ...] = ()
    recorded: Mapping[str, int] = field(default_factory=dict)
    reduction: Reduction | None = None
    sampling: Sampling | None = None
    apart: bool = False

    @property
    def more(self) -> dict[str, tuple[int, ...]]:
        """Shapes of what programs of the plant take behind x and u: its inputs, then the parameters that vary."""
        varying = {} if self.varied is None else {"p": (len(self.varied.parameters),)}
        return {name: (entries,) for name, entries in self.inputs.items()} | varying

    @property
    def bare(self) -> Plant:
        """The plant with the numbers of the record."""
        return Plant.of(self.arm, brakes="brake" in self.inputs)

    def plant(self, told: Mapping[str, Array], *, simple: bool = False) -> Plant:
        """The plant of one lane, with its parameters and what is in its hands; `simple`: told with fewer operations."""
        arm = self.varied.model(told["p"]) if self.varied is not None and "p" in told else self.arm
        for k, frame in enumerate(self.hands if "payload" in told else ()):
            arm = carrying(arm, frame, told["payload"][10 * k : 10 * k + 10])
        return Plant.of(simplified(arm) if simple else arm, brakes="brake" in self.inputs)

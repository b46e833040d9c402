"""A tick and what follows from its rows as native code, to be run by any scenario that asks for the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from armwright.errors import ScenarioError
from armwright.kernels.batch import Kernel
from armwright.kernels.compiled import CPU
from armwright.kernels.loop import NativeLoop
from armwright.kernels.stages import Integrate
from armwright.kernels.target import select_target
from armwright.model import Model
from armwright.model.vary import Varied
from armwright.program import Program
from armwright.simulation.integrate.stepping import Adaptivity
from armwright.simulation.loop.config import LoopConfig
from armwright.simulation.loop.plant_programs import plant_outputs, plant_step
from armwright.simulation.loop.tick import Tick, make_tick
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.step_limits import StepLimit

if TYPE_CHECKING:
    from armwright.kernels.cuda_loop import CudaLoop


@dataclass(frozen=True, eq=False)
class CompiledLoop:
    """The loop of an arm in native code.

    Attributes:
        config: what it was made of.   target, device: processor level, and where it runs, as in `compile`.
        tick: the stages of a tick.
        loops: one, or two with the controller's Python between them.   step_limit: the largest step for the arm.
        outputs: (x, u, …) → what is stored beside the state, by `names`; None where only the state is.
    """

    config: LoopConfig
    target: str | None
    tick: Tick
    loops: tuple[NativeLoop, ...]
    step_limit: StepLimit
    outputs: Kernel | None
    names: tuple[str, ...]
    device: str = CPU

    @classmethod
    def of(
        cls, config: LoopConfig, target: str | None, *, outputs: bool = True, runs: bool = True, device: str = CPU
    ) -> CompiledLoop:
        """Compiles a tick; `outputs`: and what follows from its rows; `runs` False: its stages alone, which then cannot run.

        Raises:
            ModelError: a drive without the constants that its command needs; no such device.
            ScenarioError: what a GPU does not do.
        """
        tick, chosen = make_tick(config), select_target(target)
        stages = [tick.before, tick.after] if tick.untraced is not None else [(*tick.before, *tick.after)]
        # What one lane's friction or step asks for is done in all lanes of its tile: the fewer these are, the less.
        tile = chosen if config.bare.sticking is not None or config.is_ahead else chosen.doubled()
        if device == CPU or not runs:
            loops = tuple(NativeLoop(part, tile, runs=runs) for part in stages)
        else:
            loops = (_on_gpu(config, tick, device),)
        program, names = plant_outputs(config) if outputs else (None, ())
        kernel = None if program is None else Kernel(program, chosen)
        return cls(config, target, tick, loops, StepLimit(config.arm), kernel, names, device)

    @property
    def arm(self) -> Model:
        """The arm that it was compiled for."""
        return self.config.arm

    @property
    def device_words(self) -> dict[str, str]:
        """The GPU that it runs on, as a run says what it was made with; nothing of the CPU."""
        return {} if self.device == CPU else {"device": self.device}

    @property
    def step(self) -> Program:
        """One step of the plant:  (x, u, …, h) → x_next; rules that choose their steps have none."""
        stage = next(stage for stage in self.loops[-1].stages if isinstance(stage, Integrate))
        return plant_step(self.config) if stage.switching else stage.step

    def check(self, config: LoopConfig, target: str | None, device: str = CPU, *, outputs: bool = True) -> None:
        """Refuses a scenario's loop that is another one, or has other inputs.

        Args:
            config, target, device: of the scenario.   outputs: whether it asks for what follows from rows.
        Raises:
            ScenarioError: names what differs.
        """
        pairs = [
            (name, getattr(self.config, name), getattr(config, name)) for name in ("arm", "integrator", "adaptivity")
        ]
        pairs += [("target", self.target, target), ("device", self.device, device)]
        names = [() if each.varied is None else each.varied.names for each in (self.config, config)]
        pairs.append(("varying", list(names[0]), list(names[1])))
        for name, known, asked in pairs:
            if known is not asked and known != asked and asked is not None:
                what = f"compiled for {name} = {known}, not for the scenario's {asked}"
                raise ScenarioError(what, place="loop", expected=f"compile_loop with the scenario's {name}")
        same = dict(config.inputs) == dict(self.config.inputs) and config.payload_frames == self.config.payload_frames
        if extra := _beside_commands(config, inputs=not same):
            what = f"compiled for commands over time alone, not for the scenario's {extra[0]}"
            raise ScenarioError(what, place="loop", expected="a simulation without `loop`")
        extra = _beside_commands(self.config, inputs=not same)
        if outputs and self.outputs is None:
            extra.append("recorded states alone")
        if extra:
            expected = "one for commands over time alone, as compile_loop returns"
            raise ScenarioError(f"compiled for {extra[0]}", place="loop", expected=expected)


def _on_gpu(config: LoopConfig, tick: Tick, device: str) -> CudaLoop:
    """The loop of a tick on a GPU.

    Raises:
        ScenarioError: a controller in Python, commands from outside, events, or CVODES.   ModelError: no such GPU.
    """
    from armwright.kernels.cuda_device import Gpu, gpu_index
    from armwright.kernels.cuda_loop import CudaLoop

    reason = None
    if config.integrator == "cvodes":
        reason = "solver.integrator = 'cvodes' runs on the CPU"
    elif config.adaptivity is not None and config.adaptivity.events:
        reason = "solver.events are found on the CPU"
    elif tick.untraced is not None:
        reason = f"a loop with Python between its stages runs on the CPU ({tick.untraced})"
    if reason is not None:
        raise ScenarioError(reason, place="solver.device", value=device, expected=CPU)
    return CudaLoop((*tick.before, *tick.after), Gpu(gpu_index(device)))


def _beside_commands(config: LoopConfig, *, inputs: bool) -> list[str]:
    """Parts of a tick that commands over time alone do not have; `inputs`: its inputs among them."""
    parts = [name for name in ("sampling", "reduction") if getattr(config, name) is not None]
    return parts + (list(config.inputs) if inputs else [])


def compile_loop(
    arm: Model,
    integrator: str = "rk3",
    target: str | None = None,
    adaptivity: Adaptivity | None = None,
    varied: Varied | None = None,
) -> CompiledLoop:
    """The loop of an arm under commands over time, for any scenario with the same arm, integrator and target.

    Args:
        arm: the model.   integrator: a name of `integrators.RULES`.   target: processor level, as in `compile`.
        adaptivity: how "rk45" or "rodas3" chooses its steps, as `Solver.adaptivity` says.
        varied: the same arm with parameters left open, which are then a block "p" of the loop.
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    recorded = {"x": Plant.of(arm).layout}
    return CompiledLoop.of(LoopConfig(arm, varied, integrator, adaptivity, recorded=recorded), target)

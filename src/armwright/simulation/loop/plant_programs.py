"""Programs of the plant in a loop, which take a lane's inputs and varied parameters: its step, its slope, its outputs.

All of them take the arguments (x, u, …) of `LoopConfig.plant_blocks`, then the contacts and directions of motion that are held.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from armwright.kernels.stages import NEXT, TURNS, Adapt, Integrate, Stage, Turn
from armwright.program import Program, kept, trace
from armwright.scalar import Array
from armwright.simulation.integrate import dormand_prince, rosenbrock
from armwright.simulation.integrate.integrators import INTEGRATORS, ORDER_OF_ERROR, PAIR
from armwright.simulation.integrate.rosenbrock import rodas3_trial
from armwright.simulation.integrate.stepping import adaptive_stage, dormand_prince_trial, speed_pairs
from armwright.simulation.loop.config import LoopConfig
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.saltation import landing_programs
from armwright.simulation.plant.slopes import plant_slopes
from armwright.simulation.plant.sticking import Sticking
from armwright.simulation.plant.switching import Switching, Watched, switching_programs

USUAL = ("qdd", "tau", "voltage", "current")  # stored of every arm
ORDERS = {"rk45": dormand_prince.ORDER, "rodas3": rosenbrock.ORDER}  # of the errors that rules estimate, in h
NOTHING: Mapping[str, tuple[int, ...]] = {}


def plant_stages(config: LoopConfig, seen: tuple[str, ...]) -> list[Stage]:
    """The stage that moves the plant; none where CVODES does."""
    delays = None if config.sampling is None else config.sampling.delays
    planned = delays.pending + 2 if delays is not None and delays.fractional else 0
    watched = plant_watched(config)
    if config.integrator in INTEGRATORS:
        step = plant_step(config, {} if watched is None else watched.block)
        programs: dict[str, Any] = {**switching_programs(watched, config.plant_shapes)}
        if config.lands and watched is not None:
            programs = {name: program for name, program in programs.items() if name != "settle"}
            programs |= _landing(config, watched)
        return [Integrate(step, planned, seen, **programs, turn=plant_turn(config))]
    if config.integrator == "cvodes":
        return []
    assert config.adaptivity is not None
    key = ("adaptive", config.structure, config.adaptivity, config.is_ahead, planned, seen)
    if config.adaptivity.events:  # functions of the user's, traced each time
        stage = _adaptive(config, watched, planned, seen)
    else:
        stage = kept(key, lambda: _adaptive(config, watched, planned, seen))
    return [replace(stage, turn=plant_turn(config))]


def _adaptive(config: LoopConfig, watched: Watched | None, planned: int, seen: tuple[str, ...]) -> Adapt:
    """The stage of a rule that chooses its steps."""
    assert config.adaptivity is not None
    trial, layout = plant_trial(config, watched), config.bare.layout
    order = ORDERS.get(config.integrator, ORDER_OF_ERROR)
    lands = config.bare.sticking is not None and not config.is_ahead
    settings = (config.adaptivity, layout, planned, seen, watched, order)
    return adaptive_stage(trial, config.plant_shapes, *settings, lands=lands, ahead=config.is_ahead)


def plant_turn(config: LoopConfig) -> Turn | None:
    """Turns of the servos' loops and their times; None of an arm without any."""
    if config.bare.turn is None:
        return None

    def turned(x: Array, u: Array, *rest: Array) -> Array:
        *given, turns = rest
        plant, inputs = config.plant_call(u, given)
        return plant.turned(x, inputs, turns[0])

    shapes = {**config.plant_shapes, TURNS: (1,)}
    program = kept(("turn", config.structure), lambda: trace("turn", turned, shapes, (f"x{NEXT}",)))
    return Turn(program, config.bare.turn)


def of_plant(config: LoopConfig, method: Callable[[Plant, Array, PlantInputs], Any]) -> Callable[..., Any]:
    """(x, u, …) → what a function of a plant, its state and its inputs gives for the lane's.

    Behind its inputs and parameters it takes the contacts that count as closed, where they do not follow from x.
    """

    def function(x: Array, u: Array, *rest: Array) -> Any:
        plant, inputs = config.plant_call(u, rest)
        return method(plant, x, inputs)

    return function


def plant_derivative(config: LoopConfig) -> Callable[..., Array]:
    """(x, u, …) → dx/dt of the arm with the lane's inputs and parameters."""
    return of_plant(config, Plant.derivative)


def plant_step(config: LoopConfig, contacts: Mapping[str, tuple[int, ...]] = NOTHING) -> Program:
    """The plant's step, with its inputs and the arm's varied parameters behind x and u, then its contacts, if these are held."""
    key = ("step", config.structure, tuple(contacts.items()))
    return kept(key, lambda: _plant_step(config, contacts))


def _plant_step(config: LoopConfig, contacts: Mapping[str, tuple[int, ...]]) -> Program:
    rule = INTEGRATORS[config.integrator].paired(speed_pairs(config.bare.layout))

    def step(x: Array, u: Array, *rest: Array) -> Array:
        *inputs, h = rest
        plant, plant_inputs = config.plant_call(u, inputs)
        return plant.step(rule, x, plant_inputs, h)

    return trace("step", step, {**config.plant_shapes, **contacts, "h": ()}, (f"x{NEXT}",))


def plant_trial(config: LoopConfig, watched: Watched | None) -> Callable[..., tuple[Array, ...]]:
    """(x, u, …, h) → x⁺, its error, and the path where events need one: a step of a rule that estimates how wrong it is."""
    sticking, shapes = config.bare.sticking, config.plant_shapes | ({} if watched is None else watched.block)
    if sticking is None or config.is_ahead:  # directions are held as contacts are
        return _smooth_trial(config, shapes)
    held = _smooth_trial(config, {**shapes, "directions": (len(sticking.places),)})

    def landing(x: Array, u: Array, *rest: Array) -> tuple[Array, ...]:
        *given, h = rest
        plant, inputs = config.plant_call(u, given)
        assert plant.sticking is not None
        directions = plant.sticking.present(x, inputs)
        new, error, *others = held(x, u, *given, directions, h)
        return plant.sticking.landed(x, replace(inputs, directions=directions), new, error, h, others)

    return landing


def _smooth_trial(config: LoopConfig, shapes: Mapping[str, tuple[int, ...]]) -> Callable[..., tuple[Array, ...]]:
    """The same for an arm that never sticks, or with directions of motion held, as the last of the arguments of those shapes."""
    derivative = plant_derivative(config)
    if config.integrator == "rk45":
        return dormand_prince_trial(derivative, shapes)
    if config.integrator == "rodas3":
        lands = config.adaptivity is not None and bool(config.adaptivity.events)
        return rodas3_trial(derivative, of_plant(config, plant_slopes), shapes, config.bare.settled, lands)

    def pair(x: Array, u: Array, *rest: Array) -> tuple[Array, ...]:
        *inputs, h = rest
        plant, plant_inputs = config.plant_call(u, inputs)
        return plant.step_with_error(PAIR, x, plant_inputs, h)

    return pair


def plant_watched(config: LoopConfig) -> Watched | None:
    """The plant's switching functions within steps; None of an arm that has no stops and no play.

    Steps that go on beyond their ticks end where something begins to stick or breaks loose, too.
    """

    def of_sticking(law: Callable[[Sticking, Array, PlantInputs], Array]) -> Callable[..., Array]:
        def function(plant: Plant, x: Array, inputs: PlantInputs) -> Array:
            assert plant.sticking is not None
            return law(plant.sticking, x, inputs)

        return of_plant(config, function)

    depths = of_plant(config, lambda plant, x, inputs: plant.contact_depths(x))
    functions = of_plant(config, Plant.switching_functions)
    contacts, sticking = sum(config.bare.contacts), config.bare.sticking
    if sticking is not None and (config.is_ahead or config.lands):
        laws = (Sticking.present, Sticking.sliding, Sticking.keeping, Sticking.settled)
        return Watched(depths, functions, contacts, len(sticking.places), *map(of_sticking, laws))
    return Watched(depths, functions, contacts) if contacts else None


def _landing(config: LoopConfig, watched: Watched) -> dict[str, Program]:
    """The programs of the end of a step at which something switches."""

    def at_rest(x: Array, inputs: Sequence[Array], directions: Array) -> Array:
        sticking = config.plant_call(inputs[0], inputs[1:])[0].sticking
        return x if sticking is None else sticking.at_rest(x, directions)

    return landing_programs(Switching(watched, config.plant_shapes), plant_derivative(config), at_rest)


def plant_outputs(config: LoopConfig) -> tuple[Program, tuple[str, ...]]:
    """Outputs from state, commands, inputs and parameters, for all recorded rows at once; and its names."""
    return kept(("outputs", config.structure, config.sampling is None), lambda: _plant_outputs(config))


def _plant_outputs(config: LoopConfig) -> tuple[Program, tuple[str, ...]]:
    names: list[str] = []

    def outputs(x: Array, u: Array, *rest: Array) -> tuple[Array, ...]:
        plant, inputs = config.plant_call(u, rest)
        outputs = plant.outputs(x, inputs)
        if config.sampling is None and plant.is_plain:  # the motors alone: what else there is follows from these
            outputs = {name: values for name, values in outputs.items() if name in USUAL}
        names[:] = outputs
        return tuple(outputs.values())

    return trace("outputs", outputs, config.plant_shapes, names), tuple(names)

"""Model exchange: dx/dt and outputs of the plant for the tool's own solver, with events at the begin and end of contacts.

Contacts (joints in their stops, flanks of gears with play) are held between events, so that a solver sees smooth functions only.
An indicator is a contact's depth, shifted by `BAND` to the side that was left: at an event it is certain which side that is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.export.fmu.model import CREATE, model_header, variable_table
from armwright.export.fmu.sampled import UnrecordedLoop, acting_layout, lane_values, plant_alone
from armwright.export.fmu.variables import Variable, variables_of
from armwright.kernels.c import Unit, c_text
from armwright.kernels.c_loop import LoopClock, LoopText
from armwright.kernels.c_syntax import C_DOUBLE, identifier
from armwright.kernels.stages import SEEN, Call
from armwright.model import Model
from armwright.model.joint_signals import joint_signal
from armwright.program import Program, interpret, trace
from armwright.program.derivative import with_tangents
from armwright.scalar import Array
from armwright.signals import Layout, Signal
from armwright.simulation.loop.config import LoopConfig
from armwright.simulation.loop.plant_programs import plant_watched
from armwright.simulation.scenario import Scenario

BAND = 1e-10  # [rad | m] of an indicator about a contact's beginning: far below what a solver resolves
#: Outputs beside the state, with the quantity that has their unit.
OUTPUTS = {"tau": "tau", "voltage": "voltage", "current": "current", "tau_link": "tau", "electrical_power": "W"}
SMOOTH = ("x", "u", "wrench")  # what derivatives are taken by

_TANGENT = """\
void model_tangent(const model_state *l, const model_direction *along, model_direction *result)
{{
    double {arrays};
{lines}
}}"""


@dataclass(frozen=True, eq=False)
class ContinuousModel:
    """Programs and variables of an FMU for model exchange.

    Attributes:
        arm: the model.   about: for the user.
        dynamics: (x, u, …, touching?) → xd, outputs, z?.   contacts: (x, u, …) → touching, None of an arm without.
        begin: (start, p, payload) → x, as the simulation begins.   tangent: of xd and outputs along directions of `SMOOTH`.
        blocks: initial values by name.   variables: all but time.   indicators: names of those that are events.
    """

    arm: Model
    about: str
    dynamics: Program
    contacts: Program | None
    begin: Program
    tangent: Program
    blocks: Mapping[str, np.ndarray]
    variables: tuple[Variable, ...]
    indicators: tuple[str, ...]


def continuous_model(scenario: Scenario) -> ContinuousModel:
    """The plant of a scenario for model exchange.

    Raises:
        ScenarioError: as `sampled_model`; an arm whose friction or gear loss sticks.
    """
    scenario = plant_alone(scenario)
    loop = UnrecordedLoop(scenario)
    config, arm, plant = loop.config, loop.arm, loop.plant
    if plant.sticking is not None:
        what = "has friction or gear loss that sticks, which is no function of the state"
        expected = "a record with a smoothing speed in `friction`, or interface = 'co-simulation'"
        raise ScenarioError(what, place="arm", value=arm.name, expected=expected)
    loop.begin(loop.lanes(1), None)
    first = loop.initial
    values = {"x": first["x"], "u": first["u"], "p": first["p"]}
    values |= {name: first[f"{name}{SEEN}"] for name in config.inputs}
    dynamics, smooth, contacts, layout = _programs(config, arm, values)
    active = [port.name for port in dynamics.inputs if port.name in SMOOTH]
    values["start"] = scenario.initial_state[0]
    variables, indicators = _variables(loop, scenario, layout, values, contacts is not None)
    begin = _beginning(config, arm, values)
    ports = (*dynamics.inputs, *dynamics.outputs, *begin.inputs)
    blocks = {port.name: values.get(port.name, np.zeros(port.size)) for port in ports if port.size}
    return ContinuousModel(
        arm, f"the arm {arm.name}, for the solver of the tool", dynamics, contacts, begin,
        with_tangents(smooth, active, {}, 1), blocks, variables, indicators,
    )  # fmt: skip


def _programs(
    config: LoopConfig, arm: Model, values: Mapping[str, np.ndarray]
) -> tuple[Program, Program, Program | None, Layout]:
    """Dynamics, the same without indicators, contacts, and the layout of those outputs that the record has the numbers for."""
    watched, shapes = plant_watched(config), config.plant_shapes
    held = {} if watched is None else watched.block
    known: dict[str, tuple[int, ...]] = {name: tuple(range(arm.n)) for name in OUTPUTS}

    def outputs(x: Array, u: Array, *rest: Array) -> tuple[Array, ...]:
        plant, inputs = config.plant_call(u, rest)
        found = plant.outputs(x, inputs)
        return tuple(scalar.array([found[name][j] for j in known[name]]) for name in OUTPUTS if known[name])

    numbers = [values.get(name, np.zeros(shape)) for name, shape in {**shapes, **held}.items()]
    every = interpret(trace("outputs", outputs, {**shapes, **held}, tuple(OUTPUTS)), *numbers)
    for name, row in zip(OUTPUTS, every, strict=True):
        known[name] = tuple(int(j) for j in np.flatnonzero(~np.isnan(np.ravel(row))))
    signals = [joint_signal(arm, name, OUTPUTS[name], _about(name), known[name]) for name in OUTPUTS if known[name]]

    def smooth(x: Array, u: Array, *rest: Array) -> tuple[Array, ...]:
        plant, inputs = config.plant_call(u, rest)
        return plant.derivative(x, inputs), *outputs(x, u, *rest)

    names = ["xd", *(signal.name for signal in signals)]
    program = trace("dynamics", smooth, {**shapes, **held}, names)
    if watched is None:
        return program, program, None, Layout.of(signals)

    def dynamics(x: Array, u: Array, *rest: Array) -> tuple[Array, ...]:
        depths = zip(watched.depths(x, u, *rest[:-1]), rest[-1], strict=True)
        shifted = [depth + BAND * (2.0 * touching - 1.0) for depth, touching in depths]
        return *smooth(x, u, *rest), scalar.array(shifted)

    def contacts(x: Array, *rest: Array) -> Array:
        return scalar.array([scalar.less_equal(0.0, depth) for depth in watched.depths(x, *rest)])

    indicated = trace("dynamics", dynamics, {**shapes, **held}, [*names, "z"])
    return indicated, program, trace("contacts", contacts, shapes, ("touching",)), Layout.of(signals)


def _beginning(config: LoopConfig, arm: Model, values: Mapping[str, np.ndarray]) -> Program:
    """Initial state from positions and speeds (2n,) of the joints: motors, currents and temperatures as a simulation begins."""

    def begin(start: Array, p: Array, payload: Array) -> Array:
        return scalar.array(config.plant({"p": p, "payload": payload}).initial(start[: arm.n], start[arm.n :]))

    shapes = {"start": (2 * arm.n,), "p": values["p"].shape, "payload": (10 * len(config.payload_frames),)}
    return trace("begin", begin, shapes, ("x",))


def _about(name: str) -> str:
    return {"tau_link": "torque that leaves the gear", "electrical_power": "electrical power into the drive"}.get(
        name, ""
    )


def _variables(
    loop: UnrecordedLoop, scenario: Scenario, outputs: Layout, values: Mapping[str, np.ndarray], touches: bool
) -> tuple[tuple[Variable, ...], tuple[str, ...]]:
    """All variables but time, and the names of event indicators."""
    joints, state = loop.arm.names, loop.plant.layout
    rows = variables_of(scenario.command_layout, joints, "u", "input", "continuous", starts=values["u"])
    for name in loop.config.inputs:
        variability = "continuous" if name == "wrench" else "discrete"
        rows += variables_of(acting_layout(loop, name), joints, name, "input", variability, starts=values[name])
    rows += lane_values(loop, "plant")
    begun = Layout((joint_signal(loop.arm, "q"), joint_signal(loop.arm, "qd")))
    rows += variables_of(
        begun, joints, "start", "parameter", "fixed", prefix="start", starts=values["start"], about="initial"
    )
    states = variables_of(
        state, joints, "x", "output", "continuous", prefix="x", starts=values["x"], about="true", states=True
    )
    rows += states
    for k, each in enumerate(states):
        unit = f"{each.unit}/s" if "/" not in each.unit else {"rad/s": "rad/s²", "m/s": "m/s²"}.get(each.unit, "-")
        about = f"time derivative of {each.name}"
        rows.append(Variable(f"der({each.name})", "local", "continuous", unit, about, "xd", k, derivative_of=each.name))
    for signal in outputs:
        rows += variables_of(Layout((signal,)), joints, identifier(signal.name), "output", "continuous")
    indicators: list[Variable] = []
    if touches:
        layout = Layout((Signal("contact", "-", (sum(loop.plant.contacts),), about="depth of a contact"),))
        indicators = variables_of(layout, joints, "z", "local", "continuous")
    return (*rows, *indicators), tuple(each.name for each in indicators)


def continuous_source(model: ContinuousModel, token: str) -> dict[str, str]:
    """The texts of model.h and model.c of a model for model exchange."""
    unit = Unit(C_DOUBLE, "model_")
    programs = [model.begin, model.dynamics, *([] if model.contacts is None else [model.contacts])]
    loop = LoopText(unit, [Call(program) for program in programs], "model_state", LoopClock(1.0))
    event = "(void)l;" if model.contacts is None else loop.call(model.contacts)
    outputs = loop.call(model.dynamics)
    unit.functions["model_outputs"] = f"void model_outputs(model_state *l)\n{{\n    {outputs}\n}}"
    unit.functions["model_event"] = f"void model_event(model_state *l)\n{{\n    {event}\n}}"
    begin = loop.call(model.begin)
    unit.functions["model_begin"] = f"void model_begin(model_state *l)\n{{\n    {begin}\n    model_event(l);\n}}"
    unit.functions["model_tangent"] = _tangent(model, loop)
    places = {name: _places(ports) for name, ports in (("known", _knowns(model)), ("unknown", _unknowns(model)))}
    known = {each.name: places["known"].get((each.member, each.entry), -1) for each in model.variables}
    unknown = {each.name: places["unknown"].get((each.member, each.entry), -1) for each in model.variables}
    unit.functions["model_create"] = CREATE.format(rows=",\n".join(f"    {row}" for row in loop.initial(model.blocks)))
    unit.functions["model_variables"] = variable_table(model.variables, known, unknown)
    longest = max(len(each) for each in places.values())
    functions = (
        "\n/* A direction of states and inputs, or of derivatives and outputs. */\n"
        f"typedef struct {{\n    double values[{longest}];\n}} model_direction;\n\n"
        "void model_outputs(model_state *l);\nvoid model_event(model_state *l);\n"
        "void model_tangent(const model_state *l, const model_direction *along, model_direction *result);"
    )
    sizes = {port.name: port.size for port in (*model.dynamics.inputs, *model.dynamics.outputs)}
    constants = {"MODEL_STATES": f"{sizes['x']}u", "MODEL_INDICATORS": f"{sizes.get('z', 0)}u"}
    return {
        "model.h": model_header(token, model.variables, loop.members({}), constants, functions),
        "model.c": c_text(unit, ['"model.h"', "<string.h>"]),
    }


def _knowns(model: ContinuousModel) -> list[tuple[str, int]]:
    return [(port.name, port.size) for port in model.dynamics.inputs if port.name in SMOOTH]


def _unknowns(model: ContinuousModel) -> list[tuple[str, int]]:
    return [(port.name, port.size) for port in model.dynamics.outputs if port.name != "z"]


def _places(ports: list[tuple[str, int]]) -> dict[tuple[str, int], int]:
    """Place of every entry of some members in one vector."""
    entries = [(name, k) for name, size in ports for k in range(size)]
    return {entry: place for place, entry in enumerate(entries)}


def _tangent(model: ContinuousModel, loop: LoopText) -> str:
    """`model_tangent`: values and directions side by side into the program, the directions of its results out of it."""
    arrays, lines, places, first = [], [], {}, 0
    for name, size in _knowns(model):
        arrays.append(f"in_{name}[{2 * size}]")
        places[name] = f"in_{name}"
        lines += [
            f"memcpy(in_{name}, l->{name}, sizeof l->{name});",
            f"memcpy(&in_{name}[{size}], &along->values[{first}], sizeof l->{name});",
        ]
        first += size
    ends, first = [], 0
    for name, size in _unknowns(model):
        arrays.append(f"out_{name}[{2 * size}]")
        ends.append(f"memcpy(&result->values[{first}], &out_{name}[{size}], {size} * sizeof(double));")
        first += size
    outer = {f"{port.name}": f"out_{port.name}" for port in model.tangent.outputs}
    lines += [loop.call(model.tangent, {**places, **outer}), *ends]
    return _TANGENT.format(arrays=", ".join(arrays), lines="\n".join(f"    {line}" for line in lines))

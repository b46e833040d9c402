"""Co-simulation: the exported parts of a simulated loop, with the variables at their borders.

    u ─→ delay, drives, arm ─→ sensors ─→ y          "plant"
    y, r ─→ controller, rate limit, limit, resolution ─→ u    "controller"
    r ─→ both, one after the other ─→ y, u          "both"

All of it are the stages that the simulation is compiled from. A step takes the inputs as they are at its beginning; its outputs
are what it has at its end. A plant measures at the end of a step, so that its outputs belong to the time that was reached.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.export.controller.stages import check_one_arm, traced_beginning
from armwright.export.fmu.variables import FmuVariable, quoted, variables_of
from armwright.kernels.c_loop import LoopClock
from armwright.kernels.stages import SEEN, Call, DelayStage, RecordStage, RowsStage, Stage, TableStage
from armwright.model import Body, Model
from armwright.model.joint_signals import joint_signal
from armwright.program import Program
from armwright.signals import Layout, Signal
from armwright.simulation.inputs.input_schedule import WRENCH, all_rows
from armwright.simulation.integrate.stepping import places_watched
from armwright.simulation.loop.compiled import CompiledLoop
from armwright.simulation.loop.config import LoopConfig
from armwright.simulation.loop.initialisation import BEGUN, Initialisation
from armwright.simulation.loop_runner import LoopRunner
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Loop, Recording

PARTS = ("plant", "controller", "both")
INERTIA = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")  # of a payload about its frame's origin
INERTIA_UNITS = ("kg", *["kg m"] * 3, *["kg m²"] * 6)
SWITCHES: Mapping[str, tuple[Callable[[Body], Any], str]] = {  # input → what of a joint it switches, where it has that
    "brake": (lambda body: body.brake, "1: the holding brake is applied, 0: released"),
    "enabled": (lambda body: body.drive.firmware, "1: the servo is on, 0: off"),
}


class UnrecordedLoop(LoopRunner):
    """A scenario's loop without recording, for printing only."""

    def _compiled(self, target: str | None, *, outputs: bool) -> CompiledLoop:
        return CompiledLoop.of(self.config, target, outputs=False, runs=False)

    def _configured(self) -> tuple[LoopConfig, Initialisation]:
        config, initialisation = super()._configured()
        return replace(config, recorded={}, reduction=None), initialisation


@dataclass(frozen=True, eq=False)
class SampledModel:
    """Programs and variables of an FMU for co-simulation.

    Attributes:
        part: of `PARTS`.   arm: the model.   clock: of its ticks.   about: for the user.
        begin: the program that computes initial values.   arguments: members that hold its inputs, by port.
        begun: blocks that its results fill, by name.   filled: rings that are filled from blocks, by name.
        control, move, measure: stages of a tick, in this order, without those of other parts.
        entering: (block, member) that a tick begins with.   blocks: initial values, which `begin` may replace.
        inputs: initial values of the members that inputs and parameters are written into, by name.   variables: all but time.
        ranged: entries of x whose ranges the solver's steps are measured by.
    """

    part: str
    arm: Model
    clock: LoopClock
    about: str
    begin: Program
    arguments: Mapping[str, str]
    begun: Mapping[str, str]
    filled: Mapping[str, str]
    control: tuple[Stage, ...]
    move: tuple[Stage, ...]
    measure: tuple[Stage, ...]
    entering: tuple[tuple[str, str], ...]
    blocks: Mapping[str, np.ndarray]
    inputs: Mapping[str, np.ndarray]
    variables: tuple[FmuVariable, ...]
    ranged: tuple[int, ...]

    @property
    def stages(self) -> tuple[Stage, ...]:
        """All stages of a tick."""
        return (*self.control, *self.move, *self.measure)


def sampled_model(scenario: Scenario, part: str) -> SampledModel:
    """The exported part of a scenario's loop for co-simulation.

    Raises:
        ScenarioError: several lanes; a start that goes on from a state; no controller, or one that cannot be traced, where
            one is asked for; a solver that is no stage of the loop.
    """
    loop = _printed_loop(scenario, part)
    scenario, sampling = loop.scenario, loop.config.sampling
    assert sampling is not None
    law = None if part == "plant" else traced_beginning(loop, sampling)  # which says why a controller cannot be traced
    lanes = loop.lanes(1)
    loop.begin(lanes, None)
    first = loop.initial
    control, shape, move, measure = _split((*loop.loop.tick.before, *loop.loop.tick.after))
    borders = _borders(loop, part, first, late=all(port.name != "u" for port in shape.program.outputs))
    controller = part == "controller"
    own, plant = () if part == "plant" else (*control, shape), () if controller else (*move, *measure)
    kept = {"y_old": "y_kept", "u": "u", "u_queued": "u"}
    blocks = {name: lanes.get(name)[0] for name in lanes.blocks}
    extra = {name: first[name] for name in ("c", "p", "c_sensors") if name in first and name not in blocks}
    begin, begun = (law, {"s": "s"}) if controller else (loop.initialisation.program, BEGUN)
    assert begin is not None
    return SampledModel(
        part,
        loop.arm,
        LoopClock(loop.period, scenario.substeps, scenario.seed, scenario.first_lane),
        _about(scenario, part, loop),
        begin,
        {port.name: borders.arguments[port.name] for port in begin.inputs if port.size},
        begun,
        {stage.to: kept[stage.to] for stage in (*own, *plant) if isinstance(stage, DelayStage)},
        own,
        () if controller else tuple(move),
        () if controller else tuple(measure),
        tuple(borders.entering),
        {**blocks, **{name: values for name, values in extra.items() if values.size}},
        {name: values for name, values in borders.inputs.items() if values.size},
        tuple(borders.variables),
        tuple(places_watched(loop.plant.layout, loop.config.is_ahead))
        if "x_first" in blocks and not controller
        else (),
    )


def _printed_loop(scenario: Scenario, part: str) -> UnrecordedLoop:
    """The loop whose stages are printed.

    Raises:
        ScenarioError: as `sampled_model`.
    """
    sampled = scenario.sampled  # or a plant under commands over time, whose steps are then those of their run
    scenario = plant_alone(scenario) if part == "plant" else _bare(scenario)
    if part != "plant" and scenario.controller is None:
        raise ScenarioError(
            "no controller", place="loop.controller", expected="one to export; an FMU of the plant needs none"
        )
    loop = UnrecordedLoop(scenario, sampled=sampled)
    if loop.config.integrator == "cvodes":
        raise ScenarioError(
            "is not part of the code", place="solver.integrator", value="cvodes", expected="'auto' or another rule"
        )
    return loop


@dataclass(eq=False)
class _Borders:
    """Members for the inputs of a part, its variables, blocks that enter a tick, and arguments of its beginning."""

    joints: Sequence[str]
    inputs: dict[str, np.ndarray] = field(default_factory=dict)
    variables: list[FmuVariable] = field(default_factory=list)
    entering: list[tuple[str, str]] = field(default_factory=list)
    arguments: dict[str, str] = field(default_factory=dict)

    def add(
        self, layout: Layout, member: str, values: np.ndarray, *kind: str, prefix: str = "", about: str = ""
    ) -> None:
        """Adds inputs or parameters: `kind` is their causality and variability."""
        self.inputs[member] = starts = np.ravel(values)
        self.variables += variables_of(layout, self.joints, member, *kind, starts=starts, prefix=prefix, about=about)


def _borders(loop: UnrecordedLoop, part: str, first: Mapping[str, np.ndarray], *, late: bool) -> _Borders:
    """The borders of a part, with the values `first` of its blocks; `late`: commands wait for their turn."""
    sampling, reference, command = loop.config.sampling, loop.reference, loop.scenario.command_layout
    assert sampling is not None
    assert reference is not None
    arguments = {"c": "c", "p": "p", "c_sensors": "c_sensors", **{name: f"in_{name}" for name in loop.config.inputs}}
    borders, y = _Borders(loop.arm.names, arguments=arguments), sampling.sensors.y
    if part == "plant":
        borders.add(command, "in_u", first["u"], "input", "discrete")
        borders.entering += [("u_issued", "in_u"), *([] if late else [("u", "in_u")])]
    else:
        r = reference.layout
        borders.add(r, "in_r", _reference(loop, r), "input", "discrete", prefix="r", about="reference:")
        borders.entering.append(("r", "in_r"))
    if part == "controller":
        borders.add(y, "in_y", first["y"], "input", "discrete", prefix="y")
        borders.entering.append(("y", "in_y"))
        borders.add(
            command, "in_u_start", first["u"], "parameter", "fixed", prefix="start", about="in force at the start:"
        )
        borders.arguments |= {"y": "in_y"}
    else:
        _add_plant(borders, loop, first)
        borders.variables += variables_of(y, borders.joints, "y", "output", "discrete", prefix="y")
        x = loop.plant.layout
        borders.variables += variables_of(x, borders.joints, "x", "output", "discrete", prefix="x", about="true")
    if part != "plant":
        borders.variables += variables_of(command, borders.joints, "u_issued", "output", "discrete")
    borders.variables += lane_values(loop, part)
    return borders


def _add_plant(borders: _Borders, loop: UnrecordedLoop, first: Mapping[str, np.ndarray]) -> None:
    """Adds what acts on the plant, and the state and command that it begins with."""
    for name in loop.config.inputs:
        borders.add(acting_layout(loop, name), f"in_{name}", first[f"{name}{SEEN}"], "input", "discrete")
        borders.entering.append((name, f"in_{name}"))
    start = loop.scenario.initial_state[0]
    layout = Layout((joint_signal(loop.arm, "q"), joint_signal(loop.arm, "qd")))
    if len(start) == layout.size:
        borders.add(layout, "in_start", start, "parameter", "fixed", prefix="start", about="initial")
    borders.arguments["start"] = "in_start"
    borders.inputs.setdefault("in_start", start)
    if loop.scenario.first_command is not None:
        borders.inputs["in_u_start"] = first["u"]
        borders.arguments["u"] = "in_u_start"


def _bare(scenario: Scenario) -> Scenario:
    """The scenario without what is recorded and looked for.

    Raises:
        ScenarioError: as `sampled_model`.
    """
    check_one_arm(scenario)
    if scenario.solver.events:
        scenario = replace(scenario, solver=replace(scenario.solver, events={}))
    return replace(scenario, recording=Recording())


def plant_alone(scenario: Scenario) -> Scenario:
    """The scenario without controller and reference; commands come from outside, once a tick.

    Raises:
        ScenarioError: as `sampled_model`.
    """
    loop = scenario.loop
    if loop is None:
        loop = Loop(period=scenario.tick, initial_command=all_rows(scenario.commands)[0])
    loop = replace(loop, controller=None, reference=None, period=loop.period or scenario.tick)
    inputs = replace(scenario.inputs, payload=scenario.carried)  # what the reference takes up stays an input without it
    return _bare(replace(scenario, loop=loop, command=None, inputs=inputs))


def _split(stages: tuple[Stage, ...]) -> tuple[Sequence[Stage], Call, Sequence[Stage], Sequence[Stage]]:
    """Stages of the controller, the shaping of its command, of what moves the plant behind it, and of its measurement.

    Rows and tables are none of them: what they bring comes from outside.
    """
    names = [_name(stage) for stage in stages]
    shape, output = names.index("shape"), names.index("tell")
    inside = [
        (k, stage) for k, stage in enumerate(stages) if not isinstance(stage, (RowsStage, TableStage, RecordStage))
    ]
    control = [stage for k, stage in inside if output < k < shape and names[k] == "control"]
    measure = [stage for k, stage in inside if k <= output]
    move = [stage for k, stage in inside if k > shape]
    shaped = stages[shape]
    assert isinstance(shaped, Call)
    return control, shaped, move, measure


def _name(stage: Stage) -> str:
    return stage.program.name if isinstance(stage, Call) else ""


def acting_layout(loop: UnrecordedLoop, name: str) -> Layout:
    """Layout of an optional input of the plant: "wrench", "supply", "brake", "enabled" or "payload"."""
    arm = loop.arm
    if name == "wrench":
        units = ("N",) * 3 + ("N m",) * 3
        return Layout((Signal(name, units, (6,), labels=WRENCH, about="of the environment on the tip, base axes"),))
    if name == "supply":
        return Layout((Signal(name, ("V",), (1,), labels=("voltage",), about="of the supply of all drives"),))
    if name in SWITCHES:
        switched, about = SWITCHES[name]
        joints = tuple(i for i, body in enumerate(arm.coordinates) if switched(body) is not None)
        return Layout((joint_signal(arm, name, "1", about, joints),))
    frames = loop.config.payload_frames
    labels = tuple(f"{frame} {part}" for frame in frames for part in INERTIA)
    units = INERTIA_UNITS * len(frames)
    return Layout((Signal(name, units, (len(units),), labels=labels, about="inertial parameters at frame"),))


def _reference(loop: UnrecordedLoop, layout: Layout) -> np.ndarray:
    """The reference at the first tick."""
    reference = loop.reference
    assert reference is not None
    if reference.table is not None:
        return reference.table[0]
    values = np.zeros(layout.size)
    if "q" in layout:
        values[layout.place("q")] = loop.scenario.initial_state[0, : loop.arm.n]
    return values


def lane_values(loop: UnrecordedLoop, part: str) -> list[FmuVariable]:
    """Values of the batched numbers of record and controller, as parameters."""
    sampling, varied, rows = loop.config.sampling, loop.config.varied, []
    assert sampling is not None
    if varied is not None and part != "controller":
        for k, name in enumerate(varied.names):
            value, about = float(loop.scenario.parameters[0, k]), "number of the record"
            rows.append(FmuVariable(f"p.{quoted(name)}", "parameter", "tunable", "-", about, "p", k, value))
    if part == "plant":
        return rows
    lanes, entry = sampling.controller.lanes, 0
    for name, shape in zip(lanes.names, lanes.shapes, strict=True):
        for k in range(int(np.prod(shape, dtype=int))):
            words = f"c.{quoted(name)}" + (f".at{k}" if shape else "")
            value = float(lanes.values[0, entry])
            rows.append(FmuVariable(words, "parameter", "tunable", "-", "gain of the controller", "c", entry, value))
            entry += 1
    return rows


def _about(scenario: Scenario, part: str, loop: UnrecordedLoop) -> str:
    law = "" if part == "plant" else f" with {loop.controller.name}" if part == "both" else f", {loop.controller.name}"
    whole = {"plant": "the arm", "controller": "the controller of", "both": "the arm"}[part]
    return f"{whole} {scenario.arm.name}{law}, one tick of {loop.period:g} s"

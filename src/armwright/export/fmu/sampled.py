"""Co-simulation: the exported parts of a simulated loop, with the variables at their borders.

    u ─→ delay, drives, arm ─→ sensors ─→ y          "plant"
    y, r ─→ control law, rate limit, limit, resolution ─→ u    "controller"
    r ─→ both, one after the other ─→ y, u          "both"

All of it are the stages that the simulation is compiled from. A step takes the inputs as they are at its beginning; its outputs
are what it has at its end. A plant measures at the end of a step, so that its outputs belong to the time that was reached.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armwright.errors import ScenarioError
from armwright.export.controller.stages import check_one_arm, traced_beginning
from armwright.export.fmu.variables import Variable, quoted, variables_of
from armwright.kernels.c_loop import LoopClock
from armwright.kernels.stages import SEEN, Call, DelayStage, RecordStage, RowsStage, Stage, TableStage
from armwright.model import Model
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
    variables: tuple[Variable, ...]
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
    sampling = loop.config.sampling
    assert sampling is not None
    assert loop.reference is not None
    law = None if part == "plant" else traced_beginning(loop, sampling)  # which says why a law cannot be traced
    lanes = loop.lanes(1)
    loop.begin(lanes, None)
    first = loop.initial
    control, shape, move, measure = _split((*loop.loop.tick.before, *loop.loop.tick.after))
    joints = loop.arm.names
    y, r, command = sampling.sensors.y, loop.reference.layout, scenario.command_layout
    inputs: dict[str, np.ndarray] = {}
    variables: list[Variable] = []

    def add(
        layout: Layout,
        member: str,
        values: np.ndarray,
        causality: str,
        variability: str,
        prefix: str = "",
        about: str = "",
    ) -> None:
        inputs[member] = np.ravel(values)
        variables.extend(
            variables_of(
                layout, joints, member, causality, variability, starts=inputs[member], prefix=prefix, about=about
            )
        )

    entering: list[tuple[str, str]] = []
    arguments = {"c": "c", "p": "p", "c_sensors": "c_sensors", "payload": "in_payload", "wrench": "in_wrench"}
    if part == "plant":
        add(command, "in_u", first["u"], "input", "discrete")
        late = not any(port.name == "u" for port in shape.program.outputs)
        entering += [("u_issued", "in_u"), *([] if late else [("u", "in_u")])]
    else:
        add(r, "in_r", _reference(loop, r), "input", "discrete", prefix="r", about="reference:")
        entering.append(("r", "in_r"))
    if part == "controller":
        add(y, "in_y", first["y"], "input", "discrete", prefix="y")
        entering.append(("y", "in_y"))
    else:
        for name in loop.config.inputs:
            add(acting_layout(loop, name), f"in_{name}", first[f"{name}{SEEN}"], "input", "discrete")
            entering.append((name, f"in_{name}"))
        start = scenario.initial_state[0]
        layout = Layout((joint_signal(loop.arm, "q"), joint_signal(loop.arm, "qd")))
        if len(start) == layout.size:
            add(layout, "in_start", start, "parameter", "fixed", prefix="start", about="initial")
        arguments["start"] = "in_start"
        inputs.setdefault("in_start", start)
        if scenario.first_command is not None:
            inputs["in_u_start"] = first["u"]
            arguments["u"] = "in_u_start"
        variables += variables_of(y, joints, "y", "output", "discrete", prefix="y")
        variables += variables_of(loop.plant.layout, joints, "x", "output", "discrete", prefix="x", about="true")
    if part == "controller":
        add(command, "in_u_start", first["u"], "parameter", "fixed", prefix="start", about="in force at the start:")
        arguments |= {"y": "in_y"}
    if part != "plant":
        variables += variables_of(command, joints, "u_issued", "output", "discrete")
    variables += lane_values(loop, part)
    controller = part == "controller"
    kept = {"y_old": "y_kept", "u": "u", "u_queued": "u"}
    stages = (*([] if part == "plant" else [*control, shape]), *([] if controller else [*move, *measure]))
    rings = [stage.to for stage in stages if isinstance(stage, DelayStage)]
    blocks = {name: lanes.get(name)[0] for name in lanes.blocks}
    extra = {name: first[name] for name in ("c", "p", "c_sensors") if name in first and name not in blocks}
    begin, begun = loop.initialisation.program, BEGUN
    if controller:
        begin, begun = law, {"s": "s"}
    assert begin is not None
    return SampledModel(
        part,
        loop.arm,
        LoopClock(loop.period, scenario.substeps, scenario.seed, scenario.first_lane),
        _about(scenario, part, loop),
        begin,
        {port.name: arguments[port.name] for port in begin.inputs if port.size},
        begun,
        {name: kept[name] for name in rings},
        () if part == "plant" else (*control, shape),
        () if controller else tuple(move),
        () if controller else tuple(measure),
        tuple(entering),
        {**blocks, **{name: values for name, values in extra.items() if values.size}},
        {name: values for name, values in inputs.items() if values.size},
        tuple(variables),
        tuple(places_watched(loop.plant.layout, loop.config.is_ahead))
        if "x_first" in blocks and not controller
        else (),
    )


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
    return _bare(replace(scenario, loop=loop, command=None))


def _split(stages: tuple[Stage, ...]) -> tuple[Sequence[Stage], Call, Sequence[Stage], Sequence[Stage]]:
    """Stages of the controller, the shaping of its command, of what moves the plant behind it, and of its measurement.

    Rows and tables are none of them: what they bring comes from outside.
    """
    names = [stage.program.name if isinstance(stage, Call) else "" for stage in stages]
    shape = names.index("shape")
    output = names.index("tell")
    inside = [stage for stage in stages if not isinstance(stage, (RowsStage, TableStage, RecordStage))]
    place = {id(stage): k for k, stage in enumerate(stages)}
    control = [stage for stage in inside if output < place[id(stage)] < shape and _name(stage) == "control"]
    measure = [stage for stage in inside if place[id(stage)] <= output]
    move = [stage for stage in inside if place[id(stage)] > shape]
    shaped = stages[shape]
    assert isinstance(shaped, Call)
    return control, shaped, move, measure


def _name(stage: Stage) -> str:
    return stage.program.name if isinstance(stage, Call) else ""


def acting_layout(loop: UnrecordedLoop, name: str) -> Layout:
    """Layout of an optional input of the plant: "wrench", "brake" or "payload"."""
    arm = loop.arm
    if name == "wrench":
        units = ("N",) * 3 + ("N m",) * 3
        return Layout((Signal(name, units, (6,), labels=WRENCH, about="of the environment on the tip, base axes"),))
    if name == "brake":
        braked = tuple(i for i, body in enumerate(arm.coordinates) if body.brake is not None)
        return Layout((joint_signal(arm, name, "1", "1: the holding brake is applied, 0: released", braked),))
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


def lane_values(loop: UnrecordedLoop, part: str) -> list[Variable]:
    """Values of the batched numbers of record and controller, as parameters."""
    sampling, varied, rows = loop.config.sampling, loop.config.varied, []
    assert sampling is not None
    if varied is not None and part != "controller":
        for k, name in enumerate(varied.names):
            value, about = float(loop.scenario.parameters[0, k]), "number of the record"
            rows.append(Variable(f"p.{quoted(name)}", "parameter", "tunable", "-", about, "p", k, value))
    if part == "plant":
        return rows
    lanes, entry = sampling.controller.lanes, 0
    for name, shape in zip(lanes.names, lanes.shapes, strict=True):
        for k in range(int(np.prod(shape, dtype=int))):
            words = f"c.{quoted(name)}" + (f".at{k}" if shape else "")
            value = float(lanes.values[0, entry])
            rows.append(Variable(words, "parameter", "tunable", "-", "gain of the law", "c", entry, value))
            entry += 1
    return rows


def _about(scenario: Scenario, part: str, loop: UnrecordedLoop) -> str:
    law = "" if part == "plant" else f" with {loop.controller.name}" if part == "both" else f", {loop.controller.name}"
    whole = {"plant": "the arm", "controller": "the controller of", "both": "the arm"}[part]
    return f"{whole} {scenario.arm.name}{law}, one tick of {loop.period:g} s"

"""Forward sensitivities: how simulated signals change with parameters and initial states, exact for the steps that are taken.

Every program of a tick carries tangents along, so that what comes out is the derivative of the simulated discrete system, and in
the limit of small steps that of the continuous one. Steps end where a contact begins or ends and where something begins to stick
or breaks loose; tangents jump there with the time of that event (`plant.saltation`). Where such an event is all but missed there
is no derivative, and it is refused, as are quantisers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from armwright.entry import AnyScenario, as_scenario
from armwright.errors import DivergenceError, ScenarioError, check_known
from armwright.features import Support
from armwright.kernels.batch import Kernel
from armwright.kernels.compiled import CPU
from armwright.kernels.loop import LaneGroup, NativeLoop
from armwright.kernels.stages import NEXT, SWITCHES, TOO_MANY, Call, DelayStage, Integrate, RecordStage, Stage
from armwright.kernels.target import select_target
from armwright.model.vary import Varied
from armwright.parameters import Batch, LaneFields, lane_values
from armwright.program.derivative import with_tangents, without_tangents
from armwright.signals import Signal
from armwright.simulation.fixed_steps import COARSE, OR_NONE, accuracy_of, with_fixed_steps
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.loop.initialisation import BEGUN
from armwright.simulation.plant.joint_drive import contact_names
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Recording
from armwright.simulation.simulation import WATCHED, Simulation

if TYPE_CHECKING:
    import xarray

UNLIKE = ("jitter", "clock_drift", "command_loss", "command_delay", "measurement_delay")  # of a timing, what is refused
SUPPORT = Support(
    "sensitivities",
    scenario=True,
    without_effect={"brakes": "they are released unless inputs.brake applies them"},
    refused={
        "delays": "delays of whole ticks",
        "jitter": "no jitter, loss or drift",
        "lost samples": "no jitter, loss or drift",
        "clock drift": "no jitter, loss or drift",
        "encoder counts": "none: they have no derivative",
        "servo counts": "none: they have no derivative",
    },
)

MOST_FINER = 8  # steps in place of one that is too coarse
STARTS = ("start.q", "start.qd")
CONTROLLER = "loop.controller."
STORED = {"x": "", "y": "_measured", "u": ""}  # block → what the names of its signals end in


def sensitivities(scenario: AnyScenario, by: Sequence[str]) -> xarray.Dataset:
    """Derivatives of simulated signals by parameters and initial states.

    Args:
        scenario: with or without a compiled controller, lanes as ever. Steps that are "auto" are `with_fixed_steps`, short
            enough for the scenario's accuracy; rule and step stand in the attributes, and why in the notes.
        by: numbers of the record ("link6.mass_kg"), fields of the controller ("loop.controller.kp", "loop.controller.kp[2]"),
            initial positions and speeds ("start.q[1]", "start.qd[0]"); a name of several numbers stands for all of them.
    Returns:
        dataset: time, the signals, and for each its derivative d_<signal> with one more dimension, `parameter`.
    Raises:
        ScenarioError: what has no such derivative, or is not there; names it and what was expected.
        DivergenceError: a single run diverged.
    Example:
        >>> scenario = aw.Scenario("two-link", 0.2, command=[20.0, 5.0])
        >>> found = aw.simulation.sensitivities(scenario, ["forearm.mass_kg"])
        >>> list(found.data_vars)
        ['q', 'd_q', 'qd', 'd_qd']
    """
    scenario = as_scenario(scenario)
    if scenario.solver.device != CPU:
        raise ScenarioError(
            place="solver.device", value=scenario.solver.device, expected=f"{CPU!r}, where derivatives run"
        )
    accuracy, chosen = accuracy_of(scenario), scenario.solver.rule == "auto"
    simulation, seeds, names = _simulation(scenario.resolved, by, accuracy, MOST_FINER if chosen else 1)
    opened = simulation.scenario
    count = len(names)
    stages, active = _augmented(simulation, seeds, count)
    loop = NativeLoop(stages, select_target(opened.solver.target))
    ticks = opened.ticks
    every = opened.every or ticks
    lanes = LaneGroup(simulation.count, loop.target.width, 0, opened.first_lane)
    loop.extend(lanes)
    _begin(simulation, loop, lanes, seeds, active, count)
    blocks = next(stage.blocks for stage in stages if isinstance(stage, RecordStage))
    record = np.empty((ticks // every + 1, lanes.tiles * lanes.width, sum(loop.sizes[name] for name in blocks)))
    simulation.reference = simulation.reference_of_ticks(ticks)
    first, counts = simulation.tick, {"every": every, "substeps": opened.substeps}
    simulation.run_loop(loop, lanes, (first, first + ticks + 1), {"run": record}, last=first + ticks, **counts)
    single = scenario.lane_count is None
    _end_stopped(simulation, lanes, record, every, single)
    dataset = _dataset(simulation, record[:, : simulation.count], blocks, loop.sizes, names, every, single)
    dataset.attrs = _about_steps(simulation, accuracy if chosen else None)
    return dataset


def _simulation(
    scenario: Scenario, by: Sequence[str], accuracy: float, most: int, finer: int = 1
) -> tuple[Simulation, dict[str, np.ndarray], list[str]]:
    """A simulation with fixed steps, tangents and names of its inputs; steps that are coarse are halved, up to `most` for one."""
    opened, seeds, names = _opened(with_fixed_steps(scenario, finer), by)
    simulation = Simulation(opened, lands=True)
    _check(simulation)
    _check_start(simulation, names)
    simulation.note_coarse_step(opened.started, min(opened.ticks, WATCHED), accuracy)
    if finer < most and any(COARSE in note for note in simulation.notes):
        return _simulation(scenario, by, accuracy, most, 2 * finer)
    return simulation, seeds, names


def _end_stopped(simulation: Simulation, lanes: LaneGroup, record: np.ndarray, every: int, single: bool) -> None:
    """Refuses a run that stopped; of several lanes, rows of those are NaN from there on, and a note says so.

    Args:
        simulation: of the scenario.   lanes: at the end.   record: (rows, lanes, entries) of them, every so many ticks.
        single: whether there is one lane.
    """
    frozen = lanes.get("frozen")[:, 0]
    stopped = np.flatnonzero(frozen >= 0)
    if not len(stopped):
        return
    first = stopped[np.argmin(frozen[stopped])]
    grazed = int(lanes.get("grazed")[first, 0]) if "grazed" in lanes.blocks else 0
    where, at = _watched_names(simulation), f"at t = {frozen[first] * simulation.period:g} s"
    expected = ""
    if grazed > 0:
        place, how = where[grazed - 1]
        what = f"{how} {at} so slowly that the least change decides whether it does: there is no derivative there"
        expected = "a motion that passes clearly, or ends before"
    elif grazed == TOO_MANY:
        place, what = "scenario", f"more than {SWITCHES} contacts and turns of friction in one step {at}"
        expected = "a shorter step, or a smaller accuracy"
    else:
        place, what = "scenario", f"the simulation diverged to infinite numbers or NaN {at}"
    if single:
        error = ScenarioError if grazed else DivergenceError
        raise error(what, place=place, expected=expected, file=simulation.arm.name)
    for lane in stopped:
        record[int(frozen[lane] - simulation.tick) // every + 1 :, lane] = np.nan
    note = f"{len(stopped)} of {len(frozen)} lanes have no derivatives behind some time; lane {first}: {place} {what}"
    simulation.notes.append(note)


def _watched_names(simulation: Simulation) -> list[tuple[str, str]]:
    """Places of contacts and of what sticks, and what happens there, as `landing_programs` count them."""
    plant, bodies = simulation.plant, simulation.arm.coordinates
    contacts = [(body, name) for body in bodies for name in contact_names(body)]
    names = [(f"joint {body.joint!r}", f"meets or leaves {name}") for body, name in contacts]
    for joint, on_motor in () if plant.sticking is None else plant.sticking.places:
        names.append((f"joint {bodies[joint].joint!r}", f"{'its motor' * on_motor or 'it'} stops, or breaks loose,"))
    return names


def _about_steps(simulation: Simulation, accuracy: float | None) -> dict[str, Any]:
    """Attributes of a dataset: rule and step, and where an accuracy was asked for how they were chosen."""
    scenario, notes = simulation.scenario, [note.replace(OR_NONE, "") for note in simulation.notes]
    attrs: dict[str, Any] = {"integrator": scenario.solver.rule, "step_s": scenario.integration_step}
    if scenario.sampled:
        attrs |= {"sample_period_s": simulation.period, "substeps": scenario.substeps}
    if accuracy is not None:
        attrs["accuracy"] = accuracy
        name, step = scenario.solver.rule, scenario.integration_step
        notes = [
            f"derivatives are those of steps that are fixed: {name} with {step:.6g} s, from the arm's fastest time constant and "
            f"the accuracy of {accuracy:g}; where lanes choose their steps, lengths change with the parameters",
            *notes,
        ]
    return attrs | {"notes": "\n".join(notes)}


def _opened(scenario: Scenario, by: Sequence[str]) -> tuple[Scenario, dict[str, np.ndarray], list[str]]:
    """The scenario with all that is asked for as inputs of its programs, the tangents of those inputs, and their names."""
    if isinstance(by, str) or not by or not all(isinstance(name, str) for name in by):
        raise ScenarioError(place="by", value=by, expected="a list of names, such as ['link6.mass_kg', 'start.q[1]']")
    starts = [name for name in by if name.split("[")[0] in STARTS]
    gains = [name for name in by if name.startswith(CONTROLLER)]
    record = [name for name in by if name not in starts and name not in gains]
    vary: dict[str, Any] = dict(scenario.vary)
    for name in record:
        for parameter in Varied(scenario.arm, [name]).parameters:
            if parameter.name not in vary and parameter.path not in vary:
                vary[parameter.name] = parameter.value
    controller, fields_of = scenario.controller, dict.fromkeys(_field(name) for name in gains)
    for field in fields_of:
        plain = not is_dataclass(controller) or isinstance(controller, type)
        known = [] if plain else [each.name for each in fields(controller)]
        check_known(ScenarioError, field, known, "the controller has no such field", place="by")
        value = getattr(controller, field)
        if not isinstance(value, Batch):
            controller = replace(cast(Any, controller), **{field: Batch(np.asarray(value, dtype=float)[None])})
    loop = scenario.loop and replace(scenario.loop, controller=controller)
    recording = Recording(every=scenario.recording.every, period=scenario.recording.period)
    opened = replace(scenario, vary=vary, loop=loop, recording=recording)
    columns: list[tuple[str, str, int]] = []  # name, input, place
    for name in by:
        if name in starts:
            columns += [(f"{each}", "start", k) for each, k in _places(name, scenario.arm.n)]
        elif name in gains:
            columns += [(each, "c", k) for each, k in _gain_places(name, opened.controller_fields)]
        else:
            assert opened.varied is not None
            own = [parameter.name for parameter in Varied(scenario.arm, [name]).parameters]
            columns += [(each, "p", opened.varied.names.index(each)) for each in own]
    sizes = {
        "start": 2 * scenario.arm.n,
        "p": opened.parameters.shape[1],
        "c": opened.controller_fields.values.shape[1],
    }
    seeds = {name: np.zeros((size, len(columns))) for name, size in sizes.items()}
    for column, (_, name, place) in enumerate(columns):
        seeds[name][place, column] = 1.0
    return opened, seeds, [name for name, _, _ in columns]


def _field(name: str) -> str:
    return name.removeprefix(CONTROLLER).split("[")[0]


def _places(name: str, n: int) -> list[tuple[str, int]]:
    """Names and places in the start (q, q̇) of `start.q[1]`, or of all entries of `start.q`."""
    field, _, entry = name.partition("[")
    first = STARTS.index(field) * n
    if not entry:
        return [(f"{field}[{k}]", first + k) for k in range(n)]
    number = entry.removesuffix("]")
    if not number.isdigit() or int(number) >= n:
        raise ScenarioError(place="by", value=name, expected=f"{field}[0] … {field}[{n - 1}]")
    return [(name, first + int(number))]


def _gain_places(name: str, lanes: LaneFields) -> list[tuple[str, int]]:
    """Names and places among a controller's varying values of `loop.controller.kp[2]`, or of all of `loop.controller.kp`."""
    field, _, entry = name.removeprefix(CONTROLLER).partition("[")
    first = 0
    for each, shape in zip(lanes.names, lanes.shapes, strict=True):
        size = int(np.prod(shape))
        if each == field:
            if not shape:
                return [(f"{CONTROLLER}{field}", first)]
            if not entry:
                return [(f"{CONTROLLER}{field}[{k}]", first + k) for k in range(size)]
            number = entry.removesuffix("]")
            if number.isdigit() and int(number) < size:
                return [(name, first + int(number))]
            expected = f"{CONTROLLER}{field}[0] … {CONTROLLER}{field}[{size - 1}]"
            raise ScenarioError(place="by", value=name, expected=expected)
        first += size
    raise ScenarioError("no number of the controller", place="by", value=name)


def _check(simulation: Simulation) -> None:
    """Refuses what has no such derivatives."""
    scenario, sampling = simulation.scenario, simulation.config.sampling
    name, loop = scenario.solver.rule, scenario.loop
    if name not in INTEGRATORS:
        raise ScenarioError(place="solver.integrator", value=name, expected=f"one of {', '.join(INTEGRATORS)}")
    if simulation.untraced is not None:
        what = f"is not compiled ({simulation.untraced}), and has no sensitivities"
        raise ScenarioError(what, place="loop.controller", expected="one that is")
    if simulation.plant.sticking is not None and not simulation.plant.sticking.by_joints:
        body = next(body for body in simulation.arm.coordinates if body.drive.coupling)
        what = "is turned by motors that turn others too and that stick: where these break loose is not followed"
        raise ScenarioError(what, place=f"joint {body.joint!r}", expected="a smoothing speed in the record's friction")
    SUPPORT.refuse(simulation.arm, "servo counts")
    if sampling is None or loop is None:
        return
    if sampling.delays.fractional or np.any(sampling.delays.earlier):
        name = next(name for name in UNLIKE if lane_values(getattr(loop.timing, name)).any())
        expected = "delays of whole ticks, no jitter, loss or drift, beside sensitivities"
        raise ScenarioError(place=f"loop.timing.{name}", value=getattr(loop.timing, name), expected=expected)
    sensors = loop.joint_sensors
    places = {"sensors.counts": sensors.counts, "sensors.counts_per_m": sensors.counts_per_m}
    places["command_filter.resolution"] = loop.command_filter.resolution
    for place, value in places.items():
        if value is not None:
            raise ScenarioError("has no derivative", place=f"loop.{place}", value=value, expected="none")


def _check_start(simulation: Simulation, names: Sequence[str]) -> None:
    """Refuses the speed 0 that a joint with dry friction starts with: forward and back it has another derivative."""
    arm, sticking = simulation.arm, simulation.plant.sticking
    for k in sorted({joint for joint, _ in sticking.places} if sticking is not None else ()):
        name, speeds = f"{STARTS[1]}[{k}]", np.asarray(simulation.scenario.initial_state)[:, arm.n + k]
        if name in names and not speeds.all():
            what = f"joint {arm.names[k]!r} starts at rest, from where dry friction makes forward and back differ"
            raise ScenarioError(what, place=name, value=0.0, expected="a speed to start with, or another name in `by`")


def _augmented(simulation: Simulation, seeds: dict[str, np.ndarray], count: int) -> tuple[tuple[Stage, ...], set[str]]:
    """The stages of a tick with tangents, and the blocks that hold them."""
    stages = (*simulation.loop.tick.before, *simulation.loop.tick.after)
    active = {"x"}
    for stage in stages:
        if isinstance(stage, Call):
            active |= {port.name.removesuffix("_next") for port in stage.program.outputs}
        elif isinstance(stage, DelayStage):
            active.add(stage.to)
    inner = {name: seed for name, seed in seeds.items() if name != "start"}
    found: list[Stage] = []
    for stage in stages:
        if isinstance(stage, Call):
            stage = Call(with_tangents(stage.program, active, inner, count))
        elif isinstance(stage, DelayStage):
            stage = replace(stage, entries=stage.entries * (1 + count))
        elif isinstance(stage, RecordStage):
            sizes = dict(zip(stage.blocks, stage.entries, strict=True))
            stored = {name: sizes[name] * (1 + count * (name in active)) for name in STORED if name in sizes}
            stage = RecordStage(stage.name, tuple(stored), tuple(stored.values()))
        elif isinstance(stage, Integrate):
            seen = {f"x{NEXT}", *active}
            carried = {name: getattr(stage, name) for name in ("step", "landing")}
            plain = {name: getattr(stage, name) for name in ("touching", "switched", "bracket", "narrow", "grazing")}
            carried = {name: with_tangents(p, seen, inner, count) for name, p in carried.items() if p is not None}
            plain = {name: without_tangents(p, seen, count) for name, p in plain.items() if p is not None}
            turn = stage.turn and replace(stage.turn, program=with_tangents(stage.turn.program, seen, inner, count))
            stage = replace(stage, **carried, **plain, tangents=count, turn=turn)
        found.append(stage)
    return tuple(found), active


def _begin(
    simulation: Simulation,
    loop: NativeLoop,
    lanes: LaneGroup,
    seeds: dict[str, np.ndarray],
    active: set[str],
    count: int,
) -> None:
    """Fills the blocks of all lanes with initial values, and their tangents."""
    values = simulation.initial_blocks(lanes)
    own = simulation.initialisation
    program, kernel = own.program, None
    tangents: dict[str, np.ndarray] = {}
    if program is None:
        tangents["x"] = np.broadcast_to(seeds["start"], (lanes.count, *seeds["start"].shape))
    else:
        kernel = Kernel(with_tangents(program, (), seeds, count), select_target(simulation.scenario.solver.target))
        results = kernel(*own.arguments(lanes, simulation.acting(lanes)))
        results = results if isinstance(results, tuple) else (results,)
        for port, result in zip(program.outputs, results, strict=True):
            tangents[port.name[0]] = np.asarray(result)[:, port.size :].reshape(lanes.count, port.size, count)
    tangent_of = {name: tangents[result[0]] for name, result in BEGUN.items() if result[0] in tangents}
    if "y" in tangents:
        assert simulation.config.sampling is not None
        tangent_of["y_kept"] = tangents["y"][:, : simulation.config.sampling.sensors.layout.size]
    enlarged = dict(values)
    for name, tangent in tangent_of.items():
        if name in values:
            rows = np.broadcast_to(values[name], (lanes.count, values[name].shape[1]))
            enlarged[name] = np.concatenate([rows, tangent.reshape(lanes.count, -1)], axis=1)
    for name in enlarged:
        if name in lanes.blocks:
            lanes.set(name, enlarged[name] if name in active else values[name])
    for name, rows in simulation.rows.items():
        loop.begin_rows(lanes, name, rows, simulation.tick)
    for name, block in (("y_old", "y_kept"), ("u", "u")):
        if name in lanes.rings:
            lanes.fill_ring(name, enlarged[block])


def _dataset(
    simulation: Simulation,
    record: np.ndarray,
    blocks: Sequence[str],
    sizes: dict[str, int],
    names: Sequence[str],
    every: int,
    single: bool,
) -> xarray.Dataset:
    """Signals and their derivatives."""
    import xarray

    arm = simulation.arm
    ticks = simulation.tick + np.arange(len(record)) * every
    dataset = xarray.Dataset(
        coords={
            "time": ("time", ticks * simulation.period, {"units": "s", "long_name": "time"}),
            "joint": ("joint", list(arm.names)),
            "parameter": ("parameter", list(names), {"long_name": "what is differentiated by"}),
        }
    )
    rows, start = record.transpose(1, 0, 2), 0
    layouts = {"x": simulation.plant.layout, "u": simulation.scenario.command_layout}
    if simulation.config.sampling is not None:
        layouts["y"] = simulation.config.sampling.sensors.y
    for block in blocks:
        layout, stop = layouts[block], start + sizes[block]
        part = rows[:, :, start:stop]
        start = stop
        values, slopes = part[..., : layout.size], part[..., layout.size :].reshape(*part.shape[:2], layout.size, -1)
        for signal in layout if slopes.shape[-1] else ():
            place = layout.place(signal.name)
            _add(dataset, f"{signal.name}{STORED[block]}", signal, values[..., place], slopes[..., place, :], single)
    return dataset


def _add(dataset: Any, name: str, signal: Signal, values: np.ndarray, slopes: np.ndarray, single: bool) -> None:
    """Adds a signal and its derivative, with a dimension for its entries."""
    every = signal.joints is not None and len(signal.joints) == dataset.sizes["joint"]
    dims = ("time", "joint" if every else f"{name}_entry")
    squeeze = (lambda v: v[0]) if single else (lambda v: v)
    dims = dims if single else ("lane", *dims)
    dataset[name] = (dims, squeeze(values), {"units": signal.unit, "long_name": signal.about or name})
    about = {"units": f"{signal.unit} per unit of the parameter", "long_name": f"derivative of {signal.about or name}"}
    dataset[f"d_{name}"] = ((*dims, "parameter"), squeeze(slopes), about)

"""`*.scenario.toml` → Scenario: robot, commands or loop, lanes, and what to keep."""

from __future__ import annotations

import dataclasses
import importlib
import json
import os
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from armwright import scalar
from armwright.description.toml_file import read_text, toml_tables
from armwright.errors import ArmwrightError, DescriptionError, ExpressionError, ModelError, Problem, ScenarioError
from armwright.expressions import expression
from armwright.model import Model, build_model
from armwright.model.joint_signals import joint_units
from armwright.model.vary import Varied
from armwright.quantity import Record
from armwright.scalar import Scalar
from armwright.scenarios.files import Files, FolderFiles
from armwright.scenarios.lanes import TENSOR, vary
from armwright.scenarios.records import Kind, PayloadTable, ScenarioTable, Tensor, key_in_file, keys_in_text
from armwright.simulation.checks import check_time
from armwright.simulation.inputs.input_schedule import WRENCH
from armwright.simulation.inputs.payload import Payload
from armwright.simulation.inputs.schedule import Schedule, parse_schedule
from armwright.simulation.loop.command_filter import CommandFilter
from armwright.simulation.loop.sensors import Sensors
from armwright.simulation.loop.timing import Timing
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Inputs, Loop, Recording, Solver, Start
from armwright.trajectory.limits import QUANTITIES, MotionLimits
from armwright.trajectory.motion import Motion
from armwright.trajectory.motion_rows import parse_motion
from armwright.validation import readable, validated

HOMES = {"controller": "armwright.control", "filter": "armwright.control", "reference": "armwright.trajectory"}
CONFIGURED = {
    "controller": ("arm", "model", "signs", "period", "sections"),
    "filter": (),
    "reference": ("arm", "model", "limits"),
}  # what no file tells
OTHERS = {"limit": np.inf, "rate": np.inf, "speed_limit": np.inf, "effort_limit": np.inf, "voltage_limit": np.inf}
FAULTS = (
    "no table of its own; [loop.timing] has delays, jitter, losses and drift, [loop.sensors] noise and counts, [inputs] what "
    "disturbs, [values] and [lanes] other numbers of the arm"
)


def read_scenario(path: str | os.PathLike[str], *, allow: Iterable[str | os.PathLike[str]] = ()) -> Scenario:
    """The scenario in a file.

    Args:
        path: of the `*.scenario.toml`; robots and tables that it names stand in its folder or below, or are built in.
        allow: further folders that it may name files in.
    Returns:
        scenario: as in Python; `scenario.document` keeps the file and all that it named.
    Raises:
        ArmwrightError: no such file, or something in it that cannot be believed; names file, key, value and what was expected.
    """
    path, folders = Path(path), [Path(folder) for folder in allow]
    for folder in folders:
        if not folder.is_dir():
            raise ScenarioError("no such folder", place="allow", value=str(folder))
    try:
        text = read_text(path)
    except DescriptionError as error:
        raise ScenarioError.of(*error.problems) from None
    with toml_tables(path, ScenarioError, text) as tables:
        return parse_scenario(tables, str(path), FolderFiles(path.parent, folders), text)


def parse_scenario(tables: dict[str, Any], place: str, files: Files, text: str, lanes: range | None = None) -> Scenario:
    """The scenario in a parsed TOML document, whose text is kept with it.

    Args:
        tables: parsed.   place: what errors call the file.   files: that it names.   text: of the document.
        lanes: only these; of draws there are as many as are asked for. By default all.
    """
    if "faults" in tables:
        raise ScenarioError(FAULTS, place="faults", file=place)
    try:
        table = validated(ScenarioTable, tables, file=place, error=ScenarioError)
    except ScenarioError as error:
        without = readable(ScenarioTable, tables)
        raise error if without is None else _with_others(error, without, place, files) from None
    try:
        scenario = _scenario(table, files, lanes)
    except ArmwrightError as error:
        raise _with_others(_in_file(error, table, place), table, place, files) from None
    document = files.document(text)
    notes = [
        f"{name} has {content.size / 2**20:.3g} MiB, too much to be kept with the run, which cannot be reproduced"
        for name, content in {place: document.scenario, **document.files}.items()
        if content.text is None
    ]
    # Of this scenario alone: a changed copy has neither.
    object.__setattr__(scenario, "document", json.dumps(document.model_dump(exclude_none=True), sort_keys=True))
    object.__setattr__(scenario, "notes", tuple(notes))
    return scenario


def _tables_of(place: str, controller: Kind) -> dict[str, str]:
    """The tables of a controller and of what it holds, by the names of their classes."""
    known = _kinds("controller").get(controller.kind)
    inner = controller.fields().get("inner")
    below = _tables_of(f"{place}.inner", Kind(**inner)) if isinstance(inner, dict) and "kind" in inner else {}
    return below | ({} if known is None else {known.__name__: place})


def _key_of(place: str, tables: Mapping[str, str]) -> str:
    """Place in the file of a place in a `Scenario`, or in a controller that calls itself by its class: JointPID.kp."""
    name, dot, rest = place.partition(".")
    return f"{tables[name]}.{rest}" if dot and name in tables else key_in_file(place)


def _scenario(table: ScenarioTable, files: Files, lanes: range | None) -> Scenario:
    arm = build_model(files.robot(table.robot))
    if table.without:
        arm = arm.replace(**dict.fromkeys(table.without))
    parts = _parts(table, arm, files)
    if table.lanes is not None:
        vary(table.lanes.columns(lanes), arm, parts)
    inputs = parts["inputs"] | {"payload": [Payload(**fields) for fields in parts["inputs"]["payload"]] or None}
    return Scenario(
        arm,
        table.duration_s,
        command=_commands(table, arm, files),
        loop=None if table.loop is None else _loop(table.loop.controller.kind, parts["loop"], arm),
        inputs=Inputs(**inputs),
        start=Start(**parts["start"]),
        solver=Solver(**parts["solver"]),
        recording=Recording(**parts["recording"]),
        vary=parts["vary"],
        lanes=None if lanes is None else len(lanes),
        seed=table.seed,
        first_lane=0 if lanes is None else lanes.start,
    )


def _in_file(error: ArmwrightError, table: ScenarioTable, place: str) -> ArmwrightError:
    """The error with keys of the file in place of Python's names."""
    tables_of = {} if table.loop is None else _tables_of("loop.controller", table.loop.controller)
    return error.renamed(lambda at: _key_of(at, tables_of), keys_in_text).within(file=place)


def _with_others(error: ArmwrightError, table: ScenarioTable, place: str, files: Files) -> ArmwrightError:
    """The error with those of the other parts of the scenario, each of which is made by itself.

    Args:
        error: the first.   table: what could be read.   place: of the file.   files: that it names.
    """
    found: list[Problem] = []
    try:
        arm = build_model(files.robot(table.robot))
        steps = _steps(table, arm, files)
    except ArmwrightError as refused:
        found, steps = list(_in_file(refused, table, place).problems), []
    for step in steps:
        try:
            step()
        except ArmwrightError as refused:
            found += _in_file(refused, table, place).problems
    known = {problem.place for problem in error.problems}
    return error.joined(
        *(problem for k, problem in enumerate(found) if problem.place not in known and problem not in found[:k])
    )


def _steps(table: ScenarioTable, arm: Model, files: Files) -> list[Callable[[], Any]]:
    """Calls that make the parts of a scenario, one part each."""
    start, inputs, recording, loop = table.start, table.inputs, table.recording, table.loop
    steps: list[Callable[[], Any]] = [
        lambda: _joints("start.q", start.q, arm),
        lambda: _joints("start.qd", start.qd, arm),
        *(partial(lambda key, value: Solver(**{key: value}), *each) for each in _without_units(table.solver).items()),
        *(partial(check_time, key, value) for key, value in (("duration", table.duration_s),) if value is not None),
        lambda: _reference("recording", recording.reference, arm, files),
        lambda: _commands(table, arm, files),
        lambda: _wrench(inputs.wrench, files),
        lambda: _brake(inputs.brake, arm, files),
        *(partial(lambda each: Payload(**_payload(each)), each) for each in inputs.payload),
        *(partial(_value, name, value, arm) for name, value in table.values.items()),
    ]
    if loop is None:
        return steps

    def part(kind: Callable[..., Any], fields: dict[str, Any]) -> None:
        try:
            kind(**fields)
        except ScenarioError as error:
            raise error.within("loop") from None

    if loop.period_s is not None:
        steps.append(partial(check_time, "loop.period", loop.period_s))
    controller, limits = loop.controller, loop.command_filter.model_dump()
    return [
        *steps,
        lambda: _built("controller", controller.kind, _controller("loop.controller", controller, arm), arm),
        lambda: _reference("loop", loop.reference, arm, files),
        lambda: part(Sensors, loop.sensors.model_dump()),
        lambda: part(Timing, _without_units(loop.timing)),
        *(partial(_joints, f"loop.command_filter.{key}", value, arm) for key, value in limits.items()),
        lambda: _joints("loop.initial_command", loop.initial_command, arm),
    ]


def _parts(table: ScenarioTable, arm: Model, files: Files) -> dict[str, dict[str, Any]]:
    """Fields of the parts of a scenario, by the part."""
    start, inputs, recording = table.start, table.inputs, table.recording
    parts: dict[str, dict[str, Any]] = {
        "start": {"q": _joints("start.q", start.q, arm), "qd": _joints("start.qd", start.qd, arm)},
        "solver": _without_units(table.solver),
        "recording": {
            **_without_units(recording),
            "reference": _reference("recording", recording.reference, arm, files),
        },
        "inputs": {
            "wrench": _wrench(inputs.wrench, files),
            "brake": _brake(inputs.brake, arm, files),
            "payload": [_payload(each) for each in inputs.payload],
        },
        "vary": {name: _value(name, value, arm) for name, value in table.values.items()},
    }
    if table.loop is not None:
        loop, filter_ = table.loop, table.loop.command_filter.model_dump()
        parts["loop"] = {
            "controller": _controller("loop.controller", loop.controller, arm),
            "reference": _reference("loop", loop.reference, arm, files),
            "period": loop.period_s,
            "sensors": loop.sensors.model_dump(),
            "command_filter": {k: _joints(f"loop.command_filter.{k}", value, arm) for k, value in filter_.items()},
            "timing": _without_units(loop.timing),
            "initial_command": _joints("loop.initial_command", loop.initial_command, arm),
        }
    return parts


def _without_units(table: Record) -> dict[str, Any]:
    """Values of a table by key, without the units that keys end in."""
    return {name.removesuffix("_s"): value for name, value in table.model_dump().items()}


def _loop(kind: str, fields: dict[str, Any], arm: Model) -> Loop:
    kinds = {"sensors": Sensors, "command_filter": CommandFilter, "timing": Timing}
    try:
        parts = {name: part(**fields[name]) for name, part in kinds.items()}
    except ScenarioError as error:
        raise error.within("loop") from None
    return Loop(**fields | parts | {"controller": _built("controller", kind, fields["controller"], arm)})


def _commands(table: ScenarioTable, arm: Model, files: Files) -> Any:
    """Constant commands, or a table of them over time; None with a loop."""
    if table.commands is None:
        return None
    if table.commands.schedule is not None:
        return parse_schedule(
            *files.table("commands.schedule", table.commands.schedule), arm.names, joint_units(arm, "u")
        )
    return _joints("commands.constant", table.commands.constant, arm)


def _wrench(value: Any, files: Files) -> Schedule | np.ndarray | None:
    """Six numbers, or a table of them over time."""
    if isinstance(value, str):
        return parse_schedule(*files.table("inputs.wrench", value), WRENCH, ["N"] * 3 + ["N m"] * 3)
    return None if value is None else np.array(value)


def _brake(value: Any, arm: Model, files: Files) -> Any:
    """Numbers, a table by joint whose others are released, or a table over time."""
    braked = [body.joint for body in arm.coordinates if body.brake is not None]
    if isinstance(value, str):
        return parse_schedule(*files.table("inputs.brake", value), braked)
    if not isinstance(value, dict):
        return value
    for name in value:
        if name not in braked:
            raise ScenarioError("a joint without a brake", place="inputs.brake", value=name, choices=braked)
    return [value.get(name, 0.0) for name in braked]


def _payload(table: PayloadTable) -> dict[str, Any]:
    """Fields of a `Payload`, its inertia as a tensor."""
    tensor = table.inertia_kg_m2
    if isinstance(tensor, Tensor):
        entries = tensor
        tensor = np.zeros((3, 3))
        for name, (i, j) in TENSOR.items():
            tensor[i, j] = tensor[j, i] = getattr(entries, name)
    elif tensor is not None:
        tensor = np.diag(tensor)
    return {"time": table.time_s, "mass": table.mass_kg, "com": table.com_m, "inertia": tensor, "frame": table.frame}


def _joints(place: str, value: Any, arm: Model) -> np.ndarray | None:
    """One number for all joints, one each, or a table by joint whose others are 0, or have no limit."""
    if value is None:
        return None
    if isinstance(value, Mapping):
        _check_joints(place, value, arm)
        other = OTHERS.get(place.rpartition(".")[2], 0.0)
        value = [value.get(name, other) for name in arm.names]
    _check_numbers(place, value, arm)
    if not isinstance(value, (list, tuple)):
        return np.full(arm.n, float(value))
    if len(value) != arm.n:
        raise ScenarioError(place=place, value=value, expected=f"{arm.n} numbers: {', '.join(arm.names)}")
    return np.array(value, dtype=float)


def _check_joints(place: str, table: Mapping[str, Any], arm: Model) -> None:
    """Refuses names that are no joints of the arm."""
    for name in table:
        if name not in arm.names:
            raise ScenarioError("no joint of the arm", place=place, value=name, choices=arm.names)


def _check_numbers(place: str, value: Any, arm: Model) -> None:
    """Refuses what is neither a number nor a list of numbers: TOML has dates, nan, and integers of any length."""
    for each in value if isinstance(value, (list, tuple)) else [value]:
        is_number = isinstance(each, (int, float)) and not isinstance(each, bool) and each == each
        if not is_number or (isinstance(each, int) and abs(each) > sys.float_info.max):
            expected = f"a number, or one for each joint: {', '.join(arm.names)}"
            raise ScenarioError(place=place, value=value, expected=expected)


def _value(name: str, value: float | tuple[float, ...], arm: Model) -> float | tuple[float, ...]:
    """A number of the record, or as many as it has there."""
    try:
        size = len(Varied(arm, [name]).parameters)
    except ModelError as error:
        what, choices = error.problems[0].what, error.problems[0].choices
        raise ScenarioError(what, place=f"values.{name!r}", expected=error.expected, choices=choices) from None
    if np.shape(value) != (() if size == 1 else (size,)):
        expected = "one number" if size == 1 else f"{size} numbers"
        more = "; what differs by lane goes into [lanes.vary]"
        raise ScenarioError(place=f"values[{name!r}]", value=value, expected=f"{expected}{more}")
    return value


def _kinds(home: str) -> dict[str, type]:
    """Controllers or trajectories by the name a file gives them: JointPID is joint_pid."""
    module = importlib.import_module(HOMES[home])
    found = {name: getattr(module, name) for name in module.__all__}
    classes = {name: kind for name, kind in found.items() if isinstance(kind, type) and dataclasses.is_dataclass(kind)}
    if home == "reference":
        classes = {name: kind for name, kind in classes.items() if issubclass(kind, Motion)}
        for name in ("PiecewisePolynomial", "Joined"):  # of files of motions
            classes.pop(name)
    else:
        part = "step" if home == "controller" else "polynomials"
        classes = {name: kind for name, kind in classes.items() if hasattr(kind, part)}
    return {
        re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", n).lower(): kind for n, kind in classes.items()
    }


def _fields(place: str, table: Kind, arm: Model) -> dict[str, Any]:
    """Fields of a controller or trajectory, tables by joint as arrays."""
    fields = table.fields()
    for name, value in fields.items():
        if place.endswith("reference") and name in QUANTITIES:
            continue  # limits by joint, whose others are the record's
        if isinstance(value, Mapping):
            fields[name] = _joints(f"{place}.{name}", value, arm)
        elif not isinstance(value, (str, bool)):
            # coefficients of a trajectory's joints: a row each; the trajectory checks how many there are
            rows = value if place.endswith("reference") and _is_matrix(value) else [value]
            for row in rows:
                _check_numbers(f"{place}.{name}", row, arm)
            even = isinstance(value, list) and len({np.shape(row) for row in value}) <= 1
            fields[name] = np.array(value, dtype=float) if even else value
    return fields


def _controller(place: str, table: Kind, arm: Model) -> dict[str, Any]:
    """Fields of a controller, with the controller and the filters that it holds made."""
    made, fields = {}, table.fields()
    if "inner" in fields:
        made["inner"] = _part("controller", place, "inner", fields.pop("inner"), arm)
    if isinstance(fields.get("filters"), list):
        rows = fields.pop("filters")
        made["filters"] = [_part("filter", place, f"filters[{k}]", each, arm) for k, each in enumerate(rows)]
    return made | _fields(place, Kind(kind=table.kind, **fields), arm)


def _part(home: str, place: str, key: str, table: Any, arm: Model) -> Any:
    """The controller or filter in a table of a controller."""
    kind = validated(Kind, table, place=f"{place}.{key}", error=ScenarioError)
    return _built(home, kind.kind, _controller(f"{place}.{key}", kind, arm), arm, place, key)


def _is_matrix(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(row, list) for row in value)


def _built(home: str, kind: str, values: Mapping[str, Any], arm: Model, place: str = "loop", key: str = "") -> Any:
    """A controller or a trajectory from its fields; `key` is where it stands in its place, by default its home."""
    kinds, place = _kinds(home), f"{place}.{key or home}"
    if kind not in kinds:
        extra = ["pose", "schedule", "motion", "expression"] if home == "reference" else []
        raise ScenarioError("unknown", place=f"{place}.kind", value=kind, choices=[*kinds, *extra])
    names = [each.name for each in dataclasses.fields(kinds[kind]) if each.init]
    keys = [name for name in names if name not in CONFIGURED[home]]
    limited = QUANTITIES if home == "reference" and "limits" in names else ()
    unknown = [name for name in values if name not in keys and name not in limited]
    if unknown:
        what, choices = f"no key of a {kind}", tuple(sorted((*keys, *limited)))
        raise ScenarioError.of(
            *(Problem(what, place, name, expected=_around(name, kind, kinds), choices=choices) for name in unknown)
        )
    values = {**({"arm": arm} if "arm" in names else {}), **({"model": arm} if "model" in names else {}), **values}
    overrides = {name: values.pop(name) for name in limited if name in values}
    try:
        if limited and (overrides or values.get("duration") is None):
            values["limits"] = MotionLimits.of(arm, **overrides)
        return kinds[kind](**values)
    except TypeError as error:
        needed = [each.name for each in dataclasses.fields(kinds[kind]) if each.init and _is_needed(each)]
        missing = [name for name in needed if name not in values]
        what = f"{kind} needs {', '.join(missing)}" if missing else str(error)
        raise ScenarioError(what, place=place) from None
    except ScenarioError as error:  # which names the class: Step.time
        own = (f"{kinds[kind].__name__}.", "limits.")
        raise error.renamed(
            lambda each: f"{place}.{each.partition('.')[2]}" if each.startswith(own) else each
        ) from None


def _around(name: str, kind: str, kinds: Mapping[str, type]) -> str:
    """The controller that has a key and may stand around one that has not: `gravity` of a feed_forward around a cascade."""
    fields = {each: {field.name for field in dataclasses.fields(kinds[each])} for each in kinds}
    around = [each for each, names in fields.items() if {name, "inner"} <= names]
    if not around or "inner" in fields[kind]:
        return ""
    return f'{{ kind = "{around[0]}", {name} = …, inner = {{ kind = "{kind}", … }} }}, or its own keys'


def _is_needed(field: dataclasses.Field) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _reference(part: str, table: Kind | None, arm: Model, files: Files) -> Any:
    """The reference of a table in [loop] or [recording]."""
    if table is None:
        return None
    place, fields = f"{part}.reference", table.fields()
    key = {"pose": "q", "schedule": "file", "motion": "file", "expression": "q"}.get(table.kind)
    if key is None:
        inner = {}
        if "reference" in fields:  # of one that shapes another
            motion = validated(Kind, fields.pop("reference"), place=f"{place}.reference", error=ScenarioError)
            inner["reference"] = _reference(place, motion, arm, files)
        rest = _fields(place, Kind(kind=table.kind, **fields), arm)
        return _built("reference", table.kind, inner | rest, arm, part)
    for name in fields:
        if name != key:
            raise ScenarioError(f"no key of a {table.kind}", place=place, value=name, choices=[key])
    if key not in fields:
        raise ScenarioError(f"{table.kind} needs {key}", place=place)
    value = fields[key]
    if table.kind == "pose":
        return _joints(f"{place}.q", value, arm)
    if table.kind in ("schedule", "motion") and not isinstance(value, str):
        raise ScenarioError(place=f"{place}.file", value=value, expected="the name of a file")
    if table.kind == "motion":
        return _motion(f"{place}.file", value, arm, files)
    if table.kind == "schedule":
        return parse_schedule(*files.table(f"{place}.file", value), arm.names, joint_units(arm, "q"))
    return _formulas(f"{place}.q", value, arm)


def _motion(place: str, name: str, arm: Model, files: Files) -> Motion:
    """The motion of a motion file, planned, or of a table of rows."""
    from armwright.motions.plan import plan_document  # which reads files as scenarios do

    text, file = files.table(place, name)
    if not name.endswith(".motion.toml"):
        return parse_motion(text, file, arm)
    with toml_tables(Path(file), ScenarioError, text) as tables:
        plan = plan_document(tables, file, files)
    if (plan.arm.name, *plan.arm.names) != (arm.name, *arm.names):
        expected = f"a motion of {arm.name}: {', '.join(arm.names)}"
        raise ScenarioError(f"is one of {plan.arm.name}", place=place, value=name, expected=expected)
    return plan.motion


def _formulas(place: str, texts: Any, arm: Model) -> Any:
    """q(t) from one formula a joint, or a table by joint whose others stay at 0."""
    if isinstance(texts, Mapping):
        _check_joints(place, texts, arm)
        texts = [str(texts.get(name, "0")) for name in arm.names]
    if not isinstance(texts, list) or len(texts) != arm.n:
        raise ScenarioError(place=place, value=texts, expected=f"{arm.n} formulas of t: {', '.join(arm.names)}")
    try:
        formulas = [expression(str(text), ("t",)) for text in texts]
    except ExpressionError as error:
        raise ScenarioError.of(*error.within(place).problems) from None

    def q(t: Scalar) -> np.ndarray:
        values = []
        for formula in formulas:
            try:
                values.append(formula({"t": t}))
            except ExpressionError as error:  # whoever asks names the part: loop or recording
                raise ScenarioError.of(*error.within(place.partition(".")[2]).problems) from None
        return scalar.array(values)

    return q

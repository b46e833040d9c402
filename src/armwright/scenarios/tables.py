"""A Scenario as the tables of its file: the inverse of `parse_scenario`, field by field; what no file can express is refused.

Values that differ by lane stand beside the tables, by the names that `[lanes.vary]` gives them. Robots, schedules and planned
motions, which a scenario's file names by files of their own, are values as they are; `writer` gives them names.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from armwright.errors import ArmwrightError, ScenarioError
from armwright.interfaces import called
from armwright.kernels.compiled import CPU
from armwright.model import Model
from armwright.model.changes import TERMS
from armwright.model.payload import Payload
from armwright.parameters import Batch, Draw
from armwright.scenarios.kinds import CONFIGURED, FILE_KEYS, kind_of
from armwright.scenarios.lanes import TIMES
from armwright.scenarios.parts import Formulas
from armwright.scenarios.values import OTHERS
from armwright.simulation.inputs.schedule import Schedule
from armwright.simulation.loop.sensors import Sensors
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Loop, Start
from armwright.spatial import TENSOR
from armwright.trajectory.limits import QUANTITIES, MotionLimits
from armwright.trajectory.motion import Motion

Tables = dict[str, Any]
SECONDS = ("duration", "period", "step", "time", *TIMES)  # fields whose keys end in _s
OF_MODEL = ("description", "warnings", "changes", "file", "name")  # that no number of a simulation depends on
SAMPLES = 997  # times at which motions of files are compared
TABLED = "is not part of a scenario file"


def tables_of(scenario: Scenario) -> tuple[Tables, dict[str, np.ndarray]]:
    """Tables of a scenario's file, and the (lanes,) values of every number that differs by lane, by its name.

    Raises:
        ScenarioError: what a scenario file cannot express; names the field and what would do.
    """
    scenario = scenario.resolved  # batches in place of draws
    if scenario.first_lane:
        expected = "the whole scenario, whose lanes begin at 0"
        raise ScenarioError(TABLED, place="first_lane", value=scenario.first_lane, expected=expected)
    if not isinstance(scenario.start, Start):
        expected = "an aw.Start(q, qd): a state that goes on is kept by its run"
        raise ScenarioError(f"a state {TABLED}", place="start", expected=expected)
    lanes: dict[str, np.ndarray] = {}
    arm = scenario.arm
    tables: Tables = {"robot": arm, "without": _without(arm)}
    if scenario.duration is not None:
        tables["duration_s"] = float(scenario.duration)
    tables["seed"] = int(scenario.seed)
    tables["values"] = _record_values(scenario.vary, lanes)
    tables["start"] = {
        name: _row(f"start.{name}", getattr(scenario.start, name), lanes)
        for name in ("q", "qd")
        if getattr(scenario.start, name) is not None
    }
    if scenario.loop is None:
        key = "schedule" if isinstance(scenario.command, Schedule) else "constant"
        tables["commands"] = {key: _schedule_or_numbers("command", scenario.command)}
    else:
        tables["loop"] = _loop(scenario.loop, arm, lanes)
    tables["inputs"] = _inputs(scenario, lanes)
    tables["solver"] = _solver(scenario)
    tables["recording"] = _recording(scenario, arm)
    if scenario.lane_count is not None and not lanes:  # lanes that differ in their random numbers alone
        q = scenario.initial_state[0, : arm.n]
        tables["start"]["q"] = q.tolist()
        lanes |= {f"start.q[{k}]": np.full(scenario.lane_count, value) for k, value in enumerate(q)}
    return {name: each for name, each in tables.items() if each not in ({}, [], None)}, lanes


def difference(one: Any, two: Any, place: str = "") -> str | None:
    """The place of the first difference between two values of tables; None of equal ones.

    Arms are equal if their numbers are, motions and schedules if their contents are, wherever they were read from.
    """
    if one is two:
        return None
    if isinstance(one, Mapping) and isinstance(two, Mapping):
        keys = dict.fromkeys([*one, *two])
        found = (
            difference(one[key], two[key], f"{place}.{key}".strip("."))
            if key in one and key in two
            else f"{place}.{key}"
            for key in keys
        )
        return next((each for each in found if each is not None), None)
    if isinstance(one, Motion) and isinstance(two, Motion):
        return None if _same_motion(one, two) else place
    if dataclasses.is_dataclass(one) and type(one) is type(two):
        hidden = OF_MODEL if isinstance(one, Model) else ("place",) if isinstance(one, Formulas) else ()
        names = [each.name for each in dataclasses.fields(one) if each.name not in hidden]
        found = (difference(getattr(one, name), getattr(two, name), place) for name in names)
        return next((each for each in found if each is not None), None)
    if _is_listed(one) and _is_listed(two):
        return _difference_of_lists(one, two, place)
    if _is_listed(one) != _is_listed(two) or isinstance(one, (bool, str)) != isinstance(two, (bool, str)):
        return place
    return None if one == two or (one != one and two != two) else place


def _difference_of_lists(one: Any, two: Any, place: str) -> str | None:
    """The place of the first difference between two lists or arrays."""
    if len(one) != len(two):
        return place
    found = (difference(a, b, f"{place}[{k}]") for k, (a, b) in enumerate(zip(one, two, strict=True)))
    return next((each for each in found if each is not None), None)


def _same_motion(one: Motion, two: Motion) -> bool:
    """True for motions with the same bits at their breaks and at times between them, and the same bodies in the hand."""
    if one.n != two.n or not np.array_equal(one.breaks, two.breaks) or not np.isfinite(one.breaks).all():
        return False
    times = np.unique(np.concatenate([one.breaks, np.linspace(one.breaks[0], one.breaks[-1], SAMPLES)]))
    bodies = difference(list(one.payloads), list(two.payloads))
    return bodies is None and np.array_equal(np.stack(one.at(times)), np.stack(two.at(times)))


def _is_listed(value: Any) -> bool:
    return isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim > 0)


def _without(arm: Model) -> list[str]:
    """Terms that were taken away.

    Raises:
        ScenarioError: the arm differs in more from its file.
    """
    more = [name for name in arm.changes if name not in (*TERMS, "name")]
    if more:
        what = f"differs from its record by replace({', '.join(f'{name}=…' for name in more)}), which {TABLED}"
        expected = "an arm as its robot file has it: state it there, and load that"
        raise ScenarioError(what, place="arm", value=arm.name, expected=expected)
    return [name for name in TERMS if name in arm.changes]


def _record_values(vary: Mapping[str, Any], lanes: dict[str, np.ndarray]) -> Tables:
    values: Tables = {}
    for name, value in vary.items():
        if not isinstance(value, Batch):
            values[name] = plain(f"vary[{name!r}]", value)
            continue
        rows = np.asarray(value.values, dtype=float)
        entries = {name: rows} if rows.ndim == 1 else {f"{name}[{k}]": column for k, column in enumerate(rows.T)}
        lanes |= entries
    return values


def _row(place: str, value: Any, lanes: dict[str, np.ndarray]) -> Any:
    """Numbers of which single entries may differ by lane: those of the first lane; `lanes` gets the columns that differ."""
    if not isinstance(value, Batch):
        return plain(place, value)
    rows = np.asarray(value.values) if value.shape is not None else np.zeros((1, 1, 1))
    if rows.ndim == 1:
        lanes[place] = rows.astype(float)
        return rows[0].item()
    if rows.ndim > 2:
        raise _by_lane(place, "one number, or one for each joint, in each lane")
    differs = (rows != rows[0]).any(axis=0)
    for k in np.flatnonzero(differs if differs.any() else np.ones_like(differs)):
        lanes[f"{place}[{k}]"] = rows[:, k].astype(float)
    return [each.item() for each in rows[0]]


def _by_lane(place: str, expected: str) -> ScenarioError:
    return ScenarioError("cannot differ by lane in a scenario file", place=place, expected=expected)


def plain(place: str, value: Any) -> Any:
    """A value as TOML has it: numbers, texts, lists and tables of them.

    Raises:
        ScenarioError: a batch, a function or another object of Python.
    """
    if value is None or isinstance(value, (bool, str, int, float)):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(f"{place}[{k}]", each) for k, each in enumerate(value)]
    if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        return {key: plain(f"{place}.{key}", each) for key, each in value.items()}
    if isinstance(value, (Batch, Draw)):
        raise _by_lane(
            place, "one value; start, loop.timing, gains, wrench, payloads and the record's numbers may differ"
        )
    what = f"{type(value).__name__} of Python, which {TABLED}"
    raise ScenarioError(what, place=place, expected="numbers, texts, or lists of them")


def _by_joint(name: str, value: Any, arm: Model) -> Any:
    """A limit of which some are infinite, which TOML has not: a table of the others by joint; None of one that is infinite."""
    if name not in OTHERS or not isinstance(value, (list, float)) or np.isfinite(value).all():
        return value
    if not isinstance(value, list):
        return None
    return {joint: each for joint, each in zip(arm.names, value, strict=True) if np.isfinite(each)}


def _changed(place: str, part: Any, names: Any = None, arm: Model | None = None) -> Tables:
    """Fields of a dataclass that are not at their defaults, by their keys; with an arm, limits without infinite ones."""
    found: Tables = {}
    for each in dataclasses.fields(part):
        value = getattr(part, each.name)
        if (names is not None and each.name not in names) or value is None or _is_default(each, value):
            continue
        numbers = plain(f"{place}.{each.name}", value)
        numbers = numbers if arm is None else _by_joint(each.name, numbers, arm)
        if numbers is not None:
            found[key_of(each.name)] = numbers
    return found


def _is_default(field: dataclasses.Field, value: Any) -> bool:
    simple = (bool, str, int, float)
    return isinstance(value, simple) and isinstance(field.default, simple) and value == field.default


def key_of(name: str) -> str:
    """Key in a scenario file of a field."""
    return f"{name}_s" if name in SECONDS else name


def _schedule_or_numbers(place: str, value: Any) -> Any:
    return value if isinstance(value, Schedule) else plain(place, value)


def _loop(loop: Loop, arm: Model, lanes: dict[str, np.ndarray]) -> Tables:
    if loop.controller is None:
        expected = "a controller: a scenario file has [commands], or a [loop] with one"
        raise ScenarioError("has no controller", place="loop.controller", expected=expected)
    others = [each for each in loop.sensor_list if not isinstance(each, Sensors)]
    if others:
        what = f"a {type(others[0]).__name__} of Python {TABLED}"
        raise ScenarioError(what, place="loop.sensors", expected="an aw.Sensors alone")
    table: Tables = {} if loop.period is None else {"period_s": float(loop.period)}
    if loop.initial_command is not None:
        table["initial_command"] = plain("loop.initial_command", loop.initial_command)
    table["controller"] = _controller("loop.controller", loop.controller, arm, lanes)
    if loop.reference is not None:
        table["reference"] = _reference("loop.reference", loop.reference, arm)
    table["sensors"] = _changed("loop.sensors", loop.joint_sensors)
    rows = _changed("loop.command_filter", loop.command_filter, arm=arm)
    table["command_filter"] = {
        key: row[0] if _is_listed(row) and len(set(row)) == 1 else row for key, row in rows.items()
    }
    timing: Tables = {}
    for each in dataclasses.fields(loop.timing):
        place, value = f"loop.timing.{key_of(each.name)}", getattr(loop.timing, each.name)
        if isinstance(value, Batch) or not _is_default(each, value):
            timing[key_of(each.name)] = _row(place, value, lanes)
    table["timing"] = timing
    return {name: each for name, each in table.items() if each != {}}


def _controller(place: str, control: Any, arm: Model, lanes: dict[str, np.ndarray] | None) -> Tables:
    """A controller's table, with those that it holds; gains of the outermost may differ by lane."""
    kind = kind_of("controller", control)
    if kind is None:
        what, expected = f"{called(control)!r} of Python {TABLED}", "a controller of Armwright, such as aw.Cascade"
        raise ScenarioError(what, place=place, expected=expected)
    table: Tables = {"kind": kind}
    for each in dataclasses.fields(control):
        name, value = each.name, getattr(control, each.name)
        at = f"{place}.{name}"
        if name in CONFIGURED["controller"]:
            own = name == "arm"  # which a loop sets to its own, whatever it was
            if isinstance(value, Model) and not own and difference(value, arm) is not None:
                expected = f"the scenario's arm, {arm.name}: a file's controllers know no other"
                raise ScenarioError("is another arm than the scenario's", place=at, value=value.name, expected=expected)
            continue
        if value is None or _is_default(each, value):
            continue
        if name == "inner":
            table[name] = _controller(at, value, arm, None)
        elif name == "filters":
            table[name] = [_filter(f"{at}[{k}]", row) for k, row in enumerate(value)]
        else:
            table[name] = _by_joint(name, plain(at, value) if lanes is None else _row(at, value, lanes), arm)
    return {name: value for name, value in table.items() if value is not None}


def _filter(place: str, value: Any) -> Tables:
    kind = kind_of("filter", value)
    if kind is None:
        what = f"a {type(value).__name__} of Python {TABLED}"
        raise ScenarioError(what, place=place, expected="aw.LowPass or aw.Notch")
    return {"kind": kind, **_changed(place, value)}


def _reference(place: str, reference: Any, arm: Model) -> Tables:
    """A reference's table; motions and schedules of files as they are, under the key `file`."""
    if isinstance(reference, Schedule):
        return {"kind": "schedule", "file": reference}
    if isinstance(reference, Formulas):
        return {"kind": "expression", "q": list(reference.texts)}
    if isinstance(reference, Motion) and reference.file is not None:
        return {"kind": "motion", "file": reference}
    kind = kind_of("reference", reference)
    if kind is not None:
        return {"kind": kind, **_motion_fields(place, reference, arm)}
    if isinstance(reference, Motion):
        what = f"an aw.{type(reference).__name__} that is not from a file {TABLED}"
        expected = "reference.save(arm, 'NAME.csv') and aw.trajectories.load_motion"
        raise ScenarioError(what, place=place, expected=expected)
    if callable(reference):
        what = f"{called(reference)!r} of Python {TABLED}"
        expected = "a pose, formulas of t, an aw.Schedule or a motion of Armwright"
        raise ScenarioError(what, place=place, expected=expected)
    numbers = plain(place, reference)
    if np.ndim(numbers) > 1:
        what = f"rows for every tick, which {TABLED}"
        raise ScenarioError(what, place=place, expected="one pose, an aw.Schedule or a motion")
    return {"kind": "pose", "q": numbers}


def _motion_fields(place: str, motion: Any, arm: Model) -> Tables:
    """Fields of a motion; limits as those that differ from the record's, and a duration that they give is left out."""
    limits, given = getattr(motion, "limits", None), {}
    for each in dataclasses.fields(motion):
        name, value = each.name, getattr(motion, each.name)
        if not each.init or name == "limits" or value is None or _is_default(each, value):
            continue
        if name == "reference":
            given[name] = _reference(f"{place}.reference", value, arm)
        elif name == "kind":
            expected = "its default: a file states another kind of motion under this key"
            raise ScenarioError(TABLED, place=f"{place}.kind", value=value, expected=expected)
        else:
            given[FILE_KEYS.get(name, name)] = plain(f"{place}.{name}", value)
    if limits is None:
        return given
    record = MotionLimits.of(arm)
    own = {name: getattr(limits, name) for name in QUANTITIES}
    other = {name: plain(place, own[name]) for name in own if not np.array_equal(own[name], getattr(record, name))}
    if "duration" in given and _comes_of_limits(motion):
        del given["duration"]
    elif "duration" in given and not other:
        other = {"velocity": plain(place, own["velocity"])}
    return given | other


def _comes_of_limits(motion: Any) -> bool:
    """True where the limits alone give the motion's duration."""
    try:
        return bool(dataclasses.replace(motion, duration=None).duration == motion.duration)
    except ArmwrightError:
        return False


def _inputs(scenario: Scenario, lanes: dict[str, np.ndarray]) -> Tables:
    inputs, table = scenario.inputs, {}
    if inputs.wrench is not None:
        whole = inputs.wrench
        table["wrench"] = whole if isinstance(whole, Schedule) else _row("inputs.wrench", whole, lanes)
    for name, key in (("brake", "brake"), ("supply", "supply_v"), ("enabled", "enabled")):
        if (value := getattr(inputs, name)) is not None:
            table[key] = _schedule_or_numbers(f"inputs.{name}", value)
    bodies = [inputs.payload] if isinstance(inputs.payload, Payload) else inputs.payload or ()
    rows = [_payload(f"inputs.payload[{k}]", each, lanes) for k, each in enumerate(bodies)]
    return table | ({"payload": rows} if rows else {})


def _payload(place: str, body: Payload, lanes: dict[str, np.ndarray]) -> Tables:
    table: Tables = {
        name: _row(f"{place}.{name}", value, lanes) for name, value in (("time_s", body.time), ("mass_kg", body.mass))
    }
    table = {name: float(value) for name, value in table.items()}
    table["com_m"] = [float(each) for each in _row(f"{place}.com_m", body.com, lanes)]
    inertia = body.inertia
    if isinstance(inertia, Batch):
        rows = np.asarray(inertia.values, dtype=float)
        rows = rows if rows.ndim == 3 else rows[:, None, :] * np.eye(3)
        for name, (i, j) in TENSOR.items():
            if (rows[:, i, j] != rows[0, i, j]).any():
                lanes[f"{place}.inertia_kg_m2.{name}"] = rows[:, i, j]
        inertia = rows[0]
    tensor = np.asarray(inertia, dtype=float)
    tensor = np.diag(tensor) if tensor.ndim == 1 else 0.5 * (tensor + tensor.T)
    table["inertia_kg_m2"] = {name: float(tensor[i, j]) for name, (i, j) in TENSOR.items()}
    if not any(table["inertia_kg_m2"].values()):
        del table["inertia_kg_m2"]
    return table | ({} if body.frame is None else {"frame": body.frame})


def _solver(scenario: Scenario) -> Tables:
    solver = scenario.solver
    not_tabled = {"events": "none: they are functions of Python", "target": "none: it is the computer's"}
    for name, expected in (not_tabled | {"device": f"{CPU!r}: it is the computer's"}).items():
        if getattr(solver, name) not in (None, {}, CPU):
            raise ScenarioError(TABLED, place=f"solver.{name}", expected=expected)
    table = _changed("solver", solver)
    table.pop("events", None)
    return table


def _recording(scenario: Scenario, arm: Model) -> Tables:
    recording = scenario.recording
    table = _changed("recording", recording, ("every", "what", "period"))
    if recording.reduce:
        table["reduce"] = [str(each) for each in recording.reduce]
    if recording.reference is not None:
        table["reference"] = _reference("recording.reference", recording.reference, arm)
    return table

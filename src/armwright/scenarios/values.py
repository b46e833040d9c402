"""Values of a scenario file for its arm, each checked by itself: of joints, the record, controllers and references."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from armwright.errors import ModelError, ScenarioError, check_known
from armwright.model import Model
from armwright.model.vary import Varied
from armwright.quantity import Record
from armwright.scenarios.mistakes import Mistakes
from armwright.scenarios.records import KindTable, LoopTable, PayloadTable, ScenarioTable, inertia_tensor
from armwright.simulation.checks import check_time
from armwright.simulation.scenario_parts import Solver
from armwright.trajectory.limits import QUANTITIES
from armwright.validation import validated

Fields = dict[str, Any]
OTHERS = {"limit": np.inf, "rate": np.inf, "speed_limit": np.inf, "effort_limit": np.inf, "voltage_limit": np.inf}
VALUE = {"pose": "q", "schedule": "file", "motion": "file", "expression": "q"}  # the only key of these references


def part_values(table: ScenarioTable, arm: Model, mistakes: Mistakes) -> dict[str, Fields]:
    """Values of a scenario by the part and the name in Python: tables by joint as arrays, files by their names.

    Args:
        table: of the file.   arm: its arm.   mistakes: where those of every value are noted; it is left out.
    """
    commands = {} if table.commands is None else table.commands.model_dump()
    parts: dict[str, Fields] = {
        "start": _by_joint("start", table.start.model_dump(), arm, mistakes),
        "commands": commands | _by_joint("commands", {"constant": commands.get("constant")}, arm, mistakes),
        "solver": _without_units(table.solver),
        "recording": _without_units(table.recording),
        "inputs": {"wrench": table.inputs.wrench, "payload": [_payload(each) for each in table.inputs.payload]},
    }
    if isinstance(table.inputs.wrench, tuple):
        parts["inputs"]["wrench"] = np.array(table.inputs.wrench)
    with mistakes.noted():
        braked = [body.joint for body in arm.coordinates if body.brake is not None]
        parts["inputs"]["brake"] = _switches("brake", table.inputs.brake, braked, 0.0)
    with mistakes.noted():
        servos = [body.joint for body in arm.coordinates if body.drive.firmware is not None]
        parts["inputs"]["enabled"] = _switches("enabled", table.inputs.enabled, servos, 1.0)
    parts["inputs"]["supply"] = table.inputs.supply_v
    for name, value in parts["solver"].items():
        with mistakes.noted():
            Solver(**{"integrator": table.solver.integrator, name: value})
    for name, time in (("duration", table.duration_s), ("loop.period", table.loop and table.loop.period_s)):
        if time is not None:
            with mistakes.noted():
                check_time(name, time)
    parts["recording"]["reference"] = _reference("recording", table.recording.reference, arm, mistakes)
    if table.loop is not None:
        parts["loop"] = _loop(table.loop, arm, mistakes)
    parts["vary"] = _record_values(table.values, arm, mistakes)
    return parts


def _loop(table: LoopTable, arm: Model, mistakes: Mistakes) -> Fields:
    fields: Fields = {
        "period": table.period_s,
        "sensors": table.sensors.model_dump(),
        "command_filter": _by_joint("loop.command_filter", table.command_filter.model_dump(), arm, mistakes),
        "timing": _without_units(table.timing),
        "reference": _reference("loop", table.reference, arm, mistakes),
        **_by_joint("loop", {"initial_command": table.initial_command}, arm, mistakes),
    }
    with mistakes.noted():
        fields["controller"] = _kind_values("loop.controller", table.controller, arm)
    return fields


def _reference(part: str, table: KindTable | None, arm: Model, mistakes: Mistakes) -> Fields | None:
    with mistakes.noted():
        return None if table is None else _reference_values(f"{part}.reference", table, arm)
    return None


def _reference_values(place: str, table: KindTable, arm: Model) -> Fields:
    """Fields of a reference, its kind and those of the reference that it shapes among them."""
    fields, key = table.fields(), VALUE.get(table.kind)
    if key is None:
        return _kind_values(place, table, arm)
    for name in fields:
        if name != key:
            raise ScenarioError(f"no key of a {table.kind}", place=place, value=name, choices=[key])
    if key not in fields:
        raise ScenarioError(f"{table.kind} needs {key}", place=place)
    value = fields[key]
    if table.kind == "pose":
        value = _joint_values(f"{place}.q", value, arm)
    elif table.kind == "expression":
        value = _formulas(f"{place}.q", value, arm)
    elif not isinstance(value, str):
        raise ScenarioError(place=f"{place}.file", value=value, expected="the name of a file")
    return {"kind": table.kind, key: value}


def _formulas(place: str, texts: Any, arm: Model) -> list[str]:
    """One formula for each joint; joints that a table does not name stay at 0."""
    if isinstance(texts, Mapping):
        _check_joints(place, texts, arm)
        texts = [texts.get(name, "0") for name in arm.names]
    if not isinstance(texts, list) or len(texts) != arm.n:
        raise ScenarioError(place=place, value=texts, expected=f"{arm.n} formulas of t: {', '.join(arm.names)}")
    return [str(text) for text in texts]


def _kind_values(place: str, table: KindTable, arm: Model) -> Fields:
    """Fields of a controller, filter or trajectory, with `kind` and the fields of its parts."""
    of_reference = place.endswith("reference")
    fields: Fields = {"kind": table.kind}
    for name, value in table.fields().items():
        at = f"{place}.{name}"
        if of_reference and name == "reference":
            fields[name] = _reference_values(at, _kind(at, value), arm)
        elif not of_reference and name == "inner":
            fields[name] = _kind_values(at, _kind(at, value), arm)
        elif not of_reference and name == "filters" and isinstance(value, list):
            rows = [(f"{at}[{k}]", row) for k, row in enumerate(value)]
            fields[name] = [_kind_values(at, _kind(at, row), arm) for at, row in rows]
        else:
            fields[name] = _kind_value(at, value, arm, of_reference)
    return fields


def _kind(place: str, table: Any) -> KindTable:
    return validated(KindTable, table, place=place, error=ScenarioError)


def _kind_value(place: str, value: Any, arm: Model, of_reference: bool) -> Any:
    if isinstance(value, (str, bool)) or (of_reference and place.rpartition(".")[2] in QUANTITIES):
        return value  # limits by joint, whose others are the record's
    if isinstance(value, Mapping):
        return _joint_values(place, value, arm)
    # coefficients of a trajectory's joints: a row each; the trajectory checks how many there are
    matrix = of_reference and isinstance(value, list) and value and all(isinstance(row, list) for row in value)
    for row in value if matrix else [value]:
        _check_numbers(place, row, arm)
    even = isinstance(value, list) and len({np.shape(row) for row in value}) <= 1
    return np.array(value, dtype=float) if even else value


def _switches(key: str, value: Any, joints: list[str], others: float) -> Any:
    """Numbers, of a table by joint with `others` for those that it does not name, or the name of a file."""
    if not isinstance(value, dict):
        return value
    for name in value:
        if name not in joints:
            what = "a joint without a brake" if key == "brake" else "a joint without a servo's firmware"
            raise ScenarioError(what, place=f"inputs.{key}", value=name, choices=joints)
    return [value.get(name, others) for name in joints]


def _payload(table: PayloadTable) -> Fields:
    inertia = None if table.inertia_kg_m2 is None else inertia_tensor(table.inertia_kg_m2)
    return {"time": table.time_s, "mass": table.mass_kg, "com": table.com_m, "inertia": inertia, "frame": table.frame}


def _record_values(values: Mapping[str, Any], arm: Model, mistakes: Mistakes) -> Fields:
    """Other numbers than the record's: for each name one, or as many as it has there."""
    for name, value in values.items():
        with mistakes.noted():
            try:
                size = len(Varied(arm, [name]).parameters)
            except ModelError as error:
                what, choices = error.problems[0].what, error.problems[0].choices
                raise ScenarioError(what, place=f"values.{name!r}", expected=error.expected, choices=choices) from None
            if np.shape(value) != (() if size == 1 else (size,)):
                expected = "one number" if size == 1 else f"{size} numbers"
                more = "; what differs by lane goes into [lanes.vary]"
                raise ScenarioError(place=f"values[{name!r}]", value=value, expected=f"{expected}{more}")
    return dict(values)


def _by_joint(place: str, values: Mapping[str, Any], arm: Model, mistakes: Mistakes) -> Fields:
    """Values of a table, each as one number for each joint."""
    fields: Fields = {}
    for name, value in values.items():
        with mistakes.noted():
            fields[name] = _joint_values(f"{place}.{name}", value, arm)
    return fields


def _joint_values(place: str, value: Any, arm: Model) -> np.ndarray | None:
    """(n,) from one number for all joints, one each, or a table by joint whose others are 0, or have no limit; None of None."""
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
        check_known(ScenarioError, name, arm.names, "no joint of the arm", place=place)


def _check_numbers(place: str, value: Any, arm: Model) -> None:
    """Refuses what is neither a number nor a list of numbers: TOML has dates, nan, and integers of any length."""
    for each in value if isinstance(value, (list, tuple)) else [value]:
        is_number = isinstance(each, (int, float)) and not isinstance(each, bool) and each == each
        if not is_number or (isinstance(each, int) and abs(each) > sys.float_info.max):
            expected = f"a number, or one for each joint: {', '.join(arm.names)}"
            raise ScenarioError(place=place, value=value, expected=expected)


def _without_units(table: Record) -> Fields:
    """Values of a table by key, without the units that keys end in."""
    return {name.removesuffix("_s"): value for name, value in table.model_dump().items()}

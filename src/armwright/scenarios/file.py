"""`*.scenario.toml` → Scenario: robot, drives or controller, reference, timing, lanes, and what to keep."""

from __future__ import annotations

import dataclasses
import importlib
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from armwright import scalar
from armwright.description.toml_file import read_document
from armwright.errors import ArmwrightError, DescriptionError, ScenarioError, nearest
from armwright.expressions import expression
from armwright.model import Model, build_model
from armwright.model.joint_signals import joint_units
from armwright.model.vary import Varied
from armwright.scalar import Scalar
from armwright.scenarios.acting import brake_of, payload_fields, payloads_of, wrench_of
from armwright.scenarios.files import Files
from armwright.scenarios.records import Kind, ScenarioTable
from armwright.scenarios.varying import vary
from armwright.simulation.inputs.schedule import read_schedule
from armwright.simulation.loop.sensors import Sensors
from armwright.simulation.loop.shaping import Shaping
from armwright.simulation.loop.timing import Timing
from armwright.simulation.scenario import Scenario
from armwright.validation import validated

HOMES = {"controller": "armwright.control", "reference": "armwright.trajectory"}
CONFIGURED = {"controller": ("arm", "model", "signs", "period"), "reference": ("arm", "model")}  # what no file tells
OTHERS = {"limit": np.inf, "rate": np.inf, "speed_limit": np.inf, "effort_limit": np.inf, "voltage_limit": np.inf}
FAULTS = (
    "no table of its own; [timing] has delays, jitter, losses and drift, [sensors] noise and counts, wrench and [[payload]] what "
    "disturbs, [values] and [lanes] other numbers of the arm"
)


def read_scenario(path: str | os.PathLike[str]) -> Scenario:
    """The scenario in a file.

    Args:
        path: of the `*.scenario.toml`; robots and tables that it names stand beside it, or are built in.
    Returns:
        scenario: as in Python; `scenario.document` keeps the file and all that it named.
    Raises:
        ArmwrightError: no such file, or something in it that cannot be believed; names file, key, value and what was expected.
    """
    path = Path(path)
    try:
        document = read_document(path)
        text = path.read_text(encoding="utf-8")
    except DescriptionError as error:
        raise ScenarioError.of(*error.problems) from None
    return parse_scenario(document, str(path), Files(path.parent), text)


def parse_scenario(document: dict[str, Any], place: str, files: Files, text: str) -> Scenario:
    """The scenario in a parsed TOML document; `place` is what errors call it."""
    if "faults" in document:
        raise ScenarioError(f"{place}: faults: {FAULTS}")
    table = validated(ScenarioTable, document, file=place, error=ScenarioError)
    try:
        scenario = _scenario(table, files)
    except ArmwrightError as error:
        told = str(error)
        raise type(error)(told if told.startswith(place) else f"{place}: {told}") from None
    kept = {"scenario": text, "files": files.read}
    object.__setattr__(scenario, "document", json.dumps(kept, sort_keys=True))  # of this one: a changed copy has none
    return scenario


def _scenario(table: ScenarioTable, files: Files) -> Scenario:
    arm = build_model(files.robot(table.robot))
    if table.without:
        arm = arm.replace(**dict.fromkeys(table.without))
    units = joint_units(arm, "u")
    given: dict[str, Any] = {
        "q0": _joints("initial.q", table.initial.q, arm),
        "qd0": _joints("initial.qd", table.initial.qd, arm),
        "initial_command": _joints("initial.command", table.initial.command, arm),
        "duration": table.duration_s,
        "sample_period": table.sample_period_s,
        "substeps": table.substeps,
        "integrator": table.integrator,
        "rtol": table.rtol,
        "atol": table.atol,
        "max_steps": table.max_steps,
        "seed": table.seed,
        "vary": {name: _value(name, value, arm) for name, value in table.values.items()},
        "record": table.record.what,
        "record_every": table.record.every,
    }
    if table.record.reduce:
        given["reduce"] = table.record.reduce
    given |= {"wrench": wrench_of(table.wrench, files), "brake": brake_of(table.brake, arm, files)}
    given["payload"] = [payload_fields(each) for each in table.payload]
    parts: dict[str, Any] = {
        "sensors": table.sensors.model_dump(),
        "shaping": {name: _joints(f"shaping.{name}", value, arm) for name, value in table.shaping.model_dump().items()},
        "timing": {name.removesuffix("_s"): value for name, value in table.timing.model_dump().items()},
        "controller": None if table.controller is None else _fields("controller", table.controller, arm),
    }
    if table.drive is not None:
        if table.drive.schedule is not None:
            given["schedule"] = read_schedule(files.table(table.drive.schedule), arm.names, units)
        else:
            given["command"] = _joints("drive.command", table.drive.command, arm)
    if table.lanes is not None:
        for name, column in table.lanes.columns().items():
            vary(name, column, arm, given, parts)
    given |= {
        "sensors": Sensors(**parts["sensors"]),
        "shaping": Shaping(**parts["shaping"]),
        "timing": Timing(**parts["timing"]),
        "payload": payloads_of(given["payload"]),
        "reference": _reference(table.reference, arm, files),
    }
    if table.controller is not None:
        given["controller"] = _built("controller", table.controller.kind, parts["controller"] or {}, arm)
    return Scenario(arm, **given)


def _joints(place: str, value: Any, arm: Model) -> np.ndarray | None:
    """One number for all joints, one each, or a table by joint whose others are 0, or have no limit."""
    if value is None:
        return None
    if isinstance(value, Mapping):
        for name in value:
            if name not in arm.names:
                raise ScenarioError(f"{place}: no joint {name!r}; {nearest(name, arm.names)}")
        other = OTHERS.get(place.rpartition(".")[2], 0.0)
        value = [value.get(name, other) for name in arm.names]
    _check_numbers(place, value, arm)
    if not isinstance(value, (list, tuple)):
        return np.full(arm.n, float(value))
    if len(value) != arm.n:
        raise ScenarioError(f"{place} holds {len(value)} numbers, expected {arm.n}: {', '.join(arm.names)}")
    return np.array(value, dtype=float)


def _check_numbers(place: str, value: Any, arm: Model) -> None:
    """Refuses what is neither a number nor a list of numbers."""
    for each in value if isinstance(value, (list, tuple)) else [value]:
        if isinstance(each, bool) or not isinstance(each, (int, float)):
            told = f"a number, or one for each joint: {', '.join(arm.names)}"
            raise ScenarioError(f"{place} = {repr(value)[:60]}: expected {told}")


def _value(name: str, value: float | tuple[float, ...], arm: Model) -> float | tuple[float, ...]:
    """A number of the record, or as many as it has there."""
    size = len(Varied(arm, [name]).parameters)
    if np.shape(value) != (() if size == 1 else (size,)):
        expected = "one number" if size == 1 else f"{size} numbers"
        raise ScenarioError(
            f"values: {name} = {value}: expected {expected}; what differs by lane goes into [lanes.vary]"
        )
    return value


def _kinds(place: str) -> dict[str, type]:
    """Controllers or trajectories by the name a file gives them: JointPID is joint_pid."""
    module = importlib.import_module(HOMES[place])
    found = {name: getattr(module, name) for name in module.__all__}
    classes = {name: kind for name, kind in found.items() if isinstance(kind, type) and dataclasses.is_dataclass(kind)}
    return {re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower(): kind for name, kind in classes.items()}


def _fields(place: str, table: Kind, arm: Model) -> dict[str, Any]:
    """The fields of a kind, tables by joint told as arrays."""
    fields = table.fields()
    for name, value in fields.items():
        if isinstance(value, Mapping):
            fields[name] = _joints(f"{place}.{name}", value, arm)
        elif isinstance(value, list):
            _check_numbers(f"{place}.{name}", value, arm)
            fields[name] = np.array(value, dtype=float)
    return fields


def _built(place: str, kind: str, values: Mapping[str, Any], arm: Model) -> Any:
    kinds = _kinds(place)
    if kind not in kinds:
        extra = ["pose", "schedule", "expression"] if place == "reference" else []
        raise ScenarioError(f"{place}: kind = {kind!r}: unknown; {nearest(kind, [*kinds, *extra])}")
    names = [f.name for f in dataclasses.fields(kinds[kind]) if f.init]
    told = [name for name in names if name not in CONFIGURED[place]]
    for name in values:
        if name not in told:
            raise ScenarioError(f"{place}: {kind} has no {name!r}; {nearest(name, told)}")
    values = {**({"arm": arm} if "arm" in names else {}), **({"model": arm} if "model" in names else {}), **values}
    try:
        return kinds[kind](**values)
    except TypeError as error:
        missing = [f.name for f in dataclasses.fields(kinds[kind]) if f.init and f.name not in values and _needed(f)]
        raise ScenarioError(f"{place}: {kind} needs {', '.join(missing) or error}") from None


def _needed(field: dataclasses.Field) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _reference(table: Kind | None, arm: Model, files: Files) -> Any:
    if table is None:
        return None
    fields = table.fields()
    wanted = {"pose": ("q",), "schedule": ("file",), "expression": ("q",)}.get(table.kind)
    if wanted is None:
        return _built("reference", table.kind, _fields("reference", table, arm), arm)
    for name in fields:
        if name not in wanted:
            raise ScenarioError(f"reference: {table.kind} has no {name!r}; {nearest(name, wanted)}")
    if wanted[0] not in fields:
        raise ScenarioError(f"reference: {table.kind} needs {wanted[0]}")
    if table.kind == "pose":
        return _joints("reference.q", fields["q"], arm)
    if table.kind == "schedule":
        if not isinstance(fields["file"], str):
            raise ScenarioError(f"reference: file = {fields['file']!r}: expected the name of a CSV file")
        return read_schedule(files.table(fields["file"]), arm.names, joint_units(arm, "q"))
    return _formulas(fields["q"], arm)


def _formulas(texts: Any, arm: Model) -> Any:
    """q(t) from one formula a joint, or a table by joint whose others stay at 0."""
    if isinstance(texts, Mapping):
        for name in texts:
            if name not in arm.names:
                raise ScenarioError(f"reference.q: no joint {name!r}; {nearest(name, arm.names)}")
        texts = [str(texts.get(name, "0")) for name in arm.names]
    if not isinstance(texts, list) or len(texts) != arm.n:
        raise ScenarioError(f"reference.q: expected {arm.n} formulas of t: {', '.join(arm.names)}")
    formulas = [expression(str(text), ("t",)) for text in texts]

    def q(t: Scalar) -> np.ndarray:
        values = []
        for text, formula in zip(texts, formulas, strict=True):
            try:
                with np.errstate(all="ignore"):  # what is no number is refused where it is used
                    values.append(formula({"t": t}))
            except (OverflowError, ZeroDivisionError):
                raise ScenarioError(f"reference.q: {str(text)[:60]!r} is beyond the finite numbers") from None
        return scalar.array(values)

    return q

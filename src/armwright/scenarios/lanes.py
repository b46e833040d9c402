"""Batches of a scenario file: numbers that differ from lane to lane."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.model.vary import Varied
from armwright.parameters import Batch, lane_values
from armwright.spatial import TENSOR

Fields = dict[str, Any]
PAYLOAD = {"time_s": "time", "mass_kg": "mass", "com_m": "com", "inertia_kg_m2": "inertia"}
TIMES = ("measurement_delay", "command_delay", "jitter")  # whose keys end in _s
NAME = re.compile(
    r"(?P<place>start|loop\.controller|loop\.timing|inputs)\.(?P<key>\w+)(\[(?P<entry>\d+)\])?(?P<rest>.*)"
)
PAYLOAD_NUMBER = re.compile(r"\.(?P<key>\w+)(\[(?P<entry>\d)\]|\.(?P<tensor>\w\w))?")


def vary(columns: Mapping[str, np.ndarray], arm: Model, parts: dict[str, Fields]) -> None:
    """Puts columns of lanes in the places of numbers of a scenario.

    Args:
        columns: (lanes,) by name, as in the file: `loop.controller.kp[2]`, `start.q[1]`, `inputs.payload[0].mass_kg`, or of
            the robot's record.   arm: the model.   parts: fields of the scenario's parts, by the part; they are changed.
    Raises:
        ScenarioError: a name of nothing that may differ by lane.
    """
    of_record = {}
    for name, column in columns.items():
        match = NAME.fullmatch(name)
        if match is not None:
            _vary_part(name, match, column, arm, parts)
        elif name.partition(".")[0] in parts:
            expected = "a number of the robot, start, loop.timing, loop.controller or inputs"
            raise ScenarioError("cannot differ by lane", place="lanes", value=name, expected=expected)
        else:
            of_record[name] = Batch(column)
    sizes = Varied(arm, list(of_record)).sizes if of_record else {}  # which refuses what is no number of the record
    for name, size in sizes.items():
        if size > 1:
            raise ScenarioError(f"{size} numbers", place="lanes", value=name, expected=f"one, as {name}[0]")
    parts["vary"] |= of_record


def _vary_part(name: str, match: re.Match[str], column: np.ndarray, arm: Model, parts: dict[str, Fields]) -> None:
    """Puts a column in the place of a number that is not the robot's."""
    place, key, rest = match["place"], match["key"], match["rest"]
    entry = None if match["entry"] is None else int(match["entry"])
    if place == "inputs" and key == "payload" and entry is not None:
        _vary_payload(name, entry, rest, column, parts["inputs"]["payload"])
    elif rest:
        raise ScenarioError(place="lanes", value=name, expected=f"{place}.{key}, or one entry of it")
    elif place == "start":
        _vary_entry(name, parts["start"], key, entry, column, arm.n, ("q", "qd"))
    elif place == "inputs":
        if not isinstance(parts["inputs"]["wrench"], (np.ndarray, Batch)):
            raise ScenarioError(place="lanes", value=name, expected="inputs.wrench[0], beside six numbers of wrench")
        _vary_entry(name, parts["inputs"], key, entry, column, 6, ("wrench",))
    elif place == "loop.timing":
        timing = parts.get("loop", {}).get("timing", {})
        key = key.removesuffix("_s")
        if key not in timing or entry is not None or key == "preset":
            choices = [f"loop.timing.{each}{'_s' * (each in TIMES)}" for each in timing if each != "preset"]
            raise ScenarioError("unknown", place="lanes", value=name, choices=choices)
        timing[key] = Batch(column)
    else:
        _vary_gain(name, parts.get("loop", {}).get("controller", {}), key, entry, column, arm.n)


def _vary_entry(
    name: str, fields: Fields, key: str, entry: int | None, column: np.ndarray, size: int, keys: tuple[str, ...]
) -> None:
    """One of several numbers, which are 0 where the file has none."""
    if key not in keys or entry is None or entry >= size:
        place = name.partition(".")[0]
        expected = " or ".join(f"{place}.{each}[0] … {place}.{each}[{size - 1}]" for each in keys)
        raise ScenarioError(place="lanes", value=name, expected=expected)
    fields[key] = _placed(np.zeros(size) if fields[key] is None else fields[key], entry, column)


def _vary_gain(name: str, fields: Fields, key: str, entry: int | None, column: np.ndarray, n: int) -> None:
    """A number of the controller, one for all joints or one of a joint."""
    if key not in fields:
        choices = [f"loop.controller.{each}" for each in fields if each != "kind"]
        raise ScenarioError("unknown", place="lanes", value=name, choices=choices)
    whole = fields[key]
    if isinstance(whole, (str, bool, dict)):
        raise ScenarioError("cannot differ by lane", place="lanes", value=name, expected="a number of the controller")
    if entry is None:
        fields[key] = Batch(column)
        return
    if entry >= n:
        expected = f"loop.controller.{key}[0] … loop.controller.{key}[{n - 1}]"
        raise ScenarioError(place="lanes", value=name, expected=expected)
    several = isinstance(whole, Batch) or np.ndim(whole) > 0
    if several and np.shape(lane_values(whole))[1:] != (n,):
        raise ScenarioError(place=f"loop.controller.{key}", value=whole, expected=f"{n} numbers")
    fields[key] = _placed(whole if several else np.full(n, whole), entry, column)


def _vary_payload(name: str, number: int, rest: str, column: np.ndarray, payloads: list[Fields]) -> None:
    """One number of a payload: `inputs.payload[0].mass_kg`, `….com_m[2]`, `….inertia_kg_m2.xx`."""
    if number >= len(payloads):
        expected = f"one of the {len(payloads)} [[inputs.payload]], counted from 0"
        raise ScenarioError(place="lanes", value=name, expected=expected)
    match, fields = PAYLOAD_NUMBER.fullmatch(rest), payloads[number]
    key, entry, tensor = (None, None, None) if match is None else (match["key"], match["entry"], match["tensor"])
    whole = fields.get(PAYLOAD.get(str(key), ""))
    if key in ("time_s", "mass_kg") and entry is None and tensor is None:
        fields[PAYLOAD[key]] = Batch(column)
    elif key == "com_m" and entry is not None and int(entry) < 3 and whole is not None:
        fields["com"] = _placed(whole, int(entry), column)
    elif key == "inertia_kg_m2" and tensor in TENSOR and whole is not None:
        rows = np.array(np.broadcast_to(lane_values(whole), (len(column), 3, 3)))
        i, j = TENSOR[tensor]
        rows[:, i, j] = rows[:, j, i] = column
        fields["inertia"] = Batch(rows)
    else:
        choices = ["time_s", "mass_kg"]
        choices += [f"com_m[{k}]" for k in range(3)] if fields["com"] is not None else []
        choices += [f"inertia_kg_m2.{each}" for each in TENSOR] if fields["inertia"] is not None else []
        raise ScenarioError("unknown", place=f"lanes: {name.removesuffix(rest)}", value=rest[1:], choices=choices)


def _placed(whole: Any, entry: int, column: np.ndarray) -> Batch:
    """Several numbers of which one varies; the others stay as they are."""
    rows = np.asarray(lane_values(whole), dtype=float)
    rows = np.repeat(rows, len(column), axis=0) if len(rows) == 1 else rows.copy()
    rows[:, entry] = column
    return Batch(rows)

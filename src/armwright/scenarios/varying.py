"""Numbers of a scenario file that differ from lane to lane, put where they belong."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from armwright.errors import ScenarioError, nearest
from armwright.model import Model
from armwright.model.vary import Varied
from armwright.parameters import Batch
from armwright.scenarios.acting import vary_payload
from armwright.scenarios.lanes import placed

TIMES = ("measurement_delay", "command_delay", "jitter")  # whose keys end in _s


def vary(name: str, column: np.ndarray, arm: Model, given: dict[str, Any], parts: dict[str, Any]) -> None:
    """One number of the file becomes a column of lanes."""
    if name.startswith("payload["):
        vary_payload(name, column, given["payload"])
        return
    path, entry = name, None
    match = re.fullmatch(r"(.*)\[(\d+)\]", name)
    if match and match[1].split(".")[0] in (*parts, "initial", "wrench"):
        path, entry = match[1], int(match[2])
    head, _, field = path.partition(".")
    if head == "initial":
        key = {"q": "q0", "qd": "qd0"}.get(field)
        if key is None or entry is None or entry >= arm.n:
            last = f" … initial.q[{arm.n - 1}]" if arm.n > 1 else ""
            raise ScenarioError(f"lanes: no {name!r}; expected initial.q[0]{last}, or the same of initial.qd")
        given[key] = placed(np.zeros(arm.n) if given[key] is None else given[key], entry, column)
    elif head == "wrench":
        if field or entry is None or entry > 5 or not isinstance(given["wrench"], (np.ndarray, Batch)):
            raise ScenarioError(f"lanes: no {name!r}; expected wrench[0] … wrench[5], beside six numbers of wrench")
        given["wrench"] = placed(given["wrench"], entry, column)
    elif head == "timing":
        field = field.removesuffix("_s")
        if field not in parts["timing"] or entry is not None or field == "preset":
            known = [f"timing.{key}{'_s' * (key in TIMES)}" for key in parts["timing"] if key != "preset"]
            raise ScenarioError(f"lanes: no {name!r}; {nearest(name, known)}")
        parts["timing"][field] = Batch(column)
    elif head == "controller":
        fields = parts["controller"] or {}
        if field not in fields:
            raise ScenarioError(f"lanes: no {name!r}; {nearest(name, [f'controller.{key}' for key in fields])}")
        whole = fields[field]
        if isinstance(whole, (str, bool)):
            raise ScenarioError(f"lanes: {name!r} cannot differ by lane; expected a number of the controller")
        if entry is not None and entry >= arm.n:
            last = f" … controller.{field}[{arm.n - 1}]" if arm.n > 1 else ""
            raise ScenarioError(f"lanes: no {name!r}; expected controller.{field}[0]{last}")
        if entry is None:
            fields[field] = Batch(column)
        else:
            several = isinstance(whole, Batch) or np.ndim(whole) > 0
            fields[field] = placed(whole if several else np.full(arm.n, whole), entry, column)
    elif head in parts:
        raise ScenarioError(
            f"lanes: {name!r} cannot differ by lane; expected a number of the robot, initial, timing, controller, wrench or "
            "payload"
        )
    else:
        parameters = Varied(
            arm, [name]
        ).parameters  # refuses what is no number of the record, and lists those there are
        if len(parameters) > 1:
            raise ScenarioError(f"lanes: {name!r} is {len(parameters)} numbers; expected one, such as {name}[0]")
        given["vary"] = {**given["vary"], name: Batch(column)}

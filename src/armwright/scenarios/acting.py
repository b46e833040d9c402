"""What acts on an arm in a scenario file beside its commands: a wrench, brakes, and bodies in its hands."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from armwright.errors import ScenarioError, nearest
from armwright.model import Model
from armwright.parameters import Batch, lane_values
from armwright.scenarios.files import Files
from armwright.scenarios.lanes import placed
from armwright.scenarios.records import PayloadTable, Tensor
from armwright.simulation.inputs.acting import WRENCH
from armwright.simulation.inputs.payload import Payload
from armwright.simulation.inputs.schedule import Schedule, read_schedule

ENTRIES = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
FIELDS = {"time_s": "time", "mass_kg": "mass", "com_m": "com", "inertia_kg_m2": "inertia"}
VARIED = re.compile(r"(?P<key>\w+)(\[(?P<entry>\d)\]|\.(?P<tensor>\w\w))?")


def wrench_of(given: Any, files: Files) -> Schedule | np.ndarray | None:
    """Six numbers, or a table of them over time."""
    if isinstance(given, str):
        return read_schedule(files.table(given), WRENCH, ["N"] * 3 + ["N m"] * 3)
    return None if given is None else np.array(given)


def brake_of(given: Any, arm: Model, files: Files) -> Any:
    """Numbers, a table by joint whose others are released, or a table over time."""
    braked = [body.joint for body in arm.coordinates if body.brake is not None]
    if isinstance(given, str):
        return read_schedule(files.table(given), braked)
    if not isinstance(given, dict):
        return given
    for name in given:
        if name not in braked:
            raise ScenarioError(f"brake: no brake on {name!r}; {nearest(name, braked)}")
    return [given.get(name, 0.0) for name in braked]


def payload_fields(table: PayloadTable) -> dict[str, Any]:
    """The fields of a `Payload`, its inertia as a tensor."""
    given = table.inertia_kg_m2
    if isinstance(given, Tensor):
        tensor = np.zeros((3, 3))
        for name, (i, j) in ENTRIES.items():
            tensor[i, j] = tensor[j, i] = getattr(given, name)
    else:
        tensor = None if given is None else np.diag(given)
    return {"time": table.time_s, "mass": table.mass_kg, "com": table.com_m, "inertia": tensor, "frame": table.frame}


def vary_payload(name: str, column: np.ndarray, payloads: list[dict[str, Any]]) -> None:
    """One number of a payload becomes a column of lanes: `payload[0].mass_kg`, `payload[1].com_m[2]`, `….inertia_kg_m2.xx`."""
    number, _, rest = name.removeprefix("payload[").partition("].")
    if not number.isdigit() or int(number) >= len(payloads):
        raise ScenarioError(f"lanes: no {name!r}; the file has {len(payloads)} [[payload]], counted from 0")
    found, fields = VARIED.fullmatch(rest), payloads[int(number)]
    key, entry, tensor = (None, None, None) if found is None else (found["key"], found["entry"], found["tensor"])
    whole = fields.get(FIELDS.get(str(key), ""))
    if key in ("time_s", "mass_kg") and entry is None and tensor is None:
        fields[FIELDS[key]] = Batch(column)
    elif key == "com_m" and entry is not None and int(entry) < 3 and whole is not None:
        fields["com"] = placed(whole, int(entry), column)
    elif key == "inertia_kg_m2" and tensor in ENTRIES and whole is not None:
        rows = np.array(np.broadcast_to(lane_values(whole), (len(column), 3, 3)))
        i, j = ENTRIES[tensor]
        rows[:, i, j] = rows[:, j, i] = column
        fields["inertia"] = Batch(rows)
    else:
        known = ["time_s", "mass_kg"]
        known += [f"com_m[{k}]" for k in range(3)] if fields["com"] is not None else []
        known += [f"inertia_kg_m2.{e}" for e in ENTRIES] if fields["inertia"] is not None else []
        raise ScenarioError(f"lanes: no {name!r}; {nearest(rest, known)}")


def payloads_of(payloads: list[dict[str, Any]]) -> list[Payload] | None:
    """What the scenario takes."""
    return [Payload(**fields) for fields in payloads] or None

"""Runs as MCAP: messages sensor_msgs/JointState of ROS 2, and every other signal as JSON with a schema.

| topic                    | message                          | holds                                                        |
|--------------------------|----------------------------------|--------------------------------------------------------------|
| `/joint_states`          | sensor_msgs/msg/JointState, CDR  | q, qd and tau, the torque of the motors at the joints        |
| `/measured/joint_states` | the same                         | what the sensors of a loop measured, as far as it is such    |
| `/reference/joint_states`| the same                         | what the loop was to follow                                  |
| `/signals/NAME`          | JSON: `{"joint1": 0.1, …}`       | every other variable over time; units in the schema          |

Topics of a run with lanes begin with `/lane0`, `/lane1` and so on. A message's log time and stamp are the run's time, 0 at its
begin. The CDR of OMG DDS-XTypes, XCDR version 1, little-endian, is packed here: the names of the joints are the same bytes in
every message.
"""

from __future__ import annotations

import itertools
import json
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import OutputError

if TYPE_CHECKING:
    import xarray as xr

JOINT_STATES = "joint_states"
FIELDS = ("q", "qd", "tau")  # position, velocity, effort
SIDES = {"": "", "_measured": "measured/", "_reference": "reference/"}  # ending of a variable → namespace of its topic
LATEST = 2**31 - 1  # [s]; seconds of builtin_interfaces/Time are an int32
NANOSECONDS = 10**9
SEPARATOR = "=" * 80
JOINT_STATE = f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{SEPARATOR}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{SEPARATOR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


@dataclass(frozen=True, eq=False)
class _Topic:
    """Rows of one topic: `values` (rows, …) of each field, or of one with its labels."""

    name: str
    values: tuple[np.ndarray, ...]
    labels: tuple[str, ...]
    units: tuple[str, ...] = ()
    about: str = ""


def write_mcap(run: xr.Dataset, path: Path, units: dict[str, list[str]]) -> None:
    """Writes a run as MCAP; see the table of this file.

    Args:
        run: with the dimensions in order.   path: of the file.   units: of each variable with joints.
    Raises:
        OutputError: times that a ROS 2 stamp cannot hold.
    """
    from mcap.writer import Writer

    times = run["time"].values
    if len(times) and not (times[0] >= 0 and times[-1] <= LATEST):
        value = float(times[0] if times[0] < 0 else times[-1])
        raise OutputError("no stamp of ROS 2", place="time", value=value, expected=f"0 to {LATEST} s", file=path)
    stamps = [round(each * NANOSECONDS) for each in times.tolist()]
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start(library="armwright")
        writer.add_metadata("armwright", {str(name): str(value) for name, value in run.attrs.items()})
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", JOINT_STATE.encode())
        topics = list(_topics(run, units))
        channels, packers = [], []
        for topic in topics:
            if topic.name.endswith(JOINT_STATES):
                channels.append(writer.register_channel(topic.name, "cdr", schema))
                packers.append(_JointStates(topic))
                continue
            about = json.dumps(_json_schema(topic)).encode()
            name = f"armwright.{topic.name.rpartition('/')[2]}"
            channels.append(
                writer.register_channel(topic.name, "json", writer.register_schema(name, "jsonschema", about))
            )
            packers.append(_Json(topic))
        for row, stamp in enumerate(stamps):
            for channel, packed in zip(channels, packers, strict=True):
                writer.add_message(channel, stamp, packed(row, stamp), stamp, row)
        writer.finish()


def _topics(run: xr.Dataset, units: dict[str, list[str]]) -> Iterator[_Topic]:
    """All topics of a run, lane by lane."""
    joints = tuple(str(joint) for joint in run["joint"].values)
    over_time = {str(name): each for name, each in run.data_vars.items() if "time" in each.dims}
    for lane in run["lane"].values.tolist() if "lane" in run.dims else [None]:
        space = "/" if lane is None else f"/lane{lane}/"
        part = {
            n: (v if lane is None or "lane" not in v.dims else v.sel(lane=lane)).transpose("time", ...)
            for n, v in over_time.items()
        }
        taken = set()
        for ending, side in SIDES.items():
            names = [field + ending for field in FIELDS]
            found = [part[name].values if name in part else None for name in names]
            if any(values is not None for values in found):
                taken |= set(names)
                none = np.zeros((run.sizes["time"], 0))  # a field that nothing is known of is empty
                values = tuple(none if each is None else each for each in found)
                yield _Topic(f"{space}{side}{JOINT_STATES}", values, joints)
        for name, variable in part.items():
            if name in taken:
                continue
            values = variable.values.reshape(run.sizes["time"], -1)
            if variable.dims == ("time", "joint"):
                labels, unit = joints, units[name]
            else:
                labels, unit = _labels(variable), [str(variable.attrs.get("units", "-"))] * values.shape[1]
            about = str(variable.attrs.get("long_name", name))
            yield _Topic(f"{space}signals/{topic_word(name)}", (values,), labels, tuple(unit), about)


def _labels(variable: xr.DataArray) -> tuple[str, ...]:
    """A name for each number of a row: labels of the last dimension where it has them, else numbers."""
    dims = variable.dims[1:]
    if not dims:
        return ("value",)
    names = [
        [str(each) for each in variable[dim].values] if dim in variable.coords else list(map(str, range(size)))
        for dim, size in zip(dims, variable.shape[1:], strict=True)
    ]
    return tuple("_".join(each) for each in itertools.product(*names))


def topic_word(name: str) -> str:
    """A name as a word of a ROS 2 topic: letters, digits and _ alone, no digit first."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return word if word[:1].isalpha() else f"x{word}"


def _json_schema(topic: _Topic) -> dict[str, Any]:
    numbers = {
        label: {"type": ["number", "null"], "description": unit}
        for label, unit in zip(topic.labels, topic.units, strict=True)
    }
    return {"type": "object", "description": topic.about, "properties": numbers}


class _Json:
    """Rows of a topic as JSON; NaN and infinity are null."""

    def __init__(self, topic: _Topic):
        self._labels, (values,) = topic.labels, topic.values
        self._rows = np.where(np.isfinite(values.astype(float)), values.astype(float), np.nan).tolist()

    def __call__(self, row: int, stamp: int) -> bytes:
        numbers = (None if value != value else value for value in self._rows[row])
        return json.dumps(dict(zip(self._labels, numbers, strict=True))).encode()


class _JointStates:
    """Rows of a topic as CDR of sensor_msgs/JointState."""

    def __init__(self, topic: _Topic):
        names = b""
        start = 12 + 4  # bytes before the names: sec, nanosec and length of frame_id, then its zero byte, padded
        for label in topic.labels:
            text = label.encode() + b"\0"
            names += struct.pack("<I", len(text)) + text + bytes(-len(text) % 4)
        self._names = struct.pack("<I", 1) + bytes(4) + struct.pack("<I", len(topic.labels)) + names
        self._at = start + 4 + len(names)
        self._values = [np.ascontiguousarray(each, dtype="<f8") for each in topic.values]

    def __call__(self, row: int, stamp: int) -> bytes:
        head = struct.pack("<iI", *divmod(stamp, NANOSECONDS))
        parts, at = [b"\x00\x01\x00\x00", head, self._names], self._at  # version 1, little-endian
        for values in self._values:
            numbers = values[row].tobytes()
            gap = -(at + 4) % 8 if numbers else 0  # doubles stand on 8 bytes, counted behind the first four
            parts += [struct.pack("<I", len(numbers) // 8), bytes(gap), numbers]
            at += 4 + gap + len(numbers)
        return b"".join(parts)

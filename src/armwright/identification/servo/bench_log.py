"""Logs of servos that swing a pendulum on a bench, as BAM records them. [DuclusaudEtAl2025]"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armwright.entry import as_path
from armwright.errors import LogError
from armwright.scalar import real_number

LEAST = 20  # rows of a log
NUMBERS = ("timestamp", "position", "goal_position")  # that every row has


@dataclass(frozen=True, eq=False)
class BenchLog:
    """A servo's motion on the bench, from goal to position: a rod with a mass at its tip, downward at 0.

    Attributes:
        name: of the log.   t: (k,) [s] increasing.   position: (k,) measured [rad].   goal: (k,) commanded [rad].
        on: (k,) 1 where torque is on, else 0.   supply: (k,) [V] of the servo.
        p: P of its register.   mass: at the tip [kg].   arm_mass: of the uniform rod [kg]; None: the log does not say.
        length: of the rod [m].   servo: its name; "" if unknown.   sha256: of the file; "" of a log that has none.
    """

    name: str
    t: np.ndarray
    position: np.ndarray
    goal: np.ndarray
    on: np.ndarray
    supply: np.ndarray
    p: float
    mass: float
    length: float
    arm_mass: float | None = None
    servo: str = ""
    sha256: str = ""

    def __post_init__(self) -> None:
        columns = ("t", "position", "goal", "on", "supply")
        for name in columns:
            values = np.asarray(getattr(self, name), dtype=float)
            object.__setattr__(self, name, values)
            if values.ndim != 1 or values.shape != np.shape(self.t):
                expected = f"{(np.size(self.t),)}, as there are so many times"
                raise LogError(f"shape {values.shape}", place=name, expected=expected, file=self.name)
            self._check_rows(name, np.isfinite(values), "a finite number")
        if len(self.t) < LEAST:
            raise LogError(f"{len(self.t)} rows", place="entries", expected=f"{LEAST} or more", file=self.name)
        late = np.flatnonzero(np.diff(self.t) <= 0.0)
        if len(late):
            row = int(late[0]) + 1
            what = f"not later than {self.t[row - 1]:.9g} s before it"
            raise LogError(
                what, place=f"t[{row}]", value=float(self.t[row]), expected="times to increase", file=self.name
            )
        for name in ("mass", "length", "p"):
            value = getattr(self, name)
            if not value > 0.0:
                raise LogError(place=name, value=value, expected="a number above 0", file=self.name)
        if self.arm_mass is not None and not self.arm_mass >= 0.0:
            raise LogError(place="arm_mass", value=self.arm_mass, expected="a number of 0 or more", file=self.name)
        self._check_rows("supply", self.supply > 0.0, "voltages above 0")
        self._check_rows("on", (self.on == 0.0) | (self.on == 1.0), "1, torque on, or 0, off")

    def _check_rows(self, name: str, right: np.ndarray, expected: str) -> None:
        """Refuses the first value of a column that is not right."""
        if not right.all():
            row = int(np.argmin(right))
            value = float(getattr(self, name)[row])
            raise LogError(place=f"{name}[{row}]", value=value, expected=expected, file=self.name)


def read_bench_log(path: str | os.PathLike[str]) -> BenchLog:
    """A log from BAM's JSON: mass, length, kp, and entries with timestamp, position, goal_position, torque_enable, input_volts.

    `arm_mass`, `vin` and `motor` are read where they are there. A row without `input_volts` has the voltage `vin`, one without
    `torque_enable` has torque on; other keys are left alone.

    Args:
        path: of the file.
    Returns:
        log: rows at their own, uneven times.
    Raises:
        LogError: names file, place, value and what was expected.
    Example:
        >>> log = aw.identification.read_bench_log("examples/logs/sts3250/sin_sin.json")
        >>> log.servo, log.mass, len(log.t)
        ('sts3250', 1.13, 286)
    """
    path = Path(as_path(path, "path", LogError))
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LogError(f"cannot be read: {error.strerror}", file=path) from None
    try:
        document = json.loads(content)
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise LogError(f"no JSON: {error}", file=path, expected="a log of BAM's bench") from None
    if not isinstance(document, dict) or not isinstance(document.get("entries"), list) or not document["entries"]:
        raise LogError(place="entries", expected="a list of rows, as in a log of BAM's bench", file=path)
    entries = document["entries"]
    columns = {name: [_number(row, f"entries[{k}]", name, path) for k, row in enumerate(entries)] for name in NUMBERS}
    vin = None if "vin" not in document else _number(document, "", "vin", path)
    motor = document.get("motor", "")
    return BenchLog(
        name=path.name,
        t=np.array(columns["timestamp"]),
        position=np.array(columns["position"]),
        goal=np.array(columns["goal_position"]),
        on=np.array([_number(row, f"entries[{k}]", "torque_enable", path, True) for k, row in enumerate(entries)]),
        supply=np.array([_number(row, f"entries[{k}]", "input_volts", path, vin) for k, row in enumerate(entries)]),
        p=_number(document, "", "kp", path),
        mass=_number(document, "", "mass", path),
        length=_number(document, "", "length", path),
        arm_mass=None if "arm_mass" not in document else _number(document, "", "arm_mass", path),
        servo=motor if isinstance(motor, str) else "",
        sha256=hashlib.sha256(content).hexdigest(),
    )


def _number(table: Any, place: str, key: str, path: Path, default: float | None = None) -> float:
    """A number of a table of the file; `default` where it has none."""
    if not isinstance(table, Mapping):
        raise LogError(place=place, value=table, expected="a table with keys and numbers", file=path)
    place = f"{place}.{key}" if place else key
    if key not in table and default is None:
        raise LogError("missing", place=place, expected="a number", file=path)
    value = table.get(key, default)
    number = float(value) if isinstance(value, bool) else real_number(value)
    if number is None or not np.isfinite(number):
        raise LogError(place=place, value=value, expected="a finite number", file=path)
    return float(number)


def as_bench_logs(logs: Any) -> tuple[BenchLog, ...]:
    """Logs from paths, from `BenchLog`s, or from one of them; all of the same servo.

    Raises:
        LogError: no logs, something else, or logs of several servos.
    """
    several = [logs] if isinstance(logs, (str, os.PathLike, BenchLog)) else logs
    if not isinstance(several, Sequence) or not several:
        raise LogError(place="logs", value=logs, expected="a list of files, or of aw.identification.BenchLog")
    found = []
    for each in several:
        if not isinstance(each, (str, os.PathLike, BenchLog)):
            raise LogError(place="logs", value=each, expected="a file, or an aw.identification.BenchLog")
        found.append(each if isinstance(each, BenchLog) else read_bench_log(each))
    servos = dict.fromkeys(each.servo for each in found if each.servo)
    if len(servos) > 1:
        other = next(each for each in found if each.servo == list(servos)[1])
        what = f"a log of {other.servo} beside one of {next(iter(servos))}"
        raise LogError(what, place="motor", value=other.servo, expected="logs of one servo", file=other.name)
    return tuple(found)

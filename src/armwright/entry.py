"""Arms, scenarios, logs, runs and motions as public functions take them: as they are, or by name or file.

Types and readers lie in rooms above this one. They are named here as text and imported at the call, so that every function of
every room takes the same things and refuses others in the same words.
"""

from __future__ import annotations

import functools
import importlib
import os
from dataclasses import dataclass
from types import UnionType
from typing import TYPE_CHECKING, Any, TypeAlias

from armwright.errors import ArmwrightError, LogError, ModelError, RunError, ScenarioError, ScheduleError

if TYPE_CHECKING:
    import xarray

    from armwright.identification.logs.log import Log
    from armwright.model.model import Model
    from armwright.simulation.scenario import Scenario
    from armwright.trajectory.motion import Motion

    File: TypeAlias = str | os.PathLike[str]
    AnyArm: TypeAlias = Model | File
    AnyScenario: TypeAlias = Scenario | File
    AnyLog: TypeAlias = Log | File
    AnyRun: TypeAlias = xarray.Dataset | File
    AnyMotion: TypeAlias = Motion | File
else:
    File = AnyArm = AnyScenario = AnyLog = AnyRun = AnyMotion = Any


@dataclass(frozen=True)
class AcceptedKind:
    """One of the things that functions take.

    Attributes:
        type, reader: where its type and its reader are.   error: of what is neither it nor a name or file.
        expected: what it may be, in words.
    """

    type: str
    reader: str
    error: type[ArmwrightError]
    expected: str


ENTRIES = {
    "arm": AcceptedKind(
        "armwright.model.model.Model",
        "armwright.model.load.load",
        ModelError,
        "an arm: its name, its file, or what aw.load returns",
    ),
    "scenario": AcceptedKind(
        "armwright.simulation.scenario.Scenario",
        "armwright.scenarios.file.read_scenario",
        ScenarioError,
        "a scenario: an aw.Scenario, or its file",
    ),
    "log": AcceptedKind(
        "armwright.identification.logs.log.Log",
        "armwright.identification.logs.read.read_log",
        LogError,
        "a log: its file, or what aw.identification.read_log returns",
    ),
    "run": AcceptedKind(
        "xarray.Dataset",
        "armwright.results.run_file.load_run",
        RunError,
        "a run: its file, or what aw.simulate and aw.load_run return",
    ),
    "motion": AcceptedKind(
        "armwright.trajectory.motion.Motion",
        "armwright.motions.plan.motion_in",
        ScheduleError,
        "a motion: its file, or what a planner or aw.trajectories.load_motion returns",
    ),
}


def as_arm(value: AnyArm, place: str = "arm") -> Model:
    """An arm, loaded if it is named.

    Args:
        value: the arm, its name or its file.   place: what the argument is called.
    Raises:
        ModelError: neither an arm nor a name or path, or one that does not load.
    """
    return _as("arm", value, place)


def as_scenario(value: AnyScenario, place: str = "scenario") -> Scenario:
    """A scenario, read if it is a file.

    Args:
        value: the scenario or its file.   place: what the argument is called.
    Raises:
        ScenarioError: neither a scenario nor a path, or a file that is none.
    """
    return _as("scenario", value, place)


def as_log(value: AnyLog, place: str = "log") -> Log:
    """A log, read if it is a file.

    Args:
        value: the log or its file.   place: what the argument is called.
    Raises:
        LogError: neither a log nor a path, or a file that is none.
    """
    return _as("log", value, place)


def as_run(value: AnyRun, place: str = "run") -> xarray.Dataset:
    """A run, read if it is a file.

    Args:
        value: the run or its file.   place: what the argument is called.
    Raises:
        RunError: neither a dataset nor a path, or a file that is none.
    """
    return _as("run", value, place)


def as_motion(value: AnyMotion, arm: Model | None = None, place: str = "motion") -> Motion:
    """A motion, read if it is a file.

    Args:
        value: the motion or its file.   arm: that it is for.   place: what the argument is called.
    Raises:
        ScheduleError: neither a motion nor a path, or a file that is none.
    """
    return _as("motion", value, place, arm)


def as_path(value: Any, place: str = "path", error: type[ArmwrightError] = ArmwrightError) -> str:
    """A path as text.

    Args:
        value: text or a path.   place: what the argument is called.   error: that is raised.
    Raises:
        ArmwrightError: it is neither.
    """
    if isinstance(value, (str, os.PathLike)) and isinstance(path := os.fspath(value), str):
        return path
    raise error(place=place, value=value, expected="a path")


def expect(
    value: Any, kind: type | UnionType, place: str, expected: str, error: type[ArmwrightError] = ArmwrightError
) -> None:
    """Refuses a value that is not of a type.

    Args:
        value: the argument.   kind: its type, or several with `|`.
        place: what it is called.   expected: what it may be.   error: that is raised.
    Raises:
        ArmwrightError: it is something else.
    """
    if not isinstance(value, kind):
        raise error(place=place, value=value, expected=expected)


def expect_names(value: Any, place: str, error: type[ArmwrightError] = ArmwrightError) -> None:
    """Refuses one text where a list of names is expected: each of its letters would be a name.

    Args:
        value: the argument.   place: what it is called.   error: that is raised.
    Raises:
        ArmwrightError: it is a text.
    """
    if isinstance(value, str):
        raise error(place=place, value=value, expected="a list of names")


def _as(kind: str, value: Any, place: str, *rest: Any) -> Any:
    entry = ENTRIES[kind]
    if isinstance(value, _found(entry.type)):
        return value
    if isinstance(value, (str, os.PathLike)):
        return _found(entry.reader)(value, *rest)
    raise entry.error(place=place, value=value, expected=entry.expected)


@functools.cache
def _found(dotted: str) -> Any:
    module, _, name = dotted.rpartition(".")
    return getattr(importlib.import_module(module), name)

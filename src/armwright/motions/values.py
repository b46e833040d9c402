"""Values of a motion file, checked against its arm: poses, waypoints and their times, bodies in the hand."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from armwright.errors import ArmwrightError, Problem, ScenarioError, check_known
from armwright.kinematics.aim import Aim
from armwright.model import Model, build_model
from armwright.model.payload import Payload
from armwright.motions.obstacles import obstacle
from armwright.motions.records import (
    GripSegment,
    MotionTable,
    MoveSegment,
    ReleaseSegment,
    TimeOptimalSegment,
    ToolSegment,
    WaypointsSegment,
)
from armwright.scenarios.files import Files
from armwright.scenarios.records import inertia_tensor
from armwright.spatial import TENSOR
from armwright.trajectory.limits import MotionLimits

MOVING = ("minimum_jerk", "ruckig")  # curves which may begin and end moving
KEYS = {"waypoints": "points", "duration": "duration_s", "times": "times_s"}  # by the names of fields
STAND_INS: dict[str, Any] = {  # for tables that cannot be read
    "segments": [{"kind": "dwell", "duration_s": 1.0}],
    "obstacles": [{"kind": "sphere", "radius_m": 1.0, "position_m": [0.0, 0.0, 0.0]}],
}
LEAST = {"robot": "two-link", "start": 0.0, "segments": STAND_INS["segments"]}
GRIP = {"mass": "mass_kg", "com": "com_m", "inertia": "inertia_kg_m2"}


def with_others(error: ArmwrightError, table: MotionTable, place: str, files: Files) -> ArmwrightError:
    """The error with the mistakes of all parts that can be judged without the motion before them.

    Args:
        error: the first.   table: what could be read.   place: of the file.   files: that it names.
    """
    try:
        found = _mistakes(table, build_model(files.robot(table.robot)))
    except ArmwrightError as refused:
        found = list(refused.problems)
    known = {problem.place for problem in error.problems}
    return error.joined(*(each.within(file=place) for each in found if each.place not in known))


def _mistakes(table: MotionTable, arm: Model) -> list[Problem]:
    """All errors in the parts of a motion file, each part checked on its own.

    Args:
        table: of the file.   arm: that it names.
    """
    found: list[Problem] = []
    limits = MotionLimits.of(arm)

    def judge(check: Callable[[], Any], segment: str = "") -> None:
        try:
            check()
        except ArmwrightError as error:
            found.extend(as_written(each, segment) if segment else each for each in error.problems)

    def reach(place: str, value: Any) -> None:
        limits.check_position(place, pose(place, value, arm, np.zeros(arm.n)))

    for quantity, value in table.limits.model_dump(exclude_none=True).items():
        judge(partial(MotionLimits.of, arm, **{quantity: value}))
    with suppress(ArmwrightError):
        limits = MotionLimits.of(arm, position=table.limits.position)
    judge(partial(reach, "start", table.start))
    held = False
    for k, segment in enumerate(table.segments):
        checks: list[Callable[[], Any]] = []
        if isinstance(segment, MoveSegment):
            checks = [partial(reach, "segment.goal", segment.goal), partial(check_goal_velocity, segment)]
            if segment.goal_velocity is not None:
                checks.append(partial(pose, "segment.goal_velocity", segment.goal_velocity, arm, np.zeros(arm.n)))
        elif isinstance(segment, WaypointsSegment | TimeOptimalSegment):
            checks = [partial(_within, segment.points, arm, limits)]
            if isinstance(segment, WaypointsSegment) and segment.times_s is not None:
                checks.append(partial(checked_times, segment))
        elif isinstance(segment, GripSegment):
            checks, held = [partial(gripped, segment, arm, 0.0)], True
        elif isinstance(segment, ToolSegment):
            checks = [partial(Aim.of, segment.aim)]
        elif isinstance(segment, ReleaseSegment):
            checks, held = [partial(check_held, held)], False
        for check in checks:
            judge(check, f"segments[{k}]")
    for k, each in enumerate(table.obstacles):
        judge(partial(obstacle, k, each))
    return found


def check_held(held: bool) -> None:
    """Refuses a release without a payload.

    Raises:
        ScenarioError: the hand is empty.
    """
    if not held:
        raise ScenarioError("the hand is empty", place="segment.kind", value="release", expected="a grip before it")


def _within(points: Sequence[Sequence[float]], arm: Model, limits: MotionLimits) -> None:
    """Refuses waypoints that are no poses within the limits."""
    limits.check_position("segment.points", through(points, arm))


def as_written(problem: Problem, segment: str) -> Problem:
    """A problem of a motion's type with the place as the file spells it: `Waypoints.times[2]` → `times_s[1]`."""
    place, kind = problem.place, re.match(r"([A-Z][A-Za-z]*|segment|time_optimal)\.", problem.place)
    if place.startswith("limits."):  # of the file or of the record, not of the segment
        return problem
    if place.startswith("segments["):  # of a tool's path
        place = f"path{place.removeprefix('segments')}"
    if kind is not None:
        place = place[kind.end() :]
        if kind[1] != "segment":  # a type has the pose that is reached as its first waypoint, and other names
            place = re.sub(
                r"^(points|waypoints|times)\[(\d+)\]", lambda at: f"{at[1]}[{max(int(at[2]) - 1, 0)}]", place
            )
            place = re.sub(r"^(waypoints|duration|times)\b", lambda at: KEYS[at[1]], place)
    return replace(problem, place=place).within(segment)


def pose(place: str, value: Any, arm: Model, others: np.ndarray) -> np.ndarray:
    """(n,) from one number for all joints, one for each, or a table by joint; joints not in the table get those of `others`."""
    if isinstance(value, Mapping):
        for name in value:
            check_known(ScenarioError, name, arm.names, "no joint of the arm", place=place)
        return np.array([value.get(name, other) for name, other in zip(arm.names, others, strict=True)], dtype=float)
    numbers = np.asarray(value, dtype=float)
    if numbers.shape not in ((), (arm.n,)):
        raise ScenarioError(place=place, value=value, expected=f"{arm.n} numbers: {', '.join(arm.names)}")
    return np.broadcast_to(numbers, (arm.n,)).copy()


def through(points: Sequence[Sequence[float]], arm: Model) -> np.ndarray:
    """(k, n) waypoints of a segment.

    Raises:
        ScenarioError: a point with another number of joints.
    """
    for k, point in enumerate(points):
        if len(point) != arm.n:
            expected = f"{arm.n}: {', '.join(arm.names)}"
            raise ScenarioError(f"{len(point)} numbers", place=f"segment.points[{k}]", expected=expected)
    return np.array(points)


def check_goal_velocity(segment: MoveSegment) -> None:
    """Refuses a final speed for a motion law that ends at rest.

    Raises:
        ScenarioError: names the laws that may.
    """
    if segment.goal_velocity is not None and segment.curve not in MOVING:
        expected = f"it with curve = {' or '.join(MOVING)}"
        raise ScenarioError(f"with curve = {segment.curve!r}", place="segment.goal_velocity", expected=expected)


def checked_times(segment: WaypointsSegment) -> tuple[float, ...]:
    """Times of a segment's waypoints, one for each, increasing from the segment's start.

    Raises:
        ScenarioError: other ones, or a curve or a duration that times do not go with.
    """
    times, count = segment.times_s or (), len(segment.points)
    if segment.curve == "parabolic":
        expected = "duration_s or speed: parabolic blends pass their waypoints at a distance"
        raise ScenarioError("with curve = 'parabolic'", place="segment.times_s", expected=expected)
    if segment.duration_s is not None:
        raise ScenarioError("with times_s", place="segment.duration_s", expected="either")
    if len(times) != count:
        raise ScenarioError(f"{len(times)} times", place="segment.times_s", expected=f"{count}, one a waypoint")
    for k, (before, each) in enumerate(zip((0.0, *times), times, strict=False)):
        if each <= before:
            what = f"not after {before:.10g}" if k else "not after the segment's beginning at 0"
            raise ScenarioError(what, place=f"segment.times_s[{k}]", value=each, expected="times [s] that increase")
    return times


def gripped(segment: GripSegment, arm: Model, time: float) -> Payload:
    """The body of a grip, checked.

    Args:
        segment: its table.   arm: that carries it.   time: [s] from which on.
    Raises:
        ScenarioError: a body that cannot be, or a frame that is not there.
    """
    body = _payload(segment, time)
    try:
        arm.with_payload(body.mass, body.com, body.inertia, body.frame)
    except ArmwrightError as error:
        problems = (
            replace(
                each,
                place=_grip_key(each.place),
                expected=each.expected.partition(", or accept_impossible")[0],
                file="",
            )
            for each in error.problems
        )
        raise ScenarioError.of(*problems) from None
    return body


def _grip_key(place: str) -> str:
    """Key of a grip from a place of `with_payload`: `inertia_kg_m2.xx` from `with_payload(…).xx` or `link 'payload' …`."""
    name = place.rpartition(").")[2].rpartition(" ")[2]
    first = name.split(".")[0].split("[")[0]
    return f"inertia_kg_m2.{name}" if first in TENSOR else name.replace(first, GRIP.get(first, first), 1)


def _payload(segment: GripSegment, time: float) -> Payload:
    """The body of a grip, its inertia as a tensor."""
    if segment.com_m is None and segment.inertia_kg_m2 is not None:
        expected = "one beside an inertia; a point mass has none"
        raise ScenarioError("missing", place="segment.com_m", expected=expected)
    com = None if segment.com_m is None else np.array(segment.com_m)
    inertia = None if segment.inertia_kg_m2 is None else inertia_tensor(segment.inertia_kg_m2)
    return Payload(time, segment.mass_kg, com, inertia, segment.frame)

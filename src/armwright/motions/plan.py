"""Plan of a motion file, `*.motion.toml`: segments within the limits, each from the end of the one before."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from armwright.description.toml_file import read_text
from armwright.entry import as_path
from armwright.errors import ArmwrightError, ScenarioError
from armwright.model import Model, build_model
from armwright.model.payload import Payload
from armwright.motions.obstacles import check_clearance
from armwright.motions.records import MotionTable, MoveSegment, TimeOptimalSegment, ToolSegment, WaypointsSegment
from armwright.motions.tool import tool_excesses, tool_motion
from armwright.motions.values import (
    LEAST,
    MOVING,
    STAND_INS,
    as_written,
    check_goal_velocity,
    check_held,
    checked_times,
    gripped,
    pose,
    through,
    with_others,
)
from armwright.results.result import Result
from armwright.results.table import Table, number
from armwright.scenarios.files import Files, FolderFiles
from armwright.toml_text import TomlText
from armwright.trajectory.joined import Joined
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.limits_report import LimitsReport, limits_report, unchecked_currents
from armwright.trajectory.minimum_jerk import MinimumJerk
from armwright.trajectory.motion import Motion
from armwright.trajectory.motion_files import load_motion
from armwright.trajectory.piecewise import LAST, PiecewisePolynomial
from armwright.trajectory.rest_to_rest import Cubic, Quintic
from armwright.trajectory.s_curve import SCurve
from armwright.trajectory.state_to_state import Ruckig
from armwright.trajectory.time_optimal import time_optimal
from armwright.trajectory.trapezoid import Trapezoid
from armwright.trajectory.waypoints import Waypoints
from armwright.validation import legible, validated

ENDING = ".motion.toml"

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CURVES: Mapping[str, Any] = {
    "s_curve": SCurve, "trapezoid": Trapezoid, "quintic": Quintic, "cubic": Cubic, "minimum_jerk": MinimumJerk,
    "ruckig": Ruckig,
}  # fmt: skip
NAMED, WIDE = 24, 90  # segments that a plot names, and letters in a line of them
SAME = 1e-12  # [rad | m] between poses that are one
STILL = ("grip", "release")  # kinds of segments that take no time


@dataclass(frozen=True, eq=False)
class Plan(Result):
    """A planned motion file; `str` lists its segments and the share of every limit that it uses.

    Attributes:
        arm, limits.   motion: of all segments.   kinds: of each segment.   begins: [s] of each.
        payloads: bodies in the hand, each from its time on.   limits_report: their use, payloads included.
        tool_excesses: by segment the limits of the tool that it exceeds.
        nearest: what comes nearest to what, and when; "" where no distance was asked for.   file: path of the motion file.
        title: of the file, or "".   slower: where segments of the tool are slower than requested, and why.
    """

    arm: Model
    limits: MotionLimits
    motion: Motion
    kinds: tuple[str, ...]
    begins: tuple[float, ...]
    payloads: tuple[Payload, ...]
    limits_report: LimitsReport
    tool_excesses: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    nearest: str = ""
    file: str = ""
    title: str = ""
    slower: tuple[str, ...] = ()

    def save(self, path: str | os.PathLike[str], rate: float = 500.0) -> Path:
        """Writes the motion as .csv or .nc, for `load_motion`.

        Args:
            path: the file, replaced as a whole.   rate: rows in a second [1/s].
        Returns:
            path: of the file.
        Raises:
            OutputError: the file cannot be written.
        """
        self.motion.save(self.arm, path, rate)
        return Path(path)

    @overload
    def plot(self, path: None = None) -> Figure: ...

    @overload
    def plot(self, path: str | os.PathLike[str]) -> None: ...

    def plot(self, path: str | os.PathLike[str] | None = None) -> Figure | None:
        """Figure of the motion with its torques and voltages, written to a path (.png, .svg, .pdf, .html) if one is given.

        Args:
            path: None: the figure is returned.
        Raises:
            OutputError: the file cannot be written.
        """
        from armwright.trajectory.motion_rows import plot_motion  # xarray takes a while to import

        title = f"{self.arm.name}   ·   {self.title or Path(self.file).name}"
        named = [f"{kind} {begin:.4g} s" for kind, begin in zip(self.kinds, self.begins, strict=True)]
        named[NAMED:] = [f"and {len(named) - NAMED} more"] if len(named) > NAMED else []
        lines = textwrap.wrap("segments: " + ", ".join(named), WIDE, break_on_hyphens=False)
        return plot_motion(self.arm, self.motion, path, self.payloads, title, lines)

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.arm.name}: {self.motion.duration:.4g} s" + (f", {self.title}" if self.title else "")

    @property
    def good(self) -> bool:
        """True if no limit is exceeded."""
        return self.kept

    def sentences(self) -> list[str]:
        """Limits that are exceeded or not checked, what comes nearest, segments that are slower, notes."""
        over = [f"exceeds limits: {each}" for each in self.excesses()] or [self.limits_report.verdict()]
        over += [f"not checked: {each}" for each in self.limits_report.unchecked]
        over += [f"nearest: {self.nearest}"] if self.nearest else []
        return [*over, *self.slower, *(f"note: {note}" for note in self.limits_report.notes)]

    def tables(self) -> list[Table]:
        """A row for each segment; then the use of the limits."""
        ends = (*self.begins[1:], self.motion.time + self.motion.duration)
        rows = [
            [str(k), kind, number(begin), number(end - begin)]
            for k, (kind, begin, end) in enumerate(zip(self.kinds, self.begins, ends, strict=True), 1)
        ]
        segments = Table(self.heading, ("segment", "kind", "from [s]", "for [s]"), rows, ("kind",))
        return [segments, *self.limits_report.tables()]

    def __str__(self) -> str:
        ends = (*self.begins[1:], self.motion.time + self.motion.duration)
        rows = zip(self.kinds, self.begins, ends, strict=True)
        lines = [self.heading]
        lines += [
            f"{k:>3} {kind:<14} from {begin:9.4f} s  for {end - begin:9.4f} s"
            for k, (kind, begin, end) in enumerate(rows, 1)
        ]
        return "\n".join([*lines, "largest use of every limit:", self.limits_report.table(), *self.sentences()])

    @property
    def kept(self) -> bool:
        """True if no segment exceeds a limit that could be checked; `limits_report.unchecked` names the others."""
        return not self.excesses()

    def excesses(self) -> list[str]:
        """Sentences, one for each limit that a segment exceeds: which segment, which joint, when, by how much."""
        moving = [k for k, kind in enumerate(self.kinds) if kind not in STILL]
        parts = self.limits_report.parts or (self.limits_report,)
        found = [(k, each) for k, part in zip(moving, parts, strict=True) for each in part.excesses()]
        found += [(k, each) for k, excesses in self.tool_excesses.items() for each in excesses]
        return [f"segments[{k}] ({self.kinds[k]}): {each}" for k, each in sorted(found, key=lambda each: each[0])]


def plan(path: str | os.PathLike[str], *, allow: Iterable[str | os.PathLike[str]] = ()) -> Plan:
    """The planned motion of a motion file.

    Args:
        path: of the `*.motion.toml`; a robot file that it names stands in its folder or below.
        allow: further folders that it may name files in.
    Returns:
        plan: motion, segments, payloads and a report of how much of every limit is used.
    Raises:
        ArmwrightError: no such file, a key or value that cannot be, a segment that cannot be planned; names file, segment,
            key, value and what was expected.
    Example:
        >>> plan = aw.trajectories.plan("examples/motions/pick-and-place.motion.toml")
        >>> print(plan.kept, round(plan.motion.duration, 2))
        True 10.43
    """
    path = Path(as_path(path, "path", ScenarioError))
    files = FolderFiles(path.parent, [Path(folder) for folder in allow])
    return plan_text(read_text(path, ScenarioError), str(path), files)


def motion_in(path: str | os.PathLike[str], arm: Model | None = None) -> Motion:
    """The motion of any file of one: planned from a motion file, `*.motion.toml`, or the rows of a .csv or .nc.

    Args:
        path: of the file.   arm: whose joints move; None: those that the file names.
    Raises:
        ArmwrightError: as `plan` and `load_motion`.   ScenarioError: a motion of another arm.
    """
    if not os.fspath(path).endswith(ENDING):
        return load_motion(path, arm)
    planned = plan(path)
    if arm is not None and (planned.arm.name, *planned.arm.names) != (arm.name, *arm.names):
        what = f"is a motion of {planned.arm.name}"
        raise ScenarioError(what, file=path, expected=f"one of {arm.name}")
    return planned.motion.from_file(path)


def plan_text(text: str, place: str, files: Files) -> Plan:
    """The plan of a motion file.

    Args:
        text: of the file.   place: what errors call it.   files: that it names.
    Raises:
        ArmwrightError: as `plan`.
    """
    document = TomlText(text, place)
    with document.checked(ScenarioError):
        if "joints" in document.tables and "segments" not in document.tables:
            raise ScenarioError(
                "is a robot file", file=place, expected="a motion file, which names a robot and has [[segments]]"
            )
        try:
            table = validated(MotionTable, document.tables, file=place, error=ScenarioError)
        except ScenarioError as error:
            without = legible(MotionTable, document.tables, LEAST, STAND_INS)
            raise error if without is None else with_others(error, without, place, files) from None
        try:
            arm = build_model(files.robot(table.robot))
            limits = MotionLimits.of(arm, **table.limits.model_dump())
            run = _Planning(arm, limits, pose("start", table.start, arm, np.zeros(arm.n)))
            limits.check_position("start", run.q)
            for k, segment in enumerate(table.segments):
                try:
                    run.add(segment)
                except ArmwrightError as error:
                    raise ScenarioError.of(*(as_written(each, f"segments[{k}]") for each in error.problems)) from None
        except ArmwrightError as error:
            raise with_others(error.within(file=place), table, place, files) from None
        if run.motions and run.qd.any():
            joint = arm.names[int(np.argmax(np.abs(run.qd)))]
            what, expected = f"ends while {joint} is moving", "a last segment that ends at rest"
            raise ScenarioError(what, place=f"segments[{len(table.segments) - 1}]", expected=expected, file=place)
        if not run.motions:
            raise ScenarioError("nothing moves", place="segments", expected="a move, waypoints or a dwell", file=place)
        payloads = tuple(run.payloads)
        motion = Joined(run.motions, payloads).from_file(place)
        try:
            nearest = check_clearance(arm, motion, table, run.begins)
        except ArmwrightError as error:
            raise error.within(file=place) from None
        report = limits_report(arm, motion, limits, payload=payloads)
        notes = (*report.notes, *(each for k, segment in enumerate(table.segments) for each in run.doubts(k, segment)))
        report = replace(report, unchecked=(*report.unchecked, *unchecked_currents(arm)), notes=notes)
        return Plan(
            arm, limits, motion, tuple(run.kinds), tuple(run.begins), payloads, report, run.tool_excesses, nearest, place,
            table.title or "", tuple(run.slower),
        )  # fmt: skip


@dataclass
class _Planning:
    """State of planning: where and how fast the arm is, and what was planned so far."""

    arm: Model
    limits: MotionLimits
    q: np.ndarray
    qd: np.ndarray = field(default_factory=lambda: np.zeros(0))
    qdd: np.ndarray = field(default_factory=lambda: np.zeros(0))
    time: float = 0.0
    motions: list[Motion] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)
    begins: list[float] = field(default_factory=list)
    payloads: list[Payload] = field(default_factory=list)
    slower: list[str] = field(default_factory=list)
    tool_excesses: dict[int, tuple[str, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.qd, self.qdd = np.zeros(self.arm.n), np.zeros(self.arm.n)

    def add(self, segment: Any) -> None:
        """Plans a segment from the state at the end of the last one."""
        self.kinds.append(segment.kind)
        self.begins.append(self.time)
        if segment.kind == "grip":
            self.payloads.append(gripped(segment, self.arm, self.time))
        elif segment.kind == "release":
            check_held(bool(self.payloads) and self.payloads[-1].mass > 0.0)
            self.payloads.append(Payload(self.time, 0.0, frame=self.payloads[-1].frame))
        else:
            self.follow(self.planned(segment))

    def follow(self, motion: Motion) -> None:
        """Moves the state on to the end of a motion."""
        end = float(motion.time + motion.duration)
        if not end <= LAST:
            what, expected = f"ends at {end:.3g} s", f"an end within {LAST:.0e} s"
            raise ScenarioError(what, place="segment.kind", value=self.kinds[-1], expected=expected)
        self.motions.append(motion)
        self.time = end
        self.q, self.qd, self.qdd = (np.where(np.abs(each) < SAME, 0.0, each) for each in motion.at(self.time))
        if not self.qd.any():
            self.qdd = np.zeros(self.arm.n)  # a deceleration ends where the arm stands

    def planned(self, segment: Any) -> Motion:
        """The motion of a segment."""
        if self.qd.any() and getattr(segment, "curve", None) not in MOVING:
            joint = self.arm.names[int(np.argmax(np.abs(self.qd)))]
            expected = f"curve = {' or '.join(MOVING)} where the segment before ends moving"
            raise ScenarioError(f"{joint} is moving", place="segment.curve", expected=expected)
        if segment.kind == "dwell":
            times = np.array([self.time, self.time + segment.duration_s])
            return PiecewisePolynomial(times, self.q[None, :, None])
        if isinstance(segment, MoveSegment):
            return self.move(segment)
        if isinstance(segment, ToolSegment):
            motion = tool_motion(self.arm, segment, self.q, self.limits, self.time)
            self.tool_excesses[len(self.kinds) - 1] = tool_excesses(segment, motion)
            if motion.stretches:
                how = (
                    f"{'' if segment.slow == 'everywhere' else 'up to '}{motion.slowed:.3g} times slower than requested"
                )
                place = f"segments[{len(self.kinds) - 1}]"
                self.slower += [f"{place} is {how}: {each}" for each in motion.stretches]
            return motion
        points = np.vstack([self.q, through(segment.points, self.arm)])
        if isinstance(segment, TimeOptimalSegment):
            held = self.payloads[-1] if self.payloads and self.payloads[-1].mass > 0.0 else None
            return time_optimal(self.arm, points, self.limits, payload=held, grid=segment.grid, time=self.time)
        return self.waypoints(segment, points)

    def doubts(self, k: int, segment: Any) -> list[str]:
        """Notes on angles of a segment that look like degrees."""
        place = f"segments[{k}]"
        if isinstance(segment, MoveSegment):
            q = pose(f"{place}.goal", segment.goal, self.arm, np.zeros(self.arm.n))
            return self.limits.doubts_of_degrees(f"{place}.goal", q)
        points = getattr(segment, "points", None)
        return [] if points is None else self.limits.doubts_of_degrees(f"{place}.points", through(points, self.arm))

    def slowed(self, speed: float) -> MotionLimits:
        """Limits of the same motion played slower."""
        limits = self.limits
        return limits.replace(
            velocity=limits.velocity * speed, acceleration=limits.acceleration * speed**2, jerk=limits.jerk * speed**3
        )

    def move(self, segment: MoveSegment) -> Motion:
        """A move to a pose."""
        goal = pose("segment.goal", segment.goal, self.arm, self.q)
        kind, options = CURVES[segment.curve], {"limits": self.slowed(segment.speed), "duration": segment.duration_s}
        check_goal_velocity(segment)
        if segment.curve in MOVING:
            options |= {"start_velocity": self.qd, "start_acceleration": self.qdd}
            if segment.goal_velocity is not None:
                options["goal_velocity"] = pose("segment.goal_velocity", segment.goal_velocity, self.arm, 0.0 * self.q)
        return kind(self.q, goal, time=self.time, **options)

    def waypoints(self, segment: WaypointsSegment, points: np.ndarray) -> Motion:
        """A curve through waypoints."""
        times = None
        if segment.times_s is not None:
            times = self.time + np.array([0.0, *checked_times(segment)])
        return Waypoints(points, self.slowed(segment.speed), segment.curve, times, segment.duration_s, time=self.time)

"""Comparison of controllers: the same arm, motions, payloads and noise, with error measures for each."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.control.comparison.measures import (
    POINTS,
    PathErrors,
    ToolPath,
    attained_points,
    last_direction,
    overshoot,
    path_errors,
    settling_time,
    tool_path,
)
from armwright.control.comparison.picture import MOST_ROWS, draw_comparison
from armwright.entry import AnyScenario, as_scenario
from armwright.errors import Interrupted, ScenarioError
from armwright.fitting.measures import rms
from armwright.kernels.compiled import compile_arm
from armwright.model import Model
from armwright.model.payload import Payload
from armwright.output import check_destination, whole_file
from armwright.parameters import Batch
from armwright.progress import Shown, automatic
from armwright.results.result import Result
from armwright.results.table import Table
from armwright.simulation.checks import check_time, check_whole
from armwright.simulation.oscillation import unstable_loop
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Loop, Recording, Start
from armwright.simulation.simulation import SUPPORT as SIMULATED, simulate
from armwright.trajectory.motion import Motion

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

SUPPORT = replace(
    SIMULATED,
    consumer="compare_controllers",
    without_effect={
        **SIMULATED.without_effect,
        **dict.fromkeys(
            ("pose", "schedule of poses", "motion", "grips of a motion"),
            "each motion of the comparison is the reference",
        ),
        "moving start": "runs begin where a motion does, at rest",
    },
    refused={"commands over time": "none beside controllers"},
)

INSTANTS = 400  # of the largest errors over time, in equal parts of a run
RUNS = 8  # of a case, where nothing says otherwise
DENSE = 4001  # samples of a commanded path
ANALYSED = 5  # poses of a motion about which loops are linear
ENDINGS = (".csv", ".nc")
CASE = ("controller", "motion", "payload")
OF_JOINTS = {  # variable → unit ("q": that of the position) and meaning
    "rms_error": ("q", "root mean square of the joint's error while the motion lasts, over all runs"),
    "largest_error": ("q", "largest error of the joint in any run"),
    "settling_time": ("s", "time after the motion's end until the joint stays within the band, of the slowest run"),
    "overshoot": ("q", "how far the joint went past the motion's end, in the worst run"),
    "peak_share": (
        "-",
        "largest voltage, current or torque that the drive was commanded and did, in parts of its limit",
    ),
    "saturation": ("-", "share of ticks in which the drive did less than was commanded"),
}
OF_TOOL = {
    "path_mean": "mean path deviation of the tool",
    "path_largest": "largest path deviation of the tool",
    "path_accuracy": "largest distance of the mean path from the commanded one, AT_p of ISO 9283",
    "path_repeatability": "spread of the runs about their mean path, RT_p of ISO 9283",
}


@dataclass(frozen=True, eq=False)
class Comparison(Result):
    """Results of `compare_controllers`.

    Attributes:
        data: dataset along controller, motion and payload, and joint where a measure is one of a joint; units and meanings in
            attributes. `deviation` (…, point) [m] is the largest path deviation of any run along the path,
            `error` (…, instant, joint) the largest error over time, `watched` (controller, motion) [s] how long a run lasts,
            `failed` the number of runs that diverged or ran out of steps: a case with one has no measures.
        band: (n,) [rad | m] of the settling time.   runs: in each case.
        notes: sentences on controllers whose loops are unstable at a pose of a motion.
    """

    data: xr.Dataset
    band: np.ndarray
    runs: int
    notes: tuple[str, ...] = ()

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"joints, the worst of each case; {self.runs} runs each, settled within {self.band.max():g} rad | m"

    def tables(self) -> list[Table]:
        """Joints and drives, the worst joint of every case; and the path deviation of the tool, if it moves."""
        errors = [(name, unit) for unit in ("rad", "m") for name in ("rms_error", "largest_error", "overshoot")]
        heads = [f"{name.replace('_', ' ')} [{unit}]" for name, unit in errors]
        heads += ["settling [s]", "peak of limit", "saturated", "failed runs"]
        of_tool = ("mean [mm]", "largest [mm]", "AT_p [mm]", "RT_p [mm]")

        def cells(case: xr.Dataset) -> list[str]:
            of_kind = [_worst(case[name].values[case["unit"].values == unit]) for name, unit in errors]
            shares = [_worst(case[name].values, 100.0, " %") for name in ("peak_share", "saturation")]
            return [*of_kind, _worst(case["settling_time"].values), *shares, str(int(case["failed"]) or "—")]

        joints = [[*names, *cells(case)] for names, case in self._cases()]
        tool = [[*names, *(_worst(case[each].values, 1e3) for each in OF_TOOL)] for names, case in self._cases()]
        found = [
            Table(self.heading, (*CASE, *heads), joints, CASE),
            Table("tool off its path", (*CASE, *of_tool), tool, CASE),
        ]
        return [each for each in found if any(set(row[len(CASE) :]) != {"—"} for row in each.cells)] or found[:1]

    def sentences(self) -> list[str]:
        """Its notes."""
        return list(self.notes)

    @property
    def height(self) -> float:
        """Of its picture [inch]."""
        return 0.9 + 2.6 * min(self.data.sizes["motion"] * self.data.sizes["payload"], MOST_ROWS)

    def draw(self, figure: Figure, ink: str, quiet: str) -> None:
        """Draws a row for each motion and payload, and a curve for each controller."""
        draw_comparison(figure, self.data, ink)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the measures as `.csv`, a row for each case and joint, or as `.nc`, the whole dataset with units and meanings.

        Returns:
            path: of the file.
        Raises:
            ArmwrightError: another ending, or a file that cannot be written.
        """
        path = check_destination(path, ENDINGS)
        with whole_file(path, ENDINGS) as temporary:
            if path.suffix.lower() == ".nc":
                self.data.to_netcdf(temporary, engine="h5netcdf")
            else:
                table = self.data[[*OF_JOINTS, *OF_TOOL, "failed"]].drop_vars("unit").to_dataframe()
                table.to_csv(temporary, lineterminator="\n")
        return path

    def _cases(self) -> Iterator[tuple[list[str], xr.Dataset]]:
        """Names and measures of every case, controllers of the same motion and payload below each other."""
        data = self.data
        for motion, payload, controller in itertools.product(
            *(range(data.sizes[name]) for name in (*CASE[1:], CASE[0]))
        ):
            place = {"controller": controller, "motion": motion, "payload": payload}
            yield [str(data[name].values[place[name]]) for name in CASE], data.isel(place)


def compare_controllers(
    scenario: AnyScenario,
    controllers: Mapping[str, Any],
    motions: Mapping[str, Any],
    payloads: Mapping[str, Any] | Sequence[Any] = (None,),
    runs: int | None = None,
    *,
    band: Any = 1e-3,
    settle: float = 1.0,
    progress: Shown = None,
) -> Comparison:
    """Errors, path accuracy, settling, overshoot and effort of controllers that follow the same motions.

    Each controller follows each motion with each payload in one compiled simulation, whose lanes are runs that differ in
    noise, jitter, losses and draws, and in what the scenario's own lanes differ in. Measures as in [ISO9283]; the tool's place
    follows from the joints' by the record.

    Args:
        scenario: the arm with its loop: period, sensors, timing, solver. Its duration, start, reference and rows are replaced.
        controllers: by name a controller for the scenario's loop, or a `Scenario` of the same arm with a loop of its own.
        motions: by name a `Motion`, or an `aw.trajectories.Plan` with what it carries.
        payloads: by name or in a row, in the hand of all motions: a `Payload`, several, or None for what a motion or its scenario
            has.
        runs: 1 or more, the repeatability needs 2; default: as many as the scenarios have lanes, or 8.
        band: [rad | m] of the settling time, one number or (n,).
        settle: [s] that a run goes on after the motion's end.
        progress: True or None: a bar where it is seen; False: none; a function is called with cases done and of all.
    Returns:
        comparison: its dataset, and the rows of a table.
    Raises:
        ScenarioError: no controllers or motions, another arm, a motion of other joints or without an end; as `simulate`.
        Interrupted: Ctrl-C; `found` holds the comparison of the controllers that were finished.
    Example:
        >>> pid = aw.JointPID(kp=[900.0, 250.0], kd=[180.0, 50.0])
        >>> move = aw.trajectories.Quintic([0.0, 0.0], [0.5, -0.5], duration=0.5)
        >>> scenario = aw.Scenario("two-link", 1.0, loop=aw.Loop(pid, move, period=0.002))
        >>> kinds = {"PD": pid, "with model": aw.FeedForward(pid, inertia="full")}
        >>> found = aw.loops.compare_controllers(scenario, kinds, {"move": move}, runs=1)
        >>> {row["controller"]: row["rms error 1"] for row in found.rows()}
        {'PD': 0.0833, 'with model': 0.000306}
    """
    scenario = as_scenario(scenario)
    arm = scenario.arm
    if runs is not None:
        check_whole("runs", runs, 1)
    check_time("settle", settle)
    widths = _band(arm, band)
    loops = {name: _scenario_of(scenario, name, each) for name, each in _named("controllers", controllers).items()}
    paths = {name: _Course.of(arm, name, each) for name, each in _named("motions", motions).items()}
    hands = _payloads(payloads, any(each.payloads for each in paths.values()))
    dyn = compile_arm(arm) if arm.tip is not None else None
    loops, count = _in_runs(loops, runs)
    poses = np.concatenate([_poses(each) for each in paths.values()])
    cases: list[list[list[dict[str, Any]]]] = []
    unstable: list[str | None] = []
    done, total = itertools.count(), len(loops) * len(paths) * len(hands)
    with automatic(progress, "comparing controllers") as tell:
        try:
            for loop in loops.values():
                of_loop = []
                for course, hand in itertools.product(paths.values(), hands.values()):
                    tell(next(done), total)
                    of_loop.append(_case(loop, course, hand, count, widths, settle, dyn))
                unstable.append(unstable_loop(loop, poses))
                cases.append([of_loop[k : k + len(hands)] for k in range(0, len(of_loop), len(hands))])
        except KeyboardInterrupt:
            if not cases:
                raise
    names = list(loops)[: len(cases)]
    data = _dataset(arm, cases, (names, list(paths), list(hands)))
    notes = tuple(f"{name}: {said}" for name, said in zip(names, unstable, strict=False) if said is not None)
    if len(names) == len(loops):
        return Comparison(data, widths, count, notes)
    stopped = f"before {', '.join(list(loops)[len(names) :])} could be compared"
    data.attrs["stopped"] = f"by Ctrl-C {stopped}"
    raise Interrupted(stopped, found=Comparison(data, widths, count, notes))


def _poses(course: _Course) -> np.ndarray:
    """(k, n) poses on the way of a motion, both ends among them, about which its loops are analysed."""
    return course.motion.at(np.linspace(float(course.motion.time), course.end, ANALYSED))[0]


@dataclass(frozen=True, eq=False)
class _Course:
    """A motion with what it carries, and the path of the tool."""

    motion: Motion
    payloads: tuple[Payload, ...]
    path: ToolPath | None
    direction: np.ndarray
    end: float

    @classmethod
    def of(cls, arm: Model, name: str, given: Any) -> _Course:
        """The motion with a name, with the tool's path.

        Raises:
            ScenarioError: no motion, one of other joints, or one without an end.
        """
        motion, place = getattr(given, "motion", given), f"motions[{name!r}]"
        if not isinstance(motion, Motion):
            raise ScenarioError(
                place=place, value=given, expected="a motion of armwright.trajectory, or an aw.trajectories.Plan"
            )
        if motion.n != arm.n:
            raise ScenarioError(
                f"a motion of {motion.n} joints", place=place, expected=f"{arm.n}: {', '.join(arm.names)}"
            )
        end = float(motion.time + motion.duration)
        if not np.isfinite(end):
            raise ScenarioError("does not end", place=place, expected="a motion with a duration")
        t = np.union1d(np.linspace(float(motion.time), end, DENSE), motion.breaks)
        q, qd, _ = motion.at(t)
        path = tool_path(t, tool_positions(compile_arm(arm), q)) if arm.tip is not None else None
        return cls(motion, tuple(getattr(given, "payloads", ())), path, last_direction(qd), end)


def tool_positions(dyn: Any, q: np.ndarray) -> np.ndarray:
    """(…, 3) [m] of the tip at joint positions q (…, n), in base axes."""
    return np.asarray(dyn.forward_kinematics(q))[..., :3, 3]


def _case(
    loop: Scenario, course: _Course, hand: Any, runs: int, band: np.ndarray, settle: float, dyn: Any
) -> dict[str, Any]:
    """Measures of one controller on one motion with one payload."""
    scenario = _followed(loop, course, hand, runs, settle)
    run = simulate(scenario.without_global_error)
    t, q = run["time"].values, run["q"].values
    n, failed = q.shape[-1], 0
    for name in ("diverged_at", "stalled_at"):
        failed += int(run[name].notnull().sum()) if name in run else 0
    case: dict[str, Any] = {"failed": failed, "watched": float(t[-1])}
    if failed:
        nothing = dict.fromkeys(OF_JOINTS, np.full(n, np.nan)) | dict.fromkeys(OF_TOOL, np.nan)
        return case | nothing | {"deviation": np.full(POINTS, np.nan), "error": np.full((INSTANTS, n), np.nan)}
    error = q - course.motion.at(t)[0]
    moving = (t >= course.motion.time) & (t <= course.end)
    after, goal = t >= course.end, course.motion.at(course.end)[0]
    case |= {
        "rms_error": rms(error[:, moving], axis=(0, 1)),
        "largest_error": np.abs(error).max(axis=(0, 1)),
        "settling_time": settling_time(t, error, course.end, band).max(axis=0),
        "overshoot": overshoot(q[:, after], goal, course.direction).max(axis=0),
        "peak_share": _peak_share(loop.arm, run),
        "saturation": run["saturation"].values.mean(axis=0),
        "error": np.maximum.reduceat(np.abs(error).max(axis=0), np.arange(INSTANTS) * len(t) // INSTANTS, axis=0),
    }
    tool, deviation = PathErrors(np.nan, np.nan, np.nan, np.nan), np.full(POINTS, np.nan)
    if course.path is not None:
        attained = attained_points(course.path, t, tool_positions(dyn, q))
        tool = path_errors(course.path, attained)
        deviation = np.linalg.norm(attained - course.path.points, axis=2).max(axis=0)
    return case | {name: getattr(tool, name.removeprefix("path_")) for name in OF_TOOL} | {"deviation": deviation}


def _followed(loop: Scenario, course: _Course, hand: Any, runs: int, settle: float) -> Scenario:
    """The scenario of one case: as many lanes as runs, from the beginning of the motion until it has settled."""
    assert loop.loop is not None
    ticks = math.ceil((course.end + settle) / loop.tick - 1e-9)
    q, qd, _ = course.motion.at(0.0)
    carried = hand if hand is not None else list(course.payloads) or loop.inputs.payload
    return replace(
        loop,
        duration=ticks * loop.tick,
        loop=replace(loop.loop, reference=course.motion),
        inputs=replace(loop.inputs, payload=carried),
        start=Start(Batch(np.tile(q, (runs, 1))), Batch(np.tile(qd, (runs, 1)))),
        recording=Recording(what="state", reduce=("saturation", *sorted(set(_peaks(loop.arm))))),
        lanes=runs,
    )


def command_limits(arm: Model) -> np.ndarray:
    """(n,) [V | A | N m | N] largest command of each drive; infinite for a drive without a limit in the record."""
    found = []
    for body in arm.coordinates:
        drive, limits = body.drive.bridge, body.limits
        per_ampere = abs(float(drive.gear_ratio) * float(drive.torque_constant or 0.0))
        if drive.command == "current" and per_ampere:
            found.append(min(limits.current, limits.torque / per_ampere))
        elif drive.command == "torque" and per_ampere:
            found.append(min(limits.torque, limits.current * per_ampere))
        else:
            found.append(getattr(limits, drive.command))
    return np.array(found, dtype=float)


def _peaks(arm: Model) -> list[str]:
    """Name of the reducer of each joint's command."""
    return [f"peak_{body.drive.bridge.command}" for body in arm.coordinates]


def _peak_share(arm: Model, run: xr.Dataset) -> np.ndarray:
    """(n,) largest command of each drive in any run, as a share of its limit; NaN without a limit."""
    peaks = np.array([float(run[name].values[:, j].max()) for j, name in enumerate(_peaks(arm))])
    limits = command_limits(arm)
    return np.where(np.isfinite(limits), peaks / limits, np.nan)


def _named(place: str, given: Any) -> dict[str, Any]:
    if not isinstance(given, Mapping) or not given:
        raise ScenarioError(place=place, value=given, expected="at least one, by name: {'name': …}")
    return {str(name): each for name, each in given.items()}


def _scenario_of(base: Scenario, name: str, given: Any) -> Scenario:
    """The scenario of a named controller."""
    place = f"controllers[{name!r}]"
    if not isinstance(given, Scenario):
        if base.command is not None:
            raise ScenarioError("commands over time", place="command", expected="none beside controllers, or a loop")
        loop = base.loop or Loop()
        return replace(base, command=None, loop=replace(loop, controller=given, reference=None))
    if given.arm.record != base.arm.record:
        what = f"{given.arm.name}, with another record"
        raise ScenarioError(what, place=place, expected=f"{base.arm.name}, so that controllers alone differ")
    if given.controller is None:
        raise ScenarioError("has no controller", place=place, expected="a scenario whose loop has one")
    return given


def _in_runs(loops: Mapping[str, Scenario], asked: int | None) -> tuple[dict[str, Scenario], int]:
    """Scenarios with one lane for each run, if they are batched, and that number: by default the smallest number of lanes.

    Raises:
        ScenarioError: more runs than a scenario has lanes.
    """
    counts = {name: each.lane_count for name, each in loops.items() if each.lane_count is not None}
    runs = min(counts.values(), default=RUNS) if asked is None else asked
    for name, count in counts.items():
        if runs > count:
            raise ScenarioError(place="runs", value=runs, expected=f"{count} at most, the lanes of {name!r}")
    cut = {name: replace(loops[name], lanes=range(runs)).resolved for name in counts}
    return {name: cut.get(name, each) for name, each in loops.items()}, runs


def _payloads(given: Any, planned: bool) -> dict[str, Any]:
    """Payloads by name; without names they are called by their masses."""
    if isinstance(given, Mapping):
        return _named("payloads", given)
    if not isinstance(given, Sequence) or not given:
        raise ScenarioError(
            place="payloads", value=given, expected="payloads, or None for an empty hand, by name or in a row"
        )
    found: dict[str, Any] = {}
    for each in given:
        bodies = [each] if isinstance(each, Payload) else each or []
        name = ", ".join("batch" if isinstance(one.mass, Batch) else f"{one.mass:g} kg" for one in bodies)
        name = name or ("as planned" if planned else "none")
        found[name if name not in found else f"{name} ({len(found) + 1})"] = each
    return found


def _band(arm: Model, band: Any) -> np.ndarray:
    try:
        widths = np.broadcast_to(np.asarray(band, dtype=float), (arm.n,))
    except (ValueError, TypeError):
        widths = np.zeros(1)
    if not (np.isfinite(widths) & (widths > 0.0)).all():
        raise ScenarioError(place="band", value=band, expected=f"a number above 0 [rad | m], or {arm.n} of them")
    return widths


def _dataset(arm: Model, cases: list[Any], names: tuple[list[str], ...]) -> xr.Dataset:
    """The dataset of all cases."""
    import xarray as xr

    from armwright.model.joint_signals import joint_units

    units = joint_units(arm, "q")
    shown = " | ".join(dict.fromkeys(units))

    def variable(name: str, more: tuple[str, ...], unit: str, about: str) -> tuple[Any, ...]:
        values = np.array([[[case[name] for case in row] for row in rows] for rows in cases])
        return (*CASE, *more), values, {"units": shown if unit == "q" else unit, "long_name": about}

    found = {name: variable(name, ("joint",), unit, about) for name, (unit, about) in OF_JOINTS.items()}
    found |= {name: variable(name, (), "m", about) for name, about in OF_TOOL.items()}
    found["deviation"] = variable("deviation", ("point",), "m", "largest path deviation in any run")
    found["error"] = variable("error", ("instant", "joint"), "q", "largest error in any run")
    found["watched"] = variable("watched", (), "s", "duration of a run")
    found["failed"] = variable("failed", (), "-", "runs that diverged or ran out of steps")
    coordinates = dict(zip(CASE, names, strict=True)) | {"joint": list(arm.names), "unit": ("joint", list(units))}
    coordinates["point"] = (np.arange(POINTS) + 0.5) / POINTS
    coordinates["instant"] = (np.arange(INSTANTS) + 0.5) / INSTANTS
    return xr.Dataset(found, coords=coordinates)


def _worst(values: Any, factor: float = 1.0, ending: str = "") -> str:
    """The largest known value in words; — where none is known."""
    values = np.atleast_1d(values) * factor
    values = values[~np.isnan(values)]
    return f"{values.max():.3g}{ending}".replace("inf", "∞") if len(values) else "—"

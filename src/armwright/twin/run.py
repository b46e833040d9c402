"""A scenario's controller, run over a bus: in lock-step or in real time."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from armwright.entry import expect
from armwright.errors import BusError, Interrupted, OutputError, Problem, RunStopped
from armwright.results.result import Result
from armwright.results.table import Table, number
from armwright.scalar import real_numbers
from armwright.simulation.checks import is_whole
from armwright.simulation.scenario import Scenario
from armwright.twin import clock
from armwright.twin.bus import BITRATE, bus_errors, check_bus
from armwright.twin.cycles import CycleReport
from armwright.twin.difference import RunDifference, first_difference
from armwright.twin.law import Law
from armwright.twin.master import ANSWERED, BEATS, ENABLE, HEARTBEAT, MISSING, ROUNDING, Ending, Master, Trouble
from armwright.twin.rehearsal import Rehearsal, rehearse
from armwright.twin.safety import Permission, bound, check_permission, check_serial
from armwright.twin.state_machine import State

VIRTUAL = Permission()  # enough for a bus of this process
SLIPPED = 0.5  # of a period: from when on SYNC is not made up for
MARGIN, LEAST_ERROR = 2.0, 0.0175  # of the rehearsal's largest error; at least a degree, or 17.5 mm
MOST_SILENCE, LEAST_MOST_MISSING = 0.02, 3  # [s] and cycles that a node may be silent for at the most lenient setting
LEAST_BEAT, MOST_BEAT = 1e-3, 65.535  # [s] that object 1016 holds
INCOMPLETE = 1e-3  # share of incomplete cycles of a run that still counts as the rehearsal of an arm


@dataclass(frozen=True, eq=False)
class BusRun(Result):
    """A run over a bus.

    Attributes:
        rehearsal: the same run as it was simulated.   time: (ticks,) [s].   q: (ticks, n) measured [rad | m].
        u: (ticks, n) commands [A | N m | N].   applied: (ticks, n) what the drives did.   cycles: what was counted.
        ending: state of the drives at its end; None if not known.   trouble: the cause that ended it early; None without one.
    """

    rehearsal: Rehearsal
    time: np.ndarray
    q: np.ndarray
    u: np.ndarray
    applied: np.ndarray
    cycles: CycleReport
    ending: Ending | None = None
    trouble: Trouble | None = None

    @property
    def errors(self) -> np.ndarray:
        """(ticks, n) reference less measured position [rad | m]."""
        return self.rehearsal.reference[: len(self.q)] - self.q

    @property
    def complete(self) -> bool:
        """True if the run reached its end, with every node answering there."""
        return self.trouble is None and len(self.q) == self.rehearsal.recording.ticks

    @property
    def counts(self) -> bool:
        """True for a complete run in which at least 99.9 % of the cycles were complete; else it rehearses nothing."""
        return self.complete and self.cycles.incomplete <= INCOMPLETE * self.cycles.cycles

    @property
    def equal(self) -> bool:
        """True if all ticks ran, and positions, commands and torques equal those of the simulation bit by bit."""
        return self.complete and self.first_difference is None

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.rehearsal.scenario.arm.name}: run over a bus of {len(self.q)} ticks"

    @property
    def good(self) -> bool:
        """True for a complete run that rehearses something."""
        return self.counts

    def sentences(self) -> list[str]:
        """Completeness, the reason of an early end, and the state of the drives at the end."""
        why = [f"stopped early: {self.trouble}"] if self.trouble else ["ended before its last tick"]
        first = ["complete"] if self.counts else ["complete, with too many incomplete cycles"] if self.complete else why
        return [*first, *([str(self.ending)] if self.ending else [])]

    def tables(self) -> list[Table]:
        """A row for each joint: its largest error and command; then what was counted of the cycles."""
        arm = self.rehearsal.scenario.arm
        columns = [np.abs(each).max(axis=0, initial=0.0) for each in (self.errors, self.u)]
        rows = [[name, *(number(each[k]) for each in columns)] for k, name in enumerate(arm.names)]
        heads = ("joint", "largest error [rad | m]", "largest command [A | N m | N]")
        return [Table(self.heading, heads, rows), Table("cycles", ("", "counted"), self.cycles.rows(), ("counted",))]

    @cached_property
    def first_difference(self) -> RunDifference | None:
        """The first value that differs from the simulation; None if those of all ticks that ran are equal."""
        return first_difference(self.rehearsal, self.q, self.u, self.applied)


def run_controller(
    scenario: Scenario | Rehearsal,
    bus: str = "virtual",
    *,
    nodes: Sequence[int] | None = None,
    eds: Sequence[str] | None = None,
    real_time: bool = False,
    following_error: float | Sequence[float] | None = None,
    missing: int = MISSING,
    permission: Permission = VIRTUAL,
    heartbeat: float = HEARTBEAT,
    bitrate: int = BITRATE,
) -> BusRun:
    """The run of a scenario's controller over a bus: enables the drives, moves the arm, and brings it to rest.

    At its end, whatever ends it, all drives that answer get a quick stop. When their joints stand still they are disabled if the
    record has a brake at every joint that gravity moves; else they hold the arm until `release_drives`.

    Args:
        scenario: with the controller; or its rehearsal.   bus: "virtual", "socketcan:can0" or "udp_multicast:ADDRESS".
        nodes: numbers of the joints' nodes; default: from 3.   eds: paths of their data sheets; default: the twin's.
        real_time: True for a SYNC every period by the clock, and heartbeats; else SYNC waits for the controller.
        following_error: [rad | m], a number or one for each joint, at which the run ends; default: twice the rehearsal's
            largest, and at least 0.0175.
        missing: answers that a node misses in a row before the run ends, 1 to the larger of 3 and 20 ms of periods.
        permission: what the user has said before an arm may move over a bus that is not virtual; its dead-man key, asked
            every cycle, ends the run with a quick stop. A scenario is rehearsed at its speed and torque.
        heartbeat: [s] from beat to beat of the master and of the nodes in real time; three that are missing stop the arm.
        bitrate: [bit/s] for the time that frames take; of a rehearsal, its own.
    Returns:
        run: positions, commands, and what was counted; not complete if the key was released.
    Raises:
        RunStopped: the run ended early, since a node was lost, a drive had a fault or a following error was too large; its
            `run` is what was recorded.
        Interrupted: Ctrl-C; its `run` is what was recorded.
        BusError: refused before a drive was enabled: no such bus, arguments out of range, nodes that do not answer or are no
            such drives, two devices with one number, an arm that must not move or stands elsewhere.
    Example:
        >>> from dataclasses import replace
        >>> scenario = aw.read_scenario("examples/bus-8ms.scenario.toml")
        >>> scenario = replace(scenario, lanes=None, vary={}, duration=0.2)
        >>> with aw.bus.Twin(scenario):
        ...     run = aw.bus.run_controller(scenario)
        >>> run.equal  # to the simulation, bit by bit
        True
    """
    check_bus(bus)
    expect(permission, Permission, "permission", "an aw.bus.Permission(…)", BusError)
    if isinstance(scenario, Rehearsal):
        rehearsal = scenario
    else:
        rehearsal = rehearse(scenario, bitrate=bitrate, speed=permission.speed, torque=permission.torque, nodes=nodes)
    check_arguments(rehearsal, following_error=following_error, missing=missing, heartbeat=heartbeat)
    if not isinstance(real_time, bool):
        raise BusError(place="real_time", value=real_time, expected="True or False")
    law = Law(rehearsal)
    master = Master(rehearsal, bus, nodes=nodes, eds=eds, missing=missing)
    with _bus_failures(master), master:
        identities = master.identify()
        real = check_permission(master, identities, permission, real_time=real_time)
        master.configure(heartbeat if real_time else None)
        run = _run(master, law, real_time, following_error, permission.may_move)
        if real and permission.reduced and run.counts:
            _store(permission, bound(master, identities), run)
    return run


def release_drives(
    scenario: Scenario | Rehearsal,
    bus: str,
    *,
    nodes: Sequence[int] | None = None,
    permission: Permission = VIRTUAL,
    bitrate: int = BITRATE,
) -> None:
    """Disables drives that hold the arm after a run; where nothing else holds it, it falls.

    Args:
        scenario: with the controller; or its rehearsal.   bus: by name.   nodes: of the joints; default: from 3.
        permission: with the arm's serial number, on a bus that is not virtual.   bitrate: [bit/s].
    Raises:
        BusError: no such bus, nodes that do not answer or that are those of another arm.
    Example:
        >>> from dataclasses import replace
        >>> scenario = aw.read_scenario("examples/bus-8ms.scenario.toml")
        >>> scenario = replace(scenario, lanes=None, vary={}, duration=0.2)
        >>> with aw.bus.Twin(scenario):
        ...     aw.bus.release_drives(scenario, "virtual")
    """
    check_bus(bus)
    rehearsal = scenario if isinstance(scenario, Rehearsal) else rehearse(scenario, bitrate=bitrate)
    master = Master(rehearsal, bus, nodes=nodes)
    with _bus_failures(master), master:
        check_serial(master, master.identify(), permission)
        master.release()


@contextlib.contextmanager
def _bus_failures(master: Master) -> Iterator[None]:
    """Raises failures of an open bus as ours."""
    try:
        yield
    except bus_errors() as error:
        kind = RunStopped if master.enabled else BusError
        raise kind(f"failed: {error}", place="bus", value=master.bus, expected="a bus that carries frames") from None


def _store(permission: Permission, bound: Mapping[str, Any], run: BusRun) -> None:
    """Stores that a reduced run counts; a failure is no refusal, since the arm has moved."""
    try:
        permission.write_reduced(bound)
    except OutputError as error:
        stopped = RunStopped(f"the run is complete, but not stored as a rehearsal: {error}")
        stopped.run = run
        raise stopped from None


def check_arguments(
    rehearsal: Rehearsal,
    *,
    following_error: float | Sequence[float] | None = None,
    missing: int = MISSING,
    heartbeat: float = HEARTBEAT,
) -> None:
    """Refuses limits and monitors that are none, all at once.

    Args:
        rehearsal: of the run.   following_error, missing, heartbeat: as of `run_controller`.
    Raises:
        BusError: names every argument that is out of range.
    """
    period, joints = rehearsal.stages.period, rehearsal.scenario.arm.n
    low, high = np.array([body.limits.position for body in rehearsal.scenario.arm.coordinates], dtype=float).T
    most_missing = max(LEAST_MOST_MISSING, math.floor(MOST_SILENCE / period + 1e-9))
    most_beat = MOST_BEAT / BEATS
    errors, beats = _positive(following_error), _positive(heartbeat)
    right_beat = beats is not None and beats.shape == () and LEAST_BEAT <= beats <= most_beat
    right_error = following_error is None or (
        errors is not None and errors.shape in ((), (joints,)) and bool(np.all(errors < high - low))
    )
    right_missing = is_whole(missing, 1) and missing <= most_missing
    in_a_row = f"a whole number from 1 to {most_missing}, at most {MOST_SILENCE:g} s or {LEAST_MOST_MISSING} cycles"
    in_object = f"{LEAST_BEAT:g} to {most_beat:.4g} s: {BEATS} beats are within the 65535 ms of object 1016"
    ranges = ", ".join(f"{each:.4g}" for each in high - low)
    expected_error = f"a number [rad | m], or {joints} of them, above 0 and below the joints' ranges {ranges}"
    rows = (
        (right_error, "following_error", following_error, expected_error),
        (right_missing, "missing", missing, in_a_row),
        (right_beat, "heartbeat", heartbeat, in_object),
    )
    problems = [Problem("", place, value, expected) for right, place, value, expected in rows if not right]
    if problems:
        raise BusError.of(*problems)


def _positive(value: Any) -> np.ndarray | None:
    """Finite numbers above 0 as an array; None for anything else."""
    try:
        found = real_numbers(value)
    except ValueError:
        return None
    return found if found.size and np.all(np.isfinite(found) & (found > 0.0)) else None


def _run(
    master: Master,
    law: Law,
    real_time: bool,
    following_error: float | Sequence[float] | None,
    may_move: Callable[[], bool] | None,
) -> BusRun:
    """The run with its end: the drives are at rest when it returns or raises."""
    recording, n = master.rehearsal.recording, len(master.numbers)
    most = MARGIN * master.rehearsal.largest_error
    most = np.maximum(most, LEAST_ERROR) if following_error is None else np.broadcast_to(following_error, n)
    _check_start(master)
    start = master.enable()
    law.begin(start[:n], start[n:])
    q, u, applied = (np.zeros((recording.ticks, n)) for _ in range(3))
    rows = DrivenRows(q, u, applied)
    trouble, interrupted = None, False
    try:
        trouble = _driven(master, law, rows, most, real_time, may_move)
    except KeyboardInterrupt:
        interrupted = True
    report = master.cycles.report
    ending = master.stop(trouble)
    restless = ending.unknown + ending.moving
    if trouble is None and restless and not interrupted:
        joint = master.names.index(restless[0])
        what = f"node {master.numbers[joint]} of {restless[0]} does not come to rest at the end"
        trouble = Trouble(joint, what, "an answer that says so", believed=False)
    done = rows.done
    times = master.period * np.arange(done)
    run = BusRun(master.rehearsal, times, rows.q[:done], rows.u[:done], rows.applied[:done], report, ending, trouble)
    if interrupted:
        raise Interrupted(f"at {done * master.period:g} s; {ending}", run)
    if trouble is None:
        return run
    error = master.error(trouble, ending)
    error.run = run
    raise error


@dataclass
class DrivenRows:
    """Positions, commands and outputs of the drives, (ticks, n) each, of which `done` are filled."""

    q: np.ndarray
    u: np.ndarray
    applied: np.ndarray
    done: int = 0


def _driven(
    master: Master, law: Law, rows: DrivenRows, most: np.ndarray, real_time: bool, may_move: Callable[[], bool] | None
) -> Trouble | None:
    """Drives the arm tick by tick; returns what ended it early, None at the end or when the key was released."""
    recording, reference = master.rehearsal.recording, master.rehearsal.reference
    master.cycles.reset()
    due = clock.now() + master.period
    for tick in range(recording.ticks):
        trouble = master.trouble(State.ENABLED)
        if trouble is not None:
            return trouble
        rows.q[tick], rows.applied[tick] = master.q, master.applied
        u = rows.u[tick] = law.command(tick, recording.r[tick], rows.q[tick], rows.applied[tick])
        at = f"at {tick * master.period:g} s"
        if not np.all(np.isfinite(u)):
            return Trouble(int(np.argmin(np.isfinite(u))), f"the controller's command {at} is not finite", "numbers")
        error = np.abs(reference[tick] - rows.q[tick])
        if np.any(error > most):
            joint = int(np.argmax(error / most))
            return Trouble(joint, f"following error {error[joint]:.4g} {at}", f"at most {most[joint]:.4g}")
        if may_move is not None and not may_move():
            return None
        master.send(ENABLE, np.asarray(master.units.thousandths(u)))
        master.cycles.ended()
        rows.done = tick + 1
        until = None
        if real_time:
            clock.sleep_until(due)
            now = clock.now()
            until = now + ANSWERED * master.period
            due = (now if now - due > SLIPPED * master.period else due) + master.period
        master.cycle(until)
    return master.trouble(State.ENABLED)


def _check_start(master: Master) -> None:
    """Refuses an arm that is not at the scenario's start."""
    master.heard()
    wanted = master.rehearsal.scenario.initial_state[0, : len(master.numbers)]
    off = np.abs(master.q - wanted) > ROUNDING * master.units.count
    if np.any(off):
        joint = int(np.argmax(off))
        what = f"joint {master.names[joint]!r} stands at {master.q[joint]:.5g}"
        raise BusError(what, place="start.q", value=float(wanted[joint]), expected="where the arm stands")

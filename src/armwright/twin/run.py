"""A scenario's controller, run over a bus: in lock-step or in real time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from armwright.errors import BusError
from armwright.simulation.scenario import Scenario
from armwright.twin.bus import BITRATE, check_bus
from armwright.twin.cycles import CycleReport
from armwright.twin.law import Law
from armwright.twin.master import ENABLE, HEARTBEAT, ROUNDING, Master
from armwright.twin.rehearsal import Rehearsal, rehearse
from armwright.twin.safety import Permission, check_permission
from armwright.twin.state_machine import State

VIRTUAL = Permission()  # enough for a bus of this process
ANSWERED, SLIPPED = 0.9, 0.5  # of a period: how long answers are waited for; from when on SYNC is not made up for
MARGIN, LEAST_ERROR = 2.0, 0.0175  # of the rehearsal's largest error; at least a degree, or 17.5 mm


@dataclass(frozen=True, eq=False)
class BusRun:
    """A run over a bus.

    Attributes:
        rehearsal: the same run as it was simulated.   time: (ticks,) [s].   q: (ticks, n) measured [rad | m].
        u: (ticks, n) commands [A | N m | N].   applied: (ticks, n) what the drives did.   cycles: what was counted.
    """

    rehearsal: Rehearsal
    time: np.ndarray
    q: np.ndarray
    u: np.ndarray
    applied: np.ndarray
    cycles: CycleReport

    @property
    def errors(self) -> np.ndarray:
        """(ticks, n) reference less measured position [rad | m]."""
        return self.rehearsal.reference[: len(self.q)] - self.q

    @property
    def complete(self) -> bool:
        """True if the run reached its end."""
        return len(self.q) == self.rehearsal.recording.ticks

    @property
    def equal(self) -> bool:
        """True if positions and commands equal those of the simulation bit by bit."""
        ticks, units = len(self.q), self.rehearsal.units
        did = self.rehearsal.recording.y[:ticks, -self.applied.shape[1] :]
        return self.first_difference is None and np.array_equal(self.applied, units.command(units.thousandths(did)))

    @property
    def first_difference(self) -> int | None:
        """The first tick whose position or command differs from the simulation; None if all are equal."""
        ticks = len(self.q)
        differs = np.any(self.q != self.rehearsal.q[:ticks], axis=1)
        differs |= np.any(self.u != self.rehearsal.recording.u[:ticks], axis=1)
        return int(np.argmax(differs)) if np.any(differs) else None


def run_controller(
    scenario: Scenario | Rehearsal,
    bus: str = "virtual",
    *,
    nodes: Sequence[int] | None = None,
    eds: Sequence[str] | None = None,
    real_time: bool = False,
    following_error: float | None = None,
    permission: Permission = VIRTUAL,
    heartbeat: float = HEARTBEAT,
    bitrate: int = BITRATE,
) -> BusRun:
    """The run of a scenario's controller over a bus: enables the drives, moves the arm, and brings it to rest.

    Args:
        scenario: with the controller; or its rehearsal.   bus: "virtual", "socketcan:can0" or "udp_multicast:ADDRESS".
        nodes: numbers of the joints' nodes; default: from 3.   eds: paths of their data sheets; default: the twin's.
        real_time: True for a SYNC every period by the clock, and a heartbeat; else SYNC waits for the controller.
        following_error: [rad | m] at which the run ends; default: twice the rehearsal's largest, and at least 0.0175.
        permission: what the user has said before an arm may move over a bus that is not virtual; its dead-man key, asked
            every cycle, ends the run with a quick stop.
        heartbeat: [s] from beat to beat of the master in real time; the drives stop where three are missing.
        bitrate: [bit/s] for the time that frames take.
    Returns:
        run: positions, commands, and what was counted.
    Raises:
        BusError: no such bus, nodes that do not answer or are no such drives, an arm that must not move or stands elsewhere, a
            fault, a following error; the drives were stopped.
    """
    check_bus(bus)
    rehearsal = scenario if isinstance(scenario, Rehearsal) else rehearse(scenario, bitrate=bitrate)
    law = Law(rehearsal)
    with Master(rehearsal, bus, nodes=nodes, eds=eds) as master:
        metal = check_permission(master, permission, real_time=real_time)
        master.configure(heartbeat if real_time else None)
        run = _run(master, law, real_time, following_error, permission.may_move)
    if metal and permission.reduced and run.complete:
        permission.write_reduced()
    return run


def _run(
    master: Master, law: Law, real_time: bool, following_error: float | None, may_move: Callable[[], bool] | None
) -> BusRun:
    rehearsal, n = master.rehearsal, len(master.numbers)
    most = np.maximum(MARGIN * rehearsal.largest_error, LEAST_ERROR) if following_error is None else following_error
    _check_start(master)
    start = master.enable()
    law.begin(start[:n], start[n:])
    ticks, recording = rehearsal.recording.ticks, rehearsal.recording
    q, u, applied = (np.zeros((ticks, n)) for _ in range(3))
    master.cycles.reset()
    due = time.perf_counter() + master.period
    done = ticks
    for tick in range(ticks):
        q[tick], applied[tick] = master.q, master.applied
        u[tick] = law.command(tick, recording.r[tick], q[tick], applied[tick])
        if not np.all(np.isfinite(u[tick])):
            what = f"the controller's command at {tick * master.period:g} s is not finite"
            raise BusError(what, place="loop.controller", expected="numbers; all drives were stopped")
        off = np.abs(rehearsal.reference[tick] - q[tick]) > most
        if np.any(off):
            joint = int(np.argmax(off))
            error = abs(rehearsal.reference[tick, joint] - q[tick, joint])
            what = f"following error {error:.4g} at {tick * master.period:g} s"
            expected = f"at most {np.broadcast_to(most, n)[joint]:.4g}; all drives were stopped"
            raise BusError(what, place=f"joint {master.names[joint]!r}", expected=expected)
        if may_move is not None and not may_move():
            done = tick
            break
        master.send(ENABLE, np.asarray(master.units.thousandths(u[tick])))
        master.cycles.ended()
        until = None
        if real_time:
            time.sleep(max(due - time.perf_counter(), 0.0))
            now = time.perf_counter()
            until = now + ANSWERED * master.period
            due = (now if now - due > SLIPPED * master.period else due) + master.period
        master.cycle(until)
        master.expect(State.ENABLED)
    report = master.cycles.report
    times = master.period * np.arange(done)
    return BusRun(rehearsal, times, q[:done], u[:done], applied[:done], report)


def _check_start(master: Master) -> None:
    """Refuses an arm that is not at the scenario's start."""
    master.cycle()
    wanted = master.rehearsal.scenario.initial_state[0, : len(master.numbers)]
    off = np.abs(master.q - wanted) > ROUNDING * master.units.count
    if np.any(off):
        joint = int(np.argmax(off))
        what = f"joint {master.names[joint]!r} stands at {master.q[joint]:.5g}"
        raise BusError(what, place="start.q", value=float(wanted[joint]), expected="where the arm stands")

"""First difference of a run over a bus from its simulation: tick, joint, signal, and the input that changed before it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armwright.simulation.inputs.input_schedule import landing_rows
from armwright.simulation.scenario import Scenario
from armwright.twin.rehearsal import Rehearsal


@dataclass(frozen=True)
class RunDifference:
    """The first value over the bus that differs from the simulation.

    Attributes:
        tick: of the controller.   time: [s].   joint: its name.   signal: "position", "applied" or "command".
        value, simulated: [rad | m], or [A | N m | N], over the bus and in the simulation.
        changed: input of the scenario that changed last before it; "" where none did.   since: [s] of that change.
        speed: of the run, in parts of the scenario's, if inputs change in it: a twin needs the same.
    """

    tick: int
    time: float
    joint: str
    signal: str
    value: float
    simulated: float
    changed: str = ""
    since: float = 0.0
    speed: float = 1.0

    def __str__(self) -> str:
        where = f"differs from the simulation from tick {self.tick} on, at {self.time:g} s"
        what = f"{self.signal} of {self.joint} is {self.value:.9g}, in the simulation {self.simulated:.9g}"
        cause = f"; before it the {self.changed} of the scenario changed, at {self.since:g} s" if self.changed else ""
        slow = f"; a twin has to be started at the same speed, {self.speed:g}, to change inputs at the same times"
        return f"{where}: {what}{cause}{slow if self.speed != 1.0 else ''}"


def first_difference(rehearsal: Rehearsal, q: np.ndarray, u: np.ndarray, applied: np.ndarray) -> RunDifference | None:
    """The first difference from a simulated run; None if all values are the same.

    Args:
        rehearsal: the simulated run.   q, u, applied: (ticks, n) each, of a run that may have ended before.
    """
    recording, units, (ticks, n) = rehearsal.recording, rehearsal.units, q.shape
    did = units.command(units.thousandths(recording.y[:ticks, -n:]))
    # In the order of a tick: what came with SYNC, then what the controller made of it.
    signals = {"position": (q, rehearsal.q[:ticks]), "applied": (applied, did), "command": (u, recording.u[:ticks])}
    found = [
        (int(tick), k, int(joint))
        for k, (ours, simulated) in enumerate(signals.values())
        for tick, joint in np.argwhere(ours != simulated)[:1]
    ]
    if not found:
        return None
    tick, k, joint = min(found)
    signal, (ours, simulated) = list(signals.items())[k]
    time = tick * rehearsal.stages.period
    changes = list(_changes(rehearsal.scenario))
    since, changed = max((change for change in changes if change[0] < time), default=(0.0, ""))
    speed = rehearsal.speed if changes else 1.0
    name, values = rehearsal.scenario.arm.names[joint], (float(ours[tick, joint]), float(simulated[tick, joint]))
    return RunDifference(tick, time, name, signal, *values, changed, since, speed)


def _changes(scenario: Scenario) -> Iterator[tuple[float, str]]:
    """Times [s] at which inputs change, and their names; before the first row all are zero."""
    for name, schedule in scenario.input_schedules.items():
        rows = landing_rows(schedule, scenario.tick)
        before = np.zeros(rows.values.shape[1])
        for tick, offset, values in zip(rows.tick, rows.offset, rows.values, strict=True):
            if np.any(values != before):
                yield float(tick * scenario.tick + offset), name
            before = values

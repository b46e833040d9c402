"""Checks of measured rows before a filter sees them: values that cannot be are left out, reported and bridged.

| signal | cannot be                                                                                                         |
|--------|-------------------------------------------------------------------------------------------------------------------|
| t      | not finite; not after the row before, or over LEAP after it, unless it follows another such one: a clock was set  |
| q      | not finite; over 10 half ranges from the middle; moved since the last row at over 10 times the greatest speed     |
| qd     | not finite; over 10 times the greatest speed                                                                      |
| tau    | not finite; over 10 times what the drives can give                                                                |

Limits are those of the record; where it states none, `UNLIMITED`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from armwright.actuators.coupling import motor_shares
from armwright.model import Body, Model

EVENTS = 12  # that are shown
BEYOND = 10.0  # times a limit
UNLIMITED = {"q": 1e5, "qd": 100.0, "tau": 1e5}  # [rad | m], [rad/s | m/s], [N m | N] where the record has no limit
LEAP = 60.0  # [s]
GAP = 5.0  # usual periods; what comes after a longer pause starts again
PERIODS = 15  # of which the median is the usual one
AT_ONCE = 1e-9  # [s] apart: two rows of one time
SHORTEST = 1e-3  # [s] over which a position may move by its speed, however near two rows are: encoders have steps
TOGETHER = 1.0  # [s] between rows of one event


@dataclass(frozen=True)
class ShadowEvent:
    """Rows that were left out because a value cannot be, or because the model has no finite residual there.

    Attributes:
        t, end: [s] of the first and the last one; of a time stamp, those of the last rows before it.
        signal: "t", "q", "qd", "tau" or "residual".   joint: None for a time stamp.   value: the first one.   rows: their number.
        allowed: the lowest and the highest value that could have been there.
    """

    t: float
    end: float
    signal: str
    joint: str | None
    value: float
    rows: int = 1
    allowed: tuple[float, float] = (-math.inf, math.inf)

    def __str__(self) -> str:
        until = "" if self.end == self.t else f" to {self.end:.3f} s"
        if self.signal == "t":
            return f"after {self.t:.3f} s{until}: time stamp {self.value:.10g}: {_count(self.rows)} left out"
        done = "the observer started again" if self.signal == "residual" else f"{_count(self.rows)} left out"
        low, high = self.allowed
        beyond = f", not within {low:.4g} … {high:.4g}" if math.isfinite(self.value) and math.isfinite(high) else ""
        return f"{self.t:.3f} s{until}: {self.signal} of {self.joint} = {self.value:.4g}{beyond}: {done}"


def _count(rows: int) -> str:
    return f"{rows} row{'s' * (rows != 1)}"


@dataclass(frozen=True, eq=False)
class CheckedRows:
    """Result of a check.

    Attributes:
        t: (rows,) [s]; of a stamp that cannot be the last one that can.   taken: (rows,) rows to be used.
        begins: (rows,) rows that are used and do not follow the ones before.   step: (rows,) [s] since the last row.
    """

    t: np.ndarray
    taken: np.ndarray
    begins: np.ndarray
    step: np.ndarray


class RowCheck:
    """Checks of a stream of rows of an arm, in blocks of any length.

    Args:
        arm: the model.

    Attributes:
        events: all so far.
    """

    def __init__(self, arm: Model):
        self._names = tuple(arm.names)
        low, high = np.array([body.limits.position for body in arm.coordinates]).T
        known = np.isfinite(low) & np.isfinite(high)
        with np.errstate(invalid="ignore"):
            middle = np.where(known, 0.5 * (low + high), 0.0)
            most = np.where(known, BEYOND * 0.5 * (high - low), UNLIMITED["q"])
        speed = np.array([_or(body.limits.velocity, UNLIMITED["qd"]) for body in arm.coordinates])
        torque = np.array([_torque(body) for body in arm.coordinates]) @ np.abs(motor_shares(arm))
        self._middle = {"q": middle, "qd": np.zeros(arm.n), "tau": np.zeros(arm.n)}
        self._most = {"q": most, "qd": BEYOND * speed, "tau": BEYOND * torque}
        self.restart()

    def restart(self) -> None:
        """Forgets all rows and events; to be called before another run."""
        self.events: list[ShadowEvent] = []
        self._latest: dict[tuple[str, str | None], int] = {}
        # last stamps: one that can be, of a row that was taken, one that cannot
        self._t = self._taken = self._stray = math.nan
        self._q = np.zeros(0)
        self._periods: deque[float] = deque(maxlen=PERIODS)

    def check(self, t: np.ndarray, q: np.ndarray, tau: np.ndarray, qd: np.ndarray | None) -> CheckedRows:
        """Mask of the rows that can be used; arguments as of `MomentumObserver.update`."""
        signals = {"q": q, "tau": tau, **({} if qd is None else {"qd": qd})}
        wrong = {name: ~(np.abs(each - self._middle[name]) <= self._most[name]) for name, each in signals.items()}
        whole = ~np.any([each.any(axis=1) for each in wrong.values()], axis=0)
        times, step = np.empty(len(t)), np.zeros(len(t))
        taken, begins = np.zeros(len(t), dtype=bool), np.zeros(len(t), dtype=bool)
        for k, now in enumerate(map(float, t)):
            possible, step[k] = self._stamp(now)
            times[k] = self._t
            if not possible:
                self.report("t", None, now)
                continue
            if not whole[k]:
                for name, each in wrong.items():
                    self._report_joints(name, signals[name][k], each[k], self._middle[name], self._most[name])
                continue
            gap = now - self._taken
            if gap <= GAP * self._usual:
                way = self._most["qd"] * max(gap, SHORTEST)
                far = np.abs(q[k] - self._q) > way
                if far.any():
                    self._report_joints("q", q[k], far, self._q, way)
                    continue
            else:
                begins[k] = True
            taken[k], self._taken, self._q = True, now, q[k]
        return CheckedRows(times, taken, begins, step)

    @property
    def _usual(self) -> float:
        return median(self._periods) if self._periods else math.inf

    def _stamp(self, now: float) -> tuple[bool, float]:
        """True if a time stamp is plausible, and the time [s] that its row stands for."""
        if math.isnan(self._t) and math.isfinite(now):
            self._t = now
            return True, 0.0
        period = now - self._t
        if AT_ONCE < period <= LEAP:
            self._t, self._stray = now, math.nan
            self._periods.append(period)
            return True, period
        if AT_ONCE < now - self._stray <= LEAP:  # the clock was set
            step = now - self._stray
            self._t, self._stray, self._taken = now, math.nan, math.nan
            return True, step
        self._stray = now if math.isfinite(now) else math.nan
        return False, median(self._periods) if self._periods else 0.0

    def _report_joints(
        self, signal: str, values: np.ndarray, wrong: np.ndarray, middle: np.ndarray, most: np.ndarray
    ) -> None:
        for k in np.flatnonzero(wrong):
            allowed = float(middle[k] - most[k]), float(middle[k] + most[k])
            self.report(signal, self._names[k], float(values[k]), allowed=allowed)

    def report(
        self, signal: str, joint: str | None, value: float, t: float | None = None,
        allowed: tuple[float, float] = (-math.inf, math.inf),
    ) -> None:  # fmt: skip
        """Adds a row at t [s], by default the last one, to the events: to the last of its signal and joint if just before."""
        at, known = self._latest.get((signal, joint)), np.nan_to_num(self._t) if t is None else t
        if at is not None and 0.0 <= known - self.events[at].end <= TOGETHER:
            event = self.events[at]
            self.events[at] = replace(event, end=float(known), rows=event.rows + 1)
            return
        self._latest[signal, joint] = len(self.events)
        self.events.append(ShadowEvent(float(known), float(known), signal, joint, value, allowed=allowed))


def _or(limit: float, otherwise: float) -> float:
    return float(limit) if math.isfinite(limit) else otherwise


def _torque(body: Body) -> float:
    """[N m | N] that a drive can give by its limits, referred to its joint."""
    drive, limits = body.drive, body.limits
    most = float(limits.torque)
    if drive.torque_constant is not None:
        constant = abs(float(drive.gear_ratio * drive.torque_constant))
        most = min(most, constant * float(limits.current))
        if drive.resistance is not None:
            most = min(most, constant * float(limits.voltage) / float(drive.resistance))
    return _or(most, UNLIMITED["tau"])


def event_lines(events: Sequence[tuple[str, ShadowEvent]]) -> list[str]:
    """One line for each event of a run, of many the first `EVENTS` and how many more there are."""
    lines = [f"{run}: {event}" for run, event in events[:EVENTS]]
    return lines if len(events) <= EVENTS else [*lines, f"{len(events) - EVENTS} more of such events"]

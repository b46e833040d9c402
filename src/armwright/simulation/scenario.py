"""Scenario: everything that decides a run, checked before it runs."""

from __future__ import annotations

import numbers
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from armwright.errors import ScenarioError, nearest
from armwright.model import Model
from armwright.simulation.integrators import INTEGRATORS
from armwright.simulation.schedule import Schedule

MOST_STEPS = 2**53
LANDING = 1e-9  # of a step: a schedule row this near a tick is meant to be on it


@dataclass(frozen=True, eq=False)
class Scenario:
    """An arm, what drives it, from where, and for how long.

    Args:
        arm: the model.
        duration: [s]; by default the time of the schedule's last row.
        step: [s] of the integrator.
        schedule: commands over time, held between rows; several of them run as lanes.
        command: (n,) constant commands, each in its joint's own unit [V | A | N m | N]; (lanes, n) runs lanes.
        q0: (n,) or (lanes, n) [rad | m], default 0.   qd0: the same [rad/s | m/s].
        integrator: a name of `integrators.INTEGRATORS`.
        record_every: rows are recorded every so many steps; 0 records the first and the last state only.
        record: "all", or "state" for q and qd alone, which many lanes over many rows may want.
        target: processor level to compile for, as in `compile`.
    Raises:
        ScenarioError: what cannot be run; one line that names the field, its value and what was expected.
    """

    arm: Model
    duration: float | None = None
    step: float = 1e-3
    schedule: Schedule | Sequence[Schedule] | None = None
    command: Any = None
    q0: Any = None
    qd0: Any = None
    integrator: str = "rk3"
    record_every: int = 1
    record: str = "all"
    target: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.arm, Model):
            raise ScenarioError(f"arm = {self.arm!r}: expected an arm, as aw.load(name) gives")
        if not isinstance(self.integrator, str) or self.integrator not in INTEGRATORS:
            raise ScenarioError(
                f"integrator = {self.integrator!r}: unknown; {nearest(str(self.integrator), INTEGRATORS)}"
            )
        if not (_is_time(self.step)):
            raise ScenarioError(f"step = {self.step!r}: expected a time above 0 s")
        if (
            isinstance(self.record_every, bool)
            or not isinstance(self.record_every, numbers.Integral)
            or self.record_every < 0
        ):
            raise ScenarioError(f"record_every = {self.record_every!r}: expected a whole number, 0 or more")
        if self.record not in ("all", "state"):
            raise ScenarioError(f'record = {self.record!r}: expected "all" or "state"')
        if (self.schedule is None) == (self.command is None):
            raise ScenarioError(
                "expected either a schedule or constant commands, not both"
                if self.command is not None
                else "nothing drives the arm: expected a schedule or constant commands"
            )
        _ = self.schedules, self.ticks, self.lanes, self.initial_state

    @cached_property
    def schedules(self) -> list[Schedule]:
        """One schedule for all lanes, or one a lane."""
        if self.schedule is not None:
            given = [self.schedule] if isinstance(self.schedule, Schedule) else list(self.schedule)
            return [_by_name(schedule, self.arm) for schedule in given]
        commands = self._vectors("command", self.command)
        return [Schedule.constant(self.arm.names, row) for row in np.atleast_2d(commands)]

    @cached_property
    def ticks(self) -> int:
        """Number of steps; the duration must hold a whole number of them."""
        duration = self.duration
        if duration is None:
            duration = max(float(schedule.times[-1]) for schedule in self.schedules)
            if duration == 0:
                raise ScenarioError(
                    "duration: expected one, since the commands are constant and do not say when to stop"
                )
        if not (_is_time(duration)):
            raise ScenarioError(f"duration = {duration!r}: expected a time above 0 s")
        ticks = round(duration / self.step)
        if ticks < 1 or abs(ticks * self.step - duration) > 1e-6 * self.step:
            raise ScenarioError(
                f"duration = {duration:g} s is no whole number of steps of {self.step:g} s; expected a multiple of the step"
            )
        if ticks > MOST_STEPS:
            raise ScenarioError(
                f"duration = {duration:g} s is {ticks:.3g} steps of {self.step:g} s, more than can be counted"
            )
        if self.record_every and ticks % self.record_every:
            raise ScenarioError(f"record_every = {self.record_every} does not divide the {ticks} steps of the run")
        return ticks

    @cached_property
    def lanes(self) -> int | None:
        """Number of lanes, None for a single run without a lane axis."""
        counts: dict[str, int] = {}
        if self.schedule is not None and not isinstance(self.schedule, Schedule):
            counts["schedule"] = len(self.schedules)
        for name in ("command", "q0", "qd0"):
            value = getattr(self, name)
            if value is not None and np.ndim(value) == 2:
                counts[name] = len(value)
        if len(set(counts.values())) > 1:
            raise ScenarioError(f"lanes do not fit together: {', '.join(f'{v} of {k}' for k, v in counts.items())}")
        if counts and next(iter(counts.values())) == 0:
            raise ScenarioError(f"{next(iter(counts))} has no lanes; expected at least one")
        return next(iter(counts.values()), None)

    @cached_property
    def initial_state(self) -> np.ndarray:
        """(lanes or 1, 2n) positions, then speeds."""
        parts = [np.atleast_2d(self._vectors(name, getattr(self, name))) for name in ("q0", "qd0")]
        rows = self.lanes or 1
        return np.concatenate([np.broadcast_to(part, (rows, self.arm.n)) for part in parts], axis=1)

    def _vectors(self, name: str, value: Any) -> np.ndarray:
        n = self.arm.n
        if value is None:
            return np.zeros(n)
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            raise ScenarioError(f"{name} = {value!r}: expected {n} numbers") from None
        if array.shape[-1:] != (n,) or array.ndim > 2:
            raise ScenarioError(
                f"{name} has shape {array.shape}, expected ({n},) or (lanes, {n}): {', '.join(self.arm.names)}"
            )
        if not np.isfinite(array).all():
            raise ScenarioError(f"{name} holds {array[~np.isfinite(array)][0]}, expected finite numbers")
        return array


def _is_time(value: Any) -> bool:
    return isinstance(value, numbers.Real) and not isinstance(value, bool) and 0.0 < float(value) < np.inf


def _by_name(schedule: Any, arm: Model) -> Schedule:
    """The schedule with its columns in the order of the arm's joints."""
    if not isinstance(schedule, Schedule):
        raise ScenarioError(
            f"schedule = {schedule!r}: expected a Schedule, as Schedule(...) or read_schedule(path, names) make"
        )
    names = list(schedule.names)
    if names == arm.names:
        return schedule
    if sorted(names) != sorted(arm.names):
        raise ScenarioError(
            f"the schedule is for {', '.join(names)}; expected the joints of {arm.name}: {', '.join(arm.names)}"
        )
    order = [names.index(name) for name in arm.names]
    return Schedule(schedule.times, schedule.commands[:, order], tuple(arm.names))

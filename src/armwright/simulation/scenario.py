"""Scenario: everything that decides a run, checked before it runs."""

from __future__ import annotations

import numbers
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from armwright.errors import ScenarioError, nearest
from armwright.model import Model
from armwright.model.vary import Varied
from armwright.simulation.events import EventFunction
from armwright.simulation.integrators import RULES
from armwright.simulation.law import Law
from armwright.simulation.reducers import reducer
from armwright.simulation.schedule import Schedule
from armwright.simulation.sensors import Sensors
from armwright.simulation.shaping import Shaping
from armwright.simulation.stepping import Adaptivity
from armwright.simulation.timing import Timing

MOST_STEPS = 2**53
STEP = 1e-3  # [s] of an integrator that is not told another
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")  # [N] and [N m], in base axes


@dataclass(frozen=True, eq=False)
class Scenario:
    """An arm, what drives it, from where, and for how long.

    Args:
        arm: the model.
        duration: [s]; by default the time of the schedule's last row.
        step: [s] of the integrator, default 1 ms; with a `sample_period` it is that over `substeps`.
        schedule: commands over time, held between rows; several of them run as lanes.
        command: (n,) constant commands, each in its joint's own unit [V | A | N m | N]; (lanes, n) runs lanes.
        controller: a control law instead: a plain function (t, r, y) → u, or a `Controller` with memory.
        reference: where the controller is to bring the arm: a pose, rows, a Schedule of poses or a function of time;
            default: the initial position.
        sample_period: [s] of the controller.   substeps: integration steps in each of its periods.
        sensors, shaping, timing: what is measured and how, what becomes of commands, and when; default: exactly and at once.
        initial_command: (n,) in force before the first tick; default: what holds the arm, within its drives' limits.
        vary: numbers of the record by name, (lanes,) each, or one for all: `{"link6.mass_kg": [0.1, 0.2]}`.
        wrench: of the environment on the tip, in base axes: (6,) [N, N m], (lanes, 6), or a Schedule with the columns `WRENCH`,
            held from row to row and landed on; with a controller.
        seed: of noise, jitter and losses.
        document: the scenario file that it was read from, with all it named; a run keeps it, to be done again.
        q0: (n,) or (lanes, n) [rad | m], default 0.   qd0: the same [rad/s | m/s].
        integrator: a name of `integrators.RULES`: "rk3", "rk4", "semi_implicit_euler"; "rk45", which chooses its own steps
            within each tick; or "cvodes", slow and accurate, for some lanes.
        rtol, atol: of "rk45" and "cvodes": what each entry of the state may be wrong by in a step; default `TOLERANCES`.
        most_steps: of "rk45" in one tick; a lane that wants more is frozen and marked.
        events: of "rk45", by name: functions (t, x) of time and state whose changes of sign are found, landed on and told,
            as `events.joint_stops` makes them.
        record_every: rows are recorded every so many steps; 0 records the first and the last state only.
        record: "all", or "state" for q and qd alone, which many lanes over many rows may want, or "none" beside `reduce`.
        reduce: names of `reducers.REDUCERS`, worked out for each joint in the loop: ("rms_error", "peak_voltage", …).
        target: processor level to compile for, as in `compile`.
    Raises:
        ScenarioError: what cannot be run; one line that names the field, its value and what was expected.
    """

    arm: Model
    duration: float | None = None
    step: float | None = None
    schedule: Schedule | Sequence[Schedule] | None = None
    command: Any = None
    q0: Any = None
    qd0: Any = None
    integrator: str = "rk3"
    record_every: int = 1
    record: str = "all"
    target: str | None = None
    controller: Any = None
    reference: Any = None
    sample_period: float | None = None
    substeps: int = 1
    sensors: Sensors = field(default_factory=Sensors)
    shaping: Shaping = field(default_factory=Shaping)
    timing: Timing = field(default_factory=Timing)
    initial_command: Any = None
    vary: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    rtol: float | None = None
    atol: float | None = None
    most_steps: int | None = None
    events: Mapping[str, EventFunction] = field(default_factory=dict)
    reduce: Sequence[str] = ()
    wrench: Any = None
    document: str | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.arm, Model):
            raise ScenarioError(f"arm = {self.arm!r}: expected an arm, as aw.load(name) gives")
        if not isinstance(self.integrator, str) or self.integrator not in RULES:
            raise ScenarioError(f"integrator = {self.integrator!r}: unknown; {nearest(str(self.integrator), RULES)}")
        self._check_loop()
        if (
            isinstance(self.record_every, bool)
            or not isinstance(self.record_every, numbers.Integral)
            or self.record_every < 0
        ):
            raise ScenarioError(f"record_every = {self.record_every!r}: expected a whole number, 0 or more")
        self._check_record()
        drivers = [name for name in ("schedule", "command", "controller") if getattr(self, name) is not None]
        if len(drivers) != 1:
            raise ScenarioError(
                f"expected one of schedule, command and controller, not {' and '.join(drivers)}"
                if drivers
                else "nothing drives the arm: expected a schedule, constant commands or a controller"
            )
        if self.controller is None and self.reference is not None:
            raise ScenarioError("a reference goes with a controller; commands over time are a schedule")
        _ = self.schedules, self.wrenches, self.ticks, self.lanes, self.initial_state, self.adaptivity

    def _check_record(self) -> None:
        """Refuses to record what is not there, or nothing at all."""
        if self.record not in ("all", "state", "none"):
            raise ScenarioError(f'record = {self.record!r}: expected "all", "state" or "none"')
        if isinstance(self.reduce, str):
            raise ScenarioError(f"reduce = {self.reduce!r}: expected a list of names, such as [{self.reduce!r}]")
        for name in self.reduce:
            reducer(name)
        if self.reduce and self.controller is None:
            raise ScenarioError("reduce goes with a controller; expected one, or record = 'all' of a schedule's motion")
        if self.record == "none" and not self.reduce:
            raise ScenarioError("record = 'none' leaves nothing; expected reduce = ['rms_error', …] beside it")

    def _check_loop(self) -> None:
        """Refuses times of the loop that do not fit together."""
        if self.step is not None and not _is_time(self.step):
            raise ScenarioError(f"step = {self.step!r}: expected a time above 0 s")
        if isinstance(self.substeps, bool) or not isinstance(self.substeps, numbers.Integral) or self.substeps < 1:
            raise ScenarioError(f"substeps = {self.substeps!r}: expected a whole number, 1 or more")
        if self.sample_period is None:
            if self.substeps != 1 and self.controller is None:
                raise ScenarioError("substeps divide a sample_period: expected one beside them, or a smaller step")
            return
        if not _is_time(self.sample_period):
            raise ScenarioError(f"sample_period = {self.sample_period!r}: expected a time above 0 s")
        part = float(self.sample_period) / self.substeps
        if self.step is not None and abs(self.step - part) > 1e-9 * part:
            raise ScenarioError(
                f"step = {self.step:g} s is not sample_period / substeps = {part:g} s; expected one of them, not both"
            )

    @cached_property
    def schedules(self) -> list[Schedule]:
        """One schedule for all lanes, or one a lane; none where a controller commands."""
        if self.controller is not None:
            return []
        if self.schedule is not None:
            given = [self.schedule] if isinstance(self.schedule, Schedule) else list(self.schedule)
            return [_by_name(schedule, self.arm) for schedule in given]
        commands = self._vectors("command", self.command)
        return [Schedule.constant(self.arm.names, row) for row in np.atleast_2d(commands)]

    @property
    def adaptivity(self) -> Adaptivity | None:
        """How the integrator chooses its steps; None for rules of fixed step."""
        return Adaptivity.of(self.integrator, self.substeps, self.rtol, self.atol, self.most_steps, self.events)

    @cached_property
    def wrenches(self) -> list[Schedule]:
        """What pushes the tip: one schedule for all lanes, or one a lane; none where nothing does."""
        if self.wrench is None:
            return []
        if self.controller is None:
            raise ScenarioError("a wrench goes with a controller; one that commands a constant is a plain function")
        if self.integrator == "cvodes":
            raise ScenarioError("integrator = 'cvodes' takes no wrench; expected 'rk45', or one of fixed step")
        self.arm.frame()  # an arm without a tip has no place where it could act
        if isinstance(self.wrench, Schedule):
            if tuple(self.wrench.names) != WRENCH:
                names = ", ".join(self.wrench.names)
                raise ScenarioError(f"wrench: the schedule has {names}; expected {', '.join(WRENCH)}")
            return [self.wrench]
        rows = np.atleast_2d(_numbers("wrench", self.wrench, 6, ", ".join(WRENCH)))
        return [Schedule.constant(WRENCH, row) for row in rows]

    @property
    def integration_step(self) -> float:
        """[s] of the integrator."""
        if self.sample_period is not None:
            return float(self.sample_period) / self.substeps
        return STEP if self.step is None else float(self.step)

    @property
    def tick(self) -> float:
        """[s] of the loop: the integrator's step, or the controller's sample period."""
        if self.controller is None:
            return self.integration_step
        return self.integration_step * self.substeps if self.sample_period is None else float(self.sample_period)

    @cached_property
    def ticks(self) -> int:
        """Number of steps, or of sample periods where a controller commands; the duration must hold a whole number of them."""
        duration, tick = self.duration, self.tick
        if duration is None and self.controller is not None:
            raise ScenarioError("duration: expected one, since a controller does not say when to stop")
        if duration is None:
            duration = max(float(schedule.times[-1]) for schedule in self.schedules)
            if duration == 0:
                raise ScenarioError(
                    "duration: expected one, since the commands are constant and do not say when to stop"
                )
        if not (_is_time(duration)):
            raise ScenarioError(f"duration = {duration!r}: expected a time above 0 s")
        what = "step" if self.controller is None else "sample_period"
        ticks = round(duration / tick)
        if ticks < 1 or abs(ticks * tick - duration) > 1e-6 * tick:
            raise ScenarioError(
                f"duration = {duration:g} s is no whole number of {what}s of {tick:g} s; expected a multiple of the {what}"
            )
        if ticks > MOST_STEPS:
            raise ScenarioError(
                f"duration = {duration:g} s is {ticks:.3g} {what}s of {tick:g} s, more than can be counted"
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
        for name in ("command", "q0", "qd0", "wrench"):
            value = getattr(self, name)
            if value is not None and not isinstance(value, Schedule) and np.ndim(value) == 2:
                counts[name] = len(value)
        counts |= self.timing.lanes
        counts |= {f"vary {name!r}": len(value) for name, value in self.vary.items() if self._rows(name, value)}
        if self.law is not None and self.law.lanes is not None:
            counts["controller"] = self.law.lanes
        if len(set(counts.values())) > 1:
            raise ScenarioError(f"lanes do not fit together: {', '.join(f'{v} of {k}' for k, v in counts.items())}")
        if counts and next(iter(counts.values())) == 0:
            raise ScenarioError(f"{next(iter(counts))} has no lanes; expected at least one")
        return next(iter(counts.values()), None)

    @cached_property
    def law(self) -> Law | None:
        """The controller, taken apart."""
        return None if self.controller is None else Law.of(self.controller, self.arm, self.tick)

    @cached_property
    def varied(self) -> Varied | None:
        """The arm with its varied parameters left open."""
        return Varied(self.arm, list(self.vary)) if self.vary else None

    @cached_property
    def parameters(self) -> np.ndarray:
        """(lanes or 1, k) values of the varied parameters."""
        if self.varied is None:
            return np.zeros((1, 0))
        rows = self.lanes or 1
        columns = [np.asarray(value, dtype=float) for value in self.vary.values()]
        wide = [
            c.reshape(-1, 1) if c.ndim == 1 and len(c) == rows and self.lanes else np.atleast_2d(c) for c in columns
        ]
        values = np.concatenate([np.broadcast_to(c, (rows, c.shape[1])) for c in wide], axis=1)
        self.varied.check(values)
        return values

    def _rows(self, name: str, value: Any) -> bool:
        """Whether a varied parameter is given a row a lane: (lanes,) of one number, (lanes, k) of several."""
        try:
            numbers_ = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            raise ScenarioError(f"vary: {name} = {value!r}: expected numbers") from None
        single = len(Varied(self.arm, [name]).parameters) == 1
        if numbers_.ndim > (1 if single else 2):
            raise ScenarioError(f"vary: {name} has shape {numbers_.shape}; expected one value, or one a lane")
        return numbers_.ndim == (1 if single else 2)

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
        return _numbers(name, value, n, ", ".join(self.arm.names))


def _numbers(name: str, value: Any, n: int, told: str) -> np.ndarray:
    """(n,) or (lanes, n) finite numbers.

    Raises:
        ScenarioError: names the field, and what its columns are.
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ScenarioError(f"{name} = {value!r}: expected {n} numbers") from None
    if array.shape[-1:] != (n,) or array.ndim > 2:
        raise ScenarioError(f"{name} has shape {array.shape}, expected ({n},) or (lanes, {n}): {told}")
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

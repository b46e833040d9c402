"""Output error of a servo's bench: every log simulated from its goals, as a whole or in parts, compared with its positions.

A whole log tells the most of a model that is right. Of one that is not, errors grow until the servo rests, and friction that
holds the joint gives the cost many minima; parts, each from its measured state, keep errors small, and their cost has few minima.

Lanes of the compiled simulator are logs times points of the search, finite differences among them. Friction that holds the joint
at rest makes the motion bend where it breaks loose, so differences are taken over steps that are large beside rounding. Errors
hardly change along directions in which numbers of friction replace each other; differences by one number after the other are too
wrong for these. So the steps follow the principal directions of the last derivatives, half a standard deviation along each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from armwright.fitting.levenberg_marquardt import Damping, Descent, descended
from armwright.identification.motor.unknowns import values_of
from armwright.identification.servo.bench import JOINT, PATHS, ROD, ServoLoop, bench_record, link_numbers
from armwright.identification.servo.bench_log import LEAST, BenchLog
from armwright.identification.servo.orders import DELAY, OFFSET, Order
from armwright.model import Model, build_model
from armwright.parameters import Batch
from armwright.simulation.inputs.schedule import Schedule
from armwright.simulation.loop.compiled import CompiledLoop
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Inputs, Recording, Solver, Start
from armwright.simulation.simulation import Simulation

STEP = 2e-3  # of a coordinate, a logarithm or in parts of its scale: the first ones, and the least of later ones
LONGEST_STEP, DEVIATIONS = 0.1, 0.5  # of a coordinate, and of the standard deviation along a direction
MOST_LANES = 1024  # of a simulation: as many as their rows find room for
ROUNDING = 1e-9  # of a tick
EVERY = 4  # turns of the loop from one stored state to the next, between which Hermite's cubic is 1e-5 rad wrong
LONGEST = 1.0  # of a step in a coordinate: e of a logarithm
AROUND, BESIDE = 0.04, 2  # [s] and rows: the least before and behind the start of a part that tell its state
JUMPS = 1e3  # [rad/s] of a goal that is not slowed down
DAMPING = Damping(first=1e-2, better=0.2, worse=5.0)
RODS = {"mass": f"{ROD}.mass_kg", "x": f"{ROD}.com_m[0]", "z": f"{ROD}.com_m[2]"}


@dataclass(frozen=True, eq=False)
class BenchProblem:
    """Logs of a servo, ready to be simulated.

    Attributes:
        logs: with a mass of the rod each.   loop: of the servo.   order: the friction model.
        restart: [s] after which a simulation starts again from the measured state; infinite: every log is simulated as a whole.
    """

    logs: tuple[BenchLog, ...]
    loop: ServoLoop
    order: Order
    restart: float = np.inf

    @cached_property
    def arm(self) -> Model:
        """The bench, whose numbers lanes vary."""
        order = self.order
        guesses = np.array([each.guess for each in order.unknowns])
        numbers = dict(zip(order.columns, order.matrix @ guesses + order.fixed, strict=True))
        return build_model(bench_record(self.logs[0], self.loop, _believable(numbers), 0.1))

    @cached_property
    def _driven_by_log(self) -> list[list[_Driven]]:
        speed = self.loop.goal_speed_rad_per_s if self._goals_are_slowed else None
        return [_parts_of(log, self.restart, speed, self.loop.period_s) for log in self.logs]

    @cached_property
    def _driven(self) -> list[_Driven]:
        return [part for parts in self._driven_by_log for part in parts]

    @property
    def _goals_are_slowed(self) -> bool:
        """True if parts have goals that already move at the goal's speed: a part does not know where the servo's goal was."""
        return (
            self.restart < np.inf
            and self.loop.goal_speed_rad_per_s is not None
            and "goal_speed" not in self.order.names
        )

    @property
    def measured(self) -> np.ndarray:
        """(rows,) concatenated positions of all logs [rad]."""
        return np.concatenate([each.position for each in self.logs])

    @cached_property
    def parts(self) -> list[slice]:
        """Rows of each log."""
        ends = np.cumsum([0, *(len(each.t) for each in self.logs)])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    def only(self, logs: Sequence[int]) -> BenchProblem:
        """The problem of some of its logs."""
        return replace(self, logs=tuple(self.logs[k] for k in logs))

    def values(self, z: np.ndarray) -> np.ndarray:
        """(…, columns) numbers of the record at coordinates z (…, k)."""
        values, _ = values_of(self.order.unknowns, z)
        return values @ self.order.matrix.T + self.order.fixed

    def predictions(self, values: np.ndarray, used: np.ndarray | None = None) -> np.ndarray:
        """Positions at the rows of all logs (points, rows) [rad]; not a number where a simulation diverged.

        Args:
            values: (points, columns) numbers of the record.
            used: (points, logs) False for logs that are not simulated: their positions are the measured ones; None: all are.
        """
        found = np.full((len(values), len(self.measured)), np.nan)
        ends = np.cumsum([0, *(len(each.log.t) for each in self._driven)])
        pairs = np.array([(point, part) for part in range(len(self._driven)) for point in range(len(values))])
        if used is not None:
            of_log = np.array([log for log, parts in enumerate(self._driven_by_log) for _ in parts])
            pairs = pairs[used[pairs[:, 0], of_log[pairs[:, 1]]]]
            found[:] = self.measured
        for begin in range(0, len(pairs), MOST_LANES):
            lanes = pairs[begin : begin + MOST_LANES]
            run = Simulation(self._scenario(values, lanes), loop=self._code).run(progress=False, keep_state=False)
            q, qd = run["q"].values[..., 0], run["qd"].values[..., 0]
            for part in np.unique(lanes[:, 1]):
                own, rows = lanes[:, 1] == part, slice(ends[part], ends[part + 1])
                found[lanes[own, 0], rows] = self._driven[part].at_rows(q[own], qd[own])
        return found

    @cached_property
    def _code(self) -> CompiledLoop:
        """The loop in native code, for all lanes of all searches."""
        guesses = np.array([[each.to_coordinate(each.guess) for each in self.order.unknowns]])
        return Simulation(self._scenario(self.values(guesses), np.zeros((1, 2), dtype=int))).loop

    def _scenario(self, values: np.ndarray, lanes: np.ndarray) -> Scenario:
        """The bench from the goals of its logs; lanes (lanes, 2) are pairs of a point, of `values`, and a part of a log."""
        driven = [self._driven[part] for part in lanes[:, 1]]
        own = dict(zip(self.order.columns, values[lanes[:, 0]].T, strict=True))
        offset, delay = own.pop(OFFSET), own.pop(DELAY)
        if self._goals_are_slowed:
            own["goal_speed"] = np.full(len(lanes), JUMPS)
        vary = {PATHS[name]: Batch(column) for name, column in own.items()}
        rods = [link_numbers(each.log, turn) for each, turn in zip(driven, offset.tolist(), strict=True)]
        vary |= {path: Batch(np.array([each[name] for each in rods])) for name, path in RODS.items()}
        for axis in ("xx", "yy"):
            vary[f"{ROD}.inertia_kg_m2.{axis}"] = Batch(np.array([each["inertia"] for each in rods]))
        vary[f"{JOINT}.firmware.p"] = Batch(np.array([each.log.p for each in driven]))
        return Scenario(
            self.arm,
            max(each.duration for each in driven),
            command=Batch([each.goal_after(late) for each, late in zip(driven, delay.tolist(), strict=True)]),
            inputs=Inputs(supply=Batch([each.supply for each in driven]), enabled=Batch([each.on for each in driven])),
            start=Start(*(Batch(np.array([[each.start[k]] for each in driven])) for k in range(2))),
            recording=Recording(period=EVERY * self.loop.period_s, what="state"),
            solver=Solver(global_error=False),
            vary=vary,
        )

    def errors(self, z: np.ndarray, used: np.ndarray | None = None) -> np.ndarray:
        """Measured less simulated positions (points, rows) at coordinates z (points, k) [rad]; 0 of logs that are not used.

        Args:
            z: (points, k).   used: (searches, logs) as `predictions` has it, for so many points in turn; None: all.
        """
        each = None if used is None else np.repeat(used, len(z) // len(used), axis=0)
        return self.measured - self.predictions(self.values(z), each)

    def evaluate(
        self, z: np.ndarray, steps: np.ndarray | None = None, used: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Errors (points, rows) and their derivatives (points, rows, k) by the coordinates.

        Args:
            z: (points, k).   steps: (points, k, k) over which differences are taken; None: one along each coordinate.
            used: (points, logs) False for logs that are left out; None: none is.
        """
        points, k = z.shape
        low, high = self.order.low, self.order.high
        steps = np.broadcast_to(STEP * np.eye(k), (points, k, k)) if steps is None else steps
        ahead, back = (np.clip(z[:, None] + way * steps, low, high) - z[:, None] for way in (1.0, -1.0))
        shorter = np.linalg.norm(ahead, axis=2) < np.linalg.norm(back, axis=2)  # cut off at a bound
        moved = np.where(shorter[:, :, None], back, ahead)
        every = np.concatenate([z[:, None], z[:, None] + moved], axis=1).reshape(-1, k)
        errors = self.errors(every, used).reshape(points, 1 + k, -1)
        changes = np.nan_to_num(errors[:, 1:] - errors[:, :1])
        return errors[:, 0], np.matmul(np.linalg.pinv(moved), changes).transpose(0, 2, 1)

    def steps_by(self, z: np.ndarray, errors: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        """Steps for differences (points, k, k): along principal directions of numbers within their bounds, and along others."""
        bound = np.minimum(z - self.order.low, self.order.high - z) < STEP
        size = np.maximum(np.linalg.norm(jacobian, axis=1), 1e-300)
        unit = np.where(bound[:, None], 0.0, jacobian / size[:, None])
        share, directions = np.linalg.eigh(
            np.matmul(unit.transpose(0, 2, 1), unit) + bound[:, None] * np.eye(bound.shape[1])
        )
        sigma = np.sqrt(np.mean(np.nan_to_num(errors) ** 2, axis=1))
        by = DEVIATIONS * sigma[:, None] / np.sqrt(np.maximum(share, 1e-12))
        steps = directions.transpose(0, 2, 1) * by[:, :, None] / size[:, None]
        longest = np.maximum(np.abs(steps).max(axis=2, keepdims=True), 1e-300)
        return steps * np.clip(longest, STEP, LONGEST_STEP) / longest

    def weights(self, square: float) -> np.ndarray:
        """Weights of errors (rows,) whose mean square is `square` [rad²]: 1 / √(1 + (m − 1) ρ) for m rows in the same count.

        These have the error of their count in common, uniform over it: ρ = count² / 12 / square, at most 1. While a servo rests,
        its many rows so weigh as one where counts are all that is wrong, and as many where the model is.
        """
        found = []
        for log in self.logs:
            steps = np.abs(np.diff(log.position))
            count = np.min(steps, where=steps > 0.0, initial=np.inf)
            rho = min(count**2 / 12.0 / max(square, 1e-300), 1.0) if np.isfinite(count) else 0.0
            same = np.diff(np.flatnonzero(np.diff(log.position, prepend=np.nan)), append=len(log.t))
            found.append(np.repeat(1.0 / np.sqrt(1.0 + (same - 1.0) * rho), same))
        return np.concatenate(found)

    def descend(
        self,
        z: np.ndarray,
        rounds: int,
        settled: float,
        weights: np.ndarray | None = None,
        used: np.ndarray | None = None,
    ) -> Descent:
        """Searches from coordinates z (points, k), within bounds, until a step gains less than a share `settled` of the cost.

        Args:
            z: to begin with.   rounds: steps that help, and half as many again that do not.   settled: share of the cost.
            weights: (rows,) of the errors, for steps that follow narrow valleys as well, where most of the way is along one;
                None: 1, and straight steps.
            used: (points, logs) False for logs that a search leaves out; None: none does.
        """
        low, high, weight = self.order.low, self.order.high, 1.0 if weights is None else weights
        steps: list[np.ndarray] = []  # of the last point, for the next

        def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            errors, jacobian = self.evaluate(x, steps.pop() if steps else None, used)
            found = errors * weight, (jacobian.transpose(0, 2, 1) * weight).transpose(0, 2, 1)
            steps.append(self.steps_by(x, *found))
            return found

        return descended(
            evaluate, Descent.begin(evaluate, np.clip(z, low, high), DAMPING.first), damping=DAMPING,
            move=lambda x, step: np.clip(x + step, low, high),
            box=lambda x: (np.maximum(low - x, -LONGEST), np.minimum(high - x, LONGEST)),
            ends=lambda gained, cost, _: gained < settled * cost, rounds=rounds, trials=rounds + rounds // 2,
            errors=None if weights is None else lambda x: self.errors(x, used) * weights,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Driven:
    """A log, or a part of one, on the ticks of the servo's loop, time 0 at its first row.

    Attributes:
        log: whose motion it is.   start: position and speed at its first row [rad, rad/s].
        goal, supply, on: held from tick to tick.   times: of the rows of `goal` [s].   duration: [s].
        period: from one stored state to the next [s].   before: (k,) the one before each row.
        part: (k,) of the way to the next.
    """

    log: BenchLog
    start: tuple[float, float]
    goal: Schedule
    supply: Schedule
    on: Schedule
    times: np.ndarray
    duration: float
    period: float
    before: np.ndarray
    part: np.ndarray

    @classmethod
    def of(cls, log: BenchLog, start: tuple[float, float], period: float) -> _Driven:
        """A log from its first state; what comes between two turns of the loop is read by the next."""
        t = (log.t - log.t[0]) / period
        ticks = np.ceil(t - ROUNDING)
        last = np.append(np.diff(ticks) > 0, True)  # of rows within a tick the last one
        times = ticks[last] * period

        def held(values: np.ndarray, name: str) -> Schedule:
            return Schedule(times, values[last][:, None], (name,))

        at = t / EVERY
        before = np.floor(at + ROUNDING).astype(int)
        duration = float(before[-1] + 1) * EVERY * period
        schedules = (held(log.goal, JOINT), held(log.supply, "supply"), held(log.on, JOINT))
        return cls(log, start, *schedules, log.t[last] - log.t[0], duration, EVERY * period, before, at - before)

    def goal_after(self, delay: float) -> Schedule:
        """The goal so many seconds late: between rows it is on the line from one to the next."""
        if delay == 0.0:
            return self.goal
        late = np.interp(self.times - delay, self.log.t - self.log.t[0], self.log.goal)
        return Schedule(self.goal.times, late[:, None], self.goal.names)

    def at_rows(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Positions at the rows (lanes, k) from stored states (lanes, states), by Hermite's cubic between two."""
        k, s, h = self.before, self.part, self.period
        a, b = q[:, k], q[:, k + 1]
        return (
            a * ((1 + 2 * s) * (1 - s) ** 2)
            + b * (s**2 * (3 - 2 * s))
            + h * (qd[:, k] * (s * (1 - s) ** 2) - qd[:, k + 1] * (s**2 * (1 - s)))
        )


def _parts_of(log: BenchLog, restart: float, goal_speed: float | None, period: float) -> list[_Driven]:
    """Parts of a log, about as long as `restart` [s], each from the measured state: a parabola through the rows around it.

    Args:
        goal_speed: [rad/s] with which the goals are to move; None: as logged.   period: of the servo's loop [s].
    """
    t = log.t - log.t[0]
    count = max(1, min(round(t[-1] / restart), len(t) // LEAST))
    first = [len(t) * k // count for k in range(count + 1)]
    goal = log.goal if goal_speed is None else _slowed(log, goal_speed)
    found = []
    for a, b in pairwise(first):
        start = (float(log.position[0]), 0.0)
        if a:
            near = np.abs(t - t[a]) <= AROUND
            near[a - BESIDE : a + BESIDE + 1] = True
            _, speed, position = np.polyfit(t[near] - t[a], log.position[near], 2)
            start = (float(position), float(speed))
        columns = {"t": log.t, "position": log.position, "goal": goal, "on": log.on, "supply": log.supply}
        part = replace(log, **{name: values[a:b] for name, values in columns.items()})
        found.append(_Driven.of(part, start, period))
    return found


def _slowed(log: BenchLog, speed: float) -> np.ndarray:
    """Goals (k,) that move to the logged ones at most at a speed [rad/s], each in the middle of the time to the next row."""
    goal, found = log.position[0], []
    for wanted, on, position, step in zip(
        log.goal, log.on, log.position, speed * np.diff(log.t, append=np.inf), strict=True
    ):
        before, way = goal if on else position, wanted - goal
        goal = before + min(max(way, -step), step) if on else position
        found.append(before + min(max(way, -step / 2), step / 2) if on else position)
    return np.array(found)


def _believable(numbers: dict[str, float]) -> dict[str, float]:
    """Numbers none of which a record refuses, nor folds as a constant: the arm that lanes vary is built with them."""
    return {name: value if value else 0.01 for name, value in numbers.items() if name not in (OFFSET, DELAY)}

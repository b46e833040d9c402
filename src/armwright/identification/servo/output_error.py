"""Output error of a servo's bench: every log simulated as a whole from its goals, compared with its positions.

Lanes of the compiled simulator are logs times points of the search, finite differences among them. Friction that holds the joint
at rest makes the motion bend where it breaks loose, so differences are taken over steps that are large beside rounding. Errors
hardly change along directions in which numbers of friction replace each other; differences by one number after the other are too
wrong for these. So the steps follow the principal directions of the last derivatives, half a standard deviation along each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from armwright.fitting.levenberg_marquardt import Damping, Descent, descended
from armwright.identification.motor.unknowns import values_of
from armwright.identification.servo.bench import JOINT, PATHS, ROD, ServoLoop, bench_record, link_numbers
from armwright.identification.servo.bench_log import BenchLog
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
DAMPING = Damping(first=1e-2, better=0.2, worse=5.0)
RODS = {"mass": f"{ROD}.mass_kg", "x": f"{ROD}.com_m[0]", "z": f"{ROD}.com_m[2]"}


@dataclass(frozen=True, eq=False)
class BenchProblem:
    """Logs of a servo, ready to be simulated.

    Attributes:
        logs: with a mass of the rod each.   loop: of the servo.   order: the friction model.
    """

    logs: tuple[BenchLog, ...]
    loop: ServoLoop
    order: Order

    @cached_property
    def arm(self) -> Model:
        """The bench, whose numbers lanes vary."""
        order = self.order
        guesses = np.array([each.guess for each in order.unknowns])
        numbers = dict(zip(order.columns, order.matrix @ guesses + order.fixed, strict=True))
        return build_model(bench_record(self.logs[0], self.loop, _believable(numbers), 0.1))

    @cached_property
    def _driven(self) -> tuple[_Driven, ...]:
        return tuple(_Driven.of(each, self.loop.period_s) for each in self.logs)

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
        return BenchProblem(tuple(self.logs[k] for k in logs), self.loop, self.order)

    def values(self, z: np.ndarray) -> np.ndarray:
        """(…, columns) numbers of the record at coordinates z (…, k)."""
        values, _ = values_of(self.order.unknowns, z)
        return values @ self.order.matrix.T + self.order.fixed

    def predictions(self, values: np.ndarray) -> np.ndarray:
        """Positions at the rows of all logs (points, rows) [rad]; not a number where a simulation diverged.

        Args:
            values: (points, columns) numbers of the record.
        """
        found = np.full((len(values), len(self.measured)), np.nan)
        pairs = np.array([(point, log) for log in range(len(self.logs)) for point in range(len(values))])
        for begin in range(0, len(pairs), MOST_LANES):
            lanes = pairs[begin : begin + MOST_LANES]
            run = Simulation(self._scenario(values, lanes), loop=self._code).run(progress=False, keep_state=False)
            q, qd = run["q"].values[..., 0], run["qd"].values[..., 0]
            for log in np.unique(lanes[:, 1]):
                own = lanes[:, 1] == log
                found[lanes[own, 0], self.parts[log]] = self._driven[log].at_rows(q[own], qd[own])
        return found

    @cached_property
    def _code(self) -> CompiledLoop:
        """The loop in native code, for all lanes of all searches."""
        guesses = np.array([[each.to_coordinate(each.guess) for each in self.order.unknowns]])
        return Simulation(self._scenario(self.values(guesses), np.zeros((1, 2), dtype=int))).loop

    def _scenario(self, values: np.ndarray, lanes: np.ndarray) -> Scenario:
        """The bench from the goals of its logs; lanes (lanes, 2) are pairs of a point, of `values`, and a log."""
        driven = [self._driven[log] for log in lanes[:, 1]]
        own = dict(zip(self.order.columns, values[lanes[:, 0]].T, strict=True))
        offset, delay = own.pop(OFFSET), own.pop(DELAY)
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
            start=Start(Batch(np.array([[each.log.position[0]] for each in driven]))),
            recording=Recording(period=EVERY * self.loop.period_s, what="state"),
            solver=Solver(global_error=False),
            vary=vary,
        )

    def errors(self, z: np.ndarray) -> np.ndarray:
        """Measured less simulated positions (points, rows) at coordinates z (points, k) [rad]."""
        return self.measured - self.predictions(self.values(z))

    def evaluate(self, z: np.ndarray, steps: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Errors (points, rows) and their derivatives (points, rows, k) by the coordinates.

        Args:
            z: (points, k).   steps: (points, k, k) over which differences are taken; None: one along each coordinate.
        """
        points, k = z.shape
        low, high = self.order.low, self.order.high
        steps = np.broadcast_to(STEP * np.eye(k), (points, k, k)) if steps is None else steps
        ahead, back = (np.clip(z[:, None] + way * steps, low, high) - z[:, None] for way in (1.0, -1.0))
        shorter = np.linalg.norm(ahead, axis=2) < np.linalg.norm(back, axis=2)  # cut off at a bound
        moved = np.where(shorter[:, :, None], back, ahead)
        every = np.concatenate([z[:, None], z[:, None] + moved], axis=1).reshape(-1, k)
        errors = self.errors(every).reshape(points, 1 + k, -1)
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
        self, z: np.ndarray, rounds: int, trials: float, settled: float, weights: np.ndarray | None = None
    ) -> Descent:
        """Searches from coordinates z (points, k), within bounds, until a step gains less than a share `settled` of the cost.

        Args:
            z: to begin with.   rounds: steps that help.   trials: steps.   settled: share of the cost.
            weights: (rows,) of the errors, for steps that follow narrow valleys as well, where most of the way is along one;
                None: 1, and straight steps.
        """
        low, high, weight = self.order.low, self.order.high, 1.0 if weights is None else weights
        steps: list[np.ndarray] = []  # of the last point, for the next

        def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            errors, jacobian = self.evaluate(x, steps.pop() if steps else None)
            found = errors * weight, (jacobian.transpose(0, 2, 1) * weight).transpose(0, 2, 1)
            steps.append(self.steps_by(x, *found))
            return found

        def ends(gained: np.ndarray, cost: np.ndarray, moved: np.ndarray) -> np.ndarray:
            return gained < settled * cost

        def box(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return np.maximum(low - x, -LONGEST), np.minimum(high - x, LONGEST)

        def move(x: np.ndarray, step: np.ndarray) -> np.ndarray:
            return np.clip(x + step, low, high)

        begun = Descent.begin(evaluate, np.clip(z, low, high), DAMPING.first)
        errors = None if weights is None else lambda x: self.errors(x) * weights
        return descended(
            evaluate, begun, damping=DAMPING, move=move, ends=ends, rounds=rounds, trials=trials, box=box, errors=errors
        )


@dataclass(frozen=True, eq=False)
class _Driven:
    """A log on the ticks of the servo's loop, time 0 at its first row.

    Attributes:
        log: whose motion it is.   goal, supply, on: held from tick to tick.   times: of the rows of `goal` [s].
        duration: [s].
        period: from one stored state to the next [s].   before: (k,) the one before each row.
        part: (k,) of the way to the next.
    """

    log: BenchLog
    goal: Schedule
    supply: Schedule
    on: Schedule
    times: np.ndarray
    duration: float
    period: float
    before: np.ndarray
    part: np.ndarray

    @classmethod
    def of(cls, log: BenchLog, period: float) -> _Driven:
        """A log; what comes between two turns of the loop is read by the next."""
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
        return cls(log, *schedules, log.t[last] - log.t[0], duration, EVERY * period, before, at - before)

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


def _believable(numbers: dict[str, float]) -> dict[str, float]:
    """Numbers none of which a record refuses, nor folds as a constant: the arm that lanes vary is built with them."""
    return {name: value if value else 0.01 for name, value in numbers.items() if name not in (OFFSET, DELAY)}

"""Output error of a servo's bench: every log simulated as a whole from its goals, compared with its positions.

Lanes of the compiled simulator are logs times points of the search, finite differences among them. Friction that holds the joint
at rest makes the motion bend where it breaks loose, so differences are taken over steps that are large beside rounding.
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
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Inputs, Recording, Solver, Start
from armwright.simulation.simulation import Simulation

STEP = 2e-3  # of a coordinate, which is a logarithm or in parts of its scale
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
            for (point, log), rows in zip(lanes, self._simulated(values, lanes), strict=True):
                found[point, self.parts[log]] = rows
        return found

    def _simulated(self, values: np.ndarray, lanes: np.ndarray) -> list[np.ndarray]:
        """Positions at the rows of its log, by lane; lanes (lanes, 2) are pairs of a point and a log."""
        driven = [self._driven[log] for _, log in lanes]
        own = dict(zip(self.order.columns, values[lanes[:, 0]].T, strict=True))
        offset, delay = own.pop(OFFSET), own.pop(DELAY)
        rods = [link_numbers(each.log, turn) for each, turn in zip(driven, offset, strict=True)]
        vary = {PATHS[name]: Batch(column) for name, column in own.items()}
        vary |= {path: Batch(np.array([each[name] for each in rods])) for name, path in RODS.items()}
        for axis in ("xx", "yy"):
            vary[f"{ROD}.inertia_kg_m2.{axis}"] = Batch(np.array([each["inertia"] for each in rods]))
        vary[f"{JOINT}.firmware.p"] = Batch(np.array([each.log.p for each in driven]))
        scenario = Scenario(
            self.arm,
            max(each.duration for each in driven),
            command=Batch([each.goal_after(late) for each, late in zip(driven, delay, strict=True)]),
            inputs=Inputs(supply=Batch([each.supply for each in driven]), enabled=Batch([each.on for each in driven])),
            start=Start(Batch(np.array([[each.log.position[0]] for each in driven]))),
            recording=Recording(period=EVERY * self.loop.period_s, what="state"),
            solver=Solver(global_error=False),
            vary=vary,
        )
        run = Simulation(scenario).run(progress=False, keep_state=False)
        q, qd = run["q"].values[..., 0], run["qd"].values[..., 0]
        return [each.at_rows(*states) for each, *states in zip(driven, q, qd, strict=True)]

    def errors(self, z: np.ndarray) -> np.ndarray:
        """Measured less simulated positions (points, rows) at coordinates z (points, k) [rad]."""
        return self.measured - self.predictions(self.values(z))

    def evaluate(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Errors (points, rows) and their derivatives (points, rows, k) by the coordinates."""
        points, k = z.shape
        steps = np.where(z + STEP <= self.order.high, STEP, -STEP)
        moved = z[:, None, :] + steps[:, None, :] * np.eye(k)
        every = np.concatenate([z[:, None, :], moved], axis=1).reshape(-1, k)
        errors = self.errors(every).reshape(points, 1 + k, -1)
        slopes = (errors[:, 1:] - errors[:, :1]) / steps[:, :, None]
        return errors[:, 0], np.nan_to_num(slopes.transpose(0, 2, 1))

    def descend(self, z: np.ndarray, rounds: int, trials: float, settled: float) -> Descent:
        """Searches from coordinates z (points, k), within bounds, until a step gains less than a share `settled` of the cost."""
        low, high = self.order.low, self.order.high

        def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            errors, jacobian = self.evaluate(x)
            slope = np.einsum("lmk,lm->lk", jacobian, np.nan_to_num(errors))
            leaves = ((x <= low) & (slope > 0.0)) | ((x >= high) & (slope < 0.0))
            return errors, np.where(leaves[:, None, :], 0.0, jacobian)  # at a bound that it would leave, a number stays

        def ends(gained: np.ndarray, cost: np.ndarray, moved: np.ndarray) -> np.ndarray:
            return gained < settled * cost

        def move(x: np.ndarray, step: np.ndarray) -> np.ndarray:
            return np.clip(x + np.clip(step, -LONGEST, LONGEST), low, high)

        begun = Descent.begin(evaluate, np.clip(z, low, high), DAMPING.first)
        return descended(evaluate, begun, damping=DAMPING, move=move, ends=ends, rounds=rounds, trials=trials)


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
        """Positions at the rows (k,) from stored states, by Hermite's cubic between two."""
        k, s, h = self.before, self.part, self.period
        a, b = q[k], q[k + 1]
        return (
            a * (1 + 2 * s) * (1 - s) ** 2
            + b * s**2 * (3 - 2 * s)
            + h * (qd[k] * s * (1 - s) ** 2 - qd[k + 1] * s**2 * (1 - s))
        )


def _believable(numbers: dict[str, float]) -> dict[str, float]:
    """Numbers none of which a record refuses, nor folds as a constant: the arm that lanes vary is built with them."""
    return {name: value if value else 0.01 for name, value in numbers.items() if name not in (OFFSET, DELAY)}

"""The search: every order in parts of a few logs, from many draws and from the smaller orders, then cross-validated.

The cost of parts has few minima, which a few draws find. From there the logs but those of a fold are fitted twice: in parts, and
as whole logs. Where the model is as good as the logs, whole logs determine its numbers best; else parts mislead it less.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armwright.errors import Interrupted
from armwright.fitting.levenberg_marquardt import cost_of
from armwright.identification.motor.unknowns import values_of
from armwright.identification.servo.bench import ServoLoop
from armwright.identification.servo.bench_log import BenchLog
from armwright.identification.servo.orders import BEFORE, DELAY, OFFSET, ORDERS, PARTS, Order, Scales, order_of
from armwright.identification.servo.output_error import BenchProblem
from armwright.progress import Progress

DRAWS, FEW = 48, 4  # first guesses of an order, and logs that judge them
DRAWS_AROUND, SPREAD = 10, 0.3  # guesses around a smaller order's fit, and the standard deviation of their logarithms
KEPT = 3  # of all guesses those that are searched from; the best of them is followed to the end
RESTART = 0.5  # [s] of a part
FOLDED = 30  # logs that all folds fit together, beside those of one fold: up to 6 logs each is held out alone, of 16 half of them
# Of the cost: a step that gains less ends the search. A number one standard deviation off costs a part in as many as rows.
NEAR, COMPARED, SETTLED = 1e-3, 1e-4, 1e-5  # in parts before the final fit, as whole logs, and in the final fit
# Steps from each guess, from the best one, of folds in parts and as whole logs, and of the final fit.
ROUNDS_OF_START, ROUNDS_OF_FEW, ROUNDS_OF_PARTS, ROUNDS, ROUNDS_TO_SETTLE = 4, 8, 3, 4, 15


@dataclass(frozen=True, eq=False)
class OrderFit:
    """Fit of a friction model.

    Attributes:
        problem: what was fitted.   z: (k,) coordinates.   errors: (rows,) measured less simulated [rad].
        jacobian: (rows, k) their derivatives.   weights: (rows,) of the errors in the fit.
    """

    problem: BenchProblem
    z: np.ndarray
    errors: np.ndarray
    jacobian: np.ndarray
    weights: np.ndarray


@dataclass(frozen=True, eq=False)
class Validated:
    """A friction model that was fitted to all logs but those of a fold, for each fold.

    Attributes:
        problem: of all logs.   z: (folds, k) coordinates.
        fitted: mean absolute errors of whole logs in the folds that were fitted to them [rad].
        held_out: (logs,) in the fold that was not; empty where there is a single log.
    """

    problem: BenchProblem
    z: np.ndarray
    fitted: np.ndarray
    held_out: np.ndarray


def validated_orders(
    logs: Sequence[BenchLog],
    loop: ServoLoop,
    extra: Sequence[str],
    orders: Sequence[str],
    seed: int,
    progress: Progress,
) -> dict[str, tuple[Validated, Validated]]:
    """Friction models by name, each fitted to whole logs and to parts, with those that it starts from.

    Args:
        logs: with a mass of the rod.   loop: of the servo.   extra: further unknowns.   orders: names that are asked for.
        seed: of the draws.   progress: called with orders done and of all.
    Raises:
        Interrupted: Ctrl-C; `found` holds the models until then.
    """
    wanted = [name for name in ORDERS if any(name == each or name in _all_before(each) for each in orders)]
    rng, scales = np.random.default_rng(seed), Scales.of(logs)
    few: dict[str, tuple[BenchProblem, np.ndarray]] = {}
    found: dict[str, tuple[Validated, Validated]] = {}
    for number, name in enumerate(wanted):
        progress(number, len(wanted))
        problem = BenchProblem(tuple(logs), loop, order_of(name, loop, scales, extra))
        try:
            few[name] = _of_few(problem, scales, [few[each] for each in BEFORE[name]], rng)
            found[name] = _validated(few[name][1], problem, [found[each][0] for each in BEFORE[name]])
        except KeyboardInterrupt:
            if not any(each in found for each in orders):
                raise
            missing = [each for each in orders if each not in found]
            raise Interrupted(f"before {', '.join(missing)} could be compared", found=found) from None
    progress(len(wanted), len(wanted))
    return found


def _all_before(name: str) -> set[str]:
    return {*BEFORE[name], *(each for before in BEFORE[name] for each in _all_before(before))}


def next_larger(name: str, of: Collection[str]) -> list[str]:
    """The orders of some that contain one, but for those that contain another such."""
    larger = [each for each in of if name in _all_before(each)]
    return [each for each in larger if not _all_before(each) & set(larger)]


def _of_few(
    problem: BenchProblem, scales: Scales, earlier: Sequence[tuple[BenchProblem, np.ndarray]], rng: np.random.Generator
) -> tuple[BenchProblem, np.ndarray]:
    """The problem of a few logs in parts and its best coordinates (k,), from draws and from smaller orders'."""
    few = replace(problem.only(_spread_out(problem.logs)), restart=RESTART)
    starts = [_drawn(problem, scales, rng), *(_from_earlier(problem, *each, rng) for each in earlier)]
    begun = few.descend(_best(few, np.concatenate(starts), KEPT), ROUNDS_OF_START, NEAR)
    best = begun.x[[np.argmin(begun.cost)]]
    return few, few.descend(best, ROUNDS_OF_FEW, NEAR).x[0]


def _drawn(problem: BenchProblem, scales: Scales, rng: np.random.Generator) -> np.ndarray:
    """(draws, k) coordinates drawn by stall torque, no-load speed, inertia and friction."""
    order = problem.order
    values = {each.name: np.full(DRAWS, each.guess) for each in order.unknowns}

    def spread(low: float, high: float) -> np.ndarray:
        return np.exp(rng.uniform(np.log(low), np.log(high), DRAWS))

    if "R" in values:
        values["kt"] = scales.supply / (spread(0.5, 8.0) * scales.speed)
        values["R"] = values["kt"] * scales.supply / (spread(1.0, 10.0) * scales.torque)
    else:
        values["kt"] = spread(0.5, 10.0) * scales.torque / problem.loop.output_limit
    values["J"] = spread(0.03, 3.0) * scales.inertia
    for each in order.unknowns:
        if each.name in ("viscous", "coulomb"):
            values[each.name] = each.guess * spread(0.1, 10.0)
        elif each.name in ("stribeck_speed", "exponent"):
            values[each.name] = each.guess * spread(0.3, 3.0)
        elif each.name.startswith("load"):
            values[each.name] = rng.uniform(0.0, 0.4, DRAWS)
        elif each.name == "fall" or each.name.startswith("square"):
            values[each.name] = each.scale * rng.uniform(0.0, 1.5, DRAWS)
    return np.array([[each.to_coordinate(v) for v in values[each.name]] for each in order.unknowns]).T


def _spread_out(logs: Sequence[BenchLog]) -> list[int]:
    """Numbers of a few logs that differ: by length of the way that they go, from the least to the most."""
    ways = np.argsort([_way(each) for each in logs], kind="stable")
    return sorted(
        int(ways[k]) for k in np.unique(np.linspace(0, len(logs) - 1, min(FEW, len(logs))).round().astype(int))
    )


def _way(log: BenchLog) -> float:
    """Length of the way that a log goes [rad]."""
    return float(np.abs(np.diff(log.position)).sum())


def _best(problem: BenchProblem, z: np.ndarray, count: int) -> np.ndarray:
    """The coordinates (count, k) with the least errors."""
    cost = cost_of(problem.errors(np.clip(z, problem.order.low, problem.order.high)))
    return z[np.argsort(cost, kind="stable")[:count]]


def _from_earlier(problem: BenchProblem, earlier: BenchProblem, z: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(draws, k) from coordinates z of an order that it contains: these, and draws around them with values of what it lacks."""
    order, known = problem.order, _widened(earlier, z)
    rows = [_with_none_of(order, known)]
    for _ in range(DRAWS_AROUND):
        values = dict(known)
        for each in order.unknowns:
            if each.name not in known and each.logarithmic:
                values[each.name] = each.guess * float(np.exp(rng.uniform(-1.5, 1.5)))
            elif each.name not in known:
                values[each.name] = each.scale * float(rng.uniform(0.0, 1.5))
            elif each.name not in (OFFSET, DELAY):
                values[each.name] = known[each.name] * float(np.exp(rng.normal(0.0, SPREAD)))
        rows.append(np.array([each.to_coordinate(values[each.name]) for each in order.unknowns]))
    return np.array(rows)


def _with_none_of(order: Order, known: Mapping[str, float]) -> np.ndarray:
    """(k,) coordinates of an order with the values of a smaller one, and none of the torques that this lacks."""
    none = {each.name: each.guess if each.logarithmic else 0.0 for each in order.unknowns}
    return np.array([each.to_coordinate(known.get(each.name, none[each.name])) for each in order.unknowns])


def _widened(problem: BenchProblem, z: np.ndarray) -> dict[str, float]:
    """Values of the unknowns at coordinates z (k,), and loads of the motor and of external torque from one load for both."""
    values, _ = values_of(problem.order.unknowns, z)
    known = dict(zip(problem.order.names, values.tolist(), strict=True))
    return known | {part: known[one] for one in ("load", "load_still") if one in known for part in PARTS[one]}


def folds(logs: Sequence[BenchLog]) -> list[list[int]]:
    """Numbers of the logs that are held out together: each log once, and of no gain nor way all; of a single log none."""
    if len(logs) < 2:
        return [[]]
    count = max(2, min(len(logs), FOLDED // len(logs) + 1))
    order = sorted(range(len(logs)), key=lambda k: (logs[k].p, _way(logs[k])))
    turn = [min(rank % (2 * count), 2 * count - 1 - rank % (2 * count)) for rank in range(len(logs))]  # 0 1 1 0 of two
    return [sorted(k for k, fold in zip(order, turn, strict=True) if fold == number) for number in range(count)]


def _validated(few: np.ndarray, problem: BenchProblem, earlier: Sequence[Validated]) -> tuple[Validated, Validated]:
    """A model cross-validated as whole logs and in parts.

    Args:
        few: (k,) coordinates where the parts start.   problem: of all whole logs.   earlier: smaller models, of whole logs.
    """
    order, in_parts = problem.order, replace(problem, restart=RESTART)
    out = np.array([[log in held for log in range(len(problem.logs))] for held in folds(problem.logs)])
    count = len(out)
    parts = in_parts.descend(np.tile(few, (count, 1)), ROUNDS_OF_PARTS, NEAR, used=~out).x
    smaller = [[_with_none_of(order, _widened(each.problem, z)) for z in each.z] for each in earlier]
    starts = np.clip(np.array([parts, *smaller]).swapaxes(0, 1), order.low, order.high)  # (folds, starts, k)
    cost = cost_of(problem.errors(starts.reshape(-1, len(few)), ~out)).reshape(count, -1)
    best = starts[np.arange(count), np.argmin(cost, axis=1)]
    whole = problem.descend(best, ROUNDS, COMPARED, problem.weights(np.inf), ~out).x
    return _judged(problem, problem, whole, out), _judged(in_parts, problem, parts, out)


def _judged(problem: BenchProblem, whole: BenchProblem, z: np.ndarray, out: np.ndarray) -> Validated:
    """Fits z (folds, k) to a problem, with their errors of whole logs; infinite where a simulation diverges."""
    wrong = np.nan_to_num(np.abs(whole.errors(z)), nan=np.inf)
    errors = np.array([wrong[:, part].mean(axis=1) for part in whole.parts]).T  # (folds, logs)
    return Validated(problem, z, errors[~out], errors.T[out.T])


def fitted_to_all(model: Validated, settled: float = COMPARED) -> OrderFit:
    """The fit to all logs from the best of the folds' fits, until a step gains less than a share `settled` of the cost.

    Rows in the same count weigh less, by the mean square of the errors before it.
    """
    problem = model.problem
    errors = problem.errors(model.z)
    best = int(np.argmin(cost_of(errors)))
    weights = problem.weights(float(np.mean(errors[best] ** 2)))
    rounds = ROUNDS if settled == COMPARED else ROUNDS_TO_SETTLE
    done = problem.descend(model.z[[best]], rounds, settled, weights)
    errors, jacobian = problem.evaluate(done.x, problem.steps_by(done.x, done.errors, done.jacobian))
    return OrderFit(problem, done.x[0], errors[0], jacobian[0], weights)

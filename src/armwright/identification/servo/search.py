"""The search: M1 from many draws, every further order from the fits of those that it contains."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from armwright.errors import Interrupted
from armwright.identification.motor.unknowns import values_of
from armwright.identification.servo.bench import ServoLoop
from armwright.identification.servo.bench_log import BenchLog
from armwright.identification.servo.orders import BEFORE, DELAY, OFFSET, ORDERS, Scales, order_of
from armwright.identification.servo.output_error import BenchProblem
from armwright.progress import Progress

DRAWS, FEW = 48, 4  # first guesses of M1 and M3, and logs that judge them
KEPT, FIRST_ROUNDS = 3, 5  # of these, and steps of a search from each with those logs
DRAWS_OF_ORDER, KEPT_OF_ORDER = (
    10,
    2,
)  # guesses of an order from each that it contains, and how many of all are searched from
SPREAD = 0.3  # standard deviation of the logarithm by which such a guess leaves what it comes from
DRAWN = ("M1", "M3")  # orders of which a good minimum is missed by a search that begins at the fit of a smaller one
# Of the cost: a step that gains less ends the search. A number one standard deviation off costs a part in as many as rows.
COMPARED, SETTLED = 1e-4, 1e-5
ROUNDS_OF_START, ROUNDS, ROUNDS_TO_SETTLE = 2, 8, 15  # steps from each start, of the best one, and of the final fit


@dataclass(frozen=True, eq=False)
class OrderFit:
    """Fit of a friction model to all logs.

    Attributes:
        problem: what was fitted.   z: (k,) coordinates.   errors: (rows,) measured less simulated [rad].
        jacobian: (rows, k) their derivatives.   weights: (rows,) of the errors in the fit.
    """

    problem: BenchProblem
    z: np.ndarray
    errors: np.ndarray
    jacobian: np.ndarray
    weights: np.ndarray

    @property
    def square(self) -> float:
        """Mean square of the errors [rad²]."""
        return float(np.mean(self.errors**2))

    @property
    def cost(self) -> float:
        """Sum of squares [rad²]."""
        return float(self.errors @ self.errors)

    @property
    def by_name(self) -> dict[str, float]:
        """Values of the unknowns."""
        values, _ = values_of(self.problem.order.unknowns, self.z)
        return dict(zip(self.problem.order.names, values.tolist(), strict=True))


def fit_orders(
    logs: Sequence[BenchLog],
    loop: ServoLoop,
    extra: Sequence[str],
    orders: Sequence[str],
    seed: int,
    progress: Progress,
) -> dict[str, OrderFit]:
    """Fits of friction models, by name, each with those that it starts from.

    Args:
        logs: with a mass of the rod.   loop: of the servo.   extra: further unknowns.   orders: names that are asked for.
        seed: of the draws.   progress: called with orders done and of all.
    Raises:
        Interrupted: Ctrl-C; `found` holds the fits until then.
    """
    wanted = [name for name in ORDERS if any(name == each or name in _all_before(each) for each in orders)]
    rng, scales, found = np.random.default_rng(seed), Scales.of(logs), {}
    for number, name in enumerate(wanted):
        progress(number, len(wanted))
        problem = BenchProblem(tuple(logs), loop, order_of(name, loop, scales, extra))
        try:
            starts = [_first(problem, scales, rng)] if name in DRAWN else []
            starts += [_from_earlier(problem, found[each], rng) for each in BEFORE[name]]
            found[name] = _searched(problem, np.concatenate(starts))
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


def _first(problem: BenchProblem, scales: Scales, rng: np.random.Generator) -> np.ndarray:
    """(starts, k) the best of draws over stall torque, no-load speed, inertia and friction, followed for a few logs."""
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
    for name in ("viscous", "coulomb"):
        values[name] = values[name] * spread(0.1, 10.0)
    if "load" in values:
        values["load"] = rng.uniform(0.0, 0.4, DRAWS)
    z = np.array([[each.to_coordinate(v) for v in values[each.name]] for each in order.unknowns]).T
    few = problem.only(_spread_out(problem.logs))
    begun = few.descend(_best(few, z, KEPT), FIRST_ROUNDS, FIRST_ROUNDS + 3, COMPARED)
    return begun.x[np.argsort(begun.cost)[:KEPT_OF_ORDER]]


def _spread_out(logs: Sequence[BenchLog]) -> list[int]:
    """Numbers of a few logs that differ: by length of the way that they go, from the least to the most."""
    ways = np.argsort([float(np.abs(np.diff(each.position)).sum()) for each in logs], kind="stable")
    return sorted(
        int(ways[k]) for k in np.unique(np.linspace(0, len(logs) - 1, min(FEW, len(logs))).round().astype(int))
    )


def _best(problem: BenchProblem, z: np.ndarray, count: int) -> np.ndarray:
    """The coordinates (count, k) with the least errors."""
    errors = problem.errors(np.clip(z, problem.order.low, problem.order.high))
    cost = np.nan_to_num(np.einsum("lm,lm->l", errors, errors), nan=np.inf)
    return z[np.argsort(cost, kind="stable")[:count]]


def _from_earlier(problem: BenchProblem, earlier: OrderFit, rng: np.random.Generator) -> np.ndarray:
    """(draws, k) from the fit of an order that it contains: that itself, and draws around it with values of what it lacks."""
    order, known = problem.order, earlier.by_name
    known |= _widened(known)
    rows = []
    for draw in range(DRAWS_OF_ORDER):
        values = dict(known)
        for each in order.unknowns:
            new, by = each.name not in known, float(np.exp(rng.normal(0.0, SPREAD))) if draw else 1.0
            if new and each.logarithmic:
                values[each.name] = each.guess * float(np.exp(rng.uniform(-1.5, 1.5)))
            elif new:
                values[each.name] = each.scale * float(rng.uniform(0.0, 1.5)) * bool(draw)
            elif each.name not in (OFFSET, DELAY):
                values[each.name] = known[each.name] * by
        rows.append([each.to_coordinate(values[each.name]) for each in order.unknowns])
    return np.array(rows)


def _widened(known: Mapping[str, float]) -> dict[str, float]:
    """Loads of the motor and of external torque from one load for both."""
    pairs = {"load": ("load_motor", "load_external"), "load_still": ("load_motor_still", "load_external_still")}
    return {part: known[one] for one, parts in pairs.items() if one in known for part in parts}


def _searched(problem: BenchProblem, starts: np.ndarray) -> OrderFit:
    """The fit from the best of some starts (starts, k)."""
    begun = problem.descend(_best(problem, starts, KEPT_OF_ORDER), ROUNDS_OF_START, ROUNDS_OF_START + 1, COMPARED)
    return refined(problem, begun.x[int(np.argmin(begun.cost))])


def refined(problem: BenchProblem, z: np.ndarray, settled: float = COMPARED, square: float = np.inf) -> OrderFit:
    """The fit from one start (k,), until a step gains less than a share `settled` of the cost.

    Args:
        problem: to fit.   z: where it starts.   settled: share of the cost.
        square: mean square of the errors [rad²], by which rows in the same count weigh less; infinite: all weigh the same.
    """
    rounds, weights = ROUNDS if settled == COMPARED else ROUNDS_TO_SETTLE, problem.weights(square)
    done = problem.descend(z[None], rounds, rounds + 4, settled, weights)
    errors, jacobian = problem.evaluate(done.x, problem.steps_by(done.x, done.errors, done.jacobian))
    return OrderFit(problem, done.x[0], errors[0], jacobian[0], weights)

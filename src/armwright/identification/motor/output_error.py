"""Output error: the least squares of free simulation less measurement, from many starts at once. [Ljung1999]

    minimise over z:  Σ ((y_k(z) - y_k measured) / σ)²,   y(z) by `Response`, with its exact Jacobian.

All starts are lanes of one compiled batch and take Levenberg and Marquardt's steps together, each with a damping of its own;
the best goes on in `scipy.optimize.least_squares`. [Marquardt1963]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc

from armwright.fitting.levenberg_marquardt import Damping, Descent, descended
from armwright.identification.motor.measured import Driven
from armwright.identification.motor.response import Response
from armwright.identification.motor.unknowns import Unknown, values_of

ROWS_OF_STARTS = 8192  # of a log that starts are compared on
SPREAD = 3.0  # factor by which starts are drawn about the guess, either way
STEPS_OF_STARTS = 12  # that the better starts take
STEPS_OF_ALL, FEWEST_STARTS = 4, 4  # after which the worse half of the starts is given up, and how many go on at least
EVALUATIONS = 60  # of the last fit
DAMPING = Damping(first=1e-2, better=0.2, least=1e-10, most=1e8)
LONGEST = 2.0  # step of a coordinate: a factor of 7 of a number above 0
GAIN = 1e-6  # of the cost: a start that gains less has arrived


@dataclass(frozen=True)
class UnknownPlaces:
    """Unknowns of one stretch: for every direction of the response the number of its unknown, -1 where it is fixed."""

    parameters: np.ndarray
    offsets: np.ndarray
    delay: int
    start: np.ndarray
    fixed_start: np.ndarray


@dataclass(frozen=True, eq=False)
class DriveProblem:
    """Residuals of stretches as functions of coordinates z.

    Attributes:
        response: compiled.   unknowns: in the order of z.   stretches: measurements.   places: of the unknowns in each.
        sigma: of the measurement error, (signals · n,).   nominal: (k,) of parameters that are fixed.   delay: fixed [samples].
        prior: (2, k) middle and standard deviation of the coordinates before the log, infinite without; None: of none. They are
            the last residuals,  (z - middle) / deviation.
    """

    response: Response
    unknowns: tuple[Unknown, ...]
    stretches: tuple[Driven, ...]
    places: tuple[UnknownPlaces, ...]
    sigma: np.ndarray
    nominal: np.ndarray
    delay: float = 0.0
    prior: np.ndarray | None = None

    @cached_property
    def rows(self) -> int:
        """Number of residuals that are measurements."""
        return sum(target.size for target in self.targets)

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(k,) lower and upper bounds of z."""
        low, high = zip(*(each.bounds for each in self.unknowns), strict=True)
        return np.array(low), np.array(high)

    @cached_property
    def tables(self) -> list[np.ndarray]:
        """The response's table of each stretch."""
        return [self.response.table(each.inputs) for each in self.stretches]

    @cached_property
    def targets(self) -> list[np.ndarray]:
        """(rows, signals · n) measured, of each stretch."""
        return [np.concatenate([s.values[name] for name in self.response.signals], axis=1) for s in self.stretches]

    def predictions(self, z: np.ndarray) -> list[np.ndarray]:
        """(rows, signals · n) predicted for each stretch by coordinates (k,)."""
        return [self.responses(s, z[None])[0][0] for s in range(len(self.stretches))]

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """(m, k) derivatives of the residuals at coordinates (k,)."""
        return self.evaluate(z[None])[1][0]

    def evaluate(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (lanes, m) of coordinates (lanes, k), and their Jacobian (lanes, m, k)."""
        residuals, jacobians = [], []
        for s, stretch in enumerate(self.stretches):
            y, dy = self.responses(s, z)
            weight = stretch.weights / self.sigma
            residuals.append(((y - self.targets[s]) * weight).reshape(len(z), -1))
            jacobians.append((dy * weight[..., None]).reshape(len(z), -1, len(self.unknowns)))
        if self.prior is not None:
            known = np.isfinite(self.prior[1])
            residuals.append(((z - self.prior[0]) / self.prior[1])[:, known])
            slope = np.diag(1.0 / self.prior[1])[known]
            jacobians.append(np.broadcast_to(slope, (len(z), *slope.shape)))
        return np.concatenate(residuals, axis=1), np.concatenate(jacobians, axis=1)

    def responses(self, s: int, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signals (lanes, rows, signals · n) of stretch s at coordinates (lanes, k), and their derivatives by these (…, k)."""
        at, values, rates = self.places[s], *values_of(self.unknowns, z)
        lanes = len(z)

        def filled(numbers: np.ndarray, fixed: np.ndarray) -> np.ndarray:
            rows = np.tile(fixed, (lanes, 1))
            rows[:, numbers >= 0] = values[:, numbers[numbers >= 0]]
            return rows

        p = np.concatenate([filled(at.parameters, self.nominal), filled(at.offsets, np.zeros(len(at.offsets)))], axis=1)
        delay = np.full(lanes, self.delay) if at.delay < 0 else values[:, at.delay]
        carried = self.response.carried
        y, raw = self.response.run(self.tables[s], p, delay, filled(at.start, at.fixed_start) @ carried.T)
        states = slice(-len(carried), None)
        raw[..., states] = raw[..., states] @ carried  # a link's start position or speed is its motor's too
        numbers = np.concatenate([at.parameters, [at.delay], at.offsets, at.start])
        dy = np.zeros((*raw.shape[:-1], len(self.unknowns)))
        for direction in np.flatnonzero(numbers >= 0):
            dy[..., numbers[direction]] += raw[..., direction]
        return y, dy * rates[:, None, None, :]

    def part(self, rows: int) -> DriveProblem:
        """The problem reduced to a number of rows from the beginning."""
        stretches, places = [], []
        for stretch, at in zip(self.stretches, self.places, strict=True):
            count = min(len(stretch.t), rows)
            if count < 2:
                break
            rows -= count
            stretches.append(stretch.part(slice(count)))
            places.append(at)
        return replace(self, stretches=tuple(stretches), places=tuple(places))


def starts(problem: DriveProblem, centre: np.ndarray, count: int, seed: int) -> np.ndarray:
    """(count, k) start coordinates: the guess, then a Latin hypercube about it; offsets stay as guessed."""
    low, high = problem.bounds
    sample = 2.0 * qmc.LatinHypercube(len(centre), rng=np.random.default_rng(seed)).random(count - 1) - 1.0
    reach = np.zeros(len(centre))
    for k, each in enumerate(problem.unknowns):
        if each.logarithmic:
            reach[k] = np.log(SPREAD)
        elif each.name == "delay":
            reach[k] = 0.5 * (high[k] - low[k])
        elif not each.nuisance:
            reach[k] = 1.0
    drawn = centre + sample * reach
    for k, each in enumerate(problem.unknowns):
        if each.name == "delay":  # anywhere
            drawn[:, k] = low[k] + 0.5 * (sample[:, k] + 1.0) * (high[k] - low[k])
    return np.clip(np.concatenate([centre[None], drawn]), low, high)


def many_starts(problem: DriveProblem, z: np.ndarray, steps: int = STEPS_OF_STARTS) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (lanes, k) after some Levenberg-Marquardt steps, and costs (lanes,), of the starts that survived."""
    low, high = problem.bounds
    found = Descent.begin(lambda x: _finite(*problem.evaluate(x)), z, DAMPING.first)
    for trials in (STEPS_OF_ALL, steps - STEPS_OF_ALL):
        found = descended(
            lambda x: _finite(*problem.evaluate(x)), found, damping=DAMPING, trials=trials,
            move=lambda x, step: np.clip(x + np.clip(step, -LONGEST, LONGEST), low, high),
            ends=lambda gained, cost, _: gained <= GAIN * cost,
        )  # fmt: skip
        found = found.only(np.argsort(found.cost)[: max(len(found.x) // 2, FEWEST_STARTS)])
    return found.x, found.cost


LARGEST = 1e9  # of a scaled residual; a lane beyond is lost


def _finite(residuals: np.ndarray, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The residuals, with a large constant in lanes that diverge (infinite, not a number, or too large)."""
    lost = ~(np.abs(residuals) < LARGEST).all(axis=1) | ~(np.abs(jacobian) < LARGEST**1.5).all(axis=(1, 2))
    residuals[lost], jacobian[lost] = LARGEST, 0.0
    return residuals, jacobian


def refined(problem: DriveProblem, z: np.ndarray) -> np.ndarray:
    """Coordinates (k,) of the least squares, from a start, within the bounds."""
    low, high = problem.bounds
    last: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if not last or not np.array_equal(last[0][0], x):
            residuals, jacobian = _finite(*problem.evaluate(x[None]))
            last[:] = [(x.copy(), residuals[0], jacobian[0])]
        return last[0][1], last[0][2]

    inside = low + 1e-10 * (high - low), high - 1e-10 * (high - low)
    slope: Any = lambda x: at(x)[1]  # noqa: E731  (SciPy's own annotation says text alone)
    solution = least_squares(
        lambda x: at(x)[0], np.clip(z, *inside), slope, bounds=(low, high), x_scale="jac",
        ftol=1e-7, xtol=1e-7, gtol=1e-10, max_nfev=EVALUATIONS,
    )  # fmt: skip
    return solution.x

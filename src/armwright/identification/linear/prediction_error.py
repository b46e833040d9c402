"""Prediction-error estimates of ARX, OE and ARMAX models with exact gradients by filtering. [Ljung1999], sections 7.2 and 10.3.

    A(q) y(t) = B(q) u(t) + c + C(q) e(t),      A = 1 + a1 q⁻¹ + …,  B = b_d q⁻ᵈ + …,  C = 1 + c1 q⁻¹ + …

ARX has C = 1, OE has C = A (so that e is the error of the free simulation), ARMAX a C of its own. Rows before the first whose
past is known serve as past only. What their unknown errors e add to the rest is the response of 1/C to impulses in its first
rows: these initial states are eliminated from each stretch by an orthogonal projection [GolubPereyra1973].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy import signal

from armwright.errors import LogError
from armwright.fitting.covariance import covariance_of
from armwright.fitting.levenberg_marquardt import ROUNDS, USUAL, Descent, descended
from armwright.identification.linear.records import RecordedStretch
from armwright.identification.logs.findings import number_of

ONE = np.ones(1)
Structure = Literal["arx", "oe", "armax"]
FIRST = 5  # steps from every start, before the best goes on
INSIDE = 0.98  # largest pole of a start that was unstable
STEADY = 1e-3  # of a standard deviation: changes the sum of squares by a millionth of the errors' variance
ROUNDING = 1e-13  # relative decrease of the sum of squares that is rounding
Errors = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Polynomials:
    """Coefficients of powers of q⁻¹: a (na + 1,) and c (nc + 1,) begin with 1, b (delay + nb,) with `delay` zeros.

    Attributes:
        constant: c of the equation, in units of y.   delay: [samples].
    """

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    constant: float
    delay: int

    @property
    def past(self) -> int:
        """Rows of the past that the equation needs."""
        return max(len(self.a), len(self.b)) - 1


@dataclass(frozen=True)
class Orders:
    """Numbers of coefficients: na poles, nb zeros and one more, nc of the noise ("armax"); delay [samples]; constant: 0 or 1"""

    structure: Structure
    na: int
    nb: int
    nc: int
    delay: int
    constant: bool

    @property
    def count(self) -> int:
        """Number of parameters."""
        return self.na + self.nb + self.nc + self.constant

    @property
    def past(self) -> int:
        """Rows of the past that the equation needs."""
        return max(self.na, self.nb + self.delay - 1)

    def polynomials(self, theta: np.ndarray) -> Polynomials:
        """Polynomials of parameters [a, b, c, constant]."""
        a, b, c = (theta[begin:end] for begin, end in self._parts())
        a = np.concatenate([ONE, a])
        b = np.concatenate([np.zeros(self.delay), b])
        c = a if self.structure == "oe" else np.concatenate([ONE, c])
        return Polynomials(a, b, c, float(theta[-1]) if self.constant else 0.0, self.delay)

    def theta(self, model: Polynomials) -> np.ndarray:
        """Parameters of polynomials."""
        c = model.c[1:] if self.structure == "armax" else np.zeros(0)
        return np.concatenate([model.a[1:], model.b[self.delay :], c, [model.constant] * self.constant])

    def _parts(self) -> list[tuple[int, int]]:
        ends = np.cumsum([0, self.na, self.nb, self.nc])
        return list(pairwise(ends))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        letter = "f" if self.structure == "oe" else "a"
        names = [f"{letter}{k + 1}" for k in range(self.na)] + [f"b{k + self.delay}" for k in range(self.nb)]
        names += [f"c{k + 1}" for k in range(self.nc)]
        return (*names, *(["constant"] if self.constant else []))


@dataclass(frozen=True, eq=False)
class PredictionFit:
    """Result of `minimise`: parameters, errors and their Jacobian at the minimum.

    Attributes:
        theta: (k,).   errors: (rows,) of all stretches.   jacobian: (rows, k) ∂errors/∂theta, initial states projected out.
        converged: False where rounds ran out.   equations: rows less the initial states that were estimated.
    """

    orders: Orders
    theta: np.ndarray
    errors: np.ndarray
    jacobian: np.ndarray
    converged: bool
    equations: int

    @property
    def condition(self) -> float:
        """Ratio of the largest singular value of the Jacobian, its columns scaled to 1, to the smallest."""
        size = np.linalg.norm(self.jacobian, axis=0)
        if not (size > 0.0).all():
            return float("inf")
        values = np.linalg.svd(np.linalg.qr(self.jacobian / size, mode="r"), compute_uv=False)
        return float(values[0] / values[-1]) if values[-1] > 0.0 else float("inf")

    @property
    def cost(self) -> float:
        """Sum of squares of the errors."""
        return float(self.errors @ self.errors)

    @cached_property
    def covariance(self) -> np.ndarray:
        """(k, k) of the parameters, for errors of any colour."""
        return covariance_of([(self.jacobian[:, None], self.errors[:, None])])

    @property
    def white_covariance(self) -> np.ndarray:
        """(k, k) of the parameters, were the errors white: what criteria of orders presume."""
        size = np.maximum(np.linalg.norm(self.jacobian, axis=0), 1e-300)
        inverse = np.linalg.pinv((self.jacobian / size).T @ (self.jacobian / size), rcond=1e-14)
        return self.cost / max(self.equations - len(size), 1) * inverse / np.outer(size, size)

    @property
    def test_covariance(self) -> np.ndarray:
        """(k, k) by which a search for the order tests coefficients: errors of OE are whatever the plant's noise is."""
        return self.covariance if self.orders.structure == "oe" else self.white_covariance


def filtered(b: np.ndarray, a: np.ndarray, values: np.ndarray) -> np.ndarray:
    """B(q)/A(q) of columns (rows,) or (rows, k), from rest."""
    return np.asarray(signal.lfilter(b, a, values, axis=0))


def prediction_errors(model: Polynomials, each: RecordedStretch, skip: int, initial: bool) -> np.ndarray:
    """Errors e (rows - skip,) = [A y - B u - c] / C of one stretch, with the effect of its initial state removed.

    Args:
        each: u and y (rows, 1).   skip: rows that serve as past only, at least `model.past`.
        initial: True: initial states are estimated; False: errors before the first row are 0, the first rows taken as measured.
    """
    return _projected_errors(model, each, skip, initial)[0]


def _projected_errors(
    model: Polynomials, each: RecordedStretch, skip: int, initial: bool
) -> tuple[np.ndarray, np.ndarray | None]:
    """`prediction_errors`, and the basis that is projected out of them; None: none is."""
    driven = filtered(model.a, ONE, each.y[:, 0])[skip:] - filtered(model.b, ONE, each.u[:, 0])[skip:]
    e = filtered(ONE, model.c, driven - model.constant)
    base = _initial_basis(model.c, len(e)) if initial else None
    return (e if base is None else e - base @ (base.T @ e)), base


def _initial_basis(c: np.ndarray, rows: int) -> np.ndarray | None:
    """Orthonormal basis (rows, nc) of the responses of 1/C to initial states; None if C = 1."""
    order = len(c) - 1
    if order == 0 or rows == 0:
        return None
    impulse = np.zeros(rows)
    impulse[0] = 1.0
    return np.linalg.qr(_shifts(filtered(ONE, c, impulse), range(order)))[0]


def _shifts(column: np.ndarray, by: Sequence[int]) -> np.ndarray:
    """Columns that are `column` later by that many rows, zeros first."""
    result = np.zeros((len(column), len(by)))
    for k, shift in enumerate(by):
        result[shift:, k] = column[: len(column) - shift]
    return result


def _with_gradient(orders: Orders, theta: np.ndarray, each: RecordedStretch, skip: int, initial: bool):
    """Errors (rows,) and their derivatives (rows, k) of one stretch, initial states projected out. [Ljung1999], eq. (10.61)."""
    model = orders.polynomials(theta)
    e, base = _projected_errors(model, each, skip, initial)
    last = len(each.y)
    past = [each.y[skip - k : last - k, 0] for k in range(1, orders.na + 1)]
    columns = [filtered(ONE, model.c, column) for column in past]
    of_noise = _shifts(filtered(ONE, model.c, -e), range(1, len(model.c)))
    if orders.structure == "oe":
        columns = [column + of_noise[:, k] for k, column in enumerate(columns)]
    moved = range(orders.delay, orders.delay + orders.nb)
    columns += [-filtered(ONE, model.c, each.u[skip - k : last - k, 0]) for k in moved]
    columns += list(of_noise.T) if orders.structure == "armax" else []
    columns += [-filtered(ONE, model.c, np.ones(len(e)))] if orders.constant else []
    jacobian = np.stack(columns, axis=1)
    if base is not None:
        jacobian = jacobian - base @ (base.T @ jacobian)
    return e, jacobian


def errors_of(orders: Orders, theta: np.ndarray, stretches: Sequence[RecordedStretch], skip: int, initial: bool):
    """Errors (rows,) of all stretches and their derivatives (rows, k), initial states projected out.

    Raises:
        LogError: no stretch is long enough.
    """
    usable = [each for each in stretches if len(each.y) > skip + orders.na]
    if not usable:
        longest = max(len(each.y) for each in stretches)
        expected = f"more than {skip + orders.na}: a lower order, a smaller delay or longer runs"
        raise LogError(f"the longest stretch has {number_of(longest, 'row')}", place="order", expected=expected)
    parts = [_with_gradient(orders, theta, each, skip, initial) for each in usable]
    return np.concatenate([e for e, _ in parts]), np.concatenate([j for _, j in parts])


def radius(polynomial: np.ndarray) -> float:
    """Magnitude of the largest root in z."""
    return float(np.abs(np.roots(polynomial)).max(initial=0.0)) if len(polynomial) > 1 else 0.0


def stabilised(polynomial: np.ndarray, largest: float = INSIDE) -> np.ndarray:
    """Polynomial with roots beyond `largest` mirrored into the circle, and at most that large."""
    roots = np.roots(polynomial)
    size = np.abs(roots)
    mirrored = np.where(size > 1.0, roots / np.maximum(size, 1e-300) ** 2, roots)
    mirrored = mirrored * np.minimum(1.0, largest / np.maximum(np.abs(mirrored), 1e-300))
    return np.real(np.poly(mirrored)) if len(roots) else polynomial


def least_squares(orders: Orders, stretches: Sequence[RecordedStretch], skip: int) -> np.ndarray:
    """Parameters of the ARX model of these orders; of ARMAX orders its C is 1."""
    arx = replace(orders, structure="arx", nc=0)
    e, jacobian = errors_of(arx, np.zeros(arx.count), stretches, skip, initial=False)
    theta = -np.linalg.lstsq(jacobian, e, rcond=None)[0]
    return orders.theta(replace(arx.polynomials(theta), c=np.eye(1, orders.nc + 1)[0]))


def starts(orders: Orders, stretches: Sequence[RecordedStretch], skip: int, initial: bool) -> list[np.ndarray]:
    """Starting points: ARX, instrumental variables of its simulation, and Steiglitz-McBride. [Ljung1999], section 10.4."""
    found = [least_squares(orders, stretches, skip)]
    found.append(_instrumental(orders, stretches, skip, found[0]))
    if orders.structure == "oe":
        theta = found[0]
        for _ in range(6):
            f = stabilised(orders.polynomials(theta).a)
            whiter = [RecordedStretch(s.run, filtered(ONE, f, s.u), filtered(ONE, f, s.y)) for s in stretches]
            theta = least_squares(orders, whiter, skip)
            if orders.constant:
                theta[-1] *= f.sum()  # the constant column was not filtered
        found.append(theta)
    models = [orders.polynomials(theta) for theta in found if np.isfinite(theta).all()]
    kept = [replace(m, a=stabilised(m.a)) if radius(m.a) >= 1.0 else m for m in models]
    if orders.structure == "oe":
        kept = [replace(m, c=m.a) for m in kept]
    if orders.structure == "armax":  # white errors of the equation, and white errors of the simulation
        kept.append(
            replace(kept[0], c=np.resize(np.append(stabilised(kept[-1].a), np.zeros(orders.nc)), orders.nc + 1))
        )
    return [with_best_numerator(orders, stretches, skip, initial, each) for each in kept]


def _instrumental(orders: Orders, stretches: Sequence[RecordedStretch], skip: int, theta: np.ndarray) -> np.ndarray:
    """ARX parameters by instrumental variables: outputs simulated by the last estimate, which the noise cannot reach, twice."""
    arx = replace(orders, structure="arx", nc=0)
    model = orders.polynomials(theta)
    for _ in range(2):
        a = stabilised(model.a)
        level = model.constant / max(a.sum(), 1e-3)
        clean = [RecordedStretch(s.run, s.u, filtered(model.b, a, s.u) + level) for s in stretches]
        e, regressors = errors_of(arx, np.zeros(arx.count), stretches, skip, initial=False)
        _, instruments = errors_of(arx, np.zeros(arx.count), clean, skip, initial=False)
        solution = np.linalg.lstsq(instruments.T @ regressors, -instruments.T @ e, rcond=None)[0]
        model = replace(arx.polynomials(solution), c=np.eye(1, orders.nc + 1)[0])
    return orders.theta(model)


def minimise(
    orders: Orders,
    stretches: Sequence[RecordedStretch],
    skip: int,
    initial: bool,
    theta: np.ndarray,
    rounds: int = ROUNDS,
) -> PredictionFit:
    """Least squares of the errors from a starting point, by Levenberg-Marquardt; poles stay within the unit circle.

    Poles may pass the circle by 1/rows, so that an integrator lies inside: over all rows such a pole grows by no more than e.
    """
    e, jacobian = errors_of(orders, theta, stretches, skip, initial)
    freed = (len(orders.polynomials(theta).c) - 1) * sum(len(each.y) > skip + orders.na for each in stretches)
    equations = len(e) - (freed if initial else 0)
    if orders.structure == "arx":
        return PredictionFit(orders, theta, e, jacobian, True, equations)
    limit = largest_radius(stretches)

    def errors(trial: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        return errors_of(orders, trial, stretches, skip, initial) if admissible(orders, trial, limit) else None

    return PredictionFit(orders, *least_errors(errors, theta, (e, jacobian), rounds), equations)


def least_errors(
    errors: Callable[[np.ndarray], Errors | None], theta: np.ndarray, first: Errors, rounds: int = ROUNDS,
    steady: float = STEADY,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:  # fmt: skip
    """Parameters (k,) with the smallest sum of squares, errors (rows,) and derivatives (rows, k) there, True if converged.

    Args:
        errors: of parameters, with their derivatives; None where parameters are forbidden.
        theta: (k,) the start.   first: errors and derivatives there.   rounds: steps at most.
        steady: part of a standard deviation of the parameters: a step that moves them by no more ends the search.
    """
    refused = np.full_like(first[0], np.inf), first[1]

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        e, jacobian = errors(x[0]) or refused
        return e[None], jacobian[None]

    begun = Descent(theta[None], first[0][None], first[1][None], np.full(1, USUAL.first), np.zeros(1, dtype=bool))
    found = descended(
        evaluate, begun, rounds=rounds,
        ends=lambda gained, cost, moved: (gained <= ROUNDING * cost) | (moved <= steady**2 * cost / len(first[0])),
    )  # fmt: skip
    return found.x[0], found.errors[0], found.jacobian[0], bool(found.ended[0])


def largest_radius(stretches: Sequence[RecordedStretch]) -> float:
    """Largest magnitude of a pole: over all rows of a stretch it grows by no more than e."""
    return 1.0 + 1.0 / max(len(each.y) for each in stretches)


def admissible(orders: Orders, theta: np.ndarray, limit: float) -> bool:
    """True for finite parameters whose poles, and zeros of C, are no larger than `limit`."""
    model = orders.polynomials(theta)
    return bool(np.isfinite(theta).all()) and radius(model.a) <= limit and radius(model.c) <= limit


def estimate(
    orders: Orders,
    stretches: Sequence[RecordedStretch],
    skip: int,
    initial: bool,
    begin: np.ndarray | None = None,
    further: Sequence[np.ndarray] = (),
) -> PredictionFit:
    """The best fit from several starts: a few steps from each, then to convergence from the best.

    Args:
        begin: the only start, where it is known to be near.   further: starts beside those of `starts`.
    """
    if orders.structure == "arx":
        return minimise(orders, stretches, skip, initial, least_squares(orders, stretches, skip))
    candidates = [begin] if begin is not None else [*starts(orders, stretches, skip, initial), *further]
    fits = [minimise(orders, stretches, skip, initial, theta, FIRST) for theta in candidates]
    best = min(fits, key=lambda fit: fit.cost)
    return best if best.converged else minimise(orders, stretches, skip, initial, best.theta)


def with_best_numerator(
    orders: Orders, stretches: Sequence[RecordedStretch], skip: int, initial: bool, model: Polynomials
) -> np.ndarray:
    """Parameters with the B and constant that fit best beside a model's A and C: of these the errors are linear."""
    theta = orders.theta(model)
    e, jacobian = errors_of(orders, theta, stretches, skip, initial)
    linear = np.r_[orders.na : orders.na + orders.nb, len(theta) - orders.constant : len(theta)]
    theta[linear] -= np.linalg.lstsq(jacobian[:, linear], e, rcond=None)[0]
    return theta

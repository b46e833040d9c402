"""Models of continuous systems behind a zero-order hold and a dead time of whole samples. [AstromWittenmark1997]

The input is held from row to row. In time counted in samples the system

    (c_0 + c_1 s + … + c_m sᵐ) / (sⁿ + p_1 sⁿ⁻¹ + … + p_n)

is then B(q)/A(q) with n coefficients of B, which m + 1 numbers determine. A free B of as many coefficients, or one of fewer,
takes a lost zero or pole for a sample of delay; this form separates them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armwright.identification.linear.prediction_error import (
    Orders,
    PredictionFit,
    admissible,
    errors_of,
    largest_radius,
    least_errors,
)
from armwright.identification.linear.records import RecordedStretch
from armwright.matrix_exponential import matrix_exponential

MOST_POLES = 10  # of which coefficients in s still say something in doubles
NEAR = 1  # delays that are tried on either side of the best one
FASTEST = 0.02  # smallest pole in z of a start: one that is gone after a sample, or that is no pole of a held system
STEADY = 0.03  # of a standard deviation: moves criteria by 0.001
STEP = 1e-6  # of central differences, of numbers of the size of 1
GONE = 100.0  # sum of the poles' speeds: one of e^-100 a sample is gone, and the numbers for it overflow
SLOWEST = 1e-6  # pole in s of a start that integrates


@dataclass(frozen=True, eq=False)
class HeldFit:
    """Fit of a continuous system behind a zero-order hold.

    Attributes:
        fit: as one of A and a free B: its parameters, errors, derivatives.   zeros: m.   poles: (n,) p_1 … p_n.
    """

    fit: PredictionFit
    zeros: int
    poles: np.ndarray

    @property
    def count(self) -> int:
        """Number of parameters."""
        return self.fit.orders.count - self.fit.orders.nb + self.zeros + 1


def held_polynomials(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A (…, n + 1) and, as rows k, B (…, n, n) of sᵏ / (sⁿ + p_1 sⁿ⁻¹ + … + p_n) behind a hold, in powers of q⁻¹ from q⁻¹ on.

    Args:
        p: (…, n), time counted in samples.
    """
    n = p.shape[-1]
    companion = np.zeros((*p.shape[:-1], n + 1, n + 1))  # states sᵏ / P, then the held input
    companion[..., range(n - 1), range(1, n)] = 1.0
    companion[..., n - 1, :n] = -p[..., ::-1]
    companion[..., n - 1, n] = 1.0
    step = matrix_exponential(companion)
    matrix, response = step[..., :n, :n], step[..., :n, n]
    a, power = [np.ones(p.shape[:-1])], np.broadcast_to(np.eye(n), matrix.shape)
    for k in range(1, n + 1):  # Faddeev and LeVerrier
        product = matrix @ power
        a.append(-np.trace(product, axis1=-2, axis2=-1) / k)
        power = product + a[k][..., None, None] * np.eye(n)
    impulse = [response]
    for _ in range(n - 1):
        impulse.append((matrix @ impulse[-1][..., None])[..., 0])
    b = [sum(a[i][..., None] * impulse[j - i] for i in range(j + 1)) for j in range(n)]
    return np.stack(a, axis=-1), np.stack([np.broadcast_to(each, response.shape) for each in b], axis=-1)


def best_held(near: PredictionFit, stretches: Sequence[RecordedStretch], skip: int, initial: bool) -> HeldFit | None:
    """The held system with the fit's number of poles and the lowest BIC over numbers of zeros and delays; None if none fits.

    Args:
        near: a fit of A and B; its poles and its delay are where the search begins.   stretches, skip, initial: as of it.
    """
    if near.orders.na > MOST_POLES:
        return None
    delay, poles, found = near.orders.delay, continuous(near.orders.polynomials(near.theta).a), []
    for zeros in reversed(range(near.orders.na)):
        tried: dict[int, HeldFit] = {}
        while wanted := _untried(near.orders, delay, skip, tried):
            for each in wanted:
                start = tried[delay].poles if delay in tried else poles
                tried[each] = fit_held(replace(near.orders, delay=each), zeros, stretches, skip, initial, start)
            delay = min(tried, key=lambda each: tried[each].fit.cost)
        if not tried:
            return None
        found.append(tried[delay])
        poles = tried[delay].poles
    return min(found, key=bic_of)


def bic_of(held: HeldFit) -> float:
    """Bayes' information criterion N ln V + d ln N."""
    rows = held.fit.equations
    return rows * float(np.log(max(held.fit.cost / rows, 1e-300))) + held.count * float(np.log(rows))


def _untried(orders: Orders, delay: int, skip: int, tried: dict[int, HeldFit]) -> list[int]:
    """Delays near the best one that are to be fitted, the nearest first; later than `skip` allows none."""
    last = skip + 1 - orders.na
    near = sorted(range(max(delay - NEAR, 0), min(delay + NEAR, last) + 1), key=lambda each: abs(each - delay))
    return [each for each in near if each not in tried]


def fit_held(
    orders: Orders, zeros: int, stretches: Sequence[RecordedStretch], skip: int, initial: bool, poles: np.ndarray
) -> HeldFit:
    """Least-squares fit of a held system with a given delay.

    Args:
        orders: numbers of poles and of noise, delay; as many coefficients of B as poles are taken.
        zeros: m.   stretches, skip, initial: as of `minimise`.   poles: (n,) where p begins.
    """
    n, m = orders.na, zeros
    orders = replace(orders, nb=n)
    size = float(np.abs(np.roots(np.append(1.0, poles))).max()) ** np.arange(1, n + 1)  # of p: unknowns are near 1
    part = slice(n, 2 * n)
    rest = slice(2 * n, orders.count)  # coefficients of C and the constant, which are unknowns as they are
    zoom = size[::-1][: m + 1]  # of c, which is near the gain times this

    def parameters(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """θ and its derivatives (count, unknowns)."""
        moved = x[:n] + STEP * np.concatenate([np.zeros((1, n)), np.eye(n), -np.eye(n)])
        c = x[n : n + m + 1] * zoom
        slope = np.zeros((orders.count, len(x)))
        with np.errstate(over="ignore", invalid="ignore"):  # of poles that are far too fast; `errors` refuses them
            a, b = held_polynomials(moved * size)
            both = np.concatenate([a[:, 1:], c @ b[:, : m + 1]], axis=1)
            slope[: 2 * n, :n] = ((both[1 : n + 1] - both[n + 1 :]) / (2.0 * STEP)).T
        slope[part, n : n + m + 1] = b[0, : m + 1].T * zoom
        slope[rest, n + m + 1 :] = np.eye(orders.count - 2 * n)
        return np.concatenate([both[0], x[n + m + 1 :]]), slope

    limit = largest_radius(stretches)

    def errors(x: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        if not abs(x[0] * size[0]) < GONE:
            return None
        theta, slope = parameters(x)
        if not admissible(orders, theta, limit):
            return None
        e, jacobian = errors_of(orders, theta, stretches, skip, initial)
        return e, jacobian @ slope

    x = np.zeros(n + m + 1 + orders.count - 2 * n)
    x[:n] = poles / size
    theta, slope = parameters(x)
    e, jacobian = errors_of(orders, theta, stretches, skip, initial)
    # numerator and constant: errors are linear in them
    linear = np.r_[n : n + m + 1, len(x) - orders.constant : len(x)]
    x[linear] -= np.linalg.lstsq((jacobian @ slope)[:, linear], e, rcond=None)[0]
    theta, slope = parameters(x)
    e, jacobian = errors_of(orders, theta, stretches, skip, initial)
    x, e, _, converged = least_errors(errors, x, (e, jacobian @ slope), steady=STEADY)
    theta, _ = parameters(x)
    _, jacobian = errors_of(orders, theta, stretches, skip, initial)
    freed = (len(orders.polynomials(theta).c) - 1) * sum(len(each.y) > skip + n for each in stretches)
    return HeldFit(PredictionFit(orders, theta, e, jacobian, converged, len(e) - freed * initial), zeros, x[:n] * size)


def continuous(a: np.ndarray) -> np.ndarray:
    """p (n,) of the continuous system with the poles of A (n + 1,); poles that a hold cannot produce are moved."""
    z = np.asarray(np.roots(a), dtype=complex)
    z = np.where((np.abs(np.imag(z)) < 1e-12) & (np.real(z) < FASTEST), np.maximum(np.abs(z), FASTEST), z)
    s = np.log(np.where(np.abs(z) < FASTEST, FASTEST, z))
    s = np.where(np.real(s) > -SLOWEST, -SLOWEST + 1j * np.imag(s), s)
    return np.real(np.poly(s))[1:]

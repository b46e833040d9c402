"""Tests of a model's residuals: whiteness, correlation with the input, and feedback."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from armwright.identification.linear.covariance import MOST_PAST, autoregression
from armwright.identification.linear.prediction_error import (
    Orders,
    filtered,
    least_squares,
    prediction_errors,
)
from armwright.identification.linear.records import Stretch

LAGS = 20  # samples
LONG = 12  # coefficients of the model whose errors are white
PREDICTABLE = 1e-8  # of its variance: an input that its own past tells so well is made by a formula, not by feedback
STEP = 3.0  # deviations of the whitened input, beyond which it is a step of a reference
NORMAL_MEDIAN = 0.6745  # median of a normal variable's magnitude by its deviation
CERTAIN = 1e-3  # probability below which chance is no explanation


@dataclass(frozen=True)
class Test:
    """A statistic, χ² with `lags` degrees of freedom under the null hypothesis, and its p-value."""

    statistic: float
    lags: int
    probability: float


def whiteness(errors: np.ndarray, lags: int = LAGS) -> Test:
    """Ljung and Box's test of a signal's autocorrelation:  N (N + 2) Σ r(k)² / (N - k).

    Args:
        errors: (rows,).   lags: how many.
    """
    n = len(errors)
    lags = min(lags, max(n // 4, 1))
    e = errors - errors.mean()
    power = max(float(e @ e), 1e-300)
    r = np.array([e[k:] @ e[: n - k] for k in range(1, lags + 1)]) / power
    return _test(n * (n + 2) * float(np.sum(r**2 / (n - np.arange(1, lags + 1)))), lags)


def cross_correlation(errors: Sequence[np.ndarray], inputs: Sequence[np.ndarray], first: int, lags: int = LAGS) -> Test:
    """Test of correlation between errors and inputs `first` … rows later (negative: earlier), both whitened before.

    Args:
        errors, inputs: (rows,) of each stretch.   first: lag.   lags: how many.
    """
    e_model, _ = autoregression(np.concatenate(errors))
    u_model, left = autoregression(np.concatenate([u - np.mean(np.concatenate(inputs)) for u in inputs]))
    if left <= PREDICTABLE * np.var(np.concatenate(inputs)):
        return Test(0.0, lags, 1.0)
    pairs = [(_whitened(e, e_model), _whitened(u, u_model)) for e, u in zip(errors, inputs, strict=True)]
    size = np.sqrt(sum(e @ e for e, _ in pairs) * sum(w @ w for _, w in pairs)) + 1e-300
    n, total = sum(len(e) for e, _ in pairs), 0.0
    for lag in range(first, first + lags):
        product = sum(_lagged(e, w, lag) for e, w in pairs)
        total += n * float(product / size) ** 2
    return _test(total, lags)


def _lagged(e: np.ndarray, w: np.ndarray, lag: int) -> float:
    n = len(e)
    if abs(lag) >= n:
        return 0.0
    return float(e[: n - lag] @ w[lag:] if lag >= 0 else e[-lag:] @ w[: n + lag])


def _whitened(values: np.ndarray, model: np.ndarray) -> np.ndarray:
    white = filtered(model, np.ones(1), values - values.mean())[MOST_PAST:]  # as many rows for every model
    return white - white.mean() if len(white) else white


def feedback(stretches: Sequence[Stretch], delay: int) -> Test:
    """Test of feedback: correlation of the input with earlier disturbances of the output. [Ljung1999], section 16.6.

    The errors of a long ARX model are what came new into the output; without feedback no later input knows of them.

    Args:
        stretches: one input, one output.   delay: of the model [samples]; from 1 on an input at the same time counts as later.
    """
    rows = sum(len(each.y) for each in stretches)
    long = int(min(LONG, max(rows // 40, 1)))
    orders = Orders("arx", long, long, 0, max(delay, 1), constant=True)
    usable = [each for each in stretches if len(each.y) > orders.past + 2 * LAGS]
    if not usable:
        return Test(0.0, LAGS, 1.0)
    model = orders.polynomials(least_squares(orders, usable, orders.past))
    errors = [prediction_errors(model, each, orders.past, False) for each in usable]
    if sum(float(e @ e) for e in errors) <= 1e-18 * sum(float(each.y[:, 0] @ each.y[:, 0]) for each in usable):
        return Test(0.0, LAGS, 1.0)  # without noise there is nothing to feed back
    inputs = [each.u[orders.past :, 0] for each in usable]
    first = 0 if delay >= 1 else 1
    tests = cross_correlation(errors, inputs, first), _between_steps(errors, inputs, first)
    return min(tests, key=lambda each: each.probability)


def _between_steps(errors: Sequence[np.ndarray], inputs: Sequence[np.ndarray], first: int, lags: int = LAGS) -> Test:
    """As `cross_correlation`, of inputs from which the steps of a reference are cut.

    A step is so large in the whitened input that what the controller answers to disturbances is nothing beside it. Clipping
    colours the input again, so that the statistic is that of a regression of the errors on it:  cᵀ (WᵀW)⁻¹ c / σ².
    """
    e_model, _ = autoregression(np.concatenate(errors))
    mean = np.mean(np.concatenate(inputs))
    u_model, left = autoregression(np.concatenate([u - mean for u in inputs]))
    if left <= PREDICTABLE * np.var(np.concatenate(inputs)):
        return Test(0.0, lags, 1.0)
    pairs = [(_whitened(e, e_model), _whitened(u, u_model)) for e, u in zip(errors, inputs, strict=True)]
    clip = STEP * float(np.median(np.abs(np.concatenate([w for _, w in pairs])))) / NORMAL_MEDIAN
    blocks = []
    for e, w in pairs:
        if len(e) > first + lags:
            later = np.lib.stride_tricks.sliding_window_view(np.clip(w, -clip, clip)[first:], lags)
            blocks.append((e[: len(later)], later))
    if not blocks or clip == 0.0:
        return Test(0.0, lags, 1.0)
    e, later = (np.concatenate(each) for each in zip(*blocks, strict=True))
    later = later - later.mean(axis=0)
    solution, _, rank, _ = np.linalg.lstsq(later, e, rcond=1e-6)
    explained = later @ solution
    return _test(len(e) * float(explained @ explained) / max(float(e @ e), 1e-300), int(max(rank, 1)))


def _test(statistic: float, lags: int) -> Test:
    return Test(statistic, lags, float(chi2.sf(statistic, lags)))

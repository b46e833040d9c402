"""Tests of a model's residuals: whiteness, correlation with the input, and feedback."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armwright.fitting.autoregression import AKAIKE, autoregression, lagged_products
from armwright.fitting.residuals import ChiSquared, autocorrelation, lagged, ljung_box
from armwright.identification.linear.prediction_error import Orders, filtered, least_squares, prediction_errors
from armwright.identification.linear.records import RecordedStretch

LAGS = 20  # samples
MOST_PAST = 30  # rows of the past in an autoregression of errors or inputs
LONG = 30  # coefficients of the model whose errors are white, also where noise is not shaped by the plant
PREDICTABLE = 1e-8  # of its variance: an input that its own past tells so well is made by a formula, not by feedback
STEP = 3.0  # deviations of the whitened input, beyond which it is a step of a reference
NORMAL_MEDIAN = 0.6745  # median of a normal variable's magnitude by its deviation
CERTAIN = 1e-3  # probability below which chance is no explanation


Columns = Sequence[np.ndarray]  # (rows,) of each stretch


def whiteness(errors: np.ndarray, lags: int = LAGS) -> ChiSquared:
    """Ljung and Box's test of a signal's autocorrelation.

    Args:
        errors: (rows,).   lags: how many.
    """
    found = autocorrelation(errors, [slice(0, len(errors))], lags)
    return ChiSquared(0.0, lags, 1.0) if found is None else ljung_box(found, len(errors))


def cross_correlation(errors: Columns, inputs: Columns, first: int, lags: int = LAGS) -> ChiSquared:
    """Test of correlation between errors and inputs `first` … rows later (negative: earlier), both whitened before.

    Args:
        errors, inputs: (rows,) of each stretch.   first: lag.   lags: how many.
    """
    pairs = _whitened(errors, inputs)
    size = np.sqrt(sum(e @ e for e, _ in pairs) * sum(w @ w for _, w in pairs)) + 1e-300
    products = [sum(lagged(w, e, lag) for e, w in pairs) / size for lag in range(first, first + lags)]
    return ChiSquared.of(sum(len(e) for e, _ in pairs) * float(np.sum(np.square(products))), lags)


def _whitened(errors: Columns, inputs: Columns) -> list[tuple[np.ndarray, np.ndarray]]:
    """Errors and inputs (rows,) of each stretch through the autoregressions of both; none of an input made by a formula."""
    models = []
    for columns in (errors, inputs):
        values = np.concatenate(columns) - np.mean(np.concatenate(columns))
        most = min(MOST_PAST, len(values) // 20)
        r = lagged_products(values[:, None], most)[:, 0] / len(values)
        models.append(autoregression(r, len(values), AKAIKE))
    if models[1][1] <= PREDICTABLE * np.var(np.concatenate(inputs)):
        return []

    def white(values: np.ndarray, model: np.ndarray) -> np.ndarray:
        found = filtered(model, np.ones(1), values - values.mean())[MOST_PAST:]  # as many rows for every model
        return found - found.mean() if len(found) else found

    return [(white(e, models[0][0]), white(u, models[1][0])) for e, u in zip(errors, inputs, strict=True)]


def feedback(stretches: Sequence[RecordedStretch], delay: int) -> ChiSquared:
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
        return ChiSquared(0.0, LAGS, 1.0)
    model = orders.polynomials(least_squares(orders, usable, orders.past))
    errors = [prediction_errors(model, each, orders.past, False) for each in usable]
    if sum(float(e @ e) for e in errors) <= 1e-18 * sum(float(each.y[:, 0] @ each.y[:, 0]) for each in usable):
        return ChiSquared(0.0, LAGS, 1.0)  # without noise there is nothing to feed back
    inputs = [each.u[orders.past :, 0] for each in usable]
    first = 0 if delay >= 1 else 1
    tests = cross_correlation(errors, inputs, first), _between_steps(errors, inputs, first)
    return min(tests, key=lambda each: each.p)


def _between_steps(errors: Columns, inputs: Columns, first: int, lags: int = LAGS) -> ChiSquared:
    """As `cross_correlation`, of inputs from which the steps of a reference are cut.

    A step is so large in the whitened input that what the controller answers to disturbances is nothing beside it. Clipping
    colours the input again, so that the statistic is that of a regression of the errors on it:  cᵀ (WᵀW)⁻¹ c / σ².
    """
    pairs = _whitened(errors, inputs)
    clip = STEP * float(np.median(np.abs(np.concatenate([w for _, w in pairs])))) / NORMAL_MEDIAN if pairs else 0.0
    blocks = []
    for e, w in pairs:
        if len(e) > first + lags:
            later = np.lib.stride_tricks.sliding_window_view(np.clip(w, -clip, clip)[first:], lags)
            blocks.append((e[: len(later)], later))
    if not blocks or clip == 0.0:
        return ChiSquared(0.0, lags, 1.0)
    e, later = (np.concatenate(each) for each in zip(*blocks, strict=True))
    later = later - later.mean(axis=0)
    solution, _, rank, _ = np.linalg.lstsq(later, e, rcond=1e-6)
    explained = later @ solution
    return ChiSquared.of(len(e) * float(explained @ explained) / max(float(e @ e), 1e-300), int(max(rank, 1)))

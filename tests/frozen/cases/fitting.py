"""Least squares, their covariance, and measures and tests of residuals, on made signals."""

from __future__ import annotations

from functools import partial

import numpy as np

from armwright.fitting.autoregression import AKAIKE, autoregression, lagged_products
from armwright.fitting.covariance import correlated, covariance_of, inverse_of
from armwright.fitting.directions import directions, directions_of, gain, in_words, without
from armwright.fitting.levenberg_marquardt import Damping, Descent, descended
from armwright.fitting.measures import agreement, at_rest, fit_percent, periods_of_rest, r_squared, rms
from armwright.fitting.profile import profile_interval
from armwright.fitting.residuals import (
    autocorrelation,
    cross_correlation,
    lagged,
    ljung_box,
    parts_of,
    residual_spectrum,
)
from armwright.fitting.stretch import LogStretch
from armwright.fitting.triangular import triangle
from fitting.noise import ar1
from frozen.numbers import Case

NAMES = ["mass", "centre", "inertia", "friction", "offset"]
STARTS = np.array([[-1.2, 1.0], [2.0, -1.0], [0.0, 0.0], [2.9, 2.9]])
LOW, HIGH = np.array([-3.0, -3.0]), np.array([0.5, 3.0])


def noise(seed, *shape):
    return np.random.default_rng(seed).normal(size=shape)


def with_gaps(values, *rows):
    values = values.copy()
    values[list(rows)] = np.nan
    return values


def rosenbrock(x):
    """Errors (lanes, 2) and their derivatives; points beyond 3 are forbidden."""
    e = np.stack([10 * (x[:, 1] - x[:, 0] ** 2), 1 - x[:, 0]], axis=1)
    J = np.zeros((len(x), 2, 2))
    J[:, 0, 0], J[:, 0, 1], J[:, 1, 0] = -20 * x[:, 0], 10.0, -1.0
    e[np.abs(x).max(axis=1) > 3.0] = np.inf
    return e, J


def searched(trials=7, starts=STARTS, rounds=60, **options):
    """Where searches are after some steps: each of these is seen."""
    begun = Descent.begin(rosenbrock, starts)
    ends = options.pop("ends", lambda gained, cost, moved: moved <= 1e-6)
    found = descended(rosenbrock, begun, ends=ends, trials=trials, rounds=rounds, **options)
    return {"x": found.x, "damping": found.damping, "ended": found.ended, "cost": found.cost}


def scored(rho, rows=400, gaps=(), alone=False, columns=3):
    """Covariance of a fit of slow columns to correlated noise of two joints."""
    X = np.stack([ar1(0.9, rows, columns, seed=5), ar1(0.5, rows, columns, seed=6)], axis=1)
    e = ar1(rho, rows, 2, seed=7) * [1.0, 0.3]
    e[list(gaps), 0] = np.nan
    weights = np.array([1.0, 4.0])
    information = np.einsum("tji,j,tjk->ik", X, weights, X)
    bread = np.diag(1 / np.diag(information)) if alone else inverse_of(information)
    half = rows // 2
    found = correlated(lambda: [(X[:half], e[:half]), (X[half:], e[half:])], weights, bread, alone)
    return {"covariance": found.covariance, "orders": found.orders, "width": found.width, "freedom": found.freedom}


def with_prior():
    X, e = ar1(0.8, 300, 2, seed=8)[:, None], ar1(0.6, 300, 1, seed=9)
    blocks = [(X[:200], e[:200]), (X[200:], with_gaps(e[200:], 3, 4))]
    return {"without": covariance_of(blocks), "with": covariance_of(blocks, np.diag([50.0, 400.0]))}


def weakly():
    """Directions of a matrix whose third column is nearly the first, and of one with a column of zeros."""
    rows = noise(2, 40, 5)
    rows[:, 2] = rows[:, 0] + 1e-4 * rows[:, 2]
    rows[:, 4] = rows[:, 3] + 0.02 * rows[:, 4]
    empty = rows.copy()
    empty[:, 1] = 0.0
    found = {"few rows": directions(rows[:3]), "of information": directions_of(rows.T @ rows), "all": directions(rows)}
    found["with zeros"] = directions(empty)
    return {
        key: {
            "shown": np.array([each.shown for each in value]),
            "condition": np.array([each.condition for each in value]),
            "size": [np.abs(each.vector).round(6) for each in value if each.condition < 1e3],
            "names": [", ".join(each.names(NAMES)) for each in value],
            "words": [in_words(each, NAMES, "a longer log would do it") for each in value],
            "members": [each.members(0.9) for each in value],
        }
        for key, value in found.items()
    }


def measured(change=lambda y, p: (y, p)):
    y = 3.0 + ar1(0.9, 200, 1, seed=3)[:, 0]
    return agreement(*change(y, 0.8 * y + 0.1 + 0.2 * noise(4, 200)))


def resting():
    speed = np.concatenate([np.full(30, 0.004), np.full(19, 0.9), np.full(19, 0.0), [1.0], np.zeros(20), np.ones(8)])
    speed = np.concatenate([speed, -speed, np.full(120, 1e-3)])
    return {
        "speed": np.flatnonzero(at_rest(speed, 1.0, 100.0)),
        "fast": np.flatnonzero(at_rest(speed, 1.0, 1000.0)),
        "slow": np.flatnonzero(periods_of_rest(np.abs(speed) < 0.95, 100.0)),
        "all": periods_of_rest(np.ones(25, bool), 100.0).sum(),
    }


def lags_of(parts, rho=0.8):
    e, u = ar1(rho, 300, 1, seed=10)[:, 0], ar1(0.7, 300, 1, seed=11)[:, 0]
    both = e + 0.4 * np.roll(u, 3)
    found, cross = autocorrelation(e, parts), cross_correlation(both, u, parts)
    return {
        "own": found, "outside": found.outside, "largest": found.largest, "box": ljung_box(found, 300), "cross": cross,
        "cross outside": cross.outside, "cross largest": cross.largest,
    }  # fmt: skip


def no_lags():
    e, whole = ar1(0.5, 100, 1)[:, 0], [slice(0, 100)]
    return {
        "constant": autocorrelation(np.ones(100), whole), "few": autocorrelation(e, [slice(0, 3)]),
        "four": autocorrelation(e, [slice(0, 4), slice(50, 52)]), "none": autocorrelation(e, []),
        "not finite": cross_correlation(e, with_gaps(e, 4), whole), "still": cross_correlation(e, 0 * e, whole),
        "short spectrum": residual_spectrum(e, e, [slice(0, 15)], 10.0),
        "of no rows": residual_spectrum(e, e, [], 10.0),
    }  # fmt: skip


def spectra():
    e, y = ar1(0.5, 1500, 1)[:, 0], ar1(0.9, 1500, 1, seed=2)[:, 0]
    return [
        residual_spectrum(e, y, parts, 200.0)
        for parts in ([slice(0, 1500)], [slice(0, 700), slice(720, 1400)], [slice(0, 16), slice(20, 30)])
    ]


def profile(least=6, curve=0.3, highest=20, gap=2, begin=5):
    """Kept numbers of a parabola, and the order in which they are tried."""
    asked = []

    def fitted(number, last):
        asked.append((number, last))
        return number, curve * (number - least) ** 2 + (3.0 if number == 9 else 0.0)

    kept = profile_interval(fitted, (begin, 0), highest, 1.0, 0.95, gap)
    return {"kept": kept, "asked": np.array(asked)}


def orders(rho, price=None, rows=500):
    values = ar1(rho, rows, 2, seed=12)
    values[2:] += 0.5 * values[:-2]
    r = lagged_products(values, 6) / rows
    return {
        "products": r,
        "first": autoregression(r[:, 0], rows, price),
        "second": autoregression(r[:, 1], rows, price),
    }


CASES = {
    "triangle": lambda _: np.abs(triangle(noise(0, 700, 4))),
    "triangle below another": lambda _: np.abs(triangle(noise(1, 30, 3), np.triu(noise(2, 3, 3)))),
    "triangle of no columns": lambda _: triangle(np.zeros((5, 0))),
    "agreement": lambda _: measured(),
    "agreement with gaps": lambda _: measured(lambda y, p: (with_gaps(y, 1, 7), with_gaps(p, 2))),
    "agreement of a constant": lambda _: measured(lambda y, p: (0 * y + 2.0, p)),
    "agreement with a constant": lambda _: measured(lambda y, p: (y, 0 * p + 1.0)),
    "agreement of nothing": lambda _: measured(lambda y, p: (y * np.nan, p)),
    "measures by name": lambda _: measured().by_name,
    "shares": lambda _: {
        "r2": r_squared(np.array([1.0, 2.0]), np.array([4.0, 0.0])),
        "fit": fit_percent(1.0, np.array([4.0, 0.0])),
        "rms": rms(np.arange(6.0)),
        "rms of columns": rms(np.arange(6.0).reshape(2, 3), axis=0),
    },
    "rest": lambda _: resting(),
    "parts": lambda _: [[part.start, part.stop] for part in parts_of(np.array([1, 1, 2, 2, 2, 5, 1]))],
    "lags of one part": lambda _: lags_of([slice(0, 300)]),
    "lags of three parts": lambda _: lags_of([slice(0, 120), slice(125, 200), slice(201, 300)]),
    "lags of white errors": lambda _: lags_of([slice(0, 300)], 0.0),
    "no lags": lambda _: no_lags(),
    "lagged": lambda _: [lagged(np.arange(4.0), np.arange(4.0) ** 2, lag) for lag in range(-5, 6)],
    "spectra": lambda _: spectra(),
    "profile": lambda _: profile(),
    "profile from its least": lambda _: profile(begin=6),
    "profile of a gap of one": lambda _: profile(gap=1, curve=1.0),
    "profile to its ends": lambda _: profile(curve=0.02, highest=12),
    "autoregression": lambda _: orders(0.7),
    "autoregression of white noise": lambda _: orders(0.0, AKAIKE),
    "autoregression without a price": lambda _: orders(0.3, 0.0),
    "autoregression of one sine": lambda _: autoregression(np.cos(0.3 * np.arange(6)), 100.0),
    "autoregression of nothing": lambda _: autoregression(np.array([0.0, 0.0]), 10.0),
    "autoregression of impossible numbers": lambda _: autoregression(np.array([1.0, 0.5, -1.5, 0.2]), 50.0, 2.0),
    "covariance": lambda _: scored(0.5),
    "covariance of slow noise": lambda _: scored(0.98),
    "covariance of white noise": lambda _: scored(0.0, rows=1500, columns=1),
    "covariance with gaps": lambda _: scored(0.8, gaps=(3, 4, 5, 250)),
    "covariance of columns alone": lambda _: scored(0.8, alone=True),
    "covariance of few rows": lambda _: scored(0.3, rows=44),
    "covariance beside a prior": lambda _: with_prior(),
    "inverse": lambda _: inverse_of(np.array([[4.0, 1.0, 0.0], [1.0, 2e-6, 0.0], [0.0, 0.0, 0.0]])),
    "directions": Case(lambda _: weakly(), close=1e-4),
    "without": lambda _: {
        "usual": without(noise(3, 12, 2), noise(4, 12, 3)),
        "of small ones": without(noise(3, 12, 2), noise(4, 12, 3) * [1.0, 1e-3, 1.0], least=0.1),
        "twice the same": without(noise(3, 12, 2), noise(4, 12, 1) @ np.array([[1.0, 2.0]])),
    },
    "gain": lambda _: [
        gain(noise(5, 20, 3), noise(6, 10, 3)),
        gain(noise(5, 20, 3) * [1, 1, 0], noise(6, 10, 3)),
        gain(noise(5, 2, 3), noise(6, 2, 3) * 10.0),
        gain(noise(5, 9, 3) * [1, 0, 0], noise(6, 9, 3) * [1, 1, 0]),
    ],
    "stretch": lambda _: {"run": LogStretch("a").part(slice(0, 2)).run},
    "search": lambda _: searched(),
    "search by one step": lambda _: searched(trials=1),
    "search to its end": Case(lambda _: searched(trials=200), 1e-5, ("damping", "cost")),
    "search of few rounds": lambda _: searched(trials=200, rounds=3),
    "search that ends by what it gains": Case(
        lambda _: searched(60, ends=lambda gained, cost, moved: gained < 0.01 * cost), 1e-5, ("damping", "cost")
    ),
    "search with its own damping": lambda _: searched(9, damping=Damping(1e-2, 0.5, 2.0, 1e-4, 1e3)),
    "search on bounds": lambda _: searched(12, move=lambda x, step: np.clip(x + step, LOW, HIGH)),
    "search in a box": lambda _: searched(9, STARTS[[0, 2]], box=lambda x: (LOW - x, HIGH - x)),
    "search that compares": lambda _: searched(5, errors=lambda x: rosenbrock(x)[0]),
    "search that compares, to its end": Case(
        lambda _: searched(300, errors=lambda x: rosenbrock(x)[0]), 1e-4, ("damping", "cost")
    ),
    "search that compares two": partial(
        lambda damping, _: searched(4, errors=lambda x: rosenbrock(x)[0], damping=damping), Damping(tried=(0.5, 3.0))
    ),
}

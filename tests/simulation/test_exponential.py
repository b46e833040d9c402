"""Exponential rules: φ functions to the last digits, linear parts exactly, and the plain rule where nothing is stiff."""

from __future__ import annotations

from decimal import Decimal, getcontext

import numpy as np
import pytest

from armwright.simulation.exponential import phi, rk3_exponential, rk4_exponential
from armwright.simulation.integrators import rk3_step, rk4_step

NOTHING = np.zeros(0)


@pytest.mark.parametrize("y", [-1e-9, -0.01, -0.3, -0.4999, -0.5, -0.7, -3.0, -30.0, -700.0, -5000.0])
def test_phi_to_the_last_digits(y):
    """Against 60 digits; the quotients of the definition lose ten of them at y = -0.01."""
    getcontext().prec = 60
    value, expected = Decimal(y).exp(), []
    for factorial in (1, 1, 2):
        expected.append(float(value))
        value = (value - 1 / Decimal(factorial)) / Decimal(y)
    np.testing.assert_allclose(phi(y), [*expected, float(value)], rtol=1e-15)


def test_phi_at_nought():
    np.testing.assert_array_equal(phi(0.0), [1.0, 1.0, 0.5, 1 / 6])


def driven(rate, x, u):
    """z' = λ z + y², y' = -y + z: λ known."""
    y, z = x
    return np.array([-y + z, rate * z + y * y]), np.array([rate])


@pytest.mark.parametrize("rule", [rk3_exponential, rk4_exponential])
@pytest.mark.parametrize("rate", [-1.0, -50.0, -1e4, -1e7])
def test_what_is_linear_is_exact(rate, rule):
    """ż = λ z + c  in one step of any length, and at rest where λ z + c = 0."""

    def linear(x, u):
        return np.array([rate * x[0] + 3.0]), np.array([rate])

    z = rule(linear, [0], np.array([2.0]), NOTHING, 0.01)[0]
    end = -3.0 / rate
    assert z == pytest.approx(end + (2.0 - end) * np.exp(rate * 0.01), rel=1e-13)
    assert rule(linear, [0], np.array([end]), NOTHING, 0.01)[0] == pytest.approx(end, rel=1e-13)


@pytest.mark.parametrize(("rule", "plain_rule"), [(rk3_exponential, rk3_step), (rk4_exponential, rk4_step)])
def test_without_a_rate_it_is_the_plain_rule(rule, plain_rule):
    x = np.array([0.4, 0.9])
    split = rule(lambda x, u: (driven(-2.0, x, u)[0], np.zeros(1)), [1], x, NOTHING, 0.1)
    plain = plain_rule(lambda x, u: driven(-2.0, x, u)[0], x, NOTHING, 0.1)
    np.testing.assert_allclose(split, plain, rtol=1e-15)


@pytest.mark.parametrize(
    ("rule", "varies", "order"),
    [(rk3_exponential, False, 3), (rk3_exponential, True, 3), (rk4_exponential, False, 4), (rk4_exponential, True, 3)],
)
def test_order(rule, varies, order):
    """The error shrinks by 8 or 16 when the step is halved, λ constant or changing with the state."""

    def f(x, u):
        y, z = x
        rate = -20.0 * (1.0 + (y * y if varies else 0.0))
        return np.array([-y + z, rate * z + 20.0 * np.cos(3.0 * y)]), np.array([rate])

    def run(count):
        x = np.array([0.4, 0.9])
        for _ in range(count):
            x = rule(f, [1], x, NOTHING, 0.8 / count)
        return x

    reference = run(1024)
    errors = [np.abs(run(count) - reference).max() for count in (64, 128, 256)]
    found = np.log2([errors[0] / errors[1], errors[1] / errors[2]])
    assert order - 0.25 < found.min()
    assert found.max() < 4.4


@pytest.mark.parametrize("rule", [rk3_exponential, rk4_exponential])
def test_far_beyond_an_explicit_step(rule):
    """h λ = -10⁴: the fast part follows its steady value, and the slow one is as if it were always there."""
    x = np.array([0.5, 0.25 / 1e6])
    for _ in range(100):
        x = rule(lambda x, u: driven(-1e6, x, u), [1], x, NOTHING, 0.01)
    assert x[0] == pytest.approx(0.5 * np.exp(-1.0), rel=1e-6)
    assert x[1] == pytest.approx(x[0] ** 2 / 1e6, rel=1e-3)

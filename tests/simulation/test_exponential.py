"""Exponential rules: φ functions to the last digits, linear parts exactly, and the plain rule where nothing is stiff."""

from __future__ import annotations

from decimal import Decimal, getcontext

import numpy as np
import pytest

from armwright.simulation.integrate.exponential import (
    Split,
    phi,
    rk3_exponential,
    rk3_exponential_pair,
    rk4_exponential,
    semi_implicit_euler_exponential,
)
from armwright.simulation.integrate.integrators import rk3_step, rk4_step, semi_implicit_euler_step

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


RULES = [rk3_exponential, rk4_exponential, semi_implicit_euler_exponential]


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("rate", [-1.0, -50.0, -1e4, -1e7])
def test_what_is_linear_is_exact(rate, rule):
    """ż = λ z + c  in one step of any length, and at rest where λ z + c = 0."""

    def linear(x, u):
        return np.array([rate * x[0] + 3.0]), np.array([rate])

    split = Split.of(linear, [0])
    z = rule(split, np.array([2.0]), NOTHING, 0.01)[0]
    end = -3.0 / rate
    assert z == pytest.approx(end + (2.0 - end) * np.exp(rate * 0.01), rel=1e-13)
    assert rule(split, np.array([end]), NOTHING, 0.01)[0] == pytest.approx(end, rel=1e-13)


@pytest.mark.parametrize(("rule", "plain_rule"), [(rk3_exponential, rk3_step), (rk4_exponential, rk4_step)])
def test_without_a_rate_it_is_the_plain_rule(rule, plain_rule):
    x = np.array([0.4, 0.9])
    split = rule(Split.of(lambda x, u: (driven(-2.0, x, u)[0], np.zeros(1)), [1]), x, NOTHING, 0.1)
    plain = plain_rule(lambda x, u: driven(-2.0, x, u)[0], x, NOTHING, 0.1)
    np.testing.assert_allclose(split, plain, rtol=1e-15)


@pytest.mark.parametrize("rate", [0.0, -1e-7])
def test_the_error_without_a_rate_is_that_of_the_plain_pair(rate):
    """h/6 (k1 - 2 k2 + k3)."""
    x, h = np.array([0.4, 0.9]), 0.1

    def plain(x):
        return driven(rate, x, NOTHING)[0]

    k1 = plain(x)
    k2 = plain(x + 0.5 * h * k1)
    k3 = plain(x + 2.0 * h * k2 - h * k1)
    error = rk3_exponential_pair(Split.of(lambda x, u: driven(rate, x, u), [1]), x, NOTHING, h)[1]
    np.testing.assert_allclose(error, h / 6.0 * (k1 - 2.0 * k2 + k3), rtol=1e-6)


@pytest.mark.study
def test_semi_implicit_euler_without_a_rate_moves_what_is_fast_as_a_position():
    """A spring that is bent by its mass's speed: z and the position beside it go the same way, and the energy stays."""

    def spring(x, u):
        _, qd, z = x
        return np.array([qd, -25.0 * z, qd]), np.zeros(1)

    x, energies = np.array([1.0, 0.0, 1.0]), []
    for _ in range(20_000):
        x = semi_implicit_euler_exponential(Split.of(spring, [2]), x, NOTHING, 0.01, pairs=[(0, 1)])
        energies.append(0.5 * x[1] ** 2 + 12.5 * x[2] ** 2)
    np.testing.assert_allclose(x[0], x[2], rtol=1e-12)
    assert np.ptp(energies) < 12.5 * 0.01 * 5.0 * 1.1  # swings by h ω of itself, and does not grow
    plain = semi_implicit_euler_step(lambda x, u: spring(x, u)[0], x, NOTHING, 0.01, pairs=[(0, 1), (2, 1)])
    split = semi_implicit_euler_exponential(Split.of(spring, [2]), x, NOTHING, 0.01, pairs=[(0, 1)])
    np.testing.assert_allclose(split, plain, rtol=1e-14)


@pytest.mark.sample(1)
@pytest.mark.parametrize("varies", [False, True])
@pytest.mark.parametrize(
    ("rule", "order"), [(rk3_exponential, 3), (rk4_exponential, 4), (semi_implicit_euler_exponential, 1)]
)
def test_order(rule, varies, order):
    """The error shrinks by 2, 8 or 16 when the step is halved, λ constant or changing with the state."""

    def f(x, u):
        y, z = x
        rate = -20.0 * (1.0 + (y * y if varies else 0.0))
        return np.array([-y + z, rate * z + 20.0 * np.cos(3.0 * y)]), np.array([rate])

    def run(rule, count):
        x = np.array([0.4, 0.9])
        more = {"pairs": []} if rule is semi_implicit_euler_exponential else {}
        for _ in range(count):
            x = rule(Split.of(f, [1]), x, NOTHING, 0.8 / count, **more)
        return x

    reference = run(rk4_exponential, 2048)
    errors = [np.abs(run(rule, count) - reference).max() for count in (128, 256, 512)]
    found = np.log2([errors[0] / errors[1], errors[1] / errors[2]])
    assert order - 0.25 < found.min()
    assert found.max() < order + 0.6


@pytest.mark.parametrize("rule", RULES)
def test_far_beyond_an_explicit_step(rule):
    """h λ = -10⁴: the fast part follows its steady value, and the slow one is as if it were always there."""
    x, more = np.array([0.5, 0.25 / 1e6]), {"pairs": []} if rule is semi_implicit_euler_exponential else {}
    for _ in range(100):
        x = rule(Split.of(lambda x, u: driven(-1e6, x, u), [1]), x, NOTHING, 0.01, **more)
    order = 1 if rule is semi_implicit_euler_exponential else 3
    assert x[0] == pytest.approx(0.5 * np.exp(-1.0), rel=1e-6 if order > 1 else 6e-3)
    assert x[1] == pytest.approx(x[0] ** 2 / 1e6, rel=1e-3 if order > 1 else 3e-2)


@pytest.mark.parametrize("rule", RULES)
def test_a_rate_that_grows_from_nought_within_a_step_does_not_overshoot(rule):
    """A bristle at rest under a speed that rises to h λ = 40 within the step: z comes to its steady value from below."""

    def bristle(x, u):
        v, z = x
        rate = -2e4 * v
        return np.array([2e3, v + rate * z]), np.array([rate])

    more = {"pairs": []} if rule is semi_implicit_euler_exponential else {}
    x = np.zeros(2)
    for _ in range(20):
        x = rule(Split.of(bristle, [1]), x, NOTHING, 1e-3, **more)
        assert 0.0 < x[1] < 1.1 / 2e4

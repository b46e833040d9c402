"""Poles, zeros, frequencies and damping in closed form; their deviations by differences and by simulated truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import armwright as aw
from armwright.identification.linear.modes import matched, modes, root_gradient

T = 0.01


def quantities(a, covariance):
    roots, gradient = root_gradient(a)
    return {each.name: each for each in modes(roots, gradient, covariance, T)}


def test_a_second_order_system_in_closed_form():
    w, damping, lag = 2 * np.pi * 3.0, 0.2, 0.15
    continuous = np.polymul([1.0, 2 * damping * w, w**2], [lag, 1.0])
    a = cont2discrete(([w**2], continuous), T)[1]
    found = quantities(a, np.zeros((3, 3)))
    assert found["natural_frequency1"].value == pytest.approx(3.0)
    assert found["damping1"].value == pytest.approx(0.2)
    assert found["time_constant2"].value == pytest.approx(lag)


def test_deviations_are_those_of_differences():
    a = np.poly([0.9 * np.exp(0.3j), 0.9 * np.exp(-0.3j), 0.7]).real
    root = np.random.default_rng(0).standard_normal((3, 3))
    covariance = 1e-8 * root @ root.T
    found = quantities(a, covariance)
    assert set(found) == {"natural_frequency1", "damping1", "time_constant2"}
    for name, each in found.items():
        slope = np.zeros(3)
        for k in range(3):
            step = 1e-6 * np.eye(4)[k + 1]
            high, low = (quantities(a + sign * step, covariance)[name].value for sign in (1, -1))
            slope[k] = (high - low) / 2e-6
        assert each.std == pytest.approx(np.sqrt(slope @ covariance @ slope), rel=1e-5)


@pytest.mark.study
def test_zeros_and_their_deviations():
    a, b, deviations = np.poly([0.9, 0.6]), np.array([0.0, 0.2, -0.1]), []
    for seed in range(25):
        draw = np.random.default_rng(seed)
        u = draw.standard_normal(600)
        y = lfilter(b, a, u) + 0.05 * draw.standard_normal(600)
        model = aw.identification.fit_oe(u, y, T, order=2, delay=1)
        deviations.append((model.zeros[0].real - 0.5) / model.zero_std[0])
    assert 0.6 < np.std(deviations) < 1.5


def test_an_unstable_pole_is_no_time_constant():
    found = quantities(np.poly([1.01, -0.3]), np.zeros((2, 2)))
    assert {name: each.value for name, each in found.items()} == pytest.approx({"pole1": 1.01, "pole2": -0.3})


def test_poles_are_matched_to_the_nearest():
    poles = np.array([0.9, 0.5 + 0.1j, 0.5 - 0.1j])
    assert matched(poles, poles[[2, 0, 1]] + 0.01) == pytest.approx(poles + 0.01)

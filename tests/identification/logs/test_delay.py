"""Delays in fractions of a sample, and steps of quantised signals: found to known truth, with honest error bars."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from armwright.identification.logs.delay import delay_between
from armwright.identification.logs.quantisation import quantisation_step

T = np.arange(3000) * 0.01


def wave(t):
    return np.sin(2.0 * t) + 0.4 * np.sin(5.3 * t + 1.0) + 0.1 * np.sin(11.0 * t)


@given(
    samples=st.floats(-12, 12),
    gain=st.floats(0.1, 50).flatmap(lambda g: st.sampled_from([g, -g])),
    offset=st.floats(-5, 5),
)
def test_a_known_delay_and_gain(samples, gain, offset):
    found = delay_between(wave(T), gain * wave(T - 0.01 * samples) + offset)
    assert found is not None
    assert abs(found.samples - samples) < 0.03
    assert found.gain == pytest.approx(gain, rel=5e-3)
    assert found.correlation > 0.999


def test_the_interval_holds_the_truth():
    rng, hits, seeds = np.random.default_rng(1), 0, 100
    for _ in range(seeds):
        found = delay_between(wave(T), wave(T - 0.023) + 0.1 * rng.normal(size=len(T)))
        assert found is not None
        hits += abs(found.samples - 2.3) < 1.96 * found.std
    assert hits >= 85


@pytest.mark.parametrize("first", [np.zeros(500), np.full(500, 3.0)])
def test_what_does_not_change_has_no_delay(first):
    assert delay_between(first, np.sin(np.arange(500.0))) is None


@given(counts=st.integers(200, 50_000), scale=st.floats(1e-3, 1e3), offset=st.floats(-10, 10))
def test_counts_are_found(counts, scale, offset):
    step = scale * 2 * np.pi / counts
    values = np.round(scale * wave(T) / step) * step + scale * offset
    found = quantisation_step(values)
    if len(np.unique(values)) < len(values) // 2:
        assert found == pytest.approx(step, rel=1e-3)


def test_printed_digits_of_counts_are_still_counts():
    values = np.array([float(f"{value:.8f}") for value in np.round(20 * wave(T)) * 6.428571428])
    assert quantisation_step(values) == pytest.approx(6.428571428, rel=1e-6)


def test_a_continuous_signal_has_no_step():
    assert quantisation_step(wave(T)) is None
    assert quantisation_step(np.random.default_rng(0).normal(size=5000)) is None
    assert quantisation_step(np.array([1.0, 2.0, 1.0, 2.0])) is None

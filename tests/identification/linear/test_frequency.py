"""Frequency response against SciPy's spectra, closed forms, and its own intervals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

import armwright as aw
from armwright.errors import LogError

A, B = [1.0, -0.8], [0.0, 0.2]


def noisy(seed, rows, noise=0.05):
    draw = np.random.default_rng(seed)
    u = draw.standard_normal(rows)
    return u, signal.lfilter(B, A, u) + noise * draw.standard_normal(rows)


def truth(f, period):
    return signal.freqz(B, A, 2 * np.pi * f * period)[1]


def test_welch_is_scipys():
    u, y = noisy(0, 8192)
    got = aw.identification.frequency_response(u, y, 0.01, segment=512)
    settings = {"fs": 100.0, "window": "hann", "nperseg": 512, "detrend": "constant"}
    f, cross = signal.csd(u, y, **settings)
    power = signal.welch(u, **settings)[1]
    assert got.frequency == pytest.approx(f[1:])
    assert got.response[:-1] == pytest.approx((cross / power)[1:-1], rel=1e-9)
    assert got.coherence == pytest.approx(signal.coherence(u, y, **settings)[1][1:], rel=1e-6)


def test_intervals_of_both_methods_cover_the_truth():
    inside = {"welch": [], "periodic": []}
    for seed in range(20):
        u, y = noisy(seed, 4096)
        found = aw.identification.frequency_response(u, y, 1.0, segment=128)
        good = slice(2, -1)
        inside["welch"].append(np.abs(found.response - truth(found.frequency, 1.0))[good] < found.radius()[good])
        draw = np.random.default_rng(seed)
        u = np.tile(draw.choice([-1.0, 1.0], 256), 12)
        y = signal.lfilter(B, A, u) + 0.1 * draw.standard_normal(len(u))
        found = aw.identification.frequency_response(u, y, 1.0)
        assert "11 periods of 256 rows" in found.method
        inside["periodic"].append(np.abs(found.response - truth(found.frequency, 1.0)) < found.radius())
    for method, hits in inside.items():
        assert 0.92 <= np.mean(np.concatenate(hits)) <= 0.98, method


def test_a_multisine_is_exact_at_its_lines():
    t = np.arange(2000)
    lines = [3, 7, 20, 45]
    u = sum(np.cos(2 * np.pi * k * t / 200 + k) for k in lines)
    y = signal.lfilter(B, A, u) + 12.0
    found = aw.identification.frequency_response(u, y, 0.005)
    assert found.frequency == pytest.approx(np.array(lines) / 200 / 0.005)
    assert found.response == pytest.approx(truth(found.frequency, 0.005), abs=1e-9)
    assert found.coherence.min() > 1 - 1e-9


def test_bad_settings():
    u, y = noisy(0, 400)
    for options in ({"segment": 1000}, {"segment": 300}, {"segment": 2}, {"repeats": 200}, {"repeats": -1}):
        with pytest.raises(LogError) as caught:
            aw.identification.frequency_response(u, y, 1.0, **options)
        assert caught.value.place == next(iter(options))


def test_an_input_that_only_nearly_repeats_is_not_averaged_over_periods():
    draw = np.random.default_rng(5)
    u = np.tile(draw.choice([-1.0, 1.0], 256), 12)
    exact = aw.identification.frequency_response(u, signal.lfilter(B, A, u), 1.0)
    u = u + 0.05 * draw.standard_normal(len(u))
    near = aw.identification.frequency_response(u, signal.lfilter(B, A, u), 1.0)
    assert "periods" in exact.method
    assert "periods" not in near.method

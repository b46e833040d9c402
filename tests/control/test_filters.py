"""Filters of commands: SciPy's coefficients, the continuous response, and a resonance taken out of a loop."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.signal

import armwright as aw
from armwright.control.filters import sampled
from armwright.errors import ScenarioError
from armwright.interfaces import JointReference, Measurement
from physics.arms import arm

signal: Any = scipy.signal  # its stubs take one form of freqz
PERIOD = 1e-3


def in_z(kind):
    """Numerator and denominator in powers of 1/z."""
    powers = np.array([[1.0, -2.0, 1.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0]])  # of δ², δ and 1, times z⁻²
    return tuple(each @ powers for each in sampled(kind, PERIOD))


def test_a_low_pass_is_scipys_butterworth():
    for hz in (3.0, 80.0, 410.0):
        b, a = in_z(aw.LowPass(hz))
        expected = signal.butter(2, hz, fs=1.0 / PERIOD)
        np.testing.assert_allclose(b, expected[0], rtol=1e-9)
        np.testing.assert_allclose(a, expected[1], rtol=1e-9)


@pytest.mark.parametrize("kind", [aw.LowPass(60.0, 0.3), aw.Notch(45.0, 20.0), aw.Notch(200.0, 90.0, 0.25)])
def test_the_response_is_that_of_scipys_bilinear_rule(kind):
    """At the filter's own frequency, of the continuous filter itself."""
    w0 = 2.0 * np.pi * kind.hz
    num, den = (np.array(each) / w0 ** np.array([2.0, 1.0, 0.0]) for each in kind.polynomials)
    rate = w0 / (2.0 * np.tan(0.5 * w0 * PERIOD))  # prewarped
    frequencies = np.linspace(1.0, 499.0, 300)
    theirs = signal.freqz(*signal.bilinear(num, den, rate), frequencies, fs=1.0 / PERIOD)[1]
    ours = signal.freqz(*in_z(kind), frequencies, fs=1.0 / PERIOD)[1]
    np.testing.assert_allclose(ours, theirs, atol=1e-9)
    own = signal.freqz(*in_z(kind), [kind.hz], fs=1.0 / PERIOD)[1]
    np.testing.assert_allclose(own, signal.freqs(num, den, [w0])[1], atol=1e-9)


def test_the_width_of_a_notch():
    """Gain 1/√2 at the ends of its band of the continuous filter, its depth in the middle."""
    kind = aw.Notch(50.0, 10.0, 0.0)
    low, high = np.roots([1.0, 10.0, -2500.0]).max(), np.roots([1.0, -10.0, -2500.0]).max()
    assert high - low == pytest.approx(10.0)
    num, den = kind.polynomials
    at = np.abs(signal.freqs(num, den, np.array([low, 50.0, high]) / 50.0)[1])
    np.testing.assert_allclose(at, [np.sqrt(0.5), 0.0, np.sqrt(0.5)], atol=1e-12)
    assert np.abs(signal.freqz(*in_z(aw.Notch(50.0, 10.0, 0.2)), [50.0], fs=1000.0)[1]) == pytest.approx(0.2)


FILTERS = [aw.LowPass(90.0), aw.Notch(40.0, 15.0, 0.1)]


def test_commands_go_through_the_filters_of_scipy():
    model, rng = arm("two-link"), np.random.default_rng(2)
    commands, before = rng.normal(size=(200, 2)), np.array([0.4, -1.0])

    def play(t, r, y):
        return commands[round(t / PERIOD)]

    law = aw.Filtered(play, FILTERS).configure(model, PERIOD)
    r = JointReference(*np.zeros((3, 2)))
    y = Measurement(np.zeros(2), np.zeros(2), np.zeros(2), before)
    s, ours = law.init(model, y), []
    for k in range(200):
        u, s = law.step(k * PERIOD, r, y, s)
        ours.append(u)
    sections = np.array([np.concatenate(in_z(each)) for each in FILTERS])
    steady = signal.sosfilt_zi(sections)[:, :, None] * before
    expected = signal.sosfilt(sections, commands, axis=0, zi=steady)[0]
    np.testing.assert_allclose(ours, expected, atol=1e-12)


def test_a_slow_filter_in_single_precision():
    """A low-pass of 1 Hz at 1 kHz follows SciPy's in double within 1e-5; in powers of 1/z it is off by more than 1e-4."""
    kind, ours, plain = aw.LowPass(1.0), [], []
    u = np.float32(1.0)
    b, a = (np.asarray(each, dtype=np.float32) for each in sampled(kind, PERIOD))
    d, c = (np.asarray(each, dtype=np.float32) for each in in_z(kind))
    first = second = left = right = np.float32(0.0)
    for _ in range(3000):
        out = b[0] * u + first
        first, second = first + (b[1] * u - a[1] * out + second), second + a[2] * (u - out)
        ours.append(out)
        out = d[0] * u + left
        left, right = d[1] * u - c[1] * out + right, d[2] * u - c[2] * out
        plain.append(out)
    expected = signal.lfilter(*in_z(kind), np.ones(3000))
    assert np.abs(ours - expected).max() < 1e-5
    assert np.abs(plain - expected).max() > 1e-4


def test_it_runs_compiled_and_keeps_the_drives_within_what_anti_windup_expects():
    model = arm("two-link")
    gains: dict[str, Any] = {"kp": 30.0, "ki": 20.0, "kd": 6.0, "gravity": True}
    laws: list[Any] = [aw.JointPID(**gains), aw.JointPID(**gains, anti_windup="clamping")]
    runs = [
        aw.simulate(
            aw.Scenario(model, duration=0.4, loop=aw.Loop(aw.Filtered(law, FILTERS), np.array([0.3, -0.2]), PERIOD))
        )
        for law in laws
    ]
    assert [run.attrs["controller"] for run in runs] == ["compiled", "compiled"]
    np.testing.assert_allclose(runs[1].q.values, runs[0].q.values, atol=1e-9)
    assert np.abs(np.diff(runs[0].q.values, axis=0)).max() < 0.01


def test_a_scenario_file_names_filters(tmp_path):
    path = tmp_path / "a.scenario.toml"
    path.write_text(
        'robot = "two-link"\nduration_s = 0.02\n[loop]\nperiod_s = 0.001\n[loop.controller]\nkind = "filtered"\n'
        'inner = { kind = "joint_pid", kp = 30.0, kd = 6.0 }\n'
        '[[loop.controller.filters]]\nkind = "low_pass"\nhz = 90.0\n'
        '[[loop.controller.filters]]\nkind = "notch"\nhz = 40.0\nwidth_hz = 15.0\ndepth = 0.1\n'
    )
    scenario = aw.read_scenario(path)
    law: Any = scenario.loop and scenario.loop.controller
    assert list(law.filters) == FILTERS
    aw.simulate(scenario)
    text = path.read_text()
    for old, new, said in (
        ('"notch"', '"comb"', r"loop\.controller\.filters\[1\]\.kind = 'comb': unknown"),
        ("width_hz = 15.0", "", r"loop\.controller\.filters\[1\].*notch needs width_hz"),
        ("hz = 90.0", "hz = 900.0", "900.0: expected below half of the sampling rate, 500"),
        ("depth = 0.1", "depth = 1.5", "depth = 1.5: expected a gain from 0 to below 1"),
    ):
        path.write_text(text.replace(old, new))
        with pytest.raises(ScenarioError, match=said):
            aw.simulate(aw.read_scenario(path))


def test_no_filters_are_refused():
    with pytest.raises(ScenarioError, match=r"Filtered\.filters"):
        aw.Filtered(aw.JointPID(kp=1.0), [])

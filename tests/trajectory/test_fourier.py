"""Fourier series as references: closed forms, rest at both ends, whole periods, lanes, scenario files."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.trajectory import Fourier
from physics.arms import arm

SINE, COSINE = np.array([[0.3, -0.1, 0.05], [0.2, 0.1, 0.0]]), np.array([[0.1, 0.2, -0.1], [-0.2, 0.05, 0.02]])
CENTRE, PERIOD = np.array([0.4, -0.3]), 2.0


def test_values_are_those_of_the_series():
    t, w = 0.37, 2 * np.pi / PERIOD
    q, qd, qdd = Fourier(CENTRE, SINE, COSINE, PERIOD)(t)
    k = np.arange(1, 4)
    s, c = np.sin(k * w * t), np.cos(k * w * t)
    np.testing.assert_allclose(q, CENTRE + SINE @ s + COSINE @ c, rtol=1e-14)
    np.testing.assert_allclose(qd, SINE @ (k * w * c) - COSINE @ (k * w * s), rtol=1e-13)
    np.testing.assert_allclose(qdd, -SINE @ ((k * w) ** 2 * s) - COSINE @ ((k * w) ** 2 * c), rtol=1e-13)


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 6), st.integers(0, 2**31), st.floats(0.1, 100.0))
def test_a_motion_at_rest_begins_and_ends_at_rest(harmonics, seed, period):
    draw = np.random.default_rng(seed)
    series = Fourier.at_rest(
        CENTRE, draw.normal(size=(2, harmonics)), draw.normal(size=(2, harmonics)), period, cycles=2
    )
    w = 2 * np.pi * harmonics / period
    for t in (0.0, period, 2 * period):
        q, qd, qdd = series(t)
        np.testing.assert_allclose(q, CENTRE + np.asarray(series.cosine).sum(axis=1), atol=1e-10)
        np.testing.assert_allclose(qd / w, 0.0, atol=1e-10)
        np.testing.assert_allclose(qdd / w**2, 0.0, atol=1e-10)


def test_times_of_an_array_and_one_after_another_agree():
    series = Fourier(CENTRE, SINE, COSINE, PERIOD, time=0.5, cycles=2)
    times = np.array([-1.0, 0.2, 0.5, 1.3, 3.9, 4.5, 4.6, 9.0])
    for at, each in zip(zip(*series.at(times), strict=True), [series(t) for t in times], strict=True):
        for a, b in zip(at, each, strict=True):
            np.testing.assert_allclose(a, b, atol=1e-12)
    assert series.duration == 4.0
    np.testing.assert_array_equal(series(9.0)[1:], 0.0)
    np.testing.assert_allclose(series(9.0)[0], CENTRE + COSINE.sum(axis=1), atol=1e-12)


def test_lanes_have_their_own_coefficients():
    scales = np.array([0.5, 1.0])
    series = Fourier(CENTRE, aw.Batch(scales[:, None, None] * SINE), COSINE, PERIOD)
    loop = aw.Loop(controller=aw.ComputedTorque(kp=100.0, kd=20.0), reference=series, period=1e-3)
    run = aw.simulate(aw.Scenario(arm("two-link"), duration=0.2, start=CENTRE, loop=loop))
    for lane, scale in enumerate(scales):
        wanted = Fourier(CENTRE, scale * SINE, COSINE, PERIOD).at(run.time.values)[0]
        np.testing.assert_allclose(run.q_reference.isel(lane=lane).values, wanted, atol=1e-12)


FILE = """
robot = "two-link"
duration_s = 0.1

[loop]
period_s = 0.01
controller = {{ kind = "computed_torque", kp = 100.0, kd = 20.0 }}

[loop.reference]
kind = "fourier"
centre = [0.4, -0.3]
sine = {sine}
cosine = [[0.1, 0.2], [-0.2, 0.05]]
period = 2.0
"""


def test_a_scenario_file_takes_it(tmp_path):
    path = tmp_path / "a.scenario.toml"
    path.write_text(FILE.format(sine="[[0.3, -0.1], [0.2, 0.1]]"))
    run = aw.simulate(aw.read_scenario(path))
    wanted = Fourier(CENTRE, [[0.3, -0.1], [0.2, 0.1]], [[0.1, 0.2], [-0.2, 0.05]], 2.0).at(run.time.values)[0]
    np.testing.assert_allclose(run.q_reference.values, wanted, atol=1e-12)


def test_a_scenario_file_calls_the_cycle_a_period(tmp_path):
    path = tmp_path / "a.scenario.toml"
    text = FILE.format(sine="[[0.3, -0.1], [0.2, 0.1]]") + "periods = 3\n"
    path.write_text(text)
    scenario = aw.read_scenario(path)
    assert scenario.loop.reference.cycles == 3
    aw.write_scenario(scenario, tmp_path / "b.scenario.toml")
    assert {"period = 2.0", "periods = 3"} <= set((tmp_path / "b.scenario.toml").read_text().splitlines())
    for wrong, said in (("period = -2.0", r"loop\.reference\.period = -2"), ("cycle = 2.0", "no key of a fourier")):
        path.write_text(text.replace("period = 2.0", wrong))
        with pytest.raises(aw.ArmwrightError, match=said):
            aw.read_scenario(path)


@pytest.mark.parametrize("sine", ["[[0.3, -0.1], [0.2]]", "[0.3, 0.2]", '[["a", 0.1], [0.2, 0.1]]', "[[], []]"])
def test_a_scenario_file_with_other_coefficients_is_refused(tmp_path, sine):
    path = tmp_path / "a.scenario.toml"
    path.write_text(FILE.format(sine=sine))
    with pytest.raises(aw.ArmwrightError, match="sine"):
        aw.read_scenario(path)

"""Experiments of one motor: sequences against their theory, sizes within the guess's limits, files that simulations take."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import signal
from scipy.integrate import solve_ivp

import armwright as aw
from armwright.errors import ModelError, ScenarioError
from armwright.identification.experiments.motor import KINDS
from identification.motor_truth import TRUE, true_record
from physics.arms import arm
from raises_at import raises_at

GUESS = aw.identification.MotorGuess(gain=12.0, time_constant=0.05, most=12.0)


def test_the_prbs_is_a_maximum_length_sequence():
    found = aw.identification.motor_experiment("prbs", GUESS, seed=3)
    sign = np.sign(found.values)
    assert len(sign) == 2**9 - 1
    assert abs(sign.sum()) == 1
    correlation = np.fft.ifft(np.abs(np.fft.fft(sign)) ** 2).real  # periodic: N, then -1 everywhere
    np.testing.assert_allclose(correlation, [511.0] + [-1.0] * 510, atol=1e-9)
    reference = 2.0 * signal.max_len_seq(9)[0] - 1.0
    assert any(np.array_equal(sign, np.roll(reference, k)) for k in range(511))
    assert found.crest == pytest.approx(1.0)


def test_the_multisine_has_a_low_crest_and_no_other_frequencies():
    found = aw.identification.motor_experiment("multisine", GUESS, period=1e-6)
    amplitudes = np.abs(np.fft.rfft(found.values))
    lines = amplitudes > 1e-9 * amplitudes.max()
    assert amplitudes[lines].min() == pytest.approx(amplitudes.max(), rel=1e-9)
    frequencies = np.fft.rfftfreq(len(found.values), found.period)[lines]
    assert frequencies[0] == pytest.approx(0.1 * GUESS.corner_hz, rel=1e-3)
    assert frequencies[-1] == pytest.approx(10.0 * GUESS.corner_hz, rel=1e-3)
    draw = np.random.default_rng(0)
    spectrum = np.zeros(len(amplitudes), dtype=complex)
    crests = []
    for _ in range(200):
        spectrum[lines] = np.exp(2j * np.pi * draw.uniform(size=lines.sum()))
        values = np.fft.irfft(spectrum, len(found.values))
        crests.append(np.abs(values).max() / values.std())
    assert found.crest < min(crests)
    assert found.crest < 2.0


def test_the_chirp_sweeps_its_band():
    found = aw.identification.motor_experiment("chirp", GUESS)
    crossings = np.flatnonzero(np.diff(np.sign(found.values)) != 0) * found.period
    halves = np.diff(crossings)
    assert 5.0 / halves[-10:].sum() == pytest.approx(10 * GUESS.corner_hz, rel=0.1)
    turns = 0.1 * GUESS.corner_hz * found.duration * 99.0 / np.log(100.0)  # the integral of its frequency
    assert len(crossings) == pytest.approx(2.0 * turns, abs=2)


@pytest.mark.parametrize("kind", KINDS)
def test_the_predicted_response_is_the_differential_equation(kind):
    guess = replace(GUESS, dead_zone=0.8)
    found = aw.identification.motor_experiment(kind, guess)
    count = min(len(found.values), 40)
    values = found.values[:count]
    speed, angle = guess.response(values, found.period)

    def slope(t, x):
        u = values[min(int(t / found.period), count - 1)]
        return [(guess.gain * np.sign(u) * max(abs(u) - 0.8, 0.0) - x[0]) / guess.time_constant, x[0]]

    end = count * found.period
    truth = solve_ivp(slope, (0, end), [0, 0], max_step=found.period / 8, rtol=1e-8, atol=1e-10).y[:, -1]
    np.testing.assert_allclose([speed[-1], angle[-1]], truth, rtol=2e-2, atol=2e-2 * np.abs(angle).max())


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(sorted(KINDS)), st.floats(0.1, 100.0), st.floats(2e-3, 1.0), st.floats(0.0, 0.3), st.floats(0.5, 50.0),
    st.floats(0.5, 50.0),
)  # fmt: skip
def test_limits_hold_by_the_guess_or_it_is_refused(kind, gain, time_constant, zone, speed, travel):
    guess = aw.identification.MotorGuess(gain, time_constant, 10.0, dead_zone=10.0 * zone, speed=speed, travel=travel)
    try:
        found = aw.identification.motor_experiment(kind, guess)
    except ScenarioError as error:
        if "leaves no room" not in error.what:
            raise
        return
    rate, angle = guess.response(found.values, found.period)
    assert np.abs(found.values).max() <= 10.0
    assert np.abs(rate).max() <= speed
    assert np.abs(angle).max() <= travel
    assert np.abs(found.values).max() >= 20.0 * zone


def test_a_refusal_says_how_much_it_takes():
    narrow = replace(GUESS, travel=0.05)
    with raises_at(ScenarioError, "MotorGuess.travel", r"\d rad .* 0\.6 V") as caught:
        aw.identification.motor_experiment("step", narrow)
    needed = float(caught.value.expected.split()[0])
    aw.identification.motor_experiment("step", replace(narrow, travel=1.001 * needed))


def test_a_simulation_and_a_file_take_it(tmp_path):
    model = arm("cmu-dd").with_locked(dict.fromkeys(arm("cmu-dd").names[1:], 0.0))
    guess = aw.identification.MotorGuess.of(model)
    found = aw.identification.motor_experiment("step", guess)
    run = aw.simulate(aw.Scenario(model, duration=found.period, command=found.schedule))
    assert np.isfinite(run.q.values).all()
    found.save(tmp_path / "step.csv")
    again = aw.simulation.read_schedule(tmp_path / "step.csv", model.names, ["V"])
    for t in np.linspace(0.0, found.duration, 50):
        np.testing.assert_allclose(again.at(t), found.schedule.at(t))


def test_the_guess_of_a_record_is_the_motor_of_the_simulation():
    names = arm("cmu-dd").names
    model = arm("cmu-dd").with_locked(dict.fromkeys(names[1:], 0.0)).replace(friction=None, gravity=(0.0, 0.0, 0.0))
    guess = replace(aw.identification.MotorGuess.of(model), dead_zone=0.0)
    run = aw.simulate(aw.Scenario(model, duration=0.1, command=[5.0], solver=aw.Solver(integrator="rk4", step=1e-4)))
    speed = guess.gain * 5.0 * (1.0 - np.exp(-run.time.values / guess.time_constant))
    np.testing.assert_allclose(run.qd.values[:, 0], speed, rtol=1e-4, atol=1e-6)


def test_a_record_without_a_largest_voltage_gets_one(tmp_path):
    """As `identify motor` writes it of a bench: the limit of its supply is no part of a log."""
    model = aw.load(true_record(tmp_path))
    with raises_at(ModelError, "joint 'motor'", r"largest voltage.*--max-command"):
        aw.identification.MotorGuess.of(model)
    guess = aw.identification.MotorGuess.of(model, most=9.0)
    assert guess.most == 9.0
    assert guess.gain == pytest.approx(1 / TRUE["Kt"])
    assert guess.dead_zone == pytest.approx(TRUE["R"] * TRUE["coulomb"] / TRUE["Kt"])


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: aw.identification.MotorGuess(0.0, 0.05, 12.0), r"MotorGuess\.gain = 0.0: expected a number above 0"),
        (lambda: aw.identification.MotorGuess(1.0, np.nan, 12.0), r"MotorGuess\.time_constant"),
        (lambda: aw.identification.MotorGuess(1.0, 0.1, 12.0, dead_zone=7.0), "dead zone"),
        (
            lambda: aw.identification.motor_experiment("prbs", GUESS, period=1.0),
            "period = 1.0: .*time above 0",
        ),
        (lambda: aw.identification.motor_experiment("prbs9", GUESS), r"\bprbs\b"),
        (lambda: aw.identification.MotorGuess.of(arm("two-link")), "resistance, no torque"),
        (lambda: aw.identification.MotorGuess.of(arm("cmu-dd"), "joint9"), "joint = 'joint9'"),
    ],
)
def test_bad_guesses_are_refused(make, said):
    with pytest.raises((ScenarioError, ModelError), match=said):
        make()

"""Under feedback least squares is biased; instruments and output error of a simulated loop are not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import sosfiltfilt

import armwright as aw
from armwright.errors import IdentificationError
from armwright.identification.arm.base import base_parameters
from armwright.identification.arm.closed_loop import Feedback, fit_closed_loop, simulated_loop
from armwright.identification.arm.equations import equations_of
from armwright.identification.arm.fit import fit_arm
from armwright.identification.arm.samples import Samples
from armwright.identification.arm.torque_model import torque_model
from armwright.identification.logs.preparation import low_pass
from raises_at import raises_at

KP, KD, PERIOD, SECONDS = np.array([900.0, 300.0]), np.array([120.0, 40.0]), 0.005, 4.0
CUTOFF, LANES, NOISE = 20.0, 8, 3e-4  # Hz, seeds, rad
SINES = aw.trajectories.Fourier(
    (0.3, -0.2), [[0.5, 0.25, -0.1], [-0.4, 0.5, 0.2]], [[0.1, -0.3, 0.1], [0.3, 0.1, -0.2]], SECONDS
)


def reference(t: np.ndarray):
    """q, q̇, q̈ of the reference at times t."""
    w = 2 * np.pi / SECONDS * np.arange(1, 4)
    a, b = np.array(SINES.sine).T, np.array(SINES.cosine).T
    s, c = np.sin(w * t[:, None]), np.cos(w * t[:, None])
    return SINES.centre + s @ a + c @ b, (w * c) @ a - (w * s) @ b, -(w**2 * s) @ a - (w**2 * c) @ b


def loop_of(noise: float) -> aw.Loop:
    sensors = aw.Sensors(position_noise=noise, velocity="difference" if noise else "exact")
    return aw.Loop(controller=aw.JointPID(kp=KP, kd=KD), reference=SINES, period=PERIOD, sensors=sensors)


@pytest.fixture(scope="module")
def arm():
    return aw.load("two-link")


@pytest.fixture(scope="module")
def start():
    return aw.Start(*(each[0] for each in reference(np.zeros(1))[:2]))


@pytest.fixture(scope="module")
def model(arm):
    return torque_model(arm, friction=(), lacks=("rotors",))


@pytest.fixture(scope="module")
def run(arm, start):
    """Runs of the simulator's loop, each lane with its own noise of the encoders."""
    scenario = aw.Scenario(arm, duration=SECONDS, loop=loop_of(NOISE), start=start, lanes=range(LANES), seed=3)
    return aw.simulate(scenario)


def samples_of_lane(run, lane: int, centred: bool) -> Samples:
    """Low-passed rows; a torque that is held over a tick counts at the tick's middle, or `centred` as the mean of two."""
    t, q, tau = run["time"].values, run["q_measured"].values[lane], run["tau"].values[lane]
    tau = 0.5 * (tau + np.concatenate([tau[:1], tau[:-1]])) if centred else tau
    q, tau = (sosfiltfilt(low_pass(4, CUTOFF, 1 / PERIOD), each, axis=0) for each in (q, tau))
    qd = np.gradient(q, PERIOD, axis=0)
    kept = slice(20, -20, 2)
    return Samples("run", 0, t[kept], q[kept], qd[kept], np.gradient(qd, PERIOD, axis=0)[kept], tau[kept])


def test_the_simulated_loop_is_that_of_the_simulator(arm, start, model):
    run = aw.simulate(aw.Scenario(arm, duration=1.0, loop=loop_of(0.0), start=start))
    truth = np.nan_to_num(model.prior)
    times, q, qd, *_ = simulated_loop(model, truth, Feedback(reference, KP, KD, PERIOD), 0.0, 1.0)
    np.testing.assert_allclose(times, run["time"].values, atol=1e-12)
    np.testing.assert_allclose(q, run["q"].values, atol=1e-6)
    np.testing.assert_allclose(qd, run["qd"].values, atol=1e-5)


@pytest.mark.study
def test_instruments_are_unbiased_where_least_squares_is_biased(run, model):
    base = base_parameters(model)
    truth, feedback = (
        base.of(np.nan_to_num(model.prior)),
        Feedback(reference, KP, KD, PERIOD, begin=0.0, speed="difference", cutoff=CUTOFF),
    )
    plain, fits = [], []
    for lane in range(LANES):
        samples = samples_of_lane(run, lane, centred=True)
        plain.append(fit_arm(equations_of([samples], model), base).values)
        fits.append(fit_closed_loop([samples], model, base, feedback, plain[-1]))
    instruments, size = np.array([fit.values for fit in fits]), np.maximum(np.abs(truth), 1.0)
    bias, spread = plain - truth, np.std(plain, axis=0, ddof=1) / np.sqrt(LANES)
    assert np.abs(bias.mean(axis=0) / size).max() > 0.05
    assert np.abs(bias.mean(axis=0) / spread).max() > 10
    error = instruments - truth
    assert np.abs(error.mean(axis=0) / size).max() < 0.003
    assert np.abs(error.mean(axis=0) / (error.std(axis=0, ddof=1) / np.sqrt(LANES))).max() < 5
    inside = np.abs(error) < 1.96 * np.array([fit.std for fit in fits])
    assert inside.mean() > 0.9
    assert all(fit.settled for fit in fits)


def test_torques_alone_tell_the_parameters(run, model):
    base = base_parameters(model)
    truth, feedback = (
        base.of(np.nan_to_num(model.prior)),
        Feedback(reference, KP, KD, PERIOD, begin=0.0, speed="difference", cutoff=CUTOFF),
    )
    for lane in range(2):
        samples = samples_of_lane(run, lane, centred=False)
        blind = Samples("run", 0, samples.t, *(np.nan * samples.q,) * 3, samples.tau)  # positions are not read
        fit = fit_closed_loop([blind], model, base, feedback, 1.3 * truth, "didim")
        assert fit.settled
        assert (np.abs(fit.values - truth) < 1.96 * fit.std).all()
        np.testing.assert_allclose(fit.values, truth, atol=0.03)


@pytest.mark.study
def test_positions_alone_tell_the_parameters(run, model):
    """CLOE never reads a torque; where least squares is biased by 5 % and more, it is within its own intervals."""
    base = base_parameters(model)
    truth = base.of(np.nan_to_num(model.prior))
    feedback = Feedback(reference, KP, KD, PERIOD, begin=0.0, speed="difference", cutoff=CUTOFF)
    for lane in range(2):
        samples = samples_of_lane(run, lane, centred=False)
        blind = Samples("run", 0, samples.t, samples.q, *(np.nan * samples.q,) * 3)
        fit = fit_closed_loop([blind], model, base, feedback, 1.2 * truth, "cloe")
        assert fit.settled
        assert (np.abs(fit.values - truth) < 3 * fit.std).all()
        assert (np.abs(fit.values - truth) < 0.1 * np.maximum(np.abs(truth), 1.0)).all()


def test_lanes_of_a_simulated_loop_are_single_loops(model):
    truth = np.nan_to_num(model.prior)
    lanes = np.array([truth, 1.2 * truth])
    many = simulated_loop(model, lanes, Feedback(reference, KP, KD, PERIOD), 0.0, 0.2)
    for k, parameters in enumerate(lanes):
        single = simulated_loop(model, parameters, Feedback(reference, KP, KD, PERIOD), 0.0, 0.2)
        for mine, one in zip(many[1:], single[1:], strict=True):
            np.testing.assert_allclose(mine[:, k], one, rtol=1e-9, atol=1e-12)


def test_bad_input_is_refused(run, model):
    base, feedback = base_parameters(model), Feedback(reference, KP, KD, PERIOD)
    samples = samples_of_lane(run, 0, centred=True)
    with pytest.raises(IdentificationError, match="method"):
        fit_closed_loop([samples], model, base, feedback, np.ones(len(base)), "magic")
    with raises_at(IdentificationError, "log", "more than 6", value=2):
        fit_closed_loop([samples.part(slice(0, 2))], model, base, feedback, np.ones(len(base)))
    with pytest.raises(IdentificationError, match="diverges"):
        fit_closed_loop([samples], model, base, Feedback(reference, -KP, -KD, PERIOD), np.ones(len(base)))

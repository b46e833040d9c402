"""Least squares from factors against dense solutions and known truth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import armwright as aw
from armwright.errors import IdentificationError
from armwright.identification.arm.base import base_parameters
from armwright.identification.arm.equations import equations_of
from armwright.identification.arm.fit import cross_validated, fit_arm, fit_robust, with_correlation
from armwright.identification.arm.torque_model import torque_model
from identification.arm.test_equations import samples
from raises_at import raises_at


@pytest.fixture(scope="module")
def model():
    return torque_model(aw.load("lwa4p"))


@pytest.fixture(scope="module")
def base(model):
    return base_parameters(model)


def test_torques_without_noise_give_the_record_back(model, base):
    fit = fit_arm(equations_of([samples(model.arm)], model), base)
    np.testing.assert_allclose(fit.values, base.of(np.nan_to_num(model.prior)), atol=1e-8)
    np.testing.assert_allclose(fit.r2, 1.0)


def test_weighted_fit_is_the_dense_one(model, base):
    data = samples(model.arm, noise=1.0)
    data.tau[:, 1] += 5 * np.random.default_rng(5).normal(size=len(data.t))
    fit = fit_arm(equations_of([data], model), base, "wls")
    values = model.rows(data.q, data.qd, data.qdd)[:, :, base.independent]
    root = np.sqrt(fit.weights)
    dense = (values * root[:, None]).reshape(-1, len(base))
    expected = np.linalg.lstsq(dense, (data.tau * root).ravel(), rcond=None)[0]
    np.testing.assert_allclose(fit.values, expected, rtol=1e-7, atol=1e-9)
    assert fit.weights[1] < 0.1 * fit.weights[0]
    size = np.linalg.norm(dense, axis=0)
    assert np.isclose(fit.condition, np.linalg.cond(dense / size), rtol=1e-6)
    white = np.linalg.inv(dense.T @ dense)
    np.testing.assert_allclose(fit.std, np.sqrt(np.diag(white)), rtol=0.02)


def test_outliers_count_less(model, base):
    data = samples(model.arm, count=800, noise=0.2)
    generator = np.random.default_rng(6)
    wild = generator.random(data.tau.shape) < 0.05
    data.tau[wild] += 100 * generator.normal(size=int(wild.sum())) + 60
    equations = equations_of([data], model)
    truth = base.of(np.nan_to_num(model.prior))
    plain = np.abs(fit_arm(equations, base).values - truth)
    for weight, gain in (("huber", 5), ("tukey", 20)):
        robust = fit_robust(lambda: [data], equations, base, weight)
        assert np.median(np.abs(robust.values - truth)) < np.median(plain) / gain
        assert robust.outliers is not None
        assert 0.03 < robust.outliers.dropped < 0.1


@pytest.mark.study
def test_deviations_count_correlated_noise(model, base):
    """Noise that is the mean of ten white ones has deviations √10 larger than its white formula where columns vary slowly."""
    arm, generator = model.arm, np.random.default_rng(7)
    errors, white, right = [], [], []
    for seed in range(12):
        data = samples(arm, count=2000, seed=1)
        t = data.t
        for k in range(arm.n):  # slow motion, of many rows to a period
            data.q[:, k] = np.sin((0.5 + 0.13 * k) * t + k)
            data.qd[:, k] = (0.5 + 0.13 * k) * np.cos((0.5 + 0.13 * k) * t + k)
            data.qdd[:, k] = -((0.5 + 0.13 * k) ** 2) * data.q[:, k]
        data.tau[:] = model.dyn.inverse_dynamics(data.q, data.qd, data.qdd)
        noise = generator.normal(size=(len(t) + 9, arm.n))
        data.tau[:] += np.stack([np.convolve(noise[:, j], np.ones(10) / 10, "valid") for j in range(arm.n)], axis=1)
        fit = fit_arm(equations_of([data], model), base, "ols")
        errors.append(fit.values - base.of(np.nan_to_num(model.prior)))
        white.append(fit.std)
        right.append(with_correlation(lambda data=data: [data], fit).std)
        assert seed < 12
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    assert 0.75 < np.median(spread / np.mean(right, axis=0)) < 1.35
    assert np.median(spread / np.mean(white, axis=0)) > 2.0


def test_parts_are_held_out_in_turn(model, base):
    data = samples(model.arm, noise=0.5)
    fit = fit_arm(equations_of([data], model, part_seconds=1.0), base)
    held = cross_validated(fit)
    assert len(held) == 4
    others = data.part(slice(100, None))
    parameters = fit_arm(equations_of([others], model), base, "wls", fit.weights).parameters
    first = data.part(slice(0, 100))
    residual = first.tau - model.rows(first.q, first.qd, first.qdd) @ parameters
    np.testing.assert_allclose(held[0].relative, np.sqrt((residual**2).mean(axis=0)) / fit.torque_rms, rtol=1e-6)
    assert not held[0].at_rest


def test_too_few_rows_and_motions_that_tell_too_little_are_refused(model, base):
    with raises_at(IdentificationError, "log", r"30 torques.*58 parameters"):
        fit_arm(equations_of([samples(model.arm, count=5)], model), base)
    still = samples(model.arm)
    still.qd[:] = 0
    with pytest.raises(IdentificationError, match="cannot distinguish"):
        fit_arm(equations_of([still], model), base)


@pytest.mark.study
def test_chi_squares_over_seeds_are_those_of_the_covariance(model, base):
    """Noise of a low-pass on known rows: the statistics' sum lies inside its central 99 % over ten seeds of 58 parameters."""
    seeds, rows, generator = 10, 8000, np.random.default_rng(11)
    data = samples(model.arm, count=rows)
    total = 0.0
    for _ in range(seeds):
        noise = generator.normal(size=(rows + 2, model.arm.n))
        noise = 0.25 * noise[:-2] + 0.5 * noise[1:-1] + 0.25 * noise[2:]
        noisy = replace(data, tau=data.tau + noise * np.arange(1.0, 7.0))
        fit = fit_arm(equations_of([noisy], model), base)
        fit = with_correlation(lambda noisy=noisy: [noisy], fit)
        error = fit.values - base.of(np.nan_to_num(model.prior))
        scale = fit.std
        total += (error / scale) @ np.linalg.solve(fit.correlation, error / scale)
    low, high = chi2.ppf([0.005, 0.995], seeds * len(base))
    assert low < total < high

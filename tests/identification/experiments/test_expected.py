"""Expected deviations against what fits of simulated measurements scatter, and sentences on what would separate parameters."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import IdentificationError
from armwright.identification.experiments.columns import DRIVES, BaseRegressor
from armwright.identification.experiments.expected import (
    deviations,
    experiments_that_separate,
    joints_that_separate,
    weak_directions,
)
from armwright.trajectory import Fourier
from physics.arms import arm
from raises_at import raises_at

BOTH = Fourier.at_rest(
    [0.2, -0.3], [[0.5, 0.2, -0.3], [-0.4, 0.6, 0.2]], [[0.2, -0.4, 0.3], [0.5, 0.1, -0.3]], 4.0, cycles=1
)
ONE = Fourier.at_rest([0.2, -0.3], [[0.5, 0.2, -0.3], [0, 0, 0]], [[0.2, -0.4, 0.3], [0, 0, 0]], 4.0, cycles=1)


def regressor():
    return BaseRegressor.of(arm("two-link"), DRIVES, np.full(2, 1e-3))


def test_deviations_are_the_scatter_of_fits():
    found = aw.identification.compare_experiments({"both": BOTH}, arm=arm("two-link"), noise=[0.5, 0.2], rate=50.0)
    t = np.arange(0.0, 4.0, 1 / 50.0)
    rows = regressor().rows(*BOTH.at(t)) / np.array([0.5, 0.2])[:, None]
    rows = rows.reshape(-1, rows.shape[-1])
    noise = np.random.default_rng(0).normal(size=(len(rows), 4000))
    scatter = np.linalg.lstsq(rows, noise, rcond=None)[0].std(axis=1)
    np.testing.assert_allclose(found.experiments["both"].std, scatter, rtol=0.06)


def test_an_experiment_that_moves_one_joint_does_not_tell_the_other():
    found = aw.identification.compare_experiments({"one": ONE, "both": BOTH}, arm=arm("two-link"), noise=0.5)
    one, both = found.experiments["one"], found.experiments["both"]
    silent = [name for name, std in zip(one.names, one.std, strict=True) if np.isinf(std)]
    assert {"fv2", "fc2", "Ia2"} <= set(silent)
    assert np.isfinite(both.std).all()
    assert found.best == "both"
    assert "one: fv2 cannot be identified from it; both would do it" in found.remarks
    assert "not identifiable" in str(found)


def test_the_joint_that_would_tell_is_named():
    t = np.linspace(0.0, 4.0, 200)
    sentences = joints_that_separate(regressor(), regressor().information(*ONE.at(t)), len(t))
    assert "fv2 cannot be identified from this log; a motion of elbow would do it" in sentences


def test_directions_of_a_known_information():
    names = ["R", "Kt", "J", "f"]
    # measured: R/Kt², J R/Kt² and f R/Kt²: their scale is not seen
    jacobian = np.array([[1.0, -2.0, 0.0, 0.0], [1.0, -2.0, 1.0, 0.0], [1.0, -2.0, 0.0, 1.0]])
    log, current = jacobian.T @ jacobian, np.diag([0.0, 4.0, 0.0, 0.0])
    assert np.isinf(deviations(log)[:2]).all()
    assert np.isfinite(deviations(log + current)).all()
    (direction,) = weak_directions(log)
    np.testing.assert_allclose(jacobian @ (direction.vector / np.linalg.norm(jacobian, axis=0)), 0.0, atol=1e-7)
    (sentence,) = experiments_that_separate(names, log, {"more of the same": log, "a current": current})
    assert sentence == "R and Kt cannot be distinguished with this log; a current would do it"
    (sentence,) = experiments_that_separate(names, log, {"more of the same": log})
    assert sentence.endswith("no other experiment that was compared would do much better")
    assert experiments_that_separate(names, log + current, {}) == ()


def test_scenarios_are_compared_by_their_sensitivities():
    model = (
        arm("cmu-dd")
        .with_locked(dict.fromkeys(arm("cmu-dd").names[1:], 0.0))
        .replace(friction=None, gravity=(0.0, 0.0, 0.0))
    )
    joint = model.names[0]
    by = [f"{joint}.motor.resistance_ohm", f"{joint}.motor.torque_constant_n_m_per_a"]
    candidates = {
        "short": aw.Scenario(model, duration=0.05, command=[20.0], solver=aw.Solver(integrator="rk4", step=1e-3)),
        "long": aw.Scenario(model, duration=1.0, command=[20.0], solver=aw.Solver(integrator="rk4", step=1e-3)),
    }
    found = aw.identification.compare_experiments(candidates, by=by, noise={"qd": 0.01})
    assert (found.experiments["long"].std < found.experiments["short"].std).all()
    # closed form: w = (u / k)(1 - exp(-t k² / R J)), its slopes by central differences
    drive = model.coordinates[0].drive
    k, resistance = float(drive.torque_constant), float(drive.resistance)
    inertia = float(aw.compile(model).mass_matrix(np.zeros(1))[0, 0])
    t = np.arange(0.0, 1.0 + 5e-4, 1e-3)

    def speed(r, kt):
        return 20.0 / kt * (1.0 - np.exp(-t * kt * kt / (r * inertia)))

    h = 1e-5
    jacobian = np.stack([
        (speed(resistance * (1 + h), k) - speed(resistance * (1 - h), k)) / (2 * h * resistance),
        (speed(resistance, k * (1 + h)) - speed(resistance, k * (1 - h))) / (2 * h * k),
    ], axis=1) / 0.01  # fmt: skip
    expected = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    np.testing.assert_allclose(found.experiments["long"].std, expected, rtol=1e-3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (({},), "experiments by name"),
        (({"a": 3},), "a Scenario, or a motion beside `arm`"),
        (({"a": Fourier([0.0, 0.0], [[1.0], [1.0]], [[1.0], [1.0]], 1.0)}, "two-link"), "a motion that ends"),
        (({"a": BOTH}, "two-link", -1.0), "standard deviations above 0"),
        (({"a": BOTH}, "two-link", [1.0, 2.0, 3.0]), "all joints, or 2"),
    ],
)
def test_what_cannot_be_compared_is_refused(arguments, said):
    candidates, name, noise = (*arguments, None, 1.0)[:3] if len(arguments) < 3 else arguments
    with pytest.raises(IdentificationError, match=said):
        aw.identification.compare_experiments(candidates, arm=None if name is None else arm(name), noise=noise)


@pytest.mark.parametrize("noise", [{}, 0.01, None])
def test_noise_of_a_scenario_is_by_signal(noise):
    scenario = aw.Scenario(arm("two-link"), duration=0.01, command=[0.0, 0.0])
    with raises_at(IdentificationError, "noise"):
        aw.identification.compare_experiments({"a": scenario}, by=["elbow.mass"], noise=noise)

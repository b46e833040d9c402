"""Laws of the mass matrix, over all arms and random states."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.dynamics import (
    bias_torques,
    gravity_torques,
    inverse_dynamics,
    kinetic_energy,
    mass_matrix,
    spring_torques,
)
from physics.arms import NAMES, arm, gradient, random_state

SEEDS = range(3)


def christoffel(derivative: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """C_ij = Σ_k ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j - ∂M_jk/∂q_i) q̇_k, from derivative[i, j, k] = ∂M_ij/∂q_k."""
    d = derivative
    symbols = 0.5 * (d + d.transpose(0, 2, 1) - d.transpose(2, 0, 1))
    return symbols @ qd


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", SEEDS)
def test_symmetric_positive_definite(name, seed):
    """M = Mᵀ > 0, with the rotors and without; accepted impossible links included."""
    q = random_state(arm(name), seed)[0]
    for model in (arm(name), arm(name).replace(rotors=None)):
        m = mass_matrix(model, q)
        np.testing.assert_array_equal(m, m.T)
        assert np.linalg.eigvalsh(m)[0] > 0.0


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", SEEDS)
def test_columns_are_unit_accelerations(name, seed):
    """Walker and Orin's method 1: column j of M is the torque for q̈ = e_j without motion, gravity and losses."""
    model = arm(name).replace(friction=None, efficiency=None, gravity=[0.0, 0.0, 0.0], springs=None)
    q = random_state(model, seed)[0]
    columns = [inverse_dynamics(model, q, np.zeros(model.n), unit) for unit in np.eye(model.n)]
    m = mass_matrix(model, q)
    np.testing.assert_allclose(m, np.array(columns).T, rtol=0, atol=1e-13 * np.abs(m).max())


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", SEEDS)
def test_kinetic_energy_is_its_quadratic_form(name, seed):
    """T = ½ q̇ᵀ M q̇, T from the bodies' velocities."""
    model = arm(name)
    q, qd, _ = random_state(model, seed)
    assert kinetic_energy(model, q, qd) == pytest.approx(0.5 * qd @ mass_matrix(model, q) @ qd, rel=1e-12)


@pytest.mark.sample(8)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", SEEDS)
def test_rate_minus_twice_coriolis_is_skew(name, seed):
    """Ṁ - 2C is skew for Christoffel's C of the traced M, and that C is the one of Newton and Euler's torques.

    The first holds by algebra for any symmetric M; that C q̇ are the velocity torques, and that they do no work
    beside changing T (q̇ᵀ Ṁ q̇ = 2 q̇ᵀ C q̇), does not.
    """
    model = arm(name).replace(friction=None, efficiency=None)
    q, qd, _ = random_state(model, seed)
    (derivative,) = gradient("mass_matrix", lambda q: mass_matrix(model, q), q)
    rate, c = derivative @ qd, christoffel(derivative, qd)
    size = np.abs(derivative).max() * np.abs(qd).max() + 1e-3
    torques = bias_torques(model, q, qd) - gravity_torques(model, q) - spring_torques(model, q)
    np.testing.assert_allclose(rate - 2 * c, -(rate - 2 * c).T, rtol=0, atol=1e-12 * size)
    np.testing.assert_allclose(
        c @ qd, torques, rtol=0, atol=1e-12 * (size + np.abs(gravity_torques(model, q)).max()) * 10
    )
    assert qd @ rate @ qd == pytest.approx(2 * qd @ torques, rel=1e-9, abs=1e-10 * size)


@pytest.mark.parametrize("name", NAMES)
def test_first_joint_turns_all_the_same(name):
    """M does not depend on the position of the first joint, whatever carries the arm."""
    model = arm(name)
    q = random_state(model, 0)[0]
    moved = q + np.eye(model.n)[0]
    np.testing.assert_allclose(mass_matrix(model, q), mass_matrix(model, moved), rtol=0, atol=1e-13)

"""Energy: torques of gravity and springs are its slope, and what goes in is what stays and what is lost."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.actuators import friction_torques
from armwright.actuators.friction import motor_friction
from armwright.dynamics import (
    bias_torques,
    forward_dynamics,
    gravity_torques,
    kinetic_energy,
    potential_energy,
    spring_torques,
)
from armwright.dynamics.gears import joint_torques
from armwright.kinematics import forward_kinematics, jacobian
from armwright.model import Model
from physics.arms import NAMES, arm, friction_at, gradient, random_state

SEEDS = range(3)


def rotors(model: Model) -> np.ndarray:
    """n² J_m of motors that turn one joint each, on the diagonal."""
    return np.diag([body.drive.reflected for body in model.coordinates])


def motor_side(model: Model, qd: np.ndarray, tau: np.ndarray, external: np.ndarray) -> np.ndarray:
    """Friction before the gears, some of it by loads."""
    rows = zip(model.coordinates, qd, tau, external, strict=True)
    return np.array([motor_friction(body, w, (t, e)) for body, w, t, e in rows])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", SEEDS)
def test_torques_at_rest_are_the_slope_of_the_potential_energy(name, seed):
    """g + s = ∂U/∂q, by differentiating the traced U."""
    model = arm(name)
    q = random_state(model, seed)[0]
    (slope,) = gradient("potential", lambda q: potential_energy(model, q), q)
    torques = gravity_torques(model, q) + spring_torques(model, q)
    np.testing.assert_allclose(torques, slope, rtol=0, atol=1e-12 * max(1.0, np.abs(slope).max()))


@pytest.mark.parametrize("name", NAMES)
def test_potential_energy_falls_with_gravity(name):
    """U = -Σ m gᵀ p: with gravity doubled it doubles, without gravity it is 0 but for springs."""
    model = arm(name).replace(springs=None)
    q = random_state(model, 0)[0]
    energy = potential_energy(model, q)
    assert energy != 0.0
    assert potential_energy(model.replace(gravity=2.0 * model.gravity), q) == pytest.approx(2.0 * energy)
    assert potential_energy(model.replace(gravity=np.zeros(3)), q) == 0.0


@pytest.mark.sample(8)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", SEEDS)
def test_power_balance(name, seed):
    """d(T+U)/dt = tau·q̇ - gear loss - friction·q̇ + wrench·tip velocity, and neither loss gives power."""
    model = arm(name)
    q, qd, tau = random_state(model, seed)
    tau, wrench = 30.0 * tau, np.random.default_rng([seed, 5]).normal(scale=10.0, size=6)
    qdd = forward_dynamics(model, q, qd, tau, wrench)
    t_q, t_qd = gradient("kinetic", lambda q, qd: kinetic_energy(model, q, qd), q, qd)
    (u_q,) = gradient("potential", lambda q: potential_energy(model, q), q)
    stored = t_q @ qd + t_qd @ qdd + u_q @ qd
    external = -bias_torques(model.replace(friction=None), q, qd, wrench)
    before = motor_side(model, qd, tau, external)
    entering = tau - rotors(model) @ qdd - before
    gear = (entering - joint_torques(model, qd, qdd, tau, external)) @ qd
    friction = friction_at(model, q, qd, tau, wrench) @ qd
    pushed = wrench @ (jacobian(model, q) @ qd)
    terms = [tau @ qd, gear, friction, pushed, t_q @ qd, t_qd @ qdd]
    assert stored == pytest.approx(tau @ qd - gear - friction + pushed, abs=1e-10 * np.abs(terms).max())
    assert gear >= -1e-13 * np.abs(terms).max()
    offsets = friction_torques(model, np.zeros(model.n))
    assert friction - np.dot(offsets, qd) >= 0.0


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", SEEDS)
def test_jacobian_is_the_rate_of_the_tip(name, seed):
    """Linear rows are ∂p/∂q, angular rows the ω of  Ṙ = ω× R, by differentiating the traced pose."""
    model = arm(name)
    q = random_state(model, seed)[0]
    (derivative,) = gradient("pose", lambda q: forward_kinematics(model, q), q)
    pose = forward_kinematics(model, q)
    spin = np.einsum("ikn,jk->ijn", derivative[:3, :3], pose[:3, :3])
    omega = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
    np.testing.assert_allclose(jacobian(model, q), np.concatenate([derivative[:3, 3], omega]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), rtol=0, atol=1e-13)
    np.testing.assert_array_equal(pose[3], [0.0, 0.0, 0.0, 1.0])

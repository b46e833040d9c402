"""Forward dynamics undoes inverse dynamics, whichever way it is computed and whatever is lost on the way."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.actuators import friction_torques
from armwright.actuators.friction import link_friction
from armwright.dynamics import (
    articulated_body,
    bias_torques,
    forward_arm,
    forward_dynamics,
    inverse_dynamics,
    mass_matrix,
)
from armwright.dynamics.gears import joint_torques
from armwright.errors import ModelError
from armwright.kinematics import jacobian
from armwright.model import build_model
from armwright.model.changes import without_servos
from physics.arms import FREE, NAMES, arm, description, random_state
from raises_at import raises_at

SEEDS = range(9)
LOSSLESS = [name for name in FREE if all(body.drive.efficiency is None for body in arm(name).bodies)]
WRENCH = np.array([12.0, -7.0, 30.0, 1.5, -2.0, 0.7])


@pytest.mark.sample(11)
@pytest.mark.parametrize(
    ("forward", "name"),
    [*((forward_dynamics, name) for name in NAMES), *((articulated_body, name) for name in LOSSLESS)],
)
@pytest.mark.parametrize("seed", SEEDS)
def test_forward_of_inverse_is_identity(forward, name, seed):
    """q̈ → tau → q̈ within 1e-9, with friction, gear loss, rotors and a wrench at the tip."""
    model = arm(name)
    q, qd, qdd = random_state(model, seed)
    for wrench in (None, WRENCH):
        tau = inverse_dynamics(model, q, qd, qdd, wrench)
        np.testing.assert_allclose(forward(model, q, qd, tau, wrench), qdd, rtol=0, atol=1e-9)


@pytest.mark.sample(25)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", SEEDS)
def test_inverse_of_forward_is_identity(name, seed):
    """tau → q̈ → tau within 1e-9 of the torques' size."""
    model = arm(name)
    q, qd, tau = random_state(model, seed)
    tau = 20.0 * tau
    qdd = forward_dynamics(model, q, qd, tau, WRENCH)
    back = inverse_dynamics(model, q, qd, qdd, WRENCH)
    np.testing.assert_allclose(back, tau, rtol=0, atol=1e-9 * max(1.0, np.abs(tau).max()))


@pytest.mark.parametrize("seed", SEEDS)
def test_forward_is_the_inverse_with_joints_at_rest(seed):
    """Without smoothing speeds each joint moves or stands: what stands has no dry friction and no gear loss, both ways."""
    model = arm("rough")
    q, qd, qdd = random_state(model, seed)
    qd = np.where(np.arange(model.n) == seed % (model.n + 1), qd, 0.0)
    tau = inverse_dynamics(model, q, qd, qdd)
    np.testing.assert_allclose(forward_dynamics(model, q, qd, tau), qdd, rtol=0, atol=1e-9)
    still = np.zeros(model.n)
    plain = inverse_dynamics(model.replace(friction=None, efficiency=None), q, still, qdd)
    offsets = [0.0 if body.friction is None else body.friction.offset for body in model.bodies]
    np.testing.assert_allclose(inverse_dynamics(model, q, still, qdd), plain + offsets, rtol=0, atol=1e-10)


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["inverse_dynamics", "forward_dynamics", "forward_dynamics_derivatives"])
def test_kernels_of_what_sticks_are_their_functions(name):
    """Compiled, with some joints at rest and others in motion: the jump is at 0 for both."""
    model = arm("rough")
    q, qd, last = np.random.default_rng(2).normal(size=(3, 16, model.n))
    qd[:, ::2] *= np.arange(16)[:, None] % 3 > 0
    kernel, function = getattr(aw.compile(model), name), getattr(aw, name)
    ours = kernel(q, qd, last)
    for k, row in enumerate(zip(q, qd, last, strict=True)):
        theirs = function(model, *row)
        if not isinstance(theirs, tuple):
            np.testing.assert_allclose(ours[k], theirs, rtol=1e-11, atol=1e-10)
            continue
        for of_kernel, of_function in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(of_kernel[k], of_function, rtol=1e-9, atol=1e-8)


def test_lossy_gears_are_met_driving_and_driven_back():
    """The states above hold each lossy gear of `workshop` both ways, so that both branches of e are inverted."""
    model = arm("workshop")
    lossy = [i for i, body in enumerate(model.bodies) if body.drive.efficiency is not None]
    power = []
    for seed in SEEDS:
        q, qd, qdd = random_state(model, seed)
        power.append((inverse_dynamics(model, q, qd, qdd) * qd)[lossy])
    assert len(lossy) == 3
    assert (np.min(power, axis=0) < 0).all()
    assert (np.max(power, axis=0) > 0).all()


@pytest.mark.sample(20)
@pytest.mark.parametrize("name", LOSSLESS)
@pytest.mark.parametrize("seed", SEEDS)
def test_articulated_bodies_are_composite_bodies(name, seed):
    """Featherstone's recursion and M⁻¹ give the same accelerations."""
    model = arm(name)
    q, qd, tau = random_state(model, seed)
    ours, other = articulated_body(model, q, qd, tau), forward_dynamics(model, q, qd, tau)
    np.testing.assert_allclose(ours, other, rtol=0, atol=1e-11 * np.abs(other).max())


@pytest.mark.sample(25)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", SEEDS)
def test_inverse_dynamics_is_its_terms(name, seed):
    """Bᵀ G = M_links q̈ + C q̇ + g + f_links - Jᵀ wrench: every term by its own function."""
    model = arm(name)
    q, qd, qdd = random_state(model, seed)
    tau = inverse_dynamics(model, q, qd, qdd, WRENCH)
    frictionless = model.replace(friction=None)
    links = mass_matrix(model.replace(rotors=None), q) @ qdd + bias_torques(frictionless, q, qd, WRENCH)
    rotors = mass_matrix(model, q) - mass_matrix(model.replace(rotors=None), q)
    followers = rotors - np.diag([body.drive.reflected for body in model.coordinates])
    behind = links + link_friction(model, qd) + followers @ qdd
    external = -bias_torques(frictionless, q, qd, WRENCH)
    found = joint_torques(model, qd, qdd, tau, external)
    np.testing.assert_allclose(found, behind, rtol=0, atol=1e-11 * np.abs(behind).max())
    np.testing.assert_allclose(
        bias_torques(model, q, qd, WRENCH),
        bias_torques(frictionless, q, qd) + friction_torques(model, qd, external) - jacobian(model, q).T @ WRENCH,
        rtol=0,
        atol=1e-11 * np.abs(behind).max(),
    )


@pytest.mark.parametrize("name", [name for name in NAMES if arm(name).bodies[0].drive.command != "torque"])
def test_forward_arm_takes_commands_in_the_joints_unit(name):
    """V = R tau/(n Kt) + n Ke q̇ (11), or i = tau/(n Kt), commands the acceleration that tau gives."""
    model = without_servos(arm(name))
    q, qd, tau = random_state(model, 1)
    drives = [body.drive for body in model.coordinates]
    current = np.array([t / (d.gear_ratio * d.torque_constant) for t, d in zip(tau, drives, strict=True)])
    u = current
    if drives[0].command == "voltage":
        u = [
            d.resistance * i + d.gear_ratio * d.back_emf_constant * w
            for d, i, w in zip(drives, current, qd, strict=True)
        ]
    expected = forward_dynamics(model, q, qd, tau)
    np.testing.assert_allclose(
        forward_arm(model, q, qd, np.array(u)), expected, rtol=0, atol=1e-9 * np.abs(expected).max()
    )


def test_torque_driven_arm_takes_torques():
    """`panda` is commanded in N m."""
    model = arm("panda")
    q, qd, tau = random_state(model, 1)
    np.testing.assert_array_equal(forward_arm(model, q, qd, tau), forward_dynamics(model, q, qd, tau))


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10**9), st.floats(-1e-3, 1e-3))
def test_gear_loss_is_inverted_near_standstill(seed, slow):
    """Speeds and torques through 0, where e changes its branch, do not hurt the identity."""
    model = arm("workshop")
    q, qd, qdd = random_state(model, seed)
    qd, qdd = slow * qd, 0.1 * qdd
    tau = inverse_dynamics(model, q, qd, qdd)
    np.testing.assert_allclose(forward_dynamics(model, q, qd, tau), qdd, rtol=0, atol=1e-9)


def test_nothing_finite_comes_of_nan():
    """A diverged position gives NaN, not a number."""
    model = arm("workshop")
    q, qd, tau = random_state(model, 0)
    q[0] = np.nan
    assert np.isnan(forward_dynamics(model, q, qd, tau)).any()
    assert np.isnan(inverse_dynamics(model, q, qd, tau)).any()


def test_wrench_needs_a_tip():
    """An arm that branches and names no tip refuses a wrench and lists its frames."""
    model = build_model(description("workshop").replace(tip=None)).replace(efficiency=None)
    q, qd, qdd = random_state(model, 0)
    inverse_dynamics(model, q, qd, qdd)
    for call in (inverse_dynamics, forward_dynamics, articulated_body):
        with raises_at(ModelError, "tip", "no tip.*tool"):
            call(model, q, qd, qdd, WRENCH)

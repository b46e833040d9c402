"""Derivatives of inverse and forward dynamics: against differences of the functions, and against Pinocchio's analytic ones."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.dynamics import (
    forward_dynamics,
    forward_dynamics_derivatives,
    inverse_dynamics,
    inverse_dynamics_derivatives,
    mass_matrix,
)
from armwright.model import Model, build_model
from physics.arms import NAMES, arm, description, has_friction_by_loads, random_state
from physics.differences import assert_slope, differences
from reference.random_trees import random_description, random_position

TREES = range(1, 37, 3)  # of 2 to 11 joints, with friction and gear loss
ANALYTIC = 1e-9


def tree(seed: int) -> Model:
    """A random tree with friction, rotors and gear loss."""
    return build_model(random_description(seed))


def is_lossy(model: Model) -> bool:
    """True if a gear loses power or friction grows with the torques: ∂tau/∂q̈ is not M then."""
    return has_friction_by_loads(model) or any(body.drive.efficiency is not None for body in model.coordinates)


@pytest.mark.sample(1)
@pytest.mark.parametrize("which", [*NAMES, *TREES])
def test_slopes_are_differences(which):
    """∂tau, ∂q̈ of every arm, friction and lossy gears included, within 1e-7 of differences of the float reference."""
    model = arm(which) if isinstance(which, str) else tree(which)
    for seed in range(2):
        q, qd, qdd = random_state(model, seed)
        by_q, by_qd, by_qdd = inverse_dynamics_derivatives(model, q, qd, qdd)
        assert_slope(by_q, differences(lambda x, qd=qd, qdd=qdd: inverse_dynamics(model, x, qd, qdd), q))
        assert_slope(by_qd, differences(lambda x, q=q, qdd=qdd: inverse_dynamics(model, q, x, qdd), qd))
        tau = inverse_dynamics(model, q, qd, qdd)
        assert_slope(by_qdd, differences(lambda x, q=q, qd=qd: inverse_dynamics(model, q, qd, x), qdd))
        if not is_lossy(model):
            assert_slope(by_qdd, mass_matrix(model, q), 1e-13)

        by_q, by_qd, by_tau = forward_dynamics_derivatives(model, q, qd, tau)
        assert_slope(by_q, differences(lambda x, qd=qd, tau=tau: forward_dynamics(model, x, qd, tau), q))
        assert_slope(by_qd, differences(lambda x, q=q, tau=tau: forward_dynamics(model, q, x, tau), qd))
        assert_slope(by_tau, differences(lambda x, q=q, qd=qd: forward_dynamics(model, q, qd, x), tau))
        assert_slope(by_tau @ by_qdd, np.eye(model.n), 1e-10)


@pytest.mark.sample(1)
@pytest.mark.parametrize("which", ["puma560", "lwa4p", "panda", "two-link", *TREES])
def test_slopes_are_pinocchios(which):
    """Within 1e-9 of computeRNEADerivatives and computeABADerivatives, rotors' inertia included; friction and gear loss away."""
    pytest.importorskip("pinocchio", exc_type=ImportError)
    from reference.peers import Pinocchio

    record = description(which) if isinstance(which, str) else random_description(which)
    model = build_model(record).replace(friction=None, efficiency=None)
    peer = Pinocchio(record, model.names)
    rng = np.random.default_rng(0)
    for _ in range(3):
        q, (qd, qdd) = random_position(model, rng), rng.normal(size=(2, model.n))
        ours = inverse_dynamics_derivatives(model, q, qd, qdd)
        for mine, theirs in zip(ours, peer.inverse_dynamics_derivatives(q, qd, qdd), strict=False):
            assert_slope(mine, theirs, ANALYTIC)
        tau = inverse_dynamics(model, q, qd, qdd)
        ours = forward_dynamics_derivatives(model, q, qd, tau)
        for mine, theirs in zip(ours, peer.forward_dynamics_derivatives(q, qd, tau), strict=True):
            assert_slope(mine, theirs, ANALYTIC)


def last_frame(model: Model) -> Model:
    """The arm with its last frame as its tip, where it names none."""
    return model if model.tip is not None else model.replace(tip=list(model.frames)[-1])


@pytest.mark.sample(1)
@pytest.mark.parametrize("which", [*NAMES, *TREES])
def test_slopes_under_a_wrench_are_differences(which):
    """The environment's wrench is held in base axes while the arm moves under it."""
    model = last_frame(arm(which) if isinstance(which, str) else tree(which))
    q, qd, qdd = random_state(model, 5)
    wrench = 20.0 * np.random.default_rng(6).normal(size=6)
    by_q, by_qd, by_qdd = inverse_dynamics_derivatives(model, q, qd, qdd, wrench)
    assert_slope(by_q, differences(lambda x: inverse_dynamics(model, x, qd, qdd, wrench), q))
    assert_slope(by_qd, differences(lambda x: inverse_dynamics(model, q, x, qdd, wrench), qd))
    tau = inverse_dynamics(model, q, qd, qdd, wrench)
    by_q, by_qd, by_tau = forward_dynamics_derivatives(model, q, qd, tau, wrench=wrench)
    assert_slope(by_q, differences(lambda x: forward_dynamics(model, x, qd, tau, wrench), q))
    assert_slope(by_qd, differences(lambda x: forward_dynamics(model, q, x, tau, wrench), qd))
    assert_slope(by_tau @ by_qdd, np.eye(model.n), 1e-10)


@pytest.mark.parametrize("name", ["puma560", "lwa4p", "panda"])
def test_slopes_under_a_wrench_are_pinocchios(name):
    """Against differences of its RNEA: its own derivatives hold a wrench in the body's axes, not in the base's."""
    pytest.importorskip("pinocchio", exc_type=ImportError)
    from reference.peers import Pinocchio

    model = arm(name).replace(friction=None, efficiency=None)
    peer = Pinocchio(description(name), model.names)
    q, qd, qdd = random_state(model, 7)
    wrench = 20.0 * np.random.default_rng(8).normal(size=6)
    by_q, by_qd, _ = inverse_dynamics_derivatives(model, q, qd, qdd, wrench)
    assert_slope(by_q, differences(lambda x: peer.inverse_dynamics(x, qd, qdd, wrench), q))
    assert_slope(by_qd, differences(lambda x: peer.inverse_dynamics(q, x, qdd, wrench), qd))


def test_a_wrench_of_zero_changes_nothing():
    model = arm("workshop")
    q, qd, qdd = random_state(model, 9)
    for function in (inverse_dynamics_derivatives, forward_dynamics_derivatives):
        without, pushed = function(model, q, qd, qdd), function(model, q, qd, qdd, np.zeros(6))
        for mine, theirs in zip(pushed, without, strict=True):
            assert_slope(mine, theirs, 1e-12)


@pytest.mark.sample(6)
@pytest.mark.parametrize("name", NAMES)
def test_they_undo_each_other(name):
    """∂q̈/∂x = -∂q̈/∂tau ∂tau/∂x where q̈ is the acceleration of tau: an identity between the two functions."""
    model = arm(name)
    q, qd, qdd = random_state(model, 3)
    tau_q, tau_qd, _ = inverse_dynamics_derivatives(model, q, qd, qdd)
    qdd_q, qdd_qd, inverse = forward_dynamics_derivatives(model, q, qd, inverse_dynamics(model, q, qd, qdd))
    assert_slope(qdd_q, -inverse @ tau_q, 1e-10)
    assert_slope(qdd_qd, -inverse @ tau_qd, 1e-10)

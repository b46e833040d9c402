"""Joints that mimic others: virtual work on the tree, Pinocchio on the same tree, and every kernel of the table."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.actuators import friction_torques
from armwright.description.database import parse
from armwright.dynamics import (
    articulated_body,
    bias_torques,
    coriolis_matrix,
    energy,
    forward_dynamics,
    inverse_dynamics,
    inverse_dynamics_derivatives,
    mass_matrix,
    regressor,
)
from armwright.errors import DescriptionError, ModelError
from armwright.kernels.signatures import SIGNATURES
from armwright.kinematics import forward_kinematics, jacobian
from armwright.model import build_model
from physics.arms import all_positions, arm, description, gripper, projection, random_state
from physics.differences import differences
from raises_at import raises_at
from reference.random_trees import random_description

SEEDS = st.integers(0, 2**32 - 1)


@st.composite
def coupled_tree(draw):
    """A random tree some of whose joints follow others, forward and backward in the tree, in chains."""
    record = random_description(draw(st.integers(0, 40)))
    joints, free = list(record.joints), []
    for k, joint in enumerate(joints):
        if joint.type == "fixed":
            continue
        plain = joint.motor is None
        if free and plain and draw(st.booleans()):
            unit = "rad" if joint.type == "revolute" else "m"
            multiplier = draw(st.sampled_from([-2.0, -0.5, 0.3, 1.0]))
            followed = {"joint": draw(st.sampled_from(free)), "multiplier": multiplier, f"offset_{unit}": 0.1}
            joints[k] = joint.replace(mimic={"source": "definition", **followed})
        free.append(joint.name)
    return record.replace(joints=tuple(joints))


@pytest.mark.study
@settings(deadline=None, max_examples=25)
@given(record=coupled_tree(), seed=SEEDS)
def test_torques_and_inertia_are_those_of_the_tree_projected(record, seed):
    """tau = Gᵀ tau_all, M = Gᵀ M_all G, J = J_all G, and forward dynamics undoes inverse dynamics."""
    model = build_model(record).replace(efficiency=None)
    tree, g = model.tree, projection(model)
    assert (tree.n, model.n) == g.shape
    q, qd, qdd = random_state(model, seed)
    every = all_positions(model, q), g @ qd, g @ qdd
    tau = inverse_dynamics(model, q, qd, qdd)
    expected = inverse_dynamics(tree, *every)
    largest = np.abs(expected).max()
    np.testing.assert_allclose(tau, g.T @ expected, rtol=0, atol=1e-12 * g.size * largest)
    m = mass_matrix(model, q)
    np.testing.assert_array_equal(m, m.T)
    np.testing.assert_allclose(m, g.T @ mass_matrix(tree, every[0]) @ g, rtol=0, atol=1e-12 * np.abs(m).max())
    frame = model.bodies[-1].link
    np.testing.assert_allclose(jacobian(model, q, frame), jacobian(tree, every[0], frame) @ g, rtol=0, atol=1e-12)
    back = forward_dynamics(model, q, qd, tau)
    np.testing.assert_allclose(back, qdd, rtol=0, atol=1e-13 * np.linalg.cond(m) * max(1.0, largest))


def test_pinocchio_has_the_same_torques_and_inertia():
    """The gripper without losses: Pinocchio's tree of nine joints, projected on five coordinates, to 1e-9."""
    pytest.importorskip("pinocchio", exc_type=ImportError)
    from reference.peers import Pinocchio

    model = arm("gripper").replace(friction=None, efficiency=None)
    g, peer = projection(model), Pinocchio(description("gripper"), model.tree.names)
    assert g.shape == (9, 5)
    for seed in range(5):
        q, qd, qdd = random_state(model, seed)
        tau = g.T @ peer.inverse_dynamics(all_positions(model, q), g @ qd, g @ qdd)
        np.testing.assert_allclose(inverse_dynamics(model, q, qd, qdd), tau, rtol=0, atol=1e-9 * np.abs(tau).max())
        m = g.T @ peer.mass_matrix(all_positions(model, q)) @ g
        np.testing.assert_allclose(mass_matrix(model, q), m, rtol=0, atol=1e-9 * np.abs(m).max())


def test_chains_are_followed_to_the_driven_joint():
    """q_tip = 0.7 (6 q_left + 0.3) - 0.4."""
    model = arm("gripper")
    assert model.names == ["joint1", "joint2", "joint3", "joint4", "left"]
    every = dict(zip(model.tree.names, all_positions(model, np.array([0.0, 0.0, 0.0, 0.4, 0.02])), strict=True))
    assert every["thumb_tip"] == pytest.approx(0.7 * (6.0 * 0.02 + 0.3) - 0.4, abs=1e-15)
    assert every["right"] == pytest.approx(0.01 - 0.02, abs=1e-15)
    assert every["joint5"] == pytest.approx(-1.5 * 0.4 + 0.2, abs=1e-15)


def test_slopes_are_those_of_differences():
    """∂tau/∂q and ∂tau/∂q̇ with friction and gear loss, M = ∂tau/∂q̈, and C q̇ the velocity torques."""
    model = arm("gripper")
    q, qd, qdd = random_state(model, 3)
    by_q, by_qd, _ = inverse_dynamics_derivatives(model, q, qd, qdd)
    for slope, function, at in (
        (by_q, lambda x: inverse_dynamics(model, x, qd, qdd), q),
        (by_qd, lambda x: inverse_dynamics(model, q, x, qdd), qd),
    ):
        np.testing.assert_allclose(slope, differences(function, at), rtol=0, atol=1e-6 * np.abs(slope).max())
    free = model.replace(efficiency=None)
    units = [
        inverse_dynamics(free, q, qd, u) - inverse_dynamics(free, q, qd, np.zeros(model.n)) for u in np.eye(model.n)
    ]
    m = mass_matrix(model, q)
    np.testing.assert_allclose(m, np.array(units), rtol=0, atol=1e-12 * np.abs(m).max())
    still = model.replace(gravity=[0.0, 0.0, 0.0], friction=None)
    velocity = bias_torques(still, q, qd)
    np.testing.assert_allclose(
        coriolis_matrix(model, q, qd) @ qd, velocity, rtol=0, atol=1e-12 * np.abs(velocity).max()
    )


def test_energy_is_kept():
    """Without losses T + U stays over 500 steps of Runge and Kutta's rule."""
    model = arm("gripper").replace(friction=None, efficiency=None)
    n, h = model.n, 1e-3
    dyn = aw.compile(model)
    x = np.concatenate([0.2 * random_state(model, 1)[0], np.zeros(n)])

    def slope(x):
        return np.concatenate([x[n:], dyn.forward_dynamics(x[:n], x[n:], np.zeros(n))])

    start = sum(energy(model, x[:n], x[n:]))
    for _ in range(500):
        a = slope(x)
        b = slope(x + 0.5 * h * a)
        c = slope(x + 0.5 * h * b)
        x = x + h / 6.0 * (a + 2 * b + 2 * c + slope(x + h * c))
    kinetic, potential = energy(model, x[:n], x[n:])
    assert kinetic > 10.0
    assert kinetic + potential == pytest.approx(start, abs=1e-6 * kinetic)


@pytest.mark.sample(1)
@pytest.mark.parametrize("kernel", sorted(SIGNATURES))
def test_kernels_are_the_plain_functions(kernel):
    """Compiled, in frames aligned and parameters regrouped, the gripper is the same."""
    model, signature = arm("gripper"), SIGNATURES[kernel]
    if kernel == "operational_inertia":
        with raises_at(ModelError, f"joints that carry {model.tip!r}"):
            signature.function(model, np.zeros(model.n))
        return
    inputs = [np.random.default_rng(7).normal(size=argument.sized(model)) for argument in signature.inputs]
    results, expected = getattr(aw.compile(model), kernel)(*inputs), signature.function(model, *inputs)
    for ours, plain in zip(*(r if isinstance(r, tuple) else (r,) for r in (results, expected)), strict=True):
        np.testing.assert_allclose(ours, plain, rtol=0, atol=1e-9 * max(1.0, np.abs(plain).max()))


def test_multipliers_may_vary():
    """The coupling's numbers are parameters of the record as all others."""
    model = arm("gripper")
    names = ["thumb.mimic.multiplier", "thumb_tip.mimic.offset_rad", "right_link.mass_kg"]
    dyn = aw.compile(model, vary=names)
    q, qd, qdd = random_state(model, 2)
    values = np.array([4.0, 0.1, 0.7])
    other = model.with_values(dict(zip(names, values.tolist(), strict=True)))
    expected = inverse_dynamics(other, q, qd, qdd)
    tau = dyn.inverse_dynamics(q, qd, qdd, values)
    np.testing.assert_allclose(tau, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    assert np.abs(expected - inverse_dynamics(model, q, qd, qdd)).max() > 1e-2


def test_regressor_has_columns_for_every_link():
    model = arm("gripper")
    assert regressor(model, *random_state(model, 0)).shape == (5, 90)
    assert model.inertial_parameters.shape == (90,)


def test_friction_of_a_follower_is_felt_by_its_master():
    model = arm("gripper")
    qd = np.array([0.0, 0.0, 0.0, 0.0, 0.3])
    own = friction_torques(model.tree, projection(model) @ qd)
    assert friction_torques(model, qd)[4] == pytest.approx(projection(model)[:, 4] @ own, rel=1e-14)
    assert (own[[5, 6, 7]] != 0.0).all()


def test_articulated_bodies_refuse():
    with raises_at(ModelError, "articulated_body", "follow others", value="gripper"):
        articulated_body(arm("gripper"), *np.zeros((3, 5)))
    with raises_at(ModelError, "articulated_body", "gears with loss", value="workshop"):
        articulated_body(arm("workshop"), *np.zeros((3, arm("workshop").n)))


def test_held_masters_hold_their_followers():
    """The rest of the arm is what the whole one does with those coordinates held."""
    model = arm("gripper")
    held = model.with_locked({"left": 0.03, "joint4": -0.5})
    assert held.mimics is None
    assert held.names == ["joint1", "joint2", "joint3"]
    q = np.array([0.3, 0.1, -0.7])
    whole = np.array([*q, -0.5, 0.03])
    for frame in ("thumb_tip_link", "link5", "tool"):
        pose = forward_kinematics(held, q, frame)
        np.testing.assert_allclose(pose, forward_kinematics(model, whole, frame), rtol=0, atol=1e-14)
    np.testing.assert_allclose(
        mass_matrix(held, q), mass_matrix(model, whole)[:3, :3], rtol=0, atol=1e-12 * np.abs(mass_matrix(held, q)).max()
    )
    with raises_at(DescriptionError, "with_locked: joint 'right'", "'left'"):
        model.with_locked({"right": 0.0})


def test_a_part_without_its_master_is_refused():
    model = arm("gripper")
    with raises_at(DescriptionError, "subchain('base', 'right_link') joint 'right'", "'left'"):
        model.subchain("base", "right_link")
    freed = model.with_locked({"left": 0.0}).subchain("base", "right_link")
    assert freed.names == ["joint1", "joint2", "joint3"]


def changed(name, **fields):
    """The gripper's record with some fields of a joint changed."""
    robot = gripper()
    joint = next(joint for joint in robot["joints"] if joint["name"] == name)
    joint |= fields
    return robot


REFUSED = [
    ("right", {"mimic": {"joint": "lef", "multiplier": 1.0, "offset_m": 0.0}}, "not there; .*left"),
    ("right", {"mimic": {"joint": "left", "multiplier": 0.0, "offset_m": 0.0}}, "a number other than 0"),
    ("right", {"mimic": {"joint": "left", "multiplier": 1.0, "offset_rad": 0.0}}, "offset_rad"),
    ("right", {"mimic": {"joint": "left", "multiplier": 1.0}}, "offset_m"),
    ("left", {"mimic": {"joint": "thumb_tip", "multiplier": 1.0, "offset_m": 0.0}}, "follows itself"),
    ("joint3", {"motor": {"gear_ratio": 3.0, "rotor_inertia_kg_m2": 1.0, "torque_constant_n_m_per_a": 1.0, "resistance_ohm": 1.0,
                          "coupling": [{"joint": "right", "ratio": 2.0}]}}, "by itself"),
    ("right", {"command": "torque"}, "command: .*'left' .*no drive"),
    ("thumb", {"stops": {"stiffness_n_m_per_rad": 9.0, "damping_n_m_s_per_rad": 1.0}}, "stops: the joint"),
    ("thumb", {"motor": {"gear_ratio": 3.0, "rotor_inertia_kg_m2": 1.0, "gear_efficiency": 0.9}}, "motor.gear_efficiency"),
    ("mount", {"mimic": {"joint": "left", "multiplier": 1.0, "offset_m": 0.0}}, "mimic"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "fields", "message"), REFUSED)
def test_records_that_cannot_be(name, fields, message):
    with pytest.raises(DescriptionError, match=message):
        parse(changed(name, **fields), "gripper")

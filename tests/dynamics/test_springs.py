"""Springs: closed forms, MuJoCo's springs and tendons, the slope of their energy, and all kernels that they are in."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.description.database import parse
from armwright.dynamics.springs import spring_potential
from armwright.export.mjcf import write_mjcf
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.model import build_model
from dynamics.springs import GRAVITY, MASS, REACH, pendulum, sprung_tree
from physics.arms import arm, gripper, random_state
from reference.random_trees import random_position

WEIGHT = MASS * GRAVITY * REACH  # [N m], of the pendulum when it lies


@pytest.mark.parametrize("share", [0.5, 1.5])
def test_an_inverted_pendulum_stands_on_a_spring_that_is_stiff_enough(share):
    """ω² = (k - m g l) / (m l²) about the top: it swings above k = m g l and falls below."""
    model = pendulum(spring={"stiffness_n_m_per_rad": share * WEIGHT, "rest_rad": 0.0})
    zero = np.zeros(1)
    assert aw.spring_torques(model, [0.3]) == pytest.approx([share * WEIGHT * 0.3])
    a, _ = aw.forward_arm_linearised(model, zero, zero, zero)
    assert a[1, 0] == pytest.approx(-(share - 1.0) * WEIGHT / (MASS * REACH**2))
    q, qd = 0.4, 0.9
    expected = (WEIGHT * np.sin(q) - share * WEIGHT * q) / (MASS * REACH**2)
    assert aw.forward_dynamics(model, [q], [qd], zero) == pytest.approx([expected])


def test_a_spring_of_no_length_balances_a_pendulum_everywhere():
    """A tension k ℓ from a point h above the joint to one r out on the rod:  s = k h r sin q, which is -g if k h r = m g l."""
    h, r = 0.7, 0.25
    k = WEIGHT / (h * r)
    ends = {"link_a": "base", "anchor_a_m": [0.0, 0.0, h], "link_b": "rod", "anchor_b_m": [0.0, 0.0, r]}
    model = pendulum([{"name": "balancer", **ends, "force_n": -k * 0.5, "length_m": 0.5, "stiffness_n_per_m": k}])
    for q in np.linspace(-3.0, 3.0, 13):
        assert aw.gravity_torques(model, [q]) == pytest.approx([-WEIGHT * np.sin(q)], abs=1e-12)
        assert aw.spring_torques(model, [q]) == pytest.approx([WEIGHT * np.sin(q)], abs=1e-12)
        assert aw.bias_torques(model, [q], [1.3]) == pytest.approx([0.0], abs=1e-12)


def test_a_gas_spring_pushes_with_its_force_at_its_length():
    """Its lever arm about the joint is that of elementary geometry: area of the triangle over half the length."""
    a, b, force = np.array([0.3, 0.0, 0.1]), np.array([0.05, 0.0, 0.35]), 500.0
    length = float(np.linalg.norm(b - a))
    ends = {"link_a": "rod", "anchor_a_m": b, "link_b": "base", "anchor_b_m": a}
    model = pendulum([{"name": "gas", **ends, "force_n": force, "length_m": length, "stiffness_n_per_m": 800.0}])
    lever = abs(a[0] * b[2] - a[2] * b[0]) / length
    assert aw.spring_torques(model, [0.0]) == pytest.approx([-force * lever])  # it leans the rod to -x, away from a


def test_a_table_of_a_line_is_the_line():
    positions, torques = [-0.5, 0.1, 0.6], [4.0, 1.0, -1.5]
    line = {"stiffness_n_m_per_rad": 5.0, "rest_rad": 0.3, "preload_n_m": 0.0}
    table = {"positions_rad": positions, "torques_n_m": torques, "outside": "linear"}
    one, other = pendulum(spring=line), pendulum(spring=table)
    for q in (-2.0, -0.2, 0.3, 0.5, 1.0):
        assert aw.spring_torques(one, [q]) == pytest.approx(aw.spring_torques(other, [q]), abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 35), st.integers(0, 10**6))
@pytest.mark.study
def test_torques_are_differences_of_the_energy(tree, seed):
    """s = ∂U/∂q on random trees, by central differences of U."""
    model = TREES[tree] if tree in TREES else TREES.setdefault(tree, build_model(sprung_tree(tree)))
    q = random_position(model, np.random.default_rng(seed))
    steps = 1e-6 * np.eye(model.n)
    slope = [(spring_potential(model, q + step) - spring_potential(model, q - step)) / 2e-6 for step in steps]
    s = aw.spring_torques(model, q)
    assert s == pytest.approx(np.array(slope), rel=0, abs=1e-5 * max(1.0, np.abs(s).max()))


TREES: dict[int, aw.Model] = {}


@pytest.mark.parametrize("seed", range(0, 36, 3))
@pytest.mark.sample(1)
def test_mujocos(seed, tmp_path):
    """Joint stiffness and spatial tendons of MuJoCo on random trees, within 1e-10; and back from its file."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is the oracle here: pip install mujoco")
    model = build_model(sprung_tree(seed, tables=False))
    losses = write_mjcf(model.record, tmp_path / "arm.xml")
    assert not any("spring" in loss or "cylinder" in loss for loss in losses)
    theirs, back = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml")), aw.load(tmp_path / "arm.xml")
    data, rng = mujoco.MjData(theirs), np.random.default_rng(seed)
    place = [theirs.jnt_qposadr[theirs.joint(name).id] for name in model.names]
    dof = [theirs.jnt_dofadr[theirs.joint(name).id] for name in model.names]
    for _ in range(3):
        q = random_position(model, rng)
        data.qpos[place] = q
        mujoco.mj_forward(theirs, data)
        s = aw.spring_torques(model, q)
        assert s == pytest.approx(-data.qfrc_spring[dof], rel=0, abs=1e-10 * max(1.0, np.abs(s).max()))
        order = [model.names.index(name) for name in back.names]
        assert aw.spring_torques(back, q[order]) == pytest.approx(
            s[order], rel=0, abs=1e-10 * max(1.0, np.abs(s).max())
        )


WITH_SPRINGS = ("spring_torques", "inverse_dynamics", "forward_dynamics", "bias_torques", "energy", "regressor")


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", WITH_SPRINGS)
def test_compiled_is_the_float_run(name):
    model, signature = arm("sprung"), SIGNATURES[name]
    inputs = np.random.default_rng(1).normal(size=(len(signature.inputs), 40, model.n))
    compiled = getattr(aw.compile(model), name)(*inputs)
    floats = [getattr(aw, name)(model, *state) for state in zip(*inputs, strict=True)]
    for k, port in enumerate(signature.outputs):
        ours = compiled if len(signature.outputs) == 1 else compiled[k]
        expected = np.array(floats if len(signature.outputs) == 1 else [each[k] for each in floats], dtype=float)
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-12 * np.abs(expected).max(), err_msg=port.name)


def test_joints_that_follow_others_have_springs():
    """By power: springs of the followers act on their masters, and forward dynamics is the inverse of inverse dynamics."""
    robot = gripper()
    springs = {
        "right": {"stiffness_n_per_m": 90.0, "rest_m": 0.0},
        "thumb_tip": {"stiffness_n_m_per_rad": 0.7, "rest_rad": 0.1},
    }
    for joint in robot["joints"]:
        joint |= {"spring": springs[joint["name"]]} if joint["name"] in springs else {}
    ends = {"link_a": "left_link", "anchor_a_m": [0.0, 0.0, 0.1], "link_b": "thumb_link", "anchor_b_m": [0.1, 0.0, 0.0]}
    robot["cylinders"] = [{"name": "clip", **ends, "force_n": 5.0, "length_m": 0.2, "stiffness_n_per_m": 30.0}]
    model = build_model(parse(robot, "gripper"))
    q, qd, qdd = random_state(model, 2)
    steps = 1e-6 * np.eye(model.n)
    slope = [(spring_potential(model, q + step) - spring_potential(model, q - step)) / 2e-6 for step in steps]
    s = aw.spring_torques(model, q)
    assert s[model.names.index("left")] != 0.0
    assert s == pytest.approx(np.array(slope), abs=1e-6)
    tau = aw.inverse_dynamics(model, q, qd, qdd)
    assert aw.forward_dynamics(model, q, qd, tau) == pytest.approx(qdd, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", ["inverse_dynamics", "forward_dynamics", "energy"])
def test_an_arm_without_springs_does_no_operation_more(name):
    """Taken away, the programs are those of the same arm that never had some."""
    bare, never = arm("sprung").replace(springs=None), arm("workshop")
    counts = [trace_kernel(model, SIGNATURES[name]).operation_counts() for model in (bare, never)]
    assert counts[0] == counts[1]


def test_a_cylinder_across_one_joint_costs_few_operations():
    """No placement is computed of bodies that do not move between its ends, and every angle once."""
    puma = aw.load("puma560")
    ends = {"link_a": "link1", "anchor_a_m": [0.2, 0.3, 0.0], "link_b": "link2", "anchor_b_m": [-0.3, 0.1, 0.0]}
    record = puma.record.model_dump(exclude_none=True)
    record["cylinders"] = [
        {"name": "c", "source": "estimate", **ends, "force_n": 9.0, "length_m": 0.5, "stiffness_n_per_m": 7.0}
    ]
    sprung = build_model(aw.RobotDescription(**record))
    plain, more = (trace_kernel(model, SIGNATURES["inverse_dynamics"]).operation_counts() for model in (puma, sprung))
    added = more - plain
    assert (added["SIN"], added["COS"], added["SQRT"], added["DIV"]) == (0, 0, 1, 1)
    assert more.total() - plain.total() < 40

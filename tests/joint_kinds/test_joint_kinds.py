"""Laws of joint kinds: the motion subspace is the derivative of the motion, and an unknown kind is refused by name."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armwright as aw
from armwright.description.database import parse
from armwright.errors import DescriptionError
from armwright.joint_kinds import KINDS, LINEAR, ROTARY, Helical, Prismatic, Revolute, kind_named
from armwright.kinematics.forward_kinematics import body_placements
from armwright.model import build_model
from physics.arms import arm, screws

MOVING = (Revolute(), Prismatic(), Helical(0.07), Helical(-0.02))
AXIS, Q, STEP = np.array([0.3, -2.0, 0.9]), 0.8, 1e-6


@pytest.mark.parametrize("kind", MOVING)
def test_projection_is_the_power_of_the_motion(kind):
    """Sᵀ f q̇ is the power of a force and a moment on the body, whose motion is differentiated here."""
    force, moment, z = np.array([1.0, 2.0, -3.0]), np.array([-0.4, 0.7, 0.2]), AXIS / np.linalg.norm(AXIS)
    before, after = (kind.placement(AXIS, q) for q in (Q - STEP, Q + STEP))
    velocity = (after.position - before.position) / (2.0 * STEP)
    turn = Rotation.from_matrix(after.rotation @ before.rotation.T).as_rotvec() / (2.0 * STEP)
    assert kind.project(moment @ z, force @ z) == pytest.approx(force @ velocity + moment @ turn, rel=1e-6)


@pytest.mark.parametrize("kind", MOVING)
def test_a_speed_moves_as_its_position(kind):
    assert kind.motion(2.0 * Q) == pytest.approx(2.0 * np.array(kind.motion(Q)))
    assert (kind.motion(1.0)[0] != 0.0, kind.motion(1.0)[1] != 0.0) == (kind.turns, kind.slides)


def test_a_screw_moves_on_by_its_lead_in_a_turn():
    model = arm("screws")
    body, q = 2, np.zeros(model.n)
    before = body_placements(model, q)[body]
    q[body] = 2.0 * np.pi
    after = body_placements(model, q)[body]
    assert after.rotation == pytest.approx(before.rotation, abs=1e-12)
    lead = 2.0 * np.pi * model.bodies[body].kind.motion(1.0)[1]
    assert after.position - before.position == pytest.approx(lead * before.rotation[:, 2], abs=1e-12)


def test_unknown_kinds_name_file_key_and_choices():
    robot = screws()
    robot["joints"][2]["type"] = "spherical"
    with pytest.raises(DescriptionError) as caught:
        parse(robot, "arm.toml")
    assert (caught.value.place, caught.value.value) == ("joint 'joint3' type", "spherical")
    assert all(name in str(caught.value) for name in KINDS)
    with pytest.raises(DescriptionError) as caught:
        kind_named("screw", "joints[0].type", "arm.toml")
    assert caught.value.choices == tuple(KINDS)
    assert str(caught.value).startswith("arm.toml: joints[0].type = 'screw'")
    assert kind_named("helical") is Helical
    with pytest.raises(DescriptionError):
        kind_named(["helical"])


def test_a_screw_without_pitch_is_refused():
    for value in (None, 0.0):
        robot = screws()
        robot["joints"][2] |= {"pitch_m_per_rad": value}
        if value is None:
            del robot["joints"][2]["pitch_m_per_rad"]
        with pytest.raises(DescriptionError) as caught:
            parse(robot, "arm.toml")
        assert caught.value.place == "joint 'joint3' pitch_m_per_rad"


def test_keys_in_metres_are_those_in_radians_renamed():
    assert LINEAR.renamed("holding_torque_n_m") == "holding_force_n"
    assert LINEAR.renamed("cubic_n_m_per_rad3") == "cubic_n_per_m3"
    assert LINEAR.renamed("current_a") == "current_a"
    assert [ROTARY.key("error", "position"), LINEAR.key("velocity", "speed")] == ["error_rad", "velocity_m_per_s"]


@pytest.mark.parametrize("held", [0.0, 0.4])
def test_a_locked_screw_stays_where_its_thread_puts_it(held):
    """The dynamics left are those of the whole arm with that joint at rest there."""
    model, joint = arm("screws"), 2
    q = np.random.default_rng(0).normal(size=model.n)
    q[joint] = held
    others = np.delete(np.arange(model.n), joint)
    locked = model.with_locked({"joint3": held})
    expected = aw.mass_matrix(model, q)[np.ix_(others, others)]
    assert aw.mass_matrix(locked, q[others]) == pytest.approx(expected, rel=1e-10, abs=1e-12)
    assert aw.forward_kinematics(locked, q[others]) == pytest.approx(aw.forward_kinematics(model, q), abs=1e-12)


@pytest.mark.study
def test_pitches_may_differ_by_lane():
    """A pitch is a parameter like any other: kernels with it left open agree with those of the changed record."""
    dyn, pitches = aw.compile(arm("screws"), vary=["joint3.pitch_m_per_rad"]), np.array([[0.05], [0.11]])
    q, qd, qdd = np.random.default_rng(1).normal(size=(3, 1, dyn.arm.n))
    found = dyn.inverse_dynamics(q, qd, qdd, parameters=pitches)
    for row, pitch in zip(found, pitches[:, 0], strict=True):
        robot = screws()
        robot["joints"][2]["pitch_m_per_rad"] = pitch
        other = aw.compile(build_model(parse(robot, "arm")))
        assert row == pytest.approx(other.inverse_dynamics(q, qd, qdd)[0], rel=1e-12)

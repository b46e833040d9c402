"""A joint in axial steps is the joint as a whole, wherever its axis points."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from armwright.kinematics.axial_motion import AxialMotion
from armwright.kinematics.joint_motion import joint_motions
from armwright.spatial import ArticulatedInertia, Placement, rotation_rpy, skew
from physics.arms import arm

RIGHT = st.sampled_from([k * np.pi / 2 for k in range(-2, 3)])
ANGLE = st.floats(-np.pi, np.pi) | RIGHT | st.sampled_from([1e-9, -1e-7, 1e-13, np.pi - 1e-8])
LENGTH = st.floats(-2.0, 2.0) | st.just(0.0)


def dense(inertia: ArticulatedInertia) -> np.ndarray:
    """(6, 6), force and acceleration rows first."""
    return np.block([[inertia.linear, inertia.coupling.T], [inertia.coupling, inertia.angular]]).astype(float)


def force_transform(motion) -> np.ndarray:
    """(6, 6) that takes force and moment about the body's origin, body axes, to the parent's."""
    placed = motion.placement()
    return np.block(
        [[placed.rotation, np.zeros((3, 3))], [skew(placed.position) @ placed.rotation, placed.rotation]]
    ).astype(float)


@settings(deadline=None, max_examples=200)
@given(
    st.tuples(ANGLE, ANGLE, ANGLE),
    st.tuples(LENGTH, LENGTH, LENGTH),
    st.floats(-3.0, 3.0),
    st.sampled_from([0, 1]),
    st.integers(0, 9),
)
def test_steps_are_the_whole(rpy, xyz, q, which, seed):
    """Forces, accelerations and a symmetric inertia, against the (6, 6) transform of the joint's placement."""
    body = dataclasses.replace(arm("workshop").bodies[which], placement=Placement(rotation_rpy(*rpy), np.array(xyz)))
    model = dataclasses.replace(arm("workshop"), bodies=(dataclasses.replace(body, parent=-1),))
    motion = joint_motions(model, np.array([q]))[0]
    axial = AxialMotion(body, motion, q)
    x = force_transform(motion)
    rng = np.random.default_rng(seed)
    force, acceleration = rng.normal(size=(2, 6))
    half = rng.normal(size=(6, 6))
    matrix = half + half.T
    inertia = ArticulatedInertia(matrix[:3, :3], matrix[3:, :3], matrix[3:, 3:])
    close = {"rtol": 0, "atol": 1e-11}
    np.testing.assert_allclose(
        np.concatenate(axial.force_to_parent(force[:3], force[3:])).astype(float), x @ force, **close
    )
    carried = np.concatenate(axial.acceleration_to_body(acceleration[:3], acceleration[3:])).astype(float)
    np.testing.assert_allclose(carried, x.T @ acceleration, **close)
    np.testing.assert_allclose(dense(axial.inertia_to_parent(inertia)), x @ matrix @ x.T, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", ["puma560", "lwa4p", "panda"])
def test_denavit_hartenberg_takes_two_axes(name):
    """Aligned frames need no turn about the parent's z, and right angles no arithmetic."""
    from armwright.model.simplify import aligned_frames

    model = aligned_frames(arm(name))
    for body, motion in zip(model.bodies, joint_motions(model, np.full(model.n, 0.3)), strict=True):
        axial = AxialMotion(body, motion, 0.3)
        assert len([turn for turn in axial.turns if turn[0] == 2]) == 1
        assert axial.shift[1] == 0.0

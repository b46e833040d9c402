"""Angles and quaternions of a rotation are those that make it again."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from armwright.spatial import roll_pitch_yaw, rotation_quaternion, rotation_rpy

NEAR = [0.0, 1e-17, 1e-12, 1e-9, 1e-6, 1e-3]
angles = st.floats(-np.pi, np.pi) | st.sampled_from([k * np.pi / 2 + e for k in range(-2, 3) for e in NEAR])
rotations = st.tuples(angles, angles, angles).map(lambda rpy: rotation_rpy(*rpy))


@given(rotation=rotations)
def test_roll_pitch_yaw_make_the_rotation_again(rotation):
    """Also where roll and yaw turn about one axis."""
    # it snaps at 1e-12
    np.testing.assert_allclose(rotation_rpy(*roll_pitch_yaw(rotation)), rotation, rtol=0, atol=3e-12)
    np.testing.assert_allclose(Rotation.from_euler("xyz", roll_pitch_yaw(rotation)).as_matrix(), rotation, atol=3e-12)


@given(rotation=rotations)
def test_the_quaternion_makes_the_rotation_again(rotation):
    w, x, y, z = rotation_quaternion(rotation)
    assert w * w + x * x + y * y + z * z == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), rotation, rtol=0, atol=3e-12)

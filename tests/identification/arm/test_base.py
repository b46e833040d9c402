"""Base parameters of arms whose files round their angles."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.identification.arm.base import base_parameters, regrouped_further
from armwright.identification.arm.torque_model import random_states, torque_model

ORIGINS = ("0 0 0.25", "0.06 0 0.1", "0.42 0 0", "0.35 0 0.02")
AXES = ("0 0 1", "0 0 1", "0 0 1", "0 1 0")


def base_of(folder, right_angle):
    """Base parameters of a URDF of four joints, kinematics alone, with such right angles."""
    text = '<robot name="quad"><link name="link0"/>'
    for k, (xyz, axis, turn) in enumerate(zip(ORIGINS, AXES, (0, 1, 0, -1), strict=True), start=1):
        text += f'<link name="link{k}"/><joint name="joint{k}" type="continuous"><parent link="link{k - 1}"/>'
        text += (
            f'<child link="link{k}"/><origin xyz="{xyz}" rpy="{turn * right_angle} 0 0"/><axis xyz="{axis}"/></joint>'
        )
    path = folder / "quad.urdf"
    path.write_text(text + "</robot>")
    return base_parameters(torque_model(aw.load(path, kinematics_only=True)))


@pytest.mark.parametrize("right_angle", [1.5708, 1.57079])
def test_a_rounded_right_angle_changes_no_base_parameter(tmp_path, right_angle):
    """Else the rotor of joint 2 and its link's inertia would be told apart, by parts in a million."""
    exact, rounded = base_of(tmp_path, np.pi / 2), base_of(tmp_path, right_angle)
    assert len(exact) == 36
    np.testing.assert_array_equal(rounded.independent, exact.independent)
    np.testing.assert_allclose(rounded.regroup, exact.regroup, atol=1e-4)


def test_columns_of_a_rounded_half_turn_are_none(tmp_path):
    """A slide that hangs by rpy 3.14159: products of inertia of the tool behind it would have torques of parts in a million."""
    text = '<robot name="scara"><link name="link0"/>'
    for k, (xyz, turn, kind) in enumerate(
        (
            ("0 0 0.3", 0, "revolute"),
            ("0.35 0 0", 0, "revolute"),
            ("0.3 0 0", 3.14159, "prismatic"),
            ("0 0 0.05", 0, "revolute"),
        ),
        start=1,
    ):
        text += f'<link name="link{k}"/><joint name="joint{k}" type="{kind}"><parent link="link{k - 1}"/><child link="link{k}"/>'
        text += f'<origin xyz="{xyz}" rpy="{turn} 0 0"/><axis xyz="0 0 1"/>'
        text += '<limit lower="-1" upper="1" velocity="1" effort="9"/></joint>'
    path = tmp_path / "scara.urdf"
    path.write_text(text + "</robot>")
    base = base_parameters(torque_model(aw.load(path, kinematics_only=True)))
    assert not {"Ixz4", "Iyz4", "Ixx4"} & {base.columns[k].name for k in base.independent}
    assert len(base) == 22


def test_a_motion_regroups_the_structure_further(tmp_path):
    """Joint 4 rests: its link's inertia about its axis moves no torque; what the log's rows give is the structure, regrouped."""
    structural = base_of(tmp_path, 1.5708)
    model = torque_model(aw.load(tmp_path / "quad.urdf", kinematics_only=True))
    q, qd, qdd = random_states(model.arm, 300)
    q[:, 3] = 0.4
    qd[:, 3] = qdd[:, 3] = 0.0
    rows = model.rows(q, qd, qdd).reshape(-1, len(model))
    base = regrouped_further(structural, rows)
    assert len(base) < len(structural)
    parameters = np.random.default_rng(0).normal(size=len(model))
    expected = rows @ parameters
    np.testing.assert_allclose(
        rows[:, base.independent] @ base.of(parameters), expected, atol=1e-4 * np.abs(expected).max()
    )
    assert sorted([*base.independent, *base.dependent, *base.absent]) == list(range(len(model)))

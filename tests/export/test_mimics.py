"""Joints that mimic others in TOML, URDF and MJCF, out and in again; the multiplier and offset mean what MuJoCo means."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.description.robot import RevoluteJoint
from armwright.description.urdf import read_urdf
from armwright.description.writer import to_toml
from armwright.errors import DescriptionError
from armwright.export.mjcf import write_mjcf
from armwright.export.urdf import write_urdf
from armwright.model import Model
from description.urdf_files import written
from physics.arms import all_positions, arm, description, projection, random_state

COUPLED = """<mujoco>
<compiler angle="radian"/>
<worldbody><body name="arm" pos="0 0 1">
  <joint name="lift" type="slide" axis="0 0 1" ref="0.3"/>
  <joint name="turn" axis="0 1 0" ref="-0.4"/>
  <geom type="box" size="0.1 0.2 0.1" pos="0.2 0 0"/>
  <body name="finger" pos="0.3 0 0">
    <joint name="bend" axis="0 0.6 0.8" ref="0.2"/>
    <geom type="capsule" size="0.02 0.1" pos="0.1 0 0"/>
    <body name="nail" pos="0.2 0 0"><joint name="slip" type="slide" axis="1 0 0"/><geom size="0.03"/></body>
  </body>
</body></worldbody>
<equality>
  <joint joint1="bend" joint2="turn" polycoef="0.1 -1.5 0 0 0"/>
  <joint joint1="slip" joint2="bend" polycoef="0.02 0.05 0 0 0"/>
</equality>
</mujoco>
"""


def assert_same(one: Model, two: Model) -> None:
    """Same coordinates, same torques, whatever the order of joints."""
    order = [two.names.index(name) for name in one.names]
    for seed in range(3):
        there = np.empty((3, one.n))
        there[:, order] = states = random_state(one, seed)
        ours, theirs = aw.inverse_dynamics(one, *states), aw.inverse_dynamics(two, *there)[order]
        np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-10 * np.abs(ours).max())


def test_toml_keeps_them(tmp_path):
    record = description("gripper")
    (tmp_path / "gripper.toml").write_text(text := to_toml(record), encoding="utf-8")
    again = aw.load(tmp_path / "gripper.toml")
    assert again.description == record
    assert again.description is not None
    assert to_toml(again.description) == text
    assert 'mimic = { joint = "thumb", multiplier = 0.7, offset_rad = -0.4 }' in text
    assert again.provenance("thumb.mimic.multiplier").kind == "definition"


def test_urdf_out_and_in(tmp_path):
    """The drive file has rotors, friction and gear loss of drivers and of followers."""
    write_urdf(description("gripper"), tmp_path / "gripper.urdf")
    assert '<mimic joint="left" multiplier="-1.0" offset="0.01" />' in (tmp_path / "gripper.urdf").read_text()
    assert_same(arm("gripper"), aw.load(tmp_path / "gripper.urdf"))


def test_mjcf_out_and_in(tmp_path):
    pytest.importorskip("mujoco", reason="MJCF is read through MuJoCo: pip install mujoco")
    losses = write_mjcf(description("gripper"), tmp_path / "gripper.xml")
    assert any("follows exactly" in loss and "thumb_tip" in loss for loss in losses)
    plain = arm("gripper").replace(friction=None, efficiency=None)
    back = aw.load(tmp_path / "gripper.xml").replace(friction=None)
    assert_same(plain, back)
    assert any("joints " in loss and "follows another exactly" in loss for loss in back.warnings)


def test_mujocos_constraints_are_ours(tmp_path):
    """Where MuJoCo's constraints are met, ours put the joints; its torques of the free tree, projected, are ours."""
    mujoco = pytest.importorskip("mujoco", reason="MJCF is read through MuJoCo: pip install mujoco")
    path = written(tmp_path, COUPLED, "arm.xml")
    model, ours = mujoco.MjModel.from_xml_path(str(path)), aw.load(path)
    assert ours.names == ["lift", "turn"]
    assert ours.tree.names == ["lift", "turn", "bend", "slip"]
    g, data = projection(ours), mujoco.MjData(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    for seed in range(4):
        q, qd, qdd = random_state(ours, seed)
        data.qpos[:], data.qvel[:], data.qacc[:] = all_positions(ours, q), g @ qd, g @ qdd
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(
            data.efc_pos[data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)], 0, atol=1e-14
        )
        data.qacc[:] = g @ qdd
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
        mujoco.mj_inverse(model, data)
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
        tau = g.T @ data.qfrc_inverse
        np.testing.assert_allclose(aw.inverse_dynamics(ours, q, qd, qdd), tau, rtol=0, atol=1e-9 * np.abs(tau).max())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "</mujoco>",
            '<actuator><motor name="m" joint="bend"/></actuator></mujoco>',
            "actuator 'm': .*that follows",
        ),
        ("0.1 -1.5 0 0 0", "0.1 -1.5 0 2 0", "polycoef = 0.1 -1.5 0 2 0; expected a line"),
        ("0.1 -1.5 0 0 0", "0.1 0 0 0 0", "expected a line"),
        ('joint2="turn"', 'joint2="slip"', "follows itself"),
        ('<joint joint1="bend"', '<joint active="false" joint1="bend"', "equality 'number 0': not active"),
        ('<joint joint1="slip" joint2="bend"', '<joint joint1="slip"', "couples bodies"),
        ('joint1="slip" joint2="bend"', 'joint1="bend" joint2="turn"', "another one moves"),
    ],
)
def test_what_is_no_line_of_one_driven_joint_is_refused(tmp_path, old, new, message):
    pytest.importorskip("mujoco", reason="MJCF is read through MuJoCo: pip install mujoco")
    with pytest.raises(DescriptionError, match=message):
        aw.load(written(tmp_path, COUPLED.replace(old, new), "arm.xml"))


def test_a_urdf_without_numbers_follows_one_to_one(tmp_path):
    """The format's defaults: multiplier 1, offset 0; names stay on both sides."""
    parts = [f'<link name="{name}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
             "</inertial></link>" for name in ("a", "b")]  # fmt: skip
    joints = ('<joint name="the one" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>'
              '<joint name="other" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
              '<mimic joint="the one"/></joint>')  # fmt: skip
    path = written(tmp_path, f'<robot name="r"><link name="base"/>{"".join(parts)}{joints}</robot>', "r.urdf")
    joint = read_urdf(path).joints[1]
    assert isinstance(joint, RevoluteJoint)
    mimic = joint.mimic
    assert mimic is not None
    assert (mimic.joint, float(mimic.multiplier), float(mimic.offset)) == ("the one", 1.0, 0.0)

"""MJCF, against MuJoCo's own dynamics of the same file."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import armwright as aw
from armwright.description.mjcf import read_mjcf
from armwright.errors import DescriptionError
from description.reports import check_report
from description.urdf_files import written
from raises_at import raises_at

mujoco = pytest.importorskip("mujoco", reason="MJCF is read through MuJoCo: pip install mujoco")

ARM = """<mujoco model="arm">
<compiler angle="radian" autolimits="true"/>
<option gravity="0.5 0 -9.5"/>
<default><joint damping="0.4"/></default>
<worldbody>
  <geom type="plane" size="1 1 1"/>
  <body name="pedestal" pos="0 0 1" euler="0 0.3 0">
    <geom type="box" size="0.1 0.1 0.5" mass="20"/>
    <body name="upper" pos="0.1 0 0.2" quat="0.9 0.1 0.3 -0.2">
      <joint name="j1" type="hinge" axis="0.1 1 0.2" pos="0 0.05 0.1" ref="0.2" armature="0.5" range="-2 1"/>
      <joint name="j2" type="hinge" axis="1 0 0" pos="0.03 0 0" damping="0"/>
      <inertial pos="0.1 0 0.05" mass="2" fullinertia="0.02 0.03 0.025 0.001 -0.002 0.003"/>
      <body pos="0.3 0 0">
        <joint name="j 3" type="slide" axis="0 0.6 0.8" ref="-0.1" pos="1 1 1" frictionloss="3" actuatorfrcrange="-40 40"/>
        <geom type="capsule" size="0.03 0.1" pos="0 0 0.1"/>
        <site name="attachment_site" pos="0 0 0.2" euler="0.4 0 0"/>
        <body name="camera" pos="0 0.1 0"><geom type="sphere" size="0.02" mass="0.1"/></body>
      </body>
    </body>
  </body>
</worldbody>
<actuator>
  <motor name="m1" joint="j1" gear="50" ctrlrange="-2 2"/>
  <position name="m2" joint="j2" kp="100" kv="3" forcerange="-7 7"/>
</actuator>
</mujoco>
"""


def theirs(path, q, qd, qdd):
    """Inverse dynamics of MuJoCo without its passive and constraint forces."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.dof_damping[:], model.dof_frictionloss[:], model.jnt_limited[:] = 0, 0, 0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
    mujoco.mj_inverse(model, data)
    return data.qfrc_inverse.copy(), data


def test_the_dynamics_are_mujocos(tmp_path):
    """Several joints of one body, anchors off the origin, references, unnamed bodies, rotated and off-diagonal tensors."""
    path = written(tmp_path, ARM, "arm.xml")
    arm = aw.load(path)
    assert arm.names == ["j1", "j2", "j 3"]
    rng = np.random.default_rng(4)
    for _ in range(5):
        q, qd, qdd = rng.normal(size=(3, 3))
        tau, data = theirs(path, q, qd, qdd)
        ours = aw.inverse_dynamics(arm.replace(friction=None), q, qd, qdd)
        assert np.abs(ours - tau).max() <= 1e-9 * np.abs(tau).max()
        tip = data.site("attachment_site")
        pose = aw.forward_kinematics(arm, q)
        np.testing.assert_allclose(pose[:3, 3], tip.xpos, atol=1e-12)
        np.testing.assert_allclose(pose[:3, :3], tip.xmat.reshape(3, 3), atol=1e-12)


def test_drives(tmp_path):
    """Armature is n² J_m; a motor's limit is gear · ctrlrange; servo gains are the controller's; frictionloss is Coulomb's."""
    path = written(tmp_path, ARM, "arm.xml")
    arm = aw.load(path)
    one, two, three = arm.bodies
    assert one.drive.gear_ratio == 50
    assert one.drive.armature == pytest.approx(0.5, rel=1e-15)
    assert [body.limits.torque for body in arm.bodies] == [100.0, 7.0, 40.0]
    assert one.limits.position == (-2.0, 1.0)
    assert one.friction is not None
    assert one.friction.viscous == 0.4
    assert two.friction is None
    assert three.friction is not None
    assert (three.friction.coulomb_positive, three.friction.coulomb_negative) == (3.0, 3.0)
    assert three.friction.sticks
    assert any("joint 'j2': its servo or activation (gains 100 -100 -3)" in warning for warning in arm.warnings)
    np.testing.assert_array_equal(arm.gravity, [0.5, 0, -9.5])
    smooth = aw.load(path, smoothing=0.02).bodies[2].friction
    assert smooth is not None
    assert (smooth.coulomb_positive, smooth.smoothing) == (3.0, 0.02)
    assert arm.provenance("upper.mass_kg").kind == "import"


def test_friction_in_motion_is_mujocos(tmp_path):
    """Where every joint slides, MuJoCo's constraint of frictionloss is at its bound: its accelerations are ours."""
    path = written(tmp_path, ARM, "arm.xml")
    arm, model = aw.load(path), mujoco.MjModel.from_xml_path(str(path))
    model.jnt_limited[:] = 0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    data, rng = mujoco.MjData(model), np.random.default_rng(5)
    for _ in range(5):
        q, qd, tau = rng.normal(size=(3, 3))
        qd = qd + np.sign(qd)  # not within its soft zone about rest
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, qd, 10.0 * tau
        mujoco.mj_forward(model, data)
        ours = aw.forward_dynamics(arm, q, qd, 10.0 * tau)
        np.testing.assert_allclose(ours, data.qacc, rtol=0, atol=1e-8 * np.abs(ours).max())
        frictionless = aw.forward_dynamics(arm.replace(friction=None), q, qd, 10.0 * tau)
        assert np.abs(frictionless - ours).max() > 0.01 * np.abs(ours).max()


def test_frictionloss_can_be_off(tmp_path):
    text = ARM.replace('gravity="0.5 0 -9.5"/>', 'gravity="0 0 -9"><flag frictionloss="disable"/></option>')
    assert not aw.load(written(tmp_path, text, "arm.xml")).bodies[2].friction.is_dry


def test_gravity_can_be_off(tmp_path):
    text = ARM.replace('gravity="0.5 0 -9.5"/>', 'gravity="0 0 -9"><flag gravity="disable"/></option>')
    np.testing.assert_array_equal(aw.load(written(tmp_path, text, "arm.xml")).gravity, [0, 0, 0])


def test_constraints_can_be_off(tmp_path):
    """A joint that would follow another one moves by itself, as in MuJoCo, where the file's flag switches constraints off."""
    follows = '<equality><joint joint1="j2" joint2="j1" polycoef="0.1 2 0 0 0"/></equality></mujoco>'
    text = ARM.replace("</mujoco>", follows).replace(
        '<position name="m2" joint="j2" kp="100" kv="3" forcerange="-7 7"/>', ""
    )
    assert aw.load(written(tmp_path, text, "arm.xml")).names == ["j1", "j 3"]
    off = text.replace('"0.5 0 -9.5"/>', '"0.5 0 -9.5"><flag equality="disable"/></option>')
    path = written(tmp_path, off, "off.xml")
    q, qd, qdd = np.random.default_rng(2).normal(size=(3, 3))
    ours = aw.inverse_dynamics(aw.load(path).replace(friction=None), q, qd, qdd)
    np.testing.assert_allclose(ours, theirs(path, q, qd, qdd)[0], rtol=1e-9)


@pytest.mark.skipif(not hasattr(mujoco.MjModel, "jnt_springyield"), reason="this MuJoCo has no springs that yield")
def test_springs_that_yield_are_refused(tmp_path):
    """Beyond their yield MuJoCo's springs creep; elastic ones would bring the joint back."""
    text = mjcf("<joint name='j' stiffness='3' springyield='0.1'/>")
    with raises_at(DescriptionError, "joint 'j'", "spring that yields"):
        aw.load(written(tmp_path, text, "a.xml"))


@pytest.mark.skipif(not hasattr(mujoco.MjModel, "actuator_delay"), reason="this MuJoCo has no delays")
def test_a_delay_is_not_left_out_silently(tmp_path):
    text = mjcf(after="<actuator><motor joint='j' delay='0.02' nsample='3'/></actuator>")
    assert any(
        "joint 'j': its delay of 0.02 s is not used" in warning
        for warning in aw.load(written(tmp_path, text, "a.xml")).warnings
    )


BODY = "<body name='b'>{}<geom size='0.1'/></body>"
HINGE = "<joint name='j' type='hinge'/>"


SITES = HINGE + "<site name='a' pos='0 0 0.3'/><geom size='0.1'/></body><body name='c'><site name='b'/>"
BETWEEN = "<site site='a'/><site site='b'/></spatial></tendon>"


def mjcf(joint=HINGE, after="", before=""):
    """One body on one joint."""
    return f"<mujoco>\n{before}<worldbody>{BODY.format(joint)}</worldbody>{after}</mujoco>"


REFUSALS = [  # file and line, place, and some of what the error says
    (mjcf("<freejoint name='f'/>"), "a.xml", "joint 'f'", "a free joint, which is not offered"),
    (mjcf("<joint name='s' type='ball'/>"), "a.xml", "joint 's'", "a ball joint, which is not offered"),
    (mjcf(SITES, after="<tendon><spatial name='t' stiffness='3' damping='1'>" + BETWEEN), "a.xml", "tendon 't'",
     "damping, which is not offered"),
    (mjcf(SITES, after="<tendon><spatial name='t' stiffness='3' springlength='0.1 0.2'>" + BETWEEN), "a.xml", "tendon 't'",
     "slack between 0.1 and 0.2 m, which is not offered"),
    (mjcf(SITES, after="<tendon><spatial name='t' stiffness='3' limited='true' range='0 1'>" + BETWEEN), "a.xml",
     "tendon 't'", "limited, which is not offered"),
    (mjcf(after="<tendon><fixed name='t'><joint joint='j' coef='1'/></fixed></tendon>"), "a.xml", "tendon 't'",
     "couples bodies or joints, which is not offered"),
    (mjcf(after="<equality><joint name='e' joint1='j'/></equality>"), "a.xml", "equality 'e'",
     "couples bodies or joints, which is not offered"),
    (mjcf(before="<option density='1.2'/>"), "a.xml", "<option>", "density, viscosity or wind: fluids are not offered"),
    (mjcf().replace("<body name", "<body gravcomp='1' name"), "a.xml", "body 'b'", "gravcomp, which is not offered"),
    (mjcf(after="<actuator><general name='a' body='b'/></actuator>"), "a.xml", "actuator 'a'", "drives no joint"),
    (mjcf().replace("size=", "sise="), "a.xml", "", "MuJoCo refuses it: XML Error: Schema violation: unrecognized"),
    (mjcf().replace("size='0.1'", "size='-0.1'"), "a.xml", "",
     "MuJoCo refuses it: Error: size 0 must be positive in geom Element"),
    (mjcf(before="<compiler meshdir='../..'/>"), "a.xml:2", "<compiler meshdir>", "leads out of "),
    (mjcf(before="<asset><mesh file='/etc/passwd'/></asset>"), "a.xml:2", "<mesh file>", "leads out of "),
    (mjcf(before="<include file='a.xml'/>"), "a.xml:2", "<include>", "includes itself"),
    (mjcf(before="<include file='b.xml'/>"), "b.xml", "", "no such file"),
    (mjcf(before="<!-- --><asset><hfield name='h' nrow='1000000' ncol='1000000' size='1 1 1 1'/></asset>"), "a.xml:2",
     "<hfield nrow>", "a number of 8192 at most"),
    (mjcf().replace("<worldbody>", "<worldbody><replicate count='1000000000'/>"), "a.xml:2", "<replicate count>",
     "a number of 1000 at most"),
    (mjcf().replace("<worldbody>", "<worldbody><flexcomp/>"), "a.xml:2", "<flexcomp>", "not offered"),
    ('<!DOCTYPE m [<!ENTITY a "b">]>' + mjcf(), "a.xml:1", "", "declares a document type or entities"),
    (mjcf().replace("size='0.1'", "pos='0 nan 0' size='0.1'"), "a.xml:2", "<geom pos>", "finite numbers"),
    (mjcf("<joint name='j' armature='1e300'/>"), "a.xml", "dof_armature", "numbers of a robot, in SI units"),
    ("<mujoco><worldbody/></mujoco>", "a.xml", "joints", "at least one joint"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "line", "place", "words"), REFUSALS)
def test_refusals(tmp_path, text, line, place, words):
    with pytest.raises(DescriptionError) as refused:
        aw.load(written(tmp_path, text, "a.xml"))
    check_report(refused.value, place, words)
    assert refused.value.file == str(tmp_path / line)


def test_includes_are_read(tmp_path):
    written(tmp_path, "<mujocoinclude><option gravity='0 0 -1'/></mujocoinclude>", "b.xml")
    path = written(tmp_path, mjcf(before="<include file='b.xml'/>"), "a.xml")
    np.testing.assert_array_equal(aw.load(path).gravity, [0, 0, -1])


def test_without_mujoco(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(DescriptionError, match=r"pip install armwright\[bench\]"):
        read_mjcf(written(tmp_path, mjcf(), "a.xml"))


DRIVE = """
source = "datasheet"
command = "current"
tip = "camera"
[joints.j1]
motor = { gear_ratio = 50, torque_constant_n_m_per_a = 0.05 }
limits = { current_a = 8.0 }
[joints.j2]
motor = { gear_ratio = 100, rotor_inertia_kg_m2 = 2e-5, torque_constant_n_m_per_a = 0.04 }
friction = { viscous_n_m_s_per_rad = 2.0 }
[joints."j 3"]
motor = { gear_ratio = 400, rotor_inertia_kg_m2 = 0, torque_constant_n_m_per_a = 0.04 }
"""


def test_a_drive_file_beside_it(tmp_path):
    """Its motors, with the armature where it names no rotor inertia; friction and tip in place of the file's."""
    path = written(tmp_path, ARM, "arm.xml")
    written(tmp_path, DRIVE, "arm.drive.toml")
    arm = aw.load(path)
    one, two, three = (body.drive for body in arm.bodies)
    assert (one.gear_ratio, two.gear_ratio, three.gear_ratio, arm.tip) == (50, 100, 400, "camera")
    assert one.armature == pytest.approx(0.5, rel=1e-15)  # n² J_m, as MuJoCo has it
    assert two.armature == pytest.approx(0.2, rel=1e-15)
    assert arm.provenance("j1.motor.rotor_inertia_kg_m2").kind == "import"
    assert arm.provenance("j1.motor.torque_constant_n_m_per_a").kind == "datasheet"
    assert arm.bodies[1].friction is not None
    assert arm.bodies[1].friction.viscous == 2.0
    assert aw.load(path, tip="attachment_site").tip == "attachment_site"
    written(
        tmp_path,
        DRIVE.replace("gear_ratio = 50", "gear_ratio = 60").replace("[joints.j2]", "[joints.j9]"),
        "other.toml",
    )
    with pytest.raises(DescriptionError) as refused:
        aw.load(path, drive=tmp_path / "other.toml")
    places = [(problem.place, problem.line) for problem in refused.value.problems]
    assert places == [("joints.j1.motor.gear_ratio", 6), ("joints.j9", 8)]


def test_an_armature_without_a_gear_is_that_of_the_rotor_behind_the_gear_of_the_drive_file(tmp_path):
    path = written(tmp_path, ARM.replace('gear="50"', ""), "arm.xml")
    motor = "motor = { gear_ratio = 80, torque_constant_n_m_per_a = 0.05 }"
    drive = written(tmp_path, f'source = "datasheet"\n[joints.j1]\n{motor}\n', "j1.toml")
    drive_of_j1 = aw.load(path, drive=drive).bodies[0].drive
    assert (drive_of_j1.gear_ratio, drive_of_j1.armature) == (80, pytest.approx(0.5, rel=1e-15))

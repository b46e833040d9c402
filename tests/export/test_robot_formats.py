"""URDF and MJCF out and in again: the dynamics stay, and what a format cannot hold is listed."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.description import builtin_names, read_description
from armwright.description.database import parse
from armwright.description.robot import MovingJoint, PrismaticJoint, RevoluteJoint, RobotDescription
from armwright.description.urdf import read_urdf
from armwright.description.writer import write_toml
from armwright.errors import OutputError
from armwright.export.mjcf import write_mjcf
from armwright.export.urdf import write_urdf
from armwright.model import Model, build_model
from description.urdf_files import INERTIAL, one_joint, written
from physics.arms import workshop
from reference.random_trees import random_description

TOLERANCE = 1e-9
ARMS = [*builtin_names(), "examples/scara.toml"]


def states(arm: Model, seed: int = 0) -> np.ndarray:
    """(3 states, 3, n): q, qd, qdd."""
    return np.random.default_rng(seed).normal(size=(3, 3, arm.n))


def assert_same_arm(one: Model, two: Model, *, tip: bool = True) -> None:
    """Same joints, same inverse dynamics, same tip."""
    assert one.names == two.names
    for q, qd, qdd in states(one):
        ours, theirs = aw.inverse_dynamics(one, q, qd, qdd), aw.inverse_dynamics(two, q, qd, qdd)
        assert np.abs(ours - theirs).max() <= TOLERANCE * np.abs(ours).max()
        if tip:
            np.testing.assert_allclose(aw.forward_kinematics(one, q), aw.forward_kinematics(two, q), atol=1e-12)


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", ARMS)
def test_toml_urdf_toml(tmp_path, name):
    """With the drive file nothing of the dynamics is lost: friction, rotors, gear loss, gravity, limits, tip."""
    arm = aw.load(name)
    assert arm.description is not None
    losses = write_urdf(arm.description, tmp_path / "arm.urdf")
    back = aw.load(tmp_path / "arm.urdf", on_impossible="warn")
    write_toml(back.description, tmp_path / "arm.toml")
    again = aw.load(tmp_path / "arm.toml", on_impossible="warn")
    for other in (back, again):
        assert_same_arm(arm, other)
        for one, two in zip(arm.bodies, other.bodies, strict=True):
            assert one.limits.__dict__ == two.limits.__dict__
            assert one.drive.bridge.__dict__ == two.drive.bridge.__dict__
            loops = [None if each.drive.firmware is None else each.drive.firmware.__dict__ for each in (one, two)]
            assert loops[0] == loops[1]
    assert any("the sources of" in loss for loss in losses)
    assert any("motors with their rotor inertia" in loss for loss in losses) == any(
        getattr(joint, "motor", None) is not None for joint in arm.description.joints
    )


@pytest.mark.parametrize("seed", range(12))
def test_random_trees(tmp_path, seed):
    """Every placement of joints, every kind, branches."""
    description = random_description(seed)
    arm = build_model(description)
    write_urdf(description, tmp_path / "arm.urdf")
    assert_same_arm(arm, aw.load(tmp_path / "arm.urdf"), tip=arm.tip is not None)
    pytest.importorskip("mujoco", reason="MJCF is read through MuJoCo: pip install mujoco")
    write_mjcf(description, tmp_path / "arm.xml")
    plain = arm.replace(friction=None, efficiency=None)
    back = aw.load(tmp_path / "arm.xml").replace(friction=None, efficiency=None)
    assert sorted(back.names) == sorted(plain.names)
    order = [back.names.index(name) for name in plain.names]  # MuJoCo numbers joints by the nesting of its XML
    for q, qd, qdd in states(plain, seed):
        there = np.empty((3, plain.n))
        there[:, order] = q, qd, qdd
        ours, theirs = aw.inverse_dynamics(plain, q, qd, qdd), aw.inverse_dynamics(back, *there)[order]
        assert np.abs(ours - theirs).max() <= TOLERANCE * np.abs(ours).max()


@pytest.mark.parametrize("name", [name for name in ARMS if name != "puma560"])
def test_mjcf_has_our_dynamics_in_mujoco(tmp_path, name):
    """MuJoCo itself, on the file: rotors in, friction out."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is the oracle here: pip install mujoco")
    arm = aw.load(name)
    assert arm.description is not None
    losses = write_mjcf(arm.description, tmp_path / "arm.xml")
    assert any("the sources of" in loss for loss in losses)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    damping = [0.0 if body.friction is None else body.friction.viscous for body in arm.bodies]
    np.testing.assert_allclose(model.dof_damping, damping, rtol=1e-15)
    model.dof_damping[:], model.dof_frictionloss[:], model.jnt_limited[:] = 0, 0, 0
    data, plain = mujoco.MjData(model), arm.replace(friction=None, efficiency=None)
    for q, qd, qdd in states(arm):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
        mujoco.mj_inverse(model, data)
        ours = aw.inverse_dynamics(plain, q, qd, qdd)
        assert np.abs(ours - data.qfrc_inverse).max() <= TOLERANCE * np.abs(ours).max()
        np.testing.assert_allclose(aw.forward_kinematics(arm, q)[:3, 3], data.site("tip").xpos, atol=1e-12)


def test_what_mujoco_will_refuse_is_listed(tmp_path):
    description = read_description("puma560")
    losses = write_mjcf(description, tmp_path / "arm.xml")
    assert "MuJoCo will not read the file, as it refuses an inertia that no body has: links link1, link3" in losses


def test_without_the_drive_file(tmp_path):
    """What then is gone is listed without (kept …); the URDF alone has viscous and, smoothed again, dry friction."""
    arm = aw.load("lwa4p")
    losses = write_urdf(arm.description, tmp_path / "arm.urdf", drive=False)
    assert [entry.name for entry in tmp_path.iterdir()] == ["arm.urdf"]
    assert not any("kept" in loss for loss in losses)
    for what in (
        "motors with their rotor inertia: joints joint1",
        "electrical constants",
        "gravity",
        "smooths dry friction",
    ):
        assert any(what in loss for loss in losses)
    back = aw.load(tmp_path / "arm.urdf", smoothing=0.01)
    assert_same_arm(arm.replace(rotors=None), back.replace(gravity=arm.gravity), tip=False)


def test_dry_friction_without_a_smoothing_speed_survives(tmp_path):
    """Coulomb friction goes to URDF and MJCF and comes back as it was; nothing of it is listed as lost."""
    description = read_description("lwa4p")
    frictions = [(joint, getattr(joint, "friction", None)) for joint in description.joints]
    joints = tuple(
        joint.replace(friction=f.replace(smoothing_rad_per_s=None)) for joint, f in frictions if f is not None
    )
    assert len(joints) == len(frictions)
    description = description.replace(joints=joints)
    ours = [body.friction for body in build_model(description).bodies]
    lost = [
        *write_urdf(description, tmp_path / "arm.urdf", drive=False),
        *write_mjcf(description, tmp_path / "arm.xml"),
    ]
    assert not any("friction" in sentence for sentence in lost)
    for name in ("arm.urdf", "arm.xml"):
        for one, two in zip(ours, aw.load(tmp_path / name).bodies, strict=True):
            assert one is not None
            assert two.friction is not None
            assert two.friction.sticks
            assert vars(two.friction) == vars(one)


def test_friction_that_neither_holds_is_listed(tmp_path):
    for name, what in (("panda", "friction by the law 'sigmoid'"), ("puma560", "that friction is the motor's")):
        description = read_description(name)
        assert any(what in loss for loss in write_urdf(description, tmp_path / "arm.urdf"))
        assert any(what in loss for loss in write_mjcf(description, tmp_path / "arm.xml"))


def motor_side(joint: MovingJoint, **friction: float) -> MovingJoint:
    """The joint with friction of its motor."""
    return joint.replace(friction={"source": "estimate", "side": "motor", **friction})


def test_friction_of_a_motor_is_written_for_its_joint(tmp_path):
    """Damping n² b and dry friction |n| c, read by Pinocchio and MuJoCo; a negative ratio turns no sign."""
    puma = read_description("puma560")
    description = read_description("lwa4p")
    levels = {"viscous_n_m_s_per_rad": 2e-4, "coulomb_positive_n_m": 0.03, "coulomb_negative_n_m": 0.01}
    joints = [motor_side(joint, **levels, smoothing_rad_per_s=1.0) for joint in description.joints]
    first = joints[0].motor
    assert first is not None
    joints[0] = joints[0].replace(motor=first.replace(gear_ratio={"value": -120.0, "source": "estimate"}))
    description = description.replace(joints=tuple(joints))
    ratios = np.array([float(joint.motor.gear_ratio) for joint in joints])
    assert ratios[0] == -120.0
    viscous, dry = 2e-4 * ratios**2, 0.02 * np.abs(ratios)
    losses = write_urdf(description, tmp_path / "arm.urdf", drive=False), write_mjcf(description, tmp_path / "arm.xml")
    for lost in losses:
        assert any(sentence.startswith("that friction is the motor's (written as the joint's") for sentence in lost)
        assert any(
            sentence.startswith("dry friction that differs by direction (the mean is written)") for sentence in lost
        )
    back = aw.load(tmp_path / "arm.urdf", smoothing=0.01)
    np.testing.assert_allclose([body.friction.viscous for body in back.bodies], viscous, rtol=1e-14)
    np.testing.assert_allclose([body.friction.coulomb_positive for body in back.bodies], dry, rtol=1e-14)
    write_urdf(puma, tmp_path / "puma.urdf", drive=False)
    arm = aw.load("puma560")
    again = aw.load(tmp_path / "puma.urdf", smoothing=0.01, on_impossible="warn")
    for one, two in zip(arm.bodies, again.bodies, strict=True):
        assert two.friction.viscous == pytest.approx(one.friction.viscous, rel=1e-14)
        assert two.friction.coulomb_negative == pytest.approx(
            0.5 * (one.friction.coulomb_positive + one.friction.coulomb_negative), rel=1e-14
        )
    pinocchio = pytest.importorskip("pinocchio", exc_type=ImportError)
    model = pinocchio.buildModelFromUrdf(str(tmp_path / "arm.urdf"))
    for name, v, d in zip(arm_names(description), viscous, dry, strict=True):
        k = model.joints[model.getJointId(name)].idx_v
        assert (model.damping[k], model.friction[k]) == pytest.approx((v, d), rel=1e-14)
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is an oracle here: pip install mujoco")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    np.testing.assert_allclose(model.dof_damping, viscous, rtol=1e-14)
    np.testing.assert_allclose(model.dof_frictionloss, dry, rtol=1e-14)


def arm_names(description: RobotDescription) -> list[str]:
    """Names of the joints that move."""
    return [joint.name for joint in description.joints if joint.type != "fixed"]


def test_friction_of_a_coupled_motor_is_listed(tmp_path):
    """It is felt at several joints, which neither format can say."""
    description = read_description("lwa4p")
    *others, last = description.joints
    last = motor_side(last, viscous_n_m_s_per_rad=2e-4)
    coupled = last.motor.replace(coupling=({"joint": others[-1].name, "ratio": 10.0, "source": "estimate"},))
    description = description.replace(joints=(*others, last.replace(motor=coupled)))
    for lost in (write_urdf(description, tmp_path / "arm.urdf"), write_mjcf(description, tmp_path / "arm.xml")):
        assert any(sentence.startswith(f"friction of coupled motors: joint {last.name}") for sentence in lost)
    assert (tmp_path / "arm.urdf").read_text().count("<dynamics") == len(others)


@pytest.mark.parametrize(
    ("law", "lost"),
    [("sigmoid", "friction by the law 'sigmoid'"), ("lugre", "the bristles of the friction law 'lugre'")],
)
def test_what_can_be_written_of_other_laws_is(tmp_path, law, lost):
    """Viscous friction of every law, dry friction of LuGre's."""
    description = read_description("lwa4p")
    keys = {"sigmoid_amplitude_n_m": 0.4, "sigmoid_slope_s_per_rad": 5.0, "sigmoid_shift_rad_per_s": 0.0}
    if law == "lugre":
        keys = {"bristle_stiffness_n_m_per_rad": 1e4, "bristle_damping_n_m_s_per_rad": 1.0, "smoothing_rad_per_s": 0.01}
        keys |= {"coulomb_positive_n_m": 3.0, "coulomb_negative_n_m": 3.0}
    record = {"source": "estimate", "law": law, "viscous_n_m_s_per_rad": 0.7, **keys}
    description = description.replace(joints=tuple(joint.replace(friction=record) for joint in description.joints))
    sentences = write_urdf(description, tmp_path / "arm.urdf", drive=False)
    assert any(sentence.startswith(lost) for sentence in sentences)
    for body in aw.load(tmp_path / "arm.urdf", smoothing=0.01).bodies:
        assert (body.friction.viscous, body.friction.coulomb_positive) == (0.7, 3.0 if law == "lugre" else 0.0)


@pytest.mark.parametrize("known", [(), ("torque_n_m",), ("velocity_rad_per_s",)])
def test_unknown_limits_are_not_written_as_zero(tmp_path, known):
    """No joint can move within effort or velocity limits of 0: Pinocchio and we read back what is known, and no bound else."""
    description = read_description("lwa4p")
    keys = ("position_rad", "torque_n_m", "velocity_rad_per_s")
    values = {"position_rad": (-1.0, 2.0), "torque_n_m": 7.0, "velocity_rad_per_s": 3.0}
    limits = {key: {"value": values[key], "source": "estimate"} for key in keys if key == keys[0] or key in known}
    description = description.replace(joints=tuple(joint.replace(limits=limits) for joint in description.joints))
    losses = write_urdf(description, tmp_path / "arm.urdf", drive=False)
    for key, name in zip(keys[1:], ("effort", "velocity"), strict=True):
        unknown = any(sentence.startswith(f"that no {name} limit is known (written as 1e+09,") for sentence in losses)
        assert unknown == (key not in known)
    for body in aw.load(tmp_path / "arm.urdf", smoothing=0.01).bodies:
        assert body.limits.position == (-1.0, 2.0)
        assert body.limits.torque == (7.0 if "torque_n_m" in known else np.inf)
        assert body.limits.velocity == (3.0 if "velocity_rad_per_s" in known else np.inf)
    pinocchio = pytest.importorskip("pinocchio", exc_type=ImportError)
    model = pinocchio.buildModelFromUrdf(str(tmp_path / "arm.urdf"))
    assert set(model.effortLimit) == {7.0 if "torque_n_m" in known else 1e9}
    assert set(model.velocityLimit) == {3.0 if "velocity_rad_per_s" in known else 1e9}


@pytest.mark.parametrize("drive", [True, False])
def test_a_slide_without_limits_comes_back_without(tmp_path, drive):
    description = parse(workshop(), "workshop")
    joints = tuple(
        joint.replace(limits=joint.limits.replace(position_m=None)) if isinstance(joint, PrismaticJoint) else joint
        for joint in description.joints
    )
    losses = write_urdf(description.replace(joints=joints), tmp_path / "arm.urdf", drive=drive)
    assert any(sentence.startswith("position limits, which are not known (written as ±1e+09 m)") for sentence in losses)
    slides = [j for j in read_urdf(tmp_path / "arm.urdf").joints if isinstance(j, PrismaticJoint)]
    assert slides
    assert all(joint.limits.position_m is None for joint in slides)
    assert any("read as unknown" in warning for warning in aw.load(tmp_path / "arm.urdf").warnings)


def test_the_drive_file_keeps_what_no_other_format_knows(tmp_path):
    """A gear that gives way, stops, a current loop, accelerations: in the drive file, and listed as lost in the others."""
    description = read_description("lwa4p")
    first, *others = description.joints
    assert isinstance(first, RevoluteJoint)
    assert first.motor is not None
    elasticity = {"stiffness_n_m_per_rad": 1e4, "damping_n_m_s_per_rad": {"value": 5.0, "source": "estimate"}}
    changed = first.replace(
        elasticity=elasticity,
        motor=first.motor.replace(current_loop_hz=800.0, inductance_h=1e-3, resistance_ohm=1.0),
        limits=first.limits.replace(acceleration_rad_per_s2=3.0),
    )
    description = description.replace(joints=(changed, *others))
    losses = write_urdf(description, tmp_path / "arm.urdf"), write_mjcf(description, tmp_path / "arm.xml")
    for found, kept in zip(losses, (" (kept in arm.drive.toml)", ""), strict=True):
        for what in ("elasticity", "current_loop_hz of the motor", "acceleration limits"):
            assert f"{what}: joint joint1{kept}" in found
        assert any(
            sentence.startswith("commands other than torque") and sentence.endswith(f"joint6{kept}")
            for sentence in found
        )
        assert not any("kept" in sentence for sentence in found if "sources" in sentence or "Denavit" in sentence)
        assert not any("coupling" in sentence or "stops" in sentence for sentence in found)
    again = read_urdf(tmp_path / "arm.urdf").joints[0]
    assert isinstance(again, RevoluteJoint)
    assert again.elasticity is not None
    assert again.elasticity.damping_n_m_s_per_rad == changed.elasticity.damping_n_m_s_per_rad
    assert float(again.elasticity.stiffness_n_m_per_rad) == 1e4
    assert again.motor == changed.motor.replace(source="liu")
    assert float(again.limits.acceleration_rad_per_s2) == 3.0


def test_pictures_are_kept(tmp_path):
    """Shapes and colours; a mesh by its path, relative where it is below the file's folder."""
    (tmp_path / "a.stl").write_text("")
    shapes = (
        '<box size="1 2 3"/>',
        '<cylinder radius="0.1" length="2"/>',
        '<sphere radius="0.2"/>',
        '<mesh filename="a.stl"/>',
    )
    red = '<material name="m"><color rgba="1 0 0 1"/></material>'
    visuals = "".join(
        f'<visual><origin xyz="0 0 1" rpy="0.1 0.2 0.3"/><geometry>{shape}</geometry>{red}</visual>' for shape in shapes
    )
    description = read_urdf(written(tmp_path, one_joint(moved=INERTIAL + visuals), "in.urdf"))
    assert not any("picture" in loss for loss in write_urdf(description, tmp_path / "out.urdf"))
    again = read_urdf(tmp_path / "out.urdf")
    assert 'filename="a.stl"' in (tmp_path / "out.urdf").read_text()
    for one, two in zip(description.link("upper").visuals, again.link("upper").visuals, strict=True):
        assert (one.solid, one.colour) == (two.solid, two.colour)
        np.testing.assert_allclose(two.placement().matrix(), one.placement().matrix(), atol=1e-15)
    losses = write_mjcf(description, tmp_path / "out.xml")
    assert "the picture of a mesh: link upper" in losses


def test_a_urdf_in_and_out_keeps_its_digits(tmp_path):
    description = read_urdf(written(tmp_path, one_joint(), "in.urdf"))
    write_urdf(description, tmp_path / "out.urdf")
    again = read_urdf(tmp_path / "out.urdf")
    assert again.joints[0].frame == description.joints[0].frame
    assert again.links == description.links
    assert again.provenance("upper.mass_kg").text == "read from out.urdf, a URDF, which names no sources"
    assert again.provenance("j1.limits.torque_n_m").text == "read from in.urdf, a URDF, which names no sources"


def test_an_axis_of_length_1_keeps_its_digits(tmp_path):
    """Scaled to length 1 once more, the last digit of this one would differ."""
    axis = (-0.9952875748074559, 0.09696722865944372, 0.0)
    description = read_description("two-link")
    joints = [joint.replace(axis=axis) if joint.name == "elbow" else joint for joint in description.joints]
    write_urdf(description.replace(joints=tuple(joints)), tmp_path / "out.urdf")
    assert 'xyz="-0.9952875748074559 0.09696722865944372 0.0"' in (tmp_path / "out.urdf").read_text(encoding="utf-8")


@pytest.mark.parametrize("write", [write_urdf, write_mjcf])
def test_nothing_is_written_halfway(tmp_path, write):
    description = read_description("two-link")
    with pytest.raises(OutputError, match="expected"):
        write(description, tmp_path / "arm.txt")
    with pytest.raises(OutputError, match="no folder"):
        write(description, tmp_path / "none" / ("arm.urdf" if write is write_urdf else "arm.xml"))
    assert list(tmp_path.iterdir()) == []

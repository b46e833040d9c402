"""The drive file: what a URDF cannot say of motors, gears, friction, limits and place."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.description.drive_file import DriveFile, JointDrive
from armwright.description.robot import PrismaticJoint, RevoluteJoint, RobotDescription
from armwright.errors import DescriptionError
from description.reports import check_report
from description.urdf_files import AXIS, INERTIAL, LIMIT, joint, link, one_joint, written
from raises_at import raises_at

REDUCTION = (
    '<transmission name="t"><joint name="j1"/><actuator name="m"><mechanicalReduction>{}</mechanicalReduction>'
    "</actuator></transmission>"
)
MOTOR = "rotor_inertia_kg_m2 = 1e-4, torque_constant_n_m_per_a = 0.05, resistance_ohm = 1.0"
DRIVE = f"""
source = "sheet"
command = "voltage"
gravity_m_s2 = [0.0, 0.0, -9.81]
tip = "upper"

[sources.sheet]
kind = "datasheet"
text = "Motor M"

[joints.j1]
motor = {{ gear_ratio = 100, {MOTOR} }}
friction = {{ viscous_n_m_s_per_rad = 2.0, coulomb_positive_n_m = 1, coulomb_negative_n_m = 1, smoothing_rad_per_s = 0.01 }}
limits = {{ voltage_v = 24, torque_n_m = 7 }}
"""


def test_found_beside_the_urdf(tmp_path):
    """It adds motors, takes the place of the URDF's friction, and of its limits key by key; every number has its source."""
    path = written(tmp_path, one_joint(AXIS + LIMIT + '<dynamics damping="9" friction="9"/>'))
    written(tmp_path, DRIVE, "arm.drive.toml")
    arm = aw.load(path)
    (body,) = arm.bodies
    assert (body.drive.command, body.drive.gear_ratio, body.drive.armature) == ("voltage", 100.0, 1.0)
    assert body.friction is not None
    assert (body.friction.viscous, body.friction.coulomb_positive, body.friction.smoothing) == (2.0, 1.0, 0.01)
    assert (body.limits.voltage, body.limits.torque, body.limits.velocity) == (24.0, 7.0, 2.0)
    assert not arm.warnings
    assert arm.tip == "upper"
    np.testing.assert_array_equal(arm.gravity, [0, 0, -9.81])
    for where, kind in (
        ("j1.motor.gear_ratio", "datasheet"),
        ("j1.limits.voltage_v", "datasheet"),
        ("j1.limits.velocity_rad_per_s", "import"),
        ("gravity_m_s2", "datasheet"),
    ):
        assert arm.provenance(where).kind == kind


def test_a_link_out_of_the_folder_is_not_read(tmp_path):
    """Unless the URDF is a link to the same folder, as in folders that colcon installs by links."""
    (tmp_path / "other").mkdir()
    (tmp_path / "here").mkdir()
    written(tmp_path / "other", DRIVE, "arm.drive.toml")
    path = written(tmp_path / "here", one_joint())
    path.with_name("arm.drive.toml").symlink_to(tmp_path / "other" / "arm.drive.toml")
    with raises_at(DescriptionError, file=path.with_name("arm.drive.toml")):
        aw.load(path)
    assert aw.load(path, drive=tmp_path / "other" / "arm.drive.toml").bodies[0].drive.gear_ratio == 100
    path.rename(tmp_path / "other" / path.name)
    path.symlink_to(tmp_path / "other" / path.name)
    assert aw.load(path).bodies[0].drive.gear_ratio == 100


def test_given_by_name(tmp_path):
    path = written(tmp_path, one_joint())
    other = written(tmp_path, DRIVE, "other.toml")
    assert aw.load(path).bodies[0].drive.command == "torque"
    assert aw.load(path, drive=other).bodies[0].drive.gear_ratio == 100


@pytest.mark.parametrize(("reduction", "own", "ratio"), [("50", "", 50.0), ("1", "gear_ratio = 100,", 100.0)])
def test_gear_ratio_of_the_transmission(tmp_path, reduction, own, ratio):
    """It is used where the drive file has none; 1 is what exporters write who do not know."""
    path = written(tmp_path, one_joint(more=REDUCTION.format(reduction)))
    written(tmp_path, DRIVE.replace("gear_ratio = 100,", own), "arm.drive.toml")
    arm = aw.load(path)
    assert arm.bodies[0].drive.gear_ratio == ratio
    assert arm.provenance("j1.motor.gear_ratio").kind == ("datasheet" if own else "import")


def test_a_reduction_without_a_motor_is_told(tmp_path):
    (warning,) = aw.load(written(tmp_path, one_joint(more=REDUCTION.format("50"))), tip="upper").warnings
    assert warning.startswith("joint 'j1': gear ratio 50 of its transmission is not used")


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("[joints.j1]", "[joints.j7]", "joints.j7", "j1"),
        ("gear_ratio = 100,", "gear_ratio = 60,", "joints.j1.motor.gear_ratio", "50, as in the transmission"),
        ("gear_ratio = 100,", "gear = 100,", "joints.j1.motor.gear", "gear_ratio"),
        ("voltage_v = 24", "voltage_v = -24", "joints.j1.limits.voltage_v", "a number above 0"),
        (
            "smoothing_rad_per_s = 0.01",
            "smoothing_rad_per_s = 0",
            "joints.j1.friction.smoothing_rad_per_s",
            "then sticks",
        ),
        ('source = "sheet"', "", "joints.j1.motor", "has no source"),
        ('source = "sheet"', 'source = "sheat"', "gravity_m_s2 source", "sheet"),
        ("command =", "comand =", "comand", "command"),
        ("source =", "source", "", "not TOML"),
        ('tip = "upper"', 'tip = "uper"', "tip", "upper"),
    ],
)
def test_refusals(tmp_path, old, new, place, words):
    ratio = "50" if "50" in words else "100"
    path = written(tmp_path, one_joint(more=REDUCTION.format(ratio)))
    assert old in DRIVE
    written(tmp_path, DRIVE.replace(old, new, 1), "arm.drive.toml")
    with pytest.raises(DescriptionError) as refused:
        aw.load(path)
    check_report(refused.value, place, words)


def test_a_slide(tmp_path):
    """Friction of a slide is in N, or its motor's in N m."""
    path = written(tmp_path, one_joint(kind="prismatic"))
    text = DRIVE[: DRIVE.index("friction =")]
    written(tmp_path, text + "friction = { viscous_n_s_per_m = 3 }", "arm.drive.toml")
    body = aw.load(path).bodies[0]
    assert body.friction is not None
    assert body.friction.viscous == 3
    written(tmp_path, text + 'friction = { side = "motor", viscous_n_m_s_per_rad = 1e-4 }', "arm.drive.toml")
    body = aw.load(path).bodies[0]
    assert body.friction is not None
    assert body.friction.viscous == pytest.approx(1.0)


def test_defaults_of_all_joints(tmp_path):
    """They stand below a joint's own keys, and go into joints that the file does not name; a typo is named."""
    second = link("tip", INERTIAL) + joint("j2", "upper", "tip", AXIS + LIMIT)
    path = written(tmp_path, one_joint(more=second))
    text = (
        DRIVE[: DRIVE.index("[joints.j1]")]
        + f"""
[defaults.motor]
gear_ratio = 100
{MOTOR.replace(", ", chr(10))}
[joints.j1]
motor = {{ gear_ratio = 50 }}
"""
    )
    written(tmp_path, text, "arm.drive.toml")
    first, other = (each.motor for each in aw.load(path, on_impossible="warn").record.joints)
    assert (first.gear_ratio.value, other.gear_ratio.value) == (50.0, 100.0)
    assert first.resistance_ohm == other.resistance_ohm
    written(tmp_path, text.replace("[defaults.motor]\ngear_ratio", "[defaults.motor]\ngear_ratoi"), "arm.drive.toml")
    with raises_at(DescriptionError, "defaults.motor.gear_ratoi", r"gear_ratio\?", value=100):
        aw.load(path)


def test_it_can_say_all_that_a_robot_file_says_of_drives():
    """Whatever a joint may have beside its place, and a robot beside its tree."""
    placed = {"name", "parent", "child", "frame", "type", "dh", "modified_dh", "axis", "mimic"}
    for each in (RevoluteJoint, PrismaticJoint):
        assert set(each.model_fields) - placed == set(JointDrive.model_fields)
    urdf = {"name", "title", "notes", "base", "built_from", "fits", "remarks", "without_masses", "links", "frames"}
    assert set(RobotDescription.model_fields) - urdf == set(DriveFile.model_fields)


def test_stops_and_brakes(tmp_path):
    """What no other format knows goes through as in a robot file, and is refused as there."""
    path = written(tmp_path, one_joint())
    brake = "brake = { holding_torque_n_m = 3.0, nonsense = 1 }"
    written(tmp_path, f"{DRIVE}{brake}", "arm.drive.toml")
    with raises_at(DescriptionError, "joint 'j1' brake.nonsense", file=f"{path} with its drive file"):
        aw.load(path)

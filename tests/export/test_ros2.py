"""`export ros2`: its URDF and YAML read by other parsers, and the arm that comes back from them."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.description import builtin_names
from armwright.errors import ModelError, OutputError
from raises_at import raises_at

yaml = pytest.importorskip("yaml")


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", [*builtin_names(), "examples/scara.toml"])
def test_limits_are_those_of_the_arm(tmp_path, name):
    arm = aw.load(name)
    exported = aw.export.export_ros2(arm, tmp_path / "ros")
    assert all(path.is_file() for path in exported.paths)
    root = ElementTree.parse(exported.paths[0]).getroot()
    limits = yaml.safe_load((tmp_path / "ros" / "joint_limits.yaml").read_text())["joint_limits"]
    control = {each.attrib["name"]: each for each in root.findall("ros2_control/joint")}
    in_urdf = {each.attrib["name"]: each for each in root.findall("joint")}
    assert list(control) == list(limits) == list(arm.names)
    for body in arm.coordinates:
        own, table, urdf = body.limits, limits[body.joint], in_urdf[body.joint].find("limit")
        interfaces = {each.attrib["name"]: each for each in control[body.joint].findall("command_interface")}
        states = [each.attrib["name"] for each in control[body.joint].findall("state_interface")]
        assert states == list(interfaces) == ["position", "velocity", "effort"]
        pairs = {
            "position": own.position,
            "velocity": (-own.velocity, own.velocity),
            "effort": (-own.torque, own.torque),
        }
        assert table["has_acceleration_limits"] == np.isfinite(own.acceleration)
        for kind, pair in pairs.items():
            pair = pair if np.isfinite(pair).all() else None
            found = {each.attrib["name"]: float(each.text) for each in interfaces[kind].findall("param")}
            assert found == ({} if pair is None else dict(zip(("min", "max"), map(float, pair), strict=True)))
            assert table[f"has_{kind}_limits"] == (pair is not None)
            if pair is not None:
                assert table[f"max_{kind}"] == pair[1]
                assert urdf is not None
                assert float(urdf.attrib[{"position": "upper"}.get(kind, kind)]) == pair[1]


@pytest.mark.parametrize("name", ["puma560", "lwa4p", "cmu-dd", "panda", "examples/scara.toml"])
def test_the_arm_comes_back(tmp_path, name):
    arm = aw.load(name)
    back = aw.load(aw.export.export_ros2(arm, tmp_path).paths[0], on_impossible="warn")
    assert back.names == arm.names
    for q, qd, qdd in np.random.default_rng(0).normal(size=(3, 3, arm.n)):
        ours, theirs = (aw.inverse_dynamics(each, q, qd, qdd) for each in (arm, back))
        np.testing.assert_allclose(theirs, ours, atol=1e-9 * np.abs(ours).max())
        np.testing.assert_allclose(aw.forward_kinematics(back, q), aw.forward_kinematics(arm, q), atol=1e-12)


def test_controllers_name_the_joints_and_the_command(tmp_path):
    arm = aw.load("lwa4p")
    exported = aw.export.export_ros2(arm, tmp_path, command="effort", rate=250, hardware="schunk/Powerball")
    table = yaml.safe_load((tmp_path / "controllers.yaml").read_text())
    manager, own = (table[name]["ros__parameters"] for name in ("controller_manager", "arm_controller"))
    assert manager["update_rate"] == 250
    assert manager["arm_controller"]["type"] == "joint_trajectory_controller/JointTrajectoryController"
    assert own["joints"] == list(arm.names)
    assert own["command_interfaces"] == ["effort"]
    root = ElementTree.parse(exported.paths[0]).getroot()
    assert root.findtext("ros2_control/hardware/plugin") == "schunk/Powerball"


def test_names_of_any_kind_stay_in_the_folder_and_come_back(tmp_path):
    text = (Path(aw.__file__).parent / "robots" / "two-link.toml").read_text()
    for old, new in (("two-link", "../../up: 1"), ("shoulder", "off"), ("elbow", "Ellbogen 🤖")):
        text = text.replace(f'name = "{old}"', f'name = "{new}"')
    (tmp_path / "arm.toml").write_text(text, encoding="utf-8")
    exported = aw.export.export_ros2(aw.load(tmp_path / "arm.toml"), tmp_path / "out")
    assert {path.parent for path in exported.paths} == {tmp_path / "out"}
    assert aw.load(exported.paths[0]).names == ["off", "Ellbogen 🤖"]
    table = yaml.safe_load((tmp_path / "out" / "joint_limits.yaml").read_text(encoding="utf-8"))
    assert list(table["joint_limits"]) == ["off", "Ellbogen 🤖"]


def test_a_mimic_joint_has_states_only(tmp_path):
    urdf = tmp_path / "grip.urdf"
    inertia = "<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"
    link = f"<link name='{{}}'><inertial><mass value='1'/>{inertia}</inertial></link>"
    joint = (
        "<joint name='{}' type='prismatic'><parent link='base'/><child link='{}'/><axis xyz='1 0 0'/>"
        "<limit lower='0.00001' upper='0.04' effort='20' velocity='0.1'/>{}</joint>"
    )
    follows = joint.format("b", "right", "<mimic joint='a'/>")
    urdf.write_text(
        f"<robot name='grip'><link name='base'/>{link.format('left')}{link.format('right')}"
        f"{joint.format('a', 'left', '')}{follows}</robot>"
    )
    exported = aw.export.export_ros2(aw.load(urdf), tmp_path / "ros")
    control = ElementTree.parse(exported.paths[0]).getroot().findall("ros2_control/joint")
    assert [len(each.findall("command_interface")) for each in control] == [3, 0]
    limits = yaml.safe_load((tmp_path / "ros" / "joint_limits.yaml").read_text())["joint_limits"]
    assert limits["a"]["min_position"] == 1e-5  # YAML 1.1 takes 1e-05 for a text
    joints = yaml.safe_load((tmp_path / "ros" / "controllers.yaml").read_text())["arm_controller"]["ros__parameters"]
    assert joints["joints"] == ["a"]


def test_the_command_writes_and_refuses(tmp_path):
    def command(*arguments, code):
        result = CliRunner().invoke(app, ["export", "ros2", *map(str, arguments)])
        assert result.exit_code == code, result.output
        return result.output.strip()

    shown = command("puma560", "-o", tmp_path / "new", code=0)
    names = ["puma560.urdf", "puma560.drive.toml", "joint_limits.yaml", "controllers.yaml"]
    assert [line.split("/")[-1] for line in shown.splitlines()[:4]] == names
    for extra, expected in (
        (("--command-interface", "force"), "--command-interface = 'force': did you mean effort?"),
        (("--update-rate", "0"), "--update-rate = 0: expected a whole number of 1 Hz or more"),
        (("--hardware", ""), "--hardware = '': expected the name of a plugin"),
    ):
        shown = command("puma560", "-o", tmp_path / "other", *extra, code=2)
        assert expected in shown
        assert "\n" not in shown
    assert not (tmp_path / "other").exists()
    (tmp_path / "file").write_text("")
    with raises_at(OutputError, file=tmp_path / "file"):
        aw.export.export_ros2(aw.load("puma560"), tmp_path / "file")
    with pytest.raises(ModelError, match="rate"):
        aw.export.export_ros2(aw.load("puma560"), tmp_path, rate=1.5)

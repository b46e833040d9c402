"""Robot files in other formats and back."""

from __future__ import annotations

import re

import numpy as np
import pytest

import armwright as aw
from armwright.errors import DescriptionError, OutputError
from physics.arms import random_state
from raises_at import raises_at


@pytest.mark.parametrize("name", ["cmu-dd", "lwa4p", "panda", "puma560", "two-link"])
def test_toml_is_byte_stable(name, tmp_path):
    first = aw.robotfiles.convert(name, tmp_path / "first.toml")
    assert all("built from" in note for note in first.lost)
    text = (tmp_path / "first.toml").read_bytes()
    done = aw.robotfiles.convert(tmp_path / "first.toml", tmp_path / "second.toml")
    assert done.lost == ()
    assert (tmp_path / "second.toml").read_bytes() == text


@pytest.mark.parametrize("name", ["cmu-dd", "lwa4p", "panda", "two-link"])
def test_through_urdf_and_back_the_dynamics_stay(name, tmp_path):
    there = aw.robotfiles.convert(name, tmp_path / "arm.urdf")
    assert [path.name for path in there.written] == ["arm.urdf", "arm.drive.toml"]
    assert any("sources of" in note for note in there.lost)
    back = aw.robotfiles.convert(tmp_path / "arm.urdf", tmp_path / "arm.toml")
    assert back.written == (tmp_path / "arm.toml",)
    arm, again = aw.load(name), aw.load(tmp_path / "arm.toml")
    q, qd, qdd = random_state(arm, 1)
    torques = aw.inverse_dynamics(arm, q, qd, qdd)
    np.testing.assert_allclose(aw.inverse_dynamics(again, q, qd, qdd), torques, rtol=1e-9, atol=1e-9)


def test_to_mjcf_and_back(tmp_path):
    pytest.importorskip("mujoco")
    there = aw.robotfiles.convert("panda", tmp_path / "panda.xml")
    assert any("sigmoid" in note for note in there.lost)
    aw.robotfiles.convert(tmp_path / "panda.xml", tmp_path / "panda.toml")
    arm, again = aw.load("panda").replace(friction=None), aw.load(tmp_path / "panda.toml")
    q, qd, qdd = random_state(arm, 1)
    torques = aw.inverse_dynamics(arm, q, qd, qdd)
    np.testing.assert_allclose(aw.inverse_dynamics(again, q, qd, qdd), torques, rtol=1e-9, atol=1e-9)


def test_what_was_left_out_on_reading_is_told(tmp_path):
    aw.robotfiles.convert("two-link", tmp_path / "arm.urdf")
    text = (tmp_path / "arm.urdf").read_text(encoding="utf-8")
    with_mesh = text.replace(
        '<link name="upper_arm">',
        '<link name="upper_arm"><visual><geometry><mesh filename="gone.stl"/></geometry></visual>',
    )
    assert with_mesh != text
    (tmp_path / "arm.urdf").write_text(with_mesh, encoding="utf-8")
    done = aw.robotfiles.convert(tmp_path / "arm.urdf", tmp_path / "a.toml")
    assert any("not on the search path" in note for note in done.notes)


@pytest.mark.parametrize("changed", ["point", "nothing", "puma560", "none"])
def test_what_mujoco_will_not_read_is_told(changed, tmp_path):
    mujoco = pytest.importorskip("mujoco")
    robot = aw.load("puma560" if changed == "puma560" else "two-link").description
    if changed in ("point", "nothing"):
        zero = dict.fromkeys(("xx", "xy", "xz", "yy", "yz", "zz"), 0.0)
        mass = {} if changed == "point" else {"mass_kg": 0.0}
        robot = robot.replace(links=(*robot.links[:-1], robot.links[-1].replace(inertia_kg_m2=zero, **mass)))
    aw.robotfiles.write_toml(robot, tmp_path / "arm.toml")
    lost = aw.robotfiles.convert(tmp_path / "arm.toml", tmp_path / "arm.xml").lost
    assert any("MuJoCo will not read the file" in note for note in lost) == (changed != "none")
    if changed == "none":
        mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    else:
        with pytest.raises(ValueError, match=r"inertia|mass"):
            mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))


def test_a_file_is_not_written_over_itself(tmp_path):
    """Nor is the drive file that goes with it; a link to it is the same file."""
    aw.robotfiles.convert("two-link", tmp_path / "arm.urdf")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    (tmp_path / "arm.xml").write_bytes(before["arm.urdf"])
    (tmp_path / "link.urdf").symlink_to(tmp_path / "arm.urdf")
    aw.robotfiles.convert("two-link", tmp_path / "arm.toml")
    before["arm.toml"] = (tmp_path / "arm.toml").read_bytes()
    pairs = (("arm.urdf", "arm.urdf"), ("arm.urdf", "link.urdf"), ("arm.xml", "arm.urdf"), ("arm.toml", "arm.toml"))
    for source, target in pairs:
        with pytest.raises(OutputError) as caught:
            aw.robotfiles.convert(tmp_path / source, tmp_path / target)
        assert caught.value.what.endswith("that is read")
        assert caught.value.file == str(tmp_path / ("arm.drive.toml" if source == "arm.xml" else target))
    assert {name: (tmp_path / name).read_bytes() for name in before} == before


def test_doubts_are_no_losses(tmp_path):
    aw.robotfiles.convert("two-link", tmp_path / "arm.urdf")
    text = (tmp_path / "arm.urdf").read_text(encoding="utf-8")
    changed = re.sub('<axis xyz="[^"]*"', '<axis xyz="0.0 0.0 3.0"', text)
    (tmp_path / "arm.urdf").write_text(changed, encoding="utf-8")
    done = aw.robotfiles.convert(tmp_path / "arm.urdf", tmp_path / "arm.toml")
    assert done.lost == ()
    assert any("not of length 1" in note for note in done.notes)


def test_refused(tmp_path):
    with pytest.raises(OutputError, match=r"expected \.toml, \.urdf, \.xml or \.mjcf"):
        aw.robotfiles.convert("panda", tmp_path / "panda.stl")
    with raises_at(DescriptionError, "robot", r"panda\?", value="pand"):
        aw.robotfiles.convert("pand", tmp_path / "panda.toml")
    with pytest.raises(DescriptionError, match="unknown option"):
        aw.robotfiles.convert("panda", tmp_path / "panda.toml", smoothing=0.1)
    assert not list(tmp_path.iterdir())


def test_robots_of_ros_leave_meshes_behind_that_are_elsewhere(tmp_path):
    """Meshes stand beside the folder of the URDF: in most folders a TOML cannot name them."""
    package = tmp_path / "robot_description"
    for folder in ("urdf", "meshes"):
        (package / folder).mkdir(parents=True)
    (package / "meshes" / "link.stl").write_text("solid link\nendsolid link\n")
    inertial = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    mesh = '<visual><geometry><mesh filename="package://robot_description/meshes/link.stl"/></geometry></visual>'
    box = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
    source = package / "urdf" / "robot.urdf"
    source.write_text(
        f'<robot name="robot"><link name="base"/><link name="link">{inertial}{mesh}{box}</link><joint name="j" type="continuous">'
        '<parent link="base"/><child link="link"/><axis xyz="0 0 1"/></joint></robot>'
    )
    done = aw.robotfiles.convert(source, tmp_path / "above.toml")
    assert done.lost == ()
    assert "robot_description/meshes/link.stl" in (tmp_path / "above.toml").read_text()
    done = aw.robotfiles.convert(source, package / "urdf" / "beside.toml")
    assert done.lost == (f"1 visual, whose meshes are not below '{package / 'urdf'}'",)
    assert len(aw.load(package / "urdf" / "beside.toml").record.links[-1].visuals) == 1
    estimate = aw.identification.Estimate(
        ("j.friction.viscous_n_m_s_per_rad",), [0.5], [[0.01]], "a" * 64, "by hand", units=("",)
    )
    path = aw.identification.write_into(aw.load(source), estimate, package / "urdf" / "found.toml")
    assert aw.load(path).record.fits["fit"].remarks == (f"left out: {done.lost[0]}",)

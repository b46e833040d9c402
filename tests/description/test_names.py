"""Names of links and joints stay as their file has them: in paths, runs, files and kernels."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.description.paths import path_name, split_path, unit_at
from armwright.errors import DescriptionError, ModelError
from armwright.export.c import write_c
from description.urdf_files import written
from raises_at import raises_at

JOINTS, LINKS = ("joint_0.0", "Rev 2"), ("link 1", "it's.link_m")
INERTIAL = (
    '<inertial><origin xyz="0.1 0 0"/><mass value="1"/>'
    '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>'
)
PARENTS = ("base link", LINKS[0])
URDF = f"""<robot name="an arm v1.2"><link name="base link"/>{
    "".join(
        f'<link name="{link}">{INERTIAL}</link><joint name="{joint}" type="revolute"><parent link="{parent}"/>'
        f'<child link="{link}"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/><dynamics damping="0.5"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="2"/></joint>'
        for link, joint, parent in zip(LINKS, JOINTS, PARENTS, strict=True)
    )
}</robot>"""
DRIVE = """
source = "datasheet"
tip = "link 1"
[joints."joint_0.0"]
motor = { gear_ratio = 50, rotor_inertia_kg_m2 = 1e-5 }
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return written(tmp_path_factory.mktemp("names"), URDF)


@pytest.mark.parametrize("name", ["elbow", "joint_0.0", "Rev 2", "a.b c.d", "it's", "ψ"])
def test_paths_hold_any_name(name):
    path = f"{path_name(name)}.motor.gear_ratio"
    assert split_path(path) == (name, "motor.gear_ratio")
    assert split_path("gravity_m_s2") == ("gravity_m_s2", "")


def test_names_state_no_unit():
    assert unit_at("arm_m.motor.gear_ratio") == "1"
    assert unit_at('"it\'s.link_m".mass_kg') == "kg"
    assert unit_at("gravity_m_s2") == "m/s²"


def test_parameters_of_such_names_vary(path):
    arm = aw.load(path)
    assert (tuple(arm.names), arm.tip) == (JOINTS, LINKS[1])
    names = ['"joint_0.0".friction.viscous_n_m_s_per_rad', '"it\'s.link_m".mass_kg', '"link 1".com_m']
    assert {*names[:2], f"{names[2]}[2]"} <= set(arm.parameters.names)
    dyn = aw.compile(arm, vary=names)
    values = np.array([0.7, 2.0, 0.1, 0.2, 0.3])
    assert arm.provenance(names[1]).kind == "import"
    q, qd, qdd = np.array([[0.1, 0.2], [0.3, -0.4], [0.5, 0.6]])
    plain = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    nominal = dyn.inverse_dynamics(q, qd, qdd, np.array([0.5, 1.0, 0.1, 0.0, 0.0]))
    np.testing.assert_allclose(nominal, plain, rtol=1e-12)
    more = dyn.inverse_dynamics(q, qd, qdd, np.array([0.7, 1.0, 0.1, 0.0, 0.0])) - plain
    np.testing.assert_allclose(more, [0.2 * qd[0], 0.0], atol=1e-12)
    assert not np.allclose(dyn.inverse_dynamics(q, qd, qdd, values), plain)
    with raises_at(ModelError, "vary", r'"joint_0\.0", "Rev 2", "link 1", "it\'s\.link_m"'):
        aw.compile(arm, vary=["joint_0.0.friction.viscous_n_m_s_per_rad"])


def test_numbers_of_such_names_are_replaced(path):
    """What `with_values` changes is what a kernel takes as an input, for every number of the arm's dynamics."""
    arm = aw.load(path)
    q, qd, qdd = np.array([[0.1, 0.2], [0.3, -0.4], [0.5, 0.6]])
    for name, value in {
        '"joint_0.0".friction.viscous_n_m_s_per_rad': 0.7, '"it\'s.link_m".mass_kg': 2.0, '"link 1".com_m[2]': 0.05,
    }.items():  # fmt: skip
        changed = aw.inverse_dynamics(arm.with_values({name: value}), q, qd, qdd)
        expected = aw.compile(arm, vary=[name]).inverse_dynamics(q, qd, qdd, np.array([value]))
        np.testing.assert_allclose(changed, expected, rtol=1e-12)
        assert np.abs(changed - aw.inverse_dynamics(arm, q, qd, qdd)).max() > 0.01
    with pytest.raises(DescriptionError, match=r'with_values: "link 1"\.mass_kg'):
        arm.with_values({'"link 1".mass_kg': -1.0})


def test_runs_and_files_keep_them(path, tmp_path):
    arm = aw.load(path)
    run = aw.simulate(aw.Scenario(arm, 0.003, [0.0, 0.0]))
    assert tuple(run["joint"].values) == JOINTS
    for ending in (".nc", ".csv"):
        aw.save(run, tmp_path / f"run{ending}")
    assert tuple(aw.load_run(tmp_path / "run.nc")["joint"].values) == JOINTS
    assert "q_joint_0.0 [rad],q_Rev 2 [rad]" in (tmp_path / "run.csv").read_text(encoding="utf-8")
    aw.robotfiles.convert(path, tmp_path / "arm.toml")
    aw.robotfiles.convert(tmp_path / "arm.toml", tmp_path / "back.urdf")
    for name in ("arm.toml", "back.urdf"):
        again = aw.load(tmp_path / name)
        assert (tuple(again.names), again.tip) == (JOINTS, LINKS[1])
    assert not aw.robotfiles.diff(path, tmp_path / "arm.toml").changes


def test_exported_c_has_identifiers(path, tmp_path):
    functions = ["inverse_dynamics", "forward_kinematics:frame=it's.link_m"]
    files = write_c(aw.load(path), functions, tmp_path)
    assert [file.name for file in files][:2] == ["an_arm_v1_2.h", "an_arm_v1_2.c"]
    assert "an_arm_v1_2_forward_kinematics_it_s_link_m(" in files[0].read_text(encoding="ascii")


def test_drives_and_lines_are_found_by_them(path, tmp_path):
    (tmp_path / "arm.drive.toml").write_text(DRIVE, encoding="utf-8")
    arm = aw.load(path, drive=tmp_path / "arm.drive.toml")
    assert (arm.bodies[0].drive.gear_ratio, arm.tip) == (50, "link 1")
    aw.robotfiles.convert(path, tmp_path / "arm.toml")
    text = (
        (tmp_path / "arm.toml").read_text(encoding="utf-8").replace("viscous_n_m_s_per_rad = 0.5", "viscous = 0.5", 1)
    )
    (tmp_path / "arm.toml").write_text(text, encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"joint 'joint_0\.0' friction\.viscous = 0\.5") as refused:
        aw.load(tmp_path / "arm.toml")
    assert text.split("\n")[int(refused.value.problems[0].line) - 1].startswith("viscous = 0.5")

"""Default tables of a robot file give the same robot as the same tables in each joint; mistakes are named where they stand."""

from __future__ import annotations

import re

import pytest

import armwright as aw
from armwright.description.robot import RobotDescription
from armwright.errors import TO_FILL_IN, DescriptionError

HEAD = """name = "arm"
source = "estimate"
command = "current"

[sources.sheet]
kind = "datasheet"
text = "RD 50/08, 2021"
"""
MOTOR = """
[{where}.motor]
source = "sheet"
gear_ratio = 50
rotor_inertia_kg_m2 = { value = 1e-5, std = 1e-6 }
torque_constant_n_m_per_a = 0.05
basis = "dc"
"""
FRICTION = """
[{where}.friction]
viscous_n_m_s_per_rad = 0.5
coulomb_positive_n_m = 0.2
coulomb_negative_n_m = 0.3
"""


def joint(k: int, kind: str = "revolute", more: str = "", tables: str = "") -> str:
    parent = "base" if k == 1 else f"link{k - 1}"
    return f"""
[[joints]]
name = "joint{k}"
type = "{kind}"
parent = "{parent}"
child = "link{k}"
frame = {{ xyz_m = [0, 0, 0.2], rpy_rad = [0, 0, 0] }}
axis = [0, 1, 0]
{more}
{tables}
[[links]]
name = "link{k}"
mass_kg = 2
com_m = [0, 0, 0.1]
inertia_kg_m2 = {{ xx = 0.01, xy = 0, xz = 0, yy = 0.01, yz = 0, zz = 0.01 }}
"""


def filled(table: str, where: str) -> str:
    return table.replace("{where}", where)


DEFAULTS = filled(MOTOR, "defaults") + filled(FRICTION, "defaults")
IN_JOINT = filled(MOTOR, "joints") + filled(FRICTION, "joints")


def load(tmp_path, *parts):
    path = tmp_path / "arm.toml"
    path.write_text("".join((HEAD, *parts)), encoding="utf-8")
    return aw.load(path).description


def refused(tmp_path, *parts):
    with pytest.raises(DescriptionError) as found:
        load(tmp_path, *parts)
    return found.value


def test_they_are_the_same_as_tables_in_each_joint(tmp_path):
    short = load(tmp_path, DEFAULTS, joint(1), joint(2))
    assert short == load(tmp_path, joint(1, tables=IN_JOINT), joint(2, tables=IN_JOINT))
    assert aw.load(tmp_path / "arm.toml").description == short
    written = aw.robotfiles.to_toml(short)
    assert "defaults" not in written
    assert written.count("gear_ratio = 50") == 2


def test_a_joints_own_keys_stand_before_them_and_every_number_keeps_its_source(tmp_path):
    own = '[joints.motor]\nsource = "definition"\ngear_ratio = 80\n'
    robot = load(tmp_path, DEFAULTS, joint(1, tables=own), joint(2, more='source = "definition"'))
    assert [float(each.motor.gear_ratio) for each in robot.moving_joints] == [80, 50]
    for path, kind in {
        "joint1.motor.gear_ratio": "definition",
        "joint1.motor.rotor_inertia_kg_m2": "datasheet",
        "joint1.motor.torque_constant_n_m_per_a": "datasheet",
        "joint1.friction.viscous_n_m_s_per_rad": "estimate",
        "joint2.friction.viscous_n_m_s_per_rad": "estimate",  # the file's, not that joint's
        "joint2.motor.gear_ratio": "datasheet",
    }.items():
        assert robot.provenance(path).kind == kind, path
    assert robot.moving_joints[0].motor.rotor_inertia_kg_m2.std == 1e-6


def test_what_says_otherwise_takes_none(tmp_path):
    law = '[joints.friction]\nlaw = "coulomb"\nviscous_n_m_s_per_rad = 7\n'
    mimic = 'mimic = { joint = "joint1", multiplier = 1, offset_rad = 0 }'
    robot = load(
        tmp_path, DEFAULTS, joint(1, tables=law), joint(2, more=mimic), joint(3, more='servo = "sts3215-7.4v"')
    )
    first, second, third = robot.moving_joints
    assert first.friction.coulomb_positive_n_m is None
    assert (second.motor, second.friction) == (None, None)
    assert float(third.motor.gear_ratio) != 50


def test_mistakes_are_named_where_they_stand(tmp_path):
    wrong = DEFAULTS.replace("gear_ratio", "gear_ration").replace(
        "viscous_n_m_s_per_rad = 0.5", "viscous_n_m_s_per_rad = -1"
    )
    error = refused(tmp_path, wrong, joint(1), joint(2))
    problems = {problem.place: (problem.line, str(problem)) for problem in error.problems}
    assert set(problems) == {"defaults.motor.gear_ration", "defaults.friction.viscous_n_m_s_per_rad"}
    line, text = problems["defaults.motor.gear_ration"]
    assert (HEAD + wrong).split("\n")[int(line) - 1] == "gear_ration = 50"
    assert "did you mean gear_ratio" in text
    assert refused(tmp_path, DEFAULTS.replace(".motor", ".moter"), joint(1)).place == "defaults.moter"
    assert "did you mean defaults" in str(refused(tmp_path, DEFAULTS.replace("defaults", "default"), joint(1)))
    assert refused(tmp_path, "[defaults]\nmotor = 3\n", joint(1)).place == "defaults.motor"


@pytest.mark.parametrize(
    ("line", "key"),
    [
        ("gear_ratio = -50", "gear_ratio"),  # a note of `check`
        ("rotor_inertia_kg_m2 = 5", "rotor_inertia_kg_m2"),  # a warning
    ],
)
def test_a_number_that_only_a_joint_finds_wrong_is_named_at_its_line_in_the_defaults(tmp_path, line, key):
    shared = re.sub(rf"^{key} = .*\n", "", DEFAULTS, flags=re.MULTILINE).replace("]\n", f"]\n{line}\n", 1)
    path = tmp_path / "arm.toml"
    path.write_text(HEAD + shared + joint(1) + joint(2), encoding="utf-8")
    found = aw.robotfiles.check(path).findings
    problems = [each.problem for each in found if each.problem.place.endswith(key)]
    assert problems
    expected = (HEAD + shared).split("\n").index(line) + 1
    assert {problem.line for problem in problems} == {expected}


def test_numbers_that_are_refused_together_are_named_at_their_line_in_the_defaults(tmp_path):
    shared = DEFAULTS.replace("]\n", "]\ninductance_h = 1e-3\n", 1)  # without a resistance
    error = refused(tmp_path, shared, joint(1))
    assert (HEAD + shared).split("\n")[int(error.problems[0].line) - 1] == "inductance_h = 1e-3"


def test_a_joints_own_number_is_named_in_the_joint_beside_defaults(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(HEAD + DEFAULTS + joint(1, tables="[joints.motor]\ngear_ratio = -50\n"), encoding="utf-8")
    (problem,) = (each.problem for each in aw.robotfiles.check(path).findings if "gear_ratio" in each.problem.place)
    assert path.read_text().split("\n")[int(problem.line) - 1] == "gear_ratio = -50"


def test_values_to_fill_in_are_listed_once(tmp_path):
    error = refused(tmp_path, re.sub("gear_ratio = 50", 'gear_ratio = "TODO"', DEFAULTS), joint(1), joint(2))
    assert [(each.what, each.place) for each in error.problems] == [(TO_FILL_IN, "defaults.motor.gear_ratio")]
    assert error.expected.startswith("a number other than 0; Motor radians")


def test_friction_goes_into_joints_of_its_unit(tmp_path):
    error = refused(tmp_path, DEFAULTS, joint(1), joint(2, "prismatic"))
    assert (error.place, "joint 'joint2' slides" in str(error)) == ("defaults.friction", True)
    own = "[joints.friction]\nviscous_n_s_per_m = 3\n"
    robot = load(tmp_path, DEFAULTS, joint(1), joint(2, "prismatic", tables=own))
    assert float(robot.moving_joints[1].friction.viscous_n_s_per_m) == 3
    assert float(robot.moving_joints[0].friction.coulomb_negative_n_m) == 0.3
    motor = DEFAULTS.replace("[defaults.friction]", '[defaults.friction]\nside = "motor"')
    robot = load(tmp_path, motor, joint(1), joint(2, "prismatic"))
    assert [each.friction.side for each in robot.moving_joints] == ["motor", "motor"]


def test_of_a_description_made_in_python_they_are_merged_too():
    turn = {"name": "a", "type": "revolute", "parent": "base", "child": "l", "axis": [0, 0, 1],
            "frame": {"xyz_m": [0, 0, 0], "rpy_rad": [0, 0, 0]}}  # fmt: skip
    tensor = dict.fromkeys(("xx", "yy", "zz"), 0.01) | dict.fromkeys(("xy", "xz", "yz"), 0.0)
    link = {"name": "l", "mass_kg": 1, "com_m": [0, 0, 0], "inertia_kg_m2": tensor}
    data = {"name": "r", "source": "estimate", "command": "torque", "joints": [turn], "links": [link]}
    robot = RobotDescription.model_validate({**data, "defaults": {"friction": {"viscous_n_m_s_per_rad": 2.0}}})
    assert float(robot.moving_joints[0].friction.viscous_n_m_s_per_rad) == 2.0
    assert robot.defaults is None

"""A robot file to start from has every key that its drives need; check walks through what is to be filled in."""

from __future__ import annotations

import re

import numpy as np
import pytest

import armwright as aw
from armwright.errors import TO_FILL_IN, ArmwrightError, DescriptionError, OutputError
from description.urdf_files import joint as urdf_joint, link, robot, written
from docs.pages import run_here

LINE = re.compile(r'^(?P<key>\w+) = (?P<value>.*"TODO".*?)(?:  #.*)?$', re.MULTILINE)
VALUES = {"text": '"RD 50/08, 2021"', "gear_ratio": "50", "axis": "[0, 0, 1]", "com_m": "[0.1, 0, 0]", "mass_kg": "2",
          "xyz_m": "[0, 0, 0.2]",
          "frame": "{ xyz_m = [0, 0.3, 0], rpy_rad = [0, 0, 0] }", "position_rad": "[-1, 1]",
          "inertia_kg_m2": "{ xx = 0.01, xy = 0, xz = 0, yy = 0.01, yz = 0, zz = 0.01 }"}  # fmt: skip


def filled_in(text):
    """The file with a number for each key that asks for one, and how many there were."""
    return LINE.subn(lambda found: f"{found['key']} = {VALUES.get(found['key'], '0.05')}", text)


def chain(tmp_path):
    return written(
        tmp_path,
        robot(link("base", ""), link("upper"), link("hand"),
              urdf_joint("j 1.0", "base", "upper"), urdf_joint("j2", "upper", "hand", kind="prismatic")),
    )  # fmt: skip


@pytest.mark.parametrize("command", ["voltage", "current", "torque"])
def test_each_comment_says_meaning_and_place_in_words(tmp_path, command):
    """Three parts: the kind of number and its unit, a meaning of three words at least, and where a datasheet has it."""
    path = tmp_path / "new.toml"
    aw.robotfiles.new_robot(path, joints=1, command=command)
    comments = re.findall(r'"TODO".*?  # (.*)', path.read_text(encoding="utf-8").partition("\n\n")[2])
    assert len(comments) > 12
    for comment in comments:
        parts = [part.strip() for part in comment.split(";")]
        assert len(parts) >= 3, comment
        assert len(re.findall(r"[^\W\d]{2,}", parts[1])) >= 3, comment
        assert "either way" not in comment.lower()


@pytest.mark.sample(1)
@pytest.mark.parametrize("command", ["voltage", "current", "torque"])
@pytest.mark.parametrize("source", ["urdf", "panda", None])
def test_filled_in_it_is_an_arm_whose_drives_have_all_that_they_need(tmp_path, source, command):
    path = tmp_path / "new.toml"
    start = chain(tmp_path) if source == "urdf" else source
    aw.robotfiles.new_robot(path, start, joints=None if source else 2, command=command)
    text = path.read_text(encoding="utf-8")
    lines = [k for k, line in enumerate(text.split("\n"), 1) if '"TODO"' in line and not line.startswith("#")]
    with pytest.raises(DescriptionError) as refused:
        aw.load(path)
    assert sorted({int(problem.line) for problem in refused.value.problems}) == lines
    assert {problem.what for problem in refused.value.problems} == {TO_FILL_IN}
    assert f"{len(refused.value.problems)} values to fill in" in str(refused.value)
    done, count = filled_in(text)
    assert count == len(lines)
    path.write_text(done, encoding="utf-8")
    arm = aw.load(path)
    assert [body.drive.command for body in arm.coordinates] == [command] * arm.n
    dyn = aw.compile(arm)
    q, qd, qdd = np.full((3, arm.n), 0.1)
    if source is not None:  # the geometry and masses are the other file's
        old = aw.load(start)
        np.testing.assert_allclose(aw.gravity_torques(arm, q), aw.gravity_torques(old, q), rtol=1e-12, atol=1e-12)
        assert arm.names == old.names
    assert np.isfinite(dyn.inverse_dynamics(q, qd, qdd)).all()
    assert np.isfinite(aw.simulate(aw.Scenario(arm, 0.001, np.zeros(arm.n)))["q"].values).all()


@pytest.mark.parametrize("command", ["voltage", "torque"])
def test_gear_ratios_of_transmissions_are_kept(tmp_path, command):
    transmission = (
        '<transmission name="t"><joint name="j 1.0"/><actuator name="m"><mechanicalReduction>-120</mechanicalReduction>'
        "</actuator></transmission>"
    )
    start = written(
        tmp_path, robot(link("base", ""), link("upper"), urdf_joint("j 1.0", "base", "upper"), transmission)
    )
    path = tmp_path / "new.toml"
    notes = aw.robotfiles.new_robot(path, start, command=command)
    assert not any("gear ratio" in note for note in notes)
    done, _ = filled_in(path.read_text(encoding="utf-8"))
    path.write_text(done, encoding="utf-8")
    arm = aw.load(path)
    assert float(arm.coordinates[0].drive.gear_ratio) == -120.0
    assert arm.provenance('"j 1.0".motor.gear_ratio').kind == "import"
    assert any("gear ratio" in note for note in aw.load(start).warnings)  # a URDF alone has no motor


def test_every_value_says_what_is_wanted_and_where_it_is_found(tmp_path):
    path = tmp_path / "new.toml"
    aw.robotfiles.new_robot(path, joints=1, command="voltage")
    with pytest.raises(DescriptionError) as refused:
        aw.load(path)
    by_key = {
        problem.place.rpartition(" ")[2].rpartition(".")[2]: problem.expected for problem in refused.value.problems
    }
    for key, words in {
        "resistance_ohm": ("a number above 0 [Ω]", '"terminal resistance"'),
        "gear_ratio": ("a number other than 0", '"reduction"'),
        "rotor_inertia_kg_m2": ("[kg m²]", "1 g cm² = 1e-7 kg m²"),
        "voltage_v": ("[V]", "supply voltage"),
        "xyz_m": ("3 numbers [m]", "in the link's frame"),
        "mass_kg": ("[kg]", "scales"),
        "viscous_n_m_s_per_rad": ("[N m s/rad]", "identify friction"),
    }.items():
        assert all(word in by_key[key] for word in words), by_key[key]


@pytest.mark.parametrize("command", ["voltage", "current", "torque"])
@pytest.mark.parametrize("source", ["urdf", None])
def test_the_meaning_of_each_stands_beside_it(tmp_path, source, command):
    path = tmp_path / "new.toml"
    start = chain(tmp_path) if source == "urdf" else None
    aw.robotfiles.new_robot(path, start, joints=None if start else 1, command=command)
    with pytest.raises(DescriptionError) as refused:
        aw.load(path)
    lines = path.read_text(encoding="utf-8").split("\n")
    comments = {int(problem.line): problem.expected for problem in reversed(refused.value.problems)}
    assert {line: lines[line - 1].partition("  # ")[2] for line in comments} == comments


@pytest.mark.sample(1)
@pytest.mark.parametrize("joints", [2, 30, 100])
def test_an_arm_of_any_size_has_a_row_for_each_key(tmp_path, joints):
    path = tmp_path / "new.toml"
    aw.robotfiles.new_robot(path, joints=joints, command="voltage")
    done = run_here(["armwright", "check", "new.toml"], tmp_path)
    rows = done.stderr.splitlines()
    assert len(rows) <= 40
    (gears,) = [row for row in rows if row.startswith("  gear_ratio: ")]
    lines = path.read_text(encoding="utf-8").split("\n")
    assert gears.split()[2:] == [str(k) for k, line in enumerate(lines, 1) if line.startswith("gear_ratio")]
    assert len(gears.split()) == joints + 2


def test_the_last_few_are_named_with_their_meaning(tmp_path):
    path = tmp_path / "new.toml"
    aw.robotfiles.new_robot(path, joints=1, command="torque")
    text = re.sub(r'"TODO"(?=.*#.*CAD)', "[0, 0, 1]", path.read_text(encoding="utf-8"))
    path.write_text(re.sub(r"(inertia_kg_m2) = .*", r"\1 = 0", text), encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"gear_ratio = 'TODO': .* a number other than 0"):
        aw.load(path)


def test_optional_keys_of_datasheets_are_there_to_uncomment(tmp_path):
    path = tmp_path / "new.toml"
    aw.robotfiles.new_robot(path, joints=1, command="voltage")
    text = path.read_text(encoding="utf-8")
    path.write_text(filled_in(re.sub(r"^# (?=\w+ = )", "", text, flags=re.MULTILINE))[0], encoding="utf-8")
    (joint,) = (arm := aw.load(path)).coordinates
    assert (joint.drive.efficiency, joint.limits.current, arm.tip) == (0.75, 5.0, "tip")
    np.testing.assert_allclose(aw.forward_kinematics(arm, [0.0])[:3, 3], [0, 0.3, 0.2])


def test_what_is_wrong_besides_is_reported_with_it(tmp_path):
    path = tmp_path / "new.toml"
    aw.robotfiles.new_robot(path, joints=1, command="current")
    text = (
        path.read_text(encoding="utf-8")
        .replace('mass_kg = "TODO"', "mass_kg = -1")
        .replace("gear_ratio", "gear_ration")
    )
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DescriptionError) as refused:
        aw.load(path)
    message = str(refused.value)
    assert "mistakes" in message.splitlines()[0]
    assert "mass_kg = -1" in message
    assert "gear_ration" in message
    assert sum(problem.what == TO_FILL_IN for problem in refused.value.problems) == text.count('= "TODO"') - 1


def test_refusals(tmp_path):
    path = tmp_path / "new.toml"
    for arguments, named, place in (
        ((path,), {}, "joints"),
        ((path, "panda"), {"joints": 2}, "joints"),
        ((path,), {"joints": 0}, "joints"),
        ((path,), {"joints": True}, "joints"),
        ((path,), {"joints": 2, "command": "volts"}, "command"),
        ((path, tmp_path / "none.urdf"), {}, ""),
    ):
        with pytest.raises(ArmwrightError) as refused:
            aw.robotfiles.new_robot(*arguments, **named)
        assert refused.value.place == place
        assert not path.exists()
    path.write_text("mine")
    for target in (path, tmp_path / "new.urdf"):
        with pytest.raises(OutputError):
            aw.robotfiles.new_robot(target, joints=2)
    assert path.read_text() == "mine"


def test_the_commands(tmp_path):
    def run(*words):
        return run_here(["armwright", *words], tmp_path)

    chain(tmp_path)
    done = run("new", "robot", "arm.toml", "--from", "arm.urdf", "--drive-command", "voltage")
    assert (done.returncode, done.stderr) == (0, "")
    assert "next: armwright check arm.toml" in done.stdout
    done = run("check", "arm.toml")
    assert done.returncode == 2
    first, *keys, _ = done.stderr.splitlines()
    assert re.fullmatch(r"armwright: error: arm\.toml: \d+ values to fill in", first)
    lines = (tmp_path / "arm.toml").read_text(encoding="utf-8").split("\n")
    found = [(key.split(":")[0].strip(), int(line)) for key in keys for line in re.findall(r"\d+", key.split(":")[1])]
    for key, line in found:
        assert f"{key} = " in lines[line - 1]
        assert "TODO" in lines[line - 1].partition("#")[0]
    assert len({line for _, line in found}) == sum('"TODO"' in line.partition("#")[0] for line in lines)
    again = run("new", "robot", "arm.toml", "--from", "arm.urdf")
    assert (again.returncode, "is there already" in again.stderr) == (2, True)

"""Twenty mistakes in one robot file are all reported at once, each with its line."""

from __future__ import annotations

import re

import pytest

import armwright as aw
from armwright.errors import DescriptionError
from docs.pages import run_here

FILE = """\
name = "bad"
source = "datasheet"
gravity_m_s2 = [0, 0]  #! expected 3 numbers
command = "voltge"  #! expected 'voltage'

[sources.maker]
kind = "datasheet"
text = ""  #! text that is not empty

[[joints]]
name = "shoulder"
type = "revolute"
parent = "base"
child = "link1"
dh = { alpha_rad = 0, r_m = 0.1, a_m = "long", offset_rad = 0 }  #! expected a number
[joints.motor]
gear_ration = 100  #! did you mean gear_ratio
rotor_inertia_kg_m2 = -1e-4  #! a number of 0 or more
resistance_ohm = 0  #! a number above 0
[joints.friction]
side = "engine"  #! expected 'joint' or 'motor'

[[joints]]
name = "elbow"
type = "revolut"  #! expected revolute, prismatic, helical or fixed
parent = "link1"
child = "link2"

[[joints]]
name = "wrist"
type = "revolute"
parent = "link7"  #! no link
child = "link3"
dh = { alpha_rad = 0, r_m = 0.1, a_m = 0, offset_rad = 0 }
limits = { position_rad = [1, -1] }  #! expected

[joints.brake]  #! missing
engage_s = 0.1  #! unknown key

[[links]]
name = "link1"
mass_kg = -1  #! a number of 0 or more
com_m = [0, 0]  #! expected 3 numbers, not 2
inertia_kg_m2 = { xx = 1, xy = 0, xz = 0, yy = 1, yz = 0, zz = 5 }

[[links]]
name = "link2"
mass_kg = { value = 1, source = "nowhere" }  #! no key of [sources]
com_m = [0, 0, 0]
inertia_kg_m2 = { xx = 1, xy = 0, xz = 0, yy = 1, yz = 0, zz = 5 }  #! zz = 5 > xx + yy = 2 kg m², by 3; 2 at most is possible
this is no TOML  #! not TOML

[[links]]
name = "link3"
mass_kg = 1
mass_kg = 2  #! there twice
com_m = [0, 0, 0]
inertia_kg_m2 = { xx = 1, xy = 0, xz = 0, yy = 1, yz = 0, z = 1 }  #! did you mean zz

[[link]]  #! did you mean links
name = "tool"
"""
PLANTED = {k: line.partition("#! ")[2] for k, line in enumerate(FILE.split("\n"), 1) if "#! " in line}


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text("\n".join(line.partition("  #! ")[0] for line in FILE.split("\n")), encoding="utf-8")
    return path


def test_all_mistakes_are_told_with_their_lines(path):
    assert len(PLANTED) >= 20
    with pytest.raises(DescriptionError) as refused:
        aw.load(path)
    problems = [(int(problem.line), str(problem)) for problem in refused.value.problems]
    assert {line for line, _ in problems} == PLANTED.keys()
    for line, words in PLANTED.items():
        assert any(at == line and words in text for at, text in problems)
    first, *lines = str(refused.value).splitlines()
    assert first == f"{path}: {len(refused.value.problems)} mistakes"
    assert [int(line.split(":")[1]) for line in lines] == sorted(int(p.line) for p in refused.value.problems)


def test_check_shows_the_lines_with_marks(path):
    done = run_here(["armwright", "check", str(path)], path.parent)
    assert (done.returncode, done.stdout) == (2, "")
    first, *lines = done.stderr.splitlines()
    places = [line for line in lines if line.startswith(f"  {path}:")]
    assert first == f"armwright: error: {path}: {len(places)} mistakes"
    assert {int(line.split(":")[1]) for line in places} == PLANTED.keys()
    at = next(k for k, line in enumerate(lines) if "gear_ration" in line)
    assert lines[at + 1 : at + 3] == ["  17 | gear_ration = 100", "     | ^^^^^^^^^^^"]
    assert sum(line.strip(" |^") == "" for line in lines) == len(places)


def test_the_marks_stand_below_findings_of_a_file_that_is_read(tmp_path):
    path = tmp_path / "arm.toml"
    text = aw.robotfiles.to_toml(aw.load("puma560")).replace("gear_ratio", "gear_efficiency = 0.3\ngear_ratio", 1)
    path.write_text(text, encoding="utf-8")
    finding = next(each for each in aw.robotfiles.check(path).warnings if "self-locking" in each.problem.what)
    assert text.split("\n")[int(finding.problem.line) - 1] == "gear_efficiency = 0.3"


def test_keys_that_contradict_each_other_are_reported_beside_misspelt_ones(tmp_path):
    """They are looked for together with the others, and not only once these are mended."""
    text = re.sub(
        r"position_rad = .*",
        "velocity_rad_s = 3\nposition_rad = [1, -1]",
        aw.robotfiles.to_toml(aw.load("cmu-dd")),
        count=1,
    )
    text = text.replace("[joints.motor]\n", "[joints.motor]\ncurrent_loop_hz = 100\nresistence_ohm = 1\n", 1)
    path = tmp_path / "arm.toml"
    path.write_text(text, encoding="utf-8")
    lines = text.split("\n")
    with pytest.raises(DescriptionError) as refused:
        aw.load(path)
    found = {lines[int(problem.line) - 1].partition(" = ")[0]: str(problem) for problem in refused.value.problems}
    assert found.keys() == {"velocity_rad_s", "position_rad", "current_loop_hz", "resistence_ohm"}
    assert "needs inductance_h" in found["current_loop_hz"]
    assert "the lowest before the highest" in found["position_rad"]

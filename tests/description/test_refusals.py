"""Bad input: one line of our own exception that names the file, the place, the value and what was expected."""

from __future__ import annotations

import copy
import math
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit

from armwright.description import builtin_names, read_description
from armwright.description.database import parse
from armwright.errors import ABSENT, DescriptionError
from armwright.model import build_model
from description.reports import check_report
from raises_at import raises_at

FILE = "arm.toml"
GONE, SAME = object(), object()
SLIDE = {"type": "prismatic", "friction": {"viscous_n_s_per_m": 1.0}}


def builtin(name: str) -> dict[str, Any]:
    """A built-in file, parsed."""
    return tomlkit.parse((resources.files("armwright.robots") / f"{name}.toml").read_text()).unwrap()


def changed(data: dict[str, Any], path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    """A copy with one entry set, or taken away (GONE)."""
    data = copy.deepcopy(data)
    at = data
    for key in path[:-1]:
        at = at[key]
    if value is GONE:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    return data


def refused(data: dict[str, Any], place: str, words: str) -> DescriptionError:
    """The error that refuses it; `place` and `words` are as in `check_report`."""
    with pytest.raises(DescriptionError) as caught:
        build_model(parse(data, FILE))
    check_report(caught.value, place, words)
    return caught.value


ELBOW, LINK2 = ("joints", 2), ("links", 1)
PUMA_ELBOW = builtin("puma560")["joints"][2]
PUMA: dict[str, tuple[tuple[Any, ...], Any, str, Any, str]] = {  # where, what; and the error's place, value, words
    "missing name": (("name",), GONE, "name", GONE, "text"),
    "missing joints": (("joints",), GONE, "joints", GONE, "[[joints]] tables"),
    "missing mass": ((*LINK2, "mass_kg"), GONE, "link 'link2' mass_kg", GONE, "a number of 0 or more"),
    "missing com": ((*LINK2, "com_m"), GONE, "link 'link2' com_m", GONE, "3 numbers"),
    "missing inertia": ((*LINK2, "inertia_kg_m2"), GONE,
     "link 'link2' inertia_kg_m2", GONE, "a table with xx, xy, xz, yy, yz, zz"),
    "a joint called t": ((*ELBOW, "name"), "t", "joint 't' name", SAME, "the time in schedules"),
    "negative std": ((*LINK2, "mass_kg"), {"value": 17.4, "std": -1},
     "link 'link2' mass_kg.std", -1, "a standard deviation of 0 or more"),
    "one negative std of three": ((*LINK2, "com_m"), {"value": [0, 0, 0], "std": [1, 1, -1e-9]},
     "link 'link2' com_m.std", [1, 1, -1e-09],
     "a standard deviation of 0 or more"),
    "missing xx": ((*LINK2, "inertia_kg_m2", "xx"), GONE, "link 'link2' inertia_kg_m2.xx", GONE, "a number of 0 or more"),
    "missing alpha": ((*ELBOW, "dh", "alpha_rad"), GONE, "joint 'elbow' dh.alpha_rad", GONE, "a number"),
    "missing ratio": ((*ELBOW, "motor", "gear_ratio"), GONE, "joint 'elbow' motor.gear_ratio", GONE, "a number other than 0"),
    "missing type": ((*ELBOW, "type"), GONE, "joint 'elbow' type", GONE, "revolute, prismatic, helical or fixed"),
    "missing placement": ((*ELBOW, "dh"), GONE, "joint 'elbow'", GONE, "exactly one of dh, modified_dh, frame, not none"),
    "missing value": ((*LINK2, "mass_kg"), {"source": "recalled"}, "link 'link2' mass_kg.value", GONE, "a value"),
    "unknown key": (("gravity",), [0, 0, -9.81], "gravity", SAME, "gravity_m_s2"),
    "unknown link key": ((*LINK2, "masse_kg"), 1.5, "link 'link2' masse_kg", SAME, "mass_kg"),
    "far from any key": ((*LINK2, "finish"), "red", "link 'link2' finish", SAME, "unknown key"),
    "unprintable key": ((*LINK2, "a\nb"), 1, "link 'link2' 'a\\nb'", SAME, "unknown key"),
    "wrong mass unit": ((*LINK2, "mass_g"), 17400, "link 'link2' mass_g", SAME, "mass_kg"),
    "wrong angle unit": ((*ELBOW, "dh", "alpha_deg"), -90, "joint 'elbow' dh.alpha_deg", SAME, "alpha_rad"),
    "wrong rotor unit": ((*ELBOW, "motor", "rotor_inertia_g_cm2"), 2000,
     "joint 'elbow' motor.rotor_inertia_g_cm2", SAME, "rotor_inertia_kg_m2"),
    "wrong friction unit": ((*ELBOW, "friction", "viscous_n_s_per_m"), 1,
     "joint 'elbow' friction.viscous_n_s_per_m", SAME, "viscous_n_m_s_per_rad"),
    "negative mass": ((*LINK2, "mass_kg"), -17.4, "link 'link2' mass_kg", SAME, "a number of 0 or more"),
    "negative mass with source": ((*LINK2, "mass_kg"), {"value": -17.4, "source": "recalled"},
     "link 'link2' mass_kg", -17.4, "a number of 0 or more"),
    "negative inertia": ((*LINK2, "inertia_kg_m2", "yy"), -1, "link 'link2' inertia_kg_m2.yy", SAME, "a number of 0 or more"),
    "negative resistance": ((*ELBOW, "motor", "resistance_ohm"), -2,
     "joint 'elbow' motor.resistance_ohm", SAME, "a number above 0"),
    "ratio zero": ((*ELBOW, "motor", "gear_ratio"), 0, "joint 'elbow' motor.gear_ratio", SAME, "a number other than 0"),
    "efficiency in percent": ((*ELBOW, "motor", "gear_efficiency"), 70,
     "joint 'elbow' motor.gear_efficiency", SAME, "a number above 0, at most 1"),
    "NaN": ((*LINK2, "mass_kg"), math.nan, "link 'link2' mass_kg", SAME, "a finite number"),
    "infinity in a list": ((*LINK2, "com_m"), [0, math.inf, 0], "link 'link2' com_m", SAME, "a finite number"),
    "integer beyond floats": ((*LINK2, "com_m"), [0, 10**400, 0], "link 'link2' com_m", SAME, "a finite number"),
    "integer beyond printing": ((*LINK2, "mass_kg"), 10**5000, "link 'link2' mass_kg", SAME, "a finite number"),
    "text": ((*LINK2, "mass_kg"), "17.4", "link 'link2' mass_kg", SAME, "a number"),
    "text in a list": ((*LINK2, "com_m"), [0, "x", 0], "link 'link2' com_m", SAME, "3 numbers"),
    "text for a list": ((*LINK2, "com_m"), "0 0 0", "link 'link2' com_m", SAME, "3 numbers"),
    "truth for a number": ((*LINK2, "mass_kg"), True, "link 'link2' mass_kg", SAME, "a number"),
    "truth in a list": ((*LINK2, "com_m"), [True, 0, 0], "link 'link2' com_m", SAME, "3 numbers"),
    "list for a number": ((*LINK2, "mass_kg"), [1, 2], "link 'link2' mass_kg", SAME, "one number, not 2"),
    "number for a list": (("gravity_m_s2",), -9.81, "gravity_m_s2", SAME, "3 numbers"),
    "short list": ((*LINK2, "com_m"), [0, 1], "link 'link2' com_m", SAME, "3 numbers, not 2"),
    "long range": ((*ELBOW, "limits", "position_rad"), [0, 1, 2],
     "joint 'elbow' limits.position_rad", SAME, "2 numbers, not 3"),
    "range turned round": ((*ELBOW, "limits", "position_rad"), [2, 1], "joint 'elbow' limits.position_rad", [2.0, 1.0],
     "the lowest before the highest"),
    "axis with DH": ((*ELBOW, "axis"), [0, 0, 1],
     "joint 'elbow' axis", [0.0, 0.0, 1.0], "goes with frame (the axis of a DH joint is z)"),
    "wrong type": ((*ELBOW, "type"), "rotary", "joint 'elbow' type", SAME, "revolute, prismatic, helical or fixed"),
    "type of no text": ((*ELBOW, "type"), [1], "joint 'elbow' type", SAME, "revolute, prismatic, helical or fixed"),
    "wrong command": (("command",), "volts", "command", SAME, "'voltage', 'current', 'torque' or 'position'"),
    "no command": (("command",), GONE, "joint 'waist' command", GONE, "voltage, current, torque or position"),
    "wrong basis": ((*ELBOW, "motor", "basis"), "rms", "joint 'elbow' motor.basis", SAME,
     "'dc', 'phase_peak', 'phase_rms', 'line_peak' or 'line_rms'"),
    "no torque constant": ((*ELBOW, "motor", "torque_constant_n_m_per_a"), GONE, "joint 'elbow' motor.resistance_ohm", GONE,
     "needs torque_constant_n_m_per_a beside it"),
    "no resistance": ((*ELBOW, "motor", "resistance_ohm"), GONE,
     "joint 'elbow' command", "voltage", "needs motor.resistance_ohm"),
    "no motor": ((*ELBOW, "motor"), GONE, "joint 'elbow' command", "voltage", "needs motor.resistance_ohm"),
    "half of Coulomb": ((*ELBOW, "friction", "coulomb_negative_n_m"), GONE, "joint 'elbow' friction.coulomb_positive_n_m", GONE,
     "needs coulomb_negative_n_m beside it"),
    "smoothing over nothing": ((*ELBOW, "friction", "smoothing_rad_per_s"), 0.0,
     "joint 'elbow' friction.smoothing_rad_per_s", 0.0, "a number above 0, or no such key: friction then sticks in simulation"),
    "unknown parent": ((*ELBOW, "parent"), "lnk2", "joint 'elbow' parent", SAME, "link2"),
    "unknown child": ((*ELBOW, "child"), "hand", "joint 'elbow' child", SAME, "link1"),
    "closed chain": (("joints", 3, "child"), "link3",
     "link 'link3'", GONE, "moved by two joints: closed chains are not offered"),
    "link on itself": ((*ELBOW, "parent"), "link3", "link 'link3'", GONE, "carries itself"),
    "ring of links": (("joints", 1, "parent"), "link5", "link 'link2'", GONE, "carries itself"),
    "two joints of a name": (("joints", 3, "name"), "elbow", "name", SAME, "two joints have this name"),
    "two links of a name": (("links", 3, "name"), "link3", "name", SAME, "two links have this name"),
    "name with a bracket": ((*ELBOW, "name"), "elbow[1]",
     "joint 'elbow[1]' name", SAME,
     "a name without brackets, quotation marks, control or invisible characters, and spaces at its ends"),
    "empty name": ((*ELBOW, "name"), "", "joints[2] name", SAME, "text that is not empty"),
    "number as name": ((*ELBOW, "name"), 5, "joints[2] name", SAME, "text"),
    "unknown tip": (("tip",), "link7", "tip", SAME, "no frame or link"),
    "unknown source": ((*LINK2, "source"), "corke94", "link2.mass_kg source", SAME, "corke1994"),
    "missing source": (("source",), GONE, "gravity_m_s2", GONE, "has no source"),
    "wrong kind of source": (("sources", "corke1994", "kind"), "paper", "sources.corke1994.kind", SAME,
     "'drawing', 'cad', 'datasheet', 'measurement', 'fit', 'estimate',"),
    "text for a source": (("sources", "corke1994"), "a paper", "sources.corke1994", SAME, "a table"),
    "number for a table": ((*ELBOW, "motor"), 3, "joint 'elbow' motor", SAME, "a table"),
    "list for a table": ((*LINK2, "inertia_kg_m2"), [1, 2, 3], "link 'link2' inertia_kg_m2", SAME, "a table"),
    "text for a joint": (("joints",), ["a"], "joints[0]", "a", "a table"),
    "table for joints": (("joints",), {"a": 1}, "joints", GONE, "[[joints]] tables"),
    "no joint at all": (("joints",), [], "joints", GONE, "at least one joint"),
    "reason of no text": ((*LINK2, "accept_impossible"), True, "link 'link2' accept_impossible", SAME, "text"),
}  # fmt: skip


@pytest.mark.sample(29)
@pytest.mark.parametrize("case", PUMA)
def test_refused_in_one_line(case):
    """A copy of `puma560` with one fault: file, place, value, and what was expected or the names that exist."""
    path, value, place, reported, words = PUMA[case]
    error = refused(changed(builtin("puma560"), path, value), place, words)
    check_value(error, value, reported)
    assert error.file == FILE


def check_value(error: DescriptionError, value: Any, reported: Any) -> None:
    """An error repeats the wrong value (SAME), another one, or none (GONE)."""
    if reported is SAME:
        assert error.value is value or error.value == value
    elif reported is GONE:
        assert error.value is ABSENT
    else:
        np.testing.assert_array_equal(error.value, reported)


TWO_LINK: dict[str, tuple[tuple[Any, ...], Any, str, Any, str]] = {  # where, what; and the error's place, value, words
    "axis of zeros": (("joints", 0, "axis"), [0, 0, 0], "joint 'shoulder' axis", SAME, "a direction, 3 numbers not all 0"),
    "NaN in the axis": (("joints", 0, "axis"), [0, math.nan, 1], "joint 'shoulder' axis", SAME, "a finite number"),
    "no axis": (("joints", 0, "axis"), GONE,
     "joint 'shoulder' axis", GONE, "[x, y, z] beside frame, the joint's direction in it"),
    "two placements": (("joints", 0, "dh"), {"alpha_rad": 0, "r_m": 0, "a_m": 0, "offset_rad": 0}, "joint 'shoulder'", GONE,
     "exactly one of dh, modified_dh, frame, not dh and frame"),
    "frame called as a link": (("frames", 0, "name"), "forearm", "name", SAME, "two frames or links have this name"),
    "frame on nothing": (("frames", 0, "link"), "forearms", "frame 'hand' link", SAME, "forearm"),
    "text on a slide": (("joints", 0), {**SLIDE, "friction": {"viscous_n_s_per_m": "a"}},
     "joint 'shoulder' friction.viscous_n_s_per_m", "a",
     "a number"),
    "wrong unit on a slide": (("joints", 0), {**SLIDE, "friction": {"viscous_n_s_per_mm": 1}},
     "joint 'shoulder' friction.viscous_n_s_per_mm", 1,
     "viscous_n_s_per_m"),
    "rotary friction of a slide": (("joints", 0), {**SLIDE, "friction": {"viscous_n_m_s_per_rad": 1}},
     "joint 'shoulder' friction", GONE,
     "in N m on a prismatic joint, it is its motor's"),
}  # fmt: skip


@pytest.mark.parametrize("case", TWO_LINK)
def test_refused_with_explicit_frames(case):
    """The same for what only explicit frames, named frames and slides have."""
    path, value, place, reported, words = TWO_LINK[case]
    data = builtin("two-link")
    new = {**data["joints"][0], **value} if path == ("joints", 0) else value
    check_value(refused(changed(data, path, new), place, words), value, reported)


def test_the_sentence():
    """Made of the fields: file, place, value, what is wrong, what was expected, and the nearest names."""
    data = changed(builtin("puma560"), (*LINK2, "mass_kg"), -1.0)
    for key, value in (("masse_kg", 1.5), ("com_m", [0, 1])):
        data = changed(data, (*LINK2, key), value)
    error = refused(data, "link 'link2' masse_kg", "mass_kg")
    assert [str(problem) for problem in error.problems] == [
        "arm.toml: link 'link2' masse_kg = 1.5: unknown key; did you mean mass_kg?",
        "arm.toml: link 'link2' mass_kg = -1.0: expected a number of 0 or more",
        "arm.toml: link 'link2' com_m = [0, 1]: expected 3 numbers, not 2",
    ]
    assert str(error).splitlines() == ["arm.toml: 3 mistakes", *(f"  {problem}" for problem in error.problems)]
    for path, value, sentence in (
        ((*ELBOW, "parent"), "lnk2", "joint 'elbow' parent = 'lnk2': no link; did you mean link2"),
        ((*LINK2, "mass_kg"), GONE, "link 'link2' mass_kg: missing; expected a number of 0 or more"),
        ((*LINK2, "finish"), "red", "link 'link2' finish = 'red': unknown key; there is accept_impossible, com_m, "),
    ):
        with pytest.raises(DescriptionError) as caught:
            parse(changed(builtin("puma560"), path, value), FILE)
        assert str(caught.value).startswith(f"{FILE}: {sentence}")


def test_link_that_hangs_on_no_joint():
    """Two roots: a second link without a joint is named, wherever it stands in the file."""
    data = builtin("two-link")
    floating = {**data["links"][0], "name": "floating"}
    carried = {**data["links"][0], "name": "carried"}
    hinge = {**data["joints"][0], "name": "hinge", "parent": "floating", "child": "carried"}
    for links in ([*data["links"], carried, floating], [carried, floating, *data["links"]]):
        refused({**data, "links": links, "joints": [hinge, *data["joints"]]}, "link 'floating'", "hangs on no joint")


def test_ring_that_carries_a_link():
    """A link that hangs on a ring is not the fault: the ring is, and is found from anywhere."""
    data = changed(builtin("puma560"), ("joints", 1, "parent"), "link3")
    data["links"].reverse()
    refused(data, "link 'link3'", "carries itself; a tree that starts at 'base'")


def test_friction_on_the_motor_side_without_motor():
    """Nothing to refer it by."""
    data = changed(builtin("panda"), ("joints", 0, "friction", "side"), "motor")
    refused(data, "joint 'joint1' friction.side", "needs a [joints.motor] with its gear_ratio")


def test_arm_that_cannot_move():
    """Only fixed joints."""
    data = builtin("two-link")
    for joint in data["joints"]:
        joint["type"] = "fixed"
        del joint["axis"]
    with raises_at(DescriptionError, "two-link", "joint that moves"):
        build_model(parse(data, FILE))


def test_impossible_inertia():
    """The link and the margin are named; a reason in the file or the caller's word lets it pass, with a warning."""
    data = changed(builtin("puma560"), ("links", 2, "accept_impossible"), GONE)
    error = refused(data, "link 'link3' inertia_kg_m2", "an impossible inertia")
    assert error.what.endswith("yy = 0.086 > zz + xx = 0.0785 kg m², by 0.0075; 0.0785 at most is possible")
    assert error.expected == 'a real body, or accept_impossible = "reason" in the link, or on_impossible="warn"'
    warned = build_model(parse(data, FILE), on_impossible="warn")
    assert any("link3" in warning for warning in warned.warnings)
    accepted = build_model(read_description("puma560"))
    assert len(accepted.warnings) == 2
    assert all("accepted: published so" in warning for warning in accepted.warnings)
    with pytest.raises(DescriptionError, match="on_impossible = 'maybe'"):
        build_model(parse(data, FILE), on_impossible="maybe")


@pytest.mark.parametrize(("xx", "passes"), [(0.9, True), (1.0, True), (1.0 + 1e-6, False), (1.1, False)])
def test_how_impossible_an_inertia_may_be(xx, passes):
    """Ixx ≤ Iyy + Izz, to rounding: a thin rod's or plate's limit case passes."""
    body = {"xx": xx, "xy": 0, "xz": 0, "yy": 0.5, "yz": 0, "zz": 0.5}
    data = changed(
        builtin("two-link"),
        ("links", 0),
        {"name": "upper_arm", "mass_kg": 1, "com_m": [0, 0, 0], "inertia_kg_m2": body},
    )
    if passes:
        build_model(parse(data, FILE))
    else:
        refused(data, "link 'upper_arm' inertia_kg_m2", "an impossible inertia")


def test_massless_link_is_allowed_when_written():
    """Zero mass with zero inertia."""
    nothing = dict.fromkeys(("xx", "xy", "xz", "yy", "yz", "zz"), 0)
    data = changed(
        builtin("two-link"),
        ("links", 0),
        {"name": "upper_arm", "mass_kg": 0, "com_m": [0, 0, 0], "inertia_kg_m2": nothing},
    )
    assert build_model(parse(data, FILE)).bodies[0].mass == 0.0


@pytest.mark.parametrize(
    ("name", "ending"),
    [
        ("puma650", "did you mean puma560?"),
        ("panda2", "did you mean panda?"),
        ("zzz", f"there is {', '.join(builtin_names())}"),
        ("", f"there is {', '.join(builtin_names())}"),
    ],
)
def test_unknown_robot(name, ending):
    """The nearest names, or all there are."""
    with pytest.raises(DescriptionError) as caught:
        read_description(name)
    assert (caught.value.place, caught.value.value, caught.value.choices) == ("robot", name, tuple(builtin_names()))
    assert str(caught.value) == f"robot = {name!r}: not a built-in arm and not a file; {ending}"


def test_a_path_to_nothing():
    with pytest.raises(DescriptionError) as caught:
        read_description("nowhere/arm.toml")
    assert (caught.value.file, caught.value.what) == (str(Path("nowhere/arm.toml")), "no such file")


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"name = \n", ":1: not TOML: Invalid value"),
        (b'name = "a"\nname = "b"\n', ":2: not TOML: this key or table is there twice"),
        (b'name = "\xff"', ": not TOML: byte 8 is no UTF-8 text"),
        (b'\xef\xbb\xbfname = "a"', ": not TOML: begins with a byte order mark (BOM)"),
        (b"a = " + b"[" * 20000, ":1: not TOML"),
        (b"a = " + b"9" * 5000, ":1: not TOML"),
        (b"", ": name: missing; expected text"),
    ],
)
def test_unreadable_file(tmp_path, content, line):
    """What is no TOML is refused with its line, and nothing else than our error comes out."""
    path = tmp_path / "arm.toml"
    path.write_bytes(content)
    with pytest.raises(DescriptionError) as caught:
        read_description(path)
    placed = [f"{path}{line}" in each for each in str(caught.value).splitlines()]
    assert any(placed)
    assert len(placed) == len(caught.value.problems) + (len(caught.value.problems) > 1)


@pytest.mark.parametrize(
    ("date", "passes"),
    [
        ("2026", True),
        ("2026-05", True),
        ("2026-05-04", True),
        ("yesterday", False),
        ("2026-13", False),
        ("2026-02-30", False),
        ("", False),
    ],
)
def test_dates(date, passes):
    """As ISO 8601 writes a year, a month or a day; of a source and of a number."""
    for value in ({"kind": "drawing", "text": "x", "date": date}, {"value": 1.0, "date": date}):
        source = "kind" in value
        path = ("sources", "sheet") if source else (*LINK2, "mass_kg")
        data = changed(builtin("puma560"), path, value)
        if passes:
            parse(data, FILE)
        else:
            place = "sources.sheet.date" if source else "link 'link2' mass_kg.date"
            refused(data, place, "a date such as 2026-05-04, 2026-05 or 2026")


def test_folder_as_file(tmp_path):
    """A folder is no file, whatever its name ends with."""
    folder = tmp_path / "arm.toml"
    folder.mkdir()
    for place in (folder, tmp_path):
        with raises_at(DescriptionError, file=place):
            read_description(place)


def test_replace_refuses_with_our_error():
    """A changed record is validated like a read one."""
    robot = read_description("panda")
    assert robot.replace(tip="link3").tip == "link3"
    assert robot.tip == "flange"
    with pytest.raises(DescriptionError) as caught:
        robot.replace(tip="link9")
    check_report(caught.value, "tip", "no frame or link")
    with pytest.raises(DescriptionError) as caught:
        robot.links[0].replace(mass_kg=-1)
    check_report(caught.value, "mass_kg", "a number of 0 or more")


def test_a_name_beats_a_neighbour(tmp_path, monkeypatch):
    """A path is read as a file, from anywhere; a built-in name needs none."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text((resources.files("armwright.robots") / "panda.toml").read_text())
    assert read_description("mine.toml").name == "panda"
    assert read_description("puma560").name == "puma560"


TOO_LARGE = [  # a number of two-link, one beyond any robot, and where it is found
    ("com_m = [0.5, 0.0, 0.0]", "com_m = [1e300, 0.0, 0.0]", "upper_arm.com_m"),
    ("com_m = [0.5, 0.0, 0.0]", "com_m = [1e10, 0.0, 0.0]", "upper_arm.com_m"),
    ("mass_kg = 6.0", "mass_kg = 1e308", "upper_arm.mass_kg"),
    ("xx = 0.01", "xx = 1e200", "upper_arm.inertia_kg_m2.xx"),
    ("xyz_m = [1.0, 0.0, 0.0]", "xyz_m = [1e300, 1e300, 1e300]", "elbow.frame.xyz_m"),
    ("xyz_m = [0.8, 0.0, 0.0]", "xyz_m = [-1e300, 0.0, 0.0]", "hand.xyz_m"),
]


@pytest.mark.parametrize(("old", "new", "place"), TOO_LARGE)
@pytest.mark.parametrize("on_impossible", ["error", "warn"])
def test_numbers_too_large_to_compute_with(old, new, place, on_impossible):
    text = (resources.files("armwright.robots") / "two-link.toml").read_text()
    assert old in text
    robot = parse(tomlkit.parse(text.replace(old, new)).unwrap(), "arm.toml")
    with raises_at(DescriptionError, place, r"1e\+(09|100) at most"):
        build_model(robot, on_impossible=on_impossible)

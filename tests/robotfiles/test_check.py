"""The physical checks of a record as one list."""

from __future__ import annotations

from dataclasses import replace

import pytest

import armwright as aw
from armwright.description.database import parse
from armwright.description.writer import write_toml
from armwright.errors import DescriptionError
from armwright.model import build_model
from description.urdf_files import AXIS, INERTIAL, LIMIT, joint as urdf_joint, link, robot, written
from docs.pages import run_here
from physics.arms import sprung, workshop


@pytest.mark.parametrize("name", ["cmu-dd", "lwa4p", "panda", "two-link"])
def test_built_in_arms_are_without_fault(name):
    report = aw.robotfiles.check(name)
    assert report.findings == ()
    assert report.joints == aw.load(name).n


def test_accepted_faults_are_warnings():
    report = aw.robotfiles.check("puma560")
    assert not report.errors
    assert [finding.check for finding in report.warnings] == ["mass properties"] * 2


def test_every_check_finds_what_it_looks_for(tmp_path):
    data = workshop()
    data["links"][0]["inertia_kg_m2"]["xx"] = 5.0  # beyond yy + zz
    data["links"][1]["mass_kg"] = 4000.0
    data["joints"][4]["motor"]["gear_efficiency"] = 0.3
    data["joints"][4]["friction"] = {"viscous_n_m_s_per_rad": 1.0, "smoothing_rad_per_s": 0.1}
    box = {"shape": "box", "size_m": [1e-3, 1e-3, 1e-3]}
    data["links"][4]["visuals"] = [{"solid": box, "xyz_m": [0, 0, 0], "rpy_rad": [0, 0, 0]}]
    data["remarks"] = ["a mesh is not on the search path"]
    path = write_toml(parse(data, "workshop"), tmp_path / "workshop.toml")
    report = aw.robotfiles.check(path)
    assert [(finding.check, "link1" in str(finding.problem)) for finding in report.errors] == [
        ("mass properties", True)
    ]
    found = {finding.check: str(finding.problem) for finding in report.warnings}
    assert set(found) == {"reading", "drives", "plausibility", "shapes"}
    assert "self-locking" in found["drives"]
    assert "link2" in found["plausibility"]
    assert "link5" in found["shapes"]
    assert report.findings[0].level == "error"
    (same,), (error,) = aw.robotfiles.check(parse(data, "workshop")).errors, report.errors
    assert replace(same.problem, file=error.problem.file) == error.problem
    lines = path.read_text(encoding="utf-8").split("\n")[: int(error.problem.line)]
    assert [line for line in lines if line.startswith("name")][-1] == 'name = "link1"'
    assert lines[-1].startswith(("inertia_kg_m2", "[links.inertia_kg_m2]"))


def test_moved_links_without_mass_are_asked_for_in_one_line(tmp_path):
    """Not those that what is fixed to them gives a mass, as the frames between two joints of a file often are."""
    names = ("base", "upper", "hand", "frame")
    masses = dict.fromkeys(names, "") | {"frame": INERTIAL}
    joints = (
        urdf_joint("j1", "base", "upper"),
        urdf_joint("j2", "upper", "hand"),
        urdf_joint("j3", "hand", "frame", kind="fixed"),
    )

    def asked(masses):
        path = written(tmp_path, robot(*(link(name, masses[name]) for name in names), *joints))
        new = tmp_path / "new.toml"
        new.unlink(missing_ok=True)
        aw.robotfiles.convert(path, new)
        found = {file: [str(each.problem) for each in aw.robotfiles.check(file).warnings] for file in (path, new)}
        return [
            [each.partition("links ")[2] or each for each in problems if "mass_kg" in each]
            for problems in found.values()
        ]

    for problems in asked(masses | {"frame": ""}):
        assert len(problems) == 1
        assert problems[0].startswith("'upper', 'hand': mass unknown?")
    assert ["link 'upper': mass unknown?" in problems[0] for problems in asked(masses)] == [True, True]
    assert asked(masses | {"upper": masses["frame"]}) == [[], []]


def test_what_loading_doubts_of_cylinders_is_a_finding():
    data = sprung()
    data["cylinders"][0]["length_m"] = 5.0
    robot = parse(data, "sprung")
    found = [str(finding.problem) for finding in aw.robotfiles.check(robot).warnings if finding.check == "cylinders"]
    assert any("length_m = 5.0" in finding for finding in found)
    assert set(found) <= set(build_model(robot).warnings)


def test_parts_that_have_changed(tmp_path):
    from shutil import copy

    import armwright.robots as robots

    for name in ("cmu-dd.parts.toml", "cmu-dd.toml"):
        copy(f"{next(iter(robots.__path__))}/{name}", tmp_path / name)
    assert aw.robotfiles.check(tmp_path / "cmu-dd.toml").findings == ()
    with (tmp_path / "cmu-dd.parts.toml").open("a") as file:
        file.write("# another drawing\n")
    (finding,) = aw.robotfiles.check(tmp_path / "cmu-dd.toml").warnings
    assert finding.check == "age"


def test_a_file_that_is_no_record(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text("name = 3", encoding="utf-8")
    with pytest.raises(DescriptionError) as caught:
        aw.robotfiles.check(path)
    assert caught.value.file == f"{path}:1"


def test_negative_gear_ratios_are_noted_and_no_warnings():
    report = aw.robotfiles.check("puma560")
    notes = [finding.problem for finding in report.findings if finding.level == "note"]
    joints = [joint for joint in aw.load("puma560").description.joints if float(joint.motor.gear_ratio) < 0]
    assert [note.place for note in notes] == [f"joint {joint.name!r} motor.gear_ratio" for joint in joints]
    assert all(float(note.value) < 0 for note in notes)
    assert not {finding.problem for finding in report.warnings} & set(notes)


def test_findings_that_differ_in_names_and_numbers_are_one_kind(tmp_path):
    def body(name, inertia):
        tensor = f'<inertia ixx="{inertia}" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/>'
        return link(name, f'<inertial><mass value="1"/>{tensor}</inertial>')

    names = ("a", "b", "c")
    pairs = [("base", "a"), ("a", "b"), ("b", "c")]
    path = written(
        tmp_path,
        robot(
            link("base", ""),
            *(body(name, inertia) for name, inertia in zip(names, (1.0, 2.0, 3.0), strict=True)),
            *(
                urdf_joint(f"j{child}", parent, child, AXIS + LIMIT + '<dynamics D="1" K="7000"/>')
                for parent, child in pairs
            ),
        ),
    )
    report = aw.robotfiles.check(path)
    assert len(report.errors) == 3  # each with its numbers
    (error,) = [kind for kind in report.kinds() if kind.level == "error"]
    assert error.problem.place == "links 'a', 'b', 'c' inertia_kg_m2"
    assert "= 1.0 to 3.0 > " in str(error.problem) or "= 1 to 3 > " in str(error.problem)
    (unused,) = [kind for kind in report.kinds() if "dynamics" in str(kind.problem)]
    assert "joints 'ja', 'jb', 'jc': <dynamics D K> is" in str(unused.problem)
    console = run_here(["armwright", "check", path.name], tmp_path).stdout
    assert console.count("error: ") == 1
    assert "3 errors" in console


def test_names_with_numbers_are_listed_and_no_range(tmp_path):
    reduction = '<actuator name="m"><mechanicalReduction>{}</mechanicalReduction></actuator>'
    geared = (
        f'<transmission name="t{k}"><joint name="Achse {k}"/>{reduction.format(50 * k)}</transmission>' for k in (1, 2)
    )
    joints = (
        urdf_joint("Achse 1", "base", "upper", AXIS + LIMIT),
        urdf_joint("Achse 2", "upper", "hand", AXIS + LIMIT),
    )
    path = written(tmp_path, robot(link("base", ""), link("upper"), link("hand"), *joints, *geared))
    (kind,) = [each for each in aw.robotfiles.check(path).kinds() if "gear ratio" in each.problem.what]
    assert kind.problem.place == "joints 'Achse 1', 'Achse 2'"
    assert "50 to 100" in kind.problem.what

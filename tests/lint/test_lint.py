"""Mistakes that robot files are known for are caught and named; good arms raise no alarm."""

from __future__ import annotations

import re
import tomllib
from importlib import resources

import numpy as np
import pytest

import armwright as aw
from armwright.description import builtin_names
from armwright.description.database import parse
from armwright.errors import Problem
from armwright.lint.hulls import implausible_shapes
from armwright.lint.plausibility import implausible_units
from armwright.model import build_model
from armwright.spatial import parallel_axes
from description.urdf_files import AXIS, joint, link, one_joint, robot, written
from physics.arms import workshop

ENTRIES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def inertial(mass, com, tensor):
    """A URDF's inertial; the tensor as a (3, 3) or a diagonal."""
    tensor = np.diag(tensor) if np.ndim(tensor) == 1 else np.asarray(tensor)
    entries = " ".join(f'i{"xyz"[i]}{"xyz"[j]}="{float(tensor[i, j])!r}"' for i, j in ENTRIES)
    xyz = " ".join(repr(float(c)) for c in com)
    return f'<inertial><origin xyz="{xyz}"/><mass value="{mass}"/><inertia {entries}/></inertial>'


def warnings(tmp_path, moved, more=""):
    """Warnings on loading a robot with that link; a joint 0.2 m on carries a light hand."""
    hand = link("hand", inertial(0.2, (0.01, 0, 0), (1e-4, 1e-4, 1e-4))) + joint("j2", "upper", "hand")
    path = written(tmp_path, one_joint(moved=moved, more=hand + more))
    return aw.load(path, tip="upper", on_impossible="warn").warnings


ROD = (1e-3, 0.02, 0.02)  # 1.5 kg, 0.4 m long


def test_good_arms_raise_no_alarm(tmp_path):
    assert warnings(tmp_path, inertial(1.5, (0.1, 0.01, 0.01), ROD)) == ()
    for name in builtin_names():
        assert not [warning for warning in aw.load(name).warnings if "accepted" not in warning]


@pytest.mark.parametrize(
    ("mass", "com", "tensor", "named"),
    [
        (1.5, (0.1, 0, 0), 1e6 * np.array(ROD), "a tensor in kg mm²"),
        (1.5, (0.1, 0, 0), 1e3 * np.array(ROD), "a tensor in g m²"),
        (1500.0, (0.1, 0, 0), 1e3 * np.array(ROD), "grams for kilograms"),
        (1.5e7, (0.1, 0, 0), 1e10 * np.array(ROD), "millimetres for metres"),
        (0.0, (0.1, 0, 0), (0.01, 0.01, 0.01), "a mass that was forgotten"),
        (2.0, (0.1, 0, 0), (0, 0, 0), "that of a point: one that was forgotten"),
        (1.5, (100.0, 0, 0), ROD, "millimetres for metres"),
        (1.219, (0, 0, 0), (0.111172755531, 0.111172755531, 0.21942), "wrist 1 and 2 of the old UR5"),
        (0.1879, (0, 0, 0), (0.0171364731454, 0.0171364731454, 0.033822), "wrist 3 of the old UR5"),
        (0.01, (0, 0, 0), (0.001, 0.001, 0.001), "every link in schunk_description's LWA 4P"),
        (1.68311, (0, 0, 0), (0.01, 0.01, 0.01), "the filler of the FZI and larics"),
    ],
)
def test_known_mistakes_are_named(tmp_path, mass, com, tensor, named):
    found = [t for t in warnings(tmp_path, inertial(mass, com, tensor)) if t.startswith("link 'upper'")]
    assert len(found) == 1
    assert re.search(named, found[0])


def two_link(**joints):
    """The built-in two-link arm with the first joint's tables changed, as a document."""
    data = tomllib.loads((resources.files("armwright.robots") / "two-link.toml").read_text(encoding="utf-8"))
    if "dh" in joints:
        del data["joints"][0]["frame"], data["joints"][0]["axis"]
    data["joints"][0].update(joints)
    return data


def test_point_masses_of_our_own_files_are_meant():
    data = two_link()
    for key in data["links"][0]["inertia_kg_m2"]:
        data["links"][0]["inertia_kg_m2"][key] = 0.0
    assert build_model(parse(data, "arm.toml")).warnings == ()
    data["links"][1]["mass_kg"] = 0.0
    (warning,) = build_model(parse(data, "arm.toml")).warnings
    assert "a mass that was forgotten" in warning


def test_units_of_joints():
    """Degrees and millimetres are named; four turns, rails and what stands for no limit are not."""
    row = {"alpha_rad": 0.0, "r_m": 0.0, "a_m": 0.3, "offset_rad": 0.0}
    for changed, place, value, what in (
        ({"dh": {**row, "alpha_rad": 90.0}}, "dh.alpha_rad", 90.0, "more than two turns: degrees for radians?"),
        ({"dh": {**row, "offset_rad": -90.0}}, "dh.offset_rad", -90.0, "more than two turns: degrees for radians?"),
        ({"dh": {**row, "a_m": 300.0}}, "dh.a_m", 300.0, "300 m away: millimetres for metres?"),
        ({"limits": {"position_rad": [-131, 131]}}, "limits.position_rad", (-131.0, 131.0), "degrees for radians?"),
    ):
        (found,) = implausible_units(parse(two_link(**changed), "arm.toml"))
        assert found == Problem(what, f"joint 'shoulder' {place}", value)
    for changed in (
        {"limits": {"position_rad": [-18.85, 18.85]}},
        {"limits": {"position_rad": [-1e4, 1e4]}},
        {"dh": {**row, "alpha_rad": -2 * np.pi}},
    ):
        assert not implausible_units(parse(two_link(**changed), "arm.toml")), changed


def test_a_joint_far_from_a_base_without_mass(tmp_path):
    path = written(tmp_path, one_joint().replace('xyz="0.2 0 0"', 'xyz="0 0 400"'))
    (warning,) = aw.load(path, tip="upper").warnings
    assert warning == "joint 'j1' frame.xyz_m = [0.0, 0.0, 400.0]: 400 m away: millimetres for metres?"


@pytest.mark.study
def test_improv_l5_breaks_the_triangle_inequality(tmp_path):
    """Robot-facts 2.2: zz = 7.43e-4 > 2 · 3.28e-4."""
    found = warnings(tmp_path, inertial(0.17, (0, 0, 0.042), (3.28e-4, 3.28e-4, 7.43e-4)))
    assert "link 'upper' inertia_kg_m2: an impossible inertia" in found[0]


def test_improv_l1_is_about_the_frame_origin(tmp_path):
    """Robot-facts 2.2: Iyz is just -m c_y c_z."""
    tensor = [[0.074338, 1e-6, -6e-6], [1e-6, 0.017132, 0.003742], [-6e-6, 0.003742, 0.074338]]
    (warning,) = warnings(tmp_path, inertial(1.62, (0, -0.175, 0.0132), tensor))
    assert "inertia_kg_m2.yz = 0.003742" in warning
    assert "a tensor about the frame's origin" in warning
    moved = np.array(tensor) - parallel_axes(1.62, np.array([0, -0.175, 0.0132]))
    assert warnings(tmp_path, inertial(1.62, (0, -0.175, 0.0132), moved)) == ()


def test_improv_ball_is_about_the_frame_origin(tmp_path):
    """Robot-facts 2.2, PB21: without looks nothing gives it away; beside its ball and flanges its size does."""
    ball = "".join(
        f'<visual><origin xyz="0 {y} {z}" rpy="{turn} 0 0"/><geometry>{shape}</geometry></visual>'
        for y, z, turn, shape in (
            (0, -0.1013, 0, '<sphere radius="0.0725"/>'),
            (0, -0.025, 0, '<cylinder radius="0.0625" length="0.05"/>'),
            (0.05065, -0.1013, 1.5708, '<cylinder radius="0.06" length="0.1013"/>'),
        )
    )
    given, com = np.diag([0.042799, 0.037801, 0.010997]), np.array([0, 0.018, -0.082])
    shifted = given - parallel_axes(3.9, com)
    for tensor, alarms in ((given, 1), (shifted, 0)):
        path = written(tmp_path, one_joint(moved=inertial(3.9, com, tensor) + ball))
        found = implausible_shapes(aw.load(path).description)
        assert len(found) == alarms
        assert all("a tensor about the frame's origin" in problem.what for problem in found)


def test_copied_efforts(tmp_path):
    """Robot-facts 2.1: the LWA 4P's effort limits are the older LWA's."""
    efforts = (370, 370, 176, 176, 41.6, 20.1)
    names = ["base", *(f"l{k}" for k in range(6))]
    body = inertial(1.5, (0.1, 0, 0), ROD)
    parts = [link("base", ""), *(link(name, body) for name in names[1:])]

    def arm(efforts):
        joints = (
            joint(f"j{k}", names[k], names[k + 1], f'{AXIS}<limit lower="-1" upper="1" effort="{e}" velocity="1"/>')
            for k, e in enumerate(efforts)
        )
        return aw.load(written(tmp_path, robot(*parts, *joints)), tip="l0")

    (warning,) = arm(efforts).warnings
    assert "'j0', 'j1', 'j2', 'j3', 'j4', 'j5' limits = [370.0, " in warning
    assert "the older Schunk LWA" in warning
    assert arm((370, 370, 176, 176, 41.6, 20.2)).warnings == ()


def test_fits_are_not_doubted(tmp_path):
    """Identified numbers need only move the arm right: the Panda's link 1 turns as if it were 0.4 m wide."""
    assert aw.load("panda").warnings == ()
    description = aw.load("panda").description
    assert description is not None
    source = description.sources["gaz2019"].replace(kind="publication")
    doubted = build_model(description.replace(sources={**description.sources, "gaz2019": source}))
    assert any("radius of gyration" in warning for warning in doubted.warnings)


@pytest.mark.parametrize(
    ("mass", "tensor", "named"),
    [
        (1.5, (1.6e-3, 1.6e-3, 1.6e-3), None),
        (1500.0, (1.6, 1.6, 1.6), "grams for kilograms"),
        (0.001001, (1.1e-6, 1.1e-6, 1.1e-6), "kg/m³"),
        (1.5, (1.6e-2, 1.6e-2, 1.6e-2), "times the tensor of its shape"),
        (1.5, (1.6e-9, 1.6e-9, 1.6e-9), "millimetres for metres"),
        (1.5, (0.0, 0.0, 0.0), "it looks like a body"),
    ],
)
def test_against_the_hull(tmp_path, mass, tensor, named):
    """A ball of 0.05 m and 1.5 kg has 0.0015 kg m²."""
    ball = '<visual><geometry><sphere radius="0.05"/></geometry></visual>'
    path = written(tmp_path, one_joint(moved=inertial(mass, (0, 0, 0), tensor) + ball))
    found = implausible_shapes(aw.load(path, on_impossible="warn").description)
    assert bool(found) == (named is not None)
    assert named is None or any(named in problem.what for problem in found)


@pytest.mark.parametrize(
    "solid",
    [
        {"shape": "cone", "bottom_radius_m": 0.05, "top_radius_m": 0.0, "length_m": 0.1},
        {"shape": "semi-cylinder", "radius_m": 0.05, "length_m": 0.1},
        {"shape": "prism", "outline_m": [[0, 0], [0.1, 0], [0, 0.1]], "length_m": 0.1},
        {"shape": "tube", "outer_radius_m": 0.05, "inner_radius_m": 0.04, "length_m": 0.1},
        {"shape": "box", "size_m": [0.1, 0.1, 0.1]},
    ],
    ids=lambda solid: solid["shape"],
)
def test_every_solid_has_a_hull(solid):
    """Masses are held against any shape; a hole is none."""
    data = workshop()
    one = data["links"][0]
    place = {"xyz_m": [0.0, 0.0, 0.0], "rpy_rad": [0.0, 0.0, 0.0]}
    one.update(mass_kg=100.0, visuals=[{"solid": solid, **place}])
    found = (f"link {one['name']!r} mass_kg", 100.0)
    assert found in [(problem.place, problem.value) for problem in implausible_shapes(parse(data, "x"))]
    one["visuals"][0]["hole"] = True
    assert not any("in a hull of" in problem.what for problem in implausible_shapes(parse(data, "x")))


def test_a_mesh_that_cannot_be_opened_is_told(tmp_path):
    (tmp_path / "a.stl").write_text("no mesh")
    seen = '<visual><geometry><mesh filename="a.stl"/></geometry></visual>'
    path = written(tmp_path, one_joint(moved=inertial(1.5, (0, 0, 0), ROD) + seen))
    (warning,) = implausible_shapes(aw.load(path).description)
    assert warning.place == "links 'upper'"
    assert warning.what.startswith("the visuals are not looked at: ")


def test_a_joint_that_moves_nothing(tmp_path):
    found = aw.load(written(tmp_path, one_joint(moved=""))).warnings
    assert any("joint 'j1': moves no mass: forward dynamics cannot be computed" in sentence for sentence in found)

"""Writing a description: reading it back gives the same one, writing that the same bytes."""

from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from armwright.description import builtin_names, read_description
from armwright.description.database import parse, read_toml
from armwright.description.robot import RobotDescription
from armwright.description.writer import to_toml, write_toml
from armwright.errors import OutputError
from armwright.model import build_model
from description.random_descriptions import descriptions


def again(text: str) -> RobotDescription:
    """What a written file reads as."""
    return parse(tomllib.loads(text), "again")


@settings(max_examples=80, deadline=None)
@given(descriptions())
def test_any_description_comes_back(robot):
    """Every value, source, deviation and date; then byte for byte."""
    text = to_toml(robot)
    read = again(text)
    assert read == robot
    assert to_toml(read) == text


@pytest.mark.parametrize("name", builtin_names())
def test_builtin_arms_are_written_as_they_stand(name):
    """The files of the package are canonical."""
    text = (resources.files("armwright.robots") / f"{name}.toml").read_text(encoding="utf-8")
    assert to_toml(read_description(name)) == text


@pytest.mark.parametrize("name", builtin_names())
def test_dynamics_are_kept_exactly(name, tmp_path):
    """The model of a written file has the same bits."""
    robot = read_description(name)
    one = build_model(robot)
    two = build_model(read_toml(write_toml(robot, tmp_path / "arm.toml")))
    assert np.array_equal(one.inertial_parameters, two.inertial_parameters)
    assert np.array_equal(one.drive_parameters, two.drive_parameters)
    for a, b in zip(one.bodies, two.bodies, strict=True):
        assert np.array_equal(a.placement.matrix(), b.placement.matrix())


def test_defaults_are_left_out():
    """An explicit default is the same description and the same file."""
    robot = read_description("puma560")
    told = robot.replace(base="base", frames=())
    assert to_toml(told) == to_toml(robot)


MESH = """
name = "m"
source = "estimate"
command = "torque"
[[joints]]
name = "j"
type = "revolute"
parent = "base"
child = "l"
dh = { alpha_rad = 0, r_m = 0, a_m = 0, offset_rad = 0 }
[[links]]
name = "l"
mass_kg = 1
com_m = [0, 0, 0]
inertia_kg_m2 = { xx = 1, xy = 0, xz = 0, yy = 1, yz = 0, zz = 1 }
[[links.visuals]]
solid = { shape = "mesh", file = "meshes/a.stl", scale = 0.001 }
xyz_m = [0, 0, 0]
rpy_rad = [0, 0, 0]
"""


def test_meshes_follow_the_file(tmp_path):
    """Written into another folder a mesh keeps its place; out of it, it is refused and nothing is written."""
    home = tmp_path / "home"
    (home / "meshes").mkdir(parents=True)
    (home / "arm.toml").write_text(MESH)
    robot = read_toml(home / "arm.toml")
    write_toml(robot, tmp_path / "up.toml")
    assert 'file = "home/meshes/a.stl"' in (tmp_path / "up.toml").read_text()
    up = read_toml(tmp_path / "up.toml").links[0].visuals[0].solid
    assert Path(up.path) == home / "meshes" / "a.stl"
    other = tmp_path / "other"
    other.mkdir()
    with pytest.raises(OutputError, match="not below the file's folder"):
        write_toml(robot, other / "arm.toml")
    assert not list(other.iterdir())

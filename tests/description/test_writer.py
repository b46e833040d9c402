"""Writing a description: reading it back gives the same one, writing that the same bytes."""

from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

import armwright as aw
from armwright.description import builtin_names, read_description
from armwright.description.database import parse, read_toml
from armwright.description.robot import RobotDescription
from armwright.description.writer import to_toml, write_toml
from armwright.errors import ModelError, OutputError
from armwright.export.mjcf import write_mjcf
from armwright.export.urdf import write_urdf
from armwright.model import Model, build_model
from description.random_descriptions import descriptions
from raises_at import raises_at
from reference.random_trees import random_description


def again(text: str) -> RobotDescription:
    """Record of a file as written and read again."""
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
def test_builtin_arms_are_written_as_they_stand(name, tmp_path):
    """The files of the package are canonical; those that name servos have their numbers from the library."""
    text = (resources.files("armwright.robots") / f"{name}.toml").read_text(encoding="utf-8")
    written = to_toml(read_description(name))
    if "\nservo = " in text:
        (tmp_path / "arm.toml").write_text(written, encoding="utf-8")
        text = to_toml(read_toml(tmp_path / "arm.toml"))
    assert written == text


@pytest.mark.sample(2)
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
    stated = robot.replace(base="base", frames=())
    assert to_toml(stated) == to_toml(robot)


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
    with raises_at(OutputError, "mesh", value=str(home / "meshes" / "a.stl")):
        write_toml(robot, other / "arm.toml")
    assert not list(other.iterdir())


def forms(folder: Path) -> dict[str, Model]:
    """An arm from every kind of file, and every kind of variant."""
    scara = aw.load("examples/scara.toml")
    write_urdf(scara, folder / "scara.urdf")
    write_urdf(scara, folder / "bare.urdf", drive=False)
    arms = {name: aw.load(name) for name in (*builtin_names(), "examples/scara.toml", "examples/hot-lift.toml")}
    arms |= {"urdf with drives": aw.load(folder / "scara.urdf"), "urdf": aw.load(folder / "bare.urdf", smoothing=0.01)}
    panda = arms["panda"]
    return arms | {
        "payload": panda.with_payload(1.0, [0, 0, 0.1], np.zeros(3)),
        "locked": panda.with_locked({"joint3": 0.4}),
        "subchain": panda.subchain("link2", "link6"),
        "values": panda.with_values({"link6.mass_kg": 2.0}),
        "random": build_model(random_description(3)),
    }


@pytest.mark.study
def test_arms_are_written_like_their_descriptions(tmp_path):
    """Text and file of an arm are those of its description, and read back as it."""
    for name, arm in forms(tmp_path).items():
        assert arm.description is not None
        text = aw.robotfiles.to_toml(arm)
        assert text == aw.robotfiles.to_toml(arm.description), name
        # those of a URDF whose joints have no motor have no place in a file
        known = arm.description.with_gear_ratios({})
        assert again(text) == known, name
        path = aw.robotfiles.write_toml(arm, tmp_path / "written.toml")
        assert aw.load(path, on_impossible="warn").description == known, name
        assert aw.robotfiles.check(arm).errors == aw.robotfiles.check(arm.description).errors


def test_an_mjcf_is_written_like_its_description(tmp_path):
    pytest.importorskip("mujoco")
    write_mjcf(aw.load("panda"), tmp_path / "panda.xml")
    arm = aw.load(tmp_path / "panda.xml", smoothing=0.01)
    assert again(aw.robotfiles.to_toml(arm)) == arm.description


@pytest.mark.parametrize(
    "write",
    [
        aw.robotfiles.to_toml,
        aw.robotfiles.check,
        lambda arm: write_urdf(arm, "x.urdf"),
        lambda arm: write_mjcf(arm, "x.xml"),
    ],
)
def test_what_no_description_holds_is_not_written(write, tmp_path, monkeypatch):
    """An arm that `replace` changed is not its description; a name is no arm."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ModelError) as error:
        write(aw.load("panda").replace(friction=None))
    assert (error.value.value, error.value.what) == ("panda", "differs from its description by replace(friction=…)")
    for wrong in ("panda", 5) if write is not aw.robotfiles.check else ():
        with pytest.raises(ModelError) as error:
            write(wrong)
        assert error.value.value == wrong
    assert not list(tmp_path.iterdir())

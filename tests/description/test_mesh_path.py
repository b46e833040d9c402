"""Meshes are looked for on the search path, and nowhere else."""

from __future__ import annotations

import pytest

from armwright.description.mesh_path import find_mesh, package_folders
from armwright.description.xml_tree import Element
from armwright.errors import DescriptionError
from raises_at import raises_at

HERE = Element("mesh", {}, "arm.urdf", 3)


@pytest.fixture
def tree(tmp_path):
    """ws/arm_description/{urdf,meshes}, and beside it what is nobody's business."""
    package = tmp_path / "ws" / "arm_description"
    for folder in ("urdf", "meshes"):
        (package / folder).mkdir(parents=True)
    (package / "meshes" / "a b.stl").write_text("")
    (package / "package.xml").write_text("")
    (package / "urdf" / "arm.urdf").write_text("")
    (tmp_path / "secret.stl").write_text("")
    (package / "meshes" / "link.stl").symlink_to(tmp_path / "secret.stl")
    return package


@pytest.fixture(autouse=True)
def no_ros(monkeypatch):
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)


def find(tree, name, *given):
    file = tree / "urdf" / "arm.urdf"
    return find_mesh(HERE, name, file, package_folders(file, given))


@pytest.mark.parametrize(
    "name",
    [
        "package://arm_description/meshes/a b.stl",
        "package://arm_description/meshes/a%20b.stl",
        "package:///arm_description/meshes/a b.stl",
        "model://arm_description/meshes/a b.stl",
        "../meshes/a b.stl",
    ],
)
def test_found_among_the_parents(tree, name):
    assert find(tree, name) == (tree / "meshes" / "a b.stl").resolve()
    assert find(tree, name.replace("b.stl", "c.stl")) is None


def test_found_in_given_folders_and_by_the_environment(tree, tmp_path, monkeypatch):
    other = tmp_path / "else" / "gripper"
    other.mkdir(parents=True)
    (other / "g.stl").write_text("")
    name = "package://gripper/g.stl"
    assert find(tree, name) is None
    assert find(tree, name, other) == find(tree, name, other.parent) == (other / "g.stl").resolve()
    assert find(tree, (other / "g.stl").as_uri(), other.parent) == (other / "g.stl").resolve()
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere/at/all:{other.parent}")
    assert find(tree, name) == (other / "g.stl").resolve()


@pytest.mark.parametrize(
    "name",
    [
        "package://arm_description/../../secret.stl",
        "package://arm_description/%2e%2e/%2e%2e/secret.stl",
        "package://arm_description/meshes/link.stl",
        "package://../secret.stl",
        "package://arm_description",
        "../../../secret.stl",
        "../meshes/link.stl",
        "/etc/passwd",
        "file:///etc/passwd",
        "https://example.org/a.stl",
        "a\0b.stl",
    ],
)
def test_never_outside(tree, name):
    with raises_at(DescriptionError, "<mesh>", file="arm.urdf:3"):
        find(tree, name)


def test_the_whole_disk_is_no_search_path(tree, tmp_path):
    """Packages beside the file's own are found, folders further up are not packages."""
    sibling = tree.parent / "tool_description"
    sibling.mkdir()
    (sibling / "t.stl").write_text("")
    assert find(tree, "package://tool_description/t.stl") == (sibling / "t.stl").resolve()
    (tmp_path / "private").mkdir()
    (tmp_path / "private" / "p.stl").write_text("")
    assert find(tree, "package://private/p.stl") is None
    top, *rest = (tmp_path / "private" / "p.stl").resolve().relative_to(tmp_path.anchor).parts
    assert find(tree, f"package://{top}/{'/'.join(rest)}") is None


def test_a_given_folder_that_is_none(tree):
    with raises_at(DescriptionError, "packages", "no such folder"):
        find(tree, "a.stl", tree / "nothing")

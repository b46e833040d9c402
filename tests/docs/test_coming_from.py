"""The page for users of other libraries: each example prints what it shows, beside that library; our names in it exist."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

import armwright as aw
from docs.pages import BLOCK, page, python, write_files
from reference.example_robots import robot_files

PAGE = "docs/coming-from.md"
SECTIONS = dict(re.findall(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", page(PAGE), re.DOTALL | re.MULTILINE))
LIBRARIES = {
    "Pinocchio": "pinocchio",
    "MuJoCo": "mujoco",
    "Robotics Toolbox for Python": "roboticstoolbox",
}


@pytest.mark.study
@pytest.mark.parametrize("title", LIBRARIES)
def test_the_numbers_agree(title: str, tmp_path: Path) -> None:
    pytest.importorskip(LIBRARIES[title], reason=f"needs {LIBRARIES[title]}: pip install armwright[bench]")
    if title == "Pinocchio":
        robots = [path for path in robot_files().values() if path.name == "ur5_robot.urdf"]
        if not robots:
            pytest.skip("needs the robots: pip install example-robot-data")
        shutil.copy(robots[0], tmp_path / "ur5.urdf")
    write_files(PAGE, tmp_path)
    found = [(match["kind"], match["text"]) for match in BLOCK.finditer(SECTIONS[title])]
    (program,) = (text for kind, text in found if kind == "python")
    (shown,) = (text for kind, text in found if kind == "text")
    assert python(program, tmp_path) == shown
    assert shown.count("True") >= 5
    assert "False" not in shown


def test_every_system_has_a_table() -> None:
    assert [title.split(",")[0] for title in SECTIONS] == [
        "Pinocchio",
        "MuJoCo",
        "Robotics Toolbox for Python",
        "MATLAB",
        "Drake",
    ]
    for text in SECTIONS.values():
        assert text.count("\n| ") >= 9


def test_the_names_of_ours_exist() -> None:
    """Whatever a table writes as `aw.NAME`, `dyn.NAME` or `arm.NAME` can be called."""
    text = page(PAGE)
    for name in set(re.findall(r"\baw\.(\w+)", text)):
        assert hasattr(aw, name), name
    for name in set(re.findall(r"\bdyn\.(\w+)", text)):
        assert hasattr(aw.CompiledArm, name), name
    for name in set(re.findall(r"\barm\.(\w+)", text)) - {"xml"}:
        assert hasattr(aw.load("two-link"), name), name

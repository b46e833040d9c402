"""Only regular files of a limited size are read: pipes, devices, links to themselves and long names are one line each."""

from __future__ import annotations

import contextlib
import os
import sys
import time

import pytest

import armwright as aw
from armwright.description.urdf import read_urdf
from armwright.errors import ArmwrightError, DescriptionError
from armwright.parts.build import build_parts
from armwright.reading import read_file
from armwright.results.csv_tables import CsvColumn, read_numbers
from armwright.session.files import read_script
from raises_at import raises_at

READERS = {  # what reads a file that the user names
    "toml": aw.load,
    "urdf": read_urdf,
    "xml": aw.load,
    "parts.toml": build_parts,
    "assembly.toml": aw.modules.assemble,
    "modules.toml": aw.modules.read_modules,
    "task.toml": aw.modules.read_task,
    "scenario.toml": aw.read_scenario,
    "csv": lambda path: read_numbers(path, [CsvColumn("t")]),
    "sim": lambda path: read_script(str(path)),
}
ENTRIES = {  # makes an odd entry at a path → what is said of it
    "a pipe": os.mkfifo if hasattr(os, "mkfifo") else None,
    "a device": lambda path: path.symlink_to("/dev/zero"),
    "a folder": lambda path: path.mkdir(),
    "cannot be read": lambda path: path.symlink_to(path.name),
    "no such file": lambda path: path.symlink_to("nowhere"),
}


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX entries of a file system")
@pytest.mark.parametrize("ending", READERS)
@pytest.mark.parametrize("what", ENTRIES)
def test_what_is_no_file_is_never_waited_for(what, ending, tmp_path):
    path = tmp_path / f"odd.{ending}"
    ENTRIES[what](path)
    start = time.monotonic()
    with pytest.raises(ArmwrightError) as error:
        READERS[ending](path)
    assert time.monotonic() - start < 60  # what waits does so for ever
    assert error.value.what.startswith(what)
    assert str(path) in str(error.value)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("ending", READERS)
@pytest.mark.parametrize("name", ["x" * 300, "x" * 5000, "a\0b"], ids=["300 letters", "5000 letters", "zero byte"])
def test_names_that_no_file_system_takes(name, ending):
    with pytest.raises(ArmwrightError) as error:
        READERS[ending](f"{name}.{ending}")
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX entries of a file system")
@pytest.mark.parametrize("robot", ["arm.urdf", "arm.xml", "arm.toml"])
@pytest.mark.parametrize("what", ["a pipe", "a device"])
def test_meshes_that_robots_name(what, robot, tmp_path, monkeypatch):
    """Drawing an arm opens its meshes; MuJoCo opens those of an MJCF itself."""
    pytest.importorskip("mujoco", reason="MJCF is read through MuJoCo: pip install mujoco")
    seeds = os.path.join(os.path.dirname(__file__), "fuzz", "seeds")
    source = "everything.toml" if robot == "arm.toml" else robot
    with open(os.path.join(seeds, source), encoding="utf-8") as file:
        text = file.read().replace("box.obj", "box.stl")
    path = tmp_path / robot
    path.write_text(text, encoding="utf-8")
    ENTRIES[what](tmp_path / "box.stl")
    start = time.monotonic()
    with contextlib.suppress(ArmwrightError):  # a picture may do without
        aw.show(aw.load(path, **({"smoothing": 0.01} if robot == "arm.urdf" else {})), tmp_path / "arm.png", size=64)
    assert time.monotonic() - start < 60


def test_a_file_that_is_too_large(tmp_path):
    path = tmp_path / "large.toml"
    path.write_bytes(b"x" * 11)
    assert read_file(path, "a TOML file", DescriptionError, most=11) == b"x" * 11
    with raises_at(DescriptionError, match="10 bytes", file=path):
        read_file(path, "a TOML file", DescriptionError, most=10)


@pytest.mark.parametrize("path", [3, None, 1.5, ["a"]])
def test_what_is_no_path(path):
    with pytest.raises(DescriptionError, match="a TOML file"):
        read_file(path, "a TOML file", DescriptionError)
    with pytest.raises(ArmwrightError, match="a CSV file"):
        aw.simulation.read_schedule(path, ["elbow"])

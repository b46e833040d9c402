"""Temporary files of writes: none is left behind for longer than until the next write."""

from __future__ import annotations

import contextlib
import functools
import os
import subprocess
import sys

import pytest

import armwright as aw
from armwright import output
from armwright.errors import OutputError
from armwright.export.c import write_c
from armwright.output import whole_file
from raises_at import raises_at

KILLED = """
import os, sys
from armwright.output import whole_file
with whole_file(sys.argv[1]) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), 9)
"""


def write(path):
    with whole_file(path) as temporary:
        temporary.write_text("whole")


def hidden(folder):
    return [entry.name for entry in folder.iterdir() if entry.name.startswith(".")]


def test_what_a_killed_write_left_is_removed_by_the_next_one(tmp_path):
    done = subprocess.run([sys.executable, "-c", KILLED, tmp_path / "run.nc"], check=False)
    assert done.returncode == -9
    assert len(hidden(tmp_path)) == 1
    write(tmp_path / "other.csv")
    assert [entry.name for entry in tmp_path.iterdir()] == ["other.csv"]


def test_files_of_running_writes_and_of_other_machines_stay(tmp_path):
    with whole_file(tmp_path / "run.nc") as temporary:
        temporary.write_text("half")
        elsewhere = tmp_path / f".armwright-00000000-{2**22 + 5}-{'0' * 16}.nc"
        user = tmp_path / ".armwright-notes"
        for path in (elsewhere, user):
            path.write_text("theirs")
        write(tmp_path / "other.csv")
        assert temporary.read_text() == "half"
        assert elsewhere.exists()
        assert user.exists()
    for path in (elsewhere, user):
        os.utime(path, (0, 0))
    write(tmp_path / "other.csv")
    assert sorted(hidden(tmp_path)) == [user.name]


@pytest.mark.parametrize("process", ["0", "-1", "99999999999999999999", "x"])
def test_names_that_only_look_like_ours_are_left_alone(tmp_path, process):
    path = tmp_path / f".armwright-{output._host()}-{process}-{'0' * 16}.nc"
    path.write_text("")
    write(tmp_path / "other.csv")
    assert path.exists()


def test_a_link_in_place_of_a_file_that_the_user_did_not_name_is_replaced(tmp_path):
    """Files beside the one that was named: behind a foreign folder's link another file would be overwritten."""
    (tmp_path / "secret").write_text("kept")
    for name in ("arm.urdf", "arm.drive.toml", "two_link.c"):
        (tmp_path / name).symlink_to(tmp_path / "secret" if name != "arm.urdf" else tmp_path / "named.urdf")
    aw.robotfiles.convert("two-link", tmp_path / "arm.urdf")
    write_c(aw.load("two-link"), ["jacobian"], tmp_path)
    assert (tmp_path / "secret").read_text() == "kept"
    assert (tmp_path / "named.urdf").is_file()
    assert [(tmp_path / name).is_symlink() for name in ("arm.urdf", "arm.drive.toml", "two_link.c")] == [
        True,
        False,
        False,
    ]


@contextlib.contextmanager
def full_disk():
    """Files of this process can have 600 bytes: a write beyond fails as on a full disk."""
    resource = pytest.importorskip("resource", reason="POSIX limits the length of files")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (600, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@functools.cache
def scenario() -> aw.Scenario:
    return aw.Scenario(aw.load("two-link"), duration=0.05, loop=aw.Loop(aw.JointPID(kp=10.0), [0.1, 0.2], period=1e-3))


@functools.cache
def run():
    return aw.simulate(scenario())


WRITERS = {  # what writes one file or several into a folder
    "export_controller": lambda folder: aw.export.export_controller(scenario(), folder / "c"),
    "write_c": lambda folder: write_c(aw.load("two-link"), ["mass_matrix"], folder / "c"),
    "export_fmu": lambda folder: aw.export.export_fmu(scenario(), folder / "arm.fmu", platforms=["host"]),
    "export_ros2": lambda folder: aw.export.export_ros2(aw.load("two-link"), folder / "ros"),
    **{f"convert to {ending}": lambda folder, ending=ending: aw.robotfiles.convert("puma560", folder / f"arm.{ending}")
       for ending in ("toml", "urdf", "xml")},
    **{f"save as {ending}": lambda folder, ending=ending: aw.save(run(), folder / f"run.{ending}")
       for ending in ("nc", "csv", "mcap", "mat", "parquet")},
    **{f"plot as {ending}": lambda folder, ending=ending: aw.plot(run(), folder / f"run.{ending}")
       for ending in ("svg", "png", "html")},
    "animate": lambda folder: aw.animate(run(), scenario().arm, folder / "run.glb"),
    "show": lambda folder: aw.show(scenario().arm, folder / "arm.png", size=120),
}  # fmt: skip


@pytest.mark.sample(3)
@pytest.mark.parametrize(("writer", "compiler"), [*((name, True) for name in WRITERS), ("export_controller", False)])
def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path, monkeypatch, writer, compiler):
    """Of the folder for results, and, where a compiler works there, of the one for temporary files."""
    if not compiler:
        monkeypatch.setattr("armwright.export.controller.write.find_compiler", lambda: None)
    room, full = tmp_path / "room", tmp_path / "full"
    room.mkdir(), full.mkdir()
    WRITERS[writer](room)  # what it compiles is kept from now on
    assert list(room.iterdir())
    with full_disk(), raises_at(OutputError, match="cannot be written") as error:
        WRITERS[writer](full)
    assert "\n" not in str(error.value)
    assert not list(full.iterdir())

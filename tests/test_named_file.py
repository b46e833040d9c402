"""Files that other files name: which paths are taken, and which lead out of the folder."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from armwright.errors import ScenarioError
from armwright.named_file import named_file
from raises_at import raises_at


@pytest.fixture
def folder(tmp_path):
    """A folder with a file, in another one with a file."""
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "u.csv").write_text("t\n0\n")
    (tmp_path / "secret.csv").write_text("secret\n")
    return tmp_path / "data"


def named(name, folder, allow=()):
    return named_file(name, folder, allow, place="schedule", error=ScenarioError)


def test_a_file_in_the_folder_or_below_is_taken(folder):
    (folder / "deep").mkdir()
    (folder / "deep" / "v.csv").write_text("t\n")
    (folder / "link.csv").symlink_to(folder / "u.csv")
    for name in ("u.csv", "deep/v.csv", "deep/../u.csv", "link.csv", str(folder / "u.csv")):
        assert named(name, folder).is_file()


@pytest.mark.parametrize("name", ["../secret.csv", "{}/secret.csv", "link.csv", "links/secret.csv", "/etc/passwd"])
def test_a_path_that_leads_out_needs_permission(folder, name):
    (folder / "link.csv").symlink_to(folder.parent / "secret.csv")
    (folder / "links").symlink_to(folder.parent)
    name = name.format(folder.parent)
    with raises_at(ScenarioError, "schedule", "--allow", value=name):
        named(name, folder)
    assert named(name, folder, [Path("/etc") if "etc" in name else folder.parent]).is_file()


def test_the_folder_may_itself_be_a_link(folder):
    (folder.parent / "other").symlink_to(folder)
    assert named("u.csv", folder.parent / "other").name == "u.csv"


@pytest.mark.parametrize("name", ["none.csv", ".", "loop", "pipe", "x" * 5000, "nu\0ll", ""])
def test_what_is_no_plain_file_is_refused_and_never_opened(folder, name):
    (folder / "loop").symlink_to("loop")
    os.mkfifo(folder / "pipe")
    with pytest.raises(ScenarioError) as refused:
        named(name, folder)
    assert refused.value.place == "schedule"
    assert len(str(refused.value)) < 300

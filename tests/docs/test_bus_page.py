"""The page from data sheets to the bus runs as it stands: every file and command, in its order, in one folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.pages import blocks, sessions, shell, write_files

PAGE = "docs/datasheet-to-bus.md"


@pytest.mark.study
def test_the_page_runs_as_it_says(tmp_path: Path) -> None:
    """Each line that is shown is printed, and no command fails."""
    pytest.importorskip("control", reason="python-control is not installed: pip install armwright[control]")
    pytest.importorskip("canopen", reason="canopen is not installed: pip install armwright[twin]")
    write_files(PAGE, tmp_path)
    commands = 0
    for kind, text in blocks(PAGE):
        for command, lines in sessions(text) if kind == "console" else ():
            done = shell(command, tmp_path)
            assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
            printed = [" ".join(line.split()) for line in done.stdout.splitlines()]
            for line in lines:
                assert " ".join(line.split()) in printed, f"{command}: {line!r} is shown, and not printed"
            commands += 1
    assert commands == 16

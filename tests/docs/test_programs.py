"""Pages whose code is one program: it runs, and prints what the page shows."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from docs.pages import blocks, comparable, python

PROGRAMS = (
    "docs/extending.md",
    "docs/cartesian-motion.md",
    "docs/collision.md",
    "docs/how-to/inverse-kinematics.md",
    "docs/how-to/simulation.md",
    "docs/identify-linear.md",
    "docs/time-optimal.md",
)


OWN_PROCESS = ("docs/extending.md",)  # in a process of its own: its laws and kinds must be there before a robot is read


def python_in_own_process(code: str, folder: Path) -> str:
    """Output of a page's Python in a process of its own."""
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.study
@pytest.mark.parametrize("name", PROGRAMS)
def test_it_prints_what_the_page_shows(name: str, tmp_path: Path) -> None:
    found = blocks(name)
    program = "\n".join(text for kind, text in found if kind == "python")
    shown = "".join(text for kind, text in found if kind == "text")
    printed = python_in_own_process(program, tmp_path) if name in OWN_PROCESS else python(program, tmp_path)
    assert comparable(printed.splitlines()) == comparable(shown.splitlines())


def test_extensions_are_compiled_in_the_loop() -> None:
    shown = "".join(text for kind, text in blocks("docs/extending.md") if kind == "text")
    assert shown.count("controller: compiled") == 3

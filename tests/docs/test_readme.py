"""What README and tutorial show is what happens."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from docs.pages import ROOT, blocks, blocks_in_order, comparable, page, python, sessions, shell

NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")
README_COMMANDS = [
    line.partition("#")[0].strip()
    for kind, text in blocks("README.md")
    if kind == "sh"
    for line in text.replace("\\\n", " ").splitlines()
    if line.startswith("armwright")
]
SHOWN = [(command, lines) for kind, text in blocks("docs/tutorial.md") if kind == "console" for command, lines in sessions(text)]  # fmt: skip  # noqa: E501


def test_the_readme_s_python_prints_what_it_shows(tmp_path: Path) -> None:
    code, printed = (
        next(text for kind, text in blocks("README.md") if kind == wanted) for wanted in ("python", "text")
    )
    assert 5 <= len([line for line in code.splitlines() if line]) <= 12
    result = python(code, tmp_path)
    assert NUMBER.sub("#", result).split() == NUMBER.sub("#", printed).split()
    ours, shown = ([float(number) for number in NUMBER.findall(text)] for text in (result, printed))
    np.testing.assert_allclose(ours, shown, atol=1e-3)


@pytest.mark.study
def test_the_readme_s_commands_run(tmp_path: Path) -> None:
    """One after the other in one folder, as a reader types them."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for command in README_COMMANDS:
        done = shell(command, tmp_path)
        assert done.returncode == 0, f"{command}: {done.stderr}"


def test_the_picture_s_command_is_the_demo_s() -> None:
    """The README's picture is what `make demo` draws."""
    demo = re.search(r"^DEMO\s*:= (.*?)(?<!\\)$", page("Makefile"), re.DOTALL | re.MULTILINE)
    assert demo is not None
    words = shlex.split(demo[1].replace("\\\n", " "))
    shown = shlex.split(README_COMMANDS[-1])[1:]
    files = {"-o", "--plot"}

    def driven(command: list[str]) -> list[str]:
        return [w for k, w in enumerate(command) if w not in files and (k == 0 or command[k - 1] not in files)]

    assert driven(words) == driven(shown)


@pytest.mark.study
def test_the_tutorial_runs_as_it_says(tmp_path: Path) -> None:
    """Commands and Python of the tutorial, in its order, in one folder."""
    pytest.importorskip("control", reason="python-control is not installed: pip install armwright[control]")
    result = ""
    for kind, text in blocks_in_order("docs/tutorial.md", tmp_path):
        if kind == "python":
            result = python(text, tmp_path)
        if kind == "text" and result:
            assert comparable(result.splitlines()) == comparable(text.splitlines())
            result = ""
        for command, lines in sessions(text) if kind == "console" else ():
            done = shell(command, tmp_path)
            wrong = any("armwright: error:" in line for line in lines)
            assert done.returncode == (2 if wrong else 0), f"{command}: {done.stderr}"
            happened = comparable((done.stdout + done.stderr).splitlines())
            for line in comparable(lines):
                assert line in happened, f"{command}: {line!r} is shown, but what it prints is {happened}"


def test_the_tutorial_brings_an_own_arm_under_control_in_few_commands() -> None:
    """From the clone to the picture; set-up included."""
    section = page("docs/tutorial.md").split("## Your own arm under control")[1]
    typed = re.findall(r"^\$ (armwright .*)$", section, re.MULTILINE)
    assert [words.split()[1] for words in typed] == ["new", "check", "check", "show", "plan", "design", "simulate"]
    assert len(typed) + len(["make demo", "source", "pip install"]) <= 12
    run = typed[-1].split()
    assert run[-2:] == ["--plot", "hold.png"]


def test_the_batches_page_runs(tmp_path: Path) -> None:
    code = "".join(text for kind, text in blocks("docs/how-to/batches.md") if kind == "python")
    printed = python(code + "print(grid.shape, tau.shape, run.q.dims)", tmp_path)
    assert printed.strip() == "(100, 1000, 6) (100000, 6) ('lane', 'time', 'joint')"


def test_the_pages_show_commands() -> None:
    assert len(README_COMMANDS) >= 4
    assert len(SHOWN) >= 6

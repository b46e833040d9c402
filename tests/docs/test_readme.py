"""What README and tutorial show is what happens."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from docs.pages import ROOT, blocks, blocks_in_order, comparable, page, python, sessions, shell, write_files

NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


def _commands(name: str) -> list[str]:
    """Commands of a page's `sh` blocks, continued lines joined, without comments."""
    lines = (line for kind, text in blocks(name) if kind == "sh" for line in text.replace("\\\n", " ").splitlines())
    return [line.partition("#")[0].strip() for line in lines if line.startswith("armwright")]


README_COMMANDS, GLANCE = _commands("README.md"), _commands("docs/at-a-glance.md")
LESSONS = ("docs/tutorial.md", "docs/tutorial-margins.md")
BUILT_IN = ("docs/how-to/built-in-arm.md",)


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
def test_the_readme_takes_an_own_arm_under_control_in_five_commands(tmp_path: Path) -> None:
    """From an empty folder; the numbers that a reader fills in are those of the tutorial."""
    pytest.importorskip("control", reason="python-control is not installed: pip install armwright[control]")
    assert [command.split()[1] for command in README_COMMANDS] == ["new", "check", "plan", "design", "simulate"]
    new, check, *others = README_COMMANDS
    assert shell(new, tmp_path).returncode == 0
    assert "values to fill in" in shell(check, tmp_path).stderr
    write_files("docs/tutorial.md", tmp_path)
    write_files("README.md", tmp_path)
    for command in (check, *others):
        done = shell(command, tmp_path)
        assert done.returncode == 0, f"{command}: {done.stderr}"
        assert "note" not in done.stderr  # which would report a limit
    assert (tmp_path / "hold.png").stat().st_size > 10_000


@pytest.mark.study
def test_the_commands_at_a_glance_run(tmp_path: Path) -> None:
    """One after the other in one folder, as a reader types them."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for command in GLANCE:
        done = shell(command, tmp_path)
        assert done.returncode == 0, f"{command}: {done.stderr}"


def test_the_picture_s_command_is_the_demo_s() -> None:
    """The picture of the built-in arm is what `make demo` draws."""
    demo = re.search(r"^DEMO\s*:= (.*?)(?<!\\)$", page("Makefile"), re.DOTALL | re.MULTILINE)
    assert demo is not None
    words = shlex.split(demo[1].replace("\\\n", " "))
    shown = shlex.split(GLANCE[-1])[1:]
    files = {"-o", "--plot"}

    def driven(command: list[str]) -> list[str]:
        return [w for k, w in enumerate(command) if w not in files and (k == 0 or command[k - 1] not in files)]

    assert driven(words) == driven(shown)


@pytest.mark.study
@pytest.mark.parametrize("pages", [LESSONS, BUILT_IN], ids=["tutorial", "built-in-arm"])
def test_they_run_as_they_say(pages: tuple[str, ...], tmp_path: Path) -> None:
    """Commands and Python of these pages, in their order, in one folder; where C is compiled, it has the simulation's bits."""
    pytest.importorskip("control", reason="python-control is not installed: pip install armwright[control]")
    result = ""
    for kind, text in (block for name in pages for block in blocks_in_order(name, tmp_path)):
        if kind == "python":
            result = python(text, tmp_path)
        if kind == "text" and result:
            assert comparable(result.splitlines()) == comparable(text.splitlines())
            result = ""
        for command, lines in sessions(text) if kind == "console" else ():
            done = shell(command, tmp_path)
            printed = "\n".join(lines)
            code = 2 if "armwright: error:" in printed else 1 if "does not keep its margins" in printed else 0
            assert done.returncode == code, f"{command}: {done.stderr}"
            happened = comparable((done.stdout + done.stderr).splitlines())
            for line in comparable(lines):
                assert line in happened, f"{command}: {line!r} is shown, but what it prints is {happened}"
            if "export" in command and shutil.which("gcc"):
                assert any("1063 steps: every command has the bits of the simulation" in line for line in happened)


def test_the_tutorial_brings_an_own_arm_under_control_in_few_commands() -> None:
    """From the clone to the picture; set-up included."""
    typed = re.findall(r"^\$ (armwright .*)$", page("docs/tutorial.md"), re.MULTILINE)
    assert [words.split()[1] for words in typed] == ["new", "check", "check", "show", "plan", "design", "simulate"]
    assert len(typed) + len(["venv", "source", "pip install"]) <= 12
    assert typed[-1].split()[-2:] == ["--plot", "hold.png"]


def test_the_batches_page_runs(tmp_path: Path) -> None:
    code = "".join(text for kind, text in blocks("docs/how-to/batches.md") if kind == "python")
    printed = python(code + "print(grid.shape, tau.shape, run.q.dims)", tmp_path)
    assert printed.strip() == "(100, 1000, 6) (100000, 6) ('lane', 'time', 'joint')"


def test_the_pages_show_commands() -> None:
    assert len(GLANCE) >= 10
    assert (
        len([line for name in (*LESSONS, *BUILT_IN) for line in page(name).splitlines() if line.startswith("$ ")]) >= 18
    )

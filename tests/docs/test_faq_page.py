"""Every command of the page of questions prints what the page shows."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs.pages import blocks, comparable, page, sessions, shell, write_files

PAGE = "docs/faq.md"
SHOWN = [session for kind, text in blocks(PAGE) if kind == "console" for session in sessions(text)]


@pytest.mark.study
def test_the_page_runs_as_it_says(tmp_path: Path) -> None:
    write_files(PAGE, tmp_path)
    for command, lines in SHOWN:
        done = shell(command, tmp_path)
        is_error = any(line.startswith("armwright: error:") for line in lines)
        assert done.returncode == (2 if is_error else 0), f"{command}: {done.stdout}{done.stderr}"
        printed = comparable((done.stdout + done.stderr).splitlines())
        for line in comparable(lines):
            found = [each for each in printed if each == line or (line[-1] == "…" and each.startswith(line[:-1]))]
            assert found, f"{command}: {line!r} is shown, but it prints {printed}"


def test_the_page_has_errors_and_notes() -> None:
    lines = "\n".join(line for _, lines in SHOWN for line in lines)
    assert lines.count("armwright: error:") >= 8
    assert lines.count("armwright: note:") >= 2


def test_messages_that_the_page_quotes_are_those_of_the_code() -> None:
    """Quoted starts of messages stand in the source, without their values."""
    source = "\n".join(
        path.read_text(encoding="utf-8") for path in Path(__file__).parents[2].glob("src/armwright/**/*.py")
    )
    for fixed in (
        "and could carry physics", "run it first, xacro", "forward dynamics cannot be computed",
        "the model has no end stop", "traced symbol", "called in Python once a tick",
        "the simulation diverged to infinite numbers or NaN",
        "no C compiler here (gcc, clang, cc)", "as CiA 402 drives take", "may be those of a real arm",
        "there is none to compare the servos with", "not reached, the nearest pose is", "did you mean",
    ):  # fmt: skip
        assert fixed in source, fixed
        words = re.escape(fixed.split(",")[0].split(" is")[0])
        assert re.search(words.replace(r"\ ", r"\s+"), page(PAGE)), fixed

"""Texts from files reach a terminal as text: names, titles, notes, units and errors steer nothing."""

from __future__ import annotations

import ast
import io
import os
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from rich.table import Table
from rich.text import Text

import armwright as aw
from armwright import terminal
from armwright.errors import DescriptionError
from armwright.printable import STEERING, printable
from armwright.session import Session
from armwright.session.listing import Screen
from cli.test_bad_input import refused
from cli.test_commands import run

SOURCE = Path(aw.__file__).parent
HOSTILE = "\x1b]0;owned\x07\x1b[2J\u202efdp.exe\u2066\x9b31m\x08\x7f\u200e"  # title, clear, bidi, C1, backspace, delete
NAME = "(0 fdp 🦾"  # what a name may hold: all that is seen
FUNCTIONS, METHODS = ("print", "Console"), ("echo", "secho", "Console")  # what else would write to the terminal
ALLOWED = {  # files, and why
    "terminal.py": "the place itself",
    "session/python_prompt.py": "shows what a line of Python printed, which is a program of the user's",
    "cli/app.py": "typer's own help",
}


def is_safe(text: str) -> bool:
    return not any(unicodedata.category(letter) in STEERING for letter in text if letter not in "\n\t")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("q̇ [rad/s²], 90 % ⣿ 🦾\n\tx", "q̇ [rad/s²], 90 % ⣿ 🦾\n\tx"),
        ("\x1b[2J", r"\x1b[2J"),
        ("a\r\nb\x00", r"a\x0d" + "\n" + r"b\x00"),
        ("\u202eabc\u2028", r"\u202eabc\u2028"),
        ("\U000e0041\x9b", r"\U000e0041\x9b"),
    ],
)
def test_steering_characters_are_escaped(text, shown):
    assert printable(text) == shown
    assert printable(shown) == shown


@pytest.mark.parametrize("terminal_of", [True, False])
def test_a_console_keeps_its_own_colours_and_no_others(terminal_of):
    file = io.StringIO()
    console = terminal.console(
        file=file, force_terminal=terminal_of, width=200, color_system="standard" if terminal_of else None
    )
    table = Table(title="t" + HOSTILE)
    table.add_column("head" + HOSTILE)
    table.add_row(Text("cell" + HOSTILE, style="red"))
    console.print(table)
    console.print("[bold]:smile:" + HOSTILE, style="yellow")
    written = file.getvalue()
    assert "[bold]:smile:" in written
    assert ("\x1b[31m" in written) == terminal_of
    for part in ("\x1b[2J", "\x1b]0;", "\u202e", "\u2066", "\x9b", "\x08", "\x7f"):
        assert part not in written


def test_errors_are_printable_whoever_shows_them():
    error = DescriptionError("title" + HOSTILE, place=HOSTILE, value=HOSTILE, file=HOSTILE, choices=[HOSTILE])
    assert is_safe(str(error))


@pytest.fixture
def robot(tmp_path):
    """A robot whose names, title and notes would steer a terminal."""
    text = aw.robotfiles.to_toml(aw.load("two-link").record)
    escaped = "".join(f"\\u{ord(letter):04x}" for letter in HOSTILE)
    text = text.replace('"shoulder"', f'"shoulder{NAME}"').replace('name = "two-link"', f'name = "two{NAME}"')
    path = tmp_path / "arm.toml"
    path.write_text(f'title = "title{escaped}"\nnotes = "notes{escaped}"\n' + "\n".join(
        line for line in text.splitlines() if not line.startswith(("title", "notes"))
    ))  # fmt: skip
    return path


def test_commands_show_hostile_names_as_text(robot, tmp_path):
    assert HOSTILE in aw.load(robot).record.title
    done = tmp_path / "run.nc"
    shown = [
        run("info", robot), run("check", robot), run("diff", robot, "two-link"),
        run("simulate", robot, "--torque", "500", "--duration", "0.5", "-o", done), run("plot", done),
        run("simulate", robot, "--torque", "1", "--duration", "0.01"),
    ]  # fmt: skip
    for each in shown:
        assert is_safe(each.stdout)
        assert is_safe(each.stderr)
    assert "two(0 fdp 🦾" in shown[0].stdout
    assert r"title\x1b]0;owned" in shown[0].stdout
    assert is_safe(refused(("simulate", robot, "--voltage", "1", "--duration", "1")))
    assert is_safe(refused(("plot", done, "--joints", "x" + HOSTILE)))


def test_a_session_shows_hostile_names_and_notes_as_text(robot, tmp_path):
    file = io.StringIO()
    screen = Screen(terminal.console(file=file, force_terminal=False))
    session = Session(str(robot))
    for line in ("show", "simulate new steps=20", "print-simulation", "plot-simulation", "inverse-arm"):
        for output in session.run(line):
            screen(output)
    screen.error("error" + HOSTILE)
    assert is_safe(file.getvalue())
    assert "shoulder(0 fdp 🦾" in file.getvalue()
    assert r"error\x1b]0;owned" in file.getvalue()


def test_units_and_notes_of_a_run_are_shown_as_text(tmp_path):
    scenario = aw.Scenario(aw.load("two-link"), 0.01, command=np.zeros(2))
    done = aw.simulate(scenario)
    done["q_measured"] = done.q.assign_attrs(units=HOSTILE, long_name=HOSTILE)
    done.attrs |= {"robot": HOSTILE, "partial": HOSTILE, "notes": HOSTILE}
    aw.save(done, tmp_path / "run.nc")
    shown = run("plot", tmp_path / "run.nc", "--quantities", "q,q_measured")
    assert is_safe(shown.stdout)
    assert r"\x1b[2J" in shown.stdout
    assert is_safe(refused(("animate", tmp_path / "run.nc", "-o", tmp_path / "run.glb")))


@pytest.mark.sample(149)
@pytest.mark.parametrize("path", sorted(SOURCE.rglob("*.py")), ids=lambda path: path.relative_to(SOURCE).as_posix())
def test_nothing_else_writes_to_the_terminal(path):
    if path.relative_to(SOURCE).as_posix() in ALLOWED:
        return
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            called = node.func
            assert not (isinstance(called, ast.Name) and called.id in FUNCTIONS), node.lineno
            assert not (isinstance(called, ast.Attribute) and called.attr in METHODS), node.lineno
            assert not ast.unparse(called).endswith(("stdout.write", "stderr.write")), node.lineno


def test_rooms_are_found():
    assert len(list(SOURCE.rglob("*.py"))) > 300
    assert os.fspath(SOURCE).endswith("armwright")

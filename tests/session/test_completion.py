"""Completion of commands, variables, joints, arguments, arms and files; a session typed into prompt_toolkit's own pipe."""

from __future__ import annotations

import io

import pytest
from prompt_toolkit.completion import CompleteEvent
from prompt_toolkit.document import Document
from prompt_toolkit.input import create_pipe_input
from prompt_toolkit.output import DummyOutput
from rich.console import Console

from armwright.session import Session
from armwright.session.listing import Screen
from armwright.session.terminal import SessionCompleter, interact

SESSION = Session()


def offered(text):
    return [c.text for c in SessionCompleter(SESSION).get_completions(Document(text), CompleteEvent())]


@pytest.mark.parametrize(
    ("text", "there"),
    [
        ("inv", {"inverse-arm"}),
        ("inverse_a", {"inverse-arm"}),
        ("the", {"theta"}),
        ("DAC", {"DACOut", "DACSampTimePeriod"}),
        ("theta[", {f"joint{k}]" for k in range(1, 7)}),
        ("theta[joint3", {"joint3]"}),
        ("theta = 30 de", {"deg"}),
        ("theta = 2*om", {"omega"}),
        ("simulate ", {"new", "continue", "start=", "steps="}),
        ("simulate new st", {"steps="}),
        ("simulate start=c", {"continue"}),
        ("database-read pu", {"puma560"}),
        ("pose ha", {"hand"}),
        ("controller joint", {"joint-pid"}),
        ("controller joint-pid k", {"kp=", "ki=", "kd="}),
        ("help simul", {"simulate"}),
    ],
)
def test_what_is_offered(text, there):
    assert there <= set(offered(text))
    if text.isalpha():
        assert all(word.lower().startswith(text.lower()) for word in offered(text))


def test_what_is_given_is_not_offered_again():
    assert offered("simulate new st") == ["steps="]
    assert offered("simulate new start=") == ["new", "continue"]
    assert offered("simulate foo=1 st") == []


def test_files_are_offered(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "volts.csv").write_text("")
    assert "ts.csv" in offered("simulate new schedule=vol")
    assert "ts.csv" in offered("run-script vol")
    assert offered("nonsense ") == []


def type_into(keys, width=140):
    """Screen of a session after those keys."""
    stream = io.StringIO()
    screen = Screen(Console(file=stream, width=width, force_terminal=True, color_system=None, highlight=False))
    with create_pipe_input() as pipe:
        pipe.send_text(keys)
        interact(Session(), screen, input=pipe, output=DummyOutput())
    return stream.getvalue()


def test_errors_leave_the_session_alive(monkeypatch):
    monkeypatch.setenv("ARMWRIGHT_CACHE_DIR", "")
    said = type_into("foo\rtheta = 1 2\rsimulate\rsoon\r\x03theta[1] = 7\rtheta[1]\rquit\r")
    assert "error: 'foo': no such command or variable" in said
    assert "error: theta = '1 2': 2 values" in said
    assert "expected new or continue" in said
    assert "interrupted; nothing has changed" in said
    assert "theta[joint1] = 7 rad" in said


def test_the_end_of_input_ends_it(monkeypatch):
    monkeypatch.setenv("ARMWRIGHT_CACHE_DIR", "")
    assert "Ctrl-D leaves" in type_into("\x04")


def test_a_table_wider_than_the_screen_comes_in_parts(monkeypatch):
    monkeypatch.setenv("ARMWRIGHT_CACHE_DIR", "")
    said = type_into("jacobian\rquit\r", width=60)
    assert max(len(line.rstrip()) for line in said.splitlines()[2:]) <= 62
    assert said.count("v x [m/s]") == 3

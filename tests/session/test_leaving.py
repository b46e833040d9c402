"""Leaving a session asks about a simulation that is not saved; `exit` leaves a question; surprising values are remarked on."""

from __future__ import annotations

import pytest

from armwright.errors import SessionError
from armwright.session import Session
from armwright.session.listing import TextLine
from armwright.session.workspace import UNSAVED


def texts(shown):
    return " ".join(part.text for part in shown if isinstance(part, TextLine))


@pytest.fixture(scope="module")
def simulated():
    """A session with a simulation, to be copied by its state."""
    session = Session("two-link")
    session.run("simulate new steps=3")
    return session.state


def session_with(state, *answers):
    """A session in that state, and the questions that it asked."""
    given, asked = iter(answers), []

    def ask(argument, default):
        asked.append(argument.prompt)
        answer = next(given)
        if answer is EOFError:
            raise EOFError
        return answer

    session = Session("two-link", ask=ask if answers else None)
    session.change(state)
    return session, asked


@pytest.mark.parametrize(("answer", "left"), [("", False), ("no", False), ("yes", True), ("y", True), (EOFError, True)])
def test_quit_asks_about_a_simulation_that_is_not_saved(simulated, answer, left):
    session, asked = session_with(simulated, answer)
    shown = session.run("quit")
    assert (len(asked), session.ended, UNSAVED in texts(shown)) == (1, left, not left)


def test_quit_does_not_ask_about_what_is_saved(simulated, tmp_path):
    for save in (f'save-simulation "{tmp_path / "run.nc"}"', f'save "{tmp_path / "all.nc"}"'):
        session, asked = session_with(simulated, "no")
        session.run(save)
        assert session.run("quit") == []
        assert (asked, session.ended) == ([], True)
    session = Session("two-link")
    session.run(f'restore "{tmp_path / "all.nc"}"')
    assert session.state.run is not None
    assert session.run("quit") == []


def test_a_script_says_that_the_simulation_is_not_saved(simulated, tmp_path):
    session, _ = session_with(simulated)
    shown = []
    session.run_lines(["quit"], "my.sim", shown.append)
    assert (texts(shown), session.ended) == (UNSAVED, True)
    (tmp_path / "inner.sim").write_text("quit\n", encoding="utf-8")
    session, _ = session_with(simulated)
    assert session.run(f'run-script "{tmp_path / "inner.sim"}"') == []  # which ends the script, not the session
    assert not session.ended


@pytest.mark.parametrize("word", ["exit", "quit", " EXIT "])
def test_exit_leaves_a_question_and_not_the_session(simulated, word):
    session, asked = session_with(simulated, "continue", word)
    before = session.state
    with pytest.raises(SessionError, match="not done"):
        session.run("simulate")
    assert (len(asked), session.ended, session.state) == (2, False, before)


def test_dacout_without_a_controller_says_that_it_is_the_voltage():
    session = Session("cmu-dd")
    assert "voltage = 1 2 3 4 5 6 V" in texts(session.run("DACOut = 1 2 3 4 5 6"))
    assert session.run("voltage = 0") == []
    session.run('controller joint-pid kp=900 kd=60 scale="10 deg"')
    assert session.run("DACOut = 1") == []


@pytest.mark.parametrize(("robot", "value", "surprising"), [
    ("cmu-dd", "9.81", True), ("cmu-dd", "-9.81", False), ("cmu-dd", "0", False),
    ("puma560", "-9.81", True), ("puma560", "9.81", False),
])  # fmt: skip
def test_gravity_of_the_other_sign_is_remarked_on(robot, value, surprising):
    session = Session(robot)
    shown = texts(session.run(f"gravity = {value}"))
    assert ("the arm falls upward" in shown) is surprising
    fall = session.state.arm.gravity[2]  # along z of the base
    assert bool(fall * session.state.loaded.base.gravity[2] < 0.0) is surprising


@pytest.mark.parametrize(("line", "surprising"), [
    ("theta = 30", True), ("theta[2] = -30", True), ("theta = 30 deg", False), ("theta = 6", False), ("omega = 30", False),
])  # fmt: skip
def test_an_angle_of_turns_is_remarked_on(line, surprising):
    shown = texts(Session("puma560").run(line))
    assert ("radians?" in shown and "30 rad, 4.8 turns" in shown) is surprising

"""The Python prompt: leaving it keeps the session, errors name what was typed, Ctrl-C and questions are those of a prompt."""

from __future__ import annotations

import subprocess
from math import inf

import pytest

from armwright.errors import ABSENT, SessionError
from armwright.session import Session
from armwright.session.listing import TextLine
from raises_at import raises_at
from session.terminal import SIM, Terminal, needs_pty
from session.walks import refused

THETA = "6 numbers: joint1, joint2, joint3, joint4, joint5, joint6"


@pytest.fixture(scope="module")
def session():
    return Session()


@pytest.mark.sample(1)
@pytest.mark.parametrize("leave", ["exit()", "quit()", "quit(1)", "raise SystemExit", "import sys; sys.exit()"])
def test_leaving_python_in_a_script_goes_on_with_its_next_line(leave):
    typed = f"python theta[0] = 0.25; {leave}\n" if "raise" not in leave else f"python {leave}\ntheta[1] = 0.25\n"
    done = subprocess.run([*SIM], input=f"{typed}theta[1]\n", capture_output=True, encoding="utf-8", check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == "theta[joint1] = 0.25 rad = 14.3239 deg"


@pytest.mark.parametrize(
    ("line", "place", "value", "expected"),
    [
        ("python theta = theta + np.inf", "python theta[0]", inf, "a finite number for joint1"),
        ("python theta[3] = -np.inf", "python theta[3]", -inf, "a finite number for joint4"),
        ("python gravity = -np.inf", "python gravity", -inf, "a finite number"),
        ("python theta = 'x'", "python theta", "x", THETA),
        ("python theta = [1, [2]]", "python theta", [1, [2]], THETA),
        ("python TimeStep = 'x'", "python TimeStep", "x", "one number [s]"),
        ("python TimeStep = [1, 2]", "python TimeStep", ABSENT, "one number [s]"),
        ("python theta = [1, 2]", "python theta", ABSENT, THETA),
        ("python x = input('hm')", "python", ABSENT, ""),
    ],
)
def test_what_is_no_value_is_named(session, line, place, value, expected):
    error = refused(session, line)
    assert (error.place, error.value, error.expected) == (place, value, expected)


def test_what_is_not_known_may_stay_so():
    panda = Session("panda")
    panda.run("python theta[0] = 0.5")  # its voltages are NaN, and nobody set them
    assert panda.state.q[0] == 0.5
    assert refused(panda, "python voltage[2] = np.inf").place == "python voltage[2]"


def test_an_interrupt_is_one_and_changes_nothing(session):
    before = session.state
    with pytest.raises(KeyboardInterrupt):
        session.run("python theta[0] = 1; raise KeyboardInterrupt")
    assert session.state is before


def test_a_question_comes_after_what_was_printed_and_before_the_answer(capsys, monkeypatch):
    monkeypatch.setattr("builtins.input", lambda prompt: print(prompt, end="") or "0.5")
    asked = Session(ask=lambda argument, default: "")
    shown = asked.run("python print('first'); theta[0] = float(input('hm? ')); print('last')")
    assert capsys.readouterr().out == "first\nhm? "
    assert next(part.text for part in shown if isinstance(part, TextLine)) == "last"
    assert asked.state.q[0] == 0.5


def test_python_needs_somebody_or_a_statement(session):
    with raises_at(SessionError, "python", "no terminal"):
        session.run("python")


@pytest.fixture
def terminal(tmp_path):
    terminal = Terminal(tmp_path)
    terminal.wait(lambda: terminal.text.rstrip().endswith("sim>"))
    yield terminal
    terminal.close()


@pytest.mark.sample(1)
@needs_pty
@pytest.mark.parametrize("leave", ["exit()\r", "quit()\r", "\x04"])
def test_leaving_the_prompt_comes_back_to_the_session(terminal, leave):
    terminal.type("python\r", until=">>> ")
    terminal.type("theta[1] = 0.25\r", until=">>> ")
    terminal.type(leave, until="sim>")
    assert "0.25 rad" in terminal.enter("theta[2]")
    terminal.enter("python exit()")
    assert "0.25 rad" in terminal.enter("theta[2]")
    assert "Traceback" not in terminal.text


@needs_pty
def test_at_a_terminal_ctrl_c_interrupts_and_questions_are_asked(terminal):
    terminal.type("python print('sl' + 'eeps', flush=True); x = input('h' + 'm? ')\r", until="hm? ")
    assert "sleeps\nhm? " in terminal.text
    terminal.enter("yes")
    terminal.type("python import time; input('re' + 'ady'); time.sleep(60)\r", until="ready")
    terminal.type("\r", until="\n")
    terminal.soon(0.3)
    printed = terminal.type("\x03", until="sim>")
    assert "interrupted" in printed
    assert "KeyboardInterrupt" not in printed
    terminal.type("python\r", until=">>> ")
    terminal.type("import time; time.sleep(60)\r", until="\n")
    terminal.soon(0.3)
    terminal.type("\x03", until=">>> ")
    terminal.type("\x04", until="sim>")
    assert "Traceback" not in terminal.text

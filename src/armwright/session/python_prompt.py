"""`python`: a Python prompt with the session's variables; changes to them are applied and recorded like typed lines."""

from __future__ import annotations

import code
import contextlib
import io
import sys
from typing import Any

import numpy as np

from armwright.errors import ArmwrightError, SessionError
from armwright.session.listing import Output, TextLine
from armwright.session.variables import TABLE, SessionVariable, value_or_nan
from armwright.session.workspace import Workspace

COMMANDS = ("torque", "voltage", "current", "DACOut")  # each of these decides the others


class Leave:
    """`exit()` and `quit()`: return to the session. Python's own versions close standard input, from which the session reads."""

    def __repr__(self) -> str:
        return "exit() or Ctrl-D goes back to the session"

    def __call__(self, code: object = None) -> None:
        """Leaves the prompt.

        Raises:
            SystemExit: always, which the prompt ends at.
        """
        raise SystemExit(code)


class Interpreter(code.InteractiveConsole):
    """Python's own prompt, with errors in one line."""

    failure = ""

    def showtraceback(self) -> None:
        """The exception in one line.

        Raises:
            KeyboardInterrupt: it was Ctrl-C.
        """
        kind, value = sys.exc_info()[:2]
        if isinstance(value, KeyboardInterrupt):
            raise value
        self.failure = " ".join(f"{kind.__name__ if kind else 'error'}: {value}".split())
        self.write(self.failure + "\n")

    def showsyntaxerror(self, filename: str | None = None, **more: Any) -> None:
        """The syntax error in one line."""
        self.showtraceback()


def python(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`python`, `python CODE`."""
    before = values(session)
    names = names_of(session)
    if arguments["code"]:
        return [*_one_line(session, names, arguments["code"]), *_read_back(session, before, names)]
    if session.ask is None:
        raise SessionError("no terminal to type at", place="python", expected="python STATEMENT")
    banner = f"Python: {', '.join(names)} (counted from 0 here); exit() or Ctrl-D goes back"
    names |= {"exit": Leave(), "quit": Leave()}
    with contextlib.suppress(SystemExit):
        Interpreter(names).interact(banner, "")
    return _read_back(session, before, names)


def _one_line(session: Workspace, names: dict[str, Any], text: str) -> list[Output]:
    """Does one statement, and returns the lines that it printed."""
    printed, screen = io.StringIO(), sys.stdout

    def ask(prompt: object = "") -> str:
        """Python's `input`: asks on the screen, below what was printed before."""
        if session.ask is None:
            raise EOFError("no terminal to answer input(…)")
        with contextlib.redirect_stdout(screen):
            print(printed.getvalue(), end="", flush=True)
            printed.seek(0)
            printed.truncate()
            return input(prompt)

    names |= {"exit": Leave(), "quit": Leave(), "input": ask}
    interpreter = Interpreter(names)
    interpreter.write = lambda data: None
    try:
        with contextlib.redirect_stdout(printed):
            unfinished = interpreter.runsource(text, "<python>", "single")
    except SystemExit:
        unfinished = False
    if interpreter.failure:
        raise SessionError(interpreter.failure, place="python")
    if unfinished:
        raise SessionError("the statement is not finished", place="python", expected="it in one line")
    return [TextLine(line) for line in printed.getvalue().splitlines()]


def names_of(session: Workspace) -> dict[str, Any]:
    """Names in the prompt: the variables as arrays, the arm, its kernels, the run."""
    import armwright as aw

    state = session.state
    copies = {name: np.array(value) if np.ndim(value) else value for name, value in values(session).items()}
    return {
        **copies,
        "arm": state.arm,
        "dyn": state.loaded.dyn,
        "run": state.run,
        "session": session,
        "aw": aw,
        "np": np,
    }


def values(session: Workspace) -> dict[str, Any]:
    """All variables by their names."""
    return {variable.name: value_or_nan(session.state, variable) for variable in TABLE}


def _read_back(session: Workspace, before: dict[str, Any], names: dict[str, Any]) -> list[Output]:
    """Sets the variables that were changed, line by line."""
    changed = [v for v in TABLE if v.name in names and not _alike(names[v.name], before[v.name])]
    commands = [variable.name for variable in changed if variable.name in COMMANDS]
    if len(commands) > 1 and session.state.controller is None:
        what = f"{' and '.join(commands)} were both set, and each decides the other"
        raise SessionError(what, place="python", expected="one of them")
    lines = [line for v in changed for line in _lines(session, v, names[v.name], before[v.name])]
    state, undo_stack = session.state, session.undo_stack
    try:
        for line in lines:
            session.run(line)
    except ArmwrightError:
        session.state, session.undo_stack = state, undo_stack
        session.write_recording()
        raise
    return [TextLine(line, "dim") for line in lines]


def _alike(value: Any, before: Any) -> bool:
    try:
        return value is before or np.array_equal(np.asarray(value, dtype=float), before, equal_nan=True)
    except (TypeError, ValueError):  # no numbers: setting it reports the error
        return False


def _lines(session: Workspace, variable: SessionVariable, value: Any, before: Any) -> list[str]:
    """The lines that set a variable, in digits that read back to the same numbers."""
    arm, name, single = session.state.arm, variable.name, variable.quantity is None
    place = f"python {name}"
    expected = f"one number [{variable.unit}]" if single else f"{arm.n} numbers: {', '.join(arm.names)}"
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise SessionError(place=place, value=value, expected=expected) from None
    if array.shape != () and (single or array.shape != (arm.n,)):
        raise SessionError(f"shape {array.shape}", place=place, expected=expected)
    if single:
        if not np.isfinite(array):
            raise SessionError(place=place, value=float(array), expected="a finite number")
        return [f"{name} = {float(array)!r}"]
    array = np.broadcast_to(array, (arm.n,))
    changed = [k for k in range(arm.n) if not _alike(array[k], before[k])]
    for k in changed:
        if not np.isfinite(array[k]):
            raise SessionError(
                place=f"{place}[{k}]", value=float(array[k]), expected=f"a finite number for {arm.names[k]}"
            )
    if not np.isnan(before).any():
        return [f"{name} = {' '.join(repr(float(x)) for x in array)}"]
    return [f"{name}[{k + 1}] = {float(array[k])!r}" for k in changed]

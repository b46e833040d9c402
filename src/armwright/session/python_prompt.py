"""`python`: the session's names in a Python prompt; what is changed there is set here, and recorded as if it were typed."""

from __future__ import annotations

import code
import contextlib
import io
import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import ArmwrightError, SessionError
from armwright.session.listing import Line, Shown
from armwright.session.variables import TABLE, Variable, known

if TYPE_CHECKING:
    from armwright.session.session import Session

TIED = ("torque", "voltage", "current", "DACOut")  # of which one decides the others


class Leave:
    """`exit()` and `quit()`: back to the session. Python's own ones close standard input, which the session reads from."""

    def __repr__(self) -> str:
        return "exit() or Ctrl-D goes back to the session"

    def __call__(self, code: object = None) -> None:
        """Leaves the prompt.

        Raises:
            SystemExit: always, which the prompt ends at.
        """
        raise SystemExit(code)


class Interpreter(code.InteractiveConsole):
    """Python's own prompt, which tells errors in one line."""

    failed = ""

    def showtraceback(self) -> None:
        """The exception in one line.

        Raises:
            KeyboardInterrupt: it was Ctrl-C, which whoever runs the code tells.
        """
        kind, value = sys.exc_info()[:2]
        if isinstance(value, KeyboardInterrupt):
            raise value
        self._fail(f"{kind.__name__ if kind else 'error'}: {value}")

    def showsyntaxerror(self, filename: str | None = None, **more: Any) -> None:
        """The same, of what is no Python."""
        self.showtraceback()

    def _fail(self, told: str) -> None:
        self.failed = " ".join(told.split())
        self.write(self.failed + "\n")


def python(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`python`, `python CODE`."""
    before = values(session)
    names = names_of(session)
    text = given["code"]
    if text:
        return [*_one_line(session, names, text), *_read_back(session, before, names)]
    if session.ask is None:
        raise SessionError("python: nobody is there to type; expected python STATEMENT")
    banner = f"Python: {', '.join(names)} (counted from 0 here); exit() or Ctrl-D goes back"
    names |= {"exit": Leave(), "quit": Leave()}
    with contextlib.suppress(SystemExit):
        Interpreter(names).interact(banner, "")
    return _read_back(session, before, names)


def _one_line(session: Session, names: dict[str, Any], text: str) -> list[Shown]:
    """Does one statement, and gives what it printed."""
    told, screen = io.StringIO(), sys.stdout

    def asked(prompt: object = "") -> str:
        """Python's `input`: asks on the screen, where what was printed before stands already."""
        if session.ask is None:
            raise EOFError("nobody is there to answer input(…)")
        with contextlib.redirect_stdout(screen):
            print(told.getvalue(), end="", flush=True)
            told.seek(0)
            told.truncate()
            return input(prompt)

    names |= {"exit": Leave(), "quit": Leave(), "input": asked}
    interpreter = Interpreter(names)
    interpreter.write = lambda data: None
    try:
        with contextlib.redirect_stdout(told):
            unfinished = interpreter.runsource(text, "<python>", "single")
    except SystemExit:
        unfinished = False
    if interpreter.failed or unfinished:
        raise SessionError(f"python: {interpreter.failed or 'the statement is not finished; expected it in one line'}")
    return [Line(line) for line in told.getvalue().splitlines()]


def names_of(session: Session) -> dict[str, Any]:
    """What the prompt knows: the variables as arrays, the arm, its kernels, the run."""
    import armwright as aw

    state = session.state
    own = {name: np.array(value) if np.ndim(value) else value for name, value in values(session).items()}
    return {**own, "arm": state.arm, "dyn": state.loaded.dyn, "run": state.run, "session": session, "aw": aw, "np": np}


def values(session: Session) -> dict[str, Any]:
    """All variables by their names."""
    return {variable.name: known(session.state, variable) for variable in TABLE}


def _read_back(session: Session, before: dict[str, Any], names: dict[str, Any]) -> list[Shown]:
    """Sets what was changed, line by line."""
    changed = [v for v in TABLE if v.name in names and not _alike(names[v.name], before[v.name])]
    tied = [variable.name for variable in changed if variable.name in TIED]
    if len(tied) > 1 and session.state.wiring is None:
        raise SessionError(f"python: {' and '.join(tied)} are tied and were both set; expected one of them")
    lines = [
        line for variable in changed for line in _lines(session, variable, names[variable.name], before[variable.name])
    ]
    state, past = session.state, session.past
    try:
        for line in lines:
            session.run(line)
    except ArmwrightError:
        session.state, session.past = state, past
        session.write_record()
        raise
    return [Line(line, "dim") for line in lines]


def _alike(value: Any, before: Any) -> bool:
    try:
        return value is before or np.array_equal(np.asarray(value, dtype=float), before, equal_nan=True)
    except (TypeError, ValueError):  # no numbers, which setting it will tell
        return False


def _lines(session: Session, variable: Variable, value: Any, before: Any) -> list[str]:
    """The lines that set a variable, in digits that read back to the same numbers."""
    arm, name = session.state.arm, variable.name
    single = variable.quantity is None
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        expected = f"one number [{variable.unit}]" if single else f"{arm.n} numbers: {', '.join(arm.names)}"
        told = " ".join(f"{value!r:.60}".split())
        raise SessionError(f"python: {name} = {told}: expected {expected}") from None
    if single:
        if array.ndim:
            raise SessionError(f"python: {name} has shape {array.shape}; expected one number [{variable.unit}]")
        if not np.isfinite(array):
            raise SessionError(f"python: {name} is {float(array)}; expected a finite number")
        return [f"{name} = {float(array)!r}"]
    if array.shape not in ((), (arm.n,)):
        raise SessionError(f"python: {name} has shape {array.shape}; expected ({arm.n},): {', '.join(arm.names)}")
    array = np.broadcast_to(array, (arm.n,))
    moved = [k for k in range(arm.n) if not _alike(array[k], before[k])]
    for k in moved:
        if not np.isfinite(array[k]):
            raise SessionError(f"python: {name}[{k}], {arm.names[k]}, is {array[k]}; expected finite numbers")
    if not np.isnan(before).any():
        return [f"{name} = {' '.join(repr(float(x)) for x in array)}"]
    return [f"{name}[{k + 1}] = {float(array[k])!r}" for k in moved]

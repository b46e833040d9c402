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


class Interpreter(code.InteractiveConsole):
    """Python's own prompt, which tells errors in one line."""

    failed = ""

    def showtraceback(self) -> None:
        """The exception in one line."""
        kind, value = sys.exc_info()[:2]
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
    if not text:
        if session.ask is None:
            raise SessionError("python: nobody is there to type; expected python STATEMENT")
        banner = f"Python: {', '.join(names)} (counted from 0 here); Ctrl-D goes back"
        with contextlib.suppress(SystemExit):
            Interpreter(names).interact(banner, "")
        return _read_back(session, before, names)
    told, interpreter = io.StringIO(), Interpreter(names)
    interpreter.write = lambda data: None
    try:
        with contextlib.redirect_stdout(told):
            unfinished = interpreter.runsource(text, "<python>", "single")
    except SystemExit:
        unfinished = False
    if interpreter.failed or unfinished:
        raise SessionError(f"python: {interpreter.failed or 'the statement is not finished; expected it in one line'}")
    return [*(Line(line) for line in told.getvalue().splitlines()), *_read_back(session, before, names)]


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
    arm = session.state.arm
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.full((0, 0), np.nan)
    if variable.quantity is None:
        if array.ndim:
            raise SessionError(f"python: {variable.name} = {value!r:.60}: expected one number [{variable.unit}]")
        return [f"{variable.name} = {float(array)!r}"]
    if array.shape not in ((), (arm.n,)):
        raise SessionError(
            f"python: {variable.name} has shape {array.shape}; expected ({arm.n},): {', '.join(arm.names)}"
        )
    array = np.broadcast_to(array, (arm.n,))
    if not np.isnan(before).any():
        return [f"{variable.name} = {' '.join(repr(float(x)) for x in array)}"]
    moved = [k for k in range(arm.n) if not _alike(array[k], before[k])]
    return [f"{variable.name}[{k + 1}] = {float(array[k])!r}" for k in moved]

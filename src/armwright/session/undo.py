"""What was typed, and the way back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from armwright.errors import SessionError
from armwright.session.listing import Line, Shown
from armwright.session.shown import shown_state, shown_variable
from armwright.session.variables import TABLE, VARIABLES, near, same

if TYPE_CHECKING:
    from armwright.session.session import Session


def undo(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`undo`, `undo N`: the state before the last N changes. Files stay as they are."""
    count = given["steps"] or 1
    if not session.past:
        raise SessionError("undo: nothing has changed yet")
    if count > len(session.past):
        raise SessionError(f"undo: {count} changes; expected at most {len(session.past)}, which is what is remembered")
    back = session.past[-count]
    undone = session.state.lines[len(back.lines) :]
    session.state, session.past = back, session.past[:-count]
    session.write_record()
    return [Line(f"undone: {'; '.join(undone)}" if undone else "undone", "good")]


def history(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`history`: the script that leads here, which `record` would write."""
    return [Line(line) for line in session.state.lines]


def show(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`show`, `show NAME`: all variables, or one."""
    name = given["name"]
    if name is None:
        return shown_state(session.state)
    if same(name) not in VARIABLES:
        raise SessionError(f"show: no variable {name!r}; {near(name, [variable.name for variable in TABLE])}")
    return shown_variable(session.state, VARIABLES[same(name)])


def leave(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`quit`: the end."""
    session.ended = True
    return []

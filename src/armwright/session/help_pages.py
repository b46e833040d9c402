"""`help`: the tables of commands and variables, and a page about each."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from armwright.errors import SessionError
from armwright.session.listing import Line, Sheet, Shown
from armwright.session.variables import TABLE, VARIABLES, Variable, near, same

if TYPE_CHECKING:
    from armwright.session.commands import Command
    from armwright.session.session import Session

VALUES = "NAME = VALUES sets a variable: one value a joint, or one for all; 30 deg, pi/2, 2*theta; NAME[JOINT] = VALUE one joint"

SPELLING = (
    "help NAME tells all about one of them; tour is for newcomers. - and _ are alike, so are large and small letters."
)


def help_page(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`help`, `help TOPIC`."""
    from armwright.session.commands import COMMANDS

    topic = given["topic"]
    if topic is None:
        return _contents()
    if same(topic) in COMMANDS:
        return _of_command(COMMANDS[same(topic)])
    if same(topic) in VARIABLES:
        return _of_variable(session, VARIABLES[same(topic)])
    known = [*(command.name for command in COMMANDS.values()), *(variable.name for variable in TABLE)]
    raise SessionError(f"help: no command or variable {topic!r}; {near(topic, known)}")


def _contents() -> list[Shown]:
    from armwright.session.commands import TABLE as ALL

    variables = tuple((v.name, v.unit or "by joint", v.meaning) for v in TABLE)
    report = tuple((c.name, c.summary) for c in ALL if c.report)
    more = tuple((c.name, c.summary) for c in ALL if not c.report)
    return [
        Sheet("Variables", ("name", "unit", "meaning"), variables, words=3),
        Line(VALUES, "dim"),
        Sheet("Commands of the 1982 report", ("command", "what it does"), report, words=2),
        Sheet("More commands", ("command", "what it does"), more, words=2),
        Line(SPELLING),
    ]


def usage(command: Command) -> str:
    """How a command is written: `pose FRAME`."""
    parts = [command.name]
    for argument in command.arguments:
        word = "|".join(argument.choices) if argument.choices else argument.name.upper()
        parts.append(word if argument.default is None else f"[{word}]")
    return " ".join(parts) + (" [NAME=VALUE …]" if command.pairs else "")


def _of_command(command: Command) -> list[Shown]:
    shown: list[Shown] = [Line(usage(command), "head"), Line(command.summary)]
    rows = []
    for argument in command.arguments:
        default = "must be given" if argument.default is None else argument.default
        rows.append((argument.name, argument.help, default))
    if rows:
        shown.append(Sheet("", ("argument", "what it is", "default"), tuple(rows), words=3))
    shown += _roots(command.equation, command.source)
    if command.example:
        shown.append(Line(f"example   {command.example}"))
    return shown


def _of_variable(session: Session, variable: Variable) -> list[Shown]:
    unit = " | ".join(dict.fromkeys(variable.units(session.state.arm)))
    form = "one number" if variable.quantity is None else "one number a joint"
    shown: list[Shown] = [Line(f"{variable.name} [{unit}]", "head"), Line(f"{variable.meaning}; {form}")]
    shown += _roots(variable.equation, variable.source)
    example = {"m/s²": "-9.80621", "s": "1 ms"}.get(variable.unit, "0")
    return [*shown, Line(f"example   {variable.name} = {example}")]


def _roots(equation: str, source: str) -> list[Shown]:
    return [Line(f"{word}  {text}") for word, text in (("equation", equation), ("source  ", source)) if text]

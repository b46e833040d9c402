"""`help`: the tables of commands and variables, and a page about each."""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
from typing import TYPE_CHECKING, Any

from armwright.errors import SessionError
from armwright.session.listing import Line, Sheet, Shown
from armwright.session.sources import KEY, cited
from armwright.session.symbols import SYMBOLS
from armwright.session.variables import TABLE, VARIABLES, Variable, near, same

if TYPE_CHECKING:
    from armwright.session.commands import Command
    from armwright.session.session import Session

VALUES = "NAME = VALUES sets a variable: one value a joint, or one for all; 30 deg, pi/2, 2*theta; NAME[JOINT] = VALUE one joint"

SPELLING = (
    "help NAME tells all about one of them, help symbols the letters of the equations; tour is for newcomers. "
    "- and _ are alike, so are large and small letters."
)
ENTRY = re.compile(r"(?:^|(?<=\.)   )(?P<names>[a-z_]+(?:, [a-z_]+)*): ", re.MULTILINE)
"""`name: what it is.   other, another: what they are.` in the docstring of a control law."""


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
    if same(topic) == "symbols":
        return [Sheet("Symbols of the equations", ("symbol", "unit", "meaning"), SYMBOLS, words=3)]
    laws = _laws()
    if same(topic) in {same(kind) for kind in laws}:
        return _of_law(*next((kind, law) for kind, law in laws.items() if same(kind) == same(topic)))
    known = [*(command.name for command in COMMANDS.values()), *(variable.name for variable in TABLE), "symbols", *laws]
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
    if command.name == "controller":
        shown.append(_gains_of_laws())
        shown.append(
            Line("U is the unit of a joint's command: V, A, N m or N; help joint-pid tells all of that law", "dim")
        )
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
    """An equation, where it stands, and that source in full."""
    told = [f"{word}  {text}" for word, text in (("equation", equation), ("source  ", source)) if text]
    told += [f"          {work}" for work in cited(source)]
    if equation:
        told.append("letters   help symbols")
    return [Line(text) for text in told]


def _laws() -> dict[str, type]:
    from armwright.session.wiring import laws  # brings the control laws, which no prompt need wait for

    return laws()


def gains(law: type) -> dict[str, str]:
    """The settings of a control law that may be typed → what each is, with its unit, as the law's docstring has them."""
    from armwright.session.wiring import settings

    entries = inspect.getdoc(law) or ""
    entries = inspect.cleandoc(entries.partition("Args:\n")[2].partition("Raises:")[0])
    entries = re.sub(r"\n +", " ", entries)  # what goes on in another line
    marks = list(ENTRY.finditer(entries))
    ends = [mark.start() for mark in marks[1:]] + [len(entries)]
    told: dict[str, str] = {}
    for mark, end in zip(marks, ends, strict=True):
        told |= dict.fromkeys(mark["names"].split(", "), entries[mark.end() : end].strip().rstrip("."))
    return {name: told.get(name, "") for name in settings(law)}


def _gains_of_laws() -> Sheet:
    """Every law with those of its gains that have a unit."""
    rows = []
    for kind, law in _laws().items():
        own = {name: re.search(r"\[.*?\]", told) for name, told in gains(law).items()}
        rows.append((kind, ", ".join(f"{name} {unit[0]}" for name, unit in own.items() if unit)))
    return Sheet("", ("kind", "gains"), tuple(rows), words=2)


def _of_law(kind: str, law: type) -> list[Shown]:
    """A control law: its equation and its gains."""
    equation = (inspect.getdoc(law) or "").partition("Args:\n")[0].strip()
    rows = tuple((name, told) for name, told in gains(law).items())
    source = " ".join(f"[{key}]" for key in KEY.findall(sys.modules[law.__module__].__doc__ or ""))
    return [
        Line(kind, "head"),
        *(Line(line) for line in equation.splitlines()),
        Sheet("", ("gain", "what it is"), rows, words=2),
        *_roots("", source),
        Line(f'example   controller {kind} {"=… ".join(needed(law))}=… scale="10 deg"'),
    ]


def needed(law: type) -> list[str]:
    """The gains of a law that must be given."""
    fields = {field.name: field for field in dataclasses.fields(law)}  # type: ignore[arg-type]
    return [name for name in gains(law) if fields[name].default is dataclasses.MISSING]

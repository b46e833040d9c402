"""Tables of the session's variables and commands, from the tables that its parser and its help use."""

from __future__ import annotations

import re

from armwright_tables import table

from armwright.model.joint_signals import UNITS
from armwright.session.commands import TABLE as COMMANDS
from armwright.session.formulas import ACCEPTED
from armwright.session.help import usage
from armwright.session.variables import TABLE as VARIABLES

KEY = re.compile(r"\[([A-Z][A-Za-z]+\d{4}[a-z]?)\]")


def _cited(text: str) -> str:
    """Keys of sources as links."""
    return KEY.sub(lambda key: rf"[\[{key[1]}\]](@references.md#{key[1].lower()})", text)


def variables() -> str:
    """Table of variables, one in each row."""
    rows = []
    for variable in VARIABLES:
        unit = variable.unit or " | ".join(dict.fromkeys(UNITS[variable.quantity or ""]))
        root = "; ".join(
            part for part in (f"`{variable.equation}`" * bool(variable.equation), _cited(variable.source)) if part
        )
        rows.append([f"`{variable.name}`", unit, variable.meaning, root])
    return table(("variable", "unit", "meaning", "equation and source"), rows)


def units() -> str:
    """Table of units that may follow a value."""
    rows = [[kept, ", ".join(f"`{name}`" for name in names)] for kept, names in ACCEPTED.items()]
    return table(("kept in", "may be typed"), rows)


def commands() -> str:
    """Sections, one for each command."""
    return "\n\n".join(_section(command) for command in COMMANDS)


def _section(command) -> str:
    origin = "" if command.report else " *(not in the report)*"
    parts = [
        f"### {command.name}",
        f"```text\n{usage(command)}\n```",
        f"{command.summary[0].upper()}{command.summary[1:]}.{origin}",
    ]
    rows = [
        [f"`{a.name}`", a.help, "must be given" if a.default is None else f"`{a.default}`" if a.default else ""]
        for a in command.arguments
    ]
    if rows:
        parts.append(table(("argument", "", "default"), rows))
    if command.equation:
        parts.append(f"`{command.equation}` – {_cited(command.source)}")
    parts.append(f"Example: `{command.example}`")
    return "\n\n".join(parts)


GENERATORS = {"session-variables": variables, "session-units": units, "session-commands": commands}

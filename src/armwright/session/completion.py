"""Completion at the prompt: commands and variables, their arguments, joints, frames, arms and files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from prompt_toolkit.completion import CompleteEvent, Completer, Completion, PathCompleter
from prompt_toolkit.document import Document

import armwright as aw
from armwright.errors import SessionError
from armwright.session.arguments import Argument, read_words
from armwright.session.commands import COMMANDS, Command
from armwright.session.commands import TABLE as ALL_COMMANDS
from armwright.session.units import ACCEPTED
from armwright.session.variables import TABLE as ALL_VARIABLES
from armwright.session.variables import VARIABLES, same
from armwright.session.wiring import laws, settings

if TYPE_CHECKING:
    from armwright.session.session import Session

INDEX = re.compile(r"(?P<name>[A-Za-z][\w-]*)\[(?P<typed>[^\]\s]*)$")
VALUE = re.compile(r"^\s*(?P<name>[A-Za-z][\w-]*)\s*(?:\[[^\]]*\])?\s*=.*?(?P<typed>[A-Za-z_]*)$", re.DOTALL)


class SessionCompleter(Completer):
    """What may stand where the cursor is."""

    def __init__(self, session: Session):
        """Args:
        session: whose arm and variables they are.
        """
        self.session = session
        self.paths = PathCompleter(expanduser=True)

    def get_completions(self, document: Document, complete_event: CompleteEvent) -> Iterable[Completion]:
        """Completions of the text before the cursor."""
        text = document.text_before_cursor
        index = INDEX.search(text)
        if index and same(index["name"]) in VARIABLES:
            yield from _matching(self.session.state.arm.names, index["typed"], "joint", "]")
            return
        head, blank, behind = text.lstrip().partition(" ")
        if not blank:
            yield from _names(head)
            return
        command = COMMANDS.get(same(head))
        value = VALUE.match(text)
        if command is None:
            if value and same(value["name"]) in VARIABLES:
                yield from self._in_values(value["name"], value["typed"])
            return
        yield from self._arguments(command, behind, complete_event)

    def _in_values(self, name: str, typed: str) -> Iterator[Completion]:
        """Units that fit, and variables."""
        units = dict.fromkeys(VARIABLES[same(name)].units(self.session.state.arm))
        yield from _matching([u for unit in units for u in ACCEPTED.get(unit, {}) if u.isascii()], typed, "unit")
        yield from _matching([*(variable.name for variable in ALL_VARIABLES), "pi"], typed, "variable")

    def _arguments(self, command: Command, behind: str, event: CompleteEvent) -> Iterator[Completion]:
        typed = behind.rsplit(" ", 1)[-1]
        before = behind.split()[: len(behind.split()) - (1 if typed else 0)]
        head, sign, value = typed.partition("=")
        if sign:
            named = [argument for argument in command.arguments if same(argument.name) == same(head)]
            for argument in named:
                yield from self._values(argument, value.lstrip('"'), event)
            return
        try:
            given = {same(name) for name in read_words(command.name, command.arguments, before, pairs=command.pairs)}
        except SessionError:  # what is there already is wrong; nothing can be added to it
            return
        free = [
            argument for argument in command.arguments if same(argument.name) not in given and argument.kind != "rest"
        ]
        if free:
            yield from self._values(free[0], typed, event)
        if typed or before or len(free) > 1:
            names = [argument.name for argument in free]
            names += [name for name in self._pairs(command, before) if same(name) not in given]
            yield from _matching([f"{name}=" for name in names], typed, "argument")

    def _pairs(self, command: Command, before: list[str]) -> list[str]:
        """Further names that a command takes: the gains of a controller."""
        kinds = {same(name): kind for name, kind in laws().items()} if command.pairs else {}
        return next((settings(kinds[same(word)]) for word in before if same(word) in kinds), [])

    def _values(self, argument: Argument, typed: str, event: CompleteEvent) -> Iterator[Completion]:
        arm = self.session.state.arm
        choices: dict[str, list[str]] = {
            "choice": list(argument.choices), "frame": list(arm.frames), "robot": aw.builtin_names(),
            "text": _texts(argument.name),
        }  # fmt: skip
        yield from _matching(choices.get(argument.kind, []), typed, argument.name)
        if argument.kind in ("file", "robot"):
            for found in self.paths.get_completions(Document(typed), event):
                yield Completion(found.text, found.start_position, display=found.display, display_meta="file")


class AnswerCompleter(Completer):
    """What may answer a prompt."""

    def __init__(self, session: Session, argument: Argument):
        """Args:
        session: as above.   argument: what is asked for.
        """
        self.of_line, self.argument = SessionCompleter(session), argument

    def get_completions(self, document: Document, complete_event: CompleteEvent) -> Iterable[Completion]:
        """Completions of the answer before the cursor."""
        yield from self.of_line._values(self.argument, document.text_before_cursor, complete_event)


def _texts(name: str) -> list[str]:
    """Words that free arguments are known to take."""
    topics = [*(command.name for command in ALL_COMMANDS), *(variable.name for variable in ALL_VARIABLES), "symbols"]
    variables = [variable.name for variable in ALL_VARIABLES]
    known: dict[str, Any] = {"topic": topics, "name": variables, "kind": [*laws(), "none"] if name == "kind" else []}
    return known.get(name, [])


def _names(typed: str) -> Iterator[Completion]:
    commands = {command.name: command.summary for command in ALL_COMMANDS}
    variables = {variable.name: variable.meaning for variable in ALL_VARIABLES}
    for name, meaning in {**variables, **commands}.items():
        if same(name).startswith(same(typed)):
            yield Completion(name, -len(typed), display_meta=meaning)


def _matching(names: Iterable[str], typed: str, meta: str, end: str = "") -> Iterator[Completion]:
    for name in names:
        if name.lower().startswith(typed.lower()):
            yield Completion(name + end, -len(typed), display=name, display_meta=meta)

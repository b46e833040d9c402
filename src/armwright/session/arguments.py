"""Words behind a command: by place or as name=value, each of a kind that says how it is read."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from armwright.errors import SessionError, nearest
from armwright.session.units import KNOWN
from armwright.session.values import number
from armwright.session.variables import same

Kind = Literal["choice", "file", "robot", "frame", "count", "time", "text", "rest"]
YES_NO = ("yes", "no")


@dataclass(frozen=True)
class Argument:
    """An argument of a command.

    Attributes:
        name, kind, help: as `help` has them.   choices: of kind "choice".
        prompt: the question that is asked where it is not given; without one it is not asked for.
        enter: what an empty answer means, in words, where there is a default.
        default: what an empty answer and a script without it stand for, as it would be typed; None: it must be given.
        wanted: by the arguments before it, whether it matters.   needed: by them, whether it must be given all the same.
        enter: what an empty answer means.   exists: of kind "file", whether it is read, so that it must be there.
    """

    name: str
    kind: Kind
    help: str
    choices: tuple[str, ...] = ()
    prompt: str = ""
    default: str | None = None
    wanted: Callable[[Mapping[str, Any]], bool] = lambda given: True
    needed: Callable[[Mapping[str, Any]], bool] = lambda given: False
    enter: str = ""
    exists: bool = False

    def default_beside(self, given: Mapping[str, Any]) -> str | None:
        """The default beside the arguments before it; None where it must be given."""
        return None if self.needed(given) else self.default

    def read(self, command: str, text: str) -> Any:
        """The value of what was typed.

        Raises:
            SessionError: names command, argument, value and what was expected.
        """
        place = f"{command}: {self.name}"
        if self.kind == "choice":
            found = [choice for choice in self.choices if choice.startswith(text.lower())] if text else []
            if text.lower() in self.choices:
                return text.lower()
            if len(found) == 1:
                return found[0]
            raise SessionError(
                f"{place} = {text!r}: {nearest(text, self.choices)}; expected {' or '.join(self.choices)}"
            )
        if self.kind == "count":
            value = number(place, text, "steps")
            if value < 1 or value != int(value):
                raise SessionError(f"{place} = {text}: expected a whole number, 1 or more")
            return int(value)
        if self.kind == "time":
            return number(place, text, "s")
        if self.exists and not _is_there(text):
            raise SessionError(f"{place} = {text}: no such file")
        return text


def _is_there(file: str) -> bool:
    try:
        return Path(file).exists()
    except OSError:  # what cannot be looked at is told by who reads it
        return True


def words(line: str) -> list[str]:
    """A line cut at blanks; quotes hold together, a backslash is a character like others, # begins a comment.

    Blanks around = and before a unit do not cut: `steps = 100` and `20 ms` are one word each.

    Raises:
        SessionError: a quote that is not closed.
    """
    reader = shlex.shlex(line, posix=True, punctuation_chars=False)
    reader.whitespace_split, reader.escape, reader.commenters = True, "", "#"
    try:
        return _glued(list(reader))
    except ValueError:
        raise SessionError(f"{line.strip()!r}: a quote is not closed") from None


def _glued(parts: list[str]) -> list[str]:
    found: list[str] = []
    for part in parts:
        before = found[-1] if found else ""
        if found and len(found) > 1 and (part.startswith("=") or before.endswith("=")):
            found[-1] += part
        elif part in KNOWN and before[-1:].isdigit():
            found[-1] += f" {part}"
        else:
            found.append(part)
    return found


def uncommented(line: str) -> str:
    """The line without the comment at its end."""
    quote = ""
    for k, mark in enumerate(line):
        if quote:
            quote = "" if mark == quote else quote
        elif mark in "\"'":
            quote = mark
        elif mark == "#":
            return line[:k].strip()
    return line.strip()


def read_words(
    command: str, arguments: Sequence[Argument], given: Sequence[str], *, pairs: bool = False
) -> dict[str, str]:
    """The words behind a command by their arguments' names, as they were typed.

    Args:
        command: its name, for errors.   arguments: what it takes.   given: the words.
        pairs: whether it also takes name=value of any name.
    Raises:
        SessionError: too many words, an unknown name, or one that is given twice.
    """
    by_name = {same(argument.name): argument.name for argument in arguments}
    found: dict[str, str] = {}
    places = [argument.name for argument in arguments]
    for word in given:
        head, sign, value = word.partition("=")
        if sign and (
            same(head) in by_name or (head.replace("_", "").replace("-", "").isalnum() and head[:1].isalpha())
        ):
            name = by_name.get(same(head), head.replace("-", "_") if pairs else None)
            if name is None:
                raise SessionError(f"{command}: unknown argument {head!r}; {nearest(head, places)}")
        else:
            free = [argument for argument in _wanted(command, arguments, found) if argument.name not in found]
            if word.isdecimal() and any(argument.kind == "count" for argument in free):
                free = [argument for argument in free if argument.kind != "file"]  # a bare number is no file
            if not free:
                most = f"takes {', '.join(places)}" if places else "takes nothing"
                raise SessionError(f"{command}: {word!r} is one word too many; it {most}")
            name, value = free[0].name, word
        if name in found:
            raise SessionError(f"{command}: {name} is given twice")
        found[name] = value
    return found


def _wanted(command: str, arguments: Sequence[Argument], found: Mapping[str, str]) -> list[Argument]:
    """The arguments that matter beside those that were found."""
    given: dict[str, Any] = {}
    wanted = []
    for argument in arguments:
        text = found.get(argument.name) or argument.default
        if argument.kind == "choice" and text:
            given[argument.name] = argument.read(command, text)
        else:
            given[argument.name] = text or None
        if argument.wanted(given):
            wanted.append(argument)
    return wanted


def quoted(text: str) -> str:
    """A word so that it reads back as one."""
    if text and not set(text) & set(" \t\"'#,;"):
        return text
    return f'"{text}"' if '"' not in text else f"'{text}'"

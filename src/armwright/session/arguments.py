"""Words behind a command: by place or as name=value, each of a kind that says how it is read."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from armwright.errors import SessionError, nearest
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
        default: what an empty answer and a script without it stand for, as it would be typed; None: it must be given.
        wanted: by the arguments before it, whether it matters.   needed: by them, whether it must be given all the same.
    """

    name: str
    kind: Kind
    help: str
    choices: tuple[str, ...] = ()
    prompt: str = ""
    default: str | None = None
    wanted: Callable[[Mapping[str, Any]], bool] = lambda given: True
    needed: Callable[[Mapping[str, Any]], bool] = lambda given: False

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
        return text


def words(line: str) -> list[str]:
    """A line cut at blanks; quotes hold together, a backslash is a character like others, # begins a comment.

    Raises:
        SessionError: a quote that is not closed.
    """
    reader = shlex.shlex(line, posix=True, punctuation_chars=False)
    reader.whitespace_split, reader.escape, reader.commenters = True, "", "#"
    try:
        return list(reader)
    except ValueError:
        raise SessionError(f"{line.strip()!r}: a quote is not closed") from None


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
            free = [name for name in places if name not in found]
            if not free:
                most = f"takes {', '.join(places)}" if places else "takes nothing"
                raise SessionError(f"{command}: {word!r} is one word too many; it {most}")
            name, value = free[0], word
        if name in found:
            raise SessionError(f"{command}: {name} is given twice")
        found[name] = value
    return found


def quoted(text: str) -> str:
    """A word so that it reads back as one."""
    if text and not set(text) & set(" \t\"'#,;"):
        return text
    return f'"{text}"' if '"' not in text else f"'{text}'"

"""Arguments of a session command: words by position or as name=value, parsed by kind."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, Literal

from armwright.errors import SessionError
from armwright.session.formulas import KNOWN
from armwright.session.values import number

Kind = Literal["choice", "file", "robot", "frame", "count", "time", "text", "rest"]
YES_NO = ("yes", "no")


@dataclass(frozen=True)
class Argument:
    """An argument of a command.

    Attributes:
        name, kind, help: as `help` has them.   choices: of kind "choice".
        prompt: the question that is asked where it is not given; without one it is not asked for.
        enter: meaning of an empty answer, where there is a default.
        default: value of an empty answer and of a script without it, as it would be typed; None: it must be given.
        wanted, needed: by the values of the arguments before it, whether it matters, and whether it must be given all the same.
        exists: of kind "file", whether it is read, so that it must exist.
    """

    name: str
    kind: Kind
    help: str
    choices: tuple[str, ...] = ()
    prompt: str = ""
    default: str | None = None
    wanted: Callable[[Mapping[str, Any]], bool] = lambda values: True
    needed: Callable[[Mapping[str, Any]], bool] = lambda values: False
    enter: str = ""
    exists: bool = False

    def default_for(self, values: Mapping[str, Any]) -> str | None:
        """The default for given values of the arguments before it; None for a required argument."""
        return None if self.needed(values) else self.default

    def read(self, command: str, text: str) -> Any:
        """The value of a typed text.

        Raises:
            SessionError: with the command and the argument as place.
        """
        place = f"{command} {self.name}"
        if self.kind == "choice":
            matches = [choice for choice in self.choices if choice.startswith(text.lower())] if text else []
            if text.lower() in self.choices:
                return text.lower()
            if len(matches) == 1:
                return matches[0]
            raise SessionError(place=place, value=text, expected=" or ".join(self.choices))
        if self.kind == "count":
            value = number(place, text, "steps")
            if value < 1 or value != int(value):
                raise SessionError(place=place, value=text, expected="a whole number, 1 or more")
            return int(value)
        if self.kind == "time":
            return number(place, text, "s")
        if self.exists and not _exists(text):
            raise SessionError("no such file", place=place, value=text)
        return text


def _exists(file: str) -> bool:
    return os.path.lexists(file)


def same(name: str) -> str:
    """A name in the form used for comparison: `DAC-Out`, `dac_out` and `DACOut` are equal."""
    return name.replace("-", "").replace("_", "").lower()


def unknown(what: str, name: str, known: Iterable[str], place: str = "") -> SessionError:
    """The error of an unknown name, with names of the same beginning or else the most similar ones, in any spelling."""
    by_same = {same(each): each for each in known}
    close = [each for each in by_same if each.startswith(same(name))] or get_close_matches(same(name), by_same, 3, 0.5)
    choices = [by_same[each] for each in close] if same(name) else []
    return SessionError(
        what, place=place, value=name, choices=choices, expected="" if choices else "one that help lists"
    )


def words(line: str) -> list[str]:
    """A line split at blanks; quotes group words, a backslash is an ordinary character, # begins a comment.

    Blanks around = and before a unit do not split: `steps = 100` and `20 ms` are one word each.

    Raises:
        SessionError: a quote that is not closed.
    """
    reader = shlex.shlex(line, posix=True, punctuation_chars=False)
    reader.whitespace_split, reader.escape, reader.commenters = True, "", "#"
    try:
        parts = list(reader)
    except ValueError:
        raise SessionError("a quote is not closed", value=line.strip()) from None
    joined: list[str] = []
    for part in parts:
        before = joined[-1] if joined else ""
        if len(joined) > 1 and (part.startswith("=") or before.endswith("=")):
            joined[-1] += part
        elif part in KNOWN and before[-1:].isdigit():
            joined[-1] += f" {part}"
        else:
            joined.append(part)
    return joined


def uncommented(line: str) -> str:
    """The line without the comment at its end; a # between quotes begins none."""
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
    command: str, arguments: Sequence[Argument], line_words: Sequence[str], *, pairs: bool = False
) -> dict[str, str]:
    """The words after a command by argument name, as typed.

    Args:
        command: its name, for errors.   arguments: of the command.   line_words: behind it.
        pairs: whether it also takes name=value of any name.
    Raises:
        SessionError: too many words, an unknown name, or one that is given twice.
    """
    by_name = {same(argument.name): argument.name for argument in arguments}
    names = [argument.name for argument in arguments]
    texts: dict[str, str] = {}
    for word in line_words:
        head, sign, value = word.partition("=")
        is_name = head.replace("_", "").replace("-", "").isalnum() and head[:1].isalpha()
        if sign and (same(head) in by_name or is_name):
            name = by_name.get(same(head), head.replace("-", "_") if pairs else None)
            if name is None:
                raise SessionError("unknown", place=f"{command} argument", value=head, choices=names)
        else:
            free = [argument for argument in _wanted(command, arguments, texts) if argument.name not in texts]
            if word.isdecimal() and any(argument.kind == "count" for argument in free):
                free = [argument for argument in free if argument.kind != "file"]  # a bare number is no file
            if not free:
                most = f"at most {', '.join(names)}" if names else "no argument"
                raise SessionError("one word too many", place=f"{command} argument", value=word, expected=most)
            name, value = free[0].name, word
        if name in texts:
            raise SessionError("given twice", place=f"{command} {name}", value=value)
        texts[name] = value
    return texts


def _wanted(command: str, arguments: Sequence[Argument], texts: Mapping[str, str]) -> list[Argument]:
    """The arguments that matter beside those that were typed."""
    values: dict[str, Any] = {}
    wanted = []
    for argument in arguments:
        text = texts.get(argument.name) or argument.default
        values[argument.name] = argument.read(command, text) if argument.kind == "choice" and text else text or None
        if argument.wanted(values):
            wanted.append(argument)
    return wanted


def quoted(text: str) -> str:
    """A word so that it reads back as one."""
    if text and not set(text) & set(" \t\"'#,;"):
        return text
    return f'"{text}"' if '"' not in text else f"'{text}'"

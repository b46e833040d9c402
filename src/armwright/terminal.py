"""The only writer to the terminal; all text, from whatever file, is made printable here.

Texts that go into a pipe or a file have the ASCII minus, so that other programs can read their numbers.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import TYPE_CHECKING, Any, TextIO

from armwright.printable import printable

if TYPE_CHECKING:
    from rich.console import Console


_gathered: ContextVar[list[Any] | None] = ContextVar("gathered", default=None)
_quiet: ContextVar[bool] = ContextVar("quiet", default=False)


def be_quiet() -> None:
    """Leaves out notes and progress bars from here on, in this context."""
    _quiet.set(True)


def is_quiet() -> bool:
    """True after `be_quiet`."""
    return _quiet.get()


@contextmanager
def gathered() -> Iterator[list[Any]]:
    """A list of what the block writes to standard output, as objects: texts, tables, results. Nothing is written."""
    things: list[Any] = []
    token = _gathered.set(things)
    try:
        yield things
    finally:
        _gathered.reset(token)


def gathering() -> list[Any] | None:
    """The list of the `gathered` block around the caller; None outside of one."""
    return _gathered.get()


def result(found: object) -> None:
    """Adds an object whose numbers belong to the command's --json document; outside of one it does nothing."""
    things = _gathered.get()
    if things is not None:
        things.append(found)


def say(text: object, *, err: bool = False) -> None:
    """Writes a line to standard output, or to standard error."""
    things, stream = _gathered.get(), sys.stderr if err else sys.stdout
    if things is not None and not err:
        things.extend([text] if isinstance(text, str) else [text, str(text)])
        return
    print(_plain(printable(str(text)), stream.isatty()), file=stream)


def remark(text: object) -> None:
    """Says a line on standard error that is no error, unless it shall be quiet."""
    if not is_quiet():
        say(text, err=True)


def note(text: object) -> None:
    """Says a note: what happened, beside the result."""
    remark(f"armwright: note: {text}")


def _plain(text: str, on_terminal: bool) -> str:
    """The text with the ASCII minus, where no person reads it at a terminal."""
    return text if on_terminal else text.replace("−", "-")


def console(**options: Any) -> Console:
    """A console of rich whose texts are printable; without markup, emoji codes and highlighting.

    Args:
        options: of rich's `Console`: stderr, width, soft_wrap, file.
    """
    return _console_class()(**{"highlight": False, "markup": False, "emoji": False, **options})


@cache
def _console_class() -> type[Console]:
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.segment import Segment

    class PrintableConsole(Console):
        """A console that escapes all texts that it renders, and leaves its own colours and cursor movements."""

        def print(self, *objects: Any, **options: Any) -> None:
            things = _gathered.get()
            if things is None or self.stderr or self._file is not None:
                return super().print(*objects, **options)
            things.extend(objects)

        def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
            for segment in super().render(renderable, options):
                text = segment.text if segment.control else _plain(printable(segment.text), self.is_terminal)
                yield segment._replace(text=text)

    return PrintableConsole


class PrintableStream:
    """A text stream, for tables that are written to standard output."""

    def __init__(self, stream: TextIO):
        """Args:
        stream: where the texts go.
        """
        self.stream = stream

    def write(self, text: str) -> int:
        """Writes a text, made printable."""
        return self.stream.write(printable(text))

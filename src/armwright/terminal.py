"""The one place that writes to the terminal. What it writes may come from any file, and is made printable here."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from functools import cache
from typing import TYPE_CHECKING, Any, TextIO

from armwright.printable import printable

if TYPE_CHECKING:
    from rich.console import Console


def say(text: object, *, err: bool = False) -> None:
    """Writes a line to standard output, or to standard error."""
    print(printable(str(text)), file=sys.stderr if err else sys.stdout)


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

        def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
            for segment in super().render(renderable, options):
                yield segment if segment.control else segment._replace(text=printable(segment.text))

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

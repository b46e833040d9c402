"""Outcome of a command: the files that it writes, its notes, and its exit code."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import typer

from armwright.errors import DivergenceError, Interrupted, ScenarioError
from armwright.output import check_destination
from armwright.terminal import note, say

T = TypeVar("T")
PAGE, PICTURE, TOML = (".html",), (".png", ".svg", ".pdf"), (".toml",)  # endings


def check_file(
    path: Path | None, endings: Sequence[str] = (), read: Sequence[str | os.PathLike[str] | None] = ()
) -> None:
    """Refuses a file that was asked for and cannot be written; to be called before long work.

    Raises:
        OutputError: as `check_destination`.
    """
    if path is not None:
        check_destination(path, endings, read=read)


def write(path: Path | None, write_to: Callable[[Path], Any]) -> None:
    """Writes a file that was asked for, and says so."""
    if path is not None:
        write_to(path)
        say(f"wrote {path}")


def say_each(words: str, items: Iterable[Any], *, err: bool = False) -> None:
    """Says items, one in a line, each behind the same words."""
    for each in items:
        say(f"{words}{each}", err=err)


def say_notes(notes: Iterable[Any]) -> None:
    """Says notes on standard error."""
    for each in notes:
        note(each)


def until_stopped(work: Callable[[], T]) -> tuple[T, bool]:
    """Result of long work, and True if Ctrl-C ended it with what was found until then, which a note says.

    Raises:
        typer.Exit: with code 130, as nothing was found until then, which a note says.
    """
    try:
        return work(), False
    except Interrupted as stop:
        if stop.found is None:
            raise end_with_nothing() from None
        note(f"stopped by Ctrl-C {stop}; what was found until then is kept")
        return stop.found, True
    except KeyboardInterrupt:
        raise end_with_nothing() from None


def end_with_nothing() -> typer.Exit:
    """The end of a command that Ctrl-C stopped before it found anything, which a note says; for the caller to raise."""
    note("stopped by Ctrl-C before anything was found; nothing is kept or written")
    return typer.Exit(130)


def exit_if(stopped: bool) -> None:
    """Ends the command with exit code 130 if Ctrl-C stopped it."""
    if stopped:
        raise typer.Exit(130)


def exit_unless(good: bool) -> None:
    """Ends the command with exit code 1, unless its verdict is good."""
    if not good:
        raise typer.Exit(1)


@contextmanager
def naming_file(file: str | os.PathLike[str]) -> Iterator[None]:
    """Errors of a run, which does not know the file of its scenario, name the file and its keys.

    Raises:
        ArmwrightError: as it was raised, with the file.
    """
    from armwright.scenarios.mistakes import key_in_file, keys_in_text

    try:
        yield
    except (ScenarioError, DivergenceError) as error:
        raise error.renamed(key_in_file, keys_in_text).within(file=file) from None

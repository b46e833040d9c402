"""Findings of the checks of a log."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from armwright.errors import Problem

Level = Literal["error", "warning", "note"]
LEVELS: tuple[Level, ...] = ("error", "warning", "note")
Found = Iterator[tuple[Level, Problem]]


@dataclass(frozen=True)
class LogFinding:
    """One result of the checks of a log.

    Attributes:
        level: "error" where the log cannot be used as its file describes it, "warning" where a fit to it may be wrong without
            showing it, "note" for what else a user should know.
        check: name of the check.   run: name of the run; "" of the whole log.   problem: what it is, and where.
    """

    level: Level
    check: str
    run: str
    problem: Problem

    def __str__(self) -> str:
        return f"{self.level}: {self.run}: {self.problem}" if self.run else f"{self.level}: {self.problem}"


def number_of(count: int, thing: str) -> str:
    """`1 row`, `2 rows`."""
    return f"{count} {thing}{'s' * (count != 1)}"


def error(what: str, place: str, expected: str = "") -> tuple[Level, Problem]:
    """A finding that makes the log unusable."""
    return "error", Problem(what, place, expected=expected)


def warning(what: str, place: str, expected: str = "") -> tuple[Level, Problem]:
    """A finding that may falsify the numbers of a fit."""
    return "warning", Problem(what, place, expected=expected)


def note(what: str, place: str, expected: str = "") -> tuple[Level, Problem]:
    """A finding that a user should know."""
    return "note", Problem(what, place, expected=expected)

"""Lines of a file with an error, with carets below the key or value that is wrong."""

from __future__ import annotations

import re
from pathlib import Path

from armwright.errors import ABSENT, Problem

WIDEST = 160  # letters of a line that are shown


def excerpt(problem: Problem) -> str:
    """The line that a problem is on, with carets below its key or value; "" if the line is unknown."""
    path, _, number = problem.file.rpartition(":")
    try:
        lines = Path(path).read_text(encoding="utf-8").split("\n")
        line = lines[int(number) - 1].rstrip().expandtabs(4)[:WIDEST]
    except (OSError, ValueError, IndexError):
        return ""
    begin, end = _mark_of(line, problem)
    margin = " " * len(number)
    return f"  {number} | {line}\n  {margin} | {' ' * begin}{'^' * max(end - begin, 1)}"


def _mark_of(line: str, problem: Problem) -> tuple[int, int]:
    """Begin and end of the mark in a line: a column, the last key of the place, the value, or the whole line."""
    key = re.split(r"[.\s]", re.sub(r"(\[\d+\])+$", "", problem.place))[-1].strip("'")
    column = re.search(r"^not TOML: .* at column (\d+)", problem.what)
    if column and int(column[1]) <= len(line):
        return int(column[1]) - 1, int(column[1])
    texts = [key] if key else []
    texts += [] if problem.value is ABSENT else [str(problem.value)]
    for text in texts:
        found = re.search(rf"(?<![\w-]){re.escape(text)}(?![\w-])", line)
        if found:
            return found.span()
    return len(line) - len(line.lstrip()), len(line)

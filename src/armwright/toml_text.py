"""A TOML text parsed statement by statement: tables, line numbers of keys, and all syntax errors."""

from __future__ import annotations

import bisect
import math
import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from typing import Any

from armwright.errors import MISSING, UNKNOWN_KEY, ArmwrightError, Problem
from armwright.validation import LISTS, Location, place_of

HEADER = re.compile(r"\s*\[")
OPEN = re.compile(r"""[\[{]|\"{3}|'{3}""")  # what may go on on the next line
PLACE = re.compile(r" \(at [^()]*\)$")  # in the parser's words
SHORT = 2  # letters of a key that any sentence may have as a word
COMMA = re.compile(r"=\s*-?\d+,\d")  # 0,3 for 0.3
LONGEST_BROKEN = 200  # lines that are looked through for the end of a statement that has none
MOST_BROKEN = 20  # lines; more, and more than those that are TOML, are another kind of file
FOLLOWING = (  # problems of a robot whose table with a name could not be read
    *("no link", "no frame or link", "hangs on no joint"),
    *("does not move or is not there", "does not move by itself or is not there"),
)
SINGULAR = {word: plural for plural, word in LISTS.items()}
MISSPELT = re.compile(rf"^\s*\[\[?\s*({'|'.join(SINGULAR)})\s*(?=[\].])")  # [[joint]], [joint.motor]
UNREADABLE = (ValueError, RecursionError)  # no TOML, a number of a million digits, a list in a list in a list …
PLAIN = re.compile(r"[^\s.]+")  # names that paths hold without quotes
CALLED = re.compile(r"\w+ '(?P<name>.*?)'(?: (?P<rest>.*))?")
NAMES = re.compile(r"^(\w+)s ('[^']*')(?:, '[^']*')+ ?")  # of several tables with one problem: joints 'a', 'b' friction
SHARED = re.compile(r"^(joint '.*?') ((?:motor|friction)\b.*)$")  # a place that may stand in [defaults.motor]
Statement = tuple[int, str, dict[str, Any]]  # line from 1 on, text, its tables where it stands alone


class TomlText:
    """A TOML text; all syntax errors are reported with their lines.

    Args:
        text: the text.   file: its path, for errors.
    Attributes:
        tables: of all statements that are TOML.   problems: of those that are not, with their lines.
    """

    def __init__(self, text: str, file: Any):
        self.file = str(file)
        self.text, misspelt = _respelt(text.replace("\r\n", "\n"))
        self.problems: tuple[Problem, ...] = tuple(
            Problem(UNKNOWN_KEY, word, choices=(meant,), file=f"{file}:{line}") for line, word, meant in misspelt
        )
        self._broken: list[tuple[int, str]] = []  # line and key of what is no TOML
        try:
            self.tables: dict[str, Any] = tomllib.loads(self.text)
        except UNREADABLE as error:
            good, wrong = _split(self.text)
            self.tables = _joined(good, wrong)
            wrong = sorted(wrong) or [(1, f"not TOML: {error}")]
            if len(wrong) > 1 and (not good or len(wrong) > max(MOST_BROKEN, len(good))):  # another kind of file
                self.tables, wrong = {}, [(wrong[0][0], f"{wrong[0][1]}; nor are {len(wrong) - 1} other lines")]
            self.problems += tuple(Problem(what, file=f"{file}:{line}") for line, what in wrong)
            lines = self.text.split("\n")
            self._broken = [(line, _key_on(lines[line - 1])) for line, _ in wrong]

    @contextmanager
    def checked(self, error: type[ArmwrightError]) -> Iterator[None]:
        """A block that converts the tables; its errors get line numbers, and are reported together with the syntax errors.

        Raises:
            error: where the syntax alone has mistakes.   ArmwrightError: as the block raised it, with lines.
        """
        if self.problems and not self.tables:
            raise error.of(*self.problems)
        try:
            yield
        except ArmwrightError as raised:
            found = [each for each in self.located(raised).problems if not self._follows(each)]
            raise type(raised).of(*found, *self.problems) from None
        if self.problems:
            raise error.of(*self.problems)

    def _follows(self, problem: Problem) -> bool:
        """True if an invalid line of TOML, which is reported already, causes this problem."""
        lines = self.text.split("\n")
        headers = [0, *(k for k, line in enumerate(lines, 1) if HEADER.match(line)), math.inf]
        last = problem.place.replace(" ", ".").rpartition(".")[2]
        for line, key in self._broken:
            k = bisect.bisect_right(headers, line) - 1
            if HEADER.match(lines[line - 1]):
                if problem.what in FOLLOWING or last == key:
                    return True
                continue
            here = headers[k] == 0 or headers[k] <= problem.line < headers[k + 1]
            if key == "name" and problem.what in FOLLOWING:
                return True
            words = re.findall(r"\w+", f"{problem.what} {problem.expected}")
            if here and (last == key if problem.what == MISSING else len(key) > SHORT and key in words):
                return True
        return False

    def located(self, error: Any) -> Any:
        """A copy of the error with lines: where the place of each problem of this file, or the table around it, begins."""
        return type(error).of(*(self.with_line(problem) for problem in error.problems))

    def with_line(self, problem: Problem) -> Problem:
        """A problem of this file with the line of its place, or of the table around it."""
        if problem.file not in ("", self.file):
            return problem
        wanted = "source" if problem.place.endswith(" source") else "name" if problem.what.startswith("two ") else ""
        if wanted:  # of a source the first line that names it, of a name that is there twice the last
            named = re.compile(rf"""(?:^|[\s{{,]){wanted}\s*=\s*["']{re.escape(str(problem.value))}["']""")
            on = [k for k, line in enumerate(self.text.split("\n"), 1) if named.search(line)]
            if on:
                return replace(problem, file=f"{self.file}:{on[0 if wanted == 'source' else -1]}")
        place = NAMES.sub(r"\1 \2 ", problem.place).strip()
        while place:
            at = place if place in self._lines else self._shared(place)
            if at in self._lines:
                return replace(problem, file=f"{self.file}:{self._lines[at]}")
            place = place[: max(place.rfind(mark) for mark in ".[ ")] if re.search(r"[.\[ ]", place) else ""
        return replace(problem, file=self.file)

    def _shared(self, place: str) -> str:
        """The place in the default tables from which a joint without it has it; those with a servo take none."""
        of_joint = SHARED.match(place)
        return f"defaults.{of_joint[2]}" if of_joint and f"{of_joint[1]} servo" not in self._lines else ""

    @cached_property
    def _lines(self) -> dict[str, int]:
        """The line of each place, as errors call it."""
        lines: dict[str, int] = {}
        for location, line in _locations(_split(self.text)[0]):
            place = place_of(location, self.tables)
            lines[place] = line if place.startswith("name") else lines.get(place, line)
            called = CALLED.fullmatch(place)
            if called:  # sources and paths of numbers call a table by its name alone: elbow.motor.gear_ratio
                name = called["name"] if PLAIN.fullmatch(called["name"]) else f'"{called["name"]}"'
                lines.setdefault(".".join(filter(None, [name, called["rest"]])), line)
        return lines


def _respelt(text: str) -> tuple[str, list[tuple[int, str, str]]]:
    """The text with [[joints]] for [[joint]], and the line, the word and the word that was meant of each."""
    try:
        words = SINGULAR.keys() & tomllib.loads(text).keys()
    except UNREADABLE:
        words = SINGULAR.keys()
    lines, found = text.split("\n"), []
    for k, line in enumerate(lines):
        misspelt = MISSPELT.match(line)
        if misspelt and misspelt[1] in words:
            word = misspelt[1]
            found.append((k + 1, word, SINGULAR[word]))
            lines[k] = f"{line[: misspelt.start(1)]}{SINGULAR[word]}{line[misspelt.end(1) :]}"
    return "\n".join(lines), found


def _key_on(line: str) -> str:
    """The key, or the last name of a header, on a line that is no TOML."""
    return re.split(r"[=:]", line)[0].strip(" []").rpartition(".")[2].strip()


def _split(text: str) -> tuple[list[Statement], list[tuple[int, str]]]:
    """The statements of a text, and line and reason of what is none; keys below a broken header are left out."""
    lines = text.split("\n")
    good: list[Statement] = []
    wrong: list[tuple[int, str]] = []
    start, is_lost = 0, False
    while start < len(lines):
        end, tables, reason = _statement(lines, start)
        is_header = HEADER.match(lines[start]) is not None
        if tables is None:
            wrong.append((start + 1, f"not TOML: {reason}"))
            is_lost = is_lost or is_header
        elif is_header or not is_lost:
            is_lost = False
            if tables:
                good.append((start + 1, "\n".join(lines[start:end]), tables))
        start = end
    return good, wrong


def _statement(lines: list[str], start: int) -> tuple[int, dict[str, Any] | None, str]:
    """Last line of the statement that begins at `start`, its tables (None if invalid), and the error."""
    reason = ""
    last = start + (LONGEST_BROKEN if OPEN.search(lines[start]) and not HEADER.match(lines[start]) else 1)
    for end in range(start + 1, min(last, len(lines)) + 1):
        try:
            return end, tomllib.loads("\n".join(lines[start:end])), ""
        except UNREADABLE as error:
            reason = reason or _parser_reason(str(error), lines[start])
    return start + 1, None, reason


def _parser_reason(reason: str, line: str) -> str:
    """The parser's reason with the column of a single line."""
    column = re.search(r"\(at line 1, column (\d+)\)", reason)
    comma = "; numbers have a decimal point, not a comma" if COMMA.search(line) else ""
    return f"{PLACE.sub('', reason)}{f' at column {column[1]}' if column else ''}{comma}"


def _joined(good: list[Statement], wrong: list[tuple[int, str]]) -> dict[str, Any]:
    """The tables of all statements together; one that contradicts those before it goes to `wrong`, and out of `good`."""
    fine, stride = 0, 1  # statements that go together; often the next one is wrong again
    while (reason := _reason(good)) is not None:
        while fine + stride < len(good) and _reason(good[: fine + stride]) is None:
            fine, stride = fine + stride, 2 * stride
        counts = range(fine, min(fine + stride, len(good)))
        k = fine + bisect.bisect_left(counts, 1, key=lambda count: _reason(good[: count + 1]) is not None)
        fine, stride = k, 1
        line, text, _ = good.pop(k)
        while HEADER.match(text) and k < len(good) and not HEADER.match(good[k][1]):
            del good[k]  # the keys of a table that is there twice
        wrong.append((line, f"not TOML: {reason}"))
    return tomllib.loads("\n".join(text for _, text, _ in good))


def _reason(statements: list[Statement]) -> str | None:
    """Reason why statements contradict each other, or None."""
    try:
        tomllib.loads("\n".join(text for _, text, _ in statements))
    except UNREADABLE:
        return "this key or table is there twice"  # each statement by itself is TOML
    return None


def _locations(statements: list[Statement]) -> Iterator[tuple[Location, int]]:
    """Every key and list item of a document, with the line of its statement."""
    inside: Location = ()
    lengths: dict[Location, int] = {}
    for line, text, tables in statements:
        header = HEADER.match(text) is not None
        path: Location = inside if not header else ()
        value: Any = tables
        while header and isinstance(value, (dict, list)) and value:
            if isinstance(value, list):  # [[joints]]: one more of them
                lengths[path] = lengths.get(path, 0) + 1
                path, value = (*path, lengths[path] - 1), value[0]
                continue
            if path in lengths:  # [joints.motor]: of the last one
                path = (*path, lengths[path] - 1)
            (key, value), *_ = value.items()
            path = (*path, key)
        if header:
            inside = path
            yield from ((inside[: k + 1], line) for k in range(len(inside)))
        else:
            for below in _below(tables, inside):
                yield below, line


def _below(value: Any, path: Location) -> Iterator[Location]:
    """The locations below a value."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in pairs:
        yield (*path, key)
        yield from _below(inner, (*path, key))

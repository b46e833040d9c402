"""Exceptions of Armwright and the problems they report: file, place, value, expectation and choices, one line as text."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

from armwright.printable import printable

LONGEST = 60  # characters of a value that a sentence repeats
LONGEST_PATH = 600  # of a file or a place
MOST = 100  # problems that one sentence a line shows
LONGEST_LIST = 1000  # of names that exist, of what is wrong and of what was expected
UNKNOWN_KEY = "unknown key"  # `what` of a problem whose choices stand for the last key of its place, not for its value
TO_FILL_IN = "to be filled in"  # `what` of a value that a new file leaves to its user
MOST_IN_FULL = 10  # values to fill in that are shown with their meaning; more are a line for each key
ENTRIES = ("xx", "xy", "xz", "yy", "yz", "zz")  # of a tensor, which count as the tensor's key
MISSING = "missing"  # `what` of a key that a table must have
OTHER_WORDS = {"velocity": "speed", "speed": "velocity", "vel_": "speed_", "pos_": "position_"}  # what others call keys
ABSENT: Any = type("Absent", (), {"__repr__": lambda self: "ABSENT", "__bool__": lambda self: False})()


@dataclass(frozen=True)
class Problem:
    """One mistake, or a note; `str` gives it as one sentence.

    Attributes:
        what: the problem in words, where "expected" does not say it all.
        place: the field, key or joint, as the user wrote it: `motor.resistance_ohm`, `payload[0].mass_kg`.
        value: what stands there; ABSENT where nothing does.   expected: what may stand there.
        choices: all names that are allowed; the sentence shows the nearest.   file: path, with `:line` where known.
    """

    what: str = ""
    place: str = ""
    value: Any = ABSENT
    expected: str = ""
    choices: tuple[str, ...] = ()
    file: str = ""

    def __str__(self) -> str:
        value = "" if self.value is ABSENT else shown(self.value)
        place = _shortened(self.place, LONGEST_PATH)
        subject = f"{place} = {value}" if place and value else place or value
        reasons = [_shortened(self.what, LONGEST_LIST)]
        reasons += [f"expected {_shortened(self.expected, LONGEST_LIST)}" if self.expected else ""]
        if self.choices or not any(reasons):
            is_key = self.value is ABSENT or self.what == UNKNOWN_KEY
            name = self.place.replace(" ", ".").rpartition(".")[2] if is_key else str(self.value)
            reasons.append(nearest(name, self.choices))
        parts = (_shortened(self.file, LONGEST_PATH), subject, "; ".join(filter(None, reasons)))
        return printable(": ".join(part for part in parts if part))  # Python itself shows errors that nobody caught

    @property
    def line(self) -> float:
        """The line of the file, inf if unknown."""
        _, _, number = self.file.rpartition(":")
        return float(number) if number.isdecimal() else math.inf

    def within(self, place: str = "", file: Any = "") -> Problem:
        """The problem as seen from an outer record: `place` is put before its own place, a missing `file` is filled in."""
        separator = "" if not place or not self.place or self.place.startswith(("[", " ")) else "."
        if separator and place.endswith("'"):  # of a table with a name: joint 'elbow' motor
            separator = " "
        return replace(self, place=f"{place}{separator}{self.place}", file=self.file or str(file))


class Findings:
    """Problems of several links, joints or others; equal ones are reported once, with all names."""

    def __init__(self) -> None:
        self._names: dict[tuple[str, Problem], list[str]] = {}

    def add(self, kind: str, name: str, problem: Problem) -> None:
        """Notes a problem; its place is seen from the link or joint of that name."""
        names = self._names.setdefault((kind, problem), [])
        if name not in names:
            names.append(name)

    def problems(self) -> list[Problem]:
        """Each problem with the names in its place: `link 'arm' mass_kg`, `joints 'a', 'b' axis`."""
        return [
            replace(
                problem, place=f"{kind}{'s' * (len(names) > 1)} {', '.join(map(repr, names))} {problem.place}".strip()
            )
            for (kind, problem), names in self._names.items()
        ]


class ArmwrightError(Exception):
    """Root of all exceptions that Armwright raises for its users.

    Args:
        what, place, value, expected, choices, file: as in `Problem`.   others: further problems of the same input.

    Attributes:
        problems: all that is wrong, the most telling first; `str` shows one a line, in the order of the file's lines.
    Example:
        >>> try:
        ...     aw.load("two-links")
        ... except aw.ArmwrightError as error:
        ...     print(error)
        robot = 'two-links': not a built-in arm and not a file; did you mean two-link?
    """

    def __init__(
        self,
        what: str = "",
        *,
        place: str = "",
        value: Any = ABSENT,
        expected: str = "",
        choices: Iterable[str] = (),
        file: Any = "",
        others: Sequence[Problem] = (),
    ):
        super().__init__(what)
        self.problems = (Problem(what, place, value, expected, tuple(choices), str(file)), *others)

    @classmethod
    def of(cls, first: Problem, *others: Problem) -> Self:
        """An error that reports these problems."""
        error = cls(first.what)
        error.problems = (first, *others)
        return error

    def joined(self, *others: Problem) -> Self:
        """A copy of the error with further problems, for the caller to raise."""
        return self.of(*self.problems, *others)

    def within(self, place: str = "", file: Any = "") -> Self:
        """A copy of the error as seen from the enclosing table, for the caller to raise: see `Problem.within`."""
        return self.of(*(problem.within(place, file) for problem in self.problems))

    def renamed(self, rename: Callable[[str], str], in_text: Callable[[str], str] = str) -> Self:
        """A copy of the error with every place as the user wrote it, for the caller to raise.

        Args:
            rename: a place to its new name.   in_text: a text to one with such names, of other places.
        """
        problems = (
            replace(each, what=in_text(each.what), place=rename(each.place), expected=in_text(each.expected))
            for each in self.problems
        )
        return self.of(*problems)

    @property
    def what(self) -> str:
        """The problem in words."""
        return self.problems[0].what

    @property
    def place(self) -> str:
        """The field, key or joint."""
        return self.problems[0].place

    @property
    def value(self) -> Any:
        """The value, or ABSENT."""
        return self.problems[0].value

    @property
    def expected(self) -> str:
        """Description of the allowed values."""
        return self.problems[0].expected

    @property
    def choices(self) -> tuple[str, ...]:
        """All names that are allowed there."""
        return self.problems[0].choices

    @property
    def file(self) -> str:
        """Path of the file, with its line where known."""
        return self.problems[0].file

    def __str__(self) -> str:
        if len(self.problems) == 1:
            return str(self.problems[0])
        ordered = sorted(self.problems, key=lambda problem: problem.line)
        keys, others = keys_to_fill_in(ordered)
        shown_lines = [f"  {line}" for line in keys] + [f"  {problem}" for problem in others[:MOST]]
        left_out = [f"  and {len(others) - MOST} more"] if len(others) > MOST else []
        path, colon, number = self.file.rpartition(":")
        file = printable(_shortened(path if colon and number.isdecimal() else self.file, LONGEST_PATH))
        word = "values to fill in" if all(each.what == TO_FILL_IN for each in ordered) else "mistakes"
        summary = f"{file}{': ' if file else ''}{len(ordered)} {word}"
        return "\n".join([summary, *shown_lines, *left_out])


class DescriptionError(ArmwrightError):
    """A robot's description is wrong: a missing key, a wrong unit, an impossible inertia."""


class ModelError(ArmwrightError):
    """The arm cannot be used as requested: no tip, no motor constant, a closed chain."""


class ShapeError(ArmwrightError):
    """An array has the wrong shape or type."""


class ScheduleError(ArmwrightError):
    """A schedule or a table of data sets cannot be read as one."""


class ScenarioError(ArmwrightError):
    """A simulation cannot be run as described; found before the run."""


class DivergenceError(ArmwrightError):
    """A simulation stopped: it diverged (infinite or not a number), or its integrator could not go on."""


class SessionError(ArmwrightError):
    """A line of a session cannot be understood, or not be executed now."""


class RunError(ArmwrightError):
    """A dataset or a saved file cannot be read as a run."""


class LogError(ArmwrightError):
    """A log of measurements cannot be read, or contradicts itself or its arm."""


class IdentificationError(ArmwrightError):
    """Parameters cannot be fitted as requested: too few rows, or a method that needs more than the log has."""


class BusError(ArmwrightError):
    """An arm cannot be reached over a bus, or must not be moved over it: no such bus, a wrong node, a limit, a fault."""


class RunStopped(BusError):
    """A run over a bus ended early, or could not be stored, after its drives were enabled; `run` holds what was recorded."""

    run: Any = None


class OutputError(ArmwrightError):
    """A result cannot be written to the given path."""


class ProgramError(ArmwrightError):
    """A function cannot be traced or compiled, for example because of an unknown operation."""


class HiddenStateError(ProgramError):
    """A traced function depends on something left by another call, not on its arguments alone."""


class ExpressionError(ArmwrightError):
    """A formula that was typed cannot be understood."""


class SymbolError(ArmwrightError, TypeError):
    """A traced symbol was used as if it were a number; names the `armwright.scalar` function to use."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C ended long work, which keeps what was found until then.

    Attributes:
        run: of a simulation, the lanes that were finished, or of one group of lanes the time until then; of a run over a bus, its
            rows until then.
        found: of a search or a fit, its result so far.
    """

    def __init__(self, message: str, run: Any = None, found: Any = None):
        super().__init__(message)
        self.run, self.found = run, found


def check_known(
    error: Callable[..., Exception], value: Any, choices: Collection[str], what: str = "", **about: Any
) -> None:
    """Refuses a value that is none of the choices.

    Args:
        error: class of the error.   about: `place`, `expected` and `file` of its problem.
    """
    if not isinstance(value, str) or value not in choices:
        raise error(what, value=value, choices=choices, **about)


def keys_to_fill_in(problems: Sequence[Problem]) -> tuple[list[str], list[Problem]]:
    """A line for each key that is to be filled in, with all its lines, and the other problems.

    Up to `MOST_IN_FULL` values stay among the other problems, which say what is wanted.

    Args:
        problems: of one file, in the order of its lines.
    Returns:
        keys: `gear_ratio: lines 21 55 89 123`, in the order of their first lines.   others: all other problems.
    """
    missing = [each for each in problems if each.what == TO_FILL_IN and each.line < math.inf]
    if len(missing) <= MOST_IN_FULL:
        return [], list(problems)
    lines: dict[str, dict[int, None]] = {}
    for each in missing:
        words = re.sub(r"(\[\d+\])+$", "", each.place).replace(" ", ".").split(".")
        key = next(word for word in reversed(words) if word not in ENTRIES)
        lines.setdefault(key, {})[int(each.line)] = None
    keys = [f"{key}: line{'s' * (len(at) > 1)} {' '.join(map(str, at))}" for key, at in lines.items()]
    return keys, [each for each in problems if each not in missing]


def shown(value: Any) -> str:
    """A value as text for an error: on one line, shortened; text in quotes, arrays as lists."""
    if hasattr(value, "tolist") and hasattr(value, "dtype"):
        few = slice(0, 20)  # of each axis of a large array, which is never turned into a list as a whole
        value = (value if value.size <= 1000 else value[(few,) * value.ndim]).tolist()
    try:
        text = value if isinstance(value, type) else repr(list(value) if isinstance(value, tuple) else value)
    except ValueError:  # an integer of more digits than Python prints
        return "a number too long to print"
    except RecursionError:  # lists in lists
        return "a value too deep to print"
    text = " ".join(str(text).split())
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"


def nearest(name: str, choices: Iterable[str]) -> str:
    """The end of an error sentence: similar names, or all valid ones. `nearest("pma560", …)` → "did you mean puma560?"."""
    import difflib  # only those who err need it

    choices = sorted(choices)
    meant = [name.replace(word, ours) for word, ours in OTHER_WORDS.items() if word in name]
    close = [each for each in choices if each in meant] or difflib.get_close_matches(name, choices, n=3, cutoff=0.5)
    if close:
        return f"did you mean {' or '.join(_shortened(each, LONGEST) for each in close)}?"
    return f"there is {_shortened(', '.join(choices), LONGEST_LIST)}" if choices else "there is none"


def _shortened(text: str, most: int) -> str:
    """A text on one line, its end left out where it is too long."""
    line = printable(" ".join(text.replace("\t", " ").splitlines()))
    return line if len(line) <= most else f"{line[:most]}…"

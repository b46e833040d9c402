"""The exceptions of Armwright. Every one is a single line that names the place, the value and what was expected."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


class ArmwrightError(Exception):
    """Root of all exceptions that Armwright raises for its users' sake."""


class DescriptionError(ArmwrightError):
    """A robot's description cannot be believed: a missing key, a wrong unit, an impossible inertia."""


class ModelError(ArmwrightError):
    """The arm is well described, but cannot do what was asked: no tip, no motor constant, a closed chain."""


class ShapeError(ArmwrightError):
    """An array has the wrong shape or type."""


class ScheduleError(ArmwrightError):
    """A schedule or a table of data sets cannot be read as one."""


class ScenarioError(ArmwrightError):
    """A simulation cannot be run as it was asked for, found before it runs."""


class DivergenceError(ArmwrightError):
    """A simulation left the finite numbers."""


class SessionError(ArmwrightError):
    """A line of a session cannot be understood, or done now."""


class RunError(ArmwrightError):
    """A dataset or a saved file cannot be read as a run."""


class OutputError(ArmwrightError):
    """A result cannot be written where it was asked to go."""


class ProgramError(ArmwrightError):
    """A function cannot be traced or compiled: an operation that has no row in the table."""


class HiddenStateError(ProgramError):
    """A traced function computes with what another call left behind; its result is no function of its arguments."""


class ExpressionError(ArmwrightError):
    """A formula that was typed cannot be understood."""


class SymbolError(ArmwrightError, TypeError):
    """A traced symbol was used as if it were a number; names the `armwright.scalar` function to use."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C ended a simulation; `run` holds the lanes that were finished, or of one group of lanes the time until then."""

    def __init__(self, message: str, run: Any):
        super().__init__(message)
        self.run = run


def nearest(name: str, choices: Iterable[str]) -> str:
    """The end of an error sentence: the nearest names, or all there are. `nearest("pma560", …)` → "did you mean puma560?"."""
    import difflib  # only those who err need it

    choices = sorted(choices)
    close = difflib.get_close_matches(name, choices, n=3, cutoff=0.5)
    if close:
        return f"did you mean {' or '.join(close)}?"
    return f"there is {', '.join(choices)}" if choices else "there is none"

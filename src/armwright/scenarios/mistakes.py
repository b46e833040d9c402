"""All mistakes of a scenario file, with the file's keys in place of Python's names."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import Any, get_args

from armwright.errors import ArmwrightError, ScenarioError
from armwright.quantity import Record
from armwright.scenarios.records import ScenarioTable
from armwright.validation import readable, validated

UNITS = ("", "_s", "_kg", "_m", "_kg_m2", "_v")  # that keys end in, and fields in Python do not
FIELDS = re.compile(r"\b(?:inputs|loop|recording|solver|start)(?:\.\w+)+")  # of a `Scenario`, in a sentence


class Mistakes:
    """Mistakes that are found while a scenario is made: a block that raises all of them at its end, or beside its own error.

    Args:
        file: what errors call it.
    """

    def __init__(self, file: str):
        self.file, self.error = file, None
        self.controllers: Mapping[str, str] = {}  # tables of the file by the names of the classes that they become
        self._refused: set[str] = set()  # places that are no scenario's, whatever is made of the rest

    error: ArmwrightError | None

    def table(self, tables: dict[str, Any]) -> ScenarioTable:
        """The scenario's tables as a record; where keys are wrong, without them.

        Raises:
            ScenarioError: nothing can be made of the rest.
        """
        try:
            return validated(ScenarioTable, tables, file=self.file, error=ScenarioError)
        except ScenarioError as error:
            self.error, self._refused = error, {problem.place for problem in error.problems}
            without = readable(ScenarioTable, tables)
            if without is None:
                raise
            return without

    @contextmanager
    def noted(self, place: str = "") -> Iterator[None]:
        """A block that makes one part of the scenario; its error is raised later, with those of the other parts.

        Args:
            place: that places of its errors start from.
        """
        try:
            yield
        except ArmwrightError as error:
            self._note(error.within(place))

    def check(self) -> None:
        """Raises what was noted so far.

        Raises:
            ArmwrightError: of the class of the first mistake.
        """
        if self.error is not None:
            raise self.error from None

    def _note(self, error: ArmwrightError) -> None:
        found = error.renamed(self._key, keys_in_text).within(file=self.file)
        if self.error is None:
            self.error = found
        else:
            known = self.error.problems
            self.error = self.error.joined(
                *(each for each in found.problems if each.place not in self._refused and each not in known)
            )

    def _key(self, place: str) -> str:
        """Place in the file of a place in a `Scenario`, or in a controller that calls itself by its class: JointPID.kp."""
        name, dot, rest = place.partition(".")
        return f"{self.controllers[name]}.{rest}" if dot and name in self.controllers else key_in_file(place)

    def __enter__(self) -> Mistakes:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if isinstance(error, ArmwrightError) and error is not self.error:
            self._note(error)
        if error is None or isinstance(error, ArmwrightError):
            self.check()


def key_in_file(place: str) -> str:
    """Place in a scenario file of a place in a `Scenario`: `inputs.payload[0].mass` → `inputs.payload[0].mass_kg`."""
    table: type[Record] | None = ScenarioTable
    keys = []
    for part in place.split("."):
        name = re.match(r"\w*", part)[0]  # type: ignore[index]
        known = {} if table is None else table.model_fields
        key = next((f"{name}{unit}" for unit in UNITS if f"{name}{unit}" in known), name)
        keys.append(f"{key}{part.removeprefix(name)}")
        table = _table_in(known[key].annotation) if key in known else None
    return ".".join(keys)


def keys_in_text(text: str) -> str:
    """A sentence with fields of a `Scenario` as the keys of a file: `loop.period` → `loop.period_s`."""
    return FIELDS.sub(lambda field: key_in_file(field[0]), text)


def _table_in(annotation: Any) -> type[Record] | None:
    """The table that an annotation such as `tuple[PayloadTable, ...]` or `LoopTable | None` allows; None: plain values."""
    if isinstance(annotation, type) and issubclass(annotation, Record):
        return annotation
    return next(filter(None, map(_table_in, get_args(annotation))), None)

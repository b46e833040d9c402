"""Sources of a sweep's lanes: a scenario file with the files that it names, or a scenario made in Python.

A source gives any range of its lanes as a scenario of its own, in which every lane is as it is among the others.
"""

from __future__ import annotations

import hashlib
import json
import pickle
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from armwright.content import checksum
from armwright.entry import AnyScenario, as_scenario
from armwright.errors import ScenarioError
from armwright.parameters import batches
from armwright.scenarios.file import parse_scenario
from armwright.scenarios.files import Document, KeptFiles
from armwright.simulation.scenario import WITH_LANES, Scenario


class LaneSource(ABC):
    """Lanes of a scenario.

    Attributes:
        document: the scenario file with all that it names, as JSON; "" of a scenario made in Python.
    """

    document: str

    @property
    @abstractmethod
    def digest(self) -> str:
        """Checksum of everything that decides a lane."""

    @abstractmethod
    def part(self, lanes: range) -> Scenario:
        """The scenario of some lanes.

        Raises:
            ScenarioError: lanes that the scenario does not have.
        """

    def sent(self, lanes: range) -> LaneSource:
        """The source to send to a worker for some lanes, without the values of other lanes."""
        return self


@dataclass(frozen=True, eq=False)
class FileSource(LaneSource):
    """Lanes of a scenario file, from its document alone.

    Args:
        path: of the file, for errors.   document: as `Scenario.document`.
    """

    path: str
    document: str

    @property
    def digest(self) -> str:
        """Checksum of the document."""
        return hashlib.sha256(self.document.encode()).hexdigest()

    def part(self, lanes: range) -> Scenario:
        """The scenario of some lanes, with draws as numbers."""
        kept = Document.model_validate(json.loads(self.document))
        text = kept.scenario.checked("content of the scenario", self.path)
        return parse_scenario(text, self.path, KeptFiles(Path(self.path), kept), lanes)


@dataclass(frozen=True, eq=False)
class PythonSource(LaneSource):
    """Lanes of a scenario made in Python.

    Args:
        scenario: the scenario; its own `lanes` count only where `Batch`es say how many there are.
    """

    scenario: Scenario
    document = ""

    @property
    def digest(self) -> str:
        """Checksum of all fields except the number of lanes."""
        return checksum(replace(self.scenario, lanes=range(1)))

    def part(self, lanes: range) -> Scenario:
        """The scenario of some lanes."""
        if self.scenario.first_lane == lanes.start and self.scenario.lanes == len(lanes):
            return self.scenario
        return replace(self.scenario, lanes=lanes)

    def sent(self, lanes: range) -> LaneSource:
        """The scenario to send to a worker; with batches, the resolved scenario of these lanes alone."""
        parts = (getattr(self.scenario, name) for name in WITH_LANES)
        batched = any(True for part in parts for _ in batches(part, ""))
        return PythonSource(self.part(lanes).resolved) if batched else self

    def __reduce__(self) -> tuple[Any, ...]:
        values = {each.name: getattr(self.scenario, each.name) for each in fields(Scenario) if each.init}
        return _unpickled, (values,)  # without what the scenario has computed from its fields


def _unpickled(values: dict[str, Any]) -> PythonSource:
    return PythonSource(Scenario(**values))


def source_of(scenario: AnyScenario) -> LaneSource:
    """The source of a scenario's lanes.

    Args:
        scenario: made in Python, read from a file, or the path of a file.
    Raises:
        ScenarioError: a scenario whose file could not be kept, or that cannot be sent to another process.
    """
    path = "scenario"
    if not isinstance(scenario, Scenario):
        path, scenario = str(scenario), as_scenario(scenario)
    if scenario.document is not None:
        return FileSource(path, scenario.document)
    source = PythonSource(scenario)
    try:
        import cloudpickle

        cloudpickle.dumps(source)
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        what = f"cannot be sent to another process: {' '.join(str(error).split())}"
        raise ScenarioError(what, place="scenario", expected="parts that pickle") from None
    return source

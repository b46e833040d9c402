"""`*.scenario.toml` → Scenario: robot, commands or loop, lanes, and what to keep."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from armwright.description.toml_file import read_text
from armwright.entry import as_path
from armwright.errors import ScenarioError
from armwright.model import build_model
from armwright.model.payload import Payload
from armwright.scenarios.files import Files, FolderFiles
from armwright.scenarios.kinds import controller_tables
from armwright.scenarios.lanes import vary
from armwright.scenarios.mistakes import Mistakes
from armwright.scenarios.parts import make_parts
from armwright.scenarios.values import part_values
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Inputs, Loop, Recording, Solver, Start
from armwright.toml_text import TomlText

FAULTS = (
    "no table of its own; [loop.timing] has delays, jitter, losses and drift, [loop.sensors] noise and counts, [inputs] what "
    "disturbs, [values] and [lanes] other numbers of the arm"
)


@dataclass(frozen=True)
class ScenarioSource:
    """The file that a scenario was read from.

    Attributes:
        path: of the file.   document: its text, and the contents of all files that it names, as `Scenario.document`.
    """

    path: str
    document: str


def read_scenario(path: str | os.PathLike[str], *, allow: Iterable[str | os.PathLike[str]] = ()) -> Scenario:
    """The scenario in a file.

    Args:
        path: of the `*.scenario.toml`; robots and tables that it names stand in its folder or below, or are built in.
        allow: further folders that it may name files in.
    Returns:
        scenario: as in Python; `scenario.document` keeps the file and all that it named.
    Raises:
        ArmwrightError: no such file, or an invalid value in it; names file, key, value and what was expected.
    Example:
        >>> scenario = aw.read_scenario("examples/swing.scenario.toml")
        >>> print(scenario.duration, scenario.loop.period)
        1.0 0.001
    """
    path, folders = Path(as_path(path, "path", ScenarioError)), [Path(folder) for folder in allow]
    for folder in folders:
        if not folder.is_dir():
            raise ScenarioError("no such folder", place="allow", value=str(folder))
    return parse_scenario(read_text(path, ScenarioError), str(path), FolderFiles(path.parent, folders))


def parse_scenario(text: str, place: str, files: Files, lanes: range | None = None) -> Scenario:
    """The scenario in a TOML document, which is kept with it.

    Args:
        text: of the document.   place: what errors call the file.   files: that it names.
        lanes: only these; of draws there are as many as are asked for. By default all.
    Raises:
        ArmwrightError: with all mistakes of the document, with their lines.
    """
    document = TomlText(text, place)
    with document.checked(ScenarioError), Mistakes(place) as mistakes:
        if "faults" in document.tables:
            raise ScenarioError(FAULTS, place="faults")
        table = mistakes.table(document.tables)
        if table.loop is not None:
            mistakes.controllers = controller_tables("loop.controller", table.loop.controller)
        arm = replace(build_model(files.robot(table.robot)), file=files.place(table.robot))
        if table.without:
            arm = arm.replace(**dict.fromkeys(table.without))
        values = part_values(table, arm, mistakes)
        if table.lanes is not None and mistakes.error is None:
            with mistakes.noted():
                vary(table.lanes.columns(lanes), arm, values)
        make_parts(values, arm, files, mistakes)
        mistakes.check()
        payloads = [Payload(**fields) for fields in values["inputs"]["payload"]]
        scenario = Scenario(
            arm,
            table.duration_s,
            command=values["commands"]["constant"],
            loop=None if table.loop is None else Loop(**values["loop"]),
            inputs=Inputs(**values["inputs"] | {"payload": payloads or None}),
            start=Start(**values["start"]),
            solver=Solver(**values["solver"]),
            recording=Recording(**values["recording"]),
            vary=values["vary"],
            lanes=None if lanes is None else len(lanes),
            seed=table.seed,
            first_lane=0 if lanes is None else lanes.start,
        )
    kept = files.document(text)
    whole = json.dumps(kept.model_dump(exclude_none=True), sort_keys=True)
    notes = [
        f"{name} has {content.size / 2**20:.3g} MiB, too much to be kept with the run, which cannot be reproduced"
        for name, content in {place: kept.scenario, **kept.files}.items()
        if content.text is None
    ]
    # Of this scenario alone: a changed copy has neither.
    object.__setattr__(scenario, "document", whole)
    object.__setattr__(scenario, "notes", tuple(notes))
    object.__setattr__(scenario, "source", ScenarioSource(os.path.abspath(place), whole))
    return scenario

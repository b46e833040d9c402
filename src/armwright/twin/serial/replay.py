"""Goals that came over a servo bus as a scenario file, and the simulation of it with the twin's bits.

Beside NAME.scenario.toml, with its schedules of goals and of servos that are on, stands NAME.values.csv if registers were written
while servos were on: the parameters that they change, a row from its time until the next; the last row is the end.
`armwright simulate NAME.scenario.toml` then ends where the first of them changes.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armwright.description import builtin_names
from armwright.errors import BusError
from armwright.results.csv_tables import CsvColumn, read_numbers, write_table
from armwright.scenarios.file import read_scenario
from armwright.scenarios.writer import ENDING, write_scenario
from armwright.simulation.simulation import simulate
from armwright.twin.serial.arm_plant import ArmPlant

if TYPE_CHECKING:
    import xarray

VALUES = ".values.csv"


def write_goals(plant: ArmPlant, path: Path) -> tuple[Path, ...]:
    """Writes the goals so far, and what came into force with them, up to the last whole turn, at least one.

    An arm from a file that is not below the scenario's folder becomes a robot file beside it.

    Args:
        plant: of the arm.   path: of the new NAME.scenario.toml.
    Returns:
        paths: of what was written, the scenario first.
    Raises:
        BusError: a file of another name.   OutputError: it cannot be written.
    """
    if not path.name.endswith(ENDING):
        raise BusError(place="schedule", value=str(path), expected=f"NAME{ENDING}")
    table, end = _values_path(path), max(plant.turn, 1)
    table.unlink(missing_ok=True)
    changes = [(turn, values) for turn, values in plant.values if turn < end]
    scenario = plant.scenario(end if len(changes) == 1 else changes[1][0])
    file = plant.arm.file
    if file is not None and file not in builtin_names() and not _is_below(Path(file), path.parent):
        scenario = replace(scenario, arm=replace(plant.arm, file=None))
    written = write_scenario(scenario, path)
    if len(changes) == 1:
        return written
    turns = [*(turn for turn, _ in changes), end]
    rows = np.array([*(values for _, values in changes), changes[-1][1]])
    write_table(table, {"t [s]": np.array(turns) * plant.period, **dict(zip(plant.names, rows.T, strict=True))})
    return (*written, table)


def replay(path: Path | str) -> list[xarray.Dataset]:
    """Runs of a scenario that `write_goals` wrote, one after another, each with its values of the parameters.

    Args:
        path: of NAME.scenario.toml; NAME.values.csv is read where it is there.
    Returns:
        runs: the first begins at 0, each other one where the one before it ended.
    Raises:
        ScenarioError: no such scenario.   ScheduleError: a table with other columns.
    """
    scenario, table = read_scenario(path), _values_path(Path(path))
    runs = [simulate(scenario)]
    if not table.exists():
        return runs
    names = list(scenario.vary)
    rows = read_numbers(table, [CsvColumn("t", ("s",)), *(CsvColumn(name, ()) for name in names)]).values
    for row, (end, *_) in pairwise(rows[1:]):
        vary = dict(zip(names, row[1:].tolist(), strict=True))
        runs.append(simulate(replace(scenario, duration=end - row[0], vary=vary, start=runs[-1])))
    return runs


def _values_path(path: Path) -> Path:
    return path.with_name(path.name.removesuffix(ENDING) + VALUES)


def _is_below(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())

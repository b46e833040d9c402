"""A run done again from what it kept: to the last bit where processor and versions are those it ran with."""

from __future__ import annotations

import json
import os
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import RunError
from armwright.scenarios.file import parse_scenario
from armwright.scenarios.files import Files
from armwright.simulation.groups import Progress
from armwright.simulation.provenance import provenance
from armwright.simulation.recording import load_run
from armwright.simulation.simulator import simulate

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False)
class Rerun:
    """A run done again.

    Attributes:
        run: the new one.   same: whether every number has the same bits as in the old one.
        surroundings: what is another processor, feature or version now, "numpy: 2.4.0 then, 2.5.1 now".
        differences: by variable, the largest difference from the old run, where bits differ.
    """

    run: xr.Dataset
    same: bool
    surroundings: tuple[str, ...]
    differences: dict[str, float]


def rerun(path: str | os.PathLike[str], progress: Progress | None = None) -> Rerun:
    """The run in a file, done again from the scenario that it keeps.

    Args:
        path: of a saved run, `.nc`.   progress: called now and then with the steps done and those there are.
    Returns:
        rerun: the new run, and in what it differs from the old one.
    Raises:
        RunError: no run, or one that keeps no scenario: it was made in Python, not from a scenario file.
    """
    old = load_run(path)
    document = old.attrs.get("scenario")
    if not document:
        raise RunError(f"{path}: keeps no scenario; expected a run that was made from a scenario file")
    try:
        kept: dict[str, Any] = json.loads(document)
        table = tomllib.loads(kept["scenario"])
    except (ValueError, KeyError, TypeError) as error:
        raise RunError(f"{path}: the scenario that it keeps cannot be read: {error}") from None
    files = Files(Path(path).parent, kept=dict(kept.get("files", {})))
    new = simulate(parse_scenario(table, f"{path} (scenario)", files, kept["scenario"]), progress=progress)
    now, then = provenance(), json.loads(old.attrs.get("made_with", "{}"))
    changed = [
        f"{name}: {then.get(name, 'unknown')} then, {now[name]} now" for name in now if then.get(name) != now[name]
    ]
    differences = {}
    for name in old.data_vars:
        if name not in new or old[name].shape != new[name].shape:
            differences[str(name)] = np.inf
        elif old[name].dtype.kind == "f" and not np.array_equal(old[name], new[name], equal_nan=True):
            differences[str(name)] = float(np.nanmax(np.abs(old[name].values - new[name].values)))
    return Rerun(new, not differences, tuple(changed), differences)

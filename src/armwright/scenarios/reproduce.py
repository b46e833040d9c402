"""Bit-exact reproduction of a run from the scenario that it keeps, where processor and versions are those it ran with."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import RunError
from armwright.progress import Shown
from armwright.results.provenance import provenance
from armwright.results.result import Result
from armwright.results.run_file import load_run
from armwright.results.table import Table, number
from armwright.scenarios.file import parse_scenario
from armwright.scenarios.files import Document, KeptFiles
from armwright.simulation.simulation import simulate
from armwright.validation import validated

if TYPE_CHECKING:
    import xarray as xr

    from armwright.simulation.scenario import Scenario

STOPPED = "stopped by Ctrl-C"  # how the first note of such a run begins


@dataclass(frozen=True, eq=False)
class Reproduction(Result):
    """A run done again.

    Attributes:
        run: the new one.   same: whether every number has the same bits as in the old one.
        surroundings: what is another processor, feature or version now, "numpy: 2.4.0 then, 2.5.1 now".
        differences: by variable or coordinate, the largest difference from the old run, where bits differ.
        reshaped: what has another shape, is not there now, or was not then, a line each.
        part: which part of the run was kept, and compared, where Ctrl-C had stopped it; else "".
    """

    run: xr.Dataset
    same: bool
    surroundings: tuple[str, ...]
    differences: dict[str, float]
    reshaped: tuple[str, ...] = ()
    part: str = ""

    @property
    def good(self) -> bool:
        """True if all bits are the same."""
        return self.same

    def sentences(self) -> list[str]:
        """The verdict, and what differs."""
        verdict = "the same to the last bit" if self.same else "numbers differ"
        part = [f"compared what there is: {self.part}"] if self.part else []
        return [verdict, *(f"differs  {line}" for line in (*self.surroundings, *self.reshaped)), *part]

    def tables(self) -> list[Table]:
        """A row for each variable with other bits: its largest difference."""
        rows = [[name, number(largest)] for name, largest in self.differences.items()]
        return [Table("differences", ("variable", "largest difference"), rows)]


def reproduce(path: str | os.PathLike[str], progress: Shown = None) -> Reproduction:
    """The run in a file, done again from the scenario that it keeps; no other file is read.

    Args:
        path: of a saved run, `.nc`.   progress: as of `simulate`.
    Returns:
        reproduction: the new run, and in what it differs from the old one.
    Raises:
        RunError: no run, or one that does not keep what it was made from: it was made in Python or by options of the
            command and not from a scenario file, or files were too large to be kept.
        ScenarioError: what is kept is no scenario file.
    Example:
        >>> scenario = aw.read_scenario("examples/swing.scenario.toml")
        >>> aw.save(aw.simulate(scenario), "swing.nc")
        >>> aw.reproduce("swing.nc").same
        True
    """
    old = load_run(path)
    now, then = provenance(), _made_with(path, old.attrs.get("made_with", "{}"))
    new = simulate(kept_scenario(old, path), progress=progress)
    changed = [
        f"{name}: {then.get(name, 'unknown')} then, {now[name]} now" for name in now if then.get(name) != now[name]
    ]
    part = str(old.attrs.get("notes", "")).partition("\n")[0]
    part = part if part.startswith(STOPPED) else ""
    differences, reshaped = _compared(old, _kept_part(old, new) if part else new, whole=not part)
    return Reproduction(new, not differences and not reshaped, tuple(changed), differences, tuple(reshaped), part)


def kept_scenario(run: xr.Dataset, path: str | os.PathLike[str]) -> Scenario:
    """The scenario that a run keeps; no other file is read, and its arm has no visuals.

    Args:
        run: as `load_run` returned it.   path: its file, for errors.
    Returns:
        scenario: what the run was made from.
    Raises:
        RunError: as `reproduce`.
    """
    if not run.attrs.get("scenario"):
        what = "keeps no scenario: only runs of a scenario file as it is read keep one"
        raise RunError(what, file=path, expected="a run of armwright simulate FILE.scenario.toml")
    kept = _kept_document(path, run.attrs["scenario"])
    text = kept.scenario.checked("content of the scenario", path)
    return parse_scenario(text, f"{path} (scenario)", KeptFiles(Path(path), kept))


def _kept_document(path: str | os.PathLike[str], text: Any) -> Document:
    """The stored files of a run."""
    try:
        document = json.loads(text)
    except (ValueError, TypeError, RecursionError) as error:
        raise RunError(f"the scenario that it keeps cannot be read: {error}", file=path) from None
    if isinstance(document, dict) and "form" not in document:
        what = "made by Armwright 0.1, whose runs do not keep what they were made from with its checksums"
        raise RunError(what, file=path, expected="a later run; simulate its scenario file again")
    return validated(Document, document, place="scenario", file=path, error=RunError)


def _made_with(path: str | os.PathLike[str], text: Any) -> dict[str, Any]:
    """Versions by name with which a run was made."""
    try:
        then = json.loads(text)
    except (ValueError, TypeError):
        then = None
    if not isinstance(then, dict):
        raise RunError(place="made_with", value=str(text), expected="versions by name, as a run keeps them", file=path)
    return then


def _kept_part(old: xr.Dataset, new: xr.Dataset) -> xr.Dataset:
    """Of the new run, the lanes and the rows that the old one has."""
    if "lane" in old.sizes and "lane" in new.sizes:
        lanes = old["lane"].values if "lane" in old.coords else np.arange(old.sizes["lane"])
        if lanes.max(initial=0) < new.sizes["lane"]:
            new = new.isel(lane=lanes)
    return new.isel(time=slice(old.sizes["time"])) if "time" in old.sizes and "time" in new.sizes else new


def _compared(old: xr.Dataset, new: xr.Dataset, *, whole: bool) -> tuple[dict[str, float], list[str]]:
    """The largest differences by name, and what cannot be compared."""
    differences: dict[str, float] = {}
    reshaped = [f"{name}: was not there then" for name in new.variables if whole and name not in old.variables]
    for name in old.variables:
        if name not in new.variables:
            reshaped.append(f"{name}: is not there now")
            continue
        then, now = old[name].values, new[name].values
        if then.shape != now.shape:
            reshaped.append(f"{name}: shape {then.shape} then, {now.shape} now")
        elif then.dtype.kind not in "iuf" or now.dtype.kind not in "iuf":
            if not np.array_equal(then, now):
                reshaped.append(f"{name}: other names now")
        elif not np.array_equal(then, now, equal_nan=True):
            known = np.isfinite(then) & np.isfinite(now)
            same = known | (then == now) | (np.isnan(then) & np.isnan(now))
            by = np.abs(then[known].astype(float) - now[known]).max(initial=0.0)
            differences[str(name)] = float(by) if same.all() else np.inf
    return differences, reshaped

"""Frozen digests: what `frozen.json` holds, how it is made, and what differs from it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import armwright as aw
from armwright.results.aliases import LOOP_STATE
from frozen.programs import DIGITS, kernel_digests
from frozen.runs import RUNS
from physics.arms import FORMS

FILE = Path(__file__).with_name("frozen.json")
CVODES = 1e-9  # of an entry's range: SUNDIALS is compiled elsewhere, so its last bits are not ours


def frozen() -> dict[str, Any]:
    """Contents of the file: `programs` by arm and kernel, `runs` by name and variable."""
    return json.loads(FILE.read_text(encoding="utf-8"))


def run_digests(name: str, target: str | None = None) -> dict[str, Any]:
    """Digest of every variable of a reference run; of CVODES, the last position instead.

    Args:
        name: of `RUNS`.   target: processor level; the bits do not depend on it.
    """
    scenario = RUNS[name]()
    solver = scenario.solver if target is None else replace(scenario.solver, target=target)
    run = aw.simulate(replace(scenario, solver=solver), threads=1)
    if scenario.solver.integrator == "cvodes":
        return {"q": run["q"].values[-1].tolist()}
    names = sorted(str(name) for name in run.data_vars if name != LOOP_STATE)  # what the state consists of may change
    return {name: _digest(run[name].values) for name in names}


def _digest(values: np.ndarray) -> str:
    """Of the bits; zeros of either sign and all NaN count alike."""
    canonical = np.where(np.isnan(values), np.nan, values + 0.0)
    return hashlib.sha256(np.ascontiguousarray(canonical, dtype="<f8").tobytes()).hexdigest()[:DIGITS]


def computed(target: str | None = None) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Everything anew, piece by piece: part of the file, name, digests."""
    for name in FORMS:
        yield "programs", name, kernel_digests(aw.load(name))
    for name in RUNS:
        yield "runs", name, run_digests(name, target)


def differences(kept: Mapping[str, Any], found: Mapping[str, Any]) -> list[str]:
    """Names whose digests differ, or that only one side has."""
    return sorted(name for name in {*kept, *found} if not _alike(kept.get(name), found.get(name)))


def _alike(kept: Any, found: Any) -> bool:
    if isinstance(kept, list) and isinstance(found, list):
        return bool(np.allclose(kept, found, rtol=CVODES, atol=CVODES))
    return kept == found

"""Predictions of a fit of drives beside the measurements, with measures of agreement."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from armwright.fitting.measures import agreement
from armwright.identification.motor.measured import LOGGED, Measured
from armwright.identification.motor.output_error import DriveProblem

Measures = Mapping[str, Mapping[str, float]]
MARK = " (held out, with the fitted delay)"  # behind a run's name, among measures: no record has a delay


def predictions_of(
    problem: DriveProblem, z: np.ndarray, data: Measured, mark: str = ""
) -> tuple[dict[str, Any], Measures]:
    """Datasets by run, and measures by run and signal.

    Args:
        problem: of the fit.   z: (k,) coordinates.   data: measurements.   mark: what stands behind a run's name, among measures.
    """
    import xarray as xr

    predicted = problem.predictions(z)
    found: dict[str, list[Any]] = {}
    measures: dict[str, dict[str, float]] = {}
    n = len(data.joints)
    columns: dict[tuple[str, str, str], list[tuple[np.ndarray, np.ndarray]]] = {}
    for stretch, y, target in zip(problem.stretches, predicted, problem.targets, strict=True):
        variables: dict[str, Any] = {}
        for s, name in enumerate(data.signals):
            plain = LOGGED.get(name, name)
            part = slice(s * n, (s + 1) * n)
            used = stretch.weights[:, part] > 0
            variables[plain] = (("time", "joint"), np.where(used, target[:, part], np.nan))
            variables[f"{plain}_predicted"] = (("time", "joint"), y[:, part])
            for k, joint in enumerate(data.joints):
                if used[:, k].any():
                    pair = target[used[:, k], s * n + k], y[used[:, k], s * n + k]
                    columns.setdefault((stretch.run, joint, plain), []).append(pair)
        each = xr.Dataset(variables, {"time": ("time", stretch.t, {"units": "s"}), "joint": list(data.joints)})
        found.setdefault(stretch.run, []).append(each)
    for (run, joint, name), pairs in columns.items():
        true, own = (np.concatenate(column) for column in zip(*pairs, strict=True))
        key = f"{run}{mark}: {name}" if n == 1 else f"{run}{mark}: {joint}.{name}"
        measures[key] = agreement(true, own).by_name
    return {run: xr.concat(parts, "time") for run, parts in found.items()}, measures

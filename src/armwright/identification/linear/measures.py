"""Measures of the agreement between a model's free simulation and the measured outputs."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.fitting.measures import fit_percent, r_squared, rms
from armwright.identification.linear.records import Records


def percent(measured: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Fit (outputs,) [%] of every output; -inf of a simulation that diverges, NaN of an output that is constant."""
    with np.errstate(over="ignore", invalid="ignore"):
        return fit_percent(*_sums(measured, errors))


def _sums(measured: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Σ e² and Σ (y − ȳ)² (outputs,), of measured outputs and errors (rows, outputs)."""
    return (errors**2).sum(axis=0), ((measured - measured.mean(axis=0)) ** 2).sum(axis=0)


def simulation_measures(
    records: Records, scaled: Records, free: Any, one_step: Any, past: int, size: np.ndarray
) -> dict[str, dict[str, float]]:
    """Measures by run and output; `free` and `one_step` give errors (rows - past, outputs) of a scaled stretch."""
    found: dict[str, dict[str, float]] = {}
    for use, part in (("fit", scaled.fit), ("hold-out", scaled.hold_out)):
        for run in dict.fromkeys(each.run for each in part):
            own = [each for each in part if each.run == run and len(each.y) > past + 1]
            if not own:
                continue
            y = np.concatenate([each.y[past:] for each in own])
            with np.errstate(over="ignore", invalid="ignore"):
                e = np.concatenate([free(each) for each in own])
                one = np.concatenate([one_step(each) for each in own]) if one_step is not None else None
                sums, ones = _sums(y, e), None if one is None else percent(y, one)
                rows = zip(fit_percent(*sums), r_squared(*sums), rms(e, axis=0) * size, strict=True)
                for k, (name, (fit, r2, size_of)) in enumerate(zip(records.outputs, rows, strict=True)):
                    row = {"fit_percent": float(fit), "r2": float(r2), "rms": float(size_of)}
                    found[f"{run} ({use}): {name}"] = (
                        row if ones is None else row | {"one_step_percent": float(ones[k])}
                    )
    return found


def gain_units(records: Records) -> list[list[str]]:
    """Units of the gains, of every output by every input."""
    return [[f"{y} / {u}" if u else y for u in records.input_units] for y in records.output_units]

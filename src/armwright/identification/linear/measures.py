"""Measures of the agreement between a model's free simulation and the measured outputs."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.identification.linear.records import Records


def percent(measured: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """100 (1 - |errors| / |measured - mean|) of every output (outputs,) [%]."""
    spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        return 100.0 * (1.0 - np.linalg.norm(errors, axis=0) / np.maximum(spread, 1e-300))


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
                fits, ones = percent(y, e), None if one is None else percent(y, one)
                for k, name in enumerate(records.outputs):
                    rms = float(np.sqrt(np.mean(e[:, k] ** 2)) * size[k])
                    row = {"fit_percent": float(fits[k]), "r2": float(1 - (1 - fits[k] / 100) ** 2), "rms": rms}
                    found[f"{run} ({use}): {name}"] = (
                        row if ones is None else row | {"one_step_percent": float(ones[k])}
                    )
    return found


def gain_unit(records: Records) -> str:
    """Unit of the gain from the first input to the first output."""
    y, u = records.output_units[0], records.input_units[0]
    return f"{y} / {u}" if u else y

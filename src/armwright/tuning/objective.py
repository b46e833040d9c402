"""Scores of gains from reducers of compiled simulations: relative to the start, and infinite where a run fails.

    J = Σ_r w_r mean_j (v_rj / s_rj) + 10 Σ_l mean_j max(0, v_lj / limit_lj - 1)

for one lane; v is a reducer's number of joint j, s the start's mean of it over the lanes. Reducers that are shares (saturation,
overshoot) count as they are, s = 1. Over the lanes the mean or the worst of J counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.results.reducers import reducer
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Recording
from armwright.simulation.simulation import simulate
from armwright.tuning.lanes import taken
from armwright.tuning.space import GainSpace

OBJECTIVES = {"rms_error": 1.0, "saturation": 1.0}
BEYOND = 10.0  # weight of a peak beyond its limit
LITTLE = 1e-3  # of the largest joint's: a joint that hardly errs is measured by this


@dataclass(frozen=True, eq=False)
class Objective:
    """Scores of candidates in lanes of a scenario.

    Attributes:
        scenario: with lanes as batches.   space: of the gains.   weights: by reducer.   limits: (n,) by reducer.
        worst: whether the worst lane counts, else the mean.
    """

    scenario: Scenario
    space: GainSpace
    weights: Mapping[str, float]
    limits: Mapping[str, np.ndarray]
    worst: bool

    def values(self, gains: np.ndarray, lanes: np.ndarray) -> dict[str, np.ndarray]:
        """Reducers by name, (candidates, lanes, n), of one compiled run; infinite in lanes that diverged or stalled.

        Args:
            gains: (candidates, gains * n).   lanes: (lanes,) numbers of the scenario's lanes.
        """
        count, names = len(gains), tuple(dict.fromkeys([*self.weights, *self.limits]))
        tiled = taken(self.scenario, np.tile(lanes, count))
        assert tiled.loop is not None
        loop = replace(tiled.loop, controller=self.space.controller(np.repeat(gains, len(lanes), axis=0)))
        run = simulate(replace(tiled, loop=loop, recording=Recording(what="none", reduce=names)))
        failed = np.zeros(count * len(lanes), dtype=bool)
        for name in ("diverged_at", "stalled_at"):
            if name in run:
                failed |= ~np.isnan(run[name].values)
        found = {}
        for name in names:
            rows = np.array(run[name].values, dtype=float)
            absent = _of_absent(name, self.scenario)
            rows = np.where(np.isnan(rows), absent, rows)
            rows = np.where(failed[:, None] | ~np.isfinite(rows), np.inf, rows)
            found[name] = rows.reshape(count, len(lanes), -1)
        return found

    def scales(self, start: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """(n,) by reducer that relative scores are measured by, of the start's values (1, lanes, n); 1 of shares."""
        scales = {}
        for name in self.weights:
            mean = start[name][0].mean(axis=0)
            scales[name] = np.maximum(mean, LITTLE * mean.max()) if reducer(name).unit != "1" else np.ones_like(mean)
            scales[name] = np.where(scales[name] > 0.0, scales[name], 1.0)
        return scales

    def score(self, values: Mapping[str, np.ndarray], scales: Mapping[str, np.ndarray]) -> np.ndarray:
        """(candidates,) J over the lanes; infinite where any lane fails."""
        total = np.zeros(next(iter(values.values())).shape[:2])
        for name, weight in self.weights.items():
            total += weight * (values[name] / scales[name]).mean(axis=-1) if weight > 0.0 else 0.0
        for name, limit in self.limits.items():
            total += BEYOND * np.maximum(values[name] / limit - 1.0, 0.0).mean(axis=-1)
        return total.max(axis=-1) if self.worst else total.mean(axis=-1)


def _of_absent(name: str, scenario: Scenario) -> float:
    """What counts where a reducer has no number: a joint without a step does not overshoot; one unsettled takes the whole run."""
    if name == "overshoot":
        return 0.0
    return scenario.ticks * scenario.tick if name.startswith("settling_time") else np.inf


def checked_weights(objectives: Any) -> dict[str, float]:
    """Weights by reducer.

    Raises:
        ScenarioError: an unknown reducer, a weight below 0, or none above.
    """
    if not isinstance(objectives, Mapping):
        raise ScenarioError(
            place="objectives", value=objectives, expected="weights by name, such as {'rms_error': 1.0}"
        )
    for name, weight in objectives.items():
        reducer(name)
        number = scalar.real_number(weight)
        if number is None or not 0.0 <= number < np.inf:
            raise ScenarioError(place=f"objectives[{name!r}]", value=weight, expected="a weight of 0 or more")
    if not any(weight > 0.0 for weight in objectives.values()):
        raise ScenarioError(place="objectives", value=dict(objectives), expected="a weight above 0")
    return {name: float(weight) for name, weight in objectives.items()}


def checked_limits(limits: Any, n: int) -> dict[str, np.ndarray]:
    """Limits (n,) by reducer.

    Raises:
        ScenarioError: an unknown reducer, or limits that are not above 0.
    """
    if not isinstance(limits, Mapping):
        raise ScenarioError(place="limits", value=limits, expected="limits by name, such as {'peak_torque': 40.0}")
    found = {}
    for name, limit in limits.items():
        reducer(name)
        try:
            found[name] = np.broadcast_to(scalar.real_numbers(limit), (n,))
        except ValueError:
            found[name] = np.zeros(n)
        if not (found[name] > 0.0).all():
            raise ScenarioError(place=f"limits[{name!r}]", value=limit, expected=f"a number above 0, or {n} of them")
    return found

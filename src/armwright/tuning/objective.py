"""Scores of gains from reducers of compiled simulations: relative to the start, and infinite for failed runs.

    J = Σ_r w_r mean_j (v_rj / s_rj) + 10 Σ_l mean_j max(0, v_lj / limit_lj - 1)

for one lane; v is a reducer's number of joint j, s the start's mean of it over the lanes, of tracking errors at least a tenth of
the largest joint's. Reducers that are shares (saturation, overshoot) count as they are, s = 1. Over the lanes the mean or the
worst of J counts. Beside reducers there are the measures of the linear loop (`linear_measures`), which are those of the record's
arm in all lanes.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.results.reducers import REDUCERS, reducer
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Recording
from armwright.simulation.simulation import simulate
from armwright.sweeps.source import PythonSource
from armwright.sweeps.sweep import simulate_chunk
from armwright.tuning.lanes import taken
from armwright.tuning.linear_measures import MEASURES
from armwright.tuning.space import GainSpace

BEYOND = 10.0  # weight of a peak beyond its limit
PATIENCE = 60.0  # [s] for the first worker of a cluster
IDLE = 0.1  # of the largest joint's tracking error: a joint at rest is measured by this, not by its own small error
LITTLE = 1e-3  # the same of other measures, which differ more from joint to joint


@dataclass(frozen=True, eq=False)
class Objective:
    """Scores of candidates in lanes of a scenario.

    Attributes:
        scenario: with lanes as batches.   space: of the gains.   weights: by reducer.   limits: (n,) by reducer.
        worst: whether the worst lane counts, else the mean.
        linear: (name, gains) → (candidates, n) of a measure of the linear loop.
        levels: mean of each objective at the start, which no candidate should exceed; None: it may.
        client: Dask client whose workers simulate; None: this process.
    """

    scenario: Scenario
    space: GainSpace
    weights: Mapping[str, float]
    limits: Mapping[str, np.ndarray]
    worst: bool
    linear: Callable[[str, np.ndarray], np.ndarray]
    levels: Mapping[str, float] | None = None
    client: Any = None

    def values(self, gains: np.ndarray, lanes: np.ndarray) -> dict[str, np.ndarray]:
        """Reducers by name, (candidates, lanes, n), of one compiled run; infinite in lanes that diverged or stalled.

        Args:
            gains: (candidates, gains * n).   lanes: (lanes,) numbers of the scenario's lanes.
        """
        count, names = len(gains), tuple(dict.fromkeys([*self.weights, *self.limits]))
        reduced = tuple(name for name in names if name not in MEASURES)
        tiled = taken(self.scenario, np.tile(lanes, count))
        assert tiled.loop is not None
        loop = replace(tiled.loop, controller=self.space.controller(np.repeat(gains, len(lanes), axis=0)))
        what = Recording(what="none", reduce=reduced or ("rms_error",))  # of which failing lanes are known at least
        run = self._simulated(replace(tiled, loop=loop, recording=what))
        failed = np.zeros(count * len(lanes), dtype=bool)
        for name in ("diverged_at", "stalled_at"):
            if name in run:
                failed |= ~np.isnan(run[name])
        found = {}
        for name in names:
            if name in MEASURES:
                rows = np.repeat(self.linear(name, gains), len(lanes), axis=0)
            else:
                rows = np.array(run[name], dtype=float)
                rows = np.where(np.isnan(rows), _of_absent(name, self.scenario), rows)
            rows = np.where(failed[:, None] | ~np.isfinite(rows), np.inf, rows)
            found[name] = rows.reshape(count, len(lanes), -1)
        return found

    def _simulated(self, scenario: Scenario) -> dict[str, np.ndarray]:
        """Results by lane of a scenario, simulated here or in chunks on a Dask cluster."""
        if self.client is None:
            run = simulate(scenario.without_global_error)
            return {str(name): run[name].values for name in run.data_vars if "lane" in run[name].dims}
        return simulated_on(self.client, scenario)

    def scales(self, start: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """(n,) by reducer: scales of relative scores, from the start's values (1, lanes, n); 1 for shares."""
        scales = {}
        for name in self.weights:
            mean = start[name][0].mean(axis=0)
            mean = np.where(np.isfinite(mean), mean, 1.0)  # of a start that is refused
            scales[name] = np.ones_like(mean) if is_share(name) else np.maximum(mean, self._least(name, mean))
            scales[name] = np.where(scales[name] > 0.0, scales[name], 1.0)
        return scales

    def _least(self, name: str, mean: np.ndarray) -> np.ndarray:
        """(n,) that the scale of a measure is at least, of its means (n,) at the start."""
        if name in MEASURES or reducer(name).unit != "q":
            return np.full_like(mean, LITTLE * mean.max())
        units = np.array(measure_units(self.scenario.arm, name))
        return IDLE * np.array([mean[units == unit].max() for unit in units])

    def score(self, values: Mapping[str, np.ndarray], scales: Mapping[str, np.ndarray]) -> np.ndarray:
        """(candidates,) J over the lanes; infinite if any lane fails."""
        total = np.zeros(next(iter(values.values())).shape[:2])
        for name, weight in self.weights.items():
            total += weight * (values[name] / scales[name]).mean(axis=-1) if weight > 0.0 else 0.0
        for name, limit in self.limits.items():
            total += BEYOND * np.maximum(values[name] / limit - 1.0, 0.0).mean(axis=-1)
        score = total.max(axis=-1) if self.worst else total.mean(axis=-1)
        if self.levels is not None:
            for name, each in self.means(values, scales).items():
                score = score + BEYOND * np.maximum(each - self.levels[name], 0.0)
        return score

    def means(self, values: Mapping[str, np.ndarray], scales: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """(candidates,) by objective of weight above 0: over joints and lanes, or of the worst lane, relative to `scales`."""
        lanes = {
            name: (values[name] / scales[name]).mean(axis=-1) for name, weight in self.weights.items() if weight > 0.0
        }
        return {name: each.max(axis=-1) if self.worst else each.mean(axis=-1) for name, each in lanes.items()}


def is_share(name: str) -> bool:
    """True for a reducer that is scored absolutely, not relative to the start."""
    return name not in MEASURES and reducer(name).unit == "1"


def measure_units(arm: Model, name: str) -> list[str]:
    """The unit of a reducer, or of a measure of the linear loop, for each joint.

    The noise gain is a command's for noise in all joints' positions, whose unit is the joints' own where they are alike.
    """
    if name == "noise_gain":
        positions = set(joint_units(arm, "q"))
        return [f"{unit}/{' | '.join(sorted(positions, reverse=True))}" for unit in joint_units(arm, "u")]
    return joint_units(arm, "1" if name in MEASURES else reducer(name).unit)


def simulated_on(client: Any, scenario: Scenario) -> dict[str, np.ndarray]:
    """Results by lane of a scenario, simulated by the workers of a Dask client in one chunk for each of their threads.

    Raises:
        ScenarioError: the cluster has no workers, or a chunk fails on it.
    """
    import cloudpickle

    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        expected = "a Dask client with workers"
        raise ScenarioError("the cluster has no workers", place="client", expected=expected) from None
    count, threads = scenario.lane_count or 1, sum(client.nthreads().values())
    ends = np.linspace(0, count, min(threads, count) + 1).astype(int)
    futures = []
    for first, last in itertools.pairwise(ends):
        part = replace(taken(scenario, np.arange(first, last)), lanes=int(last - first), first_lane=int(first))
        data = cloudpickle.dumps(PythonSource(part))  # its lanes have the noise that they would have here
        futures.append(client.submit(simulate_chunk, data, range(first, last), False, pure=False))
    try:
        parts = [values for values, _ in client.gather(futures)]
    except (OSError, TimeoutError, RuntimeError) as error:
        what = f"a chunk failed on the cluster: {' '.join(str(error).split())[:200]}"
        raise ScenarioError(what, place="client", expected="a cluster whose workers stay") from None
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _of_absent(name: str, scenario: Scenario) -> float:
    """Value that replaces a reducer's NaN: overshoot 0, settling time the whole run, others infinite."""
    if name == "overshoot":
        return 0.0
    return scenario.ticks * scenario.tick if name.startswith("settling_time") else np.inf


def _known(place: str, name: str) -> None:
    """Refuses what is neither a reducer nor a measure of the linear loop.

    Raises:
        ScenarioError: names the nearest ones.
    """
    if name not in MEASURES:
        try:
            reducer(name)
        except ScenarioError:
            choices = (*REDUCERS, *MEASURES)
            raise ScenarioError("unknown", place=place, value=name, choices=choices) from None


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
        _known("objectives", name)
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
        _known("limits", name)
        try:
            found[name] = np.broadcast_to(scalar.real_numbers(limit), (n,))
        except ValueError:
            found[name] = np.zeros(n)
        if not (found[name] > 0.0).all():
            raise ScenarioError(place=f"limits[{name!r}]", value=limit, expected=f"a number above 0, or {n} of them")
    return found

"""Lanes in which candidate gains are simulated: those of the scenario, with draws of the uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.parameters import Batch, batches, with_parts
from armwright.simulation.checks import check_whole
from armwright.simulation.scenario import WITH_LANES, Scenario
from armwright.tuning.uncertainty import USUAL, Uncertainty

LEAST = 4  # lanes: two to tune in, two to judge with


def scenario_lanes(scenario: Scenario, draws: Mapping[str, Any] | None, lanes: int, seed: int) -> Scenario:
    """The scenario with all its lanes as batches.

    Args:
        scenario: with lanes of its own or one run.   draws: as `Uncertainty.of`; None: `USUAL` of a single run, nothing else.
        lanes: how many of a single run.   seed: of the draws.
    Raises:
        ScenarioError: too few lanes, or nothing that differs between them.
    """
    check_whole("lanes", lanes, LEAST)
    own = scenario.resolved.lane_count
    count = lanes if own is None else own
    if draws is None:
        draws = USUAL if own is None else {}
    uncertainty = Uncertainty.of(draws)
    if count < LEAST:
        raise ScenarioError(f"{count} lanes", place="lanes", expected=f"{LEAST} or more: half of them judge the result")
    every = uncertainty.applied(scenario.resolved, count, seed) if draws else scenario.resolved
    if every.lane_count is None or not any(_differing(every)):
        what = "nothing differs between the lanes"
        raise ScenarioError(what, place="draws", expected="draws, or a scenario with lanes of its own")
    return every


def _differing(scenario: Scenario) -> list[bool]:
    """True for each batch of a scenario."""
    return [True for name in WITH_LANES for _ in batches(getattr(scenario, name), name)]


def taken(scenario: Scenario, index: np.ndarray) -> Scenario:
    """Some lanes of a resolved scenario, in any order, with repetition.

    Args:
        scenario: whose lanes are batches.   index: (lanes,) numbers of lanes.
    """

    def rows(part: Any, place: str) -> Any:
        if not isinstance(part, Batch):
            return part
        numeric = isinstance(part.values, np.ndarray)
        return Batch(part.values[index] if numeric else [part.values[k] for k in index])

    parts = {name: with_parts(getattr(scenario, name), name, rows, check=False) for name in WITH_LANES}
    return replace(scenario, **parts, lanes=None, first_lane=0)

"""Lanes of uncertainty that candidates are scored in: those of the scenario, or masses and friction drawn about the record."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.parameters import Batch, uniform_numbers
from armwright.simulation.checks import check_whole
from armwright.simulation.scenario import WITH_LANES, Scenario

MASS = 0.3  # of each link's mass, either way
FRICTION = 2.0  # factor either way of each joint's friction, all of its torques together
LEAST = 4  # lanes: two to tune in, two to judge with


def scenario_lanes(scenario: Scenario, draws: Mapping[str, Any] | None, lanes: int, seed: int) -> Scenario:
    """The scenario with all its lanes as batches.

    Args:
        scenario: with lanes of its own or one run.   draws: further values for `vary`; None: `usual_draws` of a single run.
        lanes: how many of a single run.   seed: of the usual draws.
    Raises:
        ScenarioError: too few lanes, or nothing that differs between them.
    """
    check_whole("lanes", lanes, LEAST)
    own = scenario.resolved.lane_count
    count = lanes if own is None else own
    if draws is None:
        draws = usual_draws(scenario.arm, count, seed) if own is None else {}
        draws = {name: value for name, value in draws.items() if name not in scenario.vary}
    if not isinstance(draws, Mapping):
        raise ScenarioError(place="draws", value=draws, expected="values by name, such as {'link6.mass_kg': aw.Draw()}")
    if own is None and not draws:
        what = "nothing differs between the lanes"
        raise ScenarioError(what, place="draws", expected="draws, or a scenario with lanes of its own")
    if count < LEAST:
        raise ScenarioError(f"{count} lanes", place="lanes", expected=f"{LEAST} or more: half of them judge the result")
    asked = scenario.lanes if own is not None else count
    return replace(scenario, vary={**scenario.vary, **draws}, lanes=asked).resolved


def usual_draws(arm: Model, lanes: int, seed: int) -> dict[str, Batch]:
    """Masses of all links within ±30 %, evenly, and friction within a factor of two, evenly in its logarithm, by name.

    Args:
        arm: made from a record.   lanes: how many.   seed: of the draws.
    """
    found: dict[str, Batch] = {}
    rubs = "friction" not in arm.changes
    for row in arm.parameters if arm.description is not None else ():
        owner, _, key = row.name.partition(".")
        if key == "mass_kg" and row.value > 0.0:
            u = uniform_numbers(seed, row.name, range(lanes), 1)[:, 0]
            found[row.name] = Batch(row.value * (1.0 + MASS * (2.0 * u - 1.0)))
        elif (
            rubs and key.startswith("friction.") and row.unit.startswith("N") and row.value != 0.0 and row.entry is None
        ):
            u = uniform_numbers(seed, f"{owner}.friction", range(lanes), 1)[:, 0]
            found[row.name] = Batch(row.value * FRICTION ** (2.0 * u - 1.0))
    return found


def taken(scenario: Scenario, index: np.ndarray) -> Scenario:
    """The scenario of some lanes of a resolved one, in any order and any number of times.

    Args:
        scenario: whose lanes are batches.   index: (lanes,) numbers of lanes.
    """
    parts = {name: _rows(getattr(scenario, name), index) for name in WITH_LANES}
    return replace(scenario, **parts, lanes=None, first_lane=0)


def _rows(value: Any, index: np.ndarray) -> Any:
    """A value with the rows of its batches."""
    if isinstance(value, Batch):
        numeric = isinstance(value.values, np.ndarray)
        return Batch(value.values[index] if numeric else [value.values[k] for k in index])
    if is_dataclass(value) and not isinstance(value, type):
        changed = copy.copy(value)
        for each in fields(value):
            part = getattr(value, each.name)
            new = _rows(part, index)
            if new is not part:
                object.__setattr__(changed, each.name, new)
        return changed
    if isinstance(value, Mapping):
        return {name: _rows(each, index) for name, each in value.items()}
    if isinstance(value, (list, tuple)) and not isinstance(value, str):
        parts = [each if isinstance(each, (int, float)) else _rows(each, index) for each in value]
        return value if all(a is b for a, b in zip(parts, value, strict=True)) else type(value)(parts)
    return value

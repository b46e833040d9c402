"""Scenarios from fields named flat, for tests that share some fields and vary one: each field goes to the part that has it."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import armwright as aw
from armwright import scalar

STARTS = {"q0": "q", "qd0": "qd"}
PARTS = {"loop": aw.Loop, "inputs": aw.Inputs, "solver": aw.Solver, "recording": aw.Recording}
HOMES = {each.name: part for part, kind in reversed(PARTS.items()) for each in fields(kind)}


def by_part(values: dict[str, Any], *, looped: bool) -> dict[str, dict[str, Any]]:
    """Fields of the scenario's parts by part, "start" too; "" holds the scenario's own."""
    found: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        part = "start" if name in STARTS else HOMES.get(name, "")
        part = "recording" if name == "reference" and not looped else part
        if part == "loop" and not looped and value is None:
            continue
        found.setdefault(part, {})[STARTS.get(name, name)] = value
    return found


def scenario_of(arm: aw.Model, **values: Any) -> aw.Scenario:
    """A scenario from its own fields and those of its parts, by rk3 unless another integrator is named.

    q0 and qd0 are those of `Start`, and are left out beside a start.
    """
    values = {"integrator": "rk3", **values}
    parts = by_part(values, looped=values.get("command") is None)
    made = {name: kind(**parts[name]) for name, kind in PARTS.items() if name in parts}
    if "start" in parts and "start" not in values:
        made["start"] = aw.Start(**parts["start"])
    return aw.Scenario(arm, **made, **parts.get("", {}))


def with_fields(scenario: aw.Scenario, **values: Any) -> aw.Scenario:
    """A scenario with other values of some fields."""
    parts = by_part(values, looped=scenario.sampled)
    changed = {name: replace(getattr(scenario, name), **parts[name]) for name in (*PARTS, "start") if name in parts}
    return replace(scenario, **changed, **parts.get("", {}))


def slopes_of(f):
    """(x, …) → dx/dt, A = ∂f/∂x and E = 1 of a system whose function f (x, …) can be traced."""
    return lambda x, *rest: (f(x, *rest), scalar.jacobian(lambda at: f(at, *rest), x), scalar.eye(len(x)))

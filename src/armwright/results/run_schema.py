"""Schema of a run: its variables and attributes, their types, dimensions and order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.entry import ENTRIES
from armwright.errors import RunError, shown
from armwright.joint_kinds import moving_kinds
from armwright.model.joint_signals import LONG_NAMES
from armwright.results.aliases import LOOP_STATE, PARTIAL, SESSION

A_RUN = "the dataset that simulate returns"
LONGEST_NAME = 200  # letters of a variable's name
LATEST = 1e15  # [s]; between later times differences are rounding
NUMBERS, WHOLE, TEXTS = "real numbers", "whole numbers from 0", "texts"
OVER_LANES = ("lane", "statistic")  # either; statistics of a run have the second instead of the first
MOTION = (*OVER_LANES, "time", "joint")


@dataclass(frozen=True)
class Rule:
    """Rule of a variable.

    Attributes:
        dims: dimensions that it may have; a coordinate has its own wherever the run has it.
        along: those of them that it has wherever the run has them.   kind: of its values.   needed: every run has it.
        finite: no NaN, no infinity.   most: its largest size.   rising: each above the one before.   unique: no value twice.
        choices: all allowed values.   units: all allowed units.
    """

    dims: tuple[str, ...]
    kind: str = NUMBERS
    needed: bool = False
    finite: bool = False
    most: float = np.inf
    rising: bool = False
    unique: bool = False
    choices: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    along: tuple[str, ...] = ()


COORDINATES = {
    "joint": Rule(("joint",), TEXTS, needed=True, unique=True),
    "kind": Rule(("joint",), TEXTS, needed=True, choices=tuple(moving_kinds())),
    "command": Rule(("joint",), TEXTS, needed=True, choices=("voltage", "current", "torque", "position")),
    "time": Rule(("time",), finite=True, most=LATEST, rising=True, units=("s",)),
    "lane": Rule(("lane",), WHOLE, unique=True),
    "event": Rule(("event",), TEXTS, unique=True),
    "statistic": Rule(("statistic",), TEXTS, unique=True),
}
VARIABLES = {
    **dict.fromkeys(LONG_NAMES, Rule(MOTION, along=("time", "joint"))),
    **dict.fromkeys(("diverged_at", "stalled_at", "steps_tried"), Rule(OVER_LANES)),
    **dict.fromkeys(("event_time", "event_count"), Rule((*OVER_LANES, "event"))),
    LOOP_STATE: Rule((*OVER_LANES, "state_entry"), finite=True),
}
OTHERS = Rule(())  # variables of sensors, reducers and users: numbers along any dimensions
TEXT_ATTRIBUTES = ("robot", "title", "notes", "integrator", "controller", "made_with", "scenario", PARTIAL, SESSION)
NUMBER_ATTRIBUTES = ("step_s", "sample_period_s", "seed", "rtol", "atol", "lanes", "lanes_left_out")


def check_run(run: Any) -> None:
    """Refuses a dataset that is not a run or lacks parts of one, such as `run.isel(joint=0)`.

    Raises:
        RunError: no dataset, or one that breaks the schema; names the variable, its value and what was expected.
    """
    import xarray as xr

    if not isinstance(run, xr.Dataset):
        raise RunError(place="run", value=run, expected=ENTRIES["run"].expected)
    _check_attributes(run.attrs)
    if not run.variables and SESSION in run.attrs:
        return  # a session that was saved before its first simulation
    for name, rule in COORDINATES.items():
        if rule.needed and name not in run.coords:
            raise RunError(f"no coordinate {name!r}", expected=A_RUN)
    for name, variable in run.variables.items():
        if len(str(name)) > LONGEST_NAME:
            raise RunError(
                "a name too long", place="variable", value=str(name), expected=f"{LONGEST_NAME} letters at most"
            )
        rule = COORDINATES.get(str(name)) or VARIABLES.get(str(name), OTHERS)
        _check_dimensions(str(name), variable, rule, run)
        _check_values(str(name), variable, rule)


def _check_attributes(attributes: Mapping[Any, Any]) -> None:
    for name in TEXT_ATTRIBUTES:
        if name in attributes and not isinstance(attributes[name], str):
            raise RunError(place=f"attribute {name}", value=attributes[name], expected="text")
    for name in NUMBER_ATTRIBUTES:
        value = attributes.get(name, 0.0)
        if isinstance(value, (bool, str)) or not np.isscalar(value) or not np.isreal(value) or not np.isfinite(value):
            raise RunError(place=f"attribute {name}", value=value, expected="a finite number")


def _check_dimensions(name: str, variable: Any, rule: Rule, run: Any) -> None:
    dims = tuple(str(dim) for dim in variable.dims)
    along = rule.dims if name in COORDINATES else rule.along
    wanted = tuple(dim for dim in along if dim in run.dims)
    allowed = wanted if name in COORDINATES else rule.dims or dims
    if not set(wanted) <= set(dims) <= set(allowed):
        raise RunError(f"along {_listed(dims)}", place=name, expected=f"along {_listed(wanted or allowed)}")


def _listed(dims: tuple[str, ...]) -> str:
    return shown(", ".join(dims)).strip("'") if dims else "no dimension"


def _is_of_kind(values: np.ndarray, variable: Any, rule: Rule) -> bool:
    """True for values of the type that a rule asks for; what no time and no joint has may be of any type."""
    if rule.kind == TEXTS:
        return values.dtype.kind in "US" or all(isinstance(value, str) for value in values.ravel())
    if rule.kind == WHOLE:
        return values.dtype.kind in "iu" and bool((values >= 0).all())
    return values.dtype.kind in "fiub" or (rule is OTHERS and not {"time", "joint"} & set(variable.dims))


def _check_values(name: str, variable: Any, rule: Rule) -> None:
    values, units = np.asarray(variable.values), variable.attrs.get("units", "")
    if not isinstance(units, str):
        raise RunError(place=f"{name} attribute units", value=units, expected="text")
    if rule.units and units and units not in rule.units:
        raise RunError(place=f"unit of {name}", value=units, expected=" or ".join(rule.units))
    if not _is_of_kind(values, variable, rule):
        raise RunError(f"{values.dtype} values", place=name, expected=rule.kind)
    flat = values.ravel()
    if rule.finite and not np.isfinite(flat).all():
        row = int(np.argmin(np.isfinite(flat)))
        raise RunError(place=f"{name}[{row}]", value=float(flat[row]), expected="a finite number")
    if rule.most < np.inf and (np.abs(flat) > rule.most).any():
        row = int(np.argmax(np.abs(flat) > rule.most))
        raise RunError(place=f"{name}[{row}]", value=float(flat[row]), expected=f"at most {rule.most:g}")
    if rule.rising and not (np.diff(flat) > 0).all():
        row = int(np.argmin(np.diff(flat) > 0)) + 1
        what = f"behind {flat[row - 1]:g}"
        raise RunError(what, place=f"{name}[{row}]", value=float(flat[row]), expected="increasing values")
    if rule.unique and len(np.unique(flat)) < len(flat):
        first, count = np.unique(flat, return_counts=True)
        raise RunError("occurs twice", place=name, value=first[np.argmax(count)], expected="different values")
    for value in flat if rule.choices else ():
        if str(value) not in rule.choices:
            raise RunError(place=name, value=str(value), expected=" or ".join(rule.choices))

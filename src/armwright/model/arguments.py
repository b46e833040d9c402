"""Checks of what plain functions get: an arm, and arrays of numbers or symbols that hold one state of it."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from armwright import scalar
from armwright.entry import as_arm
from armwright.errors import ModelError, ShapeError
from armwright.model.model import Model

JOINTS = ("q", "qd", "qdd", "tau", "voltage", "u")  # arguments with one number a joint
WRENCH = (6,)
SCALARS = (scalar.Symbol, int, float, np.number)  # that arrays of objects may hold: in a trace both stand side by side

Function = TypeVar("Function", bound=Callable[..., Any])


def one_state(function: Function) -> Function:
    """A plain function of an arm, (model, q, …), that refuses arrays which are not those of one state.

    Numbers of any type become floats; arrays that hold symbols pass as they are, so nothing is traced.

    Raises:
        ModelError: the first argument is no arm.
        ShapeError: an array of another shape, or of something else than numbers; names the argument and what was expected.
    """
    names = list(inspect.signature(function).parameters)[1:]

    @functools.wraps(function)
    def checked(arm: Model, *arrays: Any, **named: Any) -> Any:
        model = as_arm(arm)
        place = f"{function.__name__}: "
        state = [_of_one_state(place, model, name, value) for name, value in zip(names, arrays, strict=False)]
        rest = {name: _of_one_state(place, model, name, value) for name, value in named.items()}
        return function(model, *state, *arrays[len(names) :], **rest)

    return checked  # type: ignore[return-value]


def one_state_with_masses(function: Function) -> Function:
    """`one_state` of a function that needs the links' mass properties, and refuses an arm that does not know them.

    Raises:
        ModelError: links without mass properties, of an arm that was loaded for its kinematics only; names them.
    """
    checked = one_state(function)

    @functools.wraps(function)
    def with_masses(arm: Model, *arrays: Any, **named: Any) -> Any:
        model = as_arm(arm)
        if model.without_masses:
            links = ", ".join(map(repr, model.without_masses))
            expected = "mass_kg, com_m and inertia_kg_m2 in the record; kinematics alone need none"
            what = f"{function.__name__} needs mass properties, which are not known"
            raise ModelError(what, place=f"{model.name} links {links}", expected=expected)
        return checked(model, *arrays, **named)

    return with_masses  # type: ignore[return-value]


def _of_one_state(place: str, model: Model, name: str, value: Any) -> Any:
    """An argument as floats or symbols; one that is no array of a state as it is."""
    expected = (model.n,) if name in JOINTS else WRENCH if name == "wrench" else None
    if expected is None or (value is None and name == "wrench"):
        return value
    if scalar.has_masked_entries(value):
        raise ShapeError("masked entries", place=f"{place}{name}", expected="numbers")
    if _shape(value) != expected:
        raise _wrong_shape(f"{place}{name}", model, name, value, expected)
    try:
        entries = np.asarray(value)
        if entries.dtype == object and all(isinstance(each, SCALARS) for each in entries):
            return scalar.array(entries)
        return scalar.real_numbers(entries)
    except (ValueError, TypeError, OverflowError) as error:
        raise ShapeError(str(error), place=f"{place}{name}", expected="numbers") from None


def _shape(value: Any) -> tuple[int, ...] | None:
    try:
        return np.shape(value)
    except (ValueError, TypeError, RecursionError):  # rows of unequal length, lists that hold themselves
        return None


def _wrong_shape(place: str, model: Model, name: str, value: Any, expected: tuple[int, ...]) -> ShapeError:
    shape = _shape(value)
    entries = f"one number for each joint of {model.name}" if name in JOINTS else "force and moment"
    batch = "; for many states at once see aw.compile" if shape and len(shape) > 1 else ""
    batch += f", which takes (…, {expected[0]}): .T?" if shape and shape[0] == expected[0] and shape[1:] > (1,) else ""
    what = "rows of unequal length" if shape is None else f"shape {shape}"
    return ShapeError(what, place=place, expected=f"{expected}, {entries}{batch}")

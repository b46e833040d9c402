"""Checks of what plain functions get: an arm, and arrays that hold one state of it."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from armwright.errors import ModelError, ShapeError
from armwright.model.model import Model

JOINTS = ("q", "qd", "qdd", "tau", "voltage", "u")  # arguments with one number a joint
WRENCH = (6,)

Function = TypeVar("Function", bound=Callable[..., Any])


def check_arm(arm: Any) -> None:
    """Refuses a value that is no arm, such as the name of one.

    Raises:
        ModelError: it is no `Model`.
    """
    if not isinstance(arm, Model):
        raise ModelError(value=arm, expected="an arm; load it first: aw.load(NAME or PATH)")


def one_state(function: Function) -> Function:
    """A plain function of an arm, (model, q, …), that refuses arrays which are not those of one state.

    Only shapes are looked at, so numbers and symbols pass alike and nothing is traced.

    Raises:
        ModelError: the first argument is no arm.
        ShapeError: an array of another shape; names the argument, its shape and the one expected.
    """
    names = list(inspect.signature(function).parameters)[1:]

    @functools.wraps(function)
    def checked(model: Model, *arrays: Any, **named: Any) -> Any:
        check_arm(model)
        for name, value in (*zip(names, arrays, strict=False), *named.items()):
            expected = (model.n,) if name in JOINTS else WRENCH if name == "wrench" else None
            if expected is not None and value is not None and _shape(value) != expected:
                raise _wrong_shape(f"{function.__name__}: {name}", model, name, value, expected)
        return function(model, *arrays, **named)

    return checked  # type: ignore[return-value]


def _shape(value: Any) -> tuple[int, ...] | None:
    try:
        return np.shape(value)
    except ValueError:  # rows of unequal length
        return None


def _wrong_shape(place: str, model: Model, name: str, value: Any, expected: tuple[int, ...]) -> ShapeError:
    shape = _shape(value)
    entries = f"one number for each joint of {model.name}" if name in JOINTS else "force and moment"
    batch = "; for many states at once see aw.compile" if shape and len(shape) > 1 else ""
    what = "rows of unequal length" if shape is None else f"shape {shape}"
    return ShapeError(what, place=place, expected=f"{expected}, {entries}{batch}")

"""Checks of the values that users set on a scenario and its parts: one number, one for each joint, one for each lane, a word."""

from __future__ import annotations

import inspect
import numbers
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError, check_known
from armwright.model import Model
from armwright.parameters import Batch, Draw, lane_values, numbers_by_lane

Fits = Callable[[np.ndarray], np.ndarray]


def check_numbers(
    place: str, value: Any, fits: Fits, expected: str, *, per_joint: bool = False, batch: bool = False
) -> None:
    """Refuses what is not a number that fits, or several of such.

    Args:
        place: of the value, for errors.   value: what stands there.
        fits: (k,) floats → (k,) bools, true where a number may be.   expected: what is expected, in words.
        per_joint: one number for each joint is allowed.   batch: a `Batch` or `Draw` is allowed.
    Raises:
        ScenarioError: names the place, the first wrong number and what was expected.
    """
    if batch and isinstance(value, Draw):
        return  # checked when it is drawn
    expected += ", or one for each joint" * per_joint + ", or a Batch of such" * batch
    by_lane = batch and isinstance(value, Batch)
    try:
        values = numbers_by_lane(value if by_lane or not isinstance(value, (Batch, Draw)) else None)
    except ValueError:
        values = np.zeros(0)
    if not values.ndim or not values.size or values.ndim > 1 + per_joint or _is_bool(value):
        raise ScenarioError(place=place, value=value, expected=expected)
    wrong = np.argwhere(~np.asarray(fits(values)))
    if len(wrong):
        first = tuple(int(k) for k in wrong[0])  # lane, then joint where there is one per joint
        place += "".join(f"[{joint}]" for joint in first[1:]) + (f" of lane {first[0]}" if by_lane else "")
        raise ScenarioError(place=place, value=float(values[first]), expected=expected)


def _is_bool(value: Any) -> bool:
    return np.asarray(value.values if isinstance(value, Batch) else value).dtype == bool


def check_choice(place: str, value: Any, choices: tuple[str, ...]) -> None:
    """Refuses a word that is none of the choices.

    Raises:
        ScenarioError: names it and the nearest ones.
    """
    check_known(ScenarioError, value, choices, "unknown", place=place)


def is_whole(value: Any, least: int) -> bool:
    """True for a whole number that is at least so large."""
    return isinstance(value, numbers.Integral) and scalar.real_number(value) is not None and int(value) >= least


def check_whole(place: str, value: Any, least: int) -> None:
    """Refuses what is no whole number, or one below the least.

    Raises:
        ScenarioError: shows it.
    """
    if not is_whole(value, least):
        raise ScenarioError(place=place, value=value, expected=f"a whole number, {least} or more")


def check_time(place: str, value: Any) -> None:
    """Refuses what is no finite time above 0.

    Raises:
        ScenarioError: shows it.
    """
    number = scalar.real_number(value)
    if number is None or not 0.0 < number < np.inf:
        raise ScenarioError(place=place, value=value, expected="a time above 0 [s]")


def one_each(place: str, value: Any, arm: Model) -> np.ndarray:
    """(n,) a setting that is one for all joints, or one for each; of a batch, that of the first lane.

    Raises:
        ScenarioError: of another length; names the joints.
    """
    if isinstance(value, Draw):
        return np.ones(arm.n)
    values = scalar.array(lane_values(value)[0] if isinstance(value, Batch) else value)
    if values.ndim and len(values) != arm.n:
        raise ScenarioError(place=place, value=value, expected=f"one number, or {arm.n}: {', '.join(arm.names)}")
    return np.broadcast_to(values, arm.n)


def check_arguments(function: Callable[..., Any], names: Sequence[str], place: str) -> None:
    """Refuses a function that does not take arguments of that number, in their order.

    Args:
        function: of a user.   names: of the arguments.   place: of the function, for errors.
    Raises:
        ScenarioError: names it, and what it takes.
    """
    try:
        taken = inspect.signature(function)
    except ValueError:  # a built-in function without a signature
        return
    try:
        taken.bind(*names)
    except TypeError:
        raise ScenarioError(f"takes {taken}", place=place, expected=f"({', '.join(names)})") from None

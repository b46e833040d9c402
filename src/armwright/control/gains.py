"""Gains as a law takes them: one number for all joints, one for each, or a row a lane."""

from __future__ import annotations

import numbers
from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.simulation.settings import shown


def per_joint(arm: Model, law: str, name: str, value: Any, *, low: float = 0.0, limit: bool = False) -> np.ndarray:
    """A gain as (n,), or as (lanes, n) where it was given a row a lane.

    Args:
        arm: the model.   law, name: who asks, for errors.
        value: a number for all joints, (n,), (lanes, 1) or (lanes, n).
        low: the least that is allowed.   limit: whether it may be infinite, which None says too.
    Raises:
        ScenarioError: names the gain, its shape or value, and what was expected.
    """
    n = arm.n
    value = np.inf if limit and value is None else value
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = None
    if array is None or np.asarray(value).dtype.kind not in "iufO":  # "20" and True would be numbers to NumPy
        raise ScenarioError(f"{law}: {name} = {shown(value)}: expected a number, or one for each joint")
    if array.ndim > 2 or (array.ndim and array.shape[-1] not in ((n,) if array.ndim == 1 else (1, n))):
        raise ScenarioError(
            f"{law}: {name} has shape {array.shape}; expected one number, ({n},) or (lanes, {n}): {', '.join(arm.names)}"
        )
    rows = np.broadcast_to(array, (*array.shape[:-1], n)) if array.ndim else np.full(n, float(array))
    wrong = ~(rows >= low) | (np.isinf(rows) & (not limit))
    if wrong.any():
        at = tuple(np.argwhere(wrong)[0])
        what = f"a number of {low:g} or more" if low == 0.0 else f"a number above {np.nextafter(low, 0):g}"
        raise ScenarioError(f"{law}: {name} of joint {arm.names[at[-1]]!r} is {rows[at]:g}; expected {what}")
    return np.ascontiguousarray(rows)


def positive_limit(arm: Model, law: str, name: str, value: Any) -> np.ndarray:
    """A limit as `per_joint` gives it, above 0; None: infinite."""
    return per_joint(arm, law, name, value, low=float(np.nextafter(0.0, 1.0)), limit=True)


def check_model(law: str, model: Any) -> None:
    """Refuses what is no model to reckon with.

    Raises:
        ScenarioError: names it.
    """
    if model is not None and not isinstance(model, Model):
        raise ScenarioError(f"{law}: model = {model!r}: expected an arm, as aw.load(name) gives, or none")


def check_whole(law: str, name: str, value: Any, low: int, expected: str) -> None:
    """Refuses what is no whole number of `low` or more.

    Raises:
        ScenarioError: names it and what was expected.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Integral) or value < low:
        raise ScenarioError(f"{law}: {name} = {value!r}: expected {expected}")


def check_time(law: str, name: str, value: Any) -> None:
    """Refuses what is no number above 0.

    Raises:
        ScenarioError: names it.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real) or not 0.0 < float(value) < np.inf:
        raise ScenarioError(f"{law}: {name} = {value!r}: expected a number above 0")

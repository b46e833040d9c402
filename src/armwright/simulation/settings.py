"""Numbers that users set on the loop's parts: one, one a joint or one a lane, refused in one line that shows the wrong one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError, nearest
from armwright.model import Model
from armwright.parameters import Batch, Draw, lane_values

Fits = Callable[[np.ndarray], np.ndarray]


def check_numbers(
    place: str, name: str, value: Any, fits: Fits, expected: str, *, per_joint: bool = False, batch: bool = False
) -> None:
    """Refuses what is not a number that fits, or several of such.

    Args:
        place, name: of the setting, for errors.   value: as it was given.
        fits: (k,) floats → (k,) whether each is one that may be.   expected: what is expected, in words.
        per_joint: whether it may be one number for each joint.   batch: whether it may be a `Batch` or `Draw`.
    Raises:
        ScenarioError: names the place, the first wrong number and what was expected.
    """
    if batch and isinstance(value, Draw):
        return  # checked when it is drawn
    more = ", or one for each joint" * per_joint + ", or a Batch of such" * batch
    laned = batch and isinstance(value, Batch)
    try:
        plain = None if isinstance(value, (Batch, Draw)) else value
        numbers = np.asarray(lane_values(value) if laned else np.asarray(plain)[None])
    except ValueError:  # rows of unequal length
        numbers = np.asarray(None)
    if numbers.dtype.kind not in "iuf" or numbers.ndim > 1 + per_joint:
        raise ScenarioError(f"{place}: {name} = {shown(value)}: expected {expected}{more}")
    wrong = np.argwhere(~np.asarray(fits(numbers.astype(float))))
    if len(wrong):
        first = tuple(wrong[0])
        where = (f" of lane {first[0]}" if laned else "") + (f" of joint {first[1]}" if len(first) > 1 else "")
        raise ScenarioError(f"{place}: {name} = {float(numbers[first]):g}{where}: expected {expected}{more}")


def check_choice(place: str, name: str, value: Any, choices: tuple[str, ...]) -> None:
    """Refuses a word that is none of the choices.

    Raises:
        ScenarioError: names it and the nearest ones.
    """
    if not isinstance(value, str) or value not in choices:
        raise ScenarioError(f"{place}: {name} = {shown(value)}: unknown; {nearest(str(value), choices)}")


def one_each(place: str, name: str, value: Any, arm: Model) -> np.ndarray:
    """(n,) a setting that is one for all joints, or one for each; of a batch, that of the first lane.

    Raises:
        ScenarioError: of another length; names the joints.
    """
    if isinstance(value, Draw):
        return np.ones(arm.n)
    numbers = scalar.array(lane_values(value)[0] if isinstance(value, Batch) else value)
    if numbers.ndim and len(numbers) != arm.n:
        raise ScenarioError(
            f"{place}: {name} = {shown(value)} holds {len(numbers)}; expected one number, or {arm.n}: {', '.join(arm.names)}"
        )
    return np.broadcast_to(numbers, arm.n)


def shown(value: Any) -> str:
    """A value in an error: arrays as the lists that users write."""
    return repr(value.tolist() if isinstance(value, np.ndarray) else value)

"""Numbers that users set on the loop's parts: one, one a joint or one a lane, refused in one line that shows the wrong one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from armwright.errors import ScenarioError, nearest
from armwright.model import Model
from armwright.parameters import Batch

Fits = Callable[[np.ndarray], np.ndarray]


def check_numbers(place: str, name: str, value: Any, fits: Fits, expected: str, *, among: str | None = None) -> None:
    """Refuses what is not a number that fits, or a list of such.

    Args:
        place, name: of the setting, for errors.   value: as it was given.
        fits: (k,) floats → (k,) whether each is one that may be.   expected: what is expected, in words.
        among: what there may be one for each of, "joint" or, in a `Batch`, "lane"; None: a single number alone.
    Raises:
        ScenarioError: names the place, the first wrong number and what was expected.
    """
    more = {None: "", "joint": ", or one for each joint", "lane": ", or a Batch of such"}[among]
    batch = among == "lane" and isinstance(value, Batch)
    try:
        numbers = np.asarray(value.values if batch else value)
    except ValueError:  # rows of unequal length
        numbers = np.asarray(None)
    if numbers.dtype.kind not in "iuf" or numbers.ndim > (batch or among == "joint"):
        raise ScenarioError(f"{place}: {name} = {shown(value)}: expected {expected}{more}")
    right = np.atleast_1d(fits(numbers.astype(float)))
    if not right.all():
        k = int(np.argmin(right))
        where = f" of {among} {k}" if numbers.ndim else ""
        raise ScenarioError(f"{place}: {name} = {float(np.ravel(numbers)[k]):g}{where}: expected {expected}{more}")


def check_choice(place: str, name: str, value: Any, choices: tuple[str, ...]) -> None:
    """Refuses a word that is none of the choices.

    Raises:
        ScenarioError: names it and the nearest ones.
    """
    if not isinstance(value, str) or value not in choices:
        raise ScenarioError(f"{place}: {name} = {shown(value)}: unknown; {nearest(str(value), choices)}")


def one_each(place: str, name: str, value: Any, arm: Model) -> np.ndarray:
    """(n,) a setting that is one for all joints, or one for each.

    Raises:
        ScenarioError: of another length; names the joints.
    """
    numbers = np.asarray(value, dtype=float)
    if numbers.ndim and len(numbers) != arm.n:
        raise ScenarioError(
            f"{place}: {name} = {shown(value)} holds {len(numbers)}; expected one number, or {arm.n}: {', '.join(arm.names)}"
        )
    return np.broadcast_to(numbers, arm.n)


def shown(value: Any) -> str:
    """A value in an error: arrays as the lists that users write."""
    return repr(value.tolist() if isinstance(value, np.ndarray) else value)

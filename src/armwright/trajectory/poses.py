"""Poses and times of a reference, checked."""

from __future__ import annotations

import numbers
from typing import Any

import numpy as np

from armwright.errors import ScenarioError


def pose(reference: str, name: str, value: Any) -> np.ndarray:
    """Positions (n,) [rad | m] of all joints.

    Args:
        reference, name: who asks, for errors.   value: n numbers.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.ndim != 1 or not array.size or not np.isfinite(array).all():
        raise ScenarioError(f"{reference}: {name} = {value!r}: expected finite numbers, one for each joint")
    return array


def check_alike(reference: str, **poses: Any) -> None:
    """Refuses poses of different lengths.

    Raises:
        ScenarioError: names them.
    """
    sizes = {name: len(pose(reference, name, value)) for name, value in poses.items()}
    if len(set(sizes.values())) > 1:
        told = ", ".join(f"{count} of {name}" for name, count in sizes.items())
        raise ScenarioError(f"{reference}: numbers of joints do not fit together: {told}")


def check_number(reference: str, name: str, value: Any, *, above: float = -np.inf) -> None:
    """Refuses what is no finite number above a bound.

    Raises:
        ScenarioError: names the field, its value and what was expected.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real) or not above < float(value) < np.inf:
        what = "a finite number" if above == -np.inf else f"a number above {above:g}"
        raise ScenarioError(f"{reference}: {name} = {value!r}: expected {what}")

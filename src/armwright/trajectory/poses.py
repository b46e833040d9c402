"""Poses and times of a reference, checked."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.parameters import Batch, Draw, numbers_by_lane

LARGEST = 1e100  # of numbers, and of their reciprocals: squares stay within the range of floats


def check_poses(reference: str, **poses: Any) -> None:
    """Refuses what is no pose (n,) [rad | m], or a `Batch` of poses, and poses of different lengths.

    Args:
        reference: who asks, for errors.   poses: values by the name of their field.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    """
    sizes = {}
    for name, value in poses.items():
        if isinstance(value, Draw):
            continue  # checked when it is drawn
        try:
            rows = numbers_by_lane(value)
        except ValueError:
            rows = np.zeros(0)
        if rows.ndim != 2 or not rows.size or not (np.abs(rows) < LARGEST).all():
            expected = "finite numbers, one for each joint"
            raise ScenarioError(place=f"{reference}.{name}", value=value, expected=expected)
        sizes[name] = rows.shape[-1]
    if len(set(sizes.values())) > 1:
        counts = ", ".join(f"{count} of {name}" for name, count in sizes.items())
        raise ScenarioError(f"numbers of joints differ: {counts}", place=reference)


def check_number(reference: str, name: str, value: Any, *, above: float = -np.inf) -> None:
    """Refuses what is no finite number above a bound, nor a `Batch` of such.

    Raises:
        ScenarioError: names the field, its value and what was expected.
    """
    drawn = isinstance(value, Draw)  # checked when it is
    for each in value.values if isinstance(value, Batch) else [] if drawn else [value]:
        number = scalar.real_number(each)
        least = 1.0 / LARGEST if above == 0.0 else above
        if number is None or not least < number < LARGEST:
            expected = "a finite number" if above == -np.inf else f"a number above {above:g}"
            raise ScenarioError(place=f"{reference}.{name}", value=each, expected=expected)


def joint_count(pose: Any) -> int:
    """Number of joints of a pose (n,), or of a `Batch` of poses."""
    return numbers_by_lane(pose).shape[-1]

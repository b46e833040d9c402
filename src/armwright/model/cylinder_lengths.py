"""Checks of cylinders against the arm that they are in: that they are stretched, and the lengths that they really have."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from armwright.errors import Problem
from armwright.model.springs import SpringCylinder
from armwright.model.tree import BASE, Body, Tree
from armwright.spatial import Placement, rotation_z

POSES = 64
STEPS = np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0])  # irrational: multiples of them, modulo 1, fill a range evenly
BEYOND = 0.1  # share by which a stated length may lie outside of what was sampled
MEETING = 0.01  # of the largest length: ends that come nearer to each other nearly meet
NEAREST = 3  # poses from which the nearest one is looked for: between samples ends come nearer than at them
ROUNDING = 1e-9  # of the distances from the base: a length that changes by less does not change


def is_stretched(model: Tree, cylinder: SpringCylinder, held: Mapping[str, float] | None = None) -> bool:
    """True if the joints change a cylinder's length.

    Args:
        model: the arm; its joints are moved beyond their limits too.   cylinder: of it.
        held: positions of joints that are not moved, by name [rad | m].
    """
    held = held or {}
    low, high = np.array([_far(body) for body in model.bodies]).T
    poses = np.random.default_rng(0).uniform(low, high, (8, len(model.bodies)))
    for i, body in enumerate(model.bodies):
        if body.joint in held:
            poses[:, i] = held[body.joint]
    ends = np.array([_ends(model, cylinder, q) for q in poses])
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return bool(np.ptp(lengths) > ROUNDING * np.abs(ends).max())


def implausible_lengths(model: Tree) -> Iterator[Problem]:
    """Cylinders whose stated length the arm never has, and those whose ends meet, where their force has no direction.

    Args:
        model: the arm; its joints are moved over their limits, half a turn or half a metre either way without.
    """
    low, high = np.array([np.clip(body.limits.position, *_far(body)) for body in model.bodies]).reshape(-1, 2).T
    shares = np.outer(np.arange(POSES), np.resize(STEPS, len(model.bodies))) % 1.0
    for cylinder in model.cylinders:
        between = _between(model, cylinder, low, high)
        distances = np.array([np.linalg.norm(between(row)) for row in shares])
        nearest = [_nearest(between, shares[k]) for k in np.argsort(distances, kind="stable")[:NEAREST]]
        least, most, place = min(nearest), distances.max(), f"cylinder {cylinder.name!r}"
        if least < MEETING * most:
            within = "meet" if least < ROUNDING * most else f"come within {least:.2g} m of each other"
            yield Problem(f"its ends {within}, and its force then has no direction", place)
        elif not least * (1.0 - BEYOND) <= cylinder.length <= most * (1.0 + BEYOND):
            what = f"its ends are {least:.4g} to {most:.4g} m apart in all poses: another anchor or length?"
            yield Problem(what, f"{place} length_m", cylinder.length)


def _nearest(between: Callable[[np.ndarray], np.ndarray], shares: np.ndarray) -> float:
    """The least distance of two ends [m] that is found from a pose."""
    from scipy.optimize import least_squares  # few arms have cylinders, and SciPy takes a while to import

    return float(np.linalg.norm(least_squares(between, shares, bounds=(0.0, 1.0)).fun))


def _between(
    model: Tree, cylinder: SpringCylinder, low: np.ndarray, high: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """The vector from a cylinder's one end to the other [m] by the shares of their ranges at which the joints stand."""

    def between(shares: np.ndarray) -> np.ndarray:
        one, other = _ends(model, cylinder, low + shares * (high - low))
        return other - one

    return between


def _far(body: Body) -> tuple[float, float]:
    """Half a turn or half a metre either way [rad | m]."""
    half = body.kind.units.half_range
    return -half, half


def _ends(model: Tree, cylinder: SpringCylinder, q: np.ndarray) -> list[np.ndarray]:
    """A cylinder's two ends (3,) [m] in base axes, body i's joint at q[i]."""
    points = []
    for at, point in zip(cylinder.bodies, cylinder.ends, strict=True):
        while at != BASE:
            body = model.bodies[at]
            turn, slide = body.kind.motion(q[at])
            moved = Placement(rotation_z(turn + body.offset), np.array([0.0, 0.0, slide]))
            point, at = (body.placement @ moved).point(point), body.parent
        points.append(point)
    return points

"""Check of cylinders against the arm that they are in: lengths that they really have."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armwright.errors import Problem
from armwright.model.springs import Cylinder
from armwright.model.tree import BASE, Tree
from armwright.spatial import Placement, rotation_z

POSES = 64
STEPS = np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0])  # irrational: multiples of them, modulo 1, fill a range evenly
BEYOND = 0.1  # share by which a stated length may lie outside of what was sampled
MEETING = 0.01  # of the largest length: ends that come nearer to each other meet somewhere between the samples


def implausible_lengths(model: Tree) -> Iterator[Problem]:
    """Cylinders whose stated length the arm never has, and those whose ends meet, where their force has no direction.

    Args:
        model: the arm; its joints are moved over their limits, half a turn or half a metre either way without.
    """
    for cylinder in model.cylinders:
        distances = [_distance(model, cylinder, share) for share in (np.outer(np.arange(POSES), STEPS) % 1.0)]
        least, most, place = min(distances), max(distances), f"cylinder {cylinder.name!r}"
        if least < MEETING * most:
            yield Problem(
                f"its ends come within {least:.2g} m of each other, and its force then has no direction", place
            )
        elif not least * (1.0 - BEYOND) <= cylinder.length <= most * (1.0 + BEYOND):
            what = f"its ends are {least:.4g} to {most:.4g} m apart in all poses: another anchor or length?"
            yield Problem(what, f"{place} length_m", cylinder.length)


def _distance(model: Tree, cylinder: Cylinder, shares: np.ndarray) -> float:
    """Distance of a cylinder's ends [m] with every joint at a share of its range; joint k takes number k of the shares."""
    points = []
    for at, point in zip(cylinder.bodies, cylinder.ends, strict=True):
        while at != BASE:
            body = model.bodies[at]
            low, high = np.clip(body.limits.position, *((-np.pi, np.pi) if body.kind == "revolute" else (-0.5, 0.5)))
            q = low + shares[at % len(shares)] * (high - low)
            turns = body.kind == "revolute"
            moved = Placement(rotation_z(q + body.offset if turns else 0.0), np.array([0.0, 0.0, 0.0 if turns else q]))
            point, at = (body.placement @ moved).point(point), body.parent
        points.append(point)
    return float(np.linalg.norm(points[1] - points[0]))

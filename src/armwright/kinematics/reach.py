"""Bound on the distance of the tip from the base."""

from __future__ import annotations

from armwright import scalar
from armwright.model import Model
from armwright.scalar import Array, Scalar

ANGLE_SHARE = 1.0 / 3.0  # of the reach: what a turn by 1 rad counts as


def reach(arm: Model, frame: str | None = None) -> Scalar:
    """An upper bound of a frame's distance from the base's origin: the sum of the lengths between the joints' axes.

    Base to the first joint's origin, from there to the next one, …, last joint to the frame, as if the arm could be pulled
    straight; a sliding joint counts with the longer of its ends. No pose is further out, and most arms come close.

    Args:
        arm: the model.   frame: name; by default the tip.
    Returns:
        length: [m]; infinite where a sliding joint has no limits.
    Raises:
        ModelError: no such frame, or an arm that branches and names no tip.
    """
    tip = arm.frame(frame)
    total = 0.0
    for i in arm.path(tip.body):
        body = arm.bodies[i]
        if not body.kind.slides:
            total = total + _length(body.placement.position)
            continue
        low, high = body.limits.position
        if not -float("inf") < low <= high < float("inf"):
            return float("inf")
        slide = body.placement.rotation[:, 2]
        ends = [_length(body.placement.position + slide * body.kind.motion(q)[1]) for q in (low, high)]
        total = total + scalar.maximum(*ends)
    return total + _length(tip.placement.position)


def turn_length(arm: Model, frame: str | None = None) -> float:
    """Length that a turn of a frame by 1 rad counts as [m]: a third of the reach, 1 m where that is 0 or infinite."""
    length = float(reach(arm, frame))
    return ANGLE_SHARE * length if 0.0 < length < float("inf") else 1.0


def _length(v: Array) -> Scalar:
    return scalar.sqrt(v @ v)

"""Distances between segments, points, boxes and planes without branches, for floats and traced symbols.  [Ericson2004]"""

from __future__ import annotations

from armwright import scalar
from armwright.scalar import Array, Scalar

TINY = 1e-30  # [m²] added to squared lengths that are divided by: a segment may be a point


def point_to_segment(p: Array, a: Array, b: Array) -> Scalar:
    """Squared distance [m²] of a point p (3,) from the segment between a (3,) and b (3,) [m]."""
    along, from_a = b - a, p - a
    t = scalar.clip((from_a @ along) / (along @ along + TINY), 0.0, 1.0)
    gap = from_a - t * along
    return gap @ gap


def segment_to_segment(a: Array, b: Array, c: Array, d: Array) -> Scalar:
    """Distance [m] between the segments a to b and c to d, each end (3,) [m].

    The squared distance is a convex quadratic function of the places s and t on the two: its least value over 0 ≤ s, t ≤ 1 is
    either on an edge, where one place is an end, or where both slopes vanish. The value at that place, brought within the
    bounds, is never below the least one, so that the smallest of the five is right for parallel segments and for points too.
    """
    u, v, r = b - a, d - c, a - c
    uu, uv, vv, ur, vr = u @ u, u @ v, v @ v, u @ r, v @ r
    s = scalar.clip((uv * vr - vv * ur) / (uu * vv - uv * uv + TINY), 0.0, 1.0)
    t = scalar.clip((uv * s + vr) / (vv + TINY), 0.0, 1.0)
    gap = r + s * u - t * v
    least = gap @ gap
    for p, q, e in ((a, c, d), (b, c, d), (c, a, b), (d, a, b)):
        least = scalar.minimum(least, point_to_segment(p, q, e))
    return scalar.sqrt(least)


def segment_to_box(a: Array, b: Array, half: Array) -> Scalar:
    """Distance [m] of the segment a to b from a box about the origin with sides 2 half (3,); 0 where they meet.

    The squared distance of the point a + t (b - a) is convex in t, and its slope is piecewise linear and rises: it changes
    where a coordinate passes a side. The last of these places with a slope ≤ 0 and the first with one ≥ 0 enclose the root.
    """
    along = b - a

    def outside(t: Scalar) -> Array:
        """(3,) how far the point lies beyond the box's sides, with its sign."""
        return scalar.array([p - scalar.clip(p, -h, h) for p, h in zip(a + t * along, half, strict=True)])

    low, high = 0.0, 1.0
    for p, v, h in zip(a, along, half, strict=True):
        safe = scalar.where(scalar.less(scalar.abs(v), 1e-15), 1.0, v)
        for side in (-h, h):
            t = scalar.clip((side - p) / safe, 0.0, 1.0)
            falls = scalar.less(outside(t) @ along, 0.0)
            low = scalar.where(falls, scalar.maximum(low, t), low)
            high = scalar.where(falls, high, scalar.minimum(high, t))
    at_low, at_high = outside(low) @ along, outside(high) @ along
    rise = at_high - at_low
    part = scalar.where(scalar.less(0.0, rise), -at_low / scalar.maximum(rise, TINY), 0.0)
    gap = outside(low + scalar.clip(part, 0.0, 1.0) * (high - low))
    return scalar.sqrt(gap @ gap)


def segment_to_plane(a: Array, b: Array, point: Array, normal: Array) -> Scalar:
    """Height [m] of the lower end of the segment a to b over a plane; negative behind it."""
    return scalar.minimum((a - point) @ normal, (b - point) @ normal)

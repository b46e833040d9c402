"""Pieces of a tool's path: straight lines, arcs, turns in place and blends, as functions of the distance s.

Every piece gives the pose at s and its first and second derivative: position p, p', p'', rotation R, and the angular velocity
per length w (ω = w ṡ) with its derivative w', in base axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, PPoly

from armwright.trajectory.cartesian.rotations import body_rates, turned

INTERVALS, POINTS = 16, 10  # of a blend's length: Gauss-Legendre in so many parts
NEWTON = 6  # iterations for the parameter at a length
SAMPLES = 129  # of a blend, for its nearest point to the corner


@dataclass(frozen=True, eq=False)
class PathPoints:
    """Poses of the tool at k places and their derivatives by s, in base axes.

    Attributes:
        pose: (k, 4, 4).   first, second: (k, 6) [v; ω] and their derivative, by s instead of time.
    """

    pose: np.ndarray
    first: np.ndarray
    second: np.ndarray

    @classmethod
    def of(cls, p: Any, dp: Any, ddp: Any, rotation: Any, w: Any, dw: Any) -> PathPoints:
        """From positions, rotations and their derivatives."""
        pose = np.zeros((len(p), 4, 4))
        pose[:, :3, :3], pose[:, :3, 3], pose[:, 3, 3] = rotation, p, 1.0
        return cls(pose, np.concatenate([dp, w], axis=1), np.concatenate([ddp, dw], axis=1))


@dataclass(frozen=True, eq=False)
class PathStretch:
    """A straight line, an arc or a turn in place, with the tool turning about one axis at a constant rate.

    p = position + direction s, or with a centre that point turned about `normal` by s / radius;  R = rotation exp([ρ s]).

    Attributes:
        position, rotation: at s = 0.   length: [m]; of a turn in place [rad], as 1 m for each rad.
        direction: (3,) at s = 0, of length 1; 0 for a turn in place.   rate: ρ (3,) [rad/m] in the tool's axes.
        centre, normal: of an arc.
    """

    position: np.ndarray
    rotation: np.ndarray
    length: float
    direction: np.ndarray
    rate: np.ndarray
    centre: np.ndarray | None = None
    normal: np.ndarray | None = None

    @property
    def in_place(self) -> bool:
        """True for a turn in place."""
        return not self.direction.any()

    @property
    def radius(self) -> float:
        """[m] of an arc, infinite of a line."""
        return np.inf if self.centre is None else float(np.linalg.norm(self.position - self.centre))

    def at(self, s: np.ndarray) -> PathPoints:
        """Poses and derivatives at s (k,)."""
        s = np.asarray(s, dtype=float)[:, None]
        rotation = turned(self.rotation, s * self.rate)
        w = np.broadcast_to(self.rotation @ self.rate, (len(s), 3))
        if self.centre is None:
            p, dp = self.position + s * self.direction, np.broadcast_to(self.direction, (len(s), 3))
            return PathPoints.of(p, dp, 0.0 * dp, rotation, w, 0.0 * w)
        arm, radius = self.position - self.centre, self.radius
        c, sn = np.cos(s / radius), np.sin(s / radius)
        p = self.centre + c * arm + sn * radius * self.direction
        dp = c * self.direction - sn * arm / radius
        return PathPoints.of(p, dp, -(p - self.centre) / radius**2, rotation, w, 0.0 * w)

    def part(self, begin: float, end: float) -> PathStretch:
        """The piece between two lengths."""
        at = self.at(np.array([begin]))
        rotation = at.pose[0, :3, :3]
        direction = at.first[0, :3]
        return PathStretch(at.pose[0, :3, 3], rotation, end - begin, direction, self.rate, self.centre, self.normal)


@dataclass(frozen=True, eq=False)
class Blend:
    """A rounded corner: polynomials of fifth degree for the position and for the rotation vector from the corner.

    They meet both pieces with position, direction and curvature, the rotation with its rate and its change: the path is C² in
    its length. On either side the rotation vector is a straight line through 0, so that it is rounded as the position is.

    Attributes:
        position, turn: of the parameter u, 0 … `end`, (3,) each.   corner: rotation (3, 3) in the corner.
    """

    position: PPoly
    turn: PPoly
    corner: np.ndarray

    @cached_property
    def _lengths(self) -> tuple[np.ndarray, np.ndarray]:
        """Parameters and lengths at the ends of the intervals."""
        u = np.linspace(0.0, self.position.x[-1], INTERVALS + 1)
        return u, np.concatenate([[0.0], np.cumsum(self._way(u[:-1], u[1:]))])

    def _way(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Lengths between parameters."""
        x, weight = np.polynomial.legendre.leggauss(POINTS)
        half = 0.5 * (end - begin)
        u = begin[:, None] + half[:, None] * (x + 1.0)
        return half * (np.linalg.norm(self.position(u, 1), axis=-1) @ weight)

    @property
    def length(self) -> float:
        """[m]."""
        return float(self._lengths[1][-1])

    @property
    def in_place(self) -> bool:
        """False: the tool moves."""
        return False

    def parameter(self, s: np.ndarray) -> np.ndarray:
        """u (k,) at lengths s (k,)."""
        nodes, lengths = self._lengths
        k = np.clip(np.searchsorted(lengths, s, side="right") - 1, 0, INTERVALS - 1)
        u = np.interp(s, lengths, nodes)
        for _ in range(NEWTON):
            u = u - (lengths[k] + self._way(nodes[k], u) - s) / np.linalg.norm(self.position(u, 1), axis=-1)
        return np.clip(u, 0.0, nodes[-1])

    def at(self, s: np.ndarray) -> PathPoints:
        """Poses and derivatives at s (k,); d/ds = (1 / |p_u|) d/du."""
        u = self.parameter(np.asarray(s, dtype=float))
        p, pu, puu = (self.position(u, k) for k in range(3))
        phi, phiu, phiuu = (self.turn(u, k) for k in range(3))
        speed = np.linalg.norm(pu, axis=1, keepdims=True)
        bend = -(pu * puu).sum(axis=1, keepdims=True) / speed**4  # d²u/ds²
        rotation = turned(self.corner, phi)
        w, dw = body_rates(phi, phiu / speed, phiuu / speed**2 + phiu * bend)
        w, dw = ((rotation @ each[:, :, None])[:, :, 0] for each in (w, dw))
        return PathPoints.of(p, pu / speed, puu / speed**2 + pu * bend, rotation, w, dw)

    def deviation(self, corner: np.ndarray) -> tuple[float, float]:
        """Distance [m] and angle [rad] of the blend from the corner, its largest from the sharp path."""
        u = np.linspace(0.0, self.position.x[-1], SAMPLES)
        distance = np.linalg.norm(self.position(u) - corner, axis=1).min()
        return float(distance), float(np.linalg.norm(self.turn(u), axis=1).min())


def blend(before: PathStretch, after: PathStretch, cut: float) -> Blend:
    """The blend that replaces the last `cut` of one piece and the first `cut` of the next [m]."""
    ends = before.at(np.array([before.length - cut])), after.at(np.array([cut]))
    corner = after.rotation
    span = np.array([0.0, 2.0 * cut])
    position = [[e.pose[0, :3, 3], e.first[0, :3], e.second[0, :3]] for e in ends]
    turn = [[-cut * before.rate, before.rate, 0.0 * before.rate], [cut * after.rate, after.rate, 0.0 * after.rate]]
    way, phi = (PPoly.from_bernstein_basis(BPoly.from_derivatives(span, rows)) for rows in (position, turn))
    return Blend(way, phi, corner)

"""Joint positions along a tool's path, step by step from one solution, and as a spline within a tolerance.

On a smooth part of the path  J q' = V,  J q'' = V' - J' q',  with the rows of `turning` where a part of the orientation counts,
so that positions and both derivatives are known at every node.
A quintic Hermite spline through them is C² and misses the path by the sixth power of the distance of its nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, PPoly

from armwright.trajectory.cartesian.path import CartesianPath
from armwright.trajectory.cartesian.tool import Tool

FIRST = 8  # intervals of a piece at first
NEWTON, CONVERGED = 12, 1e-11  # iterations; [m] and [rad] of an error that is none
STEP, CURVED = 0.3, 0.02  # [rad | m] of a joint in a step, and of what its prediction is off; longer steps are halved
SHORTEST = 1e-7  # of the path: steps below that do not get on
SINGULAR = 1e-7  # least singular value as a share of the largest, below which a twist may ask for infinite speeds
IMPOSSIBLE = 1e-6  # of a twist: what joint rates leave of it
INSIDE = np.array([0.1, 0.25, 0.4, 0.5, 0.6, 0.75, 0.9])  # of an interval: where the spline is compared with the path
DENSER = np.linspace(0.0, 1.0, 25)[1:-1]  # where it is compared once more in the end
MOST_NODES = 200_000
SHIFT = 1e-5  # of the path: of central differences along the self-motion
EAGER = 5.0  # e-foldings along the path of the way to a posture


@dataclass(frozen=True, eq=False)
class Stuck(Exception):
    """Point at which a path cannot be continued: place, positions, and the joint rates by s that it would need."""

    s: float
    q: np.ndarray
    rates: np.ndarray


@dataclass(frozen=True, eq=False)
class Follower:
    """A tool on a path.

    Attributes:
        tool, path: which.   posture: (n,) that self-motion goes to; None: it is as small as possible.
    """

    tool: Tool
    path: CartesianPath
    posture: np.ndarray | None = None

    def _rates(self, q: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """q' (k, n), J⁺, least singular value, and the share of the twist that q' leaves (k,)."""
        points = self.path.points(s)
        twist = self.tool.asked(q, points)
        inverse, jacobian, least = self.tool.inverse(q, points.pose)
        rates = (inverse @ twist[:, :, None])[:, :, 0]
        left = twist - (jacobian @ rates[:, :, None])[:, :, 0]
        if self.posture is not None:
            wish = EAGER / self.path.length * (self.posture - q)
            rates = rates + wish - (inverse @ (jacobian @ wish[:, :, None]))[:, :, 0]
        whole = points.first if self.tool.partial else twist  # of a turn about a free axis the twist is rounding
        share = np.linalg.norm(left, axis=1) / np.maximum(np.linalg.norm(whole, axis=1), np.finfo(float).tiny)
        return rates, inverse, least, share

    def derivatives(self, q: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q' and q'' (k, n) at positions on the path, and True (k,) for points that the joints cannot follow.

        q'' is exact; of a redundant arm its part in the null space of J, which moves no tool, comes from differences along
        the way.
        """
        rates, inverse, least, left = self._rates(q, s)
        jammed = (left > IMPOSSIBLE) | (
            (least < SINGULAR) & (np.abs(rates).max(axis=1) * SINGULAR > 1.0 / self.tool.radian)
        )
        points = self.path.points(s)
        change = self.tool.change(q, rates, points)
        second = (inverse @ change[:, :, None])[:, :, 0]
        if self.tool.redundant:
            h = SHIFT * self.path.length
            begin, end = np.clip(s - h, 0.0, None), np.clip(s + h, None, self.path.length)
            ahead, back = (end - s)[:, None], (begin - s)[:, None]
            slope = self._rates(q + ahead * rates, end)[0] - self._rates(q + back * rates, begin)[0]
            slope = slope / (ahead - back)
            jacobian = self.tool.inverse(q, points.pose)[1]
            second = second + slope - (inverse @ (jacobian @ slope[:, :, None]))[:, :, 0]
        return rates, second, jammed

    def corrected(self, q: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (k, n) on the path near q by Newton's method with the least change, and True (k,) where it converged."""
        poses = self.path.points(s).pose
        for _ in range(NEWTON):
            error = self.tool.difference(q, poses)
            if np.abs(error).max() < CONVERGED:
                break
            step = (self.tool.inverse(q, poses)[0] @ error[:, :, None])[:, :, 0]
            q = q + np.clip(step, -STEP, STEP)
        return q, np.abs(self.tool.difference(q, poses)).max(axis=1) < 10.0 * CONVERGED

    def run(self, q: np.ndarray, begin: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Nodes s (k,) and positions (k, n) from one stop to the next, from positions q (n,) at its beginning.

        Raises:
            Stuck: where the joints cannot follow.
        """
        breaks = self.path.breaks
        inner = breaks[(breaks > begin) & (breaks < end)]
        corners = np.concatenate([[begin], inner, [end]])
        grid = np.unique(np.linspace(corners[:-1], corners[1:], FIRST + 1))
        nodes, rows, most = [begin], [q], end - begin
        for s in grid[1:]:
            while nodes[-1] < s:
                there, position = self._step(nodes[-1], rows[-1], s, most)
                most = 4.0 * (there - nodes[-1])  # the next step may be longer again
                nodes.append(there)
                rows.append(position)
        return np.array(nodes), np.array(rows)

    def _step(self, s: float, q: np.ndarray, goal: float, most: float) -> tuple[float, np.ndarray]:
        """The longest step towards a goal, at most so long, that follows the same solution.

        Raises:
            Stuck: no step does.
        """
        at = np.nextafter([s], np.inf)  # at a stop, where derivatives jump, the piece behind it counts
        rates, second, jammed = (each[0] for each in self.derivatives(q[None], at))
        h = min(goal - s, most)
        while not jammed and h > SHORTEST * self.path.length:
            guess = q + h * rates + 0.5 * h * h * second
            found, converged = self.corrected(guess[None], np.array([s + h]))
            near = np.abs(found[0] - q).max() < STEP and np.abs(found[0] - guess).max() < CURVED
            if converged[0] and near:
                return (goal if h == goal - s else s + h), found[0]
            h = 0.5 * h
        raise Stuck(s, q, rates)

    def spline(
        self, s: np.ndarray, q: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, np.ndarray, PPoly, tuple[float, float]]:
        """Nodes, positions and the spline through them that keeps a tolerance, with its largest deviations [m] and [rad].

        Args:
            s, q: nodes (k,) and positions (k, n) of one run.   tolerance: [m] and [rad].
        Raises:
            Stuck: at a node the joints cannot follow, or no distance of nodes is small enough.
        """
        inside, margin = INSIDE, 0.5
        while True:
            curve = self._hermite(s, q)
            widths = np.diff(s)
            places = (s[:-1, None] + widths[:, None] * inside).ravel()
            off, angle = self.tool.errors(curve(places), self.path.points(places).pose)
            worst = np.maximum(off, angle).reshape(len(widths), -1).max(axis=1)
            coarse = worst > margin * tolerance
            if not coarse.any():
                if inside is DENSER:
                    return s, q, curve, (float(off.max()), float(angle.max()))
                inside, margin = DENSER, 1.0
                continue
            middles = 0.5 * (s[:-1] + s[1:])[coarse]
            found, converged = self.corrected(curve(middles), middles)
            k = int(np.argmax(widths[coarse] < SHORTEST * self.path.length))
            if not converged.all() or widths[coarse][k] < SHORTEST * self.path.length or len(s) > MOST_NODES:
                k = int(np.argmin(converged)) if not converged.all() else k
                raise Stuck(float(middles[k]), found[k], curve(middles[k], 1))
            order = np.argsort(np.concatenate([s, middles]), kind="stable")
            s, q = np.concatenate([s, middles])[order], np.concatenate([q, found])[order]

    def _hermite(self, s: np.ndarray, q: np.ndarray) -> PPoly:
        """The C² spline of fifth degree with the path's derivatives at its nodes.

        Raises:
            Stuck: at a node the joints cannot follow.
        """
        places = s.copy()
        places[0] = np.nextafter(s[0], np.inf)
        first, second, jammed = self.derivatives(q, places)
        if jammed.any():
            k = int(np.argmax(jammed))
            raise Stuck(float(s[k]), q[k], first[k])
        values: Any = np.stack([q, first, second], axis=1)
        return PPoly.from_bernstein_basis(BPoly.from_derivatives(s, values))

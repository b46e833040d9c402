"""Subproblems 1 to 4 of inverse kinematics, each about the z axis of a joint's own frame. [EliasWen2025], [Paden1986]

In its own frame a turn moves x and y only. So a point that is close to the axis keeps its digits, and an arm with right
angles costs few operations. Angles stay cosine and sine until they are known, no acos loses half of their digits. Lengths
are in units of about the arm's reach. Where a subproblem has no solution, the nearest one in the sense of least squares
comes back: whoever uses it checks the pose.
"""

from __future__ import annotations

from dataclasses import dataclass

from armwright import scalar
from armwright.scalar import Array, Scalar

ON_AXIS = 1e-13  # distance from an axis below which a point does not tell the turn about it
_TINY = ON_AXIS**4  # of a squared product of two such distances


@dataclass(frozen=True)
class Turn:
    """A turn about z by an angle that is known by its cosine and sine."""

    cos: Scalar
    sin: Scalar

    @classmethod
    def by(cls, angle: Scalar) -> Turn:
        """The turn by an angle [rad]."""
        return cls(scalar.cos(angle), scalar.sin(angle))

    @property
    def angle(self) -> Scalar:
        """Angle [rad] from -π to π."""
        return scalar.atan2(self.sin, self.cos)

    @property
    def inverse(self) -> Turn:
        """The turn back."""
        return Turn(self.cos, -self.sin)

    def of(self, v: Array) -> Array:
        """A vector (3,) turned."""
        return scalar.array([self.cos * v[0] - self.sin * v[1], self.sin * v[0] + self.cos * v[1], v[2]])


def turn_along(x: Scalar, y: Scalar, instead: Turn) -> Turn:
    """The turn whose cosine and sine are as x to y; `instead` where both are 0."""
    square = x * x + y * y
    known = scalar.less(_TINY, square)
    inverse = 1.0 / scalar.sqrt(scalar.where(known, square, 1.0))
    return Turn(scalar.where(known, x * inverse, instead.cos), scalar.where(known, y * inverse, instead.sin))


def turn_onto(u: Array, v: Array, instead: Turn) -> Turn:
    """Subproblem 1, the turn with  Rz(θ) u = v  in x and y.

    Args:
        u, v: (2,) or more, equally far from the axis; else the turn brings u nearest to v.
        instead: the turn where both are on the axis and every turn does.
    """
    return turn_along(u[0] * v[0] + u[1] * v[1], u[0] * v[1] - u[1] * v[0], instead)


def turns_to_level(u: Array, a: Array, level: Scalar, square: Scalar, instead: Turn) -> tuple[Turn, Turn]:
    """Subproblem 4, the two turns with  a · Rz(θ) u = level  in x and y.

    With ψ the angle between a and the turned u,  |a| |u| cos ψ = level  and  |a| |u| sin ψ = ±√square.

    Args:
        u, a: (2,) or more.   level: of u along a, times |a|.
        square: |a|² |u|² - level², in whichever form keeps its digits; below 0 there is no solution.
        instead: the turn where u or a is 0.
    """
    dot, cross = u[0] * a[0] + u[1] * a[1], u[0] * a[1] - u[1] * a[0]
    side = scalar.sqrt(scalar.maximum(square, 0.0))
    x, y, dx, dy = dot * level, cross * level, cross * side, dot * side
    return turn_along(x + dx, y - dy, instead), turn_along(x - dx, y + dy, instead)


def turns_to_distance(u: Array, b: Array, square: Scalar, instead: Turn) -> tuple[Turn, Turn]:
    """Subproblem 3, the two turns with  |b + Rz(θ) u|² = square  in x and y: the law of cosines.

    Factors, each of which is 0 to all digits where the arm is stretched or folded:
    (2 |b| |u| sin ψ)² = (d² - (|b| - |u|)²) ((|b| + |u|)² - d²).
    """
    uu, bb = u[0] * u[0] + u[1] * u[1], b[0] * b[0] + b[1] * b[1]
    both, twice = uu + bb, 2.0 * scalar.sqrt(uu * bb)
    sine = 0.25 * ((square - (both - twice)) * ((both + twice) - square))
    return turns_to_level(u, b, 0.5 * (square - both), sine, instead)


def two_turns(u: Array, between: Array, v: Array, outer: Turn, inner: Turn) -> list[tuple[Turn, Turn]]:
    """Subproblem 2, the two pairs of turns with  Rz(θ₁) R Rz(θ₂) u = v.

    Its z component is subproblem 4 in θ₂, the rest subproblem 1 in θ₁. With e = R_zz and |u| = |v| the square
    there is  (1 - e²) u⊥² - (v_z - e u_z)² = (1 - e²) v⊥² - (u_z - e v_z)²,  and the vector that is nearer to its axis
    gives the form that keeps its digits.

    Args:
        u, v: (3,) of equal length.   between: (3, 3) R.
        outer, inner: θ₁ where v is on its axis, θ₂ where u is on its own.
    """
    row, e = between[2], between[2, 2]
    uu, vv, rest = u[0] * u[0] + u[1] * u[1], v[0] * v[0] + v[1] * v[1], 1.0 - e * e
    along_v, along_u = v[2] - e * u[2], u[2] - e * v[2]
    by_u, by_v = rest * uu - along_v * along_v, rest * vv - along_u * along_u
    square = scalar.where(scalar.less(uu, vv), by_u, by_v)
    seconds = turns_to_level(u, row, along_v, square, inner)
    return [(turn_onto(between @ second.of(u), v, outer), second) for second in seconds]

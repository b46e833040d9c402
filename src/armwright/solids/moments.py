"""Volume or mass in space: how much, where, and how it is spread, in one 4 × 4 matrix that adds up and moves. [Wensing2018]

    P = ∫ p pᵀ dV,  p = [x, y, z, 1]ᵀ:   P = [[Σ, h], [hᵀ, m]]

A body in pieces is the sum of their P; a body moved by the homogeneous transform T has  T P Tᵀ: parallel axes and rotated
tensors are both in it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from armwright.spatial import Frozen, Placement


@dataclass(frozen=True, eq=False)
class Moments(Frozen):
    """Moments of a body up to the second, about the origin of its frame.

    Args:
        matrix: (4, 4) [[Σ, h], [hᵀ, m]] with m [m³ | kg], h = ∫ r [m⁴ | kg m], Σ = ∫ r rᵀ [m⁵ | kg m²].
    """

    matrix: np.ndarray

    @classmethod
    def of(cls, amount: float, centre: Iterable[float], sigma: Iterable[Iterable[float]] | np.ndarray) -> Moments:
        """From the amount m, its centre c and ∫ (r - c)(r - c)ᵀ: what closed forms give."""
        c, spread = np.asarray(centre, dtype=float), np.asarray(sigma, dtype=float)
        first = (amount * c).reshape(3, 1)
        return cls(np.block([[spread + amount * np.outer(c, c), first], [first.T, np.array([[amount]])]]))

    @classmethod
    def of_tensor(cls, mass: float, com: np.ndarray, inertia_com: np.ndarray) -> Moments:
        """From mass [kg], centre of mass (3,) [m] and tensor of inertia about it (3, 3) [kg m²]."""
        return cls.of(mass, com, 0.5 * np.trace(inertia_com) * np.eye(3) - inertia_com)

    @classmethod
    def nothing(cls) -> Moments:
        """Of no body."""
        return cls(np.zeros((4, 4)))

    @property
    def amount(self) -> float:
        """Volume [m³] or mass [kg]."""
        return float(self.matrix[3, 3])

    @property
    def centre(self) -> np.ndarray:
        """(3,) centroid or centre of mass [m]; the origin, where there is nothing."""
        return self.matrix[:3, 3] / self.amount if self.amount else np.zeros(3)

    @property
    def tensor(self) -> np.ndarray:
        """(3, 3) tensor of inertia about the centre [m⁵ | kg m²]: tr(Σ) 1 - Σ, with Σ about the centre."""
        return self.tensor_about(self.centre)

    def tensor_about(self, point: np.ndarray) -> np.ndarray:
        """(3, 3) tensor of inertia about a point (3,) [m] of the frame, in its axes."""
        mean = np.outer(self.matrix[:3, 3], point)
        sigma = self.matrix[:3, :3] - mean - mean.T + self.amount * np.outer(point, point)
        tensor = np.trace(sigma) * np.eye(3) - sigma
        return 0.5 * (tensor + tensor.T)

    def __add__(self, other: Moments) -> Moments:
        return Moments(self.matrix + other.matrix)

    def __mul__(self, density: float) -> Moments:
        """The mass of a volume; -1 turns a body into a hole."""
        return Moments(density * self.matrix)

    __rmul__ = __mul__

    def placed(self, placement: Placement) -> Moments:
        """The body in another frame, in which its own frame has this placement."""
        t = placement.matrix()
        moved = t @ self.matrix @ t.T
        return Moments(0.5 * (moved + moved.T))


def total(bodies: Iterable[Moments]) -> Moments:
    """The sum of bodies."""
    return sum(bodies, start=Moments.nothing())

"""Mass in motion: tensors of inertia, and the force and moment that a moving body asks for. [Symon1971] [BalafoutisPatel1991]

The acceleration of a body's points is one linear map: a point at r from the frame's origin accelerates by  v̇ + U r,
with U = ω̇× + ω× ω×. Equations (4), (5) and (7) of the CMU report are three uses of it.
"""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.scalar import Array, Scalar
from armwright.spatial.rotation import skew

# Entries of a symmetric tensor by name, in the order of records and of the regressor.
TENSOR = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}


def acceleration_tensor(w: Array, wd: Array) -> np.ndarray:
    """U = ω̇× + ω×ω×  (3, 3) [1/s²], from angular velocity [rad/s] and acceleration [rad/s²] in the same frame."""
    xx, yy, zz = w[0] * w[0], w[1] * w[1], w[2] * w[2]
    xy, xz, yz = w[0] * w[1], w[0] * w[2], w[1] * w[2]
    return scalar.array(
        [
            [-(yy + zz), xy - wd[2], xz + wd[1]],
            [xy + wd[2], -(xx + zz), yz - wd[0]],
            [xz - wd[1], yz + wd[0], -(xx + yy)],
        ]
    )


def second_moment(inertia: Array) -> np.ndarray:
    """Σ = ∫ r rᵀ dm = ½ tr(J) 1 - J  (3, 3) [kg m²], of a tensor of inertia J about the same point."""
    return 0.5 * (inertia[0, 0] + inertia[1, 1] + inertia[2, 2]) * np.eye(3) - inertia


def inertial_moment(inertia: Array, u: Array) -> np.ndarray:
    """N = J ω̇ + ω × J ω  [N m], eq. (7), about the point that the tensor of inertia J is about.

    With U = ω̇× + ω×ω× it is  N = vee(U Σ - Σ Uᵀ),  Σ = ½ tr(J) 1 - J: 15 multiplications, 6 where J is diagonal.
    """
    s = second_moment(inertia)
    return scalar.array(
        [
            u[2, 1] * s[1, 1]
            - u[1, 2] * s[2, 2]
            + s[1, 2] * (u[2, 2] - u[1, 1])
            + u[2, 0] * s[0, 1]
            - u[1, 0] * s[0, 2],
            u[0, 2] * s[2, 2]
            - u[2, 0] * s[0, 0]
            + s[0, 2] * (u[0, 0] - u[2, 2])
            + u[0, 1] * s[1, 2]
            - u[2, 1] * s[0, 1],
            u[1, 0] * s[0, 0]
            - u[0, 1] * s[1, 1]
            + s[0, 1] * (u[1, 1] - u[0, 0])
            + u[1, 2] * s[0, 2]
            - u[0, 2] * s[1, 2],
        ]
    )


def parallel_axes(mass: Scalar, offset: Array) -> np.ndarray:
    """m ( |c|² 1 - c cᵀ )  (3, 3) [kg m²]: what a tensor about the centre of mass gains at distance c from it."""
    c = skew(offset)
    return mass * (c.T @ c)


def inertia_about_origin(mass: Scalar, com: Array, inertia_com: Array) -> np.ndarray:
    """Tensor about the frame's origin (3, 3), from the one about the centre of mass at `com`: Steiner's theorem."""
    return inertia_com + parallel_axes(mass, com)


def pseudo_inertia(mass: Scalar, com: Array, inertia_com: Array) -> np.ndarray:
    """[[Σ, m c], [m cᵀ, m]]  (4, 4), Σ about the frame's origin: positive semidefinite for every real body. [Wensing2018]"""
    first = mass * np.asarray(com)
    sigma = second_moment(inertia_about_origin(mass, com, inertia_com))
    return scalar.array(np.block([[sigma, first.reshape(3, 1)], [first.reshape(1, 3), np.reshape(mass, (1, 1))]]))


def displaced_inertia(m: Scalar, h: Array, p: Array) -> np.ndarray:
    """Change of a tensor about the origin when the body is displaced by p:  (2 h·p + m p·p) 1 - h pᵀ - p hᵀ - m p pᵀ.

    With k = h + ½ m p it is  2 (k·p) 1 - k pᵀ - p kᵀ.

    Args:
        m: () [kg].   h: (3,) [kg m] first moment before the displacement.   p: (3,) [m].
    Returns:
        gain: (3, 3) [kg m²].
    """
    k = h + (0.5 * m) * p
    xx, yy, zz = ((k[i] + k[i]) * p[i] for i in range(3))
    xy, xz, yz = (-(k[i] * p[j] + k[j] * p[i]) for i, j in ((0, 1), (0, 2), (1, 2)))
    return scalar.array([[yy + zz, xy, xz], [xy, xx + zz, yz], [xz, yz, xx + yy]])

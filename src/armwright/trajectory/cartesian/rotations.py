"""Rotations by rotation vectors, many at once: R = exp([φ]), and the angular velocity of a moving φ."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

SMALL = 1e-2  # [rad] below which the series have every digit
HALF_TURN = 1e-6  # [rad] from π, where the direction of the shortest turn is lost


def turned(rotation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """R exp([φ]) (k, 3, 3) for one rotation (3, 3) and rotation vectors (k, 3) [rad] in its axes."""
    return rotation @ Rotation.from_rotvec(vectors).as_matrix()


def shortest_turn(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) [rad] from one rotation to another, in the axes of the first; SLERP goes along it."""
    return Rotation.from_matrix(begin.T @ end).as_rotvec()


def body_rates(phi: np.ndarray, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angular velocity and acceleration (k, 3), in turned axes, of exp([φ]) with φ, φ' and φ'' (k, 3) given.

    ω = φ' - A φ × φ' + B φ × (φ × φ'),  A = (1 - cos θ) / θ²,  B = (θ - sin θ) / θ³,  θ = |φ|.
    """
    square = (phi * phi).sum(axis=1, keepdims=True)
    theta = np.sqrt(square)
    small = theta < SMALL
    t = np.where(small, 1.0, theta)
    a = np.where(small, 1 / 2 - square / 24 + square**2 / 720, (1.0 - np.cos(t)) / t**2)
    b = np.where(small, 1 / 6 - square / 120 + square**2 / 5040, (t - np.sin(t)) / t**3)
    # A' / (θ θ') and B' / (θ θ')
    da = np.where(small, -1 / 12 + square / 180 - square**2 / 6720, (t * np.sin(t) - 2.0 * (1.0 - np.cos(t))) / t**4)
    db = np.where(small, -1 / 60 + square / 1260 - square**2 / 60480, (3.0 * np.sin(t) - t * (2.0 + np.cos(t))) / t**5)
    along = (phi * first).sum(axis=1, keepdims=True)  # θ θ'
    c, d = np.cross(phi, first), np.cross(phi, second)
    cc = np.cross(phi, c)
    omega = first - a * c + b * cc
    change = second - a * d + b * (np.cross(phi, d) + np.cross(first, c)) + along * (db * cc - da * c)
    return omega, change

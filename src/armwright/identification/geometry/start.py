"""First guess of what the record does not know: the measuring frame, points on the tool, and points that do not move.

With R, t the arm's nominal poses, points p on the tool and B⁻¹ = (X, x) the measuring frame:  y = X (R p + t) + x.  For a known X
this is linear in p and x, for known p it is the registration of two clouds of points [Arun1987]: they take turns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armwright.errors import IdentificationError
from armwright.identification.geometry.problem import rotations

ROUNDS = 50
SETTLED = 1e-9  # [m] by which a round moves the points


def registered(of_arm: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """(4, 4) placement X that takes points (k, 3) nearest to others (k, 3), by singular values. [Arun1987]"""
    centre, other = of_arm.mean(axis=0), measured.mean(axis=0)
    u, _, vt = np.linalg.svd((measured - other).T @ (of_arm - centre))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = turn, other - turn @ centre
    return placed


def measuring_frame(
    poses: Sequence[np.ndarray],
    measured: Sequence[np.ndarray],
    places: Sequence[np.ndarray | None],
    known: np.ndarray | None = None,
) -> tuple[np.ndarray, list[np.ndarray]]:
    """The base in the measuring frame, and the points on the tool.

    Args:
        poses: (k, 4, 4) nominal of the frame that carries a point, of each point.   measured: (k, 3) of it.
        places: of each point (3,) in its frame; None: unknown.   known: (4, 4) base, if it is.
    Returns:
        base: (4, 4).   places: of all points.
    """
    found = [np.zeros(3) if place is None else np.asarray(place, dtype=float) for place in places]
    y = np.concatenate(measured)
    base = np.eye(4)
    for _ in range(ROUNDS):
        at = [T[:, :3, :3] @ p + T[:, :3, 3] for T, p in zip(poses, found, strict=True)]
        base = registered(np.concatenate(at), y) if known is None else known
        before = np.concatenate(found)
        for k, place in enumerate(places):
            if place is None:  # p of  Xᵀ (y − x) − t = R p
                local = (measured[k] - base[:3, 3]) @ base[:3, :3] - poses[k][:, :3, 3]
                found[k] = np.einsum("nba,nb->a", poses[k][:, :3, :3], local) / len(local)
        if np.abs(np.concatenate(found) - before).max() < SETTLED:
            break
    return base, found


def tool_turn(base: np.ndarray, poses: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """(3, 3) mean rotation of a measured frame in the record's, of (k, 4, 4) nominal poses and (k, 4) measured w, x, y, z."""
    between = (base[:3, :3] @ poses[:, :3, :3]).transpose(0, 2, 1) @ rotations(quaternions)
    u, _, vt = np.linalg.svd(between.sum(axis=0))
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt


def touched(poses: np.ndarray, which: np.ndarray, place: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """The point of the tool p and the points s that it touches:  R p + t = s[which], by linear least squares.

    Args:
        poses: (k, 4, 4) nominal.   which: (k,) number of the point that is touched.   place: (3,) p; None: unknown.
    Returns:
        place: (3,).   fixed: (points, 3).
    """
    count = int(which.max()) + 1
    if place is None:
        matrix = np.zeros((len(poses), 3, 3 + 3 * count))
        matrix[:, :, :3] = poses[:, :3, :3]
        for row, point in enumerate(which):
            matrix[row, :, 3 + 3 * point : 6 + 3 * point] = -np.eye(3)
        place = np.linalg.lstsq(matrix.reshape(-1, matrix.shape[2]), -poses[:, :3, 3].ravel(), rcond=1e-9)[0][:3]
    at = poses[:, :3, :3] @ place + poses[:, :3, 3]
    return place, np.array([at[which == k].mean(axis=0) for k in range(count)])


def anchor(points: np.ndarray, distances: np.ndarray) -> np.ndarray:
    """(3,) point a at distances (k,) from points (k, 3):  2 (P − P̄) a = |P|² − d² less its mean.

    Raises:
        IdentificationError: the points lie in a plane, so the anchor may be on either side of it.
    """
    right = (points**2).sum(axis=1) - distances**2
    matrix = 2.0 * (points - points.mean(axis=0))
    found, _, rank, _ = np.linalg.lstsq(matrix, right - right.mean(), rcond=1e-6)
    if rank < 3:
        raise IdentificationError(
            "the poses lie in a plane", place="anchor", expected="poses in all directions, or anchor_m"
        )
    return found

"""Poses for a calibration: the best exchange, free of collisions, and worth what they promise."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import IdentificationError
from armwright.identification.geometry.poses import exchanged
from raises_at import raises_at


def test_the_exchange_finds_the_largest_determinant():
    """All 70 choices of 4 of 8 small problems: the best in most, and never far from it."""
    near = []
    for seed in range(10):
        by_pose = np.random.default_rng(seed).normal(size=(8, 2, 4))
        chosen = exchanged(by_pose, 4, np.random.default_rng(seed))
        assert len(set(chosen.tolist())) == 4

        def volume(rows, by_pose=by_pose):
            stacked = by_pose[list(rows)].reshape(-1, 4)
            return np.linalg.slogdet(stacked.T @ stacked)[1]

        near.append(volume(chosen) - max(map(volume, combinations(range(8), 4))))
    assert np.sum(np.array(near) > -1e-9) >= 6
    assert min(near) > -0.5


def test_poses_are_free_within_the_box_and_better_than_random():
    """Every chosen pose keeps the clearance and the limits; its O1 is above that of each of 20 random sets' mean."""
    arm = aw.load("lwa4p")
    room = aw.collision.clearance(arm, [aw.collision.PlaneObstacle([0, 0, -0.1], [0, 0, 1])], radius=0.05, least=0.01)
    box = [[-2.0, -2.0, 0.0], [2.0, 2.0, 2.0]]
    found = aw.identification.design_poses(arm, 25, [[0.1, 0.0, 0.05], [0.0, 0.1, 0.05]], clearance=room, box=box)
    assert found.q.shape == (25, 6)
    assert room.distances(found.q).min() > 0.01
    low, high = np.array([body.limits.position for body in arm.coordinates]).T
    assert (found.q >= low).all()
    assert (found.q <= high).all()
    for pose in found.q:
        placed = aw.forward_kinematics(arm, pose)
        for point in found.points:
            assert (placed[:3, :3] @ point + placed[:3, 3])[2] >= -1e-9
    assert found.o1 > 1.05 * found.random_o1
    assert found.deviations.mean() < 0.95
    assert "least distance" in str(found)


def test_fewer_poses_than_parameters_are_refused():
    """The error says how many it takes."""
    with raises_at(IdentificationError, "count", "9 poses"):
        aw.identification.design_poses("lwa4p", 3, [0.1, 0.0, 0.05])
    with pytest.raises(IdentificationError, match="points"):
        aw.identification.design_poses("lwa4p", 30, [0.1, 0.0])
    with raises_at(IdentificationError, "candidates", "0 of 16000"):
        aw.identification.design_poses("lwa4p", 20, [0.1, 0.0, 0.05], box=[[5, 5, 5], [6, 6, 6]])

"""Closed forms are found from the axes alone, on arms of random axes, and nowhere where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armwright as aw
from armwright.ik.closed_form.geometry import geometry_of
from armwright.ik.closed_form.subproblems import Turn
from armwright.spatial import Placement
from ik.arms import arm_of
from ik.closed_form.made_arms import KINDS, arm_of_axes, axes

SAMPLES = 30


def branches(arm, geometry, pose, free=0.0):
    """Joint positions (8, 6) of all branches, as plain NumPy computes them."""
    target = Placement(pose[:3, :3], pose[:3, 3] / geometry.links.length)
    turns = geometry.positions(target, [Turn.by(free)] * 6)
    return np.array([[turn.angle for turn in each] for each in turns]) - geometry.offsets


def differences(q, other):
    """Largest difference of angles, whole turns aside."""
    return np.abs(np.sin((q - other) / 2.0)).max(axis=-1)


@pytest.mark.sample(9)
@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_positions_are_found_again_and_every_solution_meets_the_pose(kind, seed, backward, tmp_path):
    arm = arm_of_axes(tmp_path, *axes(kind, seed, backward))
    geometry = geometry_of(arm)
    assert geometry is not None
    assert geometry.reversed == backward
    for q in np.random.default_rng(seed).uniform(-np.pi, np.pi, (SAMPLES, 6)):
        pose = aw.forward_kinematics(arm, q)
        found = branches(arm, geometry, pose)
        assert found.shape == (8, 6)
        off = np.array([np.abs(aw.forward_kinematics(arm, each) - pose).max() for each in found])
        assert differences(found, q).min() < 1e-7
        assert np.sort(off)[1] < 1e-12  # solutions come in pairs; others may be complex


@pytest.mark.parametrize(
    ("name", "description"),
    [
        ("puma560", "axes 4, 5 and 6 meet, axes 2 and 3 are parallel"),
        ("lwa4p", "axes 4, 5 and 6 meet, axes 2 and 3 are parallel"),
        ("cmu-dd", "axes 1, 2 and 3 meet, axes 5 and 6 meet"),
        ("ur5", "axes 2, 3 and 4 are parallel, axes 5 and 6 meet"),
    ],
)
def test_arms_are_described(name, description, tmp_path):
    geometry = geometry_of(arm_of(name, tmp_path))
    assert geometry is not None
    assert geometry.description == description


def test_frames_of_the_last_link_have_it_and_others_do_not():
    arm = aw.load("puma560")
    assert geometry_of(arm, "link6") is not None
    assert geometry_of(arm, "link5") is None


@pytest.mark.parametrize("name", ["panda", "two-link", "iiwa", "examples/scara.toml"])
def test_arms_of_other_joints_have_none(name, tmp_path):
    assert geometry_of(arm_of(name, tmp_path)) is None


def test_nor_have_general_or_degenerate_arms(tmp_path):
    directions, points, tip, turn = axes("wrist, 2 and 3 parallel", 0)
    tilted = directions.copy()
    tilted[2] = Rotation.from_rotvec([1e-6, 0.0, 0.0]).apply(directions[2])
    moved = points.copy()
    moved[4] += 1e-6 * np.cross(directions[4], directions[5])
    planar = np.broadcast_to([0.0, 1.0, 0.0], (6, 3))
    same = directions.copy()
    same[5] = same[4]
    once = points.copy()
    once[0] = once[1]
    for wrong in ((tilted, points), (directions, moved), (planar, points), (same, points), (planar, once)):
        assert geometry_of(arm_of_axes(tmp_path, *wrong, tip, turn)) is None


def test_a_billionth_of_a_radian_is_no_difference(tmp_path):
    directions, points, tip, turn = axes("three parallel", 1)
    directions[2] = Rotation.from_rotvec([1e-11, 0.0, -1e-11]).apply(directions[2])
    arm = arm_of_axes(tmp_path, directions, points + 1e-12, tip, turn)
    geometry = geometry_of(arm)
    assert geometry is not None
    q = np.array([0.3, -0.4, 0.5, 0.6, -0.7, 0.8])
    pose = aw.forward_kinematics(arm, q)
    assert min(np.abs(aw.forward_kinematics(arm, each) - pose).max() for each in branches(arm, geometry, pose)) < 1e-9

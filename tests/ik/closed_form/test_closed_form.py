"""Closed forms through the public call: right at singular poses, all branches, limits, and other solvers' answers."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError
from ik.arms import arm_of, samples
from ik.closed_form.made_arms import KINDS, arm_of_axes, axes

ARMS = ("puma560", "lwa4p", "cmu-dd", "ur5", "ur5e", "widowx250")
COUNT = 10_000
ROUNDING, TOLERANCE = 1e-12, 1e-8
FREE = 1e-3  # least singular value, lengths in metres, above which solutions are compared by joints


def poses_of(arm, q):
    return aw.compile(arm).forward_kinematics(q)


def off(arm, q, targets):
    """Largest difference of entries of the poses at q (…, 6) from targets (…, 4, 4)."""
    return np.abs(poses_of(arm, q) - targets).max(axis=(-2, -1))


def limits_of(arm):
    return np.array([body.limits.position for body in arm.bodies]).T


def without_limits(name, folder):
    """The arm with ±2π for every joint, so that all eight branches count."""
    from armwright.ik.closed_form.axes import axes_of

    arm = arm_of(name, folder)
    found = axes_of(arm, None, 1.0)
    from scipy.spatial.transform import Rotation

    tip = found.tip.position - found.points[-1]
    return arm_of_axes(
        folder, found.directions, found.points, tip, Rotation.from_matrix(found.tip.rotation), 2.0 * np.pi
    )


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ARMS)
def test_random_positions_are_among_the_branches_within_the_limits(name, tmp_path):
    arm = arm_of(name, tmp_path)
    q, targets = samples(arm, COUNT)
    found = aw.inverse_kinematics(arm, targets, method="closed-form")
    branches = found.branches
    assert found.success.all()
    assert np.abs(branches.q - q[:, None]).max(axis=2).min(axis=1).max() < 1e-7
    low, high = limits_of(arm)
    solutions = branches.q[branches.success]
    assert ((solutions >= low) & (solutions <= high)).all()
    every = np.broadcast_to(targets[:, None], (COUNT, 8, 4, 4))[branches.success]
    assert off(arm, solutions, every).max() < ROUNDING
    chosen = branches.q[np.arange(COUNT), found.branch]
    assert np.array_equal(found.q, chosen)
    margins = np.where(branches.success, branches.margin, -np.inf)
    assert np.array_equal(found.margin, margins.max(axis=1))  # the farthest from the limits
    assert (found.iterations == 0).all()


@pytest.mark.study
@pytest.mark.parametrize("name", ARMS)
def test_every_branch_is_among_those_of_eaik_and_the_other_way_round(name, tmp_path):
    eaik = pytest.importorskip("eaik.IK_HP", reason="needs the analytic solver: pip install eaik")
    from armwright.ik.closed_form.axes import axes_of

    arm = without_limits(name, tmp_path)
    found = axes_of(arm, None, 1.0)
    points = np.vstack([np.zeros(3), found.points, found.tip.position])
    oracle = eaik.HPRobot(found.directions, np.diff(points, axis=0))
    assert oracle.hasKnownDecomposition()
    _, targets = samples(arm, 200)
    ours = aw.inverse_kinematics(arm, targets, method="closed-form").branches
    last = targets.copy()
    last[:, :3, :3] = targets[:, :3, :3] @ found.tip.rotation.T  # its tip has the base's axes in the zero pose
    for k, each in enumerate(oracle.IK_batched(last, 1)):
        theirs = np.array(each.Q)[~np.array(each.is_LS, dtype=bool)]
        mine = ours.q[k][ours.success[k]]
        difference = np.abs(np.sin((mine[:, None] - theirs[None]) / 2.0)).max(axis=2)
        assert len(mine) == len(theirs)
        assert difference.min(axis=0).max() < 1e-6
        assert difference.min(axis=1).max() < 1e-6


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.study
def test_descents_from_many_starts_find_no_other_solution(kind, tmp_path):
    arm = arm_of_axes(tmp_path, *axes(kind, 5))
    _, targets = samples(arm, 4, seed=1)
    for target in targets:
        starts = np.random.default_rng(0).uniform(-np.pi, np.pi, (400, 6))
        numeric = aw.inverse_kinematics(arm, np.broadcast_to(target, (400, 4, 4)), near=starts, method="numeric")
        branches = aw.inverse_kinematics(arm, target, method="closed-form").branches
        mine = branches.q[branches.success]
        difference = np.abs(np.sin((numeric.q[numeric.success][:, None] - mine) / 2.0)).max(axis=2)
        assert difference.min(axis=1).max() < 1e-6  # every numeric solution is a branch
        assert difference.min(axis=0).max() < 1e-6  # every branch is a numeric solution


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ARMS)
def test_closed_form_and_descent_agree_where_the_pose_is_regular(name, tmp_path):
    arm = arm_of(name, tmp_path)
    _, targets = samples(arm, COUNT, seed=2)
    closed = aw.inverse_kinematics(arm, targets, method="closed-form")
    numeric = aw.inverse_kinematics(arm, targets, near=closed.q, tolerance=1e-12, method="numeric")
    least = np.linalg.svd(aw.compile(arm).jacobian(closed.q), compute_uv=False)[:, -1]
    regular = numeric.success & (least > FREE)
    assert regular.mean() > 0.9
    assert np.abs(closed.q - numeric.q)[regular].max() < 1e-9
    assert off(arm, closed.q, targets).max() < ROUNDING


SINGULAR = {  # positions (6,) with nan where any angle does
    "puma560": {
        "wrist": [np.nan, np.nan, np.nan, np.nan, 0.0, np.nan],
        "elbow stretched": [np.nan, np.nan, np.pi / 2 - np.arctan2(0.0203, 0.4318), np.nan, np.nan, np.nan],
    },
    "lwa4p": {
        "wrist": [np.nan, np.nan, np.nan, np.nan, 0.0, np.nan],
        "elbow stretched": [np.nan, np.nan, 0.0, np.nan, np.nan, np.nan],
        "shoulder": [np.nan, 0.0, 0.0, np.nan, np.nan, np.nan],
        "all": [np.nan, 0.0, 0.0, np.nan, 0.0, np.nan],
    },
    "cmu-dd": {
        "shoulder": [np.nan, 0.0, np.nan, np.nan, np.nan, np.nan],
        "elbow in line with the forearm": [np.nan, np.nan, np.nan, 0.0, np.nan, np.nan],
        "all": [np.nan, 0.0, np.nan, 0.0, np.nan, np.nan],
    },
    "ur5": {
        "wrist": [np.nan, np.nan, np.nan, np.nan, 0.0, np.nan],
        "wrist turned": [np.nan, np.nan, np.nan, np.nan, np.pi, np.nan],
        "elbow stretched": [np.nan, np.nan, 0.0, np.nan, np.nan, np.nan],
        "elbow folded": [np.nan, np.nan, np.pi, np.nan, np.nan, np.nan],
        "upright": [np.nan, -np.pi / 2, 0.0, np.nan, 0.0, np.nan],
    },
}


# Singular in several ways: what one way leaves to rounding decides whether the others are met within the limits, and the
# descent solves what is left.
SEVERAL = ("all", "elbow in line with the forearm", "upright")


@pytest.mark.parametrize(("name", "where"), [(name, where) for name, each in SINGULAR.items() for where in each])
@pytest.mark.sample(1)
def test_at_singular_poses_and_close_to_them_no_row_is_wrong(name, where, tmp_path):
    arm = arm_of(name, tmp_path)
    fixed = np.array(SINGULAR[name][where])
    q, _ = samples(arm, 100, seed=4)
    q = np.where(np.isnan(fixed), q, fixed)
    for away in (0.0, 1e-15, 1e-12, 1e-9, 1e-7, 1e-5):
        near = np.clip(q + np.where(np.isnan(fixed), 0.0, away), *limits_of(arm))
        targets = poses_of(arm, near)
        found = aw.inverse_kinematics(arm, targets, near=near)
        assert found.success.all()
        every = np.broadcast_to(targets[:, None], (100, 8, 4, 4))[found.branches.success]
        assert off(arm, found.branches.q[found.branches.success], every).max() < TOLERANCE
        assert off(arm, found.q, targets).max() < TOLERANCE
        if where not in SEVERAL:
            assert (found.branch >= 0).all()
            assert off(arm, found.q, targets).max() < 1e-11


def test_at_a_singular_pose_the_given_positions_are_kept():
    arm = aw.load("lwa4p")
    q = np.array([0.4, 0.5, -0.6, 1.1, 0.0, 0.3])
    found = aw.inverse_kinematics(arm, poses_of(arm, q), near=q)
    assert np.abs(found.q - q).max() < 1e-7


def test_whole_turns_bring_joints_within_their_limits_and_near_what_is_given(tmp_path):
    directions, points, tip, turn = axes("three parallel", 3)
    limits = np.array([[-7.0, 7.0], [0.5, 6.0], [-12.0, -3.0], [-1.0, 1.0], [2.0, 15.0], [-np.pi, np.pi]])
    arm = arm_of_axes(tmp_path, directions, points, tip, turn, limits)
    q = np.random.default_rng(0).uniform(*limits.T, (500, 6))
    targets = poses_of(arm, q)
    found = aw.inverse_kinematics(arm, targets, method="closed-form")
    assert found.success.all()
    assert ((found.q >= limits[:, 0]) & (found.q <= limits[:, 1])).all()
    near = aw.inverse_kinematics(arm, targets, near=q, method="closed-form")
    assert np.abs(near.branches.q - q[:, None]).max(axis=2).min(axis=1).max() < 1e-6
    assert (((near.q - q) ** 2).sum(axis=1) <= ((found.q - q) ** 2).sum(axis=1) + 1e-9).all()
    at_ends = np.where(np.random.default_rng(1).random((500, 6)) < 0.5, *limits.T[:, None])
    assert aw.inverse_kinematics(arm, poses_of(arm, at_ends), method="closed-form").success.all()


def test_the_bits_of_a_target_depend_on_nothing_else():
    arm = aw.load("puma560")
    _, targets = samples(arm, 3000)
    targets[5, :3, 3] += 3.0  # out of reach
    every = aw.inverse_kinematics(arm, targets)
    assert every.branch[5] == -1
    for part in (slice(3, 4), slice(5, 6), slice(100, 333)):
        alone = aw.inverse_kinematics(arm, targets[part])
        assert np.array_equal(alone.q, every.q[part])
        assert np.array_equal(alone.branches.q, every.branches.q[part], equal_nan=True)
    assert np.array_equal(aw.inverse_kinematics(arm, targets, threads=2).q, every.q)
    one = aw.inverse_kinematics(arm, targets[7])
    assert one.branches.q.shape == (8, 6)
    assert one.branches.success.shape == (8,)
    assert one.branch == every.branch[7]
    grid = aw.inverse_kinematics(arm, targets[:6].reshape(2, 3, 4, 4))
    assert np.array_equal(grid.branches.q, every.branches.q[:6].reshape(2, 3, 8, 6), equal_nan=True)
    assert grid.branch.shape == (2, 3)


def test_out_of_reach_and_out_of_limits_are_told_apart():
    arm = aw.load("puma560")
    q = np.array([0.3, 0.4, -0.5, 0.6, 0.7, 3.0])
    q[4] = 1.9  # beyond ±100°
    targets = poses_of(arm, q[None]).repeat(2, axis=0)
    targets[1, :3, 3] += 3.0
    found = aw.inverse_kinematics(arm, targets, method="closed-form")
    assert not found.success.any()
    assert np.isnan(found.q).all()
    said = str(found).splitlines()
    assert said[1] == "target 0: not within the limits, wrist_pitch would be 0.155 rad beyond its own"
    assert said[2] == "target 1: no joint positions reach it"
    numeric = aw.inverse_kinematics(arm, targets, method="numeric")
    both = aw.inverse_kinematics(arm, targets)
    assert np.array_equal(both.q, numeric.q)
    assert np.array_equal(both.position_error, numeric.position_error)
    assert np.array_equal(both.iterations, numeric.iterations)
    assert "mm" in str(both)


def test_the_method_is_named():
    arm = aw.load("puma560")
    _, targets = samples(arm, 10)
    found = aw.inverse_kinematics(arm, targets)
    assert found.method == "closed form (axes 4, 5 and 6 meet, axes 2 and 3 are parallel)"
    assert "in closed form (axes" in str(found)
    for other in (
        aw.inverse_kinematics(arm, targets, method="numeric"),
        aw.inverse_kinematics(arm, targets[:, :3, 3]),
        aw.inverse_kinematics(arm, targets, aim="axis"),
        aw.inverse_kinematics(aw.load("panda"), poses_of(aw.load("panda"), np.zeros((1, 7)))),
    ):
        assert other.method == "numeric"
        assert other.branches is None
        assert other.branch is None
    elsewhere = aw.inverse_kinematics(arm, targets, frame="link6", method="closed-form")
    assert np.array_equal(elsewhere.q, found.q)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("panda", {"method": "closed-form"}),
        ("puma560", {"method": "closed-form", "aim": "position"}),
        ("puma560", {"method": "closed-form", "frame": "link4"}),
        ("puma560", {"method": "closed"}),
        ("puma560", {"method": None}),
        ("puma560", {"method": ["auto"]}),
    ],
)
def test_a_closed_form_that_is_not_there_is_refused(name, options):
    with pytest.raises(ModelError) as error:
        aw.inverse_kinematics(aw.load(name), np.eye(4), **options)
    assert error.value.place == "method"


@pytest.mark.parametrize(("kind", "off_by"), [(kind, 4e-6) for kind in KINDS] + [("three parallel", 6e-4)])
@pytest.mark.sample(1)
def test_an_arm_that_is_nearly_of_a_kind_has_all_its_branches(kind, off_by, tmp_path):
    """As of 1.5708 or 1.57 for π/2: the positions are among the branches, and none that many descents find is missing."""
    directions, points, tip, turn = axes(kind, 6)
    rng = np.random.default_rng(0)
    directions = directions + off_by * rng.uniform(-1.0, 1.0, (6, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    arm = arm_of_axes(tmp_path, directions, points + off_by * rng.uniform(-1.0, 1.0, (6, 3)), tip, turn)
    q, targets = samples(arm, 1000, seed=3)
    found = aw.inverse_kinematics(arm, targets, method="closed-form")
    branches = found.branches
    assert "polished" in found.method
    regular = np.linalg.svd(aw.compile(arm).jacobian(q), compute_uv=False)[:, -1] > 0.1
    difference = np.abs(np.sin((branches.q - q[:, None]) / 2.0)).max(axis=2)
    assert (np.where(branches.success, difference, 1.0).min(axis=1) < 1e-9)[regular].mean() > 0.998
    every = np.broadcast_to(targets[:, None], (*branches.success.shape, 4, 4))[branches.success]
    assert off(arm, branches.q[branches.success], every).max() < TOLERANCE
    for k in np.flatnonzero(regular)[:3]:
        starts = np.random.default_rng(0).uniform(-np.pi, np.pi, (400, 6))
        numeric = aw.inverse_kinematics(arm, np.broadcast_to(targets[k], (400, 4, 4)), near=starts, method="numeric")
        mine = branches.q[k][branches.success[k]]
        difference = np.abs(np.sin((numeric.q[numeric.success][:, None] - mine) / 2.0)).max(axis=2)
        assert difference.min(axis=1).max() < 1e-6

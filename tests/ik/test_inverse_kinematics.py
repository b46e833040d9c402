"""Inverse kinematics: every solution is checked by forward kinematics and against the limits, on arms nobody tuned it to."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armwright as aw
from armwright.errors import ABSENT, ModelError, ShapeError
from armwright.ik.starts import random_positions, sampled_ranges
from ik.arms import arm_of, samples
from ik.closed_form.made_arms import arm_of_axes
from raises_at import raises_at

COUNT = 10_000
TOLERANCE = 1e-8


def off(arm, q, targets):
    """Distances [m] and angles [rad] of the tip, by the angle of the rotation between the two."""
    poses = aw.compile(arm).forward_kinematics(q)
    turn = Rotation.from_matrix(np.swapaxes(poses[:, :3, :3], 1, 2) @ targets[:, :3, :3])
    return np.linalg.norm(poses[:, :3, 3] - targets[:, :3, 3], axis=1), turn.magnitude()


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", ["puma560", "lwa4p", "panda", "cmu-dd", "ur5", "xarm7", "iiwa"])
def test_reachable_poses_are_solved_within_the_limits(name, tmp_path):
    arm = arm_of(name, tmp_path)
    _, targets = samples(arm, COUNT)
    found = aw.inverse_kinematics(arm, targets, method="numeric")
    assert found.success.mean() >= 0.999
    q = found.q[found.success]
    far, turned = off(arm, q, targets[found.success])
    assert far.max() <= TOLERANCE
    assert turned.max() <= 2.0 * TOLERANCE  # an angle from a rotation matrix has no more digits
    low, high = np.array([body.limits.position for body in arm.bodies]).T
    assert (q >= low).all()
    assert (q <= high).all()
    assert found.iterations.mean() < 25.0
    assert (found.attempts == 1).mean() > 0.6
    assert (found.attempts <= found.iterations).all()


@pytest.mark.sample(1)
@pytest.mark.parametrize(("seed", "size"), [(4, 1.0), (10, 0.05), (11, 20.0)])
def test_arms_of_random_axes_limits_and_sizes_are_solved(seed, size, tmp_path):
    rng = np.random.default_rng(1000 + seed)
    directions = rng.normal(size=(6, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = size * np.cumsum(rng.uniform(-0.4, 0.4, (6, 3)), axis=0)
    limits = np.stack([-rng.uniform(0.8, 3.1, 6), rng.uniform(0.8, 3.1, 6)], axis=1)
    arm = arm_of_axes(tmp_path, directions, points, size * rng.uniform(-0.2, 0.2, 3), Rotation.random(rng=rng), limits)
    _, targets = samples(arm, 2000)
    found = aw.inverse_kinematics(arm, targets)
    assert found.method == "numeric"
    assert found.success.mean() >= 0.999
    assert np.abs(aw.compile(arm).forward_kinematics(found.q) - targets)[found.success].max() <= 2.0 * TOLERANCE
    assert ((found.q >= limits[:, 0]) & (found.q <= limits[:, 1])).all()
    assert found.iterations.mean() < 60.0


def test_the_bits_of_a_target_depend_on_nothing_else():
    solve = partial(aw.inverse_kinematics, method="numeric")
    arm = aw.load("puma560")
    _, targets = samples(arm, 9000)
    every = solve(arm, targets)
    assert np.array_equal(solve(arm, targets, threads=2).q, every.q)
    assert np.array_equal(solve(arm, targets[::-1]).q[::-1], every.q)
    for part in (slice(77, 78), slice(100, 333)):
        assert np.array_equal(solve(arm, targets[part]).q, every.q[part])
    one = solve(arm, targets[77])
    assert one.q.shape == (6,)
    assert one.success.shape == ()
    assert np.array_equal(one.q, every.q[77])
    assert np.array_equal(solve(arm, targets[:6].reshape(2, 3, 4, 4)).q, every.q[:6].reshape(2, 3, 6))


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["puma560", "lwa4p", "iiwa"])
def test_near_positions_are_found_again(name, tmp_path):
    arm = arm_of(name, tmp_path)
    q, targets = samples(arm, 500, seed=3)
    low, high = np.array([body.limits.position for body in arm.bodies]).T
    near = np.clip(q + 0.02, low, high)
    found = aw.inverse_kinematics(arm, targets, near=near, method="numeric")
    assert found.success.all()
    away = np.abs(found.q - near).max(axis=1)
    assert np.quantile(away, 0.95) < 0.1  # close to a singular pose a small turn of the tip is a large one of joints


def test_positions_and_directions_alone():
    arm = aw.load("puma560")
    _, targets = samples(arm, 500)
    found = aw.inverse_kinematics(arm, targets[:, :3, 3])
    assert found.success.all()
    assert (found.angle_error == 0.0).all()
    assert off(arm, found.q, targets)[0].max() <= TOLERANCE
    found = aw.inverse_kinematics(arm, targets, aim="axis")
    assert found.success.mean() >= 0.998
    axes = aw.compile(arm).forward_kinematics(found.q)[:, :3, 2]
    assert np.abs(axes - targets[:, :3, 2])[found.success].max() < 2.0 * TOLERANCE


def test_another_frame_than_the_tip():
    arm = aw.load("puma560")
    frame = "link5"
    q, _ = samples(arm, 50)
    targets = np.array([aw.forward_kinematics(arm, each, frame=frame) for each in q])
    found = aw.inverse_kinematics(arm, targets, frame=frame)
    again = np.array([aw.forward_kinematics(arm, each, frame=frame) for each in found.q])
    assert found.success.all()
    assert np.abs(again - targets).max() < 3.0 * TOLERANCE


def test_sliding_joints_and_singular_poses():
    arm = aw.load("examples/scara.toml")
    _, targets = samples(arm, 300)
    assert aw.inverse_kinematics(arm, targets).success.all()
    puma = aw.load("puma560")
    q, _ = samples(puma, 300)
    q[:, 4] = 0.0  # the wrist's axes 4 and 6 fall together
    targets = aw.compile(puma).forward_kinematics(q)
    found = aw.inverse_kinematics(puma, targets, method="numeric")
    far, turned = off(puma, found.q, targets)
    assert found.success.mean() > 0.98
    assert far[found.success].max() <= TOLERANCE
    assert turned[found.success].max() <= 2.0 * TOLERANCE


def test_out_of_reach_says_how_far_and_where_the_nearest_pose_is():
    arm = aw.load("puma560")
    targets = np.array([[3.0, 0.0, 0.0], [0.5, 0.1, 0.2]])
    found = aw.inverse_kinematics(arm, targets)
    assert found.success.tolist() == [False, True]
    from scipy.optimize import minimize

    dyn = aw.compile(arm)
    low, high = np.array([body.limits.position for body in arm.bodies]).T
    best = min(
        minimize(
            lambda q: np.linalg.norm(dyn.forward_kinematics(q)[:3, 3] - targets[0]),
            start,
            bounds=[*zip(low, high, strict=True)],
        ).fun
        for start in samples(arm, 10)[0]
    )
    assert found.position_error[0] == pytest.approx(best, rel=1e-4)
    assert f"{1e3 * found.position_error[0]:.4g} mm" in str(found)
    assert "1 of 2 solved" in str(found)


@pytest.mark.study
@pytest.mark.parametrize("name", ["puma560", "iiwa"])
def test_the_nearest_reachable_pose_is_that_of_brute_force(name, tmp_path):
    """Bounded least squares of SciPy from 40 starts, on poses out of reach: by as much, in √(distance² + (w angle)²)."""
    from scipy.optimize import least_squares

    from armwright.kinematics.reach import reach

    arm = arm_of(name, tmp_path)
    dyn, weight = aw.compile(arm), reach(arm) / 3.0
    starts, targets = samples(arm, 42, seed=9)
    targets = targets[40:]
    targets[:, :3, 3] *= (reach(arm) * np.array([1.05, 1.6]) / np.linalg.norm(targets[:, :3, 3], axis=1))[:, None]
    found = aw.inverse_kinematics(arm, targets)
    assert not found.success.any()
    low, high = np.array([body.limits.position for body in arm.bodies]).T
    assert ((found.q >= low) & (found.q <= high)).all()
    distance, angle = off(arm, found.q, targets)
    assert np.allclose(distance, found.position_error)
    assert np.allclose(angle, found.angle_error)
    for k in range(2):

        def residual(q, target=targets[k]):
            pose = dyn.forward_kinematics(q)
            turn = Rotation.from_matrix(target[:3, :3] @ pose[:3, :3].T).as_rotvec()
            return np.concatenate([target[:3, 3] - pose[:3, 3], weight * turn])

        best = min(np.sqrt(2.0 * least_squares(residual, q, bounds=(low, high)).cost) for q in starts[:40])
        assert np.hypot(distance[k], weight * angle[k]) <= best * (1.0 + 1e-3)


@pytest.mark.study
def test_a_weight_says_what_is_nearest_and_not_what_is_solved():
    arm = aw.load("panda")
    _, targets = samples(arm, 200)
    away = targets[:5].copy()
    away[:, :3, 3] *= 1.5 / np.linalg.norm(away[:, :3, 3], axis=1)[:, None]
    by_length, by_angle = (
        aw.inverse_kinematics(arm, away, goal=aw.kinematics.Goal(length=weight)) for weight in (1e-4, 1e4)
    )
    assert (by_length.position_error <= by_angle.position_error * (1.0 + 1e-6)).all()
    assert (by_angle.angle_error <= by_length.angle_error * (1.0 + 1e-6)).all()
    for weight in (1e-4, 1e4):
        assert aw.inverse_kinematics(arm, targets, goal=aw.kinematics.Goal(length=weight)).success.mean() >= 0.995


@pytest.mark.study
@pytest.mark.parametrize("name", ["puma560", "panda", "two-link"])
def test_targets_in_millimetres_are_asked_about(name):
    arm = aw.load(name)
    there = aw.forward_kinematics(arm, np.full(arm.n, 0.4))
    for target in (there[:3, 3], there) if name != "two-link" else (there[:3, 3],):
        large = np.array(target, dtype=float)
        large[(slice(3), 3) if large.ndim == 2 else slice(3)] *= 1000.0
        assert "targets are in metres" in str(aw.inverse_kinematics(arm, large))
        assert "metres" not in str(aw.inverse_kinematics(arm, target))
    assert "metres" not in str(aw.inverse_kinematics(arm, [5.0, 0.0, 0.0]))  # beyond its reach, and no more


@pytest.mark.parametrize(("name", "here"), [("q0", "near"), ("tol", "tolerance"), ("mask", "aim"), ("end", "frame")])
def test_keywords_of_other_toolboxes_are_answered(name, here):
    with pytest.raises(TypeError, match=f"'{name}'.* '{here}'"):
        aw.inverse_kinematics(aw.load("puma560"), [0.4, 0.1, 0.3], **{name: 1.0})
    with pytest.raises(TypeError, match="'xyzzy'"):
        aw.inverse_kinematics(aw.load("puma560"), [0.4, 0.1, 0.3], xyzzy=1.0)


def test_the_joint_that_holds_a_target_back_is_named():
    arm = aw.load("puma560")
    beyond = aw.compile(arm).forward_kinematics(np.array([0.1, 0.2, 0.3, 0.2, 1.9, 0.1]))  # joint 5 ends at 1.745
    found = aw.inverse_kinematics(arm, beyond)
    assert not found.success
    low, high = np.array([body.limits.position for body in arm.bodies]).T
    meets = found.branches.q[found.branches.position_error < TOLERANCE]
    excess = np.maximum(low - meets, meets - high).max(axis=1).min()  # of the branch that is least beyond
    assert 0.0 < excess <= 1.9 - high[4] + 1e-9
    assert f"joint {arm.names[4]} {excess:.4g} rad beyond its limit" in str(found)
    numeric = aw.inverse_kinematics(arm, beyond, method="numeric")
    assert numeric.at_limit[4]
    assert f"with {arm.names[4]} at its limit" in str(numeric)
    assert numeric.at_limit.sum() == 1


def test_three_positions_that_look_like_a_rotation_are_positions_where_that_is_said():
    arm = aw.load("two-link")
    assert aw.inverse_kinematics(arm, 0.5 * np.eye(3)).q.shape == (3, 2)
    found = aw.inverse_kinematics(arm, np.eye(3), aim="position")
    assert found.q.shape == (3, 2)
    assert found.success.tolist() == [True, True, False]


@pytest.mark.parametrize(
    ("pose", "word"),
    [
        (np.diag([1.0, 1.0, -1.0, 1.0]), "mirror"),
        (np.eye(4) + np.eye(4, k=-3), "transposed"),
        (np.diag([1.001, 1.0, 1.0, 1.0]), "0.002"),
        (np.full((4, 4), np.nan), "not finite"),
        (np.ones((4, 4)), "last row"),
    ],
)
def test_what_keeps_numbers_from_being_a_pose_is_said(pose, word):
    with pytest.raises(ModelError, match=word):
        aw.inverse_kinematics(aw.load("puma560"), pose)


@pytest.mark.parametrize("arm", [None, 3.5])
def test_what_is_no_arm_is_refused(arm):
    with pytest.raises(ModelError, match="an arm"):
        aw.inverse_kinematics(arm, np.eye(4))


def test_a_frame_that_no_joint_moves_is_refused():
    with pytest.raises(ModelError) as error:
        aw.inverse_kinematics(aw.load("puma560"), np.eye(4), frame="base")
    assert error.value.value == "base"


@pytest.mark.sample(13)
@pytest.mark.parametrize(
    ("targets", "options", "place"),
    [
        (np.eye(3), {"aim": "pose"}, "targets"),
        (np.zeros((2, 5)), {}, "targets"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), {}, "targets"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), {}, "targets"),
        (np.stack([np.eye(4), np.full((4, 4), np.nan)]), {}, "targets[1]"),
        ([0.1, np.inf, 0.2], {}, "targets"),
        (np.stack([np.eye(4), np.eye(4) + np.diag([0.0, 0.0, 1e-4, 0.0])]), {}, "targets[1]"),
        (np.eye(4) + np.eye(4, k=-3), {}, "targets"),
        (np.where(np.eye(4, k=3) > 0.0, -np.inf, np.eye(4)), {}, "targets"),
        (np.eye(4), {"tolerance": 0.0}, "tolerance"),
        (np.eye(4), {"tolerance": np.nan}, "tolerance"),
        (np.eye(4), {"aim": "point"}, "aim"),
        (np.eye(4), {"near": np.zeros(5)}, "near"),
        (np.eye(4), {"near": np.full(6, np.nan)}, "near"),
        (np.eye(4), {"near": np.zeros((3, 6))}, "near"),
        (np.eye(4), {"threads": 0}, "threads"),
        (None, {}, "targets"),
        ("pose", {}, "targets"),
        (np.eye(4, dtype=complex), {}, "targets"),
        ([[0.1, 0.2], [0.1, 0.2, 0.3]], {}, "targets"),
        (aw.Batch(np.zeros((2, 3))), {}, "targets"),
        (np.eye(3), {}, "targets"),
        (np.stack([np.eye(3)[[1, 2, 0]]] * 5), {}, "targets"),
        ([[0.1, 0.2, 0.3], [0.1, np.nan, 0.3]], {}, "targets[1]"),
        (np.eye(4), {"near": "home"}, "near"),
        (np.eye(4), {"near": aw.Batch(np.zeros((2, 6)))}, "near"),
    ],
)
def test_bad_input_is_named(targets, options, place):
    with pytest.raises((ModelError, ShapeError)) as error:
        aw.inverse_kinematics(aw.load("puma560"), targets, **options)
    assert error.value.place == place


@pytest.mark.parametrize(
    ("call", "place"),
    [
        (lambda arm: aw.inverse_kinematics(arm, np.eye(4), near=np.zeros((3, 6))), "near"),
        (lambda arm: aw.inverse_kinematics(arm, np.zeros((3, 6))), "targets"),
        (lambda arm: aw.kinematics.manipulability(arm, np.zeros((3, 5))), "q"),
        (lambda arm: aw.kinematics.pose_towards(np.zeros((3, 5)), [0.0, 0.0, 1.0]), "position"),
    ],
)
def test_a_wrong_shape_is_no_value(call, place):
    with raises_at(ShapeError, place, r"shape \(3, \d") as caught:
        call(aw.load("puma560"))
    assert caught.value.value is ABSENT


@pytest.mark.parametrize("name", ["puma560", "panda"])
def test_starts_fill_the_range_of_every_joint_evenly(name):
    arm = aw.load(name)
    low, high = sampled_ranges(arm)
    shares = (random_positions(arm, 2048) - low) / (high - low)
    assert ((shares >= 0.0) & (shares < 1.0)).all()
    for column in shares.T:
        counts = np.histogram(column, 8, (0.0, 1.0))[0]
        assert np.abs(counts - 256).max() <= 26  # independent numbers are as wrong as 50
    correlation = np.corrcoef(shares.T) - np.eye(arm.n)
    assert np.abs(correlation).max() < 0.1

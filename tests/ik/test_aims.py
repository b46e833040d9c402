"""Positions with a part of the orientation: solved, by another forward kinematics, and free where they say so."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armwright as aw
from armwright.errors import ModelError, ShapeError
from armwright.ik.orientation import partial_turn
from armwright.kinematics.aim import Aim
from ik.small_arms import JOINTS, forward, partly_off, samples_of, small_arm
from raises_at import raises_at

TOLERANCE = 1e-8
EVERY = ["axis", "axis x", "axis y", "pitch", "pitch x", "pitch y", "yaw", "yaw y", "yaw z"]
EVERY += [f"{frame} {axes}" for frame in ("base", "tool") for axes in ("x", "y", "z", "xy", "xz", "yz")]
PAIRS = [
    *(("pitch-4", aim) for aim in ("position", "pitch", "axis", "base z", "tool xz")),
    *(
        ("servo-5", aim)
        for aim in ("position", "pitch", "pitch x", "axis", "axis x", "yaw", "base xy", "base y", "tool z")
    ),
    *(("palletiser", aim) for aim in ("yaw", "base z", "pose")),
    *(("scara", aim) for aim in ("yaw", "yaw y", "base z", "pitch")),
    *(("puma560", aim) for aim in ("pitch", "yaw", "base z", "tool x", "base xz")),
    *(pytest.param("panda", aim, marks=pytest.mark.study) for aim in ("pitch", "axis y", "base x")),
    *(pytest.param("cmu-dd", aim, marks=pytest.mark.study) for aim in ("pitch", "yaw", "base yz")),
]


def placed(arm, name, q):
    """Positions and rotations of the tip; of arms of this folder without Armwright."""
    if name in JOINTS:
        return forward(name, q)
    poses = aw.compile(arm).forward_kinematics(q)
    return poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3])


def as_poses(at, turned):
    poses = np.broadcast_to(np.eye(4), (len(at), 4, 4)).copy()
    poses[:, :3, 3], poses[:, :3, :3] = at, turned.as_matrix()
    return poses


@pytest.mark.sample(1)
@pytest.mark.parametrize(("name", "aim"), PAIRS, ids=lambda value: value.replace(" ", "_"))
def test_reachable_targets_are_solved(name, aim, tmp_path):
    arm = small_arm(name, tmp_path) if name in JOINTS else aw.load(name)
    at, turned = placed(arm, name, samples_of(arm, 1500))
    found = aw.inverse_kinematics(arm, as_poses(at, turned), aim=aim)
    assert found.success.mean() >= 0.999
    q = found.q[found.success]
    there, how = placed(arm, name, q)
    assert np.linalg.norm(there - at[found.success], axis=1).max() <= TOLERANCE
    assert partly_off(aim, how, turned[found.success]).max() <= 2.0 * TOLERANCE  # SciPy's angles have no more digits
    low, high = np.array([body.limits.position for body in arm.coordinates]).T
    assert ((q >= low) & (q <= high)).all()
    assert found.iterations.mean() < 25.0


def test_what_is_free_is_used(tmp_path):
    """Targets that no pose of the arm meets as a whole: a part of it is met, and the rest is not."""
    arm = small_arm("pitch-4", tmp_path)
    at, turned = forward("pitch-4", samples_of(arm, 500))
    other = Rotation.from_rotvec([0.0, 0.0, 1.0] * np.random.default_rng(0).uniform(0.5, 2.0, (500, 1))) * turned
    found = aw.inverse_kinematics(arm, as_poses(at, other), aim="pitch")
    assert found.success.mean() >= 0.999
    how = forward("pitch-4", found.q)[1]
    assert (how.inv() * other).magnitude().min() > 0.1
    assert found.angle_error.max() <= TOLERANCE
    whole = aw.inverse_kinematics(arm, as_poses(at, other)[:3])
    assert not whole.success.any()
    assert (whole.angle_error > 1e-3).all()


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["pitch-4", "servo-5"])
def test_tools_that_point_straight_down(name, tmp_path):
    """Where the tool is vertical, the angle to the vertical has no slope."""
    arm, rng = small_arm(name, tmp_path), np.random.default_rng(5)
    q = samples_of(arm, 4000)
    q[:, 3] = 0.5 * np.pi - q[:, 1] - q[:, 2]  # the hand hangs
    q = q[(q[:, 3] > -1.8) & (q[:, 3] < 2.1)]
    assert len(q) > 1000
    at, _ = forward(name, q)
    down = aw.kinematics.pose_towards(at, [0.0, 0.0, -1.0])
    for aim in ("pitch", "axis"):
        found = aw.inverse_kinematics(arm, down, aim=aim)
        assert found.success.mean() >= 0.999
        assert found.iterations.mean() < 25.0
        there, how = forward(name, found.q[found.success])
        assert np.linalg.norm(there - at[found.success], axis=1).max() <= TOLERANCE
        assert np.abs(how.apply([0.0, 0.0, 1.0])[:, :2]).max() <= 2.0 * TOLERANCE
    nearly = aw.kinematics.pose_towards(
        at, np.stack([*1e-5 * rng.normal(size=(2, len(at))), -np.ones(len(at))], axis=1)
    )
    assert aw.inverse_kinematics(arm, nearly, aim="pitch").success.mean() >= 0.99


def test_what_cannot_be_reached_is_said_by_what_counts(tmp_path):
    arm = small_arm("pitch-4", tmp_path)
    high = aw.kinematics.pose_towards([[0.0, 0.0, 5.0]], [1.0, 0.0, 0.0])
    # at the end of its reach with its hand up
    stretched = aw.kinematics.pose_towards([[0.54, 0.0, 0.105]], [0.0, 0.0, 1.0])
    for target, far in ((high, 4.0), (stretched, 0.0)):
        found = aw.inverse_kinematics(arm, target, aim="pitch")
        assert not found.success.any()
        there, how = forward("pitch-4", found.q)
        np.testing.assert_allclose(found.position_error, np.linalg.norm(there - target[:, :3, 3], axis=1), atol=1e-9)
        wanted = Rotation.from_matrix(target[:, :3, :3])
        np.testing.assert_allclose(found.angle_error, partly_off("pitch", how, wanted), atol=1e-9)
        assert found.position_error[0] > far
        assert "not reached" in str(found)
    assert aw.inverse_kinematics(arm, stretched, aim="position").angle_error[0] == 0.0


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("aim", "free"),
    [
        ("axis", lambda turned, free: turned * free("z")),
        ("axis x", lambda turned, free: turned * free("x")),
        ("tool xy", lambda turned, free: turned * free("z")),
        ("base xy", lambda turned, free: free("z") * turned),
        ("base yz", lambda turned, free: free("x") * turned),
        ("pitch", lambda turned, free: free("z") * turned * free("z")),
        ("yaw", lambda turned, free: turned * free("x")),
    ],
)
def test_a_turn_about_what_is_free_changes_nothing(aim, free, tmp_path):
    arm, rng = small_arm("servo-5", tmp_path), np.random.default_rng(7)
    at, turned = forward("servo-5", samples_of(arm, 400))
    other = free(
        turned, lambda axis: Rotation.from_rotvec(rng.uniform(-3.0, 3.0, (400, 1)) * np.eye(3)["xyz".index(axis)])
    )
    q, again = (aw.inverse_kinematics(arm, as_poses(at, each), aim=aim).q for each in (turned, other))
    assert partly_off(aim, forward("servo-5", q)[1], other).max() <= 2.0 * TOLERANCE
    same = np.abs(q - again).max(axis=1) < 1e-6  # nearly always: rounding may choose another start
    assert same.mean() > 0.95


@pytest.mark.parametrize("aim", [aim for aim in EVERY if Aim.of(aim).kind != "axis"])
def test_slopes_are_those_of_differences(aim):
    part, rng, h = Aim.of(aim), np.random.default_rng(3), 1e-6
    for a, b in zip(*(Rotation.random(50, rng=rng).as_matrix() for _ in range(2)), strict=True):
        _, rows = partial_turn(part, a, b)
        for k, axis in enumerate(np.eye(3)):
            ends = [
                partial_turn(part, Rotation.from_rotvec(s * h * axis).as_matrix() @ a, b)[0][0] for s in (1.0, -1.0)
            ]
            change = np.remainder(np.subtract(*ends) + np.pi, 2.0 * np.pi) - np.pi
            np.testing.assert_allclose(
                -change / (2.0 * h), rows[0, k], rtol=1e-4, atol=1e-4 * max(1.0, np.abs(rows).max() ** 2)
            )


@pytest.mark.sample(1)
@pytest.mark.parametrize("aim", EVERY)
def test_measures_have_the_rows_that_count(aim):
    """The product of the singular values is that of J Jᵀ, J by differences of what counts about a pose that meets it."""
    arm, h = aw.load("puma560"), 1e-6
    q = np.array([0.3, -0.8, 0.4, 0.2, 0.7, 0.1])
    pose = aw.compile(arm).forward_kinematics(q)
    part = Aim.of(aim)
    ends = aw.compile(arm).forward_kinematics(q + h * np.concatenate([np.eye(6), -np.eye(6)]))
    change = (ends[:6] - ends[6:]) / (2.0 * h)
    if part.kind == "axis":  # of Rᵀ R* or R R*ᵀ, the two entries
        turns = change[:, :3, :3] @ pose[:3, :3].T if part.base else pose[:3, :3].T @ change[:, :3, :3]
        rows = [turns[:, k, part.axis] for k in part.others]
    else:
        errors = [partial_turn(part, each[:3, :3], pose[:3, :3])[0][0] for each in ends]
        rows = [np.subtract(errors[:6], errors[6:]) / (2.0 * h)]
    jacobian = np.stack([*change[:, :3, 3].T, *rows])
    found = aw.kinematics.manipulability(arm, q, aim=aim)
    np.testing.assert_allclose(found.singular_values, np.linalg.svd(jacobian, compute_uv=False), rtol=1e-6, atol=1e-8)
    assert found.singular_values.shape == (3 + part.counted,)


@pytest.mark.study
@pytest.mark.parametrize("aim", ["axis", "pitch"])
def test_several_solutions_and_goals(aim, tmp_path):
    arm = small_arm("servo-5", tmp_path)
    at, turned = forward("servo-5", samples_of(arm, 20))
    targets = as_poses(at, turned)
    many = aw.inverse_kinematics(arm, targets, aim=aim, solutions=4)
    assert many.success[:, 0].all()
    assert many.success.sum(axis=1).mean() > 1.5
    for k, row in np.argwhere(many.success):
        there, how = forward("servo-5", many.q[k, row])
        assert np.abs(there - at[k]).max() <= TOLERANCE
        assert partly_off(aim, how, turned[[k]])[0] <= 2.0 * TOLERANCE
    middle = np.array([np.mean(body.limits.position) for body in arm.coordinates])
    half = np.array([np.ptp(body.limits.position) / 2.0 for body in arm.coordinates])

    def off_middle(found):
        return (((found.q - middle) / half) ** 2).sum(axis=1)

    plain, best = (aw.inverse_kinematics(arm, targets, aim=aim, goal=goal) for goal in (None, "limits"))
    assert best.success.all()
    assert (off_middle(best) <= off_middle(plain) + 1e-9).all()
    strong = aw.inverse_kinematics(arm, targets, aim=aim, goal="manipulability")
    assert strong.success.all()
    length = 1.0
    value = [
        aw.kinematics.manipulability(arm, each.q, aim=aim, length=length).yoshikawa.mean() for each in (plain, strong)
    ]
    assert value[1] > value[0]
    near = aw.inverse_kinematics(arm, targets, aim=aim, near=samples_of(arm, 20), goal="nearest")
    assert near.success.all()


@pytest.mark.study
def test_closed_forms_are_for_whole_poses():
    arm = aw.load("puma560")
    pose = aw.compile(arm).forward_kinematics(np.array([0.3, -0.8, 0.4, 0.2, 0.7, 0.1]))
    assert aw.inverse_kinematics(arm, pose, aim="pitch").method == "numeric"
    assert aw.inverse_kinematics(arm, pose, aim="base xyz").method.startswith("closed form")
    with raises_at(ModelError, "method", "pitch x"):
        aw.inverse_kinematics(arm, pose, aim="pitch x", method="closed-form")


@pytest.mark.parametrize(
    ("word", "same"),
    [
        *(("axis z", "axis"), ("pitch z", "pitch"), ("yaw x", "yaw"), ("tool xy", "axis"), ("tool zy", "axis x")),
        *(("base yx", "base xy"), ("tool xyz", "pose"), ("base y", "base y")),
    ],
)
def test_words_that_mean_the_same(word, same):
    assert str(Aim.of(word)) == same
    assert Aim.of(word) == Aim.of(same)


@pytest.mark.parametrize(
    "word", ["", "pitch w", "axis xy", "base", "tool xx", "base xw", "pose x", "roll", 3, None, [1, 1, 1]]
)
def test_words_that_are_none(word):
    with raises_at(ModelError, "aim", "'pose', 'position', 'axis', 'pitch' or 'yaw'"):
        Aim.of(word)


def test_targets_that_cannot_be():
    arm = aw.load("puma560")
    with raises_at(ModelError, "targets[1]", "z axis is vertical"):
        aw.inverse_kinematics(arm, aw.kinematics.pose_towards(np.ones((2, 3)), [[1, 0, 0], [0, 0, 1]]), aim="yaw z")
    with pytest.raises(ShapeError, match=r"targets.*aw\.kinematics\.pose_towards"):
        aw.inverse_kinematics(arm, [0.4, 0.1, 0.3], aim="pitch")


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_poses_towards_a_direction(axis):
    rng = np.random.default_rng(2)
    at, ways = rng.normal(size=(30, 3)), rng.normal(size=(30, 3))
    ways[:6] = [*np.eye(3), *-np.eye(3)]
    poses = aw.kinematics.pose_towards(at, ways, axis)
    turn = poses[:, :3, :3]
    assert np.abs(np.swapaxes(turn, 1, 2) @ turn - np.eye(3)).max() < 1e-14
    assert (np.linalg.det(turn) > 0.0).all()
    np.testing.assert_allclose(
        turn[:, :, "xyz".index(axis)], ways / np.linalg.norm(ways, axis=1, keepdims=True), atol=1e-15
    )
    np.testing.assert_array_equal(poses[:, :3, 3], at)
    assert aw.kinematics.pose_towards([0.1, 0.2, 0.3], [0, 0, -2.0]).shape == (4, 4)


@pytest.mark.parametrize(
    ("at", "way", "axis", "place"),
    [
        ([0.0, 0.0], [0.0, 0.0, 1.0], "z", "position"),
        ([0.0] * 3, [0.0, 0.0, 0.0], "z", "direction"),
        ([0.0] * 3, [0.0, np.nan, 0.0], "z", "direction"),
        ([0.0] * 3, [[0.0, 0.0, 1.0]], "z", "direction"),
        ([0.0] * 3, [0.0, 0.0, 1.0], "w", "axis"),
    ],
)
def test_directions_that_are_none(at, way, axis, place):
    with pytest.raises((ModelError, ShapeError), match=place):
        aw.kinematics.pose_towards(at, way, axis)

"""Tool paths of which a part of the orientation counts, on arms of four and five joints."""

from __future__ import annotations

import functools
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armwright as aw
from armwright.errors import ScenarioError
from armwright.kinematics.aim import Aim
from armwright.trajectory.cartesian.turning import smooth_error, turning
from ik.small_arms import forward, partly_off, small_arm
from ik.test_aims import EVERY
from raises_at import raises_at

BENT = (0.2, 0.1, 0.9, 0.5, 0.3)
DOWN = (0.2, 0.3, 0.6, 0.5 * np.pi - 0.9, 0.3)  # the hand hangs
FLAT = {"scara": (0.3, 0.9, 0.05, 0.4), "palletiser": (0.3, 0.4, 0.5, 0.4)}


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    """Arms by name, each read once."""
    return functools.cache(lambda name: small_arm(name, tmp_path_factory.mktemp(name)))


def start_of(name, q):
    """The pose of the tool, by SciPy."""
    at, turned = forward(name, np.array(q))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turned.as_matrix()[0], at[0]
    return pose


def further(pose, way, turn=(0.0, 0.0, 0.0)):
    new = pose.copy()
    new[:3, 3] += way
    new[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ new[:3, :3]
    return new


def corner(start, turn=(0.0, 0.0, 0.0)):
    """Two lines and an arc, the corner rounded; the tool turns along the first line."""
    middle = further(start, [0.0, 0.06, 0.0], turn)
    end = middle[:3, 3] + [-0.04, 0.0, 0.03]
    arc = aw.trajectories.Arc(np.add(end, [-0.02, -0.02, 0.0]), np.add(end, [-0.02, -0.04, 0.0]))
    return aw.trajectories.CartesianPath(
        [aw.trajectories.Line(middle), aw.trajectories.Line(end), arc], start, blend=0.005
    )


CASES = [
    ("pitch-4", BENT[:4], "pitch", (0, 0, 0)),
    ("pitch-4", BENT[:4], "position", (0, 0, 0)),
    ("pitch-4", DOWN[:4], "pitch", (0, 0, 0.3)),  # the turn about the vertical is free
    ("pitch-4", DOWN[:4], "axis", (0, 0, 0)),
    ("servo-5", BENT, "pitch", (0, 0.2, 0)),
    ("servo-5", BENT, "base xy", (0, 0, 0.2)),
    ("servo-5", BENT, "tool z", (0, 0, 0.3)),
    ("servo-5", DOWN, "pitch", (0, 0, 0.3)),
    ("servo-5", DOWN, "yaw", (0, 0, 0.3)),
    ("servo-5", DOWN, "axis", (0, 0, 0.3)),
    ("scara", FLAT["scara"], "yaw", (0, 0, 0.5)),
    ("palletiser", FLAT["palletiser"], "base z", (0, 0, 0.5)),
]


@pytest.mark.sample(2)
@pytest.mark.parametrize(("name", "q", "aim", "turn"), CASES)
def test_what_counts_follows_the_path(name, q, aim, turn, arms):
    path = corner(start_of(name, q), turn)
    solution = aw.trajectories.solve_path(arms(name), path, near=q, aim=aim)
    s = np.linspace(0.0, path.length, 4001)
    joints, first, second = solution.at(s)
    at, turned = forward(name, joints)
    wanted = path.at(s)[0]
    assert np.linalg.norm(at - wanted[:, :3, 3], axis=1).max() < 1e-6
    assert partly_off(aim, turned, Rotation.from_matrix(wanted[:, :3, :3])).max() < 1e-6
    np.testing.assert_allclose(joints[0], q, atol=1e-6)
    assert (turned[1:] * turned[:-1].inv()).magnitude().max() < 0.02  # what is free goes on as well
    # derivatives are those of the positions, on both sides of each node
    middle, h = s[5:-5:7] + 1e-3 * path.length / 4000, 1e-5 * path.length
    ends = [solution.at(middle + sign * h) for sign in (1.0, -1.0)]
    np.testing.assert_allclose(
        (ends[0][0] - ends[1][0]) / (2 * h), solution.at(middle)[1], atol=1e-4 * np.abs(first).max()
    )
    away = np.abs(middle[:, None] - path.breaks).min(axis=1) > 2 * h
    slope = (ends[0][1] - ends[1][1])[away] / (2 * h)
    np.testing.assert_allclose(slope, solution.at(middle[away])[2], atol=2e-2 * np.abs(second).max())


@pytest.mark.sample(13)
@pytest.mark.parametrize("aim", EVERY)
def test_rates_are_those_of_differences(aim):
    """Frame and target that move so that the error stays 0 to second order, found by differences of its own definition."""
    part, kernel, rng = Aim.of(aim), turning(Aim.of(aim)), np.random.default_rng(4)
    for _ in range(5):
        target, (w, dw, tw, tdw) = Rotation.random(rng=rng), rng.normal(size=(4, 3))
        axis = np.eye(3)[part.axis]
        free = Rotation.from_rotvec(rng.uniform(-1.0, 1.0) * axis)
        if part.kind in ("axis", "twist"):  # a rotation that meets it
            swing = Rotation.from_rotvec(
                np.delete(np.ones(3), part.axis) @ np.delete(np.eye(3), part.axis, axis=0) * 0.4
            )
            free = swing if part.kind == "twist" else free
            frame = free * target if part.base else target * free
        else:
            frame = Rotation.from_rotvec([0.0, 0.0, 0.7 * (part.kind == "pitch")]) * target * free
        r, rows, asked, change = (
            each[0]
            for each in kernel(*(each[None] for each in (frame.as_matrix(), w, dw, target.as_matrix(), tw, tdw)))
        )
        assert np.abs(r).max() < 1e-12

        def error(step, frame=frame, target=target, w=w, dw=dw, tw=tw, tdw=tdw):
            moved = [
                each.as_matrix() + (step * skew(v) + step**2 / 2 * (skew(a) + skew(v) @ skew(v))) @ each.as_matrix()
                for each, v, a in ((frame, w, dw), (target, tw, tdw))
            ]
            return smooth_error(part, moved[0], moved[1], target.as_matrix())

        h = 1e-4
        np.testing.assert_allclose(
            (error(h) - error(-h)) / (2 * h), asked - rows @ w, atol=1e-5 * (1 + np.abs(asked).max() ** 3)
        )
        np.testing.assert_allclose(
            (error(h) - 2 * error(0) + error(-h)) / h**2, change, rtol=1e-3, atol=1e-2 * (1 + np.abs(change).max())
        )


def skew(a):
    return np.cross(np.eye(3), a)


def test_a_whole_pose_is_refused_where_an_axis_is_kept(arms):
    arm, start = arms("servo-5"), start_of("servo-5", DOWN)
    path = aw.trajectories.CartesianPath(
        [aw.trajectories.Line(further(start, [0.0, 0.06, 0.0], [0.4, 0.0, 0.0]))], start
    )
    assert aw.trajectories.solve_path(arm, path, near=DOWN, aim="yaw").deviation[1] < 1e-6
    with raises_at(ScenarioError, re.compile("path at s = .*"), " mm and .* mrad"):
        aw.trajectories.solve_path(arm, path, near=DOWN, aim="axis")  # the hand swings in one plane only
    four, begin = arms("pitch-4"), start_of("pitch-4", BENT[:4])
    line = aw.trajectories.CartesianPath([aw.trajectories.Line(begin[:3, 3] + [0.0, 0.06, 0.0])], begin)
    with raises_at(ScenarioError, re.compile("path at s = .*"), "of reach"):
        aw.trajectories.solve_path(four, line, near=BENT[:4])
    assert aw.trajectories.solve_path(four, line, aim="pitch").deviation[1] < 1e-6
    with raises_at(ScenarioError, re.compile("path at s = 0 .*"), "z axis .* yaw"):
        aw.trajectories.solve_path(arm, path, near=DOWN, aim="yaw z")


def test_limits_of_the_tool_count_what_turns_freely(arms):
    """The turn that a path leaves free is the tool's: its limit of angular speed slows the motion, and is kept."""
    arm, start = arms("pitch-4"), start_of("pitch-4", BENT[:4])
    path = aw.trajectories.CartesianPath([aw.trajectories.Line(start[:3, 3] + [0.0, 0.12, 0.0])], start)
    limits = aw.trajectories.MotionLimits.of(arm, velocity=2.0, acceleration=20.0, jerk=400.0)
    options = {"speed": 0.1, "acceleration": 1.0, "limits": limits}
    solution = aw.trajectories.solve_path(arm, path, near=BENT[:4], aim="pitch", limits=limits)
    free = aw.trajectories.follow_path(arm, solution, **options)
    for slow in ("everywhere", "where needed"):
        bound = aw.trajectories.follow_path(
            arm, solution, **options, tool=aw.trajectories.ToolLimits(angular_speed=0.3), slow=slow
        )
        assert bound.duration > 1.2 * free.duration
        assert "the tool's angular speed would be" in str(bound.stretches[0])
        t = np.linspace(0.0, bound.duration, 4001)
        turned = forward("pitch-4", bound.at(t)[0])[1]
        rate = (turned[1:] * turned[:-1].inv()).magnitude() / np.diff(t)
        assert 0.28 < rate.max() < 0.3 * (1.0 + 1e-3)
    q, qd, qdd = free.at(np.linspace(0.0, free.duration, 2001))
    assert (np.abs(qd) <= limits.velocity * (1.0 + 1e-6)).all()
    assert (np.abs(qdd) <= limits.acceleration * (1.0 + 1e-6)).all()
    low, high = limits.position.T
    assert ((q >= low) & (q <= high)).all()


def test_a_turn_in_place_that_does_not_count_is_refused(arms):
    arm, start = arms("servo-5"), start_of("servo-5", DOWN)
    path = aw.trajectories.CartesianPath(
        [
            aw.trajectories.Line(further(start, [0, 0, 0], [0, 0, 0.5])),
            aw.trajectories.Line(start[:3, 3] + [0, 0.03, 0]),
        ],
        start,
    )
    with raises_at(ScenarioError, re.compile("path at s = 0 .*"), "no joint .* aim = 'axis'"):
        aw.trajectories.solve_path(arm, path, near=DOWN, aim="axis")
    assert aw.trajectories.solve_path(arm, path, near=DOWN, aim="yaw").deviation[1] < 1e-6

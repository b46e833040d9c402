"""Tool paths: lines, arcs, circles and blends against closed forms, SciPy's SLERP and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation, Slerp

import armwright as aw
from armwright.errors import ScenarioError
from armwright.trajectory.cartesian.rotations import body_rates


def pose(position, turn=(0.0, 0.0, 0.0)):
    """A pose from a position and a rotation vector."""
    matrix = np.eye(4)
    matrix[:3, 3], matrix[:3, :3] = position, Rotation.from_rotvec(turn).as_matrix()
    return matrix


START = pose([0.3, -0.2, 0.4], [0.2, 0.1, -0.3])
MIXED = [
    aw.trajectories.Line(pose([0.5, -0.2, 0.4], [0.5, 0.3, 0.1])),
    aw.trajectories.Arc([0.6, 0.0, 0.45], pose([0.5, 0.2, 0.4], [0.0, 0.3, 0.4])),
    aw.trajectories.Poses([pose([0.3, 0.2, 0.6], [0.3, 0.0, 0.4]), [0.3, -0.1, 0.6]]),
    aw.trajectories.Circle([0.2, -0.1, 0.6], [0.0, 0.0, 1.0], -1.5 * np.pi, turns=True),
]
STILL = pose([0.3, -0.2, 0.4])


def angles(a, b):
    """Angles (k,) between rotations (k, 3, 3)."""
    return Rotation.from_matrix(a @ np.swapaxes(b, 1, 2)).magnitude()


def test_a_line_is_straight_and_its_rotation_is_slerp():
    goal = pose([0.5, 0.1, 0.2], [1.0, -0.7, 2.0])
    path = aw.trajectories.CartesianPath([aw.trajectories.Line(goal)], START)
    assert path.length == pytest.approx(np.linalg.norm(goal[:3, 3] - START[:3, 3]), rel=1e-15)
    share = np.linspace(0.0, 1.0, 101)
    poses = path.at(share * path.length)[0]
    np.testing.assert_allclose(poses[:, :3, 3], START[:3, 3] + share[:, None] * (goal - START)[:3, 3], atol=1e-15)
    slerp = Slerp([0.0, 1.0], Rotation.from_matrix([START[:3, :3], goal[:3, :3]]))
    assert angles(poses[:, :3, :3], slerp(share).as_matrix()).max() < 1e-14


@pytest.mark.parametrize("turns", [False, True])
def test_a_circle_is_the_closed_form(turns):
    centre, angle = START[:3, 3] + [0.1, 0.0, 0.2], 3.0
    normal = np.cross(START[:3, 3] - centre, [0.0, 1.0, 0.0])
    path = aw.trajectories.CartesianPath([aw.trajectories.Circle(centre, normal, angle, turns)], START)
    turn = Rotation.from_rotvec(np.linspace(0.0, angle, 50)[:, None] * normal / np.linalg.norm(normal))
    poses, first, second = path.at(np.linspace(0.0, path.length, 50))
    radius = np.hypot(0.1, 0.2)
    np.testing.assert_allclose(poses[:, :3, 3], centre + turn.apply(START[:3, 3] - centre), atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(second[:, :3], axis=1), 1.0 / radius, rtol=1e-13)
    expected = turn.as_matrix() @ START[:3, :3] if turns else np.broadcast_to(START[:3, :3], (50, 3, 3))
    assert angles(poses[:, :3, :3], expected).max() < 1e-14
    np.testing.assert_allclose(np.linalg.norm(first[:, 3:], axis=1), turns / radius, atol=1e-13)


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.95))
def test_an_arc_passes_three_points_of_the_circle_that_they_lie_on(seed, share):
    rng = np.random.default_rng(seed)
    frame, angle = Rotation.random(rng=rng).as_matrix(), rng.uniform(0.1, 6.0)
    centre, radius = rng.uniform(-1.0, 1.0, 3), rng.uniform(0.01, 2.0)
    begin, through, end = (centre + radius * frame @ [np.cos(a), np.sin(a), 0.0] for a in (0.0, share * angle, angle))
    path = aw.trajectories.CartesianPath([aw.trajectories.Arc(through, end)], pose(begin))
    assert path.length == pytest.approx(radius * angle, rel=1e-7)
    points = path.at(np.array([0.0, share, 1.0]) * radius * angle)[0][:, :3, 3]
    np.testing.assert_allclose(points, [begin, through, end], atol=1e-7 * radius)


def test_derivatives_are_those_of_the_pose_and_the_length_is_the_arc_length():
    path = aw.trajectories.CartesianPath(MIXED, START, blend=0.01, blend_angle=0.1)
    assert len(path.runs) == 1  # nothing stops
    s, h = np.linspace(1e-3, path.length - 1e-3, 3001), 1e-6
    (before, low, _), (_, first, second), (after, high, _) = (path.at(s + k * h) for k in (-1, 0, 1))
    np.testing.assert_allclose((after - before)[:, :3, 3] / (2.0 * h), first[:, :3], atol=1e-8)
    turn = Rotation.from_matrix(after[:, :3, :3] @ np.swapaxes(before[:, :3, :3], 1, 2)).as_rotvec()
    np.testing.assert_allclose(turn / (2.0 * h), first[:, 3:], atol=1e-7)
    np.testing.assert_allclose((high - low) / (2.0 * h), second, atol=1e-5 * np.abs(second).max())
    np.testing.assert_allclose(np.linalg.norm(first[:, :3], axis=1), 1.0, atol=1e-14)


def test_blends_are_twice_continuous_in_position_and_rotation():
    path = aw.trajectories.CartesianPath(MIXED, START, blend=0.01, blend_angle=0.1)
    inner = path.breaks[1:-1]
    before, after = path.at(inner), path.at(inner + 1e-12)
    for a, b, scale in zip(before, after, (1.0, 1.0, 100.0), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-8 * scale)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.floats(1e-4, 0.05), st.booleans())
def test_a_blend_passes_its_corner_at_the_stated_distance(seed, distance, arc):
    rng = np.random.default_rng(seed)
    goals = [pose(rng.uniform(-1.0, 1.0, 3), rng.uniform(-0.5, 0.5, 3)) for _ in range(2)]
    segments = [
        aw.trajectories.Line(goals[0]),
        aw.trajectories.Arc(rng.uniform(-1, 1, 3), goals[1]) if arc else aw.trajectories.Line(goals[1]),
    ]
    sharp = aw.trajectories.CartesianPath(segments, pose([0.0, 0.0, 0.0]))
    path = aw.trajectories.CartesianPath(segments, pose([0.0, 0.0, 0.0]), blend=distance, blend_angle=0.2)
    if len(path.runs) == 2:
        assert len(path.breaks) == 3  # it turns back, and stops
        return
    corner = goals[0]
    s = np.linspace(path.breaks[1], path.breaks[2], 2001)
    blended = path.at(s)[0]
    away = np.linalg.norm(blended[:, :3, 3] - corner[:3, 3], axis=1).min()
    turned = angles(blended[:, :3, :3], np.broadcast_to(corner[:3, :3], (len(s), 3, 3))).min()
    assert away <= distance * (1.0 + 1e-4)
    assert turned <= 0.2 * (1.0 + 1e-4)
    short = min(sharp.breaks[1], sharp.length - sharp.breaks[1])
    taken = sharp.breaks[1] - path.breaks[1]
    as_far = abs(away / distance - 1.0) < 1e-3 or abs(turned / 0.2 - 1.0) < 1e-3
    assert as_far or taken == pytest.approx(0.5 * short, rel=1e-6)
    dense = sharp.at(np.linspace(0.0, sharp.length, 4001))[0][:, :3, 3]  # nowhere is it further from the sharp path
    gaps = np.linalg.norm(blended[::40, None, :3, 3] - dense, axis=2).min(axis=1)
    assert gaps.max() <= distance + sharp.length / 4000


def test_lines_that_meet_without_blend_or_turn_back_stop():
    out, back = [0.5, -0.2, 0.4], [0.35, -0.2, 0.41]
    assert (
        len(
            aw.trajectories.CartesianPath(
                [aw.trajectories.Line(out), aw.trajectories.Line([0.5, 0.0, 0.4])], STILL
            ).runs
        )
        == 2
    )
    assert (
        len(
            aw.trajectories.CartesianPath(
                [aw.trajectories.Line(out), aw.trajectories.Line(back)], STILL, blend=0.01
            ).runs
        )
        == 2
    )
    assert (
        len(
            aw.trajectories.CartesianPath(
                [aw.trajectories.Line(out), aw.trajectories.Line([0.7, -0.2, 0.4])], STILL
            ).runs
        )
        == 1
    )  # straight on
    turn = [
        aw.trajectories.Line(out),
        aw.trajectories.Line(pose(out, [0.0, 0.0, 1.0])),
        aw.trajectories.Line(pose(back, [0.0, 0.0, 1.0])),
    ]
    path = aw.trajectories.CartesianPath(turn, STILL, blend=0.01)
    np.testing.assert_allclose(path.runs, [(0.0, 0.2), (0.2, 1.2), (1.2, 1.2 + np.hypot(0.15, 0.01))])


def test_rates_of_a_rotation_vector_are_the_same_by_series_and_closed_form():
    rng = np.random.default_rng(0)
    direction = rng.standard_normal((200, 3))
    phi = 0.01 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    first, second = rng.standard_normal((2, 200, 3))
    below, above = (body_rates(phi * (1.0 + k), first, second) for k in (-1e-9, 1e-9))
    for a, b in zip(below, above, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-7)


@pytest.mark.parametrize(
    ("make", "place"),
    [
        (lambda: aw.trajectories.CartesianPath([], START), "CartesianPath.segments"),
        (lambda: aw.trajectories.CartesianPath([3], START), "segments[0]"),
        (lambda: aw.trajectories.CartesianPath([aw.trajectories.Line(START)], START), "segments[0]"),
        (lambda: aw.trajectories.CartesianPath([aw.trajectories.Line(START[:3, 3])], START), "segments[0]"),
        (
            lambda: aw.trajectories.CartesianPath([aw.trajectories.Line([1.0, 0.0, 0.0])], START, blend=-1.0),
            "CartesianPath.blend",
        ),
        (
            lambda: aw.trajectories.CartesianPath([aw.trajectories.Line([1.0, 0.0, 0.0])], [0.0, 0.0, 0.0]),
            "CartesianPath.start",
        ),
        (lambda: aw.trajectories.Line(np.diag([1.0, 1.0, 2.0, 1.0])), "Line.goal"),
        (lambda: aw.trajectories.Line([np.nan, 0.0, 0.0]), "Line.goal"),
        (lambda: aw.trajectories.Line("there"), "Line.goal"),
        (
            lambda: aw.trajectories.CartesianPath([aw.trajectories.Line(pose([1, 0, 0], [np.pi, 0, 0]))], STILL),
            "segments[0]",
        ),
        (
            lambda: aw.trajectories.CartesianPath([aw.trajectories.Arc([0.4, -0.2, 0.4], [0.5, -0.2, 0.4])], STILL),
            "segments[0]",
        ),
        (
            lambda: aw.trajectories.CartesianPath([aw.trajectories.Circle([0.4, 0.2, 0.4], [1.0, 0.0, 0.0])], STILL),
            "segments[0]",
        ),
        (lambda: aw.trajectories.Circle([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]), "Circle.normal"),
        (lambda: aw.trajectories.Circle([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.0), "Circle.angle"),
        (
            lambda: aw.trajectories.CartesianPath([aw.trajectories.Poses([[0.5, 0, 0], [0.5, 0, 0]])], STILL),
            "segments[0].poses[1]",
        ),
        (lambda: aw.trajectories.Poses([]), "Poses.poses"),
        (lambda: aw.trajectories.Poses(3), "Poses.poses"),
    ],
)
def test_paths_that_are_none_are_refused(make, place):
    with pytest.raises(ScenarioError) as error:
        make()
    assert error.value.place == place

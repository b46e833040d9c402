"""Limits of velocity and acceleration over whole cells: closed forms, toppra, limits between grid points, time to plan."""

import time
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

import armwright as aw
from armwright.errors import ScenarioError
from armwright.trajectory.limits import MotionLimits
from raises_at import raises_at
from trajectory.path_problems import by_toppra, largest_use

ARM = aw.load("puma560")


def limits_of(velocity: Any = np.inf, acceleration: Any = np.inf) -> MotionLimits:
    return MotionLimits.of(
        ARM, velocity=velocity, acceleration=acceleration, jerk=np.inf, torque=np.inf, voltage=np.inf, position=1e6
    )


def turns(count: int, seed: int = 0) -> np.ndarray:
    """(count, n) poses drawn at random, one far from the next."""
    return np.random.default_rng(seed).uniform(-1.5, 1.5, (count, ARM.n))


def test_a_straight_line_is_gone_with_full_acceleration_forth_and_back() -> None:
    way = np.array([0.3, -0.2, 0.6, 0.0, 0.1, -0.05])
    motion = aw.trajectories.time_optimal(ARM, [0.0 * way, way], limits_of(acceleration=2.0))
    assert motion.duration == pytest.approx(2.0 * np.sqrt(0.6 / 2.0), rel=1e-9)
    middle = 0.5 * motion.duration
    np.testing.assert_allclose(motion.at(0.3)[1], 0.3 * 2.0 * way / 0.6, atol=1e-9)
    np.testing.assert_allclose(motion.at(np.array([0.9, 1.1]) * middle)[2][:, 2], [2.0, -2.0], rtol=1e-9)


def test_a_straight_line_with_a_speed_limit_is_a_trapezoid() -> None:
    way = np.array([0.3, -0.2, 0.6, 0.0, 0.1, -0.05])
    motion = aw.trajectories.time_optimal(ARM, [0.0 * way, way], limits_of(0.5, 2.0))
    assert motion.duration == pytest.approx(0.6 / 0.5 + 0.5 / 2.0, rel=1e-4)
    assert motion.duration >= 0.6 / 0.5 + 0.5 / 2.0 - 1e-12
    assert motion.saturated > 0.99


def test_a_circle_is_gone_at_the_speed_of_its_centripetal_acceleration() -> None:
    """|q''| x ≤ a where two joints go around: x = a / r for either at its turn, where its q' is 0."""
    angle = np.linspace(0.0, 4.0 * np.pi, 161)
    points = np.zeros((len(angle), ARM.n))
    points[:, 0], points[:, 1] = np.cos(angle), np.sin(angle)
    path = aw.trajectories.JointPath(points, angle)
    limits = limits_of(acceleration=[3.0, 3.0, 1.0, 1.0, 1.0, 1.0])
    motion = aw.trajectories.time_optimal(ARM, path, limits)
    turning = np.abs(motion.s / (0.5 * np.pi) - np.round(motion.s / (0.5 * np.pi))) < 1e-3
    inner = turning & (motion.s > 3.0) & (motion.s < 9.5)
    np.testing.assert_allclose(motion.x[inner], 3.0, rtol=2e-3)


@pytest.mark.study
@given(st.integers(0, 10**6), st.integers(2, 12))
@settings(max_examples=25, deadline=None)
def test_no_limit_is_exceeded_between_grid_points(seed: int, count: int) -> None:
    draw = np.random.default_rng(seed)
    velocity, acceleration = draw.uniform(0.3, 4.0, ARM.n), draw.uniform(0.5, 20.0, ARM.n)
    if seed % 3 == 0:
        velocity[draw.integers(0, ARM.n)] = np.inf
    points = turns(count, seed) * (draw.random(ARM.n) < 0.8)
    points[:, 0] += np.arange(count)
    limits = limits_of(velocity, acceleration)
    motion = aw.trajectories.time_optimal(ARM, points, limits, grid=int(draw.integers(10, 200)))
    assert motion.excess <= 1e-9
    assert largest_use(ARM, motion, limits) <= 1.0 + 1e-9
    assert aw.trajectories.limits_report(ARM, motion, limits).kept


@pytest.mark.parametrize("count", [3, 20])
@pytest.mark.sample(1)
def test_the_duration_is_that_of_toppra(count: int) -> None:
    path, limits = aw.trajectories.JointPath(turns(count, 3)), limits_of(2.0, 5.0)
    motion = aw.trajectories.time_optimal(ARM, path, limits)
    ways = np.diff(path.parameter)[:, None] * np.arange(100) / 100.0
    grid = np.append((path.parameter[:-1, None] + ways).ravel(), path.length)
    expected = by_toppra(ARM, path, limits, grid)
    assert motion.duration == pytest.approx(expected, rel=3e-3)


def test_the_time_to_plan_grows_with_the_number_of_waypoints() -> None:
    limits = limits_of(2.0, 5.0)

    def cpu(count: int) -> float:
        points, taken = turns(count), []
        for _ in range(4):
            begin = time.process_time()
            aw.trajectories.time_optimal(ARM, points, limits)
            taken.append(time.process_time() - begin)
        return min(taken) / count

    assert cpu(1600) < 3.0 * cpu(200)


def test_speeds_at_the_ends_are_kept_and_too_high_ones_named() -> None:
    points, limits = turns(6), limits_of(2.0, 5.0)
    usual = aw.trajectories.time_optimal(ARM, points, limits)
    flying = aw.trajectories.time_optimal(ARM, points, limits, speeds=(0.2, 0.3))
    assert flying.duration < usual.duration
    np.testing.assert_allclose(np.sqrt(flying.x[[0, -1]]), [0.2, 0.3])
    for end, speeds in ((0, (50.0, 0.0)), (1, (0.0, 50.0))):
        with raises_at(ScenarioError, f"speeds[{end}]", r"[\d.]+ or less") as caught:
            aw.trajectories.time_optimal(ARM, points, limits, speeds=speeds)
        highest = float(caught.value.expected.split()[0])
        aw.trajectories.time_optimal(ARM, points, limits, speeds=tuple(0.999 * highest * (np.arange(2) == end)))


def test_the_motion_is_its_polynomial() -> None:
    motion = aw.trajectories.time_optimal(ARM, turns(4), limits_of(2.0, 5.0), grid=30)
    t = np.linspace(-0.1, motion.duration + 0.1, 301)
    for found, expected in zip(motion.at(t), motion.polynomial.at(t), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())

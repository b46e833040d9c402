"""Bounds of path accelerations: at them exactly one joint is at a limit, through friction, back EMF and lossy gears."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import armwright as aw
from armwright.trajectory.time_optimal.constraints import PathLimits
from physics.arms import arm as built_arm
from trajectory.path_problems import random_path, reachable_limits

ARMS = ("cmu-dd", "panda", "puma560", "workshop", "rough", "sprung")


@pytest.mark.parametrize("name", ARMS)
def test_a_limit_is_reached_at_the_bounds_and_none_is_exceeded_between(name: str) -> None:
    arm = built_arm(name)
    path = random_path(arm, 3)
    limits = reachable_limits(arm, path, 1)
    points = PathLimits.at(aw.compile(arm), limits, path, np.linspace(0.0, path.length, 41))
    shares = {each: np.ones(points.q.shape) for each in ("velocity", "acceleration", "torque", "voltage")}
    low, high = points.bounds(np.zeros((41, 1)), shares)
    fast = np.median(high - low) * path.length
    x = np.geomspace(1e-5, 0.3, 41 * 6).reshape(6, 41).T * fast
    low, high = points.bounds(x, shares)
    allowed = low < high
    assert 0.2 < allowed.mean() < 1.0

    def largest(part: float) -> np.ndarray:
        used = points.used(x, low + part * (high - low))
        return np.max([np.abs(each).max(axis=-1) for name, each in used.items() if name != "velocity"], axis=0)[allowed]

    np.testing.assert_allclose(largest(0.0), 1.0, rtol=1e-8)
    np.testing.assert_allclose(largest(1.0), 1.0, rtol=1e-8)
    assert (largest(0.5) < 1.0).all()
    assert (largest(1.001) > 1.0).all()
    assert (largest(-0.001) > 1.0).all()


@pytest.mark.parametrize("name", ARMS)
def test_tangents_touch_the_bounds_and_follow_them_for_a_little_way(name: str) -> None:
    arm = built_arm(name)
    path = random_path(arm, 3)
    points = PathLimits.at(aw.compile(arm), reachable_limits(arm, path, 1), path, np.linspace(0.0, path.length, 41))
    shares = {each: np.ones(points.q.shape) for each in ("velocity", "acceleration", "torque", "voltage")}
    low, high = points.bounds(np.zeros((41, 1)), shares)
    x = np.full(41, 1e-3 * np.median(high - low) * path.length)
    a, b, c = points.tangents(x, shares, 1e-9 * x.max())
    for beside, close in ((1.0, 1e-4), (1.02, 1e-3)):
        for bound in points.bounds(beside * x[:, None], shares):
            left = (c - b * beside * x[:, None] - a * bound) / np.abs(a * (high - low)).max(axis=1, keepdims=True)
            np.testing.assert_allclose(left.min(axis=1), 0.0, atol=close)


@pytest.mark.filterwarnings("error")
def test_where_a_joint_with_a_lossy_gear_turns_it_bounds_nothing() -> None:
    """Its torque does not depend on s̈ there: the quill of a SCARA at the middle of its way, where it goes back."""
    arm = aw.load(Path(__file__).parents[3] / "examples" / "scara.toml")
    limits = aw.trajectories.MotionLimits.of(arm, torque=[30.0, 20.0, 200.0, 5.0])
    ways = [[0.0, 0.2, 0.05, 0.0], [0.5, 0.2, 0.12, 0.3], [1.0, 0.2, 0.05, 0.6]]
    motion = aw.trajectories.time_optimal(arm, ways, limits, grid=60)
    assert aw.trajectories.limits_report(arm, motion, limits).kept
    assert motion.saturated > 0.9


def test_velocity_limits_bound_x() -> None:
    arm = aw.load("panda")
    path = random_path(arm, 0)
    limits = reachable_limits(arm, path, 0).replace(velocity=2.0)
    points = PathLimits.at(aw.compile(arm), limits, path, np.linspace(0.0, path.length, 11))
    half = {"velocity": np.full(points.q.shape, 0.5)}
    speeds = np.abs(points.first) * np.sqrt(points.largest_x(half))[:, None]
    np.testing.assert_allclose(speeds.max(axis=1), 1.0)


@pytest.mark.parametrize("name", ["workshop", "rough"])
def test_rounding_bounds_no_speed_where_a_joint_accelerates_without_torque(name: str) -> None:
    """Where M q' goes through 0, a lossy gear's own torque grows almost not with s̈."""
    arm = built_arm(name)
    path = random_path(arm, 3)
    dyn, limits = aw.compile(arm), reachable_limits(arm, path, 1)

    def points(s: np.ndarray) -> PathLimits:
        return PathLimits.at(dyn, limits, path, s)

    s = np.linspace(0.0, path.length, 401)
    inertia = points(s)._inertia[:, 0]
    places = [
        brentq(lambda at, joint=joint: points(np.array([at]))._inertia[0, 0, joint], s[k], s[k + 1], xtol=1e-9)
        for k, joint in np.argwhere(inertia[:-1] * inertia[1:] < 0.0)
    ]
    near = points(np.array(places))
    shares = {each: np.ones(near.q.shape) for each in ("velocity", "acceleration", "torque", "voltage")}
    _, b, c = near.torque_tangents(np.full(len(places), 0.1), shares, 1e-9)
    assert len(places) > 3
    assert np.abs(c).max() < 1e8 * limits.torque.max()
    assert np.abs(b).max() < 1e8 * limits.torque.max()

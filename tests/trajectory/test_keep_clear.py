"""Distances as a constraint of planning: the least one along a curve, paths that come too near, solutions that do not."""

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from armwright.trajectory.keep_clear import nearest_along
from physics.arms import arm
from raises_at import raises_at
from trajectory.cartesian.test_follow import corner
from trajectory.path_problems import HOME, random_path

BALL = aw.collision.SphereObstacle(0.1, (0.4, -0.5, 0.6), name="ball")


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_least_distance_is_found_between_the_places(seed):
    path, clear = random_path(arm("puma560"), seed), aw.collision.clearance(arm("puma560"), BALL, radius=0.04)
    found, s = nearest_along(clear, lambda s: path.at(s)[0], np.linspace(0.0, path.length, 60))
    dense = np.linspace(0.0, path.length, 100_001)
    expected = clear.nearest(path.at(dense)[0])
    assert found.distance <= expected.distance + 1e-6
    assert found.distance == pytest.approx(expected.distance, abs=1e-4)
    assert found.pair == expected.pair
    assert clear.distances(path.at(s)[0]).min() == pytest.approx(found.distance, abs=1e-12)


def test_a_path_that_comes_too_near_is_not_planned():
    model, path = arm("puma560"), random_path(arm("puma560"), 1)
    found, s = nearest_along(
        aw.collision.clearance(model, BALL, radius=0.04), lambda s: path.at(s)[0], np.linspace(0.0, path.length, 2000)
    )
    enough, more = (
        aw.collision.clearance(model, BALL, radius=0.04, least=max(found.distance + way, 0.0)) for way in (-1e-3, 1e-3)
    )
    assert found.distance > 1e-3
    limits = aw.trajectories.MotionLimits.of(model, velocity=2.0, acceleration=5.0, torque=np.inf, voltage=np.inf)
    motion = aw.trajectories.time_optimal(model, path, limits, grid=30, clearance=enough)
    with raises_at(
        ScenarioError, f"path at s = {s:.6g} of {path.length:.6g}", f"{1e3 * found.distance:.4g} mm"
    ) as caught:
        aw.trajectories.time_optimal(model, path, limits, grid=30, clearance=more)
    assert caught.value.place == f"path at s = {s:.6g} of {path.length:.6g}"
    assert all(name in caught.value.what for name in found.pair)
    nearest, t = aw.trajectories.check_clearance(model, motion, enough)
    assert nearest.distance == pytest.approx(found.distance, abs=1e-4)
    with raises_at(ScenarioError, "motion", f" mm .* {t:.4g}"):
        aw.trajectories.check_clearance(model, motion, more)


@pytest.mark.study
def test_a_tool_path_takes_the_solution_that_keeps_its_distance():
    model, path = arm("lwa4p"), corner("lwa4p")
    usual = aw.trajectories.solve_path(model, path)
    upper_arm = next(c for c in aw.collision.clearance(model, radius=0.04).capsules if c.body == 1)
    placed = aw.forward_kinematics(model, usual.at(0.5 * path.length)[0], frame=upper_arm.link)
    middle = (placed @ [*(0.3 * upper_arm.a + 0.7 * upper_arm.b), 1.0])[:3]  # of the usual solution's upper arm
    post = aw.collision.SphereObstacle(0.03, middle, name="post")
    clear = aw.collision.clearance(model, post, radius=0.04, least=0.01)
    assert clear.nearest(usual.at(np.linspace(0.0, path.length, 200))[0]).distance < 0.0
    other = aw.trajectories.solve_path(model, path, clearance=clear)
    assert clear.nearest(other.at(np.linspace(0.0, path.length, 3000))[0]).distance >= 0.01
    motion = aw.trajectories.follow_path(model, other, 0.1, 1.0)
    np.testing.assert_allclose(motion.at(0.0)[0], other.at(0.0)[0])
    with pytest.raises(ScenarioError, match=r"post .* [\d.]+ mm; .* 10 mm") as caught:
        aw.trajectories.solve_path(model, path, near=usual.at(0.0)[0], clearance=clear)
    assert caught.value.place.startswith("path at s = ")


def test_the_clearance_of_another_arm_is_refused():
    other, path = aw.collision.clearance(arm("lwa4p"), radius=0.05), corner("puma560")
    free = aw.trajectories.MotionLimits.of(arm("puma560"), acceleration=5.0, torque=np.inf, voltage=np.inf)
    for call in (
        lambda: aw.trajectories.solve_path(arm("puma560"), path, near=HOME["puma560"], clearance=other),
        lambda: aw.trajectories.time_optimal(arm("puma560"), random_path(arm("puma560"), 0), free, clearance=other),
        lambda: aw.trajectories.check_clearance(arm("puma560"), aw.trajectories.Step(np.zeros(6), np.ones(6)), other),
        lambda: aw.trajectories.check_clearance(arm("puma560"), aw.trajectories.Step(np.zeros(6), np.ones(6)), 0.01),
    ):
        with raises_at(ScenarioError, "clearance", "puma560"):
            call()
    with pytest.raises(ScenarioError, match="least = -1"):
        aw.collision.clearance(arm("puma560"), radius=0.05, least=-1)

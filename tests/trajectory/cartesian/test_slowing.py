"""The tool's speed where limits do not allow the one that is asked for: slower there alone, and said where."""

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from physics.arms import arm
from trajectory.cartesian.test_follow import corner, home, moved, wrist_path
from trajectory.path_problems import HOME, largest_use

SPEED = 0.1


@pytest.fixture(scope="module")
def past_a_singularity():
    """A line that passes a singular wrist at 1 cm, at full speed but for its middle."""
    limits = aw.trajectories.MotionLimits.of(
        arm("puma560"), velocity=2.0, acceleration=40.0, torque=np.inf, voltage=np.inf
    )
    motions = [
        aw.trajectories.follow_path(arm("puma560"), wrist_path(0.01), SPEED, 2.0, limits=limits, slow=slow)
        for slow in ("everywhere", "where needed")
    ]
    return limits, *motions


def test_the_speed_is_kept_but_where_a_joint_is_at_its_limit(past_a_singularity):
    limits, slow, local = past_a_singularity
    t = np.linspace(0.0, local.duration, 20_001)
    s, speed = (each[:, 0] for each in local.profile.at(t)[:2])
    share = np.abs(local.at(t)[1] / limits.velocity).max(axis=1)
    assert speed.max() <= SPEED * (1.0 + 1e-9)
    free = ((s > 0.02) & (s < 0.05)) | ((s > 0.15) & (s < 0.18))
    np.testing.assert_allclose(speed[free], SPEED, rtol=1e-6)
    middle = np.abs(s - 0.1) < 0.01
    assert share[middle].min() > 0.98  # no slower than the joint's limit asks for
    assert largest_use(arm("puma560"), local, limits) <= 1.0 + 1e-6
    assert local.duration < 0.6 * slow.duration


def test_where_and_by_how_much_the_speed_is_too_high_is_said(past_a_singularity):
    limits, slow, local = past_a_singularity
    s = np.linspace(0.03, 0.17, 20_001)  # at full speed between its ramps
    needed = SPEED * np.abs(local.solution.at(s)[1] / limits.velocity).max(axis=1)
    (stretch,) = local.stretches
    assert stretch.begin == pytest.approx(s[needed > 1.0][0], abs=1e-3)
    assert stretch.end == pytest.approx(s[needed > 1.0][-1], abs=1e-3)
    assert stretch.slower == pytest.approx(needed.max(), rel=1e-3)
    assert f"{stretch.slower:.3g} times too fast, joint 'wrist_roll' would need" in str(stretch)
    assert slow.stretches == local.stretches
    assert slow.slowed == pytest.approx(local.slowed, rel=1e-6) == pytest.approx(stretch.slower, rel=1e-3)


@pytest.mark.sample(1)
@pytest.mark.parametrize(("name", "way"), [("puma560", [0.12, 0.1, 0.0]), ("lwa4p", [0.1, -0.1, 0.05])])
def test_limits_of_jerk_of_the_joints_slow_no_more_than_everywhere(name, way):
    model, start = arm(name), home(name)
    limits = aw.trajectories.MotionLimits.of(
        model, velocity=1.0, acceleration=3.0, jerk=40.0, torque=np.inf, voltage=np.inf
    )
    path = aw.trajectories.CartesianPath([aw.trajectories.Line(moved(start, way))], start)
    slow, local = (
        aw.trajectories.follow_path(model, path, 2.0, 20.0, limits=limits, near=HOME[name], slow=slow)
        for slow in ("everywhere", "where needed")
    )
    assert local.duration <= slow.duration
    report = aw.trajectories.limits_report(model, local, limits)
    assert report.kept  # and no acceleration jumps
    assert max(report.share[each].max() for each in ("velocity", "acceleration", "jerk")) > 0.8
    assert largest_use(model, local, limits) <= 1.0 + 1e-6


def test_what_needs_no_slowing_is_the_same_motion():
    model, path = arm("puma560"), corner("puma560", blend=0.02)
    one, other = (
        aw.trajectories.follow_path(model, path, 0.1, 2.0, near=HOME["puma560"], slow=s)
        for s in ("everywhere", "where needed")
    )
    assert one.duration == other.duration
    assert not other.stretches
    with pytest.raises(ScenarioError, match="slow = 'there'"):
        aw.trajectories.follow_path(model, path, 0.1, 2.0, near=HOME["puma560"], slow="there")


def test_stops_and_turns_in_place_stay_stops():
    model, start = arm("puma560"), home("puma560")
    turned = moved(start, turn=[0.2, 0.3, 0.0])
    path = aw.trajectories.CartesianPath(
        [aw.trajectories.Line(turned), aw.trajectories.Line(moved(turned, [0.0, 0.1, 0.0]))], start
    )
    limits = aw.trajectories.MotionLimits.of(model, velocity=0.3, acceleration=4.0, torque=np.inf, voltage=np.inf)
    options = {"tool": aw.trajectories.ToolLimits(None, 1.0, 4.0), "near": HOME["puma560"], "limits": limits}
    motion = aw.trajectories.follow_path(model, path, 0.3, 2.0, slow="where needed", time=0.5, **options)
    assert motion.duration < aw.trajectories.follow_path(model, path, 0.3, 2.0, **options).duration
    assert motion.stretches
    stop = motion.times([path.breaks[1]])
    np.testing.assert_allclose(motion.at(stop)[1], 0.0, atol=1e-6)
    np.testing.assert_allclose(motion.at([0.5, 0.5 + motion.duration])[1], 0.0, atol=1e-9)
    np.testing.assert_allclose(motion.profile.at([0.5, 0.5 + motion.duration])[0][:, 0], [0.0, path.length], atol=1e-12)
    assert largest_use(model, motion, limits) <= 1.0 + 1e-6

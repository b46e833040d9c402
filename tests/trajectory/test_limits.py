"""Limits of motions: the record's, those in their place, and the report of what a motion uses."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from physics.arms import arm
from raises_at import raises_at


def test_the_record_gives_what_it_has():
    model = arm("lwa4p")
    limits = aw.trajectories.MotionLimits.of(model)
    np.testing.assert_array_equal(limits.velocity, [float(body.limits.velocity) for body in model.coordinates])
    np.testing.assert_array_equal(limits.position, [body.limits.position for body in model.coordinates])
    assert np.isinf(limits.jerk).all()
    for k, body in enumerate(model.coordinates):  # a current is a torque
        if np.isfinite(float(body.limits.current)):
            drive = body.drive
            torque = abs(float(drive.gear_ratio) * float(drive.torque_constant)) * float(body.limits.current)
            assert limits.torque[k] == min(torque, float(body.limits.torque))


def test_overrides_take_the_place_of_the_records():
    limits = aw.trajectories.MotionLimits.of(arm("lwa4p"), acceleration=3.0, velocity={"joint2": 0.5}, position=1.0)
    np.testing.assert_array_equal(limits.acceleration, 3.0)
    assert limits.velocity[1] == 0.5
    assert limits.velocity[0] == 1.2566
    np.testing.assert_array_equal(limits.position, [[-1.0, 1.0]] * 6)


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"speed": 1.0}, "no quantity"),
        ({"velocity": 0.0}, "velocity = 0.0: .*number above 0"),
        ({"velocity": [1.0, 2.0]}, "each of 6 joints"),
        ({"velocity": np.nan}, "velocity = nan"),
        ({"acceleration": {"elbow": 1.0}}, "'elbow': no joint"),
        ({"acceleration": {"joint1": -1.0}}, r"acceleration\['joint1'\] = -1.0"),
        ({"position": [[1.0, -1.0]] * 6}, "lower and an"),
    ],
)
def test_limits_that_are_none_are_refused(overrides, said):
    with pytest.raises(ScenarioError, match=said):
        aw.trajectories.MotionLimits.of(arm("lwa4p"), **overrides)


def test_a_missing_limit_is_named_with_its_joints():
    limits = aw.trajectories.MotionLimits.of(arm("lwa4p"), acceleration={"joint1": 1.0})
    with raises_at(ScenarioError, "limits.acceleration", "joint2, joint3, joint4"):
        limits.required("velocity", "acceleration")


def test_a_pose_outside_names_joint_and_distance():
    limits = aw.trajectories.MotionLimits.of(arm("lwa4p"))
    pose = np.zeros(6)
    pose[2] = limits.position[2, 1] + 0.25
    with raises_at(ScenarioError, "goal of joint3", r"0\.25 rad"):
        limits.check_position("goal", pose)


def test_a_report_has_closed_extrema_and_the_kernels_torques():
    model = arm("cmu-dd")
    start, goal, duration = np.zeros(6), np.full(6, 0.6), 0.7
    motion = aw.trajectories.Quintic(start, goal, duration, time=0.1)
    limits = aw.trajectories.MotionLimits.of(model, velocity=2.0, acceleration=10.0, jerk=300.0)
    report = aw.trajectories.limits_report(model, motion, limits)
    np.testing.assert_allclose(report.highest["velocity"], 15 / 8 * 0.6 / duration, rtol=1e-6)
    np.testing.assert_allclose(report.share["velocity"], 15 / 16 * 0.6 / duration, rtol=1e-6)
    np.testing.assert_allclose(report.times["velocity"], 0.1 + duration / 2, atol=1e-3)
    np.testing.assert_allclose(report.highest["acceleration"], 10 / np.sqrt(3) * 0.6 / duration**2, rtol=1e-6)
    np.testing.assert_allclose(report.highest["jerk"], 60 * 0.6 / duration**3, rtol=2e-2)
    t = np.linspace(0.1, 0.1 + duration, 20001)
    dyn = aw.compile(model)
    q, qd, qdd = motion.at(t)
    tau = dyn.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(report.highest["torque"], tau.max(axis=0), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(report.lowest["voltage"], dyn.motor_voltage(qd, tau).min(axis=0), rtol=1e-4, atol=1e-6)
    assert "velocity" in str(report)
    assert not aw.trajectories.limits_report(model, motion, limits.replace(velocity=1.0)).kept
    assert "160" in aw.trajectories.limits_report(model, motion, limits.replace(velocity=1.0)).excesses()[0]


def test_jumps_of_the_acceleration_keep_no_limit_of_jerk():
    model = arm("two-link")
    limits = aw.trajectories.MotionLimits.of(model, velocity=2.0, acceleration=10.0, jerk={"elbow": 300.0})
    jumping = aw.trajectories.Cubic([0.0, 0.0], [0.3, 0.6], limits=limits, time=0.5)
    report = aw.trajectories.limits_report(model, jumping, limits)
    np.testing.assert_allclose(report.jumps, [0.5, 0.5 + jumping.duration], atol=1e-12)
    assert not report.kept
    assert report.largest == pytest.approx(1.0)  # of what it plans with
    (said,) = report.excesses()
    assert said == (
        f"elbow: acceleration jumps by up to 10 rad/s² at 0.5, {0.5 + jumping.duration:.4g} s: "
        "its limit of jerk, 300 rad/s³, is not kept"
    )
    assert str(report).endswith(said)
    assert "jumps" in str(report).splitlines()[2]  # of the elbow
    assert "no limit" in str(report).splitlines()[1]
    smooth = aw.trajectories.limits_report(
        model, aw.trajectories.Quintic([0.0, 0.0], [0.3, 0.6], limits=limits), limits
    )
    assert smooth.kept
    assert not smooth.jumps.size
    for motion in (
        jumping,
        aw.trajectories.Cubic([0.0, 0.0], [0.3, 0.0], 1.0),
    ):  # nothing has a limit, or what has one stands
        free = limits.replace(jerk=np.inf if motion is jumping else {"shoulder": np.inf})
        assert aw.trajectories.limits_report(model, motion, free).kept


def test_a_payload_is_carried():
    model = arm("lwa4p")
    motion = aw.trajectories.Quintic(np.zeros(6), [0.0, 0.5, 0.5, 0.0, 0.0, 0.0], 2.0)
    loaded = model.with_payload(2.0, [0.0, 0.0, 0.05], [1e-3] * 3)
    t = np.linspace(0.0, 2.0, 5001)
    tau = aw.compile(loaded).inverse_dynamics(*motion.at(t))
    report = aw.trajectories.limits_report(model, motion, payload=aw.Payload(0.0, 2.0, [0.0, 0.0, 0.05], [1e-3] * 3))
    np.testing.assert_allclose(report.highest["torque"], tau.max(axis=0), rtol=1e-4, atol=1e-3)


def test_a_motion_without_end_or_of_other_joints_is_refused():
    with raises_at(ScenarioError, "Sine", "not end"):
        aw.trajectories.limits_report(arm("two-link"), aw.trajectories.Sine([0.0, 0.0], [1.0, 1.0], 1.0))
    with raises_at(ScenarioError, "lwa4p", "2 joints"):
        aw.trajectories.limits_report(arm("lwa4p"), aw.trajectories.Quintic([0.0, 0.0], [1.0, 1.0], 1.0))


def test_angles_that_look_like_degrees_are_asked_about():
    limits = aw.trajectories.MotionLimits.of(arm("panda"))
    goal = np.radians([90, -30, 0, -90, 0, 90, 45])
    limits.check_position("goal", goal)
    with raises_at(ScenarioError, "goal of joint1", r"90° is 1\.5708 rad", value=90.0):
        limits.check_position("goal", np.degrees(goal))
    with raises_at(ScenarioError, "goal of joint1", r"197\.1 rad .* limits; expected"):  # 200° is outside, too
        limits.check_position("goal", np.array([200.0, *goal[1:]]))
    with raises_at(ScenarioError, "goal of joint1", r"1\.103 rad .* limits; expected"):  # no turn
        limits.check_position("goal", np.array([4.0, *goal[1:]]))
    free = aw.trajectories.MotionLimits.of(arm("two-link"))
    assert free.doubts_of_degrees("goal", np.array([0.0, -90.0])) == [
        "goal of elbow: -90 rad looks like degrees; -90° is -1.5708 rad"
    ]
    assert free.doubts_of_degrees("goal", np.array([6.0, 7.5])) == []
    assert limits.doubts_of_degrees("goal", np.degrees(goal)) == []  # which is an error there

"""Ruckig's moves: its own durations and values, limits on dense grids, and no network."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.errors import ScenarioError
from raises_at import raises_at
from trajectory.motions import check_continuous, check_within, limits_of, random_limits

ruckig = pytest.importorskip("ruckig", reason="ruckig is not installed")


def their_trajectory(states: dict[str, np.ndarray], limits: aw.trajectories.MotionLimits):
    asked = ruckig.InputParameter(limits.n)
    for theirs, ours in (("current", "start"), ("target", "goal")):
        setattr(asked, f"{theirs}_position", states[ours].tolist())
        setattr(asked, f"{theirs}_velocity", states[f"{ours}_velocity"].tolist())
        setattr(asked, f"{theirs}_acceleration", states[f"{ours}_acceleration"].tolist())
    asked.max_velocity, asked.max_acceleration = limits.velocity.tolist(), limits.acceleration.tolist()
    asked.max_jerk = limits.jerk.tolist()
    found = ruckig.Trajectory(limits.n)
    ruckig.Ruckig(limits.n).calculate(asked, found)
    return found


@pytest.mark.study
@settings(max_examples=400, deadline=None)
@given(st.integers(0, 2**32))
def test_durations_and_values_are_ruckigs_own(seed):
    draw = np.random.default_rng(seed)
    n = int(draw.integers(1, 8))
    limits = random_limits(draw, n)
    states = {"start": draw.uniform(-3.0, 3.0, n), "goal": draw.uniform(-3.0, 3.0, n)}
    for end in ("start", "goal"):
        acceleration = 0.5 * limits.acceleration * draw.uniform(-1.0, 1.0, n)
        # a speed that the acceleration does not drive over its limit while it ends
        room = limits.velocity - 0.5 * acceleration**2 / limits.jerk
        states |= {f"{end}_velocity": np.maximum(room, 0.0) * draw.uniform(-0.9, 0.9, n)}
        states |= {f"{end}_acceleration": np.where(room > 0.0, acceleration, 0.0)}
    wanted = their_trajectory(states, limits)
    motion = aw.trajectories.Ruckig(**states, limits=limits, time=0.3)
    np.testing.assert_allclose(motion.duration, wanted.duration, rtol=1e-12)
    check_within(motion, limits, "velocity", "acceleration", "jerk")
    check_continuous(motion, 3)
    for t in np.linspace(0.0, wanted.duration, 23)[1:-1]:
        theirs = [np.array(each) for each in wanted.at_time(float(t))[:3]]
        for ours, each, scale in zip(
            motion.at(0.3 + t), theirs, (1.0, limits.velocity, limits.acceleration), strict=True
        ):
            np.testing.assert_allclose(ours / scale, each / scale, atol=1e-8)
    np.testing.assert_allclose(motion.at(0.3 + motion.duration)[0], states["goal"], atol=1e-8)


def test_rest_to_rest_is_the_s_curve():
    limits = limits_of([1.0], [2.0], [10.0])
    fast, curve = aw.trajectories.Ruckig([0.0], [1.5], limits), aw.trajectories.SCurve([0.0], [1.5], limits)
    np.testing.assert_allclose(fast.duration, curve.duration, rtol=1e-12)
    t = np.linspace(0.0, curve.duration, 100)
    np.testing.assert_allclose(fast.at(t), curve.at(t), atol=1e-9)


def test_a_given_duration_is_kept():
    limits = limits_of([1.0, 1.0], 2.0, 10.0)
    assert aw.trajectories.Ruckig([0.0, 0.0], [1.0, 0.2], limits, duration=4.0).duration == pytest.approx(
        4.0, rel=1e-12
    )
    with pytest.raises(ScenarioError, match=r"Ruckig.duration = 0.5: expected 1.7"):
        aw.trajectories.Ruckig([0.0, 0.0], [1.0, 0.2], limits, duration=0.5)


def test_the_network_is_not_asked():
    """In a process where no socket can be made, of Python and by the system calls that Python audits."""
    script = """
import sys
def deny(event, arguments):
    if event.startswith("socket."):
        raise RuntimeError("the network was asked")
import socket
socket.socket = socket.create_connection = None
sys.addaudithook(deny)
import numpy as np, armwright as aw
limits = aw.trajectories.MotionLimits.of(aw.load("lwa4p"), acceleration=3.0, jerk=40.0)
motion = aw.trajectories.Ruckig(np.zeros(6), np.full(6, 0.5), limits, start_velocity=np.full(6, 0.2))
aw.trajectories.Waypoints([np.zeros(6), np.full(6, 0.3), np.full(6, 0.5)], limits)
print(motion.duration)
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=120)
    assert float(run.stdout) > 0.0
    source = (aw.trajectory.state_to_state.__file__, "intermediate")
    with open(source[0], encoding="utf-8") as file:
        assert source[1] not in file.read()  # waypoints are never passed


def test_a_joint_that_moves_needs_a_limit_of_acceleration_or_jerk():
    inf = np.inf
    with raises_at(ScenarioError, "limits.acceleration", "joint1"):
        aw.trajectories.Ruckig([0.0, 0.0], [1.0, 0.0], limits_of([1.0, 1.0], inf, inf))
    assert aw.trajectories.Ruckig(
        [0.0, 0.0], [1.0, 0.0], limits_of([1.0, 1.0], [2.0, inf], inf)
    ).duration == pytest.approx(1.5)
    jerk_alone = aw.trajectories.Ruckig([0.0], [1.0], limits_of([inf], inf, 4.0))
    assert jerk_alone.duration == pytest.approx(2.0)  # (32 h / j)^(1/3)


def test_limits_of_very_different_magnitudes():
    """A segment shorter than rounding is left out; where Ruckig finds nothing, the error is one short line."""
    steep = aw.trajectories.Ruckig([0.0, 0.0], [0.3, 0.3], limits_of([1.0, 1.0], 3.0, 1e20))
    assert steep.duration == pytest.approx(2.0 * np.sqrt(0.1), rel=1e-9)
    np.testing.assert_allclose(steep.at(steep.duration)[0], 0.3, atol=1e-12)
    with raises_at(ScenarioError, "Ruckig", "no move") as caught:
        aw.trajectories.Ruckig(np.zeros(6), np.full(6, 0.3), limits_of([1.0] * 6, 1e-20, 60.0))
    assert len(str(caught.value)) < 120


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"goal": [0.0]}, "no length"),
        ({"goal": [2.5]}, "goal of joint1 = 2.5: 0.5 rad"),
        ({"goal_velocity": [1.5]}, "goal_velocity of joint1 = 1.5: .*1 rad/s"),
        ({"start": [1.9], "start_velocity": [1.0]}, "joint1 .* by 0."),
        ({"start": [np.nan]}, "expected finite numbers"),
        ({"start": [0.0, 0.0]}, "2 numbers; expected 1"),
        ({"duration": np.inf}, "duration = inf"),
    ],
)
def test_bad_moves_are_refused(changes, said):
    limits = limits_of([1.0], [2.0], [10.0], position=2.0)
    with pytest.raises(ScenarioError, match=said):
        aw.trajectories.Ruckig(**{"start": [0.0], "goal": [1.0], "limits": limits} | changes)

"""The filter of references: limits, no overshoot, Ruckig's durations, and the same bits compiled and in C."""

from __future__ import annotations

import ctypes
import functools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.errors import ScenarioError
from armwright.interfaces import JointReference, Measurement
from armwright.kernels.batch import Kernel
from armwright.kernels.c import c_source
from armwright.kernels.target import select_target
from armwright.program import trace
from armwright.trajectory.online import filtered
from kernels.c_compilers import BITS, STRICT, batch_function, build, compiler, run_batch
from kernels.harness import same_bits
from physics.arms import arm

PERIOD = 1e-3


@functools.cache
def kernel():
    """One tick of a joint, compiled: state (…, 3), reference (…, 2), limits (…, 3) and period (…, 1) → the next state."""

    def tick(state, r, limits, period):
        velocity, acceleration, jerk = limits.reshape(3, 1)
        return filtered(state.reshape(3, 1), r[:1], r[1:], velocity, acceleration, jerk, period[0]).ravel()

    shapes = {"state": (3,), "r": (2,), "limits": (3,), "period": (1,)}
    return Kernel(trace("tick", tick, shapes, ("next",)), select_target())


def after(state, q, qd, limits):
    """States (joints, 3) after a tick, for references (joints,) and limits (joints, 3)."""
    return kernel()(state, np.stack(np.broadcast_arrays(q, qd), axis=-1), limits, [PERIOD])


def run(references, *limits, speeds: Any = 0.0):
    """States (ticks + 1, 3) of one joint that follows references (ticks,) from rest at 0."""
    states = [np.zeros(3)]
    for q, qd in zip(references, np.broadcast_to(speeds, len(references)), strict=True):
        states.append(after(states[-1], q, qd, limits))
    return np.array(states)


def motion_time(distance, velocity, acceleration, jerk):
    """Least duration [s] from rest to rest, in closed form."""
    if velocity * jerk < acceleration**2:  # the acceleration stays below its limit
        distance_at = 2.0 * velocity * np.sqrt(velocity / jerk)
        ramp = 2.0 * np.sqrt(velocity / jerk)
    else:
        ramp = velocity / acceleration + acceleration / jerk
        distance_at = velocity * ramp
    if distance >= distance_at:
        return 2.0 * ramp + (distance - distance_at) / velocity
    if distance <= 2.0 * acceleration**3 / jerk**2:
        return 4.0 * np.cbrt(distance / (2.0 * jerk))
    half = acceleration / (2.0 * jerk)
    return 2.0 * (half + np.sqrt(half**2 + distance / acceleration))


def drawn(seed, joints=500):
    """Limits (joints, 3) over orders of magnitude, and a generator for the rest."""
    rng = np.random.default_rng(seed)
    return 10.0 ** rng.uniform([-1.3, -1.0, 0.0], [1.0, 2.0, 3.7], (joints, 3)), rng


def test_the_compiled_tick_is_the_float_run():
    limits, rng = drawn(0)
    state, q = np.zeros(limits.shape), rng.uniform(-1.0, 1.0, len(limits))
    for _ in range(6):
        expected = filtered(state.T, q, 0.3 * q, limits[:, 0], limits[:, 1], limits[:, 2], PERIOD).T
        state = after(state, q, 0.3 * q, limits)
        np.testing.assert_allclose(state, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.study
@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["jumps", "noise", "impossible speeds"]))
def test_limits_hold_whatever_the_reference_does(seed, kind):
    limits, rng = drawn(seed)
    velocity, acceleration, jerk = limits.T
    state, q, qd = np.zeros(limits.shape), np.zeros(len(limits)), 0.0
    for k in range(400):
        if kind != "jumps" or k % 40 == 0:
            q = rng.uniform(-1.0, 1.0, len(q)) * 10.0 ** rng.uniform(-4, 0.5, len(q))
        if kind == "impossible speeds":
            qd = velocity * rng.uniform(-3.0, 3.0, len(q))
        following = after(state, q, qd, limits)
        assert (np.abs(following[:, 1]) / velocity).max() <= 1.0 + 1e-9
        assert (np.abs(following[:, 2]) / acceleration).max() <= 1.0 + 1e-9
        assert (np.abs(following[:, 2] - state[:, 2]) / jerk).max() <= PERIOD * (1.0 + 1e-9)
        state = following


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_a_step_is_met_in_the_least_time_without_overshoot(seed):
    limits, rng = drawn(seed)
    distance = 10.0 ** rng.uniform(-4.0, 0.5, len(limits))
    least = np.array([motion_time(d, *each) for d, each in zip(distance, limits, strict=True)])
    limits *= (least[:, None] / 0.3) ** [1.0, 2.0, 3.0]  # the same motions, all in 0.3 s
    state = np.zeros(limits.shape)
    for k in range(306):
        before, state = state[:, 0], after(state, distance, 0.0, limits)
        assert (state[:, 0] <= distance * (1.0 + 1e-12)).all()
        assert (state[:, 0] >= before - 1e-14 * distance).all()
        assert k >= 299 or (state[:, 0] < distance).all()  # nothing is quicker
    np.testing.assert_allclose(state[:, 0], distance, rtol=1e-9)
    assert (np.abs(state[:, 1]) <= 1e-6 * limits[:, 0]).all()


@pytest.mark.study
def test_a_move_that_is_changed_on_the_way_takes_as_long_as_ruckigs():
    ruckig = pytest.importorskip("ruckig")
    limits, rng = (1.0, 4.0, 60.0), np.random.default_rng(5)
    for _ in range(15):
        state = run(np.full(rng.integers(1, 500), rng.uniform(-1, 1)), *limits)[-1]
        goal = rng.uniform(-1.0, 1.0)
        asked = ruckig.InputParameter(1)
        asked.current_position, asked.current_velocity, asked.current_acceleration = ([each] for each in state)
        asked.target_position, asked.target_velocity, asked.target_acceleration = [goal], [0.0], [0.0]
        asked.max_velocity, asked.max_acceleration, asked.max_jerk = ([each] for each in limits)
        plan = ruckig.Trajectory(1)
        assert ruckig.Ruckig(1).calculate(asked, plan) in (ruckig.Result.Working, ruckig.Result.Finished)
        for k in range(int(np.ceil(plan.duration / PERIOD))):
            at = plan.at_time(k * PERIOD)
            np.testing.assert_allclose(state, [each[0] for each in at[:3]], atol=1e-7)
            state = after(state, goal, 0.0, limits)
        np.testing.assert_allclose(state, [goal, 0.0, 0.0], atol=1e-7)


def test_a_smooth_reference_is_followed_and_a_ramp_exactly():
    t = np.arange(3000) * PERIOD
    states = run(0.3 * t, 1.0, 4.0, 60.0, speeds=np.full(3000, 0.3))
    np.testing.assert_allclose(states[1000:-1, 0], 0.3 * t[1000:], atol=1e-12)
    states = run(0.2 * np.sin(2.0 * t), 1.0, 4.0, 60.0, speeds=0.4 * np.cos(2.0 * t))
    np.testing.assert_allclose(states[1000:-1, 0], 0.2 * np.sin(2.0 * t[1000:]), atol=2e-3)
    jerk = np.diff(states[1000:, 2]) / PERIOD
    assert np.mean(np.abs(jerk) > 3.2) < 0.02  # the reference's own is 1.6: it does not chatter


def test_a_reference_that_rests_gives_rest():
    states = run(np.full(2500, 0.7), 1.0, 4.0, 60.0)
    np.testing.assert_array_equal(states[1500:, 1:], 0.0)
    assert np.ptp(states[1500:, 0]) == 0.0


def law(**changes):
    """The filter before a PD law, for the two joints of a simple arm."""
    values = {"velocity": [1.0, 2.0], "acceleration": 8.0, "jerk": [100.0, 200.0]} | changes
    return aw.trajectories.ReferenceFilter(aw.ComputedTorque(kp=400.0, kd=40.0), **values)


@pytest.mark.study
def test_it_runs_in_the_compiled_loop_with_limits_of_each_lane():
    goal, speeds = np.array([0.6, -0.4]), [0.5, 1.0]
    velocity = aw.Batch([[each, each] for each in speeds])
    run = aw.simulate(
        aw.Scenario(
            arm("two-link"), duration=2.5, start=np.zeros(2),
            loop=aw.Loop(law(velocity=velocity), aw.trajectories.Step(np.zeros(2), goal, 0.1), 1e-3),
        )
    )  # fmt: skip
    assert run.attrs["controller"] == "compiled"
    np.testing.assert_allclose(run.q.values[:, -1], [goal, goal], atol=1e-3)
    peaks = np.abs(run.qd.values).max(axis=1)[:, 0]
    np.testing.assert_allclose(peaks, speeds, rtol=0.03)  # of what follows the filter


@pytest.mark.study
def test_its_step_is_printed_as_c_with_the_bits_of_the_kernel(tmp_path):
    gcc, n = compiler("gcc"), 2
    control = law().configure(arm("two-link"), PERIOD)
    control = aw.trajectories.ReferenceFilter(lambda t, r, y: 50.0 * (r.q - y.q) + 5.0 * (r.qd - y.qd), **{
        name: getattr(control, name) for name in ("velocity", "acceleration", "jerk")
    }, period=PERIOD)  # fmt: skip

    def step(r, q, qd, s):
        return control.step(0.0, JointReference(r, 0.0 * r, 0.0 * r), Measurement(q, qd, q, q), s)

    shapes = {"r": (n,), "q": (n,), "qd": (n,), "s": (3 * n,)}
    program = trace("filter_tick", step, shapes, ("u", "s_next"))
    source = tmp_path / "step.c"
    sizes = [n, n, n, 3 * n, n, 3 * n]
    source.write_text(c_source(program) + batch_function("filter_tick", sizes, 4), encoding="ascii")
    build([gcc, *BITS, *STRICT, "-shared", "-fPIC", source, "-lm", "-o", tmp_path / "step.so"])
    states = np.zeros((400, 3, n))  # of a move, after each tick
    rng = np.random.default_rng(1)
    goals = np.repeat(rng.uniform(-1.0, 1.0, (4, n)), 100, axis=0)
    limits = control.velocity, control.acceleration, control.jerk
    for k in range(399):
        states[k + 1] = filtered(states[k], goals[k], np.zeros(n), *limits, PERIOD)
    values = [goals, rng.uniform(-1.0, 1.0, (400, n)), rng.uniform(-1.0, 1.0, (400, n)), states.reshape(400, -1)]
    printed = run_batch(ctypes.CDLL(str(tmp_path / "step.so")), "filter_tick", values, [(n,), (3 * n,)])
    compiled = Kernel(program, select_target())(*values)
    for a, b in zip(printed, compiled, strict=True):
        assert same_bits(a, b).all()
    np.testing.assert_allclose(compiled[1][:-1], states[1:].reshape(399, -1), atol=1e-12)


def test_limits_of_the_record_are_taken_and_their_absence_is_named():
    panda = arm("panda")
    with pytest.raises(ScenarioError) as error:
        aw.trajectories.ReferenceFilter(lambda t, r, y: r.q, jerk=100.0, acceleration=np.inf).configure(panda, PERIOD)
    assert error.value.place == "ReferenceFilter.acceleration"
    chosen = aw.trajectories.ReferenceFilter(lambda t, r, y: r.q, jerk=100.0, acceleration=10.0).configure(
        panda, PERIOD
    )
    np.testing.assert_array_equal(chosen.velocity, aw.trajectories.MotionLimits.of(panda).velocity)
    with pytest.raises(ScenarioError, match="velocity"):
        law(velocity=-1.0).configure(arm("two-link"), PERIOD)

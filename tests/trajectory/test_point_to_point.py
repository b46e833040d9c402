"""Moves from state to state: closed forms, limits on dense grids, synchronised joints, continuity, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.errors import ScenarioError
from armwright.trajectory.s_curve import s_curve_times
from armwright.trajectory.trapezoid import trapezoid_times
from physics.arms import arm
from raises_at import raises_at
from trajectory.motions import check_continuous, check_within, limits_of, random_limits

KINDS = {
    "Cubic": (("velocity", "acceleration", "jerk"), 2),
    "Quintic": (("velocity", "acceleration", "jerk"), 3),
    "MinimumJerk": (("velocity", "acceleration", "jerk"), 3),
    "Trapezoid": (("velocity", "acceleration"), 2),
    "SCurve": (("velocity", "acceleration", "jerk"), 3),
}


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=260, deadline=None)
@given(seed=st.integers(0, 2**32))
@pytest.mark.study
def test_limits_hold_and_one_is_used(kind, seed):
    draw = np.random.default_rng(seed)
    n, (quantities, continuous) = int(draw.integers(1, 8)), KINDS[kind]
    limits, start = random_limits(draw, n), draw.uniform(-3.0, 3.0, n)
    goal = start + 10.0 ** draw.uniform(-6.0, 1.0, n) * draw.choice([-1.0, 1.0], n) * (draw.random(n) < 0.8)
    if (goal == start).all():
        return
    motion = getattr(aw.trajectories, kind)(start, goal, limits=limits, time=draw.uniform(0.0, 5.0))
    check_within(motion, limits, *quantities)
    check_continuous(motion, continuous)
    q, qd, qdd = motion.at(np.array([0.0, motion.time, motion.time + motion.duration, motion.time + 1e6]))
    np.testing.assert_allclose(q[:2], [start] * 2, atol=1e-12)
    np.testing.assert_allclose(q[2:], [goal] * 2, atol=1e-11)
    np.testing.assert_allclose(
        qd, 0.0, atol=1e-9 * (np.abs(motion.at(motion.time + 0.5 * motion.duration)[1]).max() + 1)
    )
    np.testing.assert_array_equal(qdd[-1], 0.0)
    t = np.linspace(motion.time, motion.time + motion.duration, 4001)
    _, qd, qdd = motion.at(t)
    used = [np.abs(qd).max(axis=0) / limits.velocity, np.abs(qdd).max(axis=0) / limits.acceleration]
    if "jerk" in quantities:
        used.append(np.abs(np.diff(qdd, axis=0)).max(axis=0) / (t[1] - t[0]) / limits.jerk)
    assert np.max(used) > 0.98  # the slowest joint is as fast as its limits let it be


@pytest.mark.study
@settings(max_examples=300, deadline=None)
@given(st.floats(1e-6, 1e3), st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_a_trapezoid_is_its_closed_form(h, v, a):
    motion = aw.trajectories.Trapezoid([0.3], [0.3 + h], limits_of(v, a))
    h = float(np.asarray(motion.goal)[0] - 0.3)
    wanted = h / v + v / a if h >= v * v / a else 2.0 * np.sqrt(h / a)  # [BiagiottiMelchiorri2008] (3.12), (3.14)
    np.testing.assert_allclose(motion.duration, wanted, rtol=1e-12)
    accelerating, cruising, braking = trapezoid_times(h, v, a)
    t = np.linspace(0.0, wanted, 50)[1:-1]
    top = a * accelerating
    closed = np.where(
        t < accelerating,
        0.5 * a * t**2,
        np.where(t < accelerating + cruising, top * (t - 0.5 * accelerating), h - 0.5 * a * (wanted - t) ** 2),
    )
    np.testing.assert_allclose(motion.at(t)[0][:, 0] - 0.3, closed, rtol=1e-12, atol=1e-12 * (h + 1.0))
    assert braking == accelerating


@settings(max_examples=300, deadline=None)
@given(st.floats(1e-6, 1e3), st.floats(1e-2, 1e2), st.floats(1e-2, 1e2), st.floats(1e-1, 1e4))
def test_an_s_curve_is_its_closed_form(h, v, a, j):
    times = s_curve_times(h, v, a, j)
    ramp, flat, _, cruise, *_ = times
    assert (times >= 0.0).all()
    top_a, top_v = j * ramp, j * ramp * (ramp + flat)
    assert top_a <= a * (1 + 1e-12)
    assert top_v <= v * (1 + 1e-12)
    np.testing.assert_allclose(top_v * (2 * ramp + flat + cruise), h, rtol=1e-12)  # the way
    # time-optimal: what is not at its limit is only so where the way is too short [BiagiottiMelchiorri2008] (3.21)-(3.30)
    assert top_v >= v * (1 - 1e-12) or cruise == 0.0
    assert top_a >= a * (1 - 1e-12) or flat <= 1e-12 * ramp
    motion = aw.trajectories.SCurve([0.0], [h], limits_of(v, a, j))
    np.testing.assert_allclose(motion.duration, times.sum(), rtol=1e-12)
    middle = 0.5 * motion.duration
    np.testing.assert_allclose(motion.at(middle)[0], h / 2, rtol=1e-12)
    np.testing.assert_allclose(motion.at(middle)[1], top_v, rtol=1e-12)
    t = np.linspace(0.0, ramp, 20)[:-1]
    np.testing.assert_allclose(motion.at(t)[0][:, 0], j * t**3 / 6, rtol=1e-12, atol=1e-12 * h)


def test_an_s_curve_without_limits_of_speed_or_acceleration():
    np.testing.assert_allclose(
        aw.trajectories.SCurve([0.0], [2.0], limits_of(np.inf, np.inf, 4.0)).duration, 4.0 * np.cbrt(0.25)
    )
    np.testing.assert_allclose(
        aw.trajectories.Trapezoid([0.0], [2.0], limits_of(np.inf, 4.0)).duration, 2.0 * np.sqrt(0.5)
    )
    wanted = s_curve_times(2.0, 1e9, 3.0, 40.0).sum()
    np.testing.assert_allclose(aw.trajectories.SCurve([0.0], [2.0], limits_of(np.inf, 3.0, 40.0)).duration, wanted)


@pytest.mark.parametrize("kind", KINDS)
def test_a_given_duration_slows_all_joints(kind):
    limits = limits_of([1.0, 2.0], [3.0, 4.0], [50.0, 60.0])
    fastest = getattr(aw.trajectories, kind)([0.0, 0.0], [1.0, -2.0], limits=limits)
    slow = getattr(aw.trajectories, kind)([0.0, 0.0], [1.0, -2.0], limits=limits, duration=3.0 * fastest.duration)
    assert slow.duration == 3.0 * fastest.duration
    t = np.linspace(0.0, slow.duration, 3001)
    np.testing.assert_allclose(
        np.abs(slow.at(t)[1]).max(axis=0), np.abs(fastest.at(t / 3)[1]).max(axis=0) / 3, rtol=1e-3
    )
    with pytest.raises(ScenarioError, match=rf"{kind}\.duration = "):
        getattr(aw.trajectories, kind)([0.0, 0.0], [1.0, -2.0], limits=limits, duration=0.9 * fastest.duration)


def test_joints_begin_and_end_together():
    motion = aw.trajectories.SCurve([0.0, 0.0, 0.0], [1.0, -0.1, 0.0], limits_of([1.0, 2.0, 3.0], 5.0, 80.0))
    t = np.linspace(0.0, motion.duration, 5000)[1:-1]
    q, qd, _ = motion.at(t)
    assert (qd[:, 0] > 0.0).all()
    assert (qd[:, 1] < 0.0).all()
    np.testing.assert_array_equal(q[:, 2], 0.0)


@pytest.mark.study
@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32))
def test_minimum_jerk_meets_moving_states(seed):
    draw = np.random.default_rng(seed)
    n = int(draw.integers(1, 6))
    states = draw.normal(size=(6, n)) * np.array([1.0, 1.0, 1.0, 1.0, 0.0, 0.0])[:, None]
    names = ("start", "goal", "start_velocity", "goal_velocity", "start_acceleration", "goal_acceleration")
    limits = limits_of(
        *(3.0 * np.abs(states[2:4]).max(0) + 0.1, 3.0 * np.abs(states[4:]).max(0) + 0.1, np.full(n, 1e3))
    )
    motion = aw.trajectories.MinimumJerk(**dict(zip(names, states, strict=True)), limits=limits)
    check_within(motion, limits, "velocity", "acceleration", "jerk")
    begin, end = motion.at(0.0), motion.at(motion.duration)
    np.testing.assert_allclose(begin, states[::2], atol=1e-9)
    np.testing.assert_allclose(end, states[1::2], atol=1e-8)


def test_minimum_jerk_has_the_least_integral():
    """Any other motion with the same ends has a larger ∫ jerk²: Euler's equation, q⁽⁶⁾ = 0."""
    states = {"start_velocity": [0.4], "goal_velocity": [-0.3], "start_acceleration": [1.0]}
    best = aw.trajectories.MinimumJerk([0.0], [1.0], duration=1.3, **states).polynomial
    t = np.linspace(0.0, 1.3, 20001)
    bump = aw.trajectories.PiecewisePolynomial(
        [0.0, 1.3], np.polynomial.Polynomial.fromroots([0.0] * 3 + [1.3] * 3).coef[None, None]
    )

    def cost(motion):
        jerk = motion.derivative().derivative().at(t)[1]
        return np.trapezoid(jerk[:, 0] ** 2, t)

    padded = np.pad(best.coefficients, ((0, 0), (0, 0), (0, 1)))
    for size in (-0.1, 0.1):
        assert cost(aw.trajectories.PiecewisePolynomial(best.knots, padded + size * bump.coefficients)) > cost(best)


def test_limits_of_the_record_serve():
    model = arm("lwa4p")
    motion = aw.trajectories.Quintic(
        np.zeros(6), [0.5, -0.5, 0.2, 0.0, 0.1, 1.0], limits=aw.trajectories.MotionLimits.of(model)
    )
    assert aw.trajectories.limits_report(model, motion).share["velocity"].max() == pytest.approx(1.0, rel=1e-6)


LIMITS = limits_of([1.0, 1.0], 2.0, 30.0, position=2.0)


@pytest.mark.parametrize("kind", ["Quintic", "Cubic", "Trapezoid", "SCurve", "MinimumJerk"])
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"goal": [0.0, 0.0]}, "goal: .*no length"),
        ({"goal": [0.5, 2.25]}, r"of joint2 = 2\.25: 0\.25 rad .* -2 … 2 rad"),
        ({"start": [-3.0, 0.0]}, "start of joint1 = -3.0: 1 rad"),
        ({"goal": [0.5, np.nan]}, "goal = .*finite numbers"),
        ({"goal": [0.5]}, "1 numbers|joints differ"),
        ({"duration": 0.01}, r"duration = 0.01"),
        ({"duration": -1.0}, "duration = -1.0: .*number above 0"),
        ({"time": np.inf}, "time = inf: "),
        ({"limits": "fast"}, r"limits = 'fast'"),
    ],
)
def test_bad_moves_are_refused(kind, changes, said):
    with pytest.raises(ScenarioError, match=said):
        getattr(aw.trajectories, kind)(**{"start": [0.0, 0.0], "goal": [0.5, 0.3], "limits": LIMITS} | changes)


def test_what_no_limit_bounds_is_refused():
    with raises_at(ScenarioError, "limits.jerk", "joint1, joint2"):
        aw.trajectories.SCurve([0.0, 0.0], [1.0, 1.0], limits_of([1.0, 1.0], 1.0))
    with raises_at(ScenarioError, "limits.acceleration", "joint1"):
        aw.trajectories.Trapezoid([0.0], [1.0], limits_of(1.0))
    with pytest.raises(ScenarioError, match="nothing limits joint1"):
        aw.trajectories.Quintic([0.0], [1.0], limits=limits_of(np.inf))
    with pytest.raises(ScenarioError, match="a duration"):
        aw.trajectories.Quintic([0.0], [1.0])


@pytest.mark.parametrize("kind", ["Quintic", "Cubic"])
@pytest.mark.parametrize(("before", "place"), [((), "duration"), ((1.0,), "time")])
def test_limits_in_the_place_of_another_number_are_named(kind, before, place):
    with raises_at(ScenarioError, f"{kind}.{place}", rf"{kind}\(…, limits=…\)"):
        getattr(aw.trajectories, kind)([0.0, 0.0], [0.5, 0.3], *before, LIMITS)


def test_states_beyond_the_limits_are_refused():
    with raises_at(ScenarioError, "MinimumJerk.start_velocity of joint2", "1 rad/s", value=1.5):
        aw.trajectories.MinimumJerk([0.0, 0.0], [0.5, 0.5], start_velocity=[0.0, 1.5], limits=LIMITS)
    with raises_at(ScenarioError, "MinimumJerk", "joint1"):  # it cannot stop before the limit
        aw.trajectories.MinimumJerk([1.99, 0.0], [0.5, 0.5], start_velocity=[1.0, 0.0], limits=LIMITS)

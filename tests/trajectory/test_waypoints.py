"""Motions through waypoints: limits on dense grids, continuity, durations beside IPOPT's, a thousand of them, bad input."""

from __future__ import annotations

import time
import warnings
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import CubicSpline

import armwright as aw
from armwright.errors import ScenarioError
from raises_at import raises_at
from trajectory.motions import check_continuous, check_within, limits_of, random_limits
from trajectory.path_problems import by_toppra

CURVES = {
    "cubic": 3, "natural_cubic": 3, "quintic": 3, "natural_quintic": 3, "time_optimal": 2, "parabolic": 2, "fastest": 2,
}  # fmt: skip


def random_points(draw: np.random.Generator, k: int, n: int) -> np.ndarray:
    steps = draw.normal(size=(k, n)) * 10.0 ** draw.uniform(-2.0, 0.5, size=(k, 1)) * (draw.random(n) < 0.9)
    return np.cumsum(steps + 1e-3 * draw.random((k, 1)), axis=0)


@pytest.mark.parametrize("curve", CURVES)
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32))
@pytest.mark.study
def test_limits_hold_and_one_is_used(curve, seed):
    draw = np.random.default_rng(seed)
    k, n = int(draw.integers(3 if curve == "natural_quintic" else 2, 12)), int(draw.integers(1, 7))
    limits, points = random_limits(draw, n), random_points(draw, k, n)
    if curve in ("time_optimal", "fastest") and seed % 2:
        limits = limits.replace(jerk=np.inf)
    motion = aw.trajectories.Waypoints(points, limits, curve, time=draw.uniform(0.0, 2.0))
    smooth = motion.curve == "time_optimal" and np.isfinite(limits.jerk).any()
    quantities = ("velocity", "acceleration", *(["jerk"] if motion.curve != "parabolic" else []))
    check_within(motion, limits, *quantities)
    check_continuous(motion, 3 if smooth else CURVES[motion.curve])
    polynomial = motion.polynomial
    used = [polynomial.largest(order) / getattr(limits, name) for order, name in enumerate(quantities, 1)]
    assert np.max(used) > 0.999
    if curve == "parabolic":
        np.testing.assert_allclose(motion.at(motion.time)[0], points[0], atol=1e-12)
        np.testing.assert_allclose(motion.at(motion.time + motion.duration)[0], points[-1], atol=1e-9)
        low, high = points.min(axis=0), points.max(axis=0)
        q = motion.at(np.linspace(motion.time, motion.time + motion.duration, 500))[0]
        assert ((q >= low - 1e-9) & (q <= high + 1e-9)).all()
    else:
        np.testing.assert_allclose(motion.at(motion.passes)[0], points, atol=1e-9 * (1.0 + np.abs(points).max()))
    if "natural" not in curve:
        ends = motion.at(np.array([motion.time, motion.time + motion.duration]))[1]
        np.testing.assert_allclose(ends / limits.velocity, 0.0, atol=1e-8)


def test_splines_are_scipys():
    draw = np.random.default_rng(4)
    times, points = np.cumsum(draw.uniform(0.2, 1.0, 9)), draw.normal(size=(9, 3))
    t = np.linspace(times[0], times[-1], 301)[:-1]
    for curve, kind in (("cubic", "clamped"), ("natural_cubic", "natural")):
        wanted = CubicSpline(times, points, bc_type=kind)
        for order, values in enumerate(aw.trajectories.Waypoints(points, curve=curve, times=times).at(t)):
            np.testing.assert_allclose(values, wanted(t, order), atol=1e-10)


@pytest.mark.parametrize("curve", ["quintic", "natural_quintic"])
def test_quintics_have_the_least_jerk(curve):
    """Of all curves through the points that begin and end as they do: any bump that is 0 at the knots adds jerk."""
    draw = np.random.default_rng(5)
    times, points = np.array([0.0, 0.7, 1.1, 2.0]), draw.normal(size=(4, 1))
    best = aw.trajectories.Waypoints(points, curve=curve, times=times).polynomial
    t = np.linspace(0.0, 2.0, 40001)
    jerk = best.derivative().derivative().at(t)[1][:, 0]
    ends = [0.0, 0.0, 0.0, 2.0, 2.0, 2.0] if curve == "quintic" else [0.0, 2.0]
    bump = np.polynomial.Polynomial.fromroots([*ends, 0.7, 1.1]).deriv(3)(t)
    for size in (-1e-2, 1e-2):
        assert np.trapezoid((jerk + size * bump) ** 2, t) > np.trapezoid(jerk**2, t)


@pytest.mark.parametrize(("k", "seed"), [(5, 0), (8, 1), (15, 2)])
def test_knot_times_are_near_an_optimisers(k, seed):
    """IPOPT over knot times and speeds at the knots, with limits on nine points a piece, from our solution."""
    import casadi

    draw = np.random.default_rng(seed)
    points, limits = np.cumsum(draw.normal(size=(k, 2)) * 0.5, axis=0), limits_of([2.0, 2.0], 5.0, 80.0)
    ours = aw.trajectories.Waypoints(points, limits, "cubic")
    h, v = casadi.SX.sym("h", k - 1), casadi.SX.sym("v", k, 2)
    rows, bounds = [], []
    for j in range(2):
        rows += [v[0, j], v[k - 1, j]]
        bounds += [0.0, 0.0]
        end = None
        for i in range(k - 1):
            slope = (points[i + 1, j] - points[i, j]) / h[i]
            a = (6 * slope - 4 * v[i, j] - 2 * v[i + 1, j]) / h[i]
            b = (-6 * slope + 2 * v[i, j] + 4 * v[i + 1, j]) / h[i]
            if end is not None:
                rows.append(end - a)
                bounds.append(0.0)
            end = b
            for s in np.linspace(0.0, 1.0, 9):
                rows.append(v[i, j] + a * s * h[i] + 0.5 * (b - a) * h[i] * s * s)
                bounds.append(2.0)
            rows += [a, b, (b - a) / h[i]]
            bounds += [5.0, 5.0, 80.0]
    options = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes"}
    problem = {"x": casadi.vertcat(h, casadi.vec(v)), "f": casadi.sum1(h), "g": casadi.vertcat(*rows)}
    begin = np.concatenate([np.diff(ours.breaks), ours.at(ours.breaks)[1].T.ravel()])
    least = np.concatenate([np.full(k - 1, 1e-4), np.full(2 * k, -np.inf)])
    solver = casadi.nlpsol("solver", "ipopt", problem, options)
    best = float(solver(x0=begin, lbx=least, lbg=-np.array(bounds), ubg=bounds)["f"])
    assert ours.duration < 1.002 * best


def test_dense_waypoints_are_nearly_as_fast_as_their_path_can_be():
    """toppra's time along a spline through points on sines: its accelerations may jump, so that it is a lower bound."""
    knots = np.linspace(0.0, 1.0, 250)
    points = np.sin(2.0 * np.pi * (knots[:, None] * [2.0, 3.3, 4.1] + [0.0, 0.2, 0.7]))
    limits = limits_of(np.full(3, 2.0), 10.0)
    best = by_toppra(None, aw.trajectories.JointPath(points, knots), limits, 2000)
    motion = aw.trajectories.Waypoints(points, limits)
    assert motion.curve == "cubic"
    assert 0.98 * best < motion.duration < 1.02 * best


@pytest.mark.parametrize("k", [2, 3, 8, 20])
def test_turns_take_the_time_that_toppra_finds_along_the_same_path(k):
    points, limits = np.random.default_rng(k).uniform(-1.5, 1.5, (k, 6)), limits_of(np.full(6, 2.0), 5.0)
    motion = aw.trajectories.Waypoints(points, limits)
    s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1) ** 0.5))
    grid = np.append((s[:-1, None] + np.diff(s)[:, None] * np.arange(100) / 100.0).ravel(), s[-1])
    best = by_toppra(None, aw.trajectories.JointPath(points, s), limits, grid)
    assert motion.curve == "time_optimal"
    assert motion.duration == pytest.approx(best, rel=3e-3)
    assert motion.duration < 0.95 * aw.trajectories.Waypoints(points, limits, "cubic").duration
    np.testing.assert_allclose(motion.at(motion.passes)[0], points, atol=1e-12)


def test_the_fastest_curve_is_taken_that_is_continuous_enough():
    points, limits = np.random.default_rng(0).uniform(-1.5, 1.5, (6, 3)), limits_of(np.full(3, 2.0), 5.0)
    fast, cubic = (aw.trajectories.Waypoints(points, limits, curve) for curve in ("fastest", "cubic"))
    assert (fast.curve, cubic.curve) == ("time_optimal", "cubic")
    between = 0.5 * (fast.duration + cubic.duration)
    for changes, curve in (
        ({"limits": limits.replace(jerk={"joint2": 1e9})}, "time_optimal"),
        ({"limits": limits.replace(jerk=100.0)}, "time_optimal"),
        ({"limits": limits.replace(jerk=2.0)}, "cubic"),
        ({"limits": limits.replace(acceleration={"joint2": np.inf})}, "cubic"),
        ({"duration": 1.01 * cubic.duration}, "cubic"),
        ({"duration": between}, "time_optimal"),
        ({"times": 9.0 * np.arange(6.0)}, "cubic"),
        ({"curve": "time_optimal", "duration": 2.0 * cubic.duration}, "time_optimal"),
    ):
        motion = aw.trajectories.Waypoints(**{"points": points, "limits": limits} | changes)
        assert motion.curve == curve, changes
        check_continuous(motion, CURVES[curve])
        if "duration" in changes:
            assert motion.duration == pytest.approx(changes["duration"], rel=1e-12)
        np.testing.assert_allclose(motion.at(motion.passes)[0], points, atol=1e-12)


def test_the_curve_that_keeps_the_limits_of_position_is_taken():
    """Cubic spline and path reach 1.007 and 1.068 rad through the first points, 1.028 and 1.001 through the others."""
    outside = np.array([[0.3, -0.5], [-0.9, -1.0], [0.6, 0.8], [0.2, 0.5]])
    inside = np.array([[-0.9, 0.0], [0.0, -0.5], [-0.7, -1.0], [-0.2, -0.2]])
    for points, position, duration, curve in (
        (outside, 1.1, None, "time_optimal"), (outside, 1.04, None, "cubic"),
        (inside, 1.04, 6.0, "cubic"), (inside, 1.01, 6.0, "time_optimal"),
    ):  # fmt: skip
        limits = limits_of([1.0, 1.0], 3.0, position=position)
        motion = aw.trajectories.Waypoints(points, limits, duration=duration)
        assert motion.curve == curve
        assert np.abs(motion.polynomial.extrema(0)).max() <= position
    for curve in ("fastest", "cubic", "time_optimal"):
        with raises_at(ScenarioError, "Waypoints.points", r" 0\.0\d+ rad .* joint2 between 0\.?\d* s"):
            aw.trajectories.Waypoints(outside, limits_of([1.0, 1.0], 3.0, position=1.005), curve)


@pytest.mark.parametrize(("k", "near"), [(3, 0.0), (3, 1e-6), (8, 1e-2), (20, 1e-9)])
def test_parabolic_blends_are_as_short_as_an_optimisers(k, near):
    """IPOPT over the segments' times, from times that fit; nearly coincident waypoints among them."""
    import casadi

    draw = np.random.default_rng(k)
    points, limits = np.cumsum(draw.normal(size=(k, 2)), axis=0), limits_of([2.0, 1.0], 5.0)
    if near:
        points = np.insert(points, k // 2, points[k // 2] + near * draw.normal(size=2), axis=0)
    ours, x = aw.trajectories.Waypoints(points, limits, "parabolic"), casadi.SX.sym("x", len(points) - 1)
    way, rows, bounds = np.diff(points, axis=0), [], []
    for j in range(2):
        speeds = [way[i, j] * x[i] for i in range(len(way))]
        turns = [speeds[0], *(b - a for a, b in pairwise(speeds)), -speeds[-1]]
        for i, turn in enumerate(turns):
            beside = [x[at] for at in (i - 1, i) if 0 <= at < len(way)]
            rows += [turn * rate for rate in beside]
            bounds += [5.0] * len(beside)
        rows += speeds
        bounds += [float(limits.velocity[j])] * len(way)
    problem = {"x": x, "f": casadi.sum1(1.0 / x), "g": casadi.vertcat(*rows)}
    options = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes"}
    slow = np.full(len(way), 1.0 / (20.0 * ours.duration))
    found = casadi.nlpsol("solver", "ipopt", problem, options)(x0=slow, lbx=1e-6, lbg=-np.array(bounds), ubg=bounds)
    first_and_last_blend = 0.5 * np.diff(ours.breaks)[[0, -1]].sum()
    assert ours.duration - first_and_last_blend == pytest.approx(float(found["f"]), rel=1e-3)


@pytest.mark.parametrize("curve", CURVES)
def test_limits_of_any_size_plan_without_warnings(curve):
    points = np.array([[0.0, 0.0], [0.5, 0.2], [1.0, -0.3]])
    for size in (1e-80, 1e-12, 1e12, 1e80):
        limits = limits_of([1.0, 1.0], size, size)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            motion = aw.trajectories.Waypoints(
                points, limits.replace(jerk=np.inf if curve == "parabolic" else None), curve
            )
        assert (motion.polynomial.largest(2) <= size * (1.0 + 1e-9)).all()


def test_a_thousand_waypoints_are_planned_fast():
    """In the processor's time, beside the same work on a tenth of them; the issue asks for < 1 s on one core."""
    draw = np.random.default_rng(0)
    points, limits = np.cumsum(draw.normal(size=(1000, 6)), axis=0), limits_of(np.full(6, 2.0), 5.0, 80.0)

    def spent(k, curve):
        begin = time.process_time()
        aw.trajectories.Waypoints(points[:k], limits, curve)
        return time.process_time() - begin

    for curve in ("cubic", "quintic", "parabolic", "fastest"):
        spent(10, curve)
        many, few = (min(spent(count, curve) for _ in range(3)) for count in (1000, 100))
        assert many < 10.0 * few + 0.2, curve


def test_a_given_duration_and_given_times():
    points = [[0.0, 0.0], [0.5, 0.2], [1.0, -0.3]]
    for curve in CURVES:
        limits = limits_of([1.0, 1.0], 3.0, np.inf if curve == "parabolic" else 50.0)
        fast = aw.trajectories.Waypoints(points, limits, curve)
        assert aw.trajectories.Waypoints(points, limits, curve, duration=5.0).duration == pytest.approx(5.0, rel=1e-12)
        with raises_at(ScenarioError, "Waypoints.duration", "s or more"):
            aw.trajectories.Waypoints(points, limits, curve, duration=0.9 * fast.duration)
    limits = limits_of([1.0, 1.0], 3.0, 50.0)
    timed = aw.trajectories.Waypoints(points, limits, times=[1.0, 3.0, 6.0])
    assert (timed.time, timed.duration) == (1.0, 5.0)
    np.testing.assert_allclose(timed.at(3.0)[0], [0.5, 0.2], atol=1e-12)
    with raises_at(ScenarioError, "Waypoints.times", r"joint1 .*velocity limit"):
        aw.trajectories.Waypoints(points, limits, times=[1.0, 1.2, 1.4])
    with raises_at(ScenarioError, "Waypoints.times[1]", "s at most"):
        aw.trajectories.Waypoints(points, limits, "parabolic", times=[1.0, 1.2, 1.4])


POINTS = [[0.0, 0.0], [0.5, 0.2], [1.0, -0.3]]
LIMITS = limits_of([1.0, 1.0], 3.0, 50.0, position=1.05)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"points": POINTS[:2], "curve": "natural_quintic"}, "natural quintic"),
        ({"points": [[0.0, 0.0]]}, "two waypoints"),
        ({"points": [0.0, 1.0]}, "two waypoints"),
        ({"points": [[0.0, 0.0], [0.0]]}, "two waypoints"),
        ({"points": [[0.0, 0.0], [np.nan, 1.0]]}, r"points\[1\]\[0\] = nan: expected finite"),
        (
            {"points": [[0.0, 0.0], [0.5, 0.2], [0.5, 0.2], [1.0, 1.0]]},
            r"points\[2\]: .*waypoint before",
        ),
        ({"points": [[0.0, 0.0], [0.0, 1.5], [1.0, 0.0]]}, r"points\[1\] of joint2 = 1.5: 0.45 rad outside"),
        ({"points": [[0.0], [1.0]]}, "waypoints of 1 joints; .*2"),
        (
            {"points": [[0.0, 0.0], [1.04, 1.0], [1.04, -1.0], [0.0, 0.0]]},
            r" 0\.\d+ rad .* joint1",
        ),
        (
            {"curve": "time_optimal", "limits": LIMITS.replace(jerk=np.inf), "times": [0.0, 5.0, 9.0]},
            "curve = 'time_optimal': with times",
        ),
        ({"limits": limits_of([1.0, 1.0]), "curve": "time_optimal"}, "acceleration .*joint1, joint2"),
        ({"curve": "bezier"}, "curve = 'bezier'"),
        ({"times": [0.0, 2.0, 1.0]}, r"times\[2\] = 1.0: not after 2"),
        ({"times": [0.0, 2.0]}, "3 finite numbers"),
        ({"times": [0.0, np.nan, 2.0]}, "3 finite numbers"),
        ({"times": [0.0, 5.0, 9.0], "duration": 3.0}, "expected either"),
        ({"limits": None}, "limits, or times"),
        ({"limits": limits_of([np.inf, np.inf])}, "nothing limits joint1, joint2"),
        ({"limits": limits_of([1.0, 1.0]), "curve": "parabolic"}, "acceleration .*joint1, joint2"),
        ({"time": np.nan}, "time = nan"),
    ],
)
def test_bad_waypoints_are_refused(changes, said):
    with pytest.raises(ScenarioError, match=said):
        aw.trajectories.Waypoints(**{"points": POINTS, "limits": LIMITS} | changes)

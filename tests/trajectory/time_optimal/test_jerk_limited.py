"""Time-optimal motions within limits of jerk: Ruckig on straight lines, limits between grid points, the path, refusals."""

from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial import KDTree

import armwright as aw
from armwright.errors import ScenarioError
from armwright.model import build_model
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.time_optimal.jerk_limited import SpeedProblem
from trajectory.path_problems import limited_in_speed

ARM = aw.load("puma560")


def limits_of(velocity: Any, acceleration: Any, jerk: Any) -> MotionLimits:
    kept = {"velocity": velocity, "acceleration": acceleration, "jerk": jerk}
    return MotionLimits.of(ARM, **kept, torque=np.inf, voltage=np.inf, position=1e6)


def turns(count: int, seed: int = 0) -> np.ndarray:
    """(count, n) poses drawn at random, one far from the next."""
    return np.random.default_rng(seed).uniform(-1.5, 1.5, (count, ARM.n))


@pytest.mark.parametrize(
    ("velocity", "acceleration", "jerk"), [(2.0, 8.0, 50.0), (2.0, 8.0, 5.0), (0.5, 4.0, 400.0), (1.0, 1.0, 1e5)]
)
def test_a_straight_line_takes_the_time_that_ruckig_finds(velocity: float, acceleration: float, jerk: float) -> None:
    ruckig = pytest.importorskip("ruckig", reason="ruckig is the oracle here: pip install ruckig")
    move, found = ruckig.InputParameter(1), ruckig.Trajectory(1)
    move.target_position, move.max_velocity, move.max_acceleration, move.max_jerk = (
        [1.2],
        [velocity],
        [acceleration],
        [jerk],
    )
    ruckig.Ruckig(1).calculate(move, found)
    way = np.array([0.3, -1.2, 0.6, 0.0, 0.1, -0.05])
    motion = aw.trajectories.time_optimal(ARM, [0.0 * way, way], limits_of(velocity, acceleration, jerk))
    assert found.duration * (1.0 - 1e-6) < motion.duration < found.duration * 1.005


@given(st.integers(0, 10**6), st.integers(2, 10))
@settings(max_examples=8, deadline=None)
def test_limits_hold_between_grid_points_along_the_same_path(seed: int, count: int) -> None:
    draw = np.random.default_rng(seed)
    velocity, acceleration, jerk = (draw.uniform(*each, ARM.n) for each in ((0.3, 4.0), (0.5, 20.0), (2.0, 500.0)))
    for most in (velocity, jerk):
        most[draw.integers(0, ARM.n)] = np.inf if seed % 3 == 0 else 1.0
    points = turns(count, seed) * (draw.random(ARM.n) < 0.8)
    points[:, 0] += np.arange(count)
    path, limits = aw.trajectories.JointPath(points), limits_of(velocity, acceleration, jerk)
    motion = aw.trajectories.time_optimal(ARM, path, limits)
    assert motion.excess <= 0.0

    parts = np.linspace(0.0, 1.0, 12)[:-1]  # of every piece: its beginning is that of its polynomial
    t = (motion.breaks[:-1, None] + np.diff(motion.breaks)[:, None] * parts).ravel()
    q, qd, qdd = motion.at(t)
    qddd = motion.polynomial.derivative().derivative().at(t)[1]
    for values, most in ((qd, velocity), (qdd, acceleration), (qddd, jerk)):
        assert (np.abs(values) <= most * (1.0 + 1e-6)).all()
    assert (
        max(
            float((np.abs(values) / most).max()) for values, most in ((qd, velocity), (qdd, acceleration), (qddd, jerk))
        )
        > 0.995
    )

    s = np.linspace(0.0, path.length, 40_001)
    assert KDTree(path.at(s)[0]).query(q)[0].max() < 0.51 * path.length / 40_000 * np.abs(path.at(s)[1]).max() * ARM.n
    free = aw.trajectories.time_optimal(ARM, path, limits.replace(jerk=np.inf))
    assert motion.duration > 0.996 * free.duration  # whose limits between grid points are kept by a bound


def judged(motion: Any, arm: Any, limits: MotionLimits, payload: Any = None) -> dict[str, float]:
    """Largest parts of limits at many times of every piece, by the arm's own dynamics."""
    loaded = arm if payload is None else arm.with_payload(payload.mass, payload.com, payload.inertia, payload.frame)
    dyn, parts = aw.compile(loaded), np.linspace(0.0, 1.0, 402)[:-1]  # friction comes up in a small part of a piece
    t = (motion.breaks[:-1, None] + np.diff(motion.breaks)[:, None] * parts).ravel()
    q, qd, qdd = motion.at(t)
    tau = dyn.inverse_dynamics(q, qd, qdd)
    found = {"velocity": qd, "acceleration": qdd, "torque": tau}
    found["jerk"] = motion.polynomial.derivative().derivative().at(t)[1]
    if np.isfinite(limits.voltage).any():
        found["voltage"] = dyn.motor_voltage(qd, tau)
    return {name: float((np.abs(values) / getattr(limits, name)).max()) for name, values in found.items()}


@pytest.mark.parametrize(
    ("name", "seed"), [pytest.param("cmu-dd", 4), pytest.param("panda", 25), *(
        pytest.param(name, seed, marks=pytest.mark.study) for name in ("cmu-dd", "panda") for seed in range(12)
    )]
)  # fmt: skip
def test_torques_and_voltages_hold_beside_jerk(name: str, seed: int) -> None:
    """With their friction, with limits of acceleration for some, and with a payload for some."""
    draw, arm = np.random.default_rng(seed), aw.load(name)
    payload = aw.Payload(0.0, mass=draw.uniform(0.1, 1.0), com=(0.0, 0.0, 0.02)) if seed % 3 == 1 else None
    points = draw.uniform(-0.8, 0.8, (draw.integers(2, 7), arm.n)) * (draw.random(arm.n) < 0.85)
    points[:, 0] += np.arange(len(points)) / 10.0
    limits = MotionLimits.of(arm, position=1e6)
    limits = limits.replace(acceleration=draw.uniform(3.0, 20.0)) if seed % 2 else limits
    free = aw.trajectories.time_optimal(arm, points, limits, payload=payload)
    for jerk in (1e7, 30.0 * np.abs(points).max() / free.duration**2):
        limited = limits.replace(jerk=jerk)
        motion = aw.trajectories.time_optimal(arm, points, limited, payload=payload)
        found = judged(motion, arm, limited, payload)
        assert motion.excess <= 0.0
        assert max(found.values()) < 1.0 + 1e-6, found
        assert max(found.values()) > 0.995, found
        assert motion.duration > 0.996 * free.duration
        assert jerk < 1e7 or motion.duration < 1.02 * free.duration


def test_voltages_that_limit_speeds_alone_leave_a_motion_at_limits() -> None:
    """So that its duration hardly depends on the grid."""
    arm, points, limits = limited_in_speed(40.0)
    limits = limits.replace(jerk=2000.0)
    motion, finer = (aw.trajectories.time_optimal(arm, points[:2], limits, grid=grid) for grid in (60, 120))
    assert motion.duration == pytest.approx(finer.duration, rel=2e-3)
    assert min(motion.saturated, finer.saturated) > 0.95
    assert max(judged(motion, arm, limits).values()) < 1.0 + 1e-6


def test_a_peak_of_jerk_between_places_is_taken_off_there_alone() -> None:
    """Not by a motion that is slower as a whole."""
    draw = np.random.default_rng(1043)
    points = draw.uniform(-0.7, 0.7, (draw.integers(2, 7), 4))
    limits = MotionLimits.of("open-manipulator-x", position=1e6, jerk=20.0)
    assert aw.trajectories.time_optimal("open-manipulator-x", points, limits, grid=60).saturated > 0.95


def dry(part: float) -> Any:
    """`cmu-dd` with dry friction, as a part of the torque that its motors have."""
    arm = aw.load("cmu-dd")
    joints = (
        joint.replace(friction=joint.friction.replace(coulomb_positive_n_m=c, coulomb_negative_n_m=c))
        for joint, c in zip(arm.record.joints, part * MotionLimits.of(arm).torque, strict=True)
    )
    return build_model(arm.record.replace(joints=tuple(joints)))


@pytest.mark.parametrize("count", [5, 6])
def test_dry_friction_that_jumps_at_turns_keeps_a_motion_within_its_limits(count: int) -> None:
    arm, points = dry(0.2), turns(count, 5) if count == 6 else 0.8 * turns(5, 6)
    limits = MotionLimits.of(arm, position=1e6, jerk=3000.0)
    motion = aw.trajectories.time_optimal(arm, points, limits)
    assert 0.99 < max(judged(motion, arm, limits).values()) < 1.0 + 1e-6
    assert motion.duration < 1.03 * aw.trajectories.time_optimal(arm, points, limits.replace(jerk=np.inf)).duration


def test_a_motion_that_slower_would_take_more_torque_than_there_is_is_refused() -> None:
    """Near its end it falls short of what gravity and friction take, and gets there by slowing down."""
    arm, points = dry(0.3), turns(6, 5)
    limits = MotionLimits.of(arm, position=1e6)
    assert aw.trajectories.time_optimal(arm, points, limits).duration < 10.0
    with pytest.raises(ScenarioError) as caught:
        aw.trajectories.time_optimal(arm, points, limits.replace(jerk=3000.0))
    assert caught.value.place == "limits.jerk"


def test_accelerations_are_continuous_and_nothing_at_both_ends() -> None:
    motion = aw.trajectories.time_optimal(ARM, turns(4), limits_of(2.0, 5.0, 60.0), time=1.0)
    inner = motion.breaks[1:-1]
    for before, after in zip(motion.at(np.nextafter(inner, 0.0)), motion.at(inner), strict=True):
        np.testing.assert_allclose(before, after, atol=1e-9)
    np.testing.assert_allclose(motion.at(motion.breaks[[0, -1]])[2], 0.0, atol=1e-9)
    t = np.linspace(0.9, motion.breaks[-1] + 0.1, 301)
    for found, expected in zip(motion.at(t), motion.polynomial.at(t), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("count", [3, 20])
def test_without_a_limit_of_jerk_that_matters_it_takes_as_long_as_without(count: int) -> None:
    limits = limits_of(2.0, 5.0, np.inf)
    free = aw.trajectories.time_optimal(ARM, turns(count, 3), limits)
    assert aw.trajectories.time_optimal(ARM, turns(count, 3), limits.replace(jerk=1e9)).duration == pytest.approx(
        free.duration, rel=5e-3
    )


def test_a_lower_limit_of_jerk_takes_longer() -> None:
    durations = [
        aw.trajectories.time_optimal(ARM, turns(5), limits_of(2.0, 8.0, jerk)).duration for jerk in (400.0, 50.0, 5.0)
    ]
    assert durations == sorted(durations)
    assert durations[2] > 1.2 * durations[0]


def test_limits_of_joints_that_stay_ask_for_nothing() -> None:
    points = turns(4) * (np.arange(ARM.n) > 0)
    limits = limits_of(2.0, 5.0, np.inf)
    plain = aw.trajectories.time_optimal(ARM, points, limits)
    assert (
        aw.trajectories.time_optimal(ARM, points, limits.replace(jerk={ARM.names[0]: 3.0})).duration == plain.duration
    )


def test_derivatives_of_the_problem_are_differences() -> None:
    path, limits = aw.trajectories.JointPath(turns(3)), limits_of(2.0, 5.0, 60.0)
    draw, s = np.random.default_rng(0), np.linspace(0.0, 1.0, 6) * 3.0
    start = np.stack([draw.uniform(0.5, 1.5, 6), draw.uniform(0.5, 1.5, 6), draw.normal(size=6)], axis=1)
    problem = SpeedProblem.of(path, limits, s, start)
    y = problem.unknowns(start)
    step = 1e-6 * draw.normal(size=len(y))
    for terms in (problem.limited, problem.zero):
        for here, before, after in zip(terms(y), terms(y - step), terms(y + step), strict=True):
            np.testing.assert_allclose(here.change(step), 0.5 * (after.value - before.value), rtol=1e-4, atol=1e-12)
    for here, before, after in zip(
        problem.limited(y), problem.limited(y - step), problem.limited(y + step), strict=True
    ):
        force = draw.normal(size=here.value.shape)
        slopes, _, curves = here.sums(0.0 * force, force, force)
        changes = [
            0.5 * (b - a)
            for a, b in zip(before.sums(force, force, force)[0], after.sums(force, force, force)[0], strict=True)
        ]
        for a, change in enumerate(changes):
            moved = sum(
                curve * step[here.at[at[1] if at[0] == a else at[0]]] for at, curve in curves.items() if a in at
            )
            np.testing.assert_allclose(moved + 0.0 * slopes[a], change, rtol=1e-3, atol=1e-9 * np.abs(slopes[a]).max())


@pytest.mark.parametrize(
    ("changes", "options", "place"),
    [
        ({}, {"speeds": (0.1, 0.0)}, "speeds"),
        ({"acceleration": np.inf}, {}, "limits"),
    ],
)
def test_what_it_cannot_do_is_refused(changes: dict[str, Any], options: dict[str, Any], place: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        aw.trajectories.time_optimal(ARM, turns(3), limits_of(2.0, 5.0, 60.0).replace(**changes), **options)
    assert caught.value.place == place

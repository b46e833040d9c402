"""Time-optimal motions: closed forms, toppra and IPOPT as oracles, limits on denser grids, the simulator, bad input."""

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import assume, given, settings

import armwright as aw
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.trajectory.time_optimal import PathMotion, plan
from armwright.trajectory.time_optimal.plan import grid_points
from armwright.trajectory.time_optimal.planner import Planner
from physics.arms import arm as built_arm
from raises_at import raises_at
from simulation.first_steps import geared_motor, plain_arm
from trajectory.path_problems import (
    RELAXED,
    by_ipopt,
    by_toppra,
    largest_use,
    limited_in_speed,
    random_path,
    random_problem,
    reachable_limits,
)

RIGID = {"friction": None, "efficiency": None}


def test_a_motor_under_voltage_takes_the_time_of_its_equation() -> None:
    """J q̈ = Kt n (V - n Ke q̇) / R from rest to rest: full voltage forth, then full voltage back."""
    arm, goal, volts = geared_motor(), 0.004, 24.0
    drive = arm.coordinates[0].drive
    constant = float(drive.gear_ratio * drive.torque_constant)
    inertia = float(aw.mass_matrix(arm, np.zeros(1))[0, 0])
    tau, fastest = inertia * float(drive.resistance) / constant**2, volts / constant
    path = aw.trajectories.JointPath([[0.0], [goal]])
    motion = aw.trajectories.time_optimal(arm, path, aw.trajectories.MotionLimits.of(arm, voltage=volts), grid=2000)

    def travelled(forth: float) -> tuple[float, float]:
        speed = fastest * (1.0 - np.exp(-forth / tau))
        back = tau * np.log(1.0 + speed / fastest)  # v̇ = -(v + fastest) / τ
        return fastest * forth - tau * speed + tau * speed - fastest * back, forth + back

    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if travelled(middle)[0] < goal else (low, middle)
    assert motion.duration == pytest.approx(travelled(low)[1], rel=1e-3)
    assert motion.duration >= travelled(low)[1]
    assert motion.saturated > 0.99
    t = np.linspace(0.0, 0.9 * low, 500)  # of full voltage forth: no stairs
    np.testing.assert_allclose(motion.at(t)[2][:, 0], fastest / tau * np.exp(-t / tau), rtol=2e-3)


def test_voltages_that_limit_speeds_alone_refuse_no_motion() -> None:
    """At speeds where the torque's limit is the lower one, a little faster the voltage's is."""
    arm, points, limits = limited_in_speed(10.0)
    path = aw.trajectories.JointPath(points)
    motion = aw.trajectories.time_optimal(arm, path, limits, grid=100)
    _, first, _ = path.at(np.linspace(0.0, path.length, 4000))
    least = path.length * np.mean(np.abs(aw.compile(arm).motor_voltage(first, 0.0 * first)).max(axis=1)) / 10.0
    assert 0.95 * least < motion.duration < 1.1 * least
    assert motion.saturated > 0.95


def test_accelerations_go_on_smoothly_where_one_limit_is_active() -> None:
    arm = aw.load("cmu-dd")
    motion = aw.trajectories.time_optimal(arm, random_path(arm, 0), grid=200)
    knots = motion.breaks[1:-1]
    before, after = (motion.at(np.nextafter(knots, side))[2] for side in (-np.inf, np.inf))
    jumps, steps = np.abs(after - before).max(axis=1), np.abs(np.diff(motion.at(motion.breaks)[2], axis=0)).max(axis=1)
    assert np.median(jumps) < 0.1 * np.median(steps)  # of stairs it would be 1
    first = knots < 0.05 * motion.duration
    assert jumps[first].max() < 0.02 * np.abs(after).max()


@pytest.mark.study
def test_many_waypoints_with_all_limits_of_the_motors() -> None:
    arm = aw.load("cmu-dd")
    limits = aw.trajectories.MotionLimits.of(arm, velocity=8.0, acceleration=80.0)
    path = random_path(arm, 1, 40)
    motion = aw.trajectories.time_optimal(arm, path, limits)
    assert largest_use(arm, motion, limits) <= 1.0 + 1e-6
    finer = aw.trajectories.time_optimal(arm, path, limits, grid=2500)
    assert finer.duration < motion.duration < 1.015 * finer.duration
    assert finer.saturated > 0.95


def test_a_grid_that_is_too_coarse_is_made_finer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "BETWEEN", 1)
    arm, path, limits = random_problem(384)  # of 100 points it would take more than twice as long
    motion = aw.trajectories.time_optimal(arm, path, limits, grid=100)
    assert len(motion.s) > 200
    assert motion.duration < 1.02 * aw.trajectories.time_optimal(arm, path, limits, grid=400).duration
    assert largest_use(arm, motion, limits) <= 1.0 + 1e-6


@pytest.mark.parametrize("name", ["lwa4p", "puma560"])
@pytest.mark.sample(1)
def test_torques_that_bind_nowhere_cost_no_time(name: str) -> None:
    """Of these a last excess of 8e-6 of a velocity does not shrink away: the whole plan is made slower by as little."""
    arm = built_arm(name)
    path = random_path(arm, 2, 3)
    limits = reachable_limits(arm, path, 2).replace(voltage=np.inf)
    strong, free = (limits.replace(torque=torque) for torque in (1e3 * limits.torque, np.inf))
    motion = aw.trajectories.time_optimal(arm, path, strong)
    assert motion.duration == pytest.approx(aw.trajectories.time_optimal(arm, path, free).duration, rel=1e-3)
    assert largest_use(arm, motion, strong) <= 1.0 + 1e-6


@pytest.mark.parametrize(("name", "seed"), [("panda", 0), ("panda", 1), ("lwa4p", 0), ("cmu-dd", 0), ("cmu-dd", 3)])
@pytest.mark.sample(1)
def test_rigid_bodies_take_the_time_that_toppra_finds(name: str, seed: int) -> None:
    arm = aw.load(name).replace(**RIGID)
    path = random_path(arm, seed)
    limits = aw.trajectories.MotionLimits.of(arm, voltage=np.inf)
    motion = aw.trajectories.time_optimal(arm, path, limits)
    assert motion.duration == pytest.approx(by_toppra(arm, path, limits), rel=5e-3)
    assert aw.trajectories.limits_report(arm, motion, limits).kept


@given(st.integers(0, 10**6))
@settings(max_examples=8)
@pytest.mark.study
def test_random_rigid_problems_take_the_time_that_toppra_finds(seed: int) -> None:
    arm = built_arm(("panda", "cmu-dd", "lwa4p", "workshop")[seed % 4]).replace(**RIGID, springs=None)
    path = random_path(arm, seed, 4)
    limits = reachable_limits(arm, path, seed).replace(voltage=np.inf)
    duration, expected = (
        aw.trajectories.time_optimal(arm, path, limits, grid=200).duration,
        by_toppra(arm, path, limits, 500),
    )
    assume(not np.isnan(expected))  # of some it finds none
    assert duration == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(("name", "seed"), [("cmu-dd", 0), ("cmu-dd", 1), ("lwa4p", 0)])
@pytest.mark.study
def test_no_local_optimum_of_ipopt_is_faster(name: str, seed: int) -> None:
    arm = aw.load(name)
    path, limits = random_path(arm, seed, 4), aw.trajectories.MotionLimits.of(arm)
    s = grid_points(path, 40)
    planner = Planner(aw.compile(arm), limits, path, s, (1e-10, 1e-10))
    x = planner.fastest().x  # with the limits at grid points alone, as IPOPT has them
    draw = np.random.default_rng(seed)
    starts = [0.5 * x, np.full(len(s), 1e-3 * x.max()), x.max() * draw.uniform(0.01, 1.0, len(s))]
    found = by_ipopt(arm, path, limits, s, starts)
    duration = (2.0 * np.diff(s) / (np.sqrt(x[1:]) + np.sqrt(x[:-1]))).sum()
    assert len(found) >= 2
    assert duration == pytest.approx(min(found), rel=3e-3)


@given(st.integers(0, 10**6))
@settings(max_examples=24)
@pytest.mark.study
def test_limits_hold_on_a_grid_ten_times_denser(seed: int) -> None:
    """Some of the problems of tools/motion_seeds.py."""
    arm, path, limits = random_problem(seed)
    motion = aw.trajectories.time_optimal(arm, path, limits, grid=60)
    assert largest_use(arm, motion, limits) <= 1.0 + 1e-6
    assert motion.excess <= 5e-7


def test_a_motion_is_its_polynomial_and_rests_before_and_after() -> None:
    arm = aw.load("cmu-dd")
    path = random_path(arm, 0)
    motion = aw.trajectories.time_optimal(arm, path, time=0.5, grid=60)
    t = np.linspace(0.0, 1.0 + motion.duration, 501)
    for found, expected in zip(motion.at(t), motion.polynomial.at(t), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    for here, waypoint in ((0.2, 0), (0.5, 0), (99.0, -1)):
        q, qd, _ = motion.at(here)
        np.testing.assert_allclose(q, path.waypoints[waypoint], atol=1e-12)
        np.testing.assert_array_equal(qd, 0.0)
    h, inner = 1e-6, np.linspace(0.6, 0.4 + motion.duration, 37)
    np.testing.assert_allclose(
        (motion.at(inner + h)[0] - motion.at(inner - h)[0]) / (2.0 * h), motion.at(inner)[1], atol=2e-4
    )
    np.testing.assert_allclose(motion(0.9)[1], motion.at(0.9)[1])


def test_the_same_curve_with_another_parameter_takes_the_same_time() -> None:
    arm = aw.load("cmu-dd")
    path = random_path(arm, 1)
    scaled = aw.trajectories.JointPath(path.waypoints, 7.0 * path.parameter)
    assert aw.trajectories.time_optimal(arm, scaled).duration == pytest.approx(
        aw.trajectories.time_optimal(arm, path).duration, rel=1e-6
    )


def test_more_costs_time_and_path_speeds_at_the_ends_save_some() -> None:
    arm = aw.load("lwa4p")
    path = random_path(arm, 2)
    usual = aw.trajectories.time_optimal(arm, path, grid=200)
    limits = aw.trajectories.MotionLimits.of(arm)
    hand = aw.Payload(0.0, 3.0, [0.0, 0.0, 0.05], [0.01, 0.01, 0.01])
    weak = limits.replace(torque=1.2 * limits.torque, velocity=10.0)
    assert (
        aw.trajectories.time_optimal(arm, path, weak, grid=200, payload=hand).duration
        > aw.trajectories.time_optimal(arm, path, weak, grid=200).duration
    )
    carried = aw.trajectories.time_optimal(arm, path, weak, grid=200, payload=hand)
    assert aw.trajectories.limits_report(arm, carried, weak, payload=hand).kept
    assert not aw.trajectories.limits_report(
        arm, aw.trajectories.time_optimal(arm, path, weak, grid=200), weak, payload=hand
    ).kept
    flying = aw.trajectories.time_optimal(arm, path, grid=200, speeds=(0.3, 0.2))
    assert flying.duration < usual.duration
    first, second = (np.abs(flying.at(t)[1] / path.at(s)[1]) for t, s in ((0.0, 0.0), (flying.duration, path.length)))
    np.testing.assert_allclose(first, 0.3)
    np.testing.assert_allclose(second, 0.2)


@pytest.mark.study
def test_dry_friction_and_lossy_gears_are_known() -> None:
    arm = plain_arm(smoothing=0.02)
    path = random_path(arm, 0, 3)
    limits = aw.trajectories.MotionLimits.of(arm, position=3.0)
    motion = aw.trajectories.time_optimal(arm, path, limits)
    assert aw.trajectories.limits_report(arm, motion, limits).kept
    assert motion.saturated > 0.98
    assert motion.duration > aw.trajectories.time_optimal(arm.replace(**RIGID), path, limits).duration


@pytest.mark.study
def test_a_plan_by_acceleration_alone_is_slower_or_asks_for_more_volts_than_there_are() -> None:
    arm = aw.load("cmu-dd")
    path = random_path(arm, 0)
    motion = aw.trajectories.time_optimal(arm, path, grid=150)
    qdd = motion.at(np.linspace(0.0, motion.duration, 2000))[2]
    alone = aw.trajectories.MotionLimits.of(arm, torque=np.inf, voltage=np.inf, acceleration=np.abs(qdd).max(axis=0))
    hasty = aw.trajectories.time_optimal(arm, path, alone, grid=150)
    assert not aw.trajectories.limits_report(arm, hasty).kept
    assert aw.trajectories.limits_report(arm, hasty, alone).kept
    safe, factor = hasty, 1.0  # accelerations made smaller until the motors can do it
    while not aw.trajectories.limits_report(arm, safe).kept:
        factor *= 0.7
        safe = aw.trajectories.time_optimal(
            arm, path, alone.replace(acceleration=factor * alone.acceleration), grid=150
        )
    assert motion.duration < 0.8 * safe.duration


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_simulated_arm_follows_without_feedback_and_within_its_volts(seed: int) -> None:
    arm, period = aw.load("cmu-dd"), 1e-3
    limits, path = aw.trajectories.MotionLimits.of(arm), random_path(arm, seed)
    motion = aw.trajectories.time_optimal(arm, path)
    assert motion.saturated > 0.95
    accelerations = np.abs(motion.at(np.linspace(0.0, motion.duration, 3000))[2]).max(axis=0)
    free = limits.replace(torque=np.inf, voltage=np.inf, acceleration=accelerations)
    # time goes as 1/√acceleration
    scale = (aw.trajectories.time_optimal(arm, path, free).duration / motion.duration) ** 2
    alone = aw.trajectories.time_optimal(arm, path, free.replace(acceleration=scale * accelerations))
    assert alone.duration == pytest.approx(motion.duration, rel=1e-3)
    above, most, error = _played(arm, motion, period)
    assert above <= 0.01
    assert most <= 1.01
    assert error < 30e-3  # [rad]: without feedback, on an arm that hangs and swings
    above, _, unaware = _played(arm, alone, period)
    assert above > 0.1
    assert unaware > 10.0 * error


def _played(arm: Model, motion: PathMotion, period: float) -> tuple[float, float, float]:
    """Share of ticks whose voltage before clipping is above a limit, the largest part of a limit, the largest error [rad]."""
    reference = replace(motion, time=-0.5 * period)  # a voltage is held for a tick: it is that of its middle
    loop = aw.Loop(
        lambda t, r, y: aw.motor_voltage(arm, r.qd, aw.inverse_dynamics(arm, r.q, r.qd, r.qdd)), reference, period
    )
    duration = period * np.ceil(motion.duration / period)
    run = aw.simulate(aw.Scenario(arm, duration, start=motion.path.waypoints[0], loop=loop))
    share = np.abs(run.u.values / aw.trajectories.MotionLimits.of(arm).voltage).max(axis=1)
    error = np.abs(run.q.values - motion.at(run.time.values)[0]).max()
    return float((share > 1.0 + 1e-6).mean()), float(share.max()), float(error)


@pytest.mark.parametrize("place", ["path", "limits", "payload", "grid", "speeds", "time"])
def test_bad_input_is_refused(place: str) -> None:
    arm = aw.load("cmu-dd")
    good = {"path": random_path(arm, 0), "limits": aw.trajectories.MotionLimits.of(arm)}
    bad = {
        "path": [[[0.0] * 6] * 2, [[0.0] * 5, [1.0] * 5], [[np.nan] * 6, [0.0] * 6], [[0.0] * 6, [9.0] + [0.0] * 5]],
        "limits": [aw.trajectories.MotionLimits.of(aw.load("two-link")), 3.0, aw.trajectories.MotionLimits.of(arm, **RELAXED)],
        "payload": [aw.Payload(0.0, 500.0, [0, 0, 0], [0.1, 0.1, 0.1]), 3.0],
        "grid": [3, 1.5, True, 10**9, None],
        "speeds": [(-1.0, 0.0), (np.nan, 0.0), 3.0, (1e4, 0.0), (0.0, 1e4)],
        "time": [np.nan, "soon"],
    }[place]  # fmt: skip
    for value in bad:
        with pytest.raises(ScenarioError):
            aw.trajectories.time_optimal(arm, **{**good, place: value})


@pytest.mark.parametrize("end", [0, 1])
def test_a_path_speed_that_is_too_high_is_named_with_the_highest(end: int) -> None:
    arm = aw.load("cmu-dd")
    path, speeds = random_path(arm, 0), np.where(np.arange(2) == end, 1e3, 0.0)
    with raises_at(ScenarioError, f"speeds[{end}]", r"[\d.]+ or less") as caught:
        aw.trajectories.time_optimal(arm, path, grid=50, speeds=tuple(speeds))
    highest = float(caught.value.expected.split()[0])
    aw.trajectories.time_optimal(arm, path, grid=50, speeds=tuple(0.95e-3 * highest * speeds))
    with pytest.raises(ScenarioError, match="speeds"):
        aw.trajectories.time_optimal(arm, path, grid=50, speeds=tuple(1.1e-3 * highest * speeds))


def test_a_motor_that_gravity_exceeds_is_named_with_the_place_and_the_torque() -> None:
    arm = aw.load("two-link")
    path = aw.trajectories.JointPath([[0.0, 0.0], [1.2, 0.4]])
    weak = aw.trajectories.MotionLimits.of(arm, torque=[15.0, 100.0])
    with pytest.raises(ScenarioError) as caught:
        aw.trajectories.time_optimal(arm, path, weak)
    s = np.linspace(0.0, path.length, 2000)
    weight = np.abs(aw.compile(arm).gravity_torques(path.at(s)[0]))[:, 0].max()
    message = str(caught.value)
    assert arm.names[0] in message
    assert f"{weight:.3g}"[:3] in message
    assert "15" in message


def test_a_path_that_leaves_the_position_limits_between_waypoints_is_named() -> None:
    arm = aw.load("lwa4p")
    top = float(arm.coordinates[0].limits.position[1])
    points = np.zeros((4, 6))
    points[1:3, 0], points[3, 1] = 0.999 * top, 0.2
    with raises_at(ScenarioError, "path at s = 2 of 4", "joint1") as caught:
        aw.trajectories.time_optimal(arm, aw.trajectories.JointPath(points, [0.0, 1.0, 3.0, 4.0]))
    assert str(caught.value).startswith("path at s = 2 of 4: joint1 is ")


def test_friction_that_exceeds_a_motor_is_named() -> None:
    arm = plain_arm()  # dry friction of 0.25 N m that holds what it does not let move
    limits = aw.trajectories.MotionLimits.of(arm, torque={"elbow": 0.2}, position=3.0)
    with pytest.raises(ScenarioError, match=r"friction, .* N m of elbow") as caught:
        aw.trajectories.time_optimal(arm.replace(gravity=[0.0, 0.0, 0.0]), random_path(arm, 0), limits, grid=50)
    assert "0.2 N m" in str(caught.value)

"""Verdicts on limits: each kind of motion, each kind of limit, just kept and just exceeded, against a dense grid.

The oracle samples positions, speeds and accelerations of the motion itself ten times as densely as a report, takes the jerk from
differences of the acceleration, and torques and voltages from the float functions of the arm.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.trajectory.limits_report import dense_times, limits_report
from armwright.trajectory.piecewise import PiecewisePolynomial
from physics.arms import arm

ARM = "cmu-dd"  # six joints with torque and voltage
QUANTITIES = ("position", "velocity", "acceleration", "jerk", "torque", "voltage")
WIDE = {"position": 1e3, "velocity": 1e3, "acceleration": 1e4, "jerk": 1e6, "torque": 1e6, "voltage": 1e6}
START, GOAL = np.array([-0.5, -0.3, 0.4, 0.0, 0.5, 0.0]), np.array([0.4, 0.1, -0.2, 0.3, -0.1, 0.5])
POINTS = np.array([START, [0.0, 0.2, 0.3, -0.1, 0.2, 0.4], GOAL])


def wide() -> aw.trajectories.MotionLimits:
    return aw.trajectories.MotionLimits.of(arm(ARM), **WIDE)


def planning() -> aw.trajectories.MotionLimits:
    return aw.trajectories.MotionLimits.of(
        arm(ARM), velocity=1.5, acceleration=6.0, jerk=80.0, torque=np.inf, voltage=np.inf
    )


def tool_path() -> aw.trajectories.Motion:
    model = arm(ARM)
    start = aw.forward_kinematics(model, POINTS[1])
    path = aw.trajectories.CartesianPath([aw.trajectories.Line(start[:3, 3] + [-0.05, 0.04, -0.03])], start)
    return aw.trajectories.follow_path(model, path, 0.1, 1.0, near=POINTS[1], limits=planning())


def moving_through() -> aw.trajectories.Motion:
    """Two segments with a moving state between them, then a dwell, then a move whose acceleration jumps."""
    speed = np.full(6, 0.3)
    first = aw.trajectories.MinimumJerk(START, POINTS[1], 1.1, goal_velocity=speed)
    second = aw.trajectories.MinimumJerk(POINTS[1], GOAL, 0.9, start_velocity=speed, time=1.1)
    dwell = PiecewisePolynomial(np.array([2.0, 2.2]), GOAL[None, :, None])
    return aw.trajectories.Joined([first, second, dwell, aw.trajectories.Cubic(GOAL, START, 1.3, time=2.2)])


def ruckig() -> aw.trajectories.Motion:
    pytest.importorskip("ruckig", reason="ruckig is not installed")
    return aw.trajectories.Ruckig(START, GOAL, planning(), start_velocity=np.full(6, 0.2))


KINDS = {
    "cubic spline": lambda: aw.trajectories.Waypoints(POINTS, planning(), "cubic"),
    "natural cubic spline": lambda: aw.trajectories.Waypoints(POINTS, planning(), "natural_cubic"),
    "quintic spline": lambda: aw.trajectories.Waypoints(POINTS, planning(), "quintic", times=[0.5, 1.4, 3.0]),
    "parabolic blends": lambda: aw.trajectories.Waypoints(POINTS, planning(), "parabolic"),
    "time-optimal": lambda: aw.trajectories.time_optimal(arm(ARM), POINTS, grid=60),
    "S-curve": lambda: aw.trajectories.SCurve(START, GOAL, planning(), time=0.3),
    "trapezoid": lambda: aw.trajectories.Trapezoid(START, GOAL, planning()),
    "cubic": lambda: aw.trajectories.Cubic(START, GOAL, limits=planning(), time=1.0),
    "quintic": lambda: aw.trajectories.Quintic(START, GOAL, 1.2),
    "minimum jerk": lambda: aw.trajectories.MinimumJerk(START, GOAL, 1.0, start_velocity=np.full(6, -0.4)),
    "Ruckig": ruckig,
    "ramp": lambda: aw.trajectories.Ramp(START, GOAL, 2.0),
    "tool path": tool_path,
    "shaped": lambda: aw.trajectories.InputShaper(aw.trajectories.SCurve(START, GOAL, planning()), 3.0),
    "joined": moving_through,
    "joined in joined": lambda: aw.trajectories.Joined(
        [moving_through(), aw.trajectories.Quintic(START, GOAL, 1.0, time=3.5)]
    ),
}
BODY = (aw.Payload(0.7, 3.0, [0.0, 0.0, 0.1], [0.01, 0.01, 0.01]), aw.Payload(1.3, 0.0))


def truth(motion: aw.trajectories.Motion, payloads=()) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times, and by quantity the values there (k, n)."""
    model = arm(ARM)
    t = dense_times(motion, 300)
    inside = [body.time for body in payloads if t[0] < body.time < t[-1]]
    t = np.union1d(t, [*inside, *np.nextafter([*inside, t[-1]], -np.inf)])
    q, qd, qdd = motion.at(t)
    step = np.diff(t)[:, None]
    jerk = np.divide(np.diff(qdd, axis=0), step, out=np.zeros_like(qdd[1:]), where=step > 1e-9)
    tau = aw.compile(model).inverse_dynamics(q, qd, qdd)
    for k, body in enumerate(payloads):
        held = (t >= body.time) & (t < (payloads[k + 1].time if k + 1 < len(payloads) else np.inf))
        if body.mass:
            loaded = model.with_payload(body.mass, body.com, body.inertia)
            tau[held] = aw.compile(loaded).inverse_dynamics(q[held], qd[held], qdd[held])
    volts = aw.compile(model).motor_voltage(qd, tau)
    values = {"position": q, "velocity": qd, "acceleration": qdd, "torque": tau, "voltage": volts}
    return t, values | {"jerk": np.concatenate([jerk, jerk[-1:]])}


def jumping(motion: aw.trajectories.Motion) -> dict[str, set[int]]:
    """By quantity the joints where it is infinite, from differences of speed and acceleration over 2e-9 s around the breaks."""
    breaks, found = np.asarray(motion.breaks), []
    for order in (1, 2):
        before, after = (motion.at(breaks + side)[order] for side in (-1e-9, 1e-9))
        rounding = 1e-4 * np.abs(motion.at(dense_times(motion))[order]).max()
        found.append((breaks, after - before, rounding))
    speed, acceleration = ({int(k) for k in np.flatnonzero((np.abs(d) > r).any(axis=0))} for _, d, r in found)
    impacts: set[int] = set()
    for row in np.flatnonzero((np.abs(found[0][1]) > found[0][2]).any(axis=1)):
        impulse = np.abs(aw.mass_matrix(arm(ARM), motion.at(breaks[row])[0]) @ found[0][1][row])
        impacts |= {int(k) for k in np.flatnonzero(impulse > 1e-6 * impulse.max())}
    return {"acceleration": speed, "jerk": speed | acceleration, "torque": impacts, "voltage": impacts}


@pytest.mark.sample(2)
@pytest.mark.parametrize("payloads", [(), pytest.param(BODY, marks=pytest.mark.study)], ids=["empty", "loaded"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_limit_is_exceeded_exactly_where_a_dense_grid_says_so(kind, payloads):
    """Every limit of every joint a little below, then a little above the largest value of the grid."""
    motion, model = KINDS[kind](), arm(ARM)
    t, values = truth(motion, payloads)
    infinite = jumping(motion)
    names, moves = wide().names, {}
    for exceeded in (True, False):
        limits = {}
        for quantity in QUANTITIES:
            most = np.abs(values[quantity]).max(axis=0)
            margin = 2e-2 if quantity == "jerk" else 1e-4  # of the grid's differences
            moves[quantity] = most > 1e-6
            limits[quantity] = np.where(moves[quantity], most * (1.0 + (-margin if exceeded else margin)), 1e6)
        limits["position"] = np.stack([-limits["position"], limits["position"]], axis=-1)
        report = limits_report(model, motion, wide().replace(**limits), payload=payloads)
        # of several motions in sequence the largest counts
        by_share = sorted(report.excess, key=lambda each: each.share)
        finite = {(each.joint, each.quantity): each for each in by_share if np.isfinite(each.share)}
        wanted = {(names[k], quantity) for quantity in QUANTITIES for k in np.flatnonzero(moves[quantity])}
        assert {(each.joint, each.quantity) for each in report.excess if np.isinf(each.share)} == {
            (names[k], quantity) for quantity in infinite for k in infinite[quantity]
        }
        assert report.kept == (not exceeded and not any(map(len, infinite.values())))
        assert set(finite) == (wanted if exceeded else set())
        assert "no limit" not in str(report)
        for (joint, quantity), found in finite.items():
            rows = values[quantity][:, names.index(joint)]
            margin = 2e-2 if quantity == "jerk" else 2e-4
            assert abs(found.value) == pytest.approx(np.abs(rows).max(), rel=margin)
            assert found.share == pytest.approx(1.0, rel=2.0 * margin)
            before, after = np.searchsorted(t, [found.time - 1e-2, found.time + 1e-2])
            assert np.abs(rows[max(before - 1, 0) : after + 1]).max() == pytest.approx(abs(found.value), rel=margin)


def test_positions_beyond_one_sided_limits_are_named():
    model = arm("two-link")
    motion = aw.trajectories.Quintic([0.0, 0.0], [0.5, -0.5], 1.0)
    for bounds, name in (([[-np.inf, 0.4], [-9, 9]], "shoulder"), ([[-9, 9], [-0.4, np.inf]], "elbow")):
        report = limits_report(model, motion, aw.trajectories.MotionLimits.of(model, position=bounds))
        (found,) = [each for each in report.excess if each.quantity == "position"]
        assert found.joint == name
        assert found.share == pytest.approx(1.1)
        assert abs(found.limit) == 0.4
    roomy = aw.trajectories.MotionLimits.of(model, position=[[-np.inf, 0.6], [-0.6, np.inf]])
    assert not [each for each in limits_report(model, motion, roomy).excess if each.quantity == "position"]


def test_a_step_keeps_no_limit_of_speed():
    model = arm("two-link")
    limits = aw.trajectories.MotionLimits.of(model, velocity=100.0, acceleration=1e6, torque=np.inf, voltage=np.inf)
    report = limits_report(model, aw.trajectories.Step([0.0, 0.0], [0.1, 0.0], time=0.5), limits)
    assert {(each.joint, each.quantity) for each in report.excess} == {
        ("shoulder", "velocity"),
        ("shoulder", "acceleration"),
    }
    assert limits_report(model, aw.trajectories.Step([0.0, 0.0], [0.0, 0.0]), limits).kept


def test_motions_that_meet_at_different_speeds_are_named_where_they_meet():
    model = arm("two-link")
    parts = [
        aw.trajectories.Quintic([0.0, 0.0], [0.2, 0.2], 1.0),
        aw.trajectories.MinimumJerk([0.2, 0.2], [0.5, 0.2], 1.0, time=1.0),
    ]
    hasty = replace(parts[1], start_velocity=[0.3, 0.0])
    limits = aw.trajectories.MotionLimits.of(model, velocity=100.0, acceleration=1e6, torque=1e6, voltage=1e6)
    assert limits_report(model, aw.trajectories.Joined(parts), limits).kept
    report = limits_report(model, aw.trajectories.Joined([parts[0], hasty]), limits)
    assert report.parts[0].kept
    found = {(each.joint, each.quantity): each for each in report.parts[1].excess}
    assert found["shoulder", "acceleration"].time == 1.0
    assert ("elbow", "acceleration") not in found  # its speed does not jump, but the impact reaches its motor
    assert ("elbow", "torque") in found
    assert "shoulder: speed jumps by up to 0.3 rad/s at 1 s: its limit of acceleration, 1e+06 rad/s²" in str(report)


def test_limits_that_cannot_be_checked_are_named():
    model = arm(ARM)
    motion = aw.trajectories.Quintic(START, GOAL, 2.0)
    bodies = tuple(
        replace(body, drive=replace(body.drive, resistance=None)) if body.joint == "joint3" else body
        for body in model.bodies
    )
    incomplete, limits = replace(model, bodies=bodies), wide()
    report = limits_report(incomplete, motion, limits)
    assert report.unchecked == (f"voltage of {', '.join(limits.names)}: the record has no motor constants of joint3",)
    assert report.kept
    assert report.verdict() == "all limits that could be checked are kept"
    assert "not checked: voltage of joint1" in str(report)
    assert limits_report(incomplete, motion, limits.replace(voltage=np.inf)).unchecked == ()
    assert limits_report(model, motion, limits).verdict() == "all limits that are known are kept"


def test_a_limit_of_current_stays_beside_a_stated_torque():
    model = arm("lwa4p")
    body = model.coordinates[1]
    most = abs(float(body.drive.gear_ratio * body.drive.torque_constant)) * float(body.limits.current)
    limits = aw.trajectories.MotionLimits.of(model, torque=10.0 * most)
    assert limits.torque[1] == pytest.approx(most)
    motion = aw.trajectories.Quintic(np.zeros(6), [0.0, 1.0, 0.0, 0.0, 0.0, 0.0], 0.2)
    (found,) = [each for each in limits_report(model, motion, limits).excess if each.joint == "joint2" and each.why]
    assert found.share > 1.0
    assert f"A of {float(body.limits.current):.4g} A" in str(found)
    assert np.isinf(aw.trajectories.MotionLimits.of(model, torque=np.inf).torque).all()

"""Motion files: the examples, their segments one after the other, as references of scenarios, and bad files."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.errors import ArmwrightError, ScenarioError
from ik.small_arms import forward, small_arm
from raises_at import raises_at
from trajectory.motions import check_continuous, check_within

EXAMPLES = sorted((Path(__file__).parents[2] / "examples" / "motions").glob("*.motion.toml"))


@pytest.mark.sample(1)
@pytest.mark.parametrize("file", EXAMPLES, ids=lambda path: path.stem.partition(".")[0])
def test_examples_keep_their_limits(file):
    if 'curve = "ruckig"' in file.read_text(encoding="utf-8"):
        pytest.importorskip("ruckig", reason="ruckig is not installed")
    plan = aw.trajectories.plan(file)
    assert plan.limits_report.kept, plan.limits_report.excesses()
    check_continuous(plan.motion, 2)
    t = np.linspace(0.0, plan.motion.duration, 20011)
    q, qd, qdd = plan.motion.at(t)
    low, high = plan.limits.position.T
    assert ((q >= low - 1e-9) & (q <= high + 1e-9)).all()
    assert (np.abs(qd) <= plan.limits.velocity * (1 + 1e-6)).all()
    assert (np.abs(qdd) <= plan.limits.acceleration * (1 + 1e-6)).all()
    np.testing.assert_allclose(np.gradient(q[:, 0], t), qd[:, 0], atol=0.05)
    np.testing.assert_array_equal(plan.motion.at(plan.motion.duration + 1.0)[1:], 0.0)
    assert f"{plan.motion.duration:.4g} s" in str(plan)


def test_a_seam_is_led_at_a_constant_speed():
    plan = aw.trajectories.plan(next(path for path in EXAMPLES if "welding" in path.name))
    begin = plan.begins[1]
    t = np.linspace(begin + 0.3, plan.begins[2] - 0.3, 1001)  # but for its ends
    place = aw.compile(plan.arm).forward_kinematics(plan.motion.at(t)[0])[:, :3, 3]
    speed = np.linalg.norm(np.gradient(place, t, axis=0), axis=1)
    assert np.ptp(place[:, 2]) < 1e-4  # the seam is level
    np.testing.assert_allclose(speed, 0.04, rtol=2e-3)


SEAM = """
robot = "puma560"
start = [0.2, -0.8, 0.2, 0, 0.6, 0]
limits = {{ velocity = 0.15, acceleration = 20.0, jerk = 400.0 }}

[[segments]]
kind = "tool"
origin = "start"
path = [{{ kind = "line", to_m = [0, 0.2, 0] }}]
speed_m_per_s = 0.1
acceleration_m_per_s2 = 1.0
{}
"""


def test_where_a_tool_is_slower_than_asked_is_said(tmp_path):
    slow, local = (planned(tmp_path, "", SEAM.format(line)) for line in ("", 'slow = "where needed"'))
    assert local.motion.duration < slow.motion.duration
    assert re.search(
        r"segments\[0\] is [\d.]+ times slower than requested: s = .* m: [\d.]+ times too fast, joint", str(slow)
    )
    assert re.search(r"segments\[0\] is up to [\d.]+ times slower than requested: s = ", str(local))
    with raises_at(ScenarioError, re.compile(r"segments\[0\]\.path at s = .*"), r"joint '\w+' .* rad/s"):
        planned(tmp_path, "", SEAM.format("constant = true"))
    with pytest.raises(ScenarioError, match=r"slow = 'there'"):
        planned(tmp_path, "", SEAM.format('slow = "there"'))


def test_full_speed_is_at_the_motors_limits():
    plan = aw.trajectories.plan(next(path for path in EXAMPLES if "full-speed" in path.name))
    states = plan.motion.at(np.linspace(0.0, plan.motion.duration, 2001))
    dyn = aw.compile(plan.arm)
    tau = dyn.inverse_dynamics(*states)
    voltage = np.abs(dyn.motor_voltage(states[1], tau) / plan.limits.voltage).max(axis=1)
    assert voltage.max() <= 1.0 + 1e-6
    assert (voltage > 0.99).mean() > 0.5
    assert (np.maximum(voltage, np.abs(tau / plan.limits.torque).max(axis=1)) > 0.99).mean() > 0.9


def test_a_payload_counts_from_its_grip_to_its_release():
    plan = aw.trajectories.plan(next(path for path in EXAMPLES if "pick" in path.name))
    grip, release = (plan.begins[plan.kinds.index(kind)] for kind in ("grip", "release"))
    assert [body.time for body in plan.payloads] == [grip, release]
    loaded = aw.compile(plan.arm.with_payload(2.0, [0, 0, 0.06], [0.004, 0.004, 0.003]))
    empty = aw.compile(plan.arm)
    t = np.linspace(0.0, plan.motion.duration, 4001)
    held = (t >= grip) & (t < release)
    states = plan.motion.at(t)
    tau = np.where(held[:, None], loaded.inverse_dynamics(*states), empty.inverse_dynamics(*states))
    np.testing.assert_allclose(plan.limits_report.highest["torque"], tau.max(axis=0), rtol=2e-2, atol=0.2)
    dataset = plan.motion.dataset(plan.arm, 500.0, plan.payloads)
    inside = (dataset.time.values >= grip) & (dataset.time.values < release)
    np.testing.assert_allclose(
        dataset.tau.values[inside], loaded.inverse_dynamics(*plan.motion.at(dataset.time.values[inside])), rtol=1e-9
    )


FILE = """
title = "there and back"
robot = "lwa4p"
start = [0.1, 0, 0, 0, 0, 0]

[limits]
acceleration = 3.0
jerk = 60.0
"""
MOVE = '[[segments]]\nkind = "move"\ngoal = {{ joint2 = 0.4 }}\n{}\n'


def planned(tmp_path, text, head=FILE):
    path = tmp_path / "a.motion.toml"
    path.write_text(head + text)
    return aw.trajectories.plan(path)


def test_segments_follow_each_other(tmp_path):
    text = MOVE.format("") + '[[segments]]\nkind = "dwell"\nduration_s = 0.5\n'
    text += '[[segments]]\nkind = "waypoints"\npoints = [[0.3, 0.3, 0, 0, 0, 0], [0.1, 0, 0, 0, 0, 0]]\n'
    text += '[[segments]]\nkind = "move"\ngoal = 0.0\ncurve = "cubic"\nduration_s = 4.0\n'
    plan = planned(tmp_path, text)
    assert plan.kinds == ("move", "dwell", "waypoints", "move")
    first = aw.trajectories.SCurve([0.1, 0, 0, 0, 0, 0], [0.1, 0.4, 0, 0, 0, 0], plan.limits)
    np.testing.assert_allclose(plan.begins[:3], [0.0, first.duration, first.duration + 0.5])
    t = np.linspace(0.0, first.duration, 100)
    np.testing.assert_allclose(plan.motion.at(t)[0], first.at(t)[0], atol=1e-12)
    check_within(plan.motion, plan.limits, "velocity", "acceleration")
    assert plan.motion.duration == pytest.approx(plan.begins[3] + 4.0)
    np.testing.assert_allclose(plan.motion.at(100.0)[0], 0.0, atol=1e-12)


@pytest.mark.sample(1)
@pytest.mark.parametrize("curve", ["s_curve", "trapezoid", "quintic", "minimum_jerk"])
def test_speed_plays_a_move_slower(tmp_path, curve):
    limits = "velocity = 1e6\n"  # a law of one polynomial is then limited by its acceleration alone
    fast, slow = (planned(tmp_path, MOVE.format(f'curve = "{curve}"\nspeed = {s}'), FILE + limits) for s in (1.0, 0.25))
    assert slow.motion.duration == pytest.approx(4.0 * fast.motion.duration, rel=1e-9)


def test_a_moving_end_is_taken_over(tmp_path):
    pytest.importorskip("ruckig", reason="ruckig is not installed")
    text = MOVE.format('curve = "ruckig"\ngoal_velocity = { joint2 = 0.5 }')
    plan = planned(tmp_path, text + '[[segments]]\nkind = "move"\ncurve = "ruckig"\ngoal = { joint2 = 0.9 }\n')
    np.testing.assert_allclose(plan.motion.at(plan.begins[1])[1][1], 0.5, atol=1e-9)
    check_continuous(plan.motion, 3)
    with raises_at(ScenarioError, "segments[1].curve", "joint2 is moving.*minimum_jerk or ruckig"):
        planned(tmp_path, text + MOVE.format(""))


GRIP = '[[segments]]\nkind = "grip"\nmass_kg = 1\ncom_m = [0, 0, 0]\ninertia_kg_m2 = {}\n{}\n'
POINTS = '[[segments]]\nkind = "waypoints"\npoints = [[0.3, 0, 0, 0, 0, 0], [0.5, 0, 0, 0, 0, 0]]\n'


@pytest.mark.sample(4)
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "segments: missing|segments"),
        ('[[segments]]\nkind = "jump"\n', r"kind = 'jump'.*move"),
        ('[[segments]]\nkind = "move"\n', r"segments\[0\].*goal: missing"),
        ('[[segments]]\nkind = "move"\ngoal = [1.0]\n', r"segments\[0\].goal = \[1.0\]: expected 6 numbers"),
        ('[[segments]]\nkind = "move"\ngoal = { elbow = 1.0 }\n', r"segments\[0\].goal = 'elbow': no joint"),
        ('[[segments]]\nkind = "move"\ngoal = { joint1 = 0.1 }\n', r"segments\[0\].goal: .*no length"),
        (
            '[[segments]]\nkind = "move"\ngoal = { joint3 = 3.0 }\n',
            r"segments\[0\].goal of joint3 = 3.0: 0.286 rad outside",
        ),
        (
            MOVE.format("duration_s = 0.01"),
            r"segments\[0\].duration_s = 0.01: .*0.\d+ s .*joint2",
        ),
        (MOVE.format("duration_s = -1"), r"segments\[0\].*duration_s = -1: expected greater than 0"),
        (MOVE.format("speed = 2"), r"segments\[0\].*speed = 2"),
        (MOVE.format("sped = 1"), r"segments\[0\].*sped.*unknown key; .*speed"),
        (
            MOVE.format('curve = "ruckig"\ngoal_velocity = { joint1 = 0.1 }'),
            r"segments\[0\]: .*joint1 is moving",
        ),
        (MOVE.format("goal_velocity = 0.1"), r"segments\[0\].goal_velocity: with curve = 's_curve'"),
        ('[[segments]]\nkind = "release"\n', r"segments\[0\].kind = .release.: .*empty"),
        ('[[segments]]\nkind = "dwell"\nduration_s = 0\n', "duration_s = 0"),
        (
            '[[segments]]\nkind = "waypoints"\npoints = [[0.1, 0, 0, 0, 0, 0]]\n',
            r"segments\[0\].points\[0\]: .*waypoint before",
        ),
        ('[[segments]]\nkind = "waypoints"\npoints = [[1, 2]]\n', r"segments\[0\].points\[0\]: 2 numbers; expected 6"),
        (
            '[[segments]]\nkind = "waypoints"\npoints = [[0.3, 0, 0, 0, 0, 0], [0.5, 0, 0, 0, 0, 0]]\ntimes_s = [3, 2]\n',
            r"segments\[0\].times_s\[1\] = 2.0: not after 3; .*times",
        ),
        (
            '[[segments]]\nkind = "tool"\npath = [{ kind = "line", to_m = [5, 0, 0] }]\nspeed_m_per_s = 0.1\n'
            "acceleration_m_per_s2 = 1\n",
            r"segments\[0\]",
        ),
        (
            '[[segments]]\nkind = "tool"\npath = [{ kind = "spiral" }]\nspeed_m_per_s = 0.1\nacceleration_m_per_s2 = 1\n',
            "kind = 'spiral'.*or circle",
        ),
        (
            '[[segments]]\nkind = "time_optimal"\npoints = [[1, 2]]\n',
            r"segments\[0\].points\[0\]: 2 numbers; expected 6",
        ),
        ('[[segments]]\nkind = "grip"\nmass_kg = 1\ncom_m = [0, 0, 0]\ninertia_kg_m2 = [0, 0, 0]\n', "nothing moves"),
        (GRIP.format("[-1, 0, 0]", ""), r"segments\[0\].inertia_kg_m2.xx = -1.0"),
        (GRIP.format("[0, 0, 0]", 'frame = "hand"'), r"segments\[0\].frame = 'hand': unknown; .*base, link1"),
        (POINTS + "times_s = [-1, 2]\n", r"segments\[0\].times_s\[0\] = -1.0: not after .*at 0"),
        (POINTS + "times_s = [1, 2, 3]\n", r"segments\[0\].times_s: 3 times; .*2, one a waypoint"),
        (POINTS + "times_s = [1, 2]\nduration_s = 2\n", r"segments\[0\].duration_s: with times_s; expected either"),
        (
            POINTS + "times_s = [0.1, 0.2]\n",
            r"segments\[0\].times_s: joint\d .* limit; .*\d\.\d+ times",
        ),
        (POINTS + "duration_s = 0.1\n", r"segments\[0\].duration_s = 0.1: .*0.\d+ s .*shortest"),
        (
            MOVE.format("duration_s = 1e12"),
            r"segments\[0\].kind = 'move': ends at 1e\+12 s; .*1e\+09 s",
        ),
        (POINTS.replace("0.5", "9"), r"segments\[0\].points\[1\] of joint1 = 9.0: 6.033 rad"),
        (POINTS.replace("0.5", "0.3"), r"segments\[0\].points\[1\]: .*waypoint before"),
        (
            POINTS.replace("0.5", "0.3").replace("waypoints", "time_optimal"),
            r"segments\[0\].points\[1\]: .*waypoint before",
        ),
        (
            MOVE.format('curve = "minimum_jerk"\nduration_s = 0.01'),
            r"segments\[0\].duration_s = 0.01: joint2 .* jerk limit; .*0\.877\d+ s",
        ),
    ],
)
def test_bad_files_are_refused(tmp_path, text, said):
    with pytest.raises(ScenarioError, match=said) as raised:
        planned(tmp_path, text)
    assert "a.motion.toml" in str(raised.value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('robot = "lwa4p"', 'robot = "lwa"', "robot = 'lwa'"),
        ("acceleration = 3.0", "acceleration = -3.0", r"limits.acceleration = -3.0: expected a number above 0"),
        ("acceleration = 3.0", "acceleration = { elbow = 1.0 }", "'elbow': no joint"),
        ("acceleration = 3.0", "speed = 3.0", "limits.speed.*unknown key"),
        ("jerk = 60.0", "", "toml:6: limits.jerk: .*joint2"),
        ("jerk = 60.0", "position = 1e308", r"limits.position = 1e\+308: expected .* 1e\+30 at most"),
        ("jerk = 60.0", "jerk = 1e-300", "limits.jerk = 1e-300: .*1e-30 or more"),
        ("start = [0.1,", "start = [9,", "start of joint1 = 9.0: 6.033 rad"),
        ("start = [0.1,", "start = [nan,", "finite number"),
        ('title = "there and back"', "title = [", "a.motion.toml"),
    ],
)
def test_bad_heads_are_refused(tmp_path, old, new, said):
    with pytest.raises(ArmwrightError, match=said):
        planned(tmp_path, MOVE.format(""), FILE.replace(old, new))


OBSTACLES = """
title = "a floor and a ball"
robot = "lwa4p"
start = 0.0
clearance_m = {least}
link_radius_m = 0.05
obstacles = [
    {{ kind = "plane", point_m = [0, 0, {floor}], normal = [0, 0, 1], name = "floor" }},
    {{ kind = "sphere", radius_m = 0.05, position_m = [0, 0, 3], name = "ball" }},
]
limits = {{ acceleration = 3.0, jerk = 60.0 }}
"""


def test_obstacles_are_kept_away_from(tmp_path):
    far = planned(tmp_path, MOVE.format(""), OBSTACLES.format(least=0.0, floor=-1.0))
    assert "nearest: " in str(far)
    with raises_at(ScenarioError, "segments[0]", " mm .* s; .*3000 mm"):
        planned(tmp_path, MOVE.format(""), OBSTACLES.format(least=3.0, floor=-1.0))
    with raises_at(ScenarioError, "segments[0]", "floor .* mm at .* s"):
        planned(tmp_path, MOVE.format(""), OBSTACLES.format(least=0.0, floor=0.4))


@pytest.mark.parametrize(
    ("obstacle", "said"),
    [
        ('kind = "plane", point_m = [0, 0, -9], normal = [0, 0, 0]', r"obstacles\[2\].normal = .*: expected a vector"),
        (
            'kind = "box", size_m = [0, 0, -1], position_m = [9, 0, 0]',
            r"obstacles\[2\].size_m = .*: expected 3 numbers",
        ),
        (
            'kind = "sphere", radius_m = 0.1, position_m = [9, 0, 0]',
            r"toml(:\d+)?: link_radius_m: .*no shapes",
        ),
    ],
)
def test_obstacles_are_named_as_they_were_written(tmp_path, obstacle, said):
    head = OBSTACLES.format(least=0.0, floor=-1.0).replace("]\nlimits", f"    {{ {obstacle} }},\n]\nlimits")
    if "radius_m" in obstacle:
        head = head.replace("link_radius_m = 0.05\n", "")
    with pytest.raises(ScenarioError, match=said) as raised:
        planned(tmp_path, MOVE.format(""), head)
    assert str(raised.value).startswith(str(tmp_path / "a.motion.toml"))


FAST = '[[segments]]\nkind = "time_optimal"\npoints = [[0.3, 0.3, 0, 0, 0, 0]]\ngrid = 50\n'


def test_a_limit_of_jerk_holds_beside_a_time_optimal_segment(tmp_path):
    """Those of torque and voltage of the record hold beside it."""
    plan = planned(tmp_path, FAST + MOVE.format(""))
    assert plan.kept, plan.excesses()
    assert "all limits that are known are kept" in str(plan)
    fastest, move = (motion.polynomial for motion in plan.motion.motions)
    assert 59.0 < fastest.largest(3).max() <= 60.0
    assert move.largest(3).max() == pytest.approx(60.0, rel=1e-9)  # the move is an S-curve at that limit
    free = planned(tmp_path, FAST, FILE.replace("jerk = 60.0", ""))
    assert free.kept
    assert free.motion.duration < fastest.breaks[-1] - fastest.breaks[0]


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("segment", "kind", "jumps"),
    [
        (MOVE.format('curve = "s_curve"'), "move", False),
        (MOVE.format('curve = "quintic"'), "move", False),
        (MOVE.format('curve = "minimum_jerk"'), "move", False),
        (MOVE.format('curve = "cubic"'), "move", True),
        (MOVE.format('curve = "trapezoid"'), "move", True),
        (POINTS, "waypoints", True),
        (POINTS + 'curve = "quintic"\n', "waypoints", False),
        (POINTS + 'curve = "parabolic"\n', "waypoints", True),
        (FAST, "time_optimal", False),
    ],
)
def test_each_segment_that_breaks_a_limit_is_named(tmp_path, segment, kind, jumps):
    """The jerk where the acceleration jumps; torque and current that no planner but `time_optimal` keeps."""
    dwell = '[[segments]]\nkind = "dwell"\nduration_s = 0.2\n'
    plan = planned(tmp_path, dwell + segment)
    assert plan.kept != jumps
    assert all(each.startswith(f"segments[1] ({kind}): ") and "jerk" in each for each in plan.excesses())
    assert ("all limits that are known are kept" in str(plan)) != jumps
    arguments = ["plan", str(tmp_path / "a.motion.toml")]
    assert CliRunner().invoke(app, arguments).exit_code == int(jumps)
    free = planned(tmp_path, dwell + segment, FILE.replace("jerk = 60.0", "jerk = 60.0\nvelocity = 100.0"))
    torque = np.maximum(np.abs(free.limits_report.lowest["torque"]), free.limits_report.highest["torque"])[1]
    if kind == "time_optimal":
        return
    limits = f"torque = {{ joint2 = {0.99 * torque} }}\nvelocity = 100.0\n"
    beyond = planned(tmp_path, dwell + segment, FILE + limits)
    assert any(re.match(r"segments\[\d\] .*joint2: torque .* at .* s, 101\.0%", each) for each in beyond.excesses())
    assert "all limits" not in str(beyond)


@pytest.mark.study
def test_the_fastest_curve_jumps_in_acceleration_only_without_a_limit_of_jerk(tmp_path):
    fastest, free = POINTS + 'curve = "fastest"\n', FILE.replace("jerk = 60.0", "")
    smooth, jumping = (planned(tmp_path, fastest, file) for file in (FILE, free))
    cubic = [planned(tmp_path, POINTS, file).motion.duration for file in (FILE, free)]
    assert smooth.kept
    assert smooth.motion.duration < 0.98 * cubic[0]
    assert jumping.motion.duration < min(0.98 * cubic[1], smooth.motion.duration)


def test_limits_of_a_tool_count_where_its_path_leaves_them_free(tmp_path):
    turning = SEAM.format('aim = "position"\nangular_speed_rad_per_s = {}').replace("[0, 0.2, 0]", "[0.1, 0.2, 0]")
    with raises_at(ScenarioError, re.compile(r"segments\[0\]\.path at s = .*"), r"angular speed .* rad/s"):
        planned(tmp_path, "", turning.replace("{}", "1e-3"))
    assert planned(tmp_path, "", turning.replace("{}", "10.0")).kept


def test_a_limit_that_cannot_be_checked_is_named(tmp_path):
    limits = FILE.replace("lwa4p", "panda").replace("[0.1, 0, 0, 0, 0, 0]", "[0, -0.6, 0, -2.2, 0, 1.6, 0.8]")
    plan = planned(tmp_path, MOVE.format("").replace("0.4", "-0.4"), limits + "voltage = 24.0\n")
    assert plan.kept
    assert "all limits that could be checked are kept\nnot checked: voltage of joint1" in str(plan)
    assert "all limits that are known" not in str(plan)
    done = CliRunner().invoke(app, ["plan", str(tmp_path / "a.motion.toml")])
    assert done.exit_code == 0
    assert "not checked: voltage" in done.output


SCENARIO = """
robot = "lwa4p"
duration_s = 0.2

[start]
q = [0.1, 0, 0, 0, 0, 0]

[loop]
period_s = 0.01
controller = {{ kind = "computed_torque", kp = 100.0, kd = 20.0 }}
reference = {{ kind = "motion", file = "{}" }}
"""


CARRYING = """
robot = "lwa4p"
start = [0, 0.6, 0.9, 0, 0.4, 0]

[limits]
acceleration = 3.0
jerk = 60.0

[[segments]]
kind = "dwell"
duration_s = 0.1

[[segments]]
kind = "grip"
mass_kg = 2.0
com_m = [0, 0, 0.06]
inertia_kg_m2 = [0.004, 0.004, 0.003]

[[segments]]
kind = "move"
goal = { joint2 = 0.62 }

[[segments]]
kind = "dwell"
duration_s = 0.3

[[segments]]
kind = "release"

[[segments]]
kind = "dwell"
duration_s = 0.4
"""


@pytest.mark.study
def test_a_grip_of_a_mass_alone_takes_a_point_mass(tmp_path):
    """As with zeros: at the tip's origin, or at the centre of mass that is stated."""
    for com in ("", "com_m = [0, 0, 0.06]\n"):
        alone = CARRYING.replace("com_m = [0, 0, 0.06]\n", com).replace("inertia_kg_m2 = [0.004, 0.004, 0.003]\n", "")
        zeros = alone.replace(
            "mass_kg = 2.0\n", f"mass_kg = 2.0\n{'' if com else 'com_m = [0, 0, 0]'}\ninertia_kg_m2 = [0, 0, 0]\n"
        )
        one, two = (planned(tmp_path, "", each) for each in (alone, zeros))
        np.testing.assert_array_equal(one.payloads[0].com, [0, 0, 0.06 if com else 0])
        assert str(one.limits_report) == str(two.limits_report)
        np.testing.assert_array_equal(one.motion.at(0.3), two.motion.at(0.3))
    with raises_at(ScenarioError, "segments[1].com_m", "missing"):
        planned(tmp_path, "", CARRYING.replace("com_m = [0, 0, 0.06]\n", ""))


@pytest.mark.study
def test_a_simulation_carries_what_the_motion_takes_up(tmp_path):
    """The motors hold the body's weight from the grip to the release: g(q) of the arm with the body, and of the arm alone."""
    plan = planned(tmp_path, "", CARRYING)
    arm = plan.arm.replace(friction=None)
    loop = aw.Loop(aw.ComputedTorque(400.0, 40.0), plan.motion, period=0.01)
    scenario = aw.Scenario(arm, duration=round(plan.motion.duration, 2), loop=loop, start=[0, 0.6, 0.9, 0, 0.4, 0])
    run = aw.simulate(scenario)
    assert "the hand carries what the reference takes up: 2 kg from 0.1 s on, nothing from" in run.attrs["notes"]
    loaded = aw.compile(arm.with_payload(2.0, [0, 0, 0.06], [0.004, 0.004, 0.003]))
    grip, release = (body.time for body in plan.payloads)
    for when, dyn in (
        (grip - 0.02, aw.compile(arm)),
        (release - 0.02, loaded),
        (plan.motion.duration, aw.compile(arm)),
    ):
        row = run.sel(time=when, method="nearest")
        np.testing.assert_allclose(row.tau.values, dyn.gravity_torques(row.q.values), atol=0.1)
    weight = loaded.gravity_torques(row.q.values) - aw.compile(arm).gravity_torques(row.q.values)
    assert np.abs(weight[1:3]).min() > 1.0  # N m, ten times what the comparison allows
    by_hand = dataclasses.replace(
        scenario, loop=dataclasses.replace(loop, reference=aw.trajectories.Joined(plan.motion.motions))
    )
    stated = aw.simulate(dataclasses.replace(by_hand, inputs=aw.Inputs(payload=list(plan.payloads))))
    np.testing.assert_array_equal(run.tau, stated.tau)
    other = dataclasses.replace(scenario, inputs=aw.Inputs(payload=aw.Payload(0.0, 0.0)))
    empty = aw.simulate(other)
    np.testing.assert_allclose(empty.tau, aw.simulate(by_hand).tau, atol=1e-6)
    assert "inputs.payload stands in place of what the reference takes up" in empty.attrs["notes"]


@pytest.mark.study
def test_the_command_simulates_with_what_the_motion_takes_up(tmp_path):
    plan = planned(tmp_path, "", CARRYING)
    scenario, runs = tmp_path / "a.scenario.toml", []
    text = SCENARIO.format("a.motion.toml").replace("duration_s = 0.2", "duration_s = 0.3")
    scenario.write_text(text.replace("q = [0.1, 0, 0, 0, 0, 0]", "q = [0, 0.6, 0.9, 0, 0.4, 0]"))
    other = tmp_path / "b.scenario.toml"
    other.write_text(
        scenario.read_text().replace('{ kind = "motion", file = "a.motion.toml" }', '{ kind = "pose", q = 0.1 }')
    )
    for arguments in ([str(scenario)], [str(other), "--reference", str(tmp_path / "a.motion.toml")]):
        done = CliRunner().invoke(app, ["simulate", *arguments, "-o", str(tmp_path / "run.nc")])
        assert done.exit_code == 0, done.output
        assert "the hand carries what the reference takes up: 2 kg from 0.1 s on" in done.output
        runs.append(aw.load_run(tmp_path / "run.nc").load())
    np.testing.assert_array_equal(runs[0].tau, runs[1].tau)
    begin = plan.payloads[0].time
    assert np.abs(runs[0].q - runs[0].q_reference).sel(time=slice(begin + 0.1, None)).max() > 1e-3  # it sags


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["a.motion.toml", "a.csv"])
def test_a_scenario_takes_a_motion_file(tmp_path, name):
    plan = planned(tmp_path, MOVE.format(""))
    plan.save(tmp_path / "a.csv")
    (tmp_path / "a.scenario.toml").write_text(SCENARIO.format(name))
    run = aw.simulate(aw.read_scenario(tmp_path / "a.scenario.toml"))
    np.testing.assert_allclose(run.q_reference.values, plan.motion.at(run.time.values)[0], atol=1e-9)
    aw.save(run, tmp_path / "run.nc")
    for path in (tmp_path / "a.motion.toml", tmp_path / "a.csv"):
        path.unlink()
    assert aw.reproduce(tmp_path / "run.nc").same  # the run keeps what it was made from


def test_a_scenario_of_another_arm_is_refused(tmp_path):
    planned(tmp_path, MOVE.format(""))
    (tmp_path / "a.scenario.toml").write_text(
        SCENARIO.format("a.motion.toml").replace('robot = "lwa4p"', 'robot = "cmu-dd"')
    )
    with raises_at(ScenarioError, "loop.reference.file", "lwa4p", value="a.motion.toml"):
        aw.read_scenario(tmp_path / "a.scenario.toml")


def test_the_command_plans_writes_and_draws(tmp_path):
    plan = planned(tmp_path, MOVE.format(""))
    files = [tmp_path / name for name in ("m.csv", "m.html")]
    arguments = ["plan", str(tmp_path / "a.motion.toml"), "-o", str(files[0]), "--plot", str(files[1])]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "move" in done.output
    assert "all limits that are known are kept" in done.output
    assert files[1].stat().st_size > 10_000
    t = np.linspace(0.0, plan.motion.duration, 100)
    np.testing.assert_allclose(
        aw.trajectories.load_motion(files[0], plan.arm).at(t)[0], plan.motion.at(t)[0], atol=1e-9
    )


def test_a_page_names_the_motion_and_its_segments(tmp_path):
    plan = aw.trajectories.plan(EXAMPLES[0].parent / "pick-and-place.motion.toml")
    plan.plot(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert f"<title>lwa4p   ·   {plan.title}</title>" in page
    assert re.search(rf"grip {plan.begins[3]:.4g} s,\s+waypoints", page)
    assert plan.plot().get_suptitle().startswith(f"lwa4p   ·   {plan.title}\nsegments: move 0 s")


def test_an_arm_without_a_tip_is_asked_for_a_frame(tmp_path):
    limit = '<axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2" effort="9"/>'
    joints = [("a", "revolute", "base", "one", limit), ("b", "revolute", "one", "two", limit)]
    joints += [("c", "fixed", "two", "hand", ""), ("d", "fixed", "two", "camera", "")]
    links = "".join(f'<link name="{name}"/>' for name in ("base", "one", "two", "hand", "camera"))
    place = '<origin xyz="0.5 0 0"/>'
    text = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{place}{more}</joint>'
        for name, kind, parent, child, more in joints
    )
    (tmp_path / "arm.urdf").write_text(f'<robot name="y">{links}{text}</robot>', encoding="utf-8")
    tool = 'robot = "arm.urdf"\nstart = [0.3, 0.8]\n[limits]\nvelocity = 2.0\nacceleration = 9.0\njerk = 90.0\n[[segments]]\n'
    tool += 'kind = "tool"\naim = "position"\norigin = "start"\npath = [{ kind = "line", to_m = [-0.05, 0, 0] }]\n'
    tool += "speed_m_per_s = 0.1\nacceleration_m_per_s2 = 1.0\n"
    file = tmp_path / "a.motion.toml"
    file.write_text(tool, encoding="utf-8")
    with raises_at(ScenarioError, "segments[0].frame", "missing"):
        aw.trajectories.plan(file)
    file.write_text(tool + 'frame = "hand"\n', encoding="utf-8")
    assert aw.trajectories.plan(file).limits_report.kept
    file.write_text(tool.replace("[-0.05, 0, 0]", "[0, 0, 0]") + 'frame = "hand"\n', encoding="utf-8")
    with raises_at(ScenarioError, "segments[0].path[0]", "no length"):
        aw.trajectories.plan(file)


def test_pairs_of_links_may_be_left_out(tmp_path):
    text = 'robot = "puma560"\nstart = [0, 0.6, 0, 0, 0.8, 0]\nclearance_m = 0.05\nlink_radius_m = 0.06\n'
    move = "[limits]\nvelocity = 2.0\nacceleration = 9.0\njerk = 90.0\n[[segments]]\nkind = 'move'\ngoal = { waist = 0.2 }\n"
    file = tmp_path / "a.motion.toml"
    file.write_text(text + move, encoding="utf-8")
    with raises_at(ScenarioError, "segments[0]", "link2 and link4"):
        aw.trajectories.plan(file)
    others = [f'["link{i}", "link{j}"]' for i in (1, 2) for j in (4, 5, 6)]
    file.write_text(f"{text}ignore = [{', '.join(others)}]\n{move}", encoding="utf-8")
    assert "link2 and link4" not in aw.trajectories.plan(file).nearest
    file.write_text(f'{text}ignore = [["link2", "hand"]]\n{move}', encoding="utf-8")
    with raises_at(ScenarioError, "ignore", value="hand"):
        aw.trajectories.plan(file)


def test_the_command_says_what_is_exceeded(tmp_path):
    planned(tmp_path, MOVE.format(""), FILE + "torque = { joint2 = 1.0 }\n")
    done = CliRunner().invoke(app, ["plan", str(tmp_path / "a.motion.toml")])
    assert done.exit_code == 1
    assert "exceeds limits: segments[0] (move): joint2: torque" in done.output


def test_the_command_ends_with_2_and_writes_nothing(tmp_path):
    path = tmp_path / "a.motion.toml"
    path.write_text(FILE)
    done = CliRunner().invoke(app, ["plan", str(path), "-o", str(tmp_path / "m.csv")])
    assert done.exit_code == 2
    assert not (tmp_path / "m.csv").exists()


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["a.motion.toml", "a.csv", "a.nc"])
def test_simulate_follows_a_motion(tmp_path, name):
    plan = planned(tmp_path, MOVE.format(""))
    for file in ("a.csv", "a.nc"):
        plan.save(tmp_path / file)
    scenario = tmp_path / "a.scenario.toml"
    scenario.write_text(
        SCENARIO.format("a.csv").replace('{ kind = "motion", file = "a.csv" }', '{ kind = "pose", q = 0.1 }')
    )
    arguments = ["simulate", str(scenario), "--reference", str(tmp_path / name), "-o", str(tmp_path / "run.nc")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    run = aw.load_run(tmp_path / "run.nc")
    np.testing.assert_allclose(run.q_reference.values, plan.motion.at(run.time.values)[0], atol=1e-9)


def test_simulate_without_a_loop_follows_nothing(tmp_path):
    planned(tmp_path, MOVE.format(""))
    done = CliRunner().invoke(
        app, ["simulate", "lwa4p", "--current", "0", "--reference", str(tmp_path / "a.motion.toml")]
    )
    assert done.exit_code == 2
    assert "a scenario file, whose controller follows it" in done.output


SERVO = """
robot = "servo-5.urdf"
start = {start}
limits = {{ velocity = 2.0, acceleration = 20.0, jerk = 400.0 }}

[[segments]]
kind = "tool"
aim = "{aim}"
origin = "start"
path = [{{ kind = "line", to_m = [0, 0.05, 0.02]{turn} }}, {{ kind = "line", to_m = [-0.03, 0.05, 0.02] }}]
blend_m = 0.005
speed_m_per_s = 0.05
acceleration_m_per_s2 = 0.5
"""
TILTED = [0.2, 0.3, 0.6, 0.5 * np.pi - 0.9 - 1e-3, 0.3]
DOWN, BENT = [0.2, 0.3, 0.6, 0.5 * np.pi - 0.9, 0.3], [0.2, 0.1, 0.9, 0.5, 0.3]


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("aim", "start", "turn"),
    [
        ("pitch", BENT, ""),
        ("pitch", BENT, ", pitch_rad = 1.2"),
        ("pitch", DOWN, ""),
        ("pitch", TILTED, ", pitch_rad = 1.3"),
        ("axis", DOWN, ""),
        ("axis x", DOWN, ", direction = [0.5, -1, 0]"),
        ("yaw", DOWN, ", yaw_rad = -0.4"),
        ("position", BENT, ""),
        ("base z", DOWN, ", rpy_rad = [3.141592653589793, 0, -0.4]"),
    ],
)
def test_a_tool_is_led_with_a_part_of_its_orientation(aim, start, turn, tmp_path):
    small_arm("servo-5", tmp_path)
    file = tmp_path / "led.motion.toml"
    file.write_text(SERVO.format(aim=aim, start=start, turn=turn), encoding="utf-8")
    plan = aw.trajectories.plan(file)
    assert plan.limits_report.kept
    check_continuous(plan.motion, 2)
    ends = plan.motion.at(np.array([0.0, plan.motion.duration]))[0]
    at, turned = forward("servo-5", ends)
    np.testing.assert_allclose(at[1] - at[0], [-0.03, 0.05, 0.02], atol=1e-6)
    x, z = (turned.apply(axis) for axis in np.eye(3)[[0, 2]])
    value = float(turn.partition("=")[2]) if turn.count("_rad") and "[" not in turn else None
    if aim == "pitch":
        pitches = -np.arcsin(np.clip(z[:, 2], -1.0, 1.0))
        np.testing.assert_allclose(pitches[1], pitches[0] if value is None else value, atol=2e-6)
    elif aim == "axis":
        np.testing.assert_allclose(z[1], z[0], atol=1e-6)
    elif aim == "axis x":
        np.testing.assert_allclose(x[1], np.array([0.5, -1.0, 0.0]) / np.hypot(0.5, 1.0), atol=1e-6)
    elif aim == "yaw":
        np.testing.assert_allclose(np.arctan2(x[1, 1], x[1, 0]), value, atol=1e-6)


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    ("aim", "turn", "said"),
    [
        ("slope", "", r"segments\[0\]\.aim = 'slope'"),
        ("pose", ", rpy_rad = [2.8, 0, 0]", "out of reach"),
        ("axis", ", direction = [0.5, -1, -1]", "out of reach"),
        (
            "pose",
            ", direction = [0, 0, -1]",
            r"segments\[0\]\.path\[0\]\.direction: with aim = 'pose'; ",
        ),
        (
            "axis",
            ", pitch_rad = 0.3",
            r"segments\[0\]\.path\[0\]\.pitch_rad: with aim = 'axis'; ",
        ),
        ("base xy", ", direction = [0, 0, -1]", r"path\[0\]\.direction: with aim = 'base xy'"),
        (
            "axis",
            ", direction = [0, 0, -1], rpy_rad = [0, 0, 0]",
            r"path\[0\]\.direction: with rpy_rad; ",
        ),
        ("axis", ", direction = [0, 0, 0]", r"path\[0\]\.direction = "),
        ("axis", ", direction = [0, 0, 1]", "opposite to"),
        ("pitch", ", pitch_rad = 2.0", r"pitch_rad"),
        ("pitch", ", pitch_rad = 1.3", "path at .*pitch"),
        ("yaw z", "", "vertical, .*its yaw"),
    ],
)
def test_parts_of_an_orientation_that_cannot_be(aim, turn, said, tmp_path):
    small_arm("servo-5", tmp_path)
    file = tmp_path / "led.motion.toml"
    file.write_text(SERVO.format(aim=aim, start=DOWN, turn=turn), encoding="utf-8")
    with pytest.raises(ArmwrightError, match=said):
        aw.trajectories.plan(file)

"""Motion files: the examples, their segments one after the other, as references of scenarios, and bad files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.errors import ArmwrightError, ScenarioError
from trajectory.motions import check_continuous, check_within

EXAMPLES = sorted((Path(__file__).parents[2] / "examples" / "motions").glob("*.motion.toml"))


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda path: path.stem.partition(".")[0])
def test_examples_keep_their_limits(file):
    if 'curve = "ruckig"' in file.read_text(encoding="utf-8"):
        pytest.importorskip("ruckig", reason="ruckig is not installed")
    plan = aw.plan(file)
    assert plan.report.kept, plan.report.excesses()
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
    plan = aw.plan(next(path for path in EXAMPLES if "welding" in path.name))
    begin = plan.begins[1]
    t = np.linspace(begin + 0.3, plan.begins[2] - 0.3, 1001)  # but for its ends
    place = aw.compile(plan.arm).forward_kinematics(plan.motion.at(t)[0])[:, :3, 3]
    speed = np.linalg.norm(np.gradient(place, t, axis=0), axis=1)
    assert np.ptp(place[:, 2]) < 1e-4  # the seam is level
    np.testing.assert_allclose(speed, 0.04, rtol=2e-3)


def test_full_speed_is_at_the_motors_limits():
    plan = aw.plan(next(path for path in EXAMPLES if "full-speed" in path.name))
    states = plan.motion.at(np.linspace(0.0, plan.motion.duration, 2001))
    dyn = aw.compile(plan.arm)
    tau = dyn.inverse_dynamics(*states)
    voltage = np.abs(dyn.motor_voltage(states[1], tau) / plan.limits.voltage).max(axis=1)
    assert voltage.max() <= 1.0 + 1e-6
    assert (voltage > 0.99).mean() > 0.5
    assert (np.maximum(voltage, np.abs(tau / plan.limits.torque).max(axis=1)) > 0.99).mean() > 0.9


def test_a_payload_counts_from_its_grip_to_its_release():
    plan = aw.plan(next(path for path in EXAMPLES if "pick" in path.name))
    grip, release = (plan.begins[plan.kinds.index(kind)] for kind in ("grip", "release"))
    assert [body.time for body in plan.payloads] == [grip, release]
    loaded = aw.compile(plan.arm.with_payload(2.0, [0, 0, 0.06], [0.004, 0.004, 0.003]))
    empty = aw.compile(plan.arm)
    t = np.linspace(0.0, plan.motion.duration, 4001)
    held = (t >= grip) & (t < release)
    states = plan.motion.at(t)
    tau = np.where(held[:, None], loaded.inverse_dynamics(*states), empty.inverse_dynamics(*states))
    np.testing.assert_allclose(plan.report.highest["torque"], tau.max(axis=0), rtol=2e-2, atol=0.2)
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
    return aw.plan(path)


def test_segments_follow_each_other(tmp_path):
    text = MOVE.format("") + '[[segments]]\nkind = "dwell"\nduration_s = 0.5\n'
    text += '[[segments]]\nkind = "waypoints"\npoints = [[0.3, 0.3, 0, 0, 0, 0], [0.1, 0, 0, 0, 0, 0]]\n'
    text += '[[segments]]\nkind = "move"\ngoal = 0.0\ncurve = "cubic"\nduration_s = 4.0\n'
    plan = planned(tmp_path, text)
    assert plan.kinds == ("move", "dwell", "waypoints", "move")
    first = aw.SCurve([0.1, 0, 0, 0, 0, 0], [0.1, 0.4, 0, 0, 0, 0], plan.limits)
    np.testing.assert_allclose(plan.begins[:3], [0.0, first.duration, first.duration + 0.5])
    t = np.linspace(0.0, first.duration, 100)
    np.testing.assert_allclose(plan.motion.at(t)[0], first.at(t)[0], atol=1e-12)
    check_within(plan.motion, plan.limits, "velocity", "acceleration")
    assert plan.motion.duration == pytest.approx(plan.begins[3] + 4.0)
    np.testing.assert_allclose(plan.motion.at(100.0)[0], 0.0, atol=1e-12)


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
    with pytest.raises(
        ScenarioError, match=r"segments\[1\].curve: joint2 is moving; expected curve = minimum_jerk or ruckig"
    ):
        planned(tmp_path, text + MOVE.format(""))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "segments: missing|segments"),
        ('[[segments]]\nkind = "jump"\n', r"kind = 'jump'.*move"),
        ('[[segments]]\nkind = "move"\n', r"segments\[0\].*goal: missing"),
        ('[[segments]]\nkind = "move"\ngoal = [1.0]\n', r"segments\[0\].goal = \[1.0\]: expected 6 numbers"),
        ('[[segments]]\nkind = "move"\ngoal = { elbow = 1.0 }\n', r"segments\[0\].goal = 'elbow': no joint of the arm"),
        ('[[segments]]\nkind = "move"\ngoal = { joint1 = 0.1 }\n', r"segments\[0\].goal: the move has no length"),
        (
            '[[segments]]\nkind = "move"\ngoal = { joint3 = 3.0 }\n',
            r"segments\[0\].goal of joint3 = 3.0: 0.286 rad outside",
        ),
        (
            MOVE.format("duration_s = 0.01"),
            r"segments\[0\].duration = 0.01: expected 0.\d+ s or more, which joint2 needs",
        ),
        (MOVE.format("duration_s = -1"), r"segments\[0\].*duration_s = -1: expected greater than 0"),
        (MOVE.format("speed = 2"), r"segments\[0\].*speed = 2"),
        (MOVE.format("sped = 1"), r"segments\[0\].*sped.*unknown key; did you mean speed"),
        (
            MOVE.format('curve = "ruckig"\ngoal_velocity = { joint1 = 0.1 }'),
            r"segments\[0\]: ends while joint1 is moving; expected a last segment",
        ),
        (MOVE.format("goal_velocity = 0.1"), r"segments\[0\].goal_velocity: with curve = 's_curve'"),
        ('[[segments]]\nkind = "release"\n', r"segments\[0\].release: the hand is empty"),
        ('[[segments]]\nkind = "dwell"\nduration_s = 0\n', "duration_s = 0"),
        ('[[segments]]\nkind = "waypoints"\npoints = [[0.1, 0, 0, 0, 0, 0]]\n', r"points\[1\]: is where waypoint 0 is"),
        ('[[segments]]\nkind = "waypoints"\npoints = [[1, 2]]\n', r"segments\[0\].points\[0\]: 2 numbers; expected 6"),
        (
            '[[segments]]\nkind = "waypoints"\npoints = [[0.3, 0, 0, 0, 0, 0], [0.5, 0, 0, 0, 0, 0]]\ntimes_s = [3, 2]\n',
            r"segments\[0\].times\[2\] = 2.0: not after 3",
        ),
        (
            '[[segments]]\nkind = "tool"\npath = [{ kind = "line", to_m = [5, 0, 0] }]\nspeed_m_per_s = 0.1\n'
            "acceleration_m_per_s2 = 1\n",
            r"segments\[0\]",
        ),
        (
            '[[segments]]\nkind = "tool"\npath = [{ kind = "spiral" }]\nspeed_m_per_s = 0.1\nacceleration_m_per_s2 = 1\n',
            "kind = 'spiral'.*line, arc or circle",
        ),
        (
            '[[segments]]\nkind = "time_optimal"\npoints = [[1, 2]]\n',
            r"segments\[0\].points\[0\]: 2 numbers; expected 6",
        ),
        ('[[segments]]\nkind = "grip"\nmass_kg = 1\ncom_m = [0, 0, 0]\ninertia_kg_m2 = [0, 0, 0]\n', "nothing moves"),
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
        ("acceleration = 3.0", "acceleration = { elbow = 1.0 }", "no joint of the arm"),
        ("acceleration = 3.0", "speed = 3.0", "limits.speed.*unknown key"),
        ("jerk = 60.0", "", r"segments\[0\].*no jerk limit of joint2"),
        ("start = [0.1,", "start = [9,", r"start of joint1 = 9.0: 6.033 rad outside its limits"),
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
    with pytest.raises(ScenarioError, match=r"segments\[0\]: .* are .* mm apart at .* s; expected 3000 mm or more"):
        planned(tmp_path, MOVE.format(""), OBSTACLES.format(least=3.0, floor=-1.0))
    with pytest.raises(ScenarioError, match=r"segments\[0\]: .* and floor overlap by .* mm at .* s"):
        planned(tmp_path, MOVE.format(""), OBSTACLES.format(least=0.0, floor=0.4))


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
    with pytest.raises(ScenarioError, match=r"loop\.reference\.file = 'a\.motion\.toml': is one of lwa4p"):
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
    np.testing.assert_allclose(aw.load_motion(files[0], plan.arm).at(t)[0], plan.motion.at(t)[0], atol=1e-9)


def test_the_command_says_what_is_exceeded(tmp_path):
    planned(tmp_path, MOVE.format(""), FILE + "torque = { joint2 = 1.0 }\n")
    done = CliRunner().invoke(app, ["plan", str(tmp_path / "a.motion.toml")])
    assert done.exit_code == 1
    assert "exceeds limits: joint2: torque" in done.output


def test_the_command_ends_with_2_and_writes_nothing(tmp_path):
    path = tmp_path / "a.motion.toml"
    path.write_text(FILE)
    done = CliRunner().invoke(app, ["plan", str(path), "-o", str(tmp_path / "m.csv")])
    assert done.exit_code == 2
    assert not (tmp_path / "m.csv").exists()


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

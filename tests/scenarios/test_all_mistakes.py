"""Twenty mistakes in a scenario file, and many in a log and a motion file, are all reported at once with their lines."""

from __future__ import annotations

import pytest

import armwright as aw
from armwright.errors import ArmwrightError, ScenarioError

SCENARIO = """\
robot = "puma560"
duration_s = -1  #! a time above 0
sed = 3  #! did you mean seed
comand = [1, 2]  #! did you mean commands
[start]
q = [0, 0, 0]  #! expected 6 numbers
qd = "fast"  #! a finite number
[solver]
integrator = "rk9"  #! did you mean rk4
step_s = 0  #! a time above 0
substeps = 1.5  #! a whole number
[recording]
every = -1  #! expected
[loop]
period_s = -0.001  #! a time above 0
[loop.controller]
kind = "joint_pd"  #! did you mean joint_pid
[loop.reference]
kind = "stepp"  #! did you mean step
[loop.sensors]
counts = -5  #! counts above 0
encoder = 3  #! unknown key
[loop.timing]
preset = "fastest"  #! there is ideal, one-tick, sync
delay_s = -1  #! did you mean command_delay_s
[inputs]
wrench = [1, 2]  #! 6 numbers, not 2
brake = { elbw = 1 }  #! a joint without a brake
[[inputs.payload]]
time_s = 0
mass_kg = 1
com_m = [0, 0]  #! 3 numbers, not 2
[values]
"link9.mass_kg" = 1  #! no such parameter
[tuning]
phase_margin_rad = 30  #! [rad]; 30° is 0.5236
gain_margin = 0.5  #! a factor of 1 or more
generations = 0  #! expected
"""
LOG = """\
titel = "x"  #! did you mean title
joints = ["one", "two", "two"]  #! a name twice
kinematics_only = true  #! goes with robot
[files.a]
path = "a.csv"
separator = 5  #! unknown key
skip_linez = -1  #! did you mean skip_lines
[files.b]  #! a path here or in
decimal = ";"  #! expected '.' or ','
[time]
columm = "t"  #! did you mean column
unit = "hour"  #! expected 's'
[gears]
ratios = [1, 0, 3]  #! cannot be inverted
[[signals]]
quantity = "torq"  #! expected 'position'
columns = 3
[[signals]]
file = "a"
quantity = "position"
columns = ["a", "b", "c"]
side = "moter"  #! expected 'joint' or 'motor'
held = true  #! goes with a torque
signs = [1, 1, 2]  #! 1 or -1
[[signals]]
file = "c"  #! no such file
quantity = "voltage"
columns = ["v", "w", "x"]
[[signals]]
file = "a"
quantity = "current"
columns = ["x", "y", "z"]
unit = "N m"  #! no unit of a current
joints = ["one"]  #! 3, one for each column
offsets = [1, 2]  #! one number, or 3
side = "motor"  #! no side
[[runs]]
name = 5  #! text
use = "fitt"  #! expected 'fit'
from_s = "x"  #! a finite number
files = { d = "x" }  #! no such file
"""
MOTION = """\
robot = "puma560"
start = [0, 0, 0, 0, 0]  #! expected 6 numbers
clearance_m = -1  #! greater than or equal to 0
[limits]
jrk = 3  #! did you mean jerk
velocity = [1, 2]  #! or one for each of 6 joints
torque = { elbw = 1 }  #! no joint of the arm; did you mean elbow
[[obstacle]]  #! did you mean obstacles
[[obstacles]]
kind = "sphere"
position_m = [0, 0]  #! 3 numbers, not 2
radius_m = 0.1
[[obstacles]]
kind = "box"
position_m = [1, 1, 1]
size_m = [0.1, -0.1, 0.1]  #! above 0
[[segments]]
kind = "move"
goal = [1, 0, 0, 0, 0, 0]
sped = 3  #! did you mean speed
[[segments]]
kind = "dwel"  #! expected move
[[segments]]
kind = "move"
goal = { elbow = 99 }  #! outside its limits
goal_velocity = 0.1  #! minimum_jerk or ruckig
[[segments]]
kind = "dwell"
duration_s = -1  #! greater than 0
[[segments]]
kind = "release"  #! the hand is empty
[[segments]]
kind = "grip"
mass_kg = -2  #! greater than 0
com_m = [0, 0]  #! 3 numbers, not 2
inertia_kg_m2 = [0, 0, 0]
[[segments]]
kind = "grip"
mass_kg = 2
com_m = [0, 0, 0]
inertia_kg_m2 = [1, 0.1, 0.1]  #! xx = 1 > yy + zz
[[segments]]
kind = "waypoints"
curve = "cubik"  #! expected 'fastest', 'cubic'
points = [[0, 0, 0, 0, 0, 0]]
[[segments]]
kind = "waypoints"
points = [[0, 0, 0]]  #! 3 numbers; expected 6
times_s = [0.5, 0.2]  #! expected 1, one a waypoint
[[segments]]
kind = "time_optimal"
points = [[0, 0, 0, 0, 0, 50]]  #! outside its limits
[[segments]]
kind = "tool"
path = [{ kind = "line", to_m = [1, 2] }]  #! 3 numbers, not 2
speed_m_per_s = 0  #! greater than 0
acceleration_m_per_s2 = 1
"""


@pytest.mark.parametrize(
    ("text", "name", "read", "least"),
    [
        (SCENARIO, "a.scenario.toml", aw.read_scenario, 20),
        (LOG, "a.log.toml", aw.identification.read_log, 20),
        (MOTION, "a.motion.toml", aw.trajectories.plan, 20),
    ],
)
def test_all_are_reported_with_their_lines(tmp_path, text, name, read, least):
    lines = text.split("\n")
    planted = {k: line.partition("  #! ")[2] for k, line in enumerate(lines, 1) if "#! " in line}
    assert len(planted) >= least
    path = tmp_path / name
    path.write_text("\n".join(line.partition("  #! ")[0] for line in lines), encoding="utf-8")
    with pytest.raises(ArmwrightError) as refused:
        read(path)
    problems = [(problem.line, str(problem)) for problem in refused.value.problems]
    assert {line for line, _ in problems} == planted.keys()
    for line, words in planted.items():
        assert any(at == line and words in said for at, said in problems), (line, words, problems)


@pytest.mark.parametrize(("key", "value", "expected"), [
    ("phase_margin_rad", "30", "an angle from 0 to below π [rad]; 30° is 0.5236"),
    ("phase_margin_rad", "-1", "an angle from 0 to below π [rad]"),
    ("gain_margin", "0", "a factor of 1 or more"),
])  # fmt: skip
def test_a_tuning_table_is_refused_with_file_line_and_unit(tmp_path, key, value, expected):
    path = tmp_path / "a.scenario.toml"
    path.write_text(
        f'robot = "two-link"\nduration_s = 1\n[commands]\nconstant = 0\n[tuning]\n{key} = {value}\n', encoding="utf-8"
    )
    with pytest.raises(ScenarioError) as refused:
        aw.read_scenario(path)
    assert (refused.value.place, refused.value.expected, refused.value.file) == (f"tuning.{key}", expected, f"{path}:6")


def test_a_tolerance_that_goes_with_the_integrator_is_no_mistake_beside_others(tmp_path):
    path = tmp_path / "a.scenario.toml"
    path.write_text(
        'robot = "two-link"\nduration_s = 1\n[commands]\nconstant = 0\n[start]\nq = [0]\n'
        '[solver]\nintegrator = "rk45"\nrtol = 1e-6\natol = 2\n',
        encoding="utf-8",
    )
    with pytest.raises(ScenarioError) as refused:
        aw.read_scenario(path)
    assert [problem.place for problem in refused.value.problems] == ["start.q", "solver.atol"]


def test_a_word_of_others_is_answered_with_ours(tmp_path):
    text = """robot = "cmu-dd"
duration_s = 0.1
step_s = 0.001
[loop.controller]
kind = "cascade"
position_kp = 20
velocity_kp = 3
"""
    path = tmp_path / "vel.scenario.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ArmwrightError, match=r"velocity_kp.* speed_kp\?"):
        aw.read_scenario(path)

"""Scenario files: the same runs as in Python, clear refusals, lanes, and runs done again."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import armwright as aw
from armwright.description.writer import write_toml
from armwright.errors import ArmwrightError, RunError, ScenarioError
from armwright.model.changes import TERMS
from armwright.scenarios import mistakes, records
from armwright.simulation.inputs.input_schedule import all_rows
from physics.arms import arm as arm_named
from raises_at import raises_at

HEAD = """
robot = "cmu-dd"
duration_s = 0.05
solver.step_s = 1e-3
"""
DRIVEN = HEAD + "[commands]\nconstant = [4, -3, 2, 1, 0.5, 0.25]\n"
PID = HEAD + (
    '[loop.controller]\nkind = "joint_pid"\nkp = [400, 900, 300, 150, 30, 20]\nkd = [40, 90, 30, 12, 3, 2]\n'
    '[loop.reference]\nkind = "expression"\nq = { joint2 = "0.2*sin(3*t)", joint4 = "10 deg" }\n'
)


def scenario(folder, text):
    path = folder / "one.scenario.toml"
    path.write_text(text, encoding="utf-8")
    return aw.read_scenario(path)


def test_a_driven_arm_is_that_of_python(tmp_path):
    run = aw.simulate(scenario(tmp_path, DRIVEN + "[start]\nq = { joint2 = 0.3 }\n"))
    arm = aw.load("cmu-dd")
    command = [4, -3, 2, 1, 0.5, 0.25]
    same = aw.simulate(
        aw.Scenario(arm, command=command, duration=0.05, start=[0, 0.3, 0, 0, 0, 0], solver=aw.Solver(step=1e-3))
    )
    np.testing.assert_array_equal(run.q, same.q)


@pytest.mark.study
def test_terms_are_taken_away_as_in_python(tmp_path):
    """Every term that `replace` takes away, springs and cylinders too."""
    arm = arm_named("sprung")
    write_toml(arm.record, tmp_path / "sprung.toml")
    text = 'robot = "sprung.toml"\nduration_s = 0.01\nwithout = [%s]\n[commands]\nconstant = [0, 0, 0, 0, 0]\n'
    for term in TERMS:
        run = aw.simulate(scenario(tmp_path, text % f'"{term}"'))
        same = aw.simulate(aw.Scenario(arm.replace(**{term: None}), command=[0.0] * 5, duration=0.01))
        np.testing.assert_array_equal(run.q, same.q)


def test_schedules_and_robots_lie_beside_the_file(tmp_path):
    arm = aw.load("cmu-dd")
    write_toml(arm.description, tmp_path / "mine.toml")
    (tmp_path / "volts.csv").write_text(
        "t,1,2,3,4,5,6\n".replace("1,2,3,4,5,6", ",".join(arm.names)) + "0,1,2,3,0,0,0\n0.02,0,0,0,1,1,1\n"
    )
    text = HEAD.replace("cmu-dd", "mine.toml") + '[commands]\nschedule = "volts.csv"\n'
    run = aw.simulate(scenario(tmp_path, text))
    rows = aw.Schedule(np.array([0.0, 0.02]), np.array([[1.0, 2, 3, 0, 0, 0], [0, 0, 0, 1, 1, 1]]), tuple(arm.names))
    same = aw.simulate(aw.Scenario(arm, command=rows, duration=0.05, solver=aw.Solver(step=1e-3)))
    np.testing.assert_array_equal(run.q, same.q)
    aw.save(run, tmp_path / "run.nc")
    for name in ("volts.csv", "mine.toml", "one.scenario.toml"):
        (tmp_path / name).unlink()
    assert aw.reproduce(tmp_path / "run.nc").same


@pytest.mark.study
def test_a_controlled_arm_and_its_lanes(tmp_path):
    lanes = '[lanes]\nkind = "grid"\n[lanes.vary]\n"loop.timing.command_delay_s" = { values = [0, 1.5e-3] }\n'
    lanes += (
        '"link6.mass_kg" = { start = 1.0, stop = 2.0, count = 2 }\n"loop.controller.kp[1]" = { values = [500, 900] }\n'
    )
    many = aw.simulate(scenario(tmp_path, PID + lanes))
    assert many.sizes["lane"] == 8
    assert many.attrs["controller"] == "compiled"
    text = PID.replace("kp = [400, 900,", "kp = [400, 500,")
    text += "[loop.timing]\ncommand_delay_s = 1.5e-3\n"
    one = aw.simulate(
        scenario(tmp_path, text.replace("[loop.controller]", "[values]\n'link6.mass_kg' = 2.0\n[loop.controller]"))
    )
    np.testing.assert_allclose(many.q.values[6], one.q.values, atol=1e-10)


def test_draws_depend_on_the_seed_and_on_nothing_else(tmp_path):
    drawn = (
        PID + '[lanes]\nkind = "draws"\ncount = 5\nseed = 7\n[lanes.vary]\n"start.q[1]" = { normal = [0.1, 0.02] }\n'
    )
    first = scenario(tmp_path, drawn)
    more = scenario(tmp_path, drawn + '"loop.controller.kp[0]" = { uniform = [300, 500] }\n')
    q0 = first.start.q.values
    np.testing.assert_array_equal(q0, more.start.q.values)
    other = scenario(tmp_path, drawn.replace("seed = 7", "seed = 8"))
    assert not np.array_equal(q0, other.start.q.values)
    assert np.abs(q0[:, 1] - 0.1).max() < 0.1
    assert np.all(q0[:, [0, 2, 3, 4, 5]] == 0.0)


@pytest.mark.study
def test_noise_and_losses_come_again(tmp_path):
    noisy = PID.replace("[loop.controller]", "seed = 5\n[loop.controller]").replace(
        "[loop.controller]",
        "[loop.sensors]\nposition_noise = 1e-4\n[loop.timing]\njitter_s = 5e-4\ncommand_loss = 0.1\n[loop.controller]",
    )
    run = aw.simulate(scenario(tmp_path, noisy))
    aw.save(run, tmp_path / "run.nc")
    again = aw.reproduce(tmp_path / "run.nc")
    assert again.same
    assert again.surroundings == ()
    calm = aw.simulate(scenario(tmp_path, PID))
    assert not np.array_equal(run.q, calm.q)


def test_another_surrounding_is_told_and_other_numbers_found(tmp_path):
    run = aw.simulate(scenario(tmp_path, DRIVEN))
    run.attrs["made_with"] = json.dumps(json.loads(run.attrs["made_with"]) | {"numpy": "1.0"})
    run["q"] = run["q"] + 1e-9
    aw.save(run, tmp_path / "run.nc")
    again = aw.reproduce(tmp_path / "run.nc")
    assert not again.same
    assert again.surroundings[0].startswith("numpy: 1.0 then")
    assert again.differences["q"] == pytest.approx(1e-9, rel=1e-6)


def test_a_run_of_python_keeps_no_scenario(tmp_path):
    run = aw.simulate(aw.Scenario(aw.load("two-link"), command=[1.0, 1.0], duration=0.01))
    aw.save(run, tmp_path / "run.nc")
    with raises_at(RunError, match="no scenario", file=tmp_path / "run.nc"):
        aw.reproduce(tmp_path / "run.nc")


@pytest.mark.sample(12)
@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD, r"expected either \[commands\] or \[loop\]"),
        (DRIVEN + "speed = 3\n", "drive speed|unknown"),
        (DRIVEN.replace("cmu-dd", "cmu-ddd"), "robot = 'cmu-ddd'.*mean cmu-dd"),
        (
            DRIVEN.replace("duration_s = 0.05", "duration_s = 0.0505"),
            r"duration_s = 0\.0505",
        ),
        (DRIVEN.replace("0.05\n", "0.05\nsolver.substeps = 0\n"), "solver.substeps = 0"),
        (DRIVEN.replace("[4, -3,", "[4,"), r"commands\.constant = \[4\.0, 2\.0, 1\.0, 0\.5, 0\.25\]"),
        (DRIVEN + "[start]\nq = { joint9 = 1 }\n", r"start\.q = 'joint9': no joint"),
        (PID.replace("joint_pid", "joint_pidd"), "kind = 'joint_pidd': unknown; .*joint_pid"),
        (PID.replace("kd =", "kdd ="), r"loop\.controller = 'kdd': no key of a joint_pid"),
        (
            PID.replace("joint_pid", "computed_torque").replace("kd =", "inertia = 1\nfriction = true\nkd ="),
            r"(?s)'inertia': .*computed_torque.*'friction': .* kind = \"feed_forward\", friction = ",
        ),
        (PID.replace("[400, 900, 300, 150, 30, 20]", "[400, 900]"), "kp"),
        (PID.replace("sin(3*t)", "sinn(3*t)"), "'sinn': unknown function"),
        (PID.replace("joint4 =", "joint7 ="), r"loop\.reference\.q = 'joint7': no joint"),
        (PID + "[loop.timing]\npreset = 'onetick'\n", "did you mean one-tick"),
        (PID + "[loop.timing]\ncommand_delay_s = -1e-3\n", "0 s or more"),
        (PID + "[loop.sensors]\nvelocity = 'observer'\n", "cutoff_hz"),
        (
            PID + "[lanes]\nkind = 'grid'\n[lanes.vary]\n'link6.mass' = { values = [1] }\n",
            "'link6.mass': no such parameter",
        ),
        (
            PID + "[lanes]\nkind = 'grid'\n[lanes.vary]\n'loop.controller.kx' = { values = [1] }\n",
            r"did you mean loop.controller.kp",
        ),
        (
            PID + "[lanes]\nkind = 'grid'\n[lanes.vary]\n'loop.sensors.counts' = { values = [1] }\n",
            "differ by lane",
        ),
        (
            PID + "[lanes]\nkind = 'list'\n[lanes.vary]\n'loop.controller.kp[0]' = { normal = [1, 1] }\n",
            "expected kind = 'draws'",
        ),
        (
            PID + "[lanes]\nkind = 'draws'\n[lanes.vary]\n'loop.controller.kp[0]' = { normal = [1, 1] }\n",
            "count and seed",
        ),
        (HEAD.replace("0.05", "nan") + "[commands]\nconstant = 1\n", "expected a finite number"),
        ("robot = [", "not TOML"),
    ],
)
def test_what_cannot_be_run_is_refused_in_one_line(tmp_path, text, said):
    with pytest.raises(ArmwrightError, match=said) as refused:
        aw.simulate(scenario(tmp_path, text))
    assert str(refused.value).startswith(str(tmp_path)) or "scenario" not in said
    assert len(str(refused.value).splitlines()) == len(refused.value.problems) + (len(refused.value.problems) > 1)


HUGE = "9" * 400  # beyond float range
NO_NUMBERS = ("2020-01-01", "12:00:00", "1979-05-27T07:32:00Z", "[2020-01-01, 1]", "{ elbow = 2020-01-01 }", "nan", "[nan, 0]",
              "[[1, 2]]", "[{ a = 1 }]", HUGE, f"[{HUGE}, 1]", f"{{ elbow = {HUGE} }}")  # fmt: skip
PLACES = {
    "loop.controller.kp": "kp = {}\n[loop.reference]\nkind = 'pose'\nq = 0\n",
    "loop.reference.q": "kp = 1\n[loop.reference]\nkind = 'pose'\nq = {}\n",
    "loop.reference.time": "kp = 1\n[loop.reference]\nkind = 'step'\nstart = [0, 0]\ngoal = [1, 1]\ntime = {}\n",
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("value", NO_NUMBERS)
def test_values_of_toml_that_are_no_numbers_are_refused_in_one_line(tmp_path, value, place):
    """Also where one entry of them differs by lane."""
    text = "robot = 'two-link'\nduration_s = 0.01\n[loop]\nperiod_s = 1e-3\n[loop.controller]\nkind = 'joint_pid'\n"
    lanes = "[lanes]\nkind = 'list'\n[lanes.vary]\n'loop.controller.kp[0]' = { values = [1.0, 2.0] }\n"
    for more in ("", lanes):
        with pytest.raises(ScenarioError) as refused:
            scenario(tmp_path, text + PLACES[place].format(value) + more)
        assert refused.value.place == place
        assert "\n" not in str(refused.value)


def test_formulas_beyond_numbers_name_their_place_once(tmp_path):
    """They are found when the run asks for their values; the same in [recording.reference]."""
    text = PID.replace('"0.2*sin(3*t)"', HUGE)
    with pytest.raises(ScenarioError) as refused:
        aw.simulate(scenario(tmp_path, text))
    assert refused.value.place == "loop.reference.q"
    text = f"{DRIVEN}[recording]\nreduce = ['rms_error']\n[recording.reference]\nkind = 'expression'\nq = {{ joint1 = {HUGE} }}\n"
    with pytest.raises(ScenarioError) as refused:
        aw.simulate(scenario(tmp_path, text))
    assert refused.value.place == "recording.reference.q"


def test_formulas_that_are_none_name_their_place(tmp_path):
    text = PID.replace('"0.2*sin(3*t)"', "2020-01-01")
    with pytest.raises(ArmwrightError) as refused:
        scenario(tmp_path, text)
    assert refused.value.place == "loop.reference.q"


@pytest.mark.study
@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_file_is_a_scenario_or_refused(tmp_path, data):
    """Lines of a good file, some of them spoilt."""
    lines = [
        line for line in (PID + "[loop.timing]\npreset = 'one-tick'\n[lanes]\nkind = 'grid'\n").splitlines() if line
    ]
    for _ in range(data.draw(st.integers(1, 3))):
        k = data.draw(st.integers(0, len(lines) - 1))
        lines[k] = data.draw(
            st.sampled_from(
                ["", "x = 1", "kp = 'a'", "q = [1]", "[lanes.vary]", "robot = 3", "kd = nan", lines[k][::-1]]
            )
        )
    said, count = "", 0
    try:
        scenario(tmp_path, "\n".join(lines))
    except ArmwrightError as error:
        said, count = str(error), len(error.problems)
    assert len(said.splitlines()) == count + (count > 1)


@pytest.mark.parametrize("wrench", ['"push.csv"', "[3, 0, -5, 0, 0, 1]"])
def test_a_wrench_is_six_numbers_or_a_table(tmp_path, wrench):
    (tmp_path / "push.csv").write_text("t,fx,fy,fz,mx,my,mz\n0,3,0,-5,0,0,1\n")
    text = (
        f'robot = "two-link"\nduration_s = 0.1\nsolver.step_s = 1e-3\ninputs.wrench = {wrench}\n'
        '[loop.controller]\nkind = "computed_torque"\nkp = 100\nkd = 20\n'
    )
    (tmp_path / "push.scenario.toml").write_text(text)
    scenario = aw.read_scenario(tmp_path / "push.scenario.toml")
    np.testing.assert_array_equal(all_rows(scenario.input_schedules["wrench"]), [[3.0, 0, -5, 0, 0, 1]])


TWO = 'robot = "two-link"\nduration_s = 0.2\n'
PAYLOAD = """
[[inputs.payload]]
time_s = 0.0503
mass_kg = 2.0
com_m = [0.0, 0.0, 0.1]
inertia_kg_m2 = { xx = 0.012, xy = 0.001, xz = 0.0, yy = 0.01, yz = 0.0, zz = 0.009 }
[[inputs.payload]]
time_s = 0.1
mass_kg = 0.5
com_m = [0.0, 0.0, 0.1]
inertia_kg_m2 = [0.01, 0.01, 0.01]
frame = "forearm"
[[inputs.payload]]
time_s = 0.15
mass_kg = 0
"""


def test_a_payload_of_a_mass_alone_is_a_point_mass(tmp_path):
    text = TWO + "[commands]\nconstant = [20, 5]\n[[inputs.payload]]\ntime_s = 0.05\nmass_kg = 2\n"
    whole = text + "com_m = [0, 0, 0]\ninertia_kg_m2 = [0, 0, 0]\n"
    one, two = (aw.simulate(scenario(tmp_path, each)) for each in (text, whole))
    np.testing.assert_array_equal(one.q, two.q)
    with raises_at(ScenarioError, "inputs.payload[0].com_m", "missing"):
        scenario(tmp_path, text + "inertia_kg_m2 = [1, 1, 1]\n")


def test_payloads_are_those_of_python_and_come_again(tmp_path):
    run = aw.simulate(scenario(tmp_path, TWO + "[commands]\nconstant = [20, 5]\n" + PAYLOAD))
    tensor = np.array([[0.012, 0.001, 0], [0.001, 0.01, 0], [0, 0, 0.009]])
    payloads = [
        aw.Payload(0.0503, 2.0, [0, 0, 0.1], tensor),
        aw.Payload(0.1, 0.5, [0, 0, 0.1], [0.01, 0.01, 0.01], "forearm"),
        aw.Payload(0.15, 0.0),
    ]
    same = aw.simulate(
        aw.Scenario(aw.load("two-link"), command=[20, 5], duration=0.2, inputs=aw.Inputs(payload=payloads))
    )
    np.testing.assert_array_equal(run.q, same.q)
    plain = aw.simulate(scenario(tmp_path, TWO + "[commands]\nconstant = [20, 5]\n"))
    np.testing.assert_allclose(run.q[:51], plain.q[:51], atol=1e-15)
    assert (run.q[-1] != plain.q[-1]).all()
    aw.save(run, tmp_path / "run.nc")
    assert aw.reproduce(tmp_path / "run.nc").same


def test_what_acts_differs_by_lane(tmp_path):
    lanes = (
        '[lanes]\nkind = "list"\n[lanes.vary]\n"inputs.payload[0].mass_kg" = { values = [1, 2] }\n'
        '"inputs.payload[0].time_s" = { values = [0.03, 0.0503] }\n"inputs.payload[0].com_m[2]" = { values = [0.2, 0.1] }\n'
        '"inputs.payload[0].inertia_kg_m2.xy" = { values = [-0.001, 0.001] }\n"inputs.wrench[1]" = { values = [7, -5] }\n'
    )
    text = "inputs.wrench = [3, 0, 0, 0, 0, 1]\n" + TWO + "[commands]\nconstant = [20, 5]\n" + PAYLOAD
    many = aw.simulate(scenario(tmp_path, text + lanes))
    one = aw.simulate(scenario(tmp_path, text.replace("[3, 0,", "[3, -5,")))
    np.testing.assert_array_equal(many.q[1], one.q)
    assert (many.q[0, -1] != one.q[-1]).all()


def test_commands_over_time_are_reduced(tmp_path):
    text = TWO + '[commands]\nconstant = [20, 5]\n[recording]\nwhat = "none"\nreduce = ["peak_error", "energy"]\n'
    text = text.replace('["peak_error", "energy"]', '["peak_error", "peak_torque"]')
    run = aw.simulate(scenario(tmp_path, text + '[recording.reference]\nkind = "pose"\nq = [0.1, 0.2]\n'))
    whole = aw.simulate(scenario(tmp_path, TWO + "[commands]\nconstant = [20, 5]\n"))
    np.testing.assert_array_equal(run.peak_error, np.abs(whole.q - [0.1, 0.2]).max("time"))
    np.testing.assert_array_equal(run.peak_torque, np.abs(whole.tau).max("time"))


def braked_file(folder):
    from armwright.description.writer import write_toml
    from simulation.plants import BRAKE, MOTOR, chain

    joint = {"command": "voltage", "motor": MOTOR, "brake": BRAKE}
    model = chain([joint, joint, {"command": "voltage", "motor": MOTOR}])
    write_toml(model.description, folder / "braked.toml")
    return 'robot = "braked.toml"\nduration_s = 0.1\nsolver.step_s = 1e-3\n'


@pytest.mark.sample(1)
@pytest.mark.parametrize("brake", ["true", "[1, 1]", "{ joint0 = 1, joint1 = 1 }", '"brake.csv"'])
def test_brakes_are_applied_as_in_python(tmp_path, brake):
    (tmp_path / "brake.csv").write_text("t,joint1,joint0\n0,1,1\n")
    run = aw.simulate(
        scenario(tmp_path, f"inputs.brake = {brake}\n" + braked_file(tmp_path) + "[commands]\nconstant = 0\n")
    )
    same = aw.simulate(
        aw.Scenario(
            aw.load(tmp_path / "braked.toml"),
            command=np.zeros(3),
            duration=0.1,
            inputs=aw.Inputs(brake=1),
            solver=aw.Solver(step=1e-3),
        )
    )
    np.testing.assert_array_equal(run.q, same.q)
    aw.save(run, tmp_path / "run.nc")
    assert aw.reproduce(tmp_path / "run.nc").same


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (
            PAYLOAD.replace("mass_kg = 2.0", "mass_kg = -2"),
            r"inputs\.payload\[0\]\.mass_kg = -2.0: .*0 kg or more",
        ),
        (
            PAYLOAD.replace("xx = 0.012", "xx = 0.12"),
            r"payload\[0\]\.inertia_kg_m2: principal moments",
        ),
        (PAYLOAD.replace("[0.01, 0.01, 0.01]", "[0.01, 0.01]"), "3 numbers, not 2: "),
        (PAYLOAD.replace("xz = 0.0, ", ""), r"inputs.payload\[0\].inertia_kg_m2.xz: missing"),
        (PAYLOAD.replace("mass_kg = 0\n", "mas_kg = 0\n"), "unknown key; .*mass_kg"),
        (PAYLOAD.replace("0.15", "0.01"), r"payload\[2\]\.time_s = 0\.01: expected one after payload\[0\]'s 0\.0503 s"),
        (PAYLOAD.replace("forearm", "forarm"), "frame = 'forarm': two-link .*forearm"),
        ("inputs.wrench = [1, 2]\n", "inputs.wrench = .*: .*6 numbers, not 2"),
        ("inputs.brake = 1\n", "two-link has a brake"),
        ("[loop.timing]\npreset = 'one-tick'\n", "loop.controller: missing"),
        ("[start]\ncommand = 1\n", "start.command = 1: unknown key"),
        ("[recording.reference]\nkind = 'pose'\nq = 1\n", "recording.reference: goes with recording.reduce"),
        (
            "[lanes]\nkind='list'\n[lanes.vary]\n'inputs.payload[0].mass_kg' = {values=[1]}\n",
            r"lanes = 'inputs\.payload\[0\]\.mass_kg': .*\[\[inputs\.payload\]\]",
        ),
        (
            PAYLOAD + "[lanes]\nkind='list'\n[lanes.vary]\n'inputs.payload[0].mass' = {values=[1]}\n",
            "did you mean mass_kg",
        ),
        ("[lanes]\nkind='list'\n[lanes.vary]\n'inputs.wrench[0]' = {values=[1]}\n", "numbers of wrench"),
        ("[lanes]\nkind='draws'\ncount=1\nseed=1\n[lanes.vary]\n'a' = {normal=[1]}\n", "expected 2 numbers, not 1"),
    ],
)
def test_what_cannot_act_is_refused_in_one_line(tmp_path, more, said):
    flat = more.startswith("inputs")
    text = (more if flat else "") + TWO + "[commands]\nconstant = [20, 5]\n" + ("" if flat else more)
    with pytest.raises(ArmwrightError, match=said) as refused:
        scenario(tmp_path, text)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("duration_s = -1\n[commands]\nconstant = 0\n", "duration_s"),
        ("duration_s = 1\n[commands]\nconstant = 0\n[solver]\nstep_s = -1\n", "solver.step_s"),
        ("[loop]\nperiod_s = -1\n[loop.controller]\nkind = 'joint_pid'\nkp = 1\n", "loop.period_s"),
        ("[loop.timing]\njitter_s = -1\n[loop.controller]\nkind = 'joint_pid'\nkp = 1\n", "loop.timing.jitter_s"),
    ],
)
def test_errors_use_the_keys_of_the_file(tmp_path, text, place):
    """With their units, which the fields in Python do not have."""
    if not text.startswith("duration"):
        text = f"duration_s = 1\n{text}"
    with pytest.raises(ScenarioError) as error:
        scenario(tmp_path, f'robot = "two-link"\n{text}')
    assert error.value.place == place


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("duration_s = 0.0105\n[commands]\nconstant = 0\n[solver]\nstep_s = 1e-3\n", "solver.step_s = 0.001 s"),
        (
            "duration_s = 0.0105\n[loop]\nperiod_s = 1e-3\n[loop.controller]\nkind = 'joint_pid'\nkp = 1\n",
            "loop.period_s",
        ),
        (
            "duration_s = 1\n[loop]\nperiod_s = 1e-3\n[loop.controller]\nkind = 'joint_pid'\nkp = 1\n[solver]\nstep_s = 1\n",
            "loop.period_s / solver.substeps",
        ),
    ],
)
def test_what_is_expected_uses_them_too(tmp_path, text, expected):
    with pytest.raises(ScenarioError) as error:
        scenario(tmp_path, f'robot = "two-link"\n{text}')
    assert expected in error.value.expected


def test_places_that_are_no_keys_stay():
    assert mistakes.key_in_file("loop.controller.kp[2]") == "loop.controller.kp[2]"
    assert mistakes.key_in_file("inputs.payload[1].time of lane 3") == "inputs.payload[1].time_s of lane 3"
    assert mistakes.key_in_file("link6.mass") == "link6.mass"
    assert mistakes.key_in_file("") == ""


UNITS = re.compile("(?<!_per)_(s|m|kg|kg_m2|v)$")


@pytest.mark.parametrize(
    ("table", "group"),
    [
        (records.StartTable, aw.Start),
        (records.LoopTable, aw.Loop),
        (records.InputsTable, aw.Inputs),
        (records.SolverTable, aw.Solver),
        (records.RecordingTable, aw.Recording),
        (records.PayloadTable, aw.Payload),
        (records.TimingTable, aw.Timing),
        (records.SensorsTable, aw.Sensors),
        (records.CommandFilterTable, aw.CommandFilter),
    ],
)
def test_tables_have_the_fields_of_the_groups_in_python(table, group):
    """Units aside; events, processor level and device of a solver are those of Python alone."""
    names = {UNITS.sub("", name) for name in table.model_fields}
    only_python = {"events", "target", "device"} if group is aw.Solver else set()
    assert names == {field.name for field in dataclasses.fields(group)} - only_python

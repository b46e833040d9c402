"""Scenario files with one mistake each: refused in one line that names it, and no other."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ArmwrightError, DescriptionError, DivergenceError, ScenarioError
from raises_at import raises_at

BASE = """
robot = "two-link"
duration_s = 0.02
solver.step_s = 1e-3
[loop.controller]
kind = "computed_torque"
kp = 100
kd = 20
"""
POSE = '[loop.reference]\nkind = "pose"\nq = [0.5, 0]\n'
DRAWS = '[lanes]\nkind = "draws"\ncount = 3\nseed = 1\n[lanes.vary]\n"forearm.mass_kg" = '
LIST = '[lanes]\nkind = "list"\n[lanes.vary]\n'
GRID = '[lanes]\nkind = "grid"\n[lanes.vary]\n'
LONG = "{ start = 1, stop = 2, count = 100000 }\n"


def read(folder, text):
    path = folder / "one.scenario.toml"
    path.write_text(text, encoding="utf-8")
    return aw.read_scenario(path)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("text", "said"),
    [
        (BASE + DRAWS + "{ normal = [1] }\n", "2 numbers, not 1: "),
        (BASE + DRAWS + "{ uniform = [2, 1] }\n", "then an upper"),
        (BASE + DRAWS + "{ uniform = [-1e308, 1e308] }\n", "a finite way apart"),
        (
            BASE + DRAWS + "{ lognormal = [1.7e308, 5] }\n",
            r"lanes\.vary\['forearm\.mass_kg'\] of lane \d = inf: ",
        ),
        (
            BASE + DRAWS.replace("seed = 1", "seed = 18446744073709551616") + "{ normal = [1, 0] }\n",
            "lanes: seed = 1844.*: expected",
        ),
        (BASE + LIST + '"loop.controller.kp[2]" = { values = [1] }\n', r"expected loop.controller.kp\[0\] …"),
        (BASE + LIST + '"forearm.com_m" = { values = [1, 2] }\n', r"lanes = 'forearm\.com_m': 3 numbers"),
        (BASE + LIST + '"loop.controller.kp" = { values = [] }\n', "1 or more, not 0"),
        (BASE + '[lanes]\nkind = "list"\n', "lanes.vary: missing"),
        (
            BASE + GRID + f'"loop.controller.kp" = {LONG}"loop.controller.kd" = {LONG}',
            "grid of 1e[+]10 lanes",
        ),
        ("inputs.wrench = [1, 2]\n" + BASE, "6 numbers, not 2: .* N m$"),
        (BASE + POSE.replace("[0.5, 0]", '"a"'), "reference.q = 'a'"),
        (BASE + POSE.replace("[0.5, 0]", "true"), "reference.q = True: expected a number"),
        (
            BASE + '[loop.reference]\nkind = "quintic"\ngoal = ["a", 0]\nduration = 1\n',
            r"reference.goal = \['a', 0\]: expected",
        ),
        (BASE + '[loop.reference]\nkind = "schedule"\nfile = 5\n', "file = 5"),
        (BASE + '[loop.reference]\nkind = "expression"\nq = ["9**9**9**9", "0"]\n', "too large"),
        (BASE + "[loop.sensors]\ncounts = [1, 2, 3]\n", r"sensors\.counts = \[1\.0, 2\.0, 3\.0\]"),
        (BASE + '[loop.sensors]\ncounts = "a"\n', "loop.sensors.counts = 'a': expected a finite number$"),
        (BASE + '[start]\nq = "30deg"\n', "start.q = '30deg': expected a finite number$"),
        (BASE + "[start]\nq = true\n", "start.q = True: expected a finite number$"),
        (BASE + '[start]\nq = [0, "a"]\n', r"start.q\[1\] = 'a': expected a finite number$"),
        (BASE.replace("0.02", '"1"'), "duration_s = '1': expected a finite number$"),
        (BASE.replace("0.02", "true"), "duration_s = True: expected a finite number$"),
        ('solver.substeps = "2"\n' + BASE, "solver.substeps = '2': expected a whole number$"),
        (
            "solver.substeps = 'a'\nseed = 'b'\n" + BASE,
            r"2 mistakes\n.*:1: .*\n.*:2: seed = 'b': .*whole number$",
        ),
        (BASE + "period = 5.0\n", r"loop\.controller = 'period': no key of a computed_torque"),
        (BASE + 'model = "puma560"\n', r"loop\.controller = 'model': no key of a computed_torque"),
        (
            BASE.replace("kp = 100", "kp = [[1, 1], [2, 2]]"),
            "loop.controller.kp = .*",
        ),
        (
            BASE + '[values]\n"forearm.mass_kg" = [1, 2]\n',
            r"\[lanes",
        ),
        (BASE + "[faults]\nx = 1\n", r"faults: .*\[loop.timing\]"),
    ],
)
def test_a_mistake_is_told_in_one_line(tmp_path, text, said):
    with pytest.raises(ArmwrightError, match=said) as refused:
        aw.simulate(read(tmp_path, text))
    assert len(str(refused.value).splitlines()) == len(refused.value.problems) + (len(refused.value.problems) > 1)


def test_one_joint_is_no_range(tmp_path):
    from armwright.description.writer import write_toml
    from simulation.plants import MOTOR, chain

    write_toml(chain([{"command": "voltage", "motor": MOTOR}]).description, tmp_path / "one.toml")
    text = (
        'robot = "one.toml"\nduration_s = 0.02\n[commands]\nconstant = 0\n' + LIST + '"start.q[1]" = { values = [1] }\n'
    )
    with raises_at(ArmwrightError, "lanes", r"start\.q\[0\]", value="start.q[1]"):
        read(tmp_path, text)


def test_what_goes_wrong_in_a_run_names_the_file(tmp_path):
    from typer.testing import CliRunner

    from armwright.cli.app import app

    path = tmp_path / "one.scenario.toml"
    path.write_text(BASE + '[loop.reference]\nkind = "expression"\nq = ["log(-1)", "0"]\n')
    refused = CliRunner().invoke(app, ["simulate", str(path)])
    assert refused.stderr.startswith(f"armwright: error: {path}: loop.reference of shoulder at t = 0 s")


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["limit", "rate"])
def test_joints_that_a_table_leaves_out_have_no_limit(tmp_path, name):
    first = aw.load("two-link").names[0]
    free = aw.simulate(read(tmp_path, BASE + POSE))
    other = aw.simulate(read(tmp_path, BASE + POSE + f"[loop.command_filter]\n{name} = {{ {first} = 1e6 }}\n"))
    held = aw.simulate(read(tmp_path, BASE + POSE + f"[loop.command_filter]\n{name} = {{ {first} = 1 }}\n"))
    if name == "limit":
        np.testing.assert_array_equal(free.u_issued, other.u_issued)
        assert np.abs(held.u_issued[:, 0]).max() <= 1.0
    assert np.abs(held.u_issued[:, 1]).max() > 1.0


@pytest.mark.parametrize(("law", "key"), [("kp = -1", "kp"), ("kp = 10, kd = -2", "kd")])
def test_gains_are_refused_under_their_keys(tmp_path, law, key):
    text = f'robot = "two-link"\nduration_s = 0.02\n[loop]\nperiod_s = 1e-3\ncontroller = {{ kind = "joint_pid", {law} }}\n'
    with pytest.raises(ScenarioError) as refused:
        read(tmp_path, text + 'reference = { kind = "pose", q = 0 }\n')
    assert refused.value.place == f"loop.controller.{key} of joint 'shoulder'"
    assert refused.value.problems[0].line == 5


def test_a_file_of_another_kind_is_named(tmp_path):
    path = tmp_path / "arm.toml"
    for text, command in (("duration_s = 1", "simulate"), ("segments = []", "plan"), ("", "log")):
        path.write_text(f'robot = "two-link"\n{text}\n', encoding="utf-8")
        with raises_at(DescriptionError, "robot", f"`armwright {command} {path}`"):
            aw.load(path)


def test_a_loop_that_diverges_says_what_to_try():
    arm = aw.load("puma560")
    loop = aw.Loop(aw.JointPID(kp=1e7, kd=1e5), np.ones(6), 1e-3)
    with pytest.raises(DivergenceError, match=r"elbow oscillates .*`armwright loops FILE`"):
        aw.simulate(aw.Scenario(arm, 1.0, loop=loop))

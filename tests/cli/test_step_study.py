"""`armwright step-study`: a table of steps and what is recommended; what cannot be tried is refused in one line."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

from armwright.cli.app import app
from simulation.first_steps import GEARED_MOTOR

SCENARIO = """
robot = "two-link"
duration_s = 0.04
solver.step_s = 2e-3
[commands]
constant = [90.0, 20.0]
[start]
q = 0.4
"""


COUNTED = """
robot = "two-link"
duration_s = 0.4
solver.step_s = 8e-3
[loop.controller]
kind = "joint_pid"
kp = [100.0, 100.0]
kd = [10.0, 10.0]
[loop.reference]
kind = "expression"
q = { shoulder = "0.5*sin(9*t)", elbow = "0.4*sin(13*t)" }
[loop.sensors]
counts = 1000000
velocity = "difference"
"""


def asked(*arguments: str):
    return CliRunner().invoke(app, ["step-study", *arguments])


def test_steps_and_recommendations_are_shown():
    result = asked(
        "two-link", "--command", "90,20", "--duration", "0.04", "--step-count", "3", "--accuracies", "0.1,1e-30"
    )
    assert result.exit_code == 0
    assert "two-link: rk3 (order 3) against CVODES" in result.output
    assert "for an accuracy of 0.1: a step of 4 ms" in result.output
    assert "for an accuracy of 1e-30: no step that was tried" in result.output


def test_a_scenario_file_says_all_of_it(tmp_path):
    path = tmp_path / "push.scenario.toml"
    path.write_text(SCENARIO.replace("solver.step_s", 'solver.integrator = "rk45"\nsolver.rtol = 1e-4\nsolver.step_s'))
    result = asked(str(path), "--step-count", "3", "--integrator", "rk4", "--accuracies", "1e-3")
    assert result.exit_code == 0, result.stderr
    assert "two-link: rk4 (order 4) against CVODES" in result.output
    assert "for an accuracy of 0.001: a step of" in result.output


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["two-link", "--duration", "1"], "no command given; expected --schedule FILE or --torque"),
        (
            ["two-link", "--torque", "0", "--duration", "1", "--accuracies", "1e-3,x"],
            "--accuracies = '1e-3,x': expected numbers",
        ),
        (
            ["two-link", "--torque", "0", "--duration", "1", "--integrator", "rk45"],
            "--integrator = 'rk45': chooses its",
        ),
        (
            ["two-link", "--torque", "0", "--duration", "1", "--step-count", "0"],
            "--step-count = 0: expected a whole number",
        ),
        (["two-link", "--torque", "0"], "error: --duration: expected a time above 0 [s]"),
        (["x.scenario.toml", "--duration", "1"], "--duration: the scenario file states this already"),
    ],
)
def test_what_cannot_be_tried_is_refused_in_one_line(arguments, said):
    result = asked(*arguments)
    assert result.exit_code == 2
    assert said in result.stderr
    assert result.stderr.count("\n") == 1


def study_of(arm, path, *arguments: str):
    """The study of an arm in a file, on a screen that is wide enough."""
    path.write_text(arm)
    result = CliRunner().invoke(app, ["step-study", str(path), *arguments], env={"COLUMNS": "160"})
    assert result.exit_code == 0, result.stderr
    return result.output


def test_an_arm_that_sticks_is_compared_with_steps_that_follow_it(tmp_path):
    text = GEARED_MOTOR + "\n[joints.friction]\ncoulomb_positive_n_m = 2.0\ncoulomb_negative_n_m = 2.0\n"
    before, after = text.split("[joints.motor]")
    shown = study_of(f"{before}[joints.motor]{after}", tmp_path / "arm.toml", "--voltage", "12", "--duration", "0.02")
    assert "against rk45 at 1e-11" in shown
    assert "CVODES" not in shown


def test_of_a_stiff_arm_the_stiff_rule_is_shown_with_what_limits_the_others(tmp_path):
    gear = "[joints.elasticity]\nstiffness_n_m_per_rad = 1e8\ndamping_n_m_s_per_rad = 1e4\n"
    arguments = ("--voltage", "12", "--duration", "0.02", "--step-count", "2", "--accuracies", "1e-2,1e-7")
    shown = study_of(GEARED_MOTOR.replace("[[links]]", f"{gear}\n[[links]]"), tmp_path / "arm.toml", *arguments)
    assert re.search(r"4 to 2 +too large", shown)
    assert "of the elastic gear of joint 'axis'" in shown
    assert "auto, rodas3," in shown
    assert "for an accuracy of 0.01: no step that was tried; auto keeps it, with no step given" in shown
    assert re.search(r"1e-07: no step that was tried; auto with an accuracy of \S+ is wrong by \de-0[678]", shown)


def test_simulate_takes_an_integrator():
    """The end of a run by steps that lanes choose is the one that CVODES finds, to the digits that are shown."""
    asked = ["simulate", "two-link", "--torque", "90,20", "--duration", "0.1", "--step", "0.05", "--integrator"]
    ends = [CliRunner().invoke(app, [*asked, name]).output.partition("at the end")[2] for name in ("rk45", "cvodes")]
    assert "shoulder" in ends[0]
    assert ends[0] == ends[1]


def test_runs_that_a_count_parts_are_told(tmp_path):
    """A column says from when on, and a sentence why."""
    path = tmp_path / "counted.scenario.toml"
    path.write_text(COUNTED)
    result = asked(str(path), "--step-count", "2", "--accuracies", "1e-3")
    assert result.exit_code == 0, result.stderr
    assert "other counts from [s]" in result.output
    assert "rows behind are not compared" in result.output
    plain = asked("two-link", "--command", "90,20", "--duration", "0.04", "--step-count", "2")
    assert "counts" not in plain.output

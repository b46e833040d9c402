"""`armwright excite` as users type it."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from armwright.cli.app import app


def run(*arguments):
    return CliRunner().invoke(app, ["excite", *map(str, arguments)])


def test_a_motion_of_an_arm(tmp_path):
    path, picture = tmp_path / "motion.csv", tmp_path / "motion.png"
    result = run(
        "two-link",
        "-o",
        path,
        "--max-velocity",
        "2,3",
        "--harmonics",
        3,
        "--starts",
        1,
        "--cycle",
        4,
        "--record-period",
        0.02,
        "--plot",
        picture,
    )
    assert result.exit_code == 0, result.output
    assert "condition number" in result.output
    assert result.stderr == "designing a motion of two-link by 1 start, each of some seconds\n"
    assert "self-collision is not checked" in result.output
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    assert rows.shape == (201, 7)
    assert (np.abs(rows[:, 3:5]) <= [2.0, 3.0]).all()
    assert picture.stat().st_size > 10_000


def test_a_command_of_a_motor(tmp_path):
    path, picture = tmp_path / "prbs.csv", tmp_path / "prbs.svg"
    guess = ("--motor-gain", 12, "--time-constant", 0.05, "--max-command", 12)
    result = run("motor", "prbs", "-o", path, *guess, "--plot", picture)
    assert result.exit_code == 0, result.output
    assert path.read_text().startswith("t [s],motor [V]\n")
    assert "<svg" in picture.read_text()
    assert run("motor", "cmu-dd", "step", "-o", path, "--joint", "joint1").exit_code in (0, 2)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["two-link", "-o", "m.csv"], "nothing bounds the speed"),
        (["nobody", "-o", "m.csv"], "nobody"),
        (["two-link", "-o", "m.txt"], "the ending '.txt' is not offered"),
        (["motor", "prbs", "-o", "m.csv", "--motor-gain", "1"], "no --time-constant, --max-command"),
        (
            ["motor", "prbs", "-o", "m.csv", "--motor-gain", "0", "--time-constant", "1", "--max-command", "1"],
            "--motor-gain = 0",
        ),
        (
            ["motor", "noise", "-o", "m.csv", "--motor-gain", "1", "--time-constant", "1", "--max-command", "1"],
            "kind = 'noise'",
        ),
        (["two-link"], "--output"),
        (["two-link", "-o", "m.csv", "--max-velocity", "1", "--criterion", "best"], "--criterion = 'best'"),
        (["two-link", "-o", "m.csv", "--max-velocity", "1", "--cycle", "-1"], "--cycle = -1"),
        (
            [
                "motor",
                "step",
                "-o",
                "m.csv",
                "--motor-gain",
                "1",
                "--time-constant",
                "1",
                "--max-command",
                "1",
                "--period",
                "0",
            ],
            "--period = 0",
        ),
    ],
)
def test_bad_input_is_one_line(tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == 2
    assert said in result.output
    assert "Traceback" not in result.output
    assert not list(tmp_path.iterdir())


def test_nothing_is_announced_before_a_refusal(tmp_path):
    result = run("two-link", "-o", tmp_path / "m.csv", "--max-velocity", 0)
    assert result.exit_code == 2
    assert result.output.startswith("armwright: error: --max-velocity = ")
    assert result.output.count("\n") == 1

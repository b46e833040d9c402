"""`armwright compare-controllers`: tables, picture, file, exit codes."""

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app

SCENARIO = """
robot = "two-link"
duration_s = 1.0

[loop]
period_s = 2e-3

[loop.controller]
kind = "joint_pid"
kp = {kp}
kd = 40
gravity = true
"""
MOTION = """
robot = "{robot}"
start = 0.0

[limits]
position = 3.0
velocity = 1.0
acceleration = 4.0
jerk = 40.0

[[segments]]
kind = "move"
goal = 0.3
"""


@pytest.fixture
def files(tmp_path):
    for name, kp in (("soft", 100), ("stiff", 300)):
        (tmp_path / f"{name}.scenario.toml").write_text(SCENARIO.format(kp=kp))
    (tmp_path / "move.motion.toml").write_text(MOTION.format(robot="two-link"))
    (tmp_path / "other.motion.toml").write_text(MOTION.format(robot="cmu-dd"))
    aw.trajectories.Quintic(np.zeros(2), np.array([0.2, 0.1]), 0.4).save(aw.load("two-link"), tmp_path / "saved.csv")
    return tmp_path


def run(folder, *arguments):
    shown = [str(folder / each) if "." in str(each) and not str(each)[0].isdigit() else str(each) for each in arguments]
    result = CliRunner().invoke(app, ["compare-controllers", *shown])
    if result.exception and result.exit_code == 1:
        raise result.exception
    return result.exit_code, result.output


@pytest.mark.study
def test_two_controllers_on_two_motions(files):
    code, text = run(
        files, "soft.scenario.toml", "stiff.scenario.toml", "--reference", "move.motion.toml", "--reference", "saved.csv",
        "--lanes", 2, "--settle", "0.2", "--plot", "errors.png", "-o", "errors.csv",
    )  # fmt: skip
    assert code == 0, text
    for word in ("soft", "stiff", "move", "saved", "AT_p", "settling"):
        assert word in text
    assert (files / "errors.png").read_bytes().startswith(b"\x89PNG")
    rows = (files / "errors.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0].startswith("controller,motion,payload,joint,rms_error,largest_error")
    assert len(rows) == 1 + 2 * 2 * 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("soft.scenario.toml",), "--reference"),
        (("soft.scenario.toml", "--reference", "none.csv"), "none.csv"),
        (("soft.scenario.toml", "--reference", "other.motion.toml"), "cmu-dd"),
        (("soft.scenario.toml", "soft.scenario.toml", "--reference", "saved.csv"), "given twice"),
        (("soft.scenario.toml", "--reference", "saved.csv", "--payload", "-1"), "--payload"),
        (("soft.scenario.toml", "--reference", "saved.csv", "--lanes", "0"), "runs"),
        (("soft.scenario.toml", "--reference", "saved.csv", "--plot", "errors.gif"), ".gif"),
        (("soft.scenario.toml", "--reference", "saved.csv", "-o", "errors.txt"), ".txt"),
        (("soft.scenario.toml", "--reference", "saved.csv", "-o", "saved.csv"), "saved.csv"),
    ],
)
def test_bad_input(files, arguments, words):
    code, text = run(files, *arguments)
    assert code == 2
    assert words in text
    assert not (files / "errors.gif").exists()

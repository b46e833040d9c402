"""`armwright tune`: the written file, the page, exit codes."""

import re

import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app

pytest.importorskip("cma", reason="cma is not installed: pip install armwright[control]")

SCENARIO = """\
robot = "two-link"
duration_s = 0.4

[loop]
period_s = {period}  # of the bus

[loop.controller]
kind = "joint_pid"
kp = [600, 120]  # by hand
kd = {{shoulder = 60, elbow = 10}}
gravity = true

[loop.reference]
kind = "pose"
q = [0.3, 0.2]

[loop.timing]
preset = "one-tick"
"""
QUICK = ("--lanes", "16", "--generations", "4")


def run(folder, *arguments, period=2e-3, name="tuned.scenario.toml"):
    file = folder / "arm.scenario.toml"
    file.write_text(SCENARIO.format(period=period))
    result = CliRunner().invoke(app, ["tune", str(file), "-o", str(folder / name), *QUICK, *map(str, arguments)])
    return result.exit_code, result.output


def test_a_tuned_scenario_is_the_file_with_other_gains(tmp_path):
    code, text = run(tmp_path, "--report", tmp_path / "tuned.html")
    assert code == 0, text
    written = (tmp_path / "tuned.scenario.toml").read_text()
    assert "# by hand" in written
    assert "# of the bus" in written
    old = [line for line in SCENARIO.format(period=2e-3).splitlines() if not line.startswith(("kp", "kd"))]
    assert [line for line in written.splitlines() if not line.startswith(("kp", "kd"))] == old
    tuned = aw.read_scenario(tmp_path / "tuned.scenario.toml")
    assert tuned.controller.kp.tolist() != [600.0, 120.0]
    assert "held-out lanes goes from" in text
    for words in (
        "kp    N m/rad",
        "kd    N m s/rad",
        "rms_error   rad",
        "1 is the start's mean over the lanes tuned in",
    ):
        assert words in text, words
    page = (tmp_path / "tuned.html").read_text(encoding="utf-8")
    assert "<svg" in page
    assert "held-out lanes goes from" in page


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--gain", "kp"), "--gain"),
        (("--gain", "kp=1:2:3"), "--gain"),
        (("--gain", "kp=2", "--gain", "kp=3"), "given twice"),
        (("--objective", "rms=1"), "rms_error"),
        (("--lanes", "1"), "lanes"),
        (("--report", "tuned.gif"), ".gif"),
    ],
)
def test_refused_in_one_line_and_nothing_is_written(tmp_path, arguments, words):
    code, text = run(tmp_path, *arguments)
    assert code == 2, text
    assert words in text
    assert len(text.strip().splitlines()) == 1
    assert not (tmp_path / "tuned.scenario.toml").exists()


def test_an_unstable_start(tmp_path):
    code, text = run(tmp_path, period=0.05)
    assert code == 2
    assert "start gains are unstable" in text
    assert len(text.strip().splitlines()) == 1


def test_margins_that_no_gains_reach_say_which_delay_or_period_would_do(tmp_path):
    file = tmp_path / "arm.scenario.toml"
    file.write_text(SCENARIO.format(period=2e-3) + "command_delay_s = 0.02\n")
    output = tmp_path / "tuned.scenario.toml"
    asked = ("--gain", "kp=1.01", "--phase-margin", "35deg", "--generations", "1", "--lanes", "4")
    result = CliRunner().invoke(app, ["tune", str(file), "-o", str(output), *asked])
    assert result.exit_code == 2
    assert re.search(r"no gains found that keep .* at 2 ms .*; expected a delay of [\d.]+ ms or less", result.stderr)
    assert len(result.stderr.strip().splitlines()) == 1
    assert not output.exists()


def test_the_scenario_itself_is_never_replaced(tmp_path):
    code, text = run(tmp_path, name="arm.scenario.toml")
    assert code == 2
    assert "would be replaced" in text

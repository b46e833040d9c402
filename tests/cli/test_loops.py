"""`armwright loops`: table, words, pictures, exit codes."""

import pytest
from typer.testing import CliRunner

from armwright.cli.app import app

SCENARIO = """
robot = "two-link"
duration_s = 1.0

[loop]
period_s = {period}

[loop.controller]
kind = "joint_pid"
kp = 300
kd = 40
gravity = true

[loop.timing]
preset = "one-tick"
"""


def run(folder, *arguments, period=2e-3, text=SCENARIO):
    file = folder / "arm.scenario.toml"
    file.write_text(text.format(period=period))
    result = CliRunner().invoke(app, ["loops", str(file), "--poses", "200", *map(str, arguments)])
    return result.exit_code, result.output


@pytest.mark.study
def test_a_loop_that_keeps_its_margins(tmp_path):
    report, plot = tmp_path / "loops.html", tmp_path / "loops.png"
    code, text = run(tmp_path, "--report", report, "--plot", plot)
    assert code == 0, text
    assert "shoulder" in text
    assert "it would be stable up to a period of" in text
    assert plot.read_bytes().startswith(b"\x89PNG")
    page = report.read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert "<svg" in page
    assert "keeps its margins" in page


@pytest.mark.study
@pytest.mark.parametrize("change", ["gains", "period"])
def test_what_would_keep_the_margins_is_written(change, tmp_path):
    out = tmp_path / "fixed.scenario.toml"
    code, text = run(tmp_path, "-o", out, "--change", change, period=4e-3)
    assert code == 1  # of the loop as it is
    assert "a lower bandwidth keeps" in " ".join(text.split())
    assert "# armwright loops: " in out.read_text()
    (tmp_path / "arm.scenario.toml").unlink()
    result = CliRunner().invoke(app, ["loops", str(out), "--poses", "200"])
    assert result.exit_code == 0, result.output
    code, text = run(tmp_path, "-o", tmp_path / "same.scenario.toml")
    assert code == 0
    assert "is not written" in text
    assert not (tmp_path / "same.scenario.toml").exists()


@pytest.mark.study
def test_a_loop_that_is_too_slow(tmp_path):
    code, text = run(tmp_path, period=0.05)
    assert code == 1
    assert "NOT stable" in text


@pytest.mark.parametrize(
    ("arguments", "text", "words"),
    [
        (("--gain-margin", "0.5"), SCENARIO, "gain_margin"),
        (("--phase-margin", "200deg"), SCENARIO, "phase_margin"),
        (("--poses", "0"), SCENARIO, "poses"),
        (("--plot", "loops.gif"), SCENARIO, ".gif"),
        (("--change", "gains"), SCENARIO, "--change"),
        (("--change", "delay", "-o", "x.scenario.toml"), SCENARIO, "--change"),
        ((), 'robot = "two-link"\nduration_s = 1.0\n[commands]\nconstant = [0, 0]\n', "loop"),
    ],
)
def test_refused(tmp_path, arguments, text, words):
    code, output = run(tmp_path, *arguments, text=text)
    assert code == 2, output
    assert words in output
    assert len(output.strip().splitlines()) == 1

"""`armwright design`: the written file, what limits each joint, exit codes."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app

pytest.importorskip("control", reason="python-control is not installed: pip install armwright[control]")

SCENARIO = """\
robot = "two-link"     # direct
duration_s = 0.4

[loop]
period_s = 2e-3

[loop.controller]
kind = "feed_forward"  # gravity
inner = { kind = "cascade", position_kp = 1, speed_kp = 1 }

[loop.timing]
preset = "one-tick"
"""


def armwright(*arguments, code=0):
    result = CliRunner().invoke(app, [*map(str, arguments)])
    assert result.exit_code == code, result.output
    return result.output


def test_designed_gains_are_written_into_the_file_with_their_reasons(tmp_path):
    file, out = tmp_path / "arm.scenario.toml", tmp_path / "designed.scenario.toml"
    file.write_text(SCENARIO)
    text = armwright("design", file, "-o", out, "--poses", 200)
    written = out.read_text()
    design = aw.loops.design_gains(aw.read_scenario(file), poses=200)
    inner = aw.read_scenario(out).controller.inner
    for name, gains in design.gains.items():
        np.testing.assert_array_equal(getattr(inner, name), gains)
    assert "# direct" in written
    assert 'kind = "feed_forward"  # gravity' in written
    reasons = [line for line in written.splitlines() if line.startswith("# armwright design: ")]
    for line, limit in zip(reasons[-2:], design.limits, strict=True):
        assert line == f"# armwright design: {limit}"
        assert "the delay of 2 ms (×" in line
        assert str(limit) in text
    armwright("design", out, "-o", tmp_path / "again.scenario.toml", "--poses", 200)
    again = (tmp_path / "again.scenario.toml").read_text()
    assert again.count("# armwright design") == len(reasons)  # its own lines are replaced, not gathered


def test_a_bandwidth_that_does_not_keep_the_margins_is_no_success(tmp_path):
    file, out = tmp_path / "arm.scenario.toml", tmp_path / "designed.scenario.toml"
    file.write_text(SCENARIO)
    text = armwright("design", file, "-o", out, "--poses", 200, "--bandwidth", 300, code=1)
    assert "do NOT keep" in text
    assert "do NOT keep" in out.read_text()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("two-link",), "--period: missing"),
        (("two-link", "--period", 2e-3, "--controller", "lqg"), "--controller = 'lqg': unknown"),
        (("two-link", "--period", 2e-3, "--robot", "two-link"), "--robot = 'two-link': goes with a scenario file"),
        (("arm.scenario.toml", "--period", 2e-3), "--period = 0.002: the scenario file states this already"),
        (("arm.scenario.toml", "--gain-margin", 0.5), "gain_margin"),
        (("arm.scenario.toml", "--reference", "none.csv"), "none.csv"),
        (("arm.scenario.toml", "--gain-margin", 1e6), "no bandwidth keeps"),
    ],
)
def test_refused_in_one_line_and_nothing_is_written(arguments, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.scenario.toml").write_text(SCENARIO)
    text = armwright("design", *arguments, "-o", "designed.scenario.toml", "--poses", 50, code=2)
    assert said in " ".join(text.split())
    assert not (tmp_path / "designed.scenario.toml").exists()


def test_an_arm_gets_a_scenario_that_follows_a_motion(tmp_path):
    arm = aw.load("two-link")
    motion = aw.trajectories.Quintic([0.1, 0.2], [0.4, -0.3], 0.5)
    motion.save(arm, tmp_path / "go.csv")
    out = tmp_path / "go.scenario.toml"
    armwright("design", "two-link", "--period", 3e-3, "--reference", tmp_path / "go.csv", "-o", out, "--poses", 200)
    scenario = aw.read_scenario(out)
    assert scenario.duration == pytest.approx(0.501)  # whole periods
    np.testing.assert_array_equal(scenario.start.q, [0.1, 0.2])
    run = aw.simulate(scenario)
    np.testing.assert_allclose(run.q.values[-1], [0.4, -0.3], atol=0.15)

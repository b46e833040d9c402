"""`armwright design`: the written file, what limits each joint, exit codes, and a chain of files without a number typed."""

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
    design = aw.design_gains(aw.read_scenario(file), poses=200)
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
    motion = aw.Quintic([0.1, 0.2], [0.4, -0.3], 0.5)
    motion.save(tmp_path / "go.csv", arm)
    out = tmp_path / "go.scenario.toml"
    armwright("design", "two-link", "--period", 3e-3, "--reference", tmp_path / "go.csv", "-o", out, "--poses", 200)
    scenario = aw.read_scenario(out)
    assert scenario.duration == pytest.approx(0.501)  # whole periods
    np.testing.assert_array_equal(scenario.start.q, [0.1, 0.2])
    run = aw.simulate(scenario)
    np.testing.assert_allclose(run.q.values[-1], [0.4, -0.3], atol=0.15)


MOTION = """\
robot = "identified.toml"
start = 0.0
[limits]
velocity = 0.4
acceleration = 1.0
jerk = 10.0
[[segments]]
kind = "grip"
mass_kg = 0.5
[[segments]]
kind = "move"
goal = 0.4
"""


@pytest.mark.study
@pytest.mark.parametrize(("robot", "period", "timing"), [("lwa4p", 4e-3, "one-tick"), ("cmu-dd", 5e-4, "ideal")])
def test_a_chain_of_files_from_the_excitation_to_the_bus(robot, period, timing, tmp_path, monkeypatch):
    """excite → simulate → identify → plan → design → loops → simulate → C → FMU → twin; each reads what the step before wrote."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "go.motion.toml").write_text(MOTION)
    armwright("excite", robot, "-o", "excite.csv", "--period", 8, "--harmonics", 3, "--starts", 1, "--velocity", 0.8)
    armwright(
        "design", robot, "--period", period, "--timing", timing, "--reference", "excite.csv", "-o", "excited.scenario.toml"
    )  # fmt: skip
    armwright("simulate", "excited.scenario.toml", "-o", "excited.csv", "--log", "arm.log.toml")
    armwright("identify", "arm", "arm.log.toml", "-o", "identified.toml")
    armwright("plan", "go.motion.toml", "-o", "go.csv")
    armwright("design", "excited.scenario.toml", "--reference", "go.csv", "-o", "held.scenario.toml")
    armwright("simulate", "held.scenario.toml", "-o", "held.csv", "--log", "arm.log.toml", "--hold-out")
    armwright("validate", "identified.toml", "arm.log.toml")
    armwright(
        "design", "excited.scenario.toml", "--robot", "identified.toml", "--reference", "go.motion.toml", "-o", "go.scenario.toml"
    )  # fmt: skip
    armwright("loops", "go.scenario.toml", "--poses", 2000)
    armwright("simulate", "go.scenario.toml", "-o", "go.nc")
    text = armwright("export", "controller", "go.scenario.toml", "-o", "firmware")
    assert "every command has the bits of the simulation" in text or "no C compiler" in text
    armwright("export", "fmu", "go.scenario.toml", "--part", "both", "--platforms", "host", "-o", "go.fmu")
    if robot == "lwa4p":  # frames of a bus take longer than half a millisecond
        pytest.importorskip("canopen")
        text = armwright("run-controller", "go.scenario.toml", "--go")
        assert "are those of the simulation, to the bit" in text

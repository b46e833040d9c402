""" "No alarm" is said only where every joint was judged practically all the time and the model went with the arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.shadow.verdict import Judged, verdict
from identification.arm.simulated_log import motion
from shadow.test_shadow import log_file

ARM = aw.load("two-link")


def said(lost, farthest=(0.0, 0.0), alarms=0, time=100.0):
    return verdict(ARM, Judged(time, np.array(lost), np.array(farthest)), alarms)


@pytest.mark.parametrize(
    ("lost", "clean", "lines"),
    [
        ((0.0, 0.0), True, ["no alarm"]),
        ((0.9, 0.9), True, ["no alarm", "not judged: all joints 0.9 % of the time"]),
        ((1.1, 1.1), False, ["no verdict: too much was not judged", "not judged: all joints 1.1 % of the time"]),
        ((100, 100), False, ["no verdict: no joint was judged", "not judged: all joints 100 % of the time"]),
        (
            (0.5, 2.0),
            False,
            ["no verdict on elbow; nothing raised by the others", "not judged: shoulder 0.5 %, elbow 2 % of the time"],
        ),
    ],
)
def test_lines(lost, clean, lines):
    found = said(lost)
    assert (found.clean, list(found.lines)) == (clean, lines)


def test_alarms_and_no_time_are_not_clean():
    assert said((0.0, 0.0), alarms=2).lines == ("2 alarms",)
    assert not said((0.0, 0.0), alarms=1).clean
    assert said((0.0, 0.0), time=0.0).lines[0] == "no verdict: no joint was judged"


def test_a_position_residual_that_is_far_is_no_clean_verdict():
    found = said((0.0, 0.0), (0.1, 0.8))
    assert not found.clean
    assert "no alarm" not in found.lines
    assert any("elbow: the position residual reached 0.8 rad, beyond 0.5" in line for line in found.lines)
    assert said((0.0, 0.0), (0.1, 0.49)).clean


def test_a_light_joint_that_leaves_its_model(tmp_path):
    """A torque within the limit of a record that fits badly moves the elbow's model 0.8 rad away: said, with exit code 1."""
    from typer.testing import CliRunner

    from armwright.cli.app import app

    rows = motion(2, 4.0, 500.0, seed=2)
    path = log_file(tmp_path, ARM, rows, np.array([0.0, 0.0]))
    table = np.loadtxt(tmp_path / "log.csv", delimiter=",", skiprows=1)
    table[:, -1] += 25.0
    heads = (tmp_path / "log.csv").read_text().splitlines()[0]
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=heads, comments="", fmt="%.10g")
    found = aw.shadow.shadow_log(aw.identification.read_log(path), ARM, deviation=4.0)
    assert not found.alarms
    assert found.largest("position")[1] > 0.5
    assert not found.verdict.clean
    shown = CliRunner().invoke(app, ["shadow", "two-link", str(path), "--deviation", "4"])
    assert shown.exit_code == 1
    assert "elbow: the position residual reached" in shown.output
    assert "no alarm" not in shown.output
    found.report(tmp_path / "shadow.html")
    assert "position residual reached" in (tmp_path / "shadow.html").read_text()


def test_parts_of_a_log_that_are_not_judged(tmp_path):
    """NaN from 1 s to 2 s of 4 s, in one joint's torque."""
    rows = motion(2, 4.0, 500.0, seed=2)
    path = log_file(tmp_path, ARM, rows, 0.0)
    log = aw.identification.read_log(path)
    right = aw.shadow.shadow_log(log, ARM, deviation=1.0)
    assert right.verdict.clean
    assert right.verdict.lines == ("no alarm",)
    lines = (tmp_path / "log.csv").read_text().splitlines()
    for k in range(501, 1001):
        lines[k] = lines[k].rsplit(",", 1)[0] + ",nan"
    (tmp_path / "log.csv").write_text("\n".join(lines))
    found = aw.shadow.shadow_log(aw.identification.read_log(path), ARM, deviation=1.0)
    assert found.verdict.lines[0] == "no verdict: too much was not judged"
    assert "28.9 %" in found.verdict.lines[1]
    ((_, event),) = found.events
    assert (event.signal, event.joint, event.rows) == ("tau", "elbow", 500)


def test_sums_over_runs():
    one = Judged(2.0, np.array([1.0, 0.0]), np.array([0.1, 0.3]))
    total = sum((one, replace(one, time=6.0)), Judged.of(2))
    assert total.unjudged == pytest.approx([0.25, 0.0])
    assert total.farthest == pytest.approx([0.1, 0.3])

"""`armwright shadow`: what it shows, its exit codes, its page, and what it refuses in one line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli import shadow_live
from armwright.cli.app import app
from identification.arm.simulated_log import motion
from shadow.test_shadow import EMPTY, RATE, log_file, noise_of, validated


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """two-link.toml with its verdict, log.log.toml of the right arm, heavy.log.toml of one with 1 kg more."""
    place = tmp_path_factory.mktemp("shadow")
    arm = aw.load("two-link")
    noise = noise_of(arm)
    validated(place, arm, noise)
    log_file(place, arm.with_payload(1.0, *EMPTY), motion(2, 2.0, RATE, seed=11), noise, "heavy")
    return place


def command(*arguments, code):
    result = CliRunner().invoke(app, ["shadow", *map(str, arguments)])
    assert result.exit_code == code, result.output
    return result.output


def test_the_right_arm_raises_nothing(folder):
    shown = command(folder / "two-link.toml", folder / "log.log.toml", code=0)
    assert "no alarm" in shown
    assert "standard deviations of the residuals: residuals of the validation with log.log.toml" in shown
    assert "passes its limits" in shown or "passed" in shown or "verdict:" in shown


def test_another_payload_raises_an_alarm(folder):
    page = folder / "shadow.html"
    arguments = (folder / "two-link.toml", folder / "heavy.log.toml")
    shown = command(*arguments, "--report", page, code=1)
    assert "kg at the tip explains" in shown
    text = page.read_text()
    assert text.count("<svg") == 2
    assert "1 alarm" in text
    assert "kg at the tip explains" in text
    assert "http" not in text.replace("http://www.w3.org", "")
    table = json.loads(command(*arguments, "--json", code=1))["tables"][0]
    found = aw.shadow.shadow_log(aw.identification.read_log(folder / "heavy.log.toml"), folder / "two-link.toml")
    assert [row["joint"] for row in table["rows"]] == list(found.arm.names)
    assert found.alarms[0][1].t < 0.5


def test_live_tables_follow_the_log(folder, monkeypatch):
    found = aw.shadow.shadow_log(aw.identification.read_log(folder / "heavy.log.toml"), folder / "two-link.toml")
    pauses = []
    monkeypatch.setattr(shadow_live.time, "sleep", pauses.append)
    shown = command(folder / "two-link.toml", folder / "heavy.log.toml", "--live", code=1)
    assert len(pauses) == 20  # ten tables a second
    assert "kg at the tip explains" in shown
    (run,) = found.runs
    rows = run.residuals
    last = shadow_live.frame(
        found.arm, "run1", 2.0, rows.torque[-1], found.limits, rows.position[-1], found.largest(), []
    )
    assert "no alarm" in str(last.title)


REFUSED = [
    (("none.log.toml",), "none.log.toml"),
    (("{}/log.log.toml",), "ROBOT: missing; expected a robot's file, here or in the log"),
    (("puma560", "{}/log.log.toml"), "joints: the log has 2 ('shoulder', 'elbow'), puma560 has 6"),
    (("two-link", "{}/log.log.toml", "--run", "fast"), "--run = 'fast'"),
    (("two-link", "{}/log.log.toml", "--deviation", "a,b"), "--deviation = 'a,b': expected numbers"),
    (("two-link", "{}/log.log.toml", "--deviation", "0"), "--deviation = 0.0: expected a torque above 0"),
    (("two-link", "{}/log.log.toml", "--deviation", "1,2,3"), "expected a torque above 0, or 2 of them"),
    (("two-link", "{}/log.log.toml", "--factor", "-1"), "--factor = -1.0: expected a number above 0"),
    (("two-link", "{}/log.log.toml", "--report", "x.pdf"), "the ending '.pdf' is not offered"),
    (("two-link", "{}/log.log.toml", "--nodes", "3,4"), "--nodes: does not go with it; expected a bus"),
    (("socketcan:can0", "--report", "x.html"), "--report: does not go with it; expected a log"),
    (("socketcan:can0",), "ROBOT: missing; expected the arm whose drives are on the bus"),
    (("lwa4p", "socketcan:none0"), "cannot be opened"),
    (("lwa4p", "socketcan:can0", "--nodes", "a"), "--nodes = 'a': expected whole numbers"),
    (("lwa4p", "virtual:nobody", "--duration", "0.1"), "no frames were received"),
    (("lwa4p", "virtual:nobody", "--period", "0"), "--period = 0.0: expected a time above 0"),
    (("two-link", "{}/voltages.log.toml"), "no torques or currents of all joints"),
]


@pytest.mark.parametrize(("arguments", "expected"), REFUSED)
def test_refusals_are_one_line(folder, arguments, expected):
    text = (folder / "log.log.toml").read_text()
    at = text.rindex("[[signals]]")
    (folder / "voltages.log.toml").write_text(text[:at])
    shown = command(*(each.format(folder) for each in arguments), code=2).strip()
    assert expected in shown
    assert "\n" not in shown


def test_currents_are_torques_of_their_motors(tmp_path):
    arm = aw.load("cmu-dd")
    rows = motion(arm.n, 1.0, RATE, seed=3)
    tau = aw.compile(arm).inverse_dynamics(*rows[1:])
    kt = np.array([body.drive.gear_ratio * body.drive.torque_constant for body in arm.coordinates])
    path = log_file(tmp_path, arm, rows, 0.0)
    table = np.loadtxt(tmp_path / "log.csv", delimiter=",", skiprows=1)
    table[:, 1 + arm.n :] = tau / kt
    heads = (tmp_path / "log.csv").read_text().splitlines()[0]
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=heads, comments="", fmt="%.10g")
    text = path.read_text()
    at = text.rindex("[[signals]]")
    signal = text[at:].replace('"torque"', '"current"').replace('"N m"', '"A"').replace('side = "joint"\n', "")
    path.write_text(text[:at] + signal)
    found = aw.shadow.shadow_log(aw.identification.read_log(path), arm, deviation=0.5)
    assert not found.alarms
    assert (found.largest() < 0.05 * np.abs(tau).max(axis=0)).all()

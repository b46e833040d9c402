"""Runs held out of a fit are simulated with its numbers; the page shows them; what would tell more is named."""

from __future__ import annotations

from pathlib import Path

import pytest

import armwright as aw
from armwright.identification.motor.page import plots
from identification.motor_truth import PATHS, TRUE, write_log

RUN = '[[runs]]\nname = "r{k}"\nfiles.log = "run{k}.csv"\nuse = "{use}"\n'


def two_runs(folder: Path, rows: int = 800, **changes: float) -> Path:
    """Path of a log whose second run is held out, of a motor with some numbers changed."""
    for k, each in enumerate(({}, changes)):
        write_log(folder, k, ("current", "qd"), rows=rows, name=f"run{k}", **each)
    text = (folder / "run0.log.toml").read_text()
    runs = "".join(RUN.format(k=k, use=use) for k, use in enumerate(("fit", "hold-out")))
    path = folder / "both.log.toml"
    path.write_text(text.replace('path = "run0.csv"', "").replace("[time]", f"{runs}[time]"))
    return path


def test_a_held_out_run_is_predicted_as_well_as_the_fitted(tmp_path):
    found = aw.identify_motor(two_runs(tmp_path), starts=2)
    fitted, fresh = (found.estimate.fit[f"{run}: qd"]["fit_percent"] for run in ("r0", "r1 (held out)"))
    assert fresh == pytest.approx(fitted, abs=1.0)
    assert fitted > 96.0, "1 % of noise of the largest speed is left"
    assert set(found.predictions) == {"r0", "r1"}
    assert "worse" not in str(found.estimate)
    (_, first), (heading, second) = plots(found)
    assert heading == "Run r1, held out"
    assert first.count("<svg") == second.count("<svg") == 2, "speed and current"


def test_a_held_out_run_of_another_motor_is_told(tmp_path):
    path = two_runs(tmp_path, coulomb=0.06)
    before = aw.identify_motor(path, starts=2)
    assert "r1 (held out): qd is described worse than what was fitted" in str(before.estimate)
    other = aw.identify_motor(two_runs(tmp_path, R=6.0, coulomb=0.05), starts=2).estimate
    assert other.verdict == "not identified"
    assert "does not describe a run that it has not seen" in str(other)


def test_the_experiment_that_would_tell_is_named(tmp_path):
    log = write_log(tmp_path, 0, ("qd",), rows=800)
    found = aw.identify_motor(log, fixed={"viscous": TRUE["viscous"]}, starts=2).estimate
    assert not found.identifiable[found.number(PATHS["R"])]
    (sentence,) = (each for each in found.remarks if "the resistance is held" in each)
    assert "; a locked-rotor test with current would " in sentence

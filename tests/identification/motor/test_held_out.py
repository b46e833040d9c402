"""Runs held out of a fit are simulated with its numbers; the page shows them; what would tell more is named."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.identification import MotorSearch
from armwright.identification.motor.predictions import MARK
from armwright.identification.motor.report import plots
from identification.motor_truth import PATHS, TRUE, true_record, write_log

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
    found = aw.identification.identify_motor(two_runs(tmp_path), search=MotorSearch(starts=2))
    fitted, fresh = (found.estimate.fit[f"{run}: qd"]["fit_percent"] for run in ("r0", f"r1{MARK}"))
    assert fresh == pytest.approx(fitted, abs=1.0)
    assert fitted > 96.0, "1 % of noise of the largest speed is left"
    assert set(found.predictions) == {"r0", "r1"}
    assert "worse" not in str(found.estimate)
    (_, first), (heading, second) = plots(found)
    assert heading == "Run r1, held out"
    assert first.count("<svg") == second.count("<svg") == 2, "speed and current"


def test_a_held_out_run_of_another_motor_is_told(tmp_path):
    path = two_runs(tmp_path, coulomb=0.06)
    before = aw.identification.identify_motor(path, search=MotorSearch(starts=2))
    assert f"r1{MARK}: qd is described worse than what was fitted" in str(before.estimate)
    other = aw.identification.identify_motor(
        two_runs(tmp_path, R=6.0, coulomb=0.05), search=MotorSearch(starts=2)
    ).estimate
    assert other.verdict == "not identified"
    assert "does not describe a run that it has not seen" in str(other)


def test_the_experiment_that_would_tell_is_named(tmp_path):
    log = write_log(tmp_path, 0, ("qd",), rows=800)
    found = aw.identification.identify_motor(
        log, fixed={"viscous": TRUE["viscous"]}, search=MotorSearch(starts=2)
    ).estimate
    assert not found.identifiable[found.number(PATHS["R"])]
    (sentence,) = (each for each in found.remarks if "the resistance is held" in each)
    assert "; a locked-rotor test with current would " in sentence


@pytest.mark.study
@pytest.mark.parametrize("load", [None, 0.0], ids=["robot", "motor taken off"])
def test_the_written_record_is_judged_with_the_numbers_of_validate(tmp_path, load):
    """Bit by bit, both records; the old one is the truth, so that the fit is no more than its noise behind it."""
    log, record = two_runs(tmp_path), true_record(tmp_path)
    found = aw.identification.identify_motor(log, record, load=load, search=MotorSearch(starts=2))
    assert found.hold_out is not None
    written = found.write(tmp_path / "written.toml")
    for path, of in ((written, "written"), (record, "before")):
        validation = aw.identification.validate(path, log)
        assert {check.quantity for check in validation.checks} == {each.quantity for each in found.hold_out.rows}
        for each in found.hold_out.rows:
            assert getattr(each, of) == validation.of(each.quantity, "motor").overall
    own = found.estimate.fit["speed of motor (held out)"]
    assert own["r2"] == next(each.written.r2 for each in found.hold_out.rows if each.quantity == "speed")
    assert found.estimate.verdict == "identified"


@pytest.mark.study
def test_a_record_worse_than_the_one_that_it_replaces_is_not_identified(tmp_path):
    """A friction that was said to be known, and is not."""
    log, record, output = two_runs(tmp_path), true_record(tmp_path), tmp_path / "written.toml"
    wrong = ["--fix", "coulomb=0.05", "--fix", "viscous=0.002"]
    for more, code in (([], 0), (wrong, 1)):
        options = ["--starts", "2", "-o", str(output), "--report", str(tmp_path / "page.html")]
        result = CliRunner().invoke(app, ["identify", "motor", str(record), str(log), *options, *more])
        assert result.exit_code == code, result.output
        assert ("worse than the record that it replaces" in " ".join(result.output.split())) == bool(code)
        assert aw.load(output).record.fits["fit"].verdict == ("not identified" if code else "identified")


@pytest.mark.study
def test_a_bench_motor_has_nothing_to_be_compared_with(tmp_path):
    found = aw.identification.identify_motor(two_runs(tmp_path), search=MotorSearch(starts=2))
    assert found.hold_out is not None
    assert found.hold_out.before is None
    assert "no record came in" in str(found.estimate)
    alone = aw.identification.identify_motor(write_log(tmp_path, 0, ("qd",), rows=400), search=MotorSearch(starts=2))
    assert alone.hold_out is None
    assert "no run is held out" in str(alone.estimate)

"""`armwright validate`: exit codes, files, one line for what cannot be."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from identification.validation.made_logs import driven, motor_file, random_steps, written_log


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("validate")
    record = motor_file(folder)
    table = driven(aw.load(record), random_steps(600, 60, [6.0], 0), 4e-3, ("speed", "voltage"), 0.005)
    return record, written_log(folder, ["motor"], {"fit": table, "held": table})


def run(*arguments) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["validate", *map(str, arguments)])
    return result.exit_code, result.output


def test_a_record_that_passes(made):
    record, log = made
    code, text = run(record, log, "--report", record.with_name("report.html"))
    assert code == 0, text
    assert "passes" in text
    assert record.with_name("motor.verdict.toml").is_file()
    assert record.with_name("report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_limits_without_a_limit_are_refused(made):
    record, log = made
    limits = record.with_name("empty.toml")
    limits.write_text("[torque]\n")
    code, text = run(record, log, "--limits", limits)
    assert code == 2
    assert "the file has no limit" in text


def test_a_record_that_fails_its_limits(made):
    record, log = made
    limits = record.with_name("limits.toml")
    limits.write_text("speed.fit_at_least = 99.9\n")
    code, text = run(record, log, "--limits", limits, "--run", "fit")
    assert code == 1
    assert "FAILS" in text
    stored = aw.identification.stored_verdict(record)
    assert stored is not None
    assert not stored.passed


def test_input_that_cannot_be(made, tmp_path):
    record, log = made
    for arguments, words in (
        (["two-link", log], "the log has 1"),
        ([record.with_name("none.toml"), log], "none.toml"),
        ([record, log.with_name("none.log.toml")], "none.log.toml"),
        ([record, log, "--report", tmp_path / "report.pdf"], ".html"),
        ([record, log, "--window", "0"], "--window = 0"),
        ([record, log, "--run", "none"], "no such run"),
    ):
        code, text = run(*arguments)
        assert code == 2, text
        assert words in text
        assert "Traceback" not in text
    assert list(tmp_path.iterdir()) == []

"""A verdict belongs to one state of one record."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import LogError
from armwright.identification.validation.validate import Validation, record_sha256, validate
from armwright.identification.validation.verdict import stored_verdict, verdict_path, write_verdict
from identification.validation.made_logs import driven, motor_file, random_steps, written_log
from raises_at import raises_at


@pytest.fixture
def found(tmp_path) -> Validation:
    record = motor_file(tmp_path)
    arm = aw.load(record)
    table = driven(arm, random_steps(600, 60, [6.0], 0), 4e-3, ("speed", "voltage"), 0.005)
    return validate(record, written_log(tmp_path, ["motor"], {"fit": table, "held": table}))


def test_a_passing_verdict_is_found_again(found):
    path = write_verdict(found)
    assert path == found.record.with_name("motor.verdict.toml")
    stored = stored_verdict(found.record)
    assert stored is not None
    assert stored.passed
    assert stored.table.log_sha256 == found.log.sha256
    assert stored.table.runs == ("held",)
    assert stored.table.limits == {
        "torque": {"r2_at_least": 0.9},
        "position": {"fit_at_least": 70.0},
        "speed": {"fit_at_least": 70.0},
    }
    assert stored.table.measures["motor"]["speed"]["fit"] == pytest.approx(
        found.of("speed", "motor").overall.fit, rel=1e-5
    )


def test_it_does_not_belong_to_a_record_that_has_changed(found):
    write_verdict(found)
    found.record.write_text(found.record.read_text().replace("gear_ratio = 10", "gear_ratio = 11"))
    stored = stored_verdict(found.record)
    assert stored is not None
    assert (stored.table.passed, stored.belongs, stored.passed) == (True, False, False)
    assert "has changed since" in str(stored)


def test_a_failing_verdict_does_not_pass(found):
    failed = validate(found.record, found.log, limits={"speed": {"rms_at_most_rad_per_s": 1e-9}})
    write_verdict(failed)
    stored = stored_verdict(found.record)
    assert stored is not None
    assert (stored.belongs, stored.passed) == (True, False)


def test_no_verdict_and_damaged_ones(found):
    assert stored_verdict(found.record) is None
    path = verdict_path(found.record)
    path.write_text("passed = true\n")
    with pytest.raises(LogError, match="missing"):
        stored_verdict(found.record)
    path.write_text("passed = ")
    with pytest.raises(LogError, match="not TOML"):
        stored_verdict(found.record)
    with raises_at(LogError, file=found.record.with_name("other.toml")):
        stored_verdict(found.record.with_name("other.toml"))


def test_arms_without_a_file_have_none(found):
    arm = aw.load(found.record)
    with pytest.raises(LogError, match="no file"):
        write_verdict(validate(arm, found.log))
    given = validate(arm, found.log, record=found.record)
    assert given.record_sha256 == record_sha256(found.record)
    assert np.isfinite(given.of("speed", "motor").overall.fit)

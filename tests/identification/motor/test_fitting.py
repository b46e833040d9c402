"""The search for numbers of motors: it begins at the record's own too, and does not leave them for worse ones."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import armwright as aw
from armwright.identification import MotorSearch
from armwright.identification.motor import fitting
from armwright.identification.motor.unknowns import Unknown
from identification.motor_truth import PATHS, TRUE, true_record, write_log


def test_a_search_that_goes_astray_is_no_worse_than_the_record(tmp_path, monkeypatch):
    """Starts that all end far away, by what they are compared on, do not count where the record is nearer to all rows."""
    search = fitting.many_starts

    def astray(problem, z, *more):
        found, cost = search(problem, z, *more)
        if all(each.nuisance for each in problem.unknowns):
            return found, cost
        return 0.0 * found + problem.bounds[0], 0.0 * cost

    monkeypatch.setattr(fitting, "many_starts", astray)
    log = write_log(tmp_path, 0, rows=800)
    fit = aw.identification.identify_motor(log, true_record(tmp_path), search=MotorSearch(starts=1))
    for name, value in TRUE.items():
        assert fit.estimate[PATHS[name]] == pytest.approx(value, rel=0.02, abs=1e-5), name


@pytest.mark.parametrize(("samples", "zero"), [(0.0, [0]), (8e-6, [0]), (1e-3, [])])
def test_a_delay_of_next_to_nothing_is_none(samples, zero):
    delay = Unknown("delay", 0.5, 0.0, 11.0, 1.0, nuisance=True, label="delay")
    problem = SimpleNamespace(unknowns=(delay,), bounds=(np.array([0.0]), np.array([11.0])))
    done = fitting.Fitted(problem, np.array([samples]), [])
    fitting._hold_at_zero(done, None)
    assert done.zero == zero

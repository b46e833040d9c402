"""Statistics over lanes against NumPy, and lanes that are left out."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import RunError
from simulation.runs import invented


@pytest.fixture
def run():
    return invented(aw.load("two-link"), lanes=40)


def test_they_are_what_numpy_says(run):
    found = aw.statistics(run, percentiles=(10, 50))
    assert list(found.statistic.values) == ["mean", "std", "min", "max", "p10", "p50"]
    q = run.q.values
    assert found.q.dims == ("statistic", "time", "joint")
    np.testing.assert_allclose(found.q.sel(statistic="mean").values, q.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.q.sel(statistic="std").values, q.std(axis=0, ddof=1), rtol=1e-12)
    np.testing.assert_allclose(found.q.sel(statistic="p10").values, np.percentile(q, 10, axis=0), rtol=1e-12)
    assert found.q.attrs["units"] == run.q.attrs["units"]
    assert found.attrs["lanes"] == 40


def test_lanes_that_diverged_are_left_out(run):
    stopped = np.full(40, np.nan)
    stopped[7] = 0.5
    run["diverged_at"] = ("lane", stopped)
    run["q"][7] = 1e30
    found = aw.statistics(run)
    assert (found.attrs["lanes"], found.attrs["lanes_left_out"]) == (39, 1)
    np.testing.assert_allclose(
        found.q.sel(statistic="max").values, np.delete(run.q.values, 7, axis=0).max(axis=0), rtol=1e-15
    )


def test_unknown_numbers_stay_unknown(run):
    run["tau"][:, :, 1] = np.nan
    found = aw.statistics(run)
    assert np.isnan(found.tau.values[..., 1]).all()
    assert np.isfinite(found.tau.values[..., 0]).all()


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda run: aw.statistics(run.isel(lane=0)), "of many lanes"),
        (lambda run: aw.statistics(3), "run = 3"),
        (lambda run: aw.statistics(run, [120]), "0 to 100"),
        (lambda run: aw.statistics(run.assign(diverged_at=("lane", np.zeros(40)))), "of the 40 lanes"),
    ],
)
def test_what_has_none_is_refused(run, make, said):
    with pytest.raises(RunError, match=said):
        make(run)

"""What must not change unnoticed: operations of every kernel of arms of all forms, and bits of reference runs.

A change that is meant freezes anew with `make frozen ARGS=--write`, and its commit says what moved and why.
"""

from __future__ import annotations

import pytest

import armwright as aw
from frozen.programs import kernel_digests
from frozen.records import differences, frozen, run_digests
from frozen.runs import RUNS
from physics.arms import FORMS


@pytest.mark.parametrize("name", FORMS)
def test_kernels_do_the_same_operations(name):
    assert differences(frozen()["programs"][name], kernel_digests(aw.load(name))) == []


@pytest.mark.parametrize("name", RUNS)
def test_reference_runs_have_the_same_bits(name):
    assert differences(frozen()["runs"][name], run_digests(name)) == []


def test_everything_that_is_frozen_is_compared():
    kept = frozen()
    assert set(kept["programs"]) == set(FORMS)
    assert set(kept["runs"]) == set(RUNS)
    assert len(RUNS) >= 60

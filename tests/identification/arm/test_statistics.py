"""Errors of base parameters have the covariance that the fit states; the whole study is tools/arm_seeds.py."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from scipy.stats import chi2

PATH = Path(__file__).resolve().parents[3] / "tools" / "arm_seeds.py"


@pytest.mark.study
def test_errors_have_the_stated_covariance():
    """6 seeds of LWA 4P, short, with slow noise: few enough to be quick, enough to find a covariance that is wrong by a third."""
    spec = importlib.util.spec_from_file_location("arm_seeds", PATH)
    assert spec is not None
    assert spec.loader is not None
    arm_seeds = importlib.util.module_from_spec(spec)
    import sys

    sys.modules["arm_seeds"] = arm_seeds
    try:
        spec.loader.exec_module(arm_seeds)
        count, results = arm_seeds.study("lwa4p", range(6), 60.0, 0.8)
    finally:
        del sys.modules["arm_seeds"]
    assert count == 36
    low, high = chi2.ppf([0.0005, 0.9995], 6 * 36)
    assert low < sum(each.chi2 for each in results) < high
    assert all(each.r2 > 0.99 for each in results)

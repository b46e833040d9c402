"""The problem of speeds that stick, over random and adversarial states."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]


def tool():
    """tools/sticking_states.py."""
    spec = importlib.util.spec_from_file_location("sticking_states", ROOT / "tools" / "sticking_states.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


STATES = tool()


@pytest.mark.study
@pytest.mark.parametrize("name", list(STATES.FAMILIES)[:5])
def test_random_and_adversarial_states(name):
    """Few solves, nothing wrong that is not marked, the speeds of another method, and energy that never rises."""
    family = STATES.FAMILIES[name]
    probe = STATES.probed(family, 2000, checked=40)
    assert probe.failures == 0
    assert probe.unmarked == 0
    assert np.flatnonzero(probe.solves)[-1] <= STATES.MOST
    assert probe.solves[: 12 + 1].sum() >= 0.999 * probe.solves.sum()
    assert probe.unbalanced < 1e-6
    assert probe.difference < 1e-3  # of ill-conditioned ones, whose other method is the worse
    assert probe.risen < 1e-7

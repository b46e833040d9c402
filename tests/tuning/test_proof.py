"""Tuned gains of a modular arm on its bus against designed ones and a textbook's, in lanes of a seed that nobody tuned with."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

import armwright as aw

pytest.importorskip("cma", reason="cma is not installed: pip install armwright[control]")
pytest.importorskip("control", reason="python-control is not installed: pip install armwright[control]")

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
from tuning_proof import (  # pyright: ignore[reportMissingImports]
    DRAWS,
    OBJECTIVES,
    judged,
    scenario,
    textbook,
)


def test_tuned_gains_beat_the_designed_start_and_a_textbook_cascade_on_every_objective():
    result = aw.tune(
        scenario(), {"position_kp": 6.0, "speed_kp": 4.0, "speed_ki": 8.0}, start="pole-placement", draws=DRAWS,
        objectives=OBJECTIVES, improve_each=True, lanes=12, generations=8, poses=200,
    )  # fmt: skip
    assert result.improved
    start = replace(result.scenario.controller, **result.start)
    laws = {"textbook": textbook(), "designed": start, "tuned": result.scenario.controller}
    table = judged(laws, lanes=30, seed=1)
    for name in ("rms error [mrad]", "peak error [mrad]", "noise gain [A/rad]"):
        assert table["tuned"][name] < table["designed"][name], name
        assert table["tuned"][name] < table["textbook"][name], name
    assert table["tuned"]["keeps the margins"] > 0.9  # at poses of another number than those it was tuned with

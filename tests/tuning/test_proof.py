"""Tuned gains of a modular arm on its bus against designed ones and two cascades by hand, in lanes that nobody tuned with."""

import sys
from dataclasses import replace
from pathlib import Path

import armwright as aw

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
from tuning_proof import BY_HAND, judged, scenario, textbook  # pyright: ignore[reportMissingImports]

TUNED = aw.Cascade(  # what `python tools/tuning_proof.py` finds in 60 generations
    position_kp=[30.62, 40.64, 19.65, 38.06, 44.75, 27.19],
    speed_kp=[11.58, 11.38, 13.92, 10.47, 0.896, 1.234],
    speed_ki=[12.47, 11.93, 222.5, 83.44, 2.938, 33.9],
    speed_feedforward=1.0,
)


def test_one_tuning_beats_the_designed_start_and_both_cascades_by_hand_on_every_objective():
    design = aw.design_gains(scenario(), "pole-placement", poses=300)
    laws = {"textbook": textbook(), "by hand": BY_HAND, "designed": replace(BY_HAND, **design.gains), "tuned": TUNED}
    table = judged(laws, lanes=60, seed=2)
    for name in ("rms error [mrad]", "peak error [mrad]", "noise gain [A/rad]"):
        for other in ("textbook", "by hand", "designed"):
            assert table["tuned"][name] < table[other][name], (name, other)
    assert table["tuned"]["keeps the margins"] == 1.0
    assert table["designed"]["keeps the margins"] > 0.9  # designed at other poses
    assert table["textbook"]["keeps the margins"] < 0.1

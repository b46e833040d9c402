"""The census of a run is the same however its rows are cut into blocks."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.identification.logs.blocks import run_blocks
from armwright.identification.logs.census import census_of, longest
from armwright.identification.logs.log import Log
from identification.logs.example_logs import ALL, columns, written

COUNTED = (
    "rows",
    "first",
    "last",
    "period",
    "gaps",
    "lost",
    "widest",
    "same_time",
    "backwards",
    "no_time",
    "stretches",
)
STRETCHES = [(0, 300, 2), (300, 511, 2), (512, 900, 2), (900, 901, 1), (901, 1000, 1)]  # first row, end, pieces


@pytest.fixture
def log(tmp_path):
    """A log with gaps, empty cells, rows at the same time and one that goes back, near the edges of blocks too."""
    table = columns(2.0)
    t = table["t"]
    t[300:] += 0.04
    t[512:] += 0.1
    t[700] = t[699]
    t[900] -= 0.01
    for name, rows in {"q1": [63, 64, 65], "v2": [400], "m1": [511, 1000]}.items():
        table[name][rows] = np.nan
    return aw.identification.read_log(written(tmp_path, ALL, {"arm.csv": table}), on_error="keep")


def test_events_are_counted_with_their_rows(log):
    census = log.runs[0].census
    assert census.rows == 1001
    assert census.gaps.rows == (300, 512, 701, 901)  # behind a row that is late or goes back there is a gap as well
    assert census.lost == 20 + 50 + 1 + 5
    assert (census.same_time.rows, census.backwards.rows) == ((700,), (900,))
    assert census.signals["q"].missing[0].rows == (63, 64, 65)
    # missing cells and a lost row are bridged; two pauses and time that goes back are not
    assert [(each.begin, each.end, each.pieces) for each in census.stretches] == STRETCHES
    assert all(a.end <= b.begin for a, b in zip(census.stretches, census.stretches[1:], strict=False))


@pytest.mark.parametrize("rows", [64, 100, 512])
def test_blocks_do_not_matter(log, monkeypatch, rows):
    whole = census_of(log, log.runs[0])
    monkeypatch.setattr(Log, "blocks", lambda self, run=None: run_blocks(self, self.run(run), rows))
    parts = census_of(log, log.runs[0])
    for name in COUNTED:
        assert getattr(parts, name) == getattr(whole, name), name
    assert parts.jitter == pytest.approx(whole.jitter, rel=1e-9, abs=1e-15)
    for name, signal in whole.signals.items():
        assert parts.signals[name].missing == signal.missing
        assert np.array_equal(parts.signals[name].low, signal.low)
        assert np.array_equal(parts.signals[name].high, signal.high)


@pytest.mark.parametrize(("happens", "length"), [([], 0), ([0, 0], 0), ([1, 1, 0, 1], 2), ([0, 1, 1, 1], 3), ([1], 1)])
def test_the_longest_run(happens, length):
    assert longest(np.array(happens, dtype=bool)) == length

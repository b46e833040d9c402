"""Logs of real machines are read as their authors describe them."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from identification.real_logs import DATA, DC_MOTOR, LWA_4P, TX40, log_of


def test_dc_motor(tmp_path):
    log = aw.identification.read_log(log_of(tmp_path, "dc_motor", DC_MOTOR))
    assert (log.fit, log.hold_out) == (("prbs",), ("step",))
    assert [run.rows for run in log.runs] == [4093, 502]
    assert [1 / run.period for run in log.runs] == pytest.approx([50.0, 50.0])
    (note,) = log.notes  # one count in 20 ms, 2800 in a turn
    assert f"quantised in steps of {2 * np.pi / 2800 / 0.02:.4g} rad/s" in str(note)
    assert log.dataset("prbs")["qd"].values.max() == pytest.approx(3.8148, abs=1e-4)


def test_staubli_tx40(tmp_path):
    log = aw.identification.read_log(log_of(tmp_path, "staubli_tx40", TX40))
    assert log.notes == ()
    data = aw.identification.prepare_log(
        log, preparation=aw.identification.choose_preparation(log, cutoff=100.0, decimate=20)
    )
    assert np.abs(data["qd"]).max("time").values == pytest.approx([5.0, 5.0, 7.0, 7.2, 5.6, 11.6], rel=0.02)
    assert np.abs(data["q"].values[0] - [0, -np.pi / 2 + 50.265 / 32, np.pi / 2 - 70.685 / 45, 0, 0, 0]).max() < 0.01
    raw = log.dataset()
    rms = np.sqrt((raw["tau"] ** 2).mean("time")).values
    assert rms == pytest.approx([31.0, 32.4, 12.0, 5.7, 8.2, 5.0], rel=0.05)
    choice = aw.identification.choose_preparation(log)
    assert 40.0 < choice.cutoff < 160.0  # others chose 100 Hz by hand


def test_schunk_lwa_4p(tmp_path):
    folders = sorted(each.as_posix() for each in (DATA / "schunk_lwa4p").glob("measurement_*"))
    log = aw.identification.read_log(log_of(tmp_path, "schunk_lwa4p", LWA_4P, fit=folders[:8], held=folders[8:11]))
    assert len(log.fit) == 8
    assert len(log.hold_out) == 3
    assert all(run.rows in (233, 467, 702, 936, 1087) for run in log.runs)  # inputs have one row fewer
    assert not log.errors
    data = log.dataset(log.fit[0])
    assert np.diff(data["time"]).max() == pytest.approx(0.004)

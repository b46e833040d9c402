"""The DC motor's PRBS log, as others fitted it: ../shared/data/dc_motor/SOURCE.md."""

from __future__ import annotations

import pytest

import armwright as aw
from identification.real_logs import DC_MOTOR, log_of


def test_dc_motor(tmp_path):
    log = aw.identification.read_log(log_of(tmp_path, "dc_motor", DC_MOTOR))
    first = aw.identification.fit_oe(log, order=1, delay=1)
    fits = {"oe": first.fit["prbs (fit): qd"]["fit_percent"]}
    assert fits["oe"] == pytest.approx(80.0, abs=0.05)  # of a linear model with offset and initial state
    per_degree = 57.29577951308232
    assert first.gain[0, 0] * per_degree == pytest.approx(1703.6, abs=2.0)
    assert first["time_constant1"] == pytest.approx(0.470, abs=0.002)
    assert any("coloured" in remark for remark in first.remarks)
    for name, fit in (
        ("arx", aw.identification.fit_arx),
        ("armax", aw.identification.fit_armax),
        ("n4sid", aw.identification.fit_n4sid),
    ):
        fits[name] = fit(log, order=2 if name != "arx" else 5, delay=1).fit["prbs (fit): qd"]["fit_percent"]
    assert min(fits.values()) > 80.0
    response = aw.identification.frequency_response(log)
    slow = response.frequency < 2.0
    assert abs(response.response[slow]) == pytest.approx(abs(first.response(response.frequency[slow])), rel=0.25)

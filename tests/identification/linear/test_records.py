"""Data that no model can be fitted to are refused in words; logs and arrays give the same fit."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from scipy.signal import lfilter

import armwright as aw
from armwright.errors import ArmwrightError
from armwright.identification import LogSignals, OrderSearch
from armwright.results.csv_tables import write_table

HEAD = """
joints = ["motor"]
[files.log]
[time]
column = "t"
unit = "s"
[[signals]]
quantity = "voltage"
columns = "u"
unit = "V"
[[signals]]
quantity = "speed"
columns = "y"
unit = "rad/s"
side = "joint"
"""


def data(seed=0, rows=600, period=0.01):
    draw = np.random.default_rng(seed)
    u = np.repeat(draw.choice([-1.0, 1.0], rows // 3), 3)
    return period * np.arange(rows), u, lfilter([0.0, 0.2], [1.0, -0.9], u) + 0.01 * draw.standard_normal(rows)


def log_file(folder, runs):
    text = HEAD
    for name, (use, (t, u, y)) in runs.items():
        write_table(folder / f"{name}.csv", {"t": t, "u": u, "y": y})
        text += f'[[runs]]\nname = "{name}"\nfiles.log = "{name}.csv"\nuse = "{use}"\n'
    path = folder / "motor.log.toml"
    path.write_text(text)
    return path


def test_a_log_is_fitted_by_its_runs_and_judged_by_the_others(tmp_path):
    runs = {"a": ("fit", data(0)), "b": ("fit", data(1)), "c": ("hold-out", data(2))}
    log = aw.identification.read_log(log_file(tmp_path, runs))
    model = aw.identification.fit_oe(log, order=1, delay=1)
    arrays = aw.identification.fit_oe([data(0)[1], data(1)[1]], [data(0)[2], data(1)[2]], 0.01, order=1, delay=1)
    assert model.values == pytest.approx(arrays.values, rel=1e-9)
    assert list(model.fit) == ["a (fit): qd", "b (fit): qd", "c (hold-out): qd"]
    assert model.fit["c (hold-out): qd"]["fit_percent"] > 95.0
    assert model.quantities[0].unit == "rad/s / V"
    estimate = model.estimate()
    assert estimate.sha256 == log.sha256
    assert estimate["time_constant1"] == pytest.approx(-0.01 / np.log(0.9), rel=0.02)
    assert "free simulation" in str(model)
    assert aw.identification.fit_n4sid(log, order=1).gain[0, 0] == pytest.approx(2.0, rel=0.02)
    assert aw.identification.frequency_response(log).units == ("rad/s", "V")


def test_short_logs_take_an_information_criterion():
    _, u, y = data()
    model = aw.identification.fit_oe(u[:200], y[:200], 0.01, search=OrderSearch("bic", 2, 5))
    assert model.gain[0, 0] == pytest.approx(2.0, rel=0.05)
    assert aw.identification.fit_oe(u[:60], y[:60], 0.01, order=1, delay=1).gain[0, 0] == pytest.approx(2.0, rel=0.1)


def test_joints_of_a_log_are_inputs_and_outputs(tmp_path):
    (t, u1, y1), (_, u2, y2) = data(0), data(1)
    write_table(tmp_path / "a.csv", {"t": t, "u1": u1, "u2": u2, "y1": y1 + 0.5 * y2, "y2": y2})
    text = HEAD.replace('["motor"]', '["one", "two"]').replace('"u"', '["u1", "u2"]').replace('"y"', '["y1", "y2"]')
    (tmp_path / "two.log.toml").write_text(text + '[[runs]]\nfiles.log = "a.csv"\n')
    model = aw.identification.fit_n4sid(
        aw.identification.read_log(tmp_path / "two.log.toml"), order=2, signals=LogSignals(joint=["one", "two"])
    )
    assert model.inputs == ("voltage/one", "voltage/two")
    assert model.gain == pytest.approx(np.array([[2.0, 1.0], [0.0, 2.0]]), abs=0.06)


def test_gaps_split_a_run(tmp_path):
    t, u, y = data()
    keep = np.r_[0:200, 260:600]
    model = aw.identification.fit_oe(
        aw.identification.read_log(log_file(tmp_path, {"a": ("fit", (t[keep], u[keep], y[keep]))})), order=1, delay=1
    )
    assert any("gaps" in remark for remark in model.remarks)
    assert model.gain[0, 0] == pytest.approx(2.0, rel=0.02)


def test_two_clocks(tmp_path):
    log = aw.identification.read_log(log_file(tmp_path, {"a": ("fit", data()), "b": ("fit", data(1, period=0.02))}))
    with pytest.raises(ArmwrightError, match="two clocks"):
        aw.identification.fit_oe(log)


T, U, Y = data()
BAD = {
    "not a number": ((U, np.where(np.arange(600) == 7, np.nan, Y), 0.01), {}, "y[7]"),
    "constant input": ((np.full(600, 2.0), Y, 0.01), {}, "u"),
    "constant output": ((U, np.full(600, 2.0), 0.01), {}, "y"),
    "too few rows": ((U[:40], Y[:40], 0.01), {"order": 5}, "order"),
    "too few rows to hold out": ((U[:150], Y[:150], 0.01), {}, "select"),
    "short runs": (
        ([U[k : k + 20] for k in range(0, 600, 20)], [Y[k : k + 20] for k in range(0, 600, 20)], 0.01),
        {},
        "order",
    ),
    "rows differ": ((U, Y[:-1], 0.01), {}, "run"),
    "runs differ": (([U, U], [Y], 0.01), {}, "y"),
    "gap": ((U, Y, np.where(T > 3, T + 1, T)), {}, "period"),
    "no period": ((U, Y), {}, "period"),
    "period": ((U, Y, -1.0), {}, "period"),
    "text": ((["a", "b"], Y, 0.01), {}, "u"),
    "absurd": ((U, Y * 1e200, 0.01), {}, "y"),
    "complex": ((U * 1j, Y, 0.01), {}, "u"),
    "empty": (([], [], 0.01), {}, "u"),
    "order": ((U, Y, 0.01), {"order": 0}, "order"),
    "orders": ((U, Y, 0.01), {"order": (1, 2, 3, 4)}, "order"),
    "delay": ((U, Y, 0.01), {"delay": -1}, "delay"),
    "a log's word": ((U, Y, 0.01), {"signals": LogSignals("voltage")}, "input"),
    "no signals": ((U, Y, 0.01), {"signals": "voltage"}, "signals"),
    "two inputs": ((np.stack([U, U[::-1]], 1), Y, 0.01), {}, "data"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case):
    arguments, options, place = BAD[case]
    with pytest.raises(ArmwrightError) as caught:
        aw.identification.fit_oe(*arguments, **options)
    assert caught.value.place == place
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("options", [{"select": "best"}, {"most_order": 0}, {"most_delay": -1}])
def test_a_search_that_cannot_be_is_refused(options):
    with pytest.raises(ArmwrightError) as caught:
        OrderSearch(**options)
    assert caught.value.place == next(iter(options))


ODD = {
    "output is input": U,
    "no noise": lfilter([0.0, 0.2], [1.0, -0.9], U),
    "an outlier": Y + 1e6 * (np.arange(600) == 200),
    "quantised": np.round(Y),
    "two integrators": 1e-3 * np.cumsum(np.cumsum(U)),
    "tiny": 1e-25 * Y,
}


@pytest.mark.parametrize("case", ODD)
def test_odd_data_end_in_a_model_or_in_words(case):
    for fit in (
        aw.identification.fit_arx,
        aw.identification.fit_oe,
        aw.identification.fit_armax,
        aw.identification.fit_n4sid,
    ):
        with contextlib.suppress(ArmwrightError):
            model = fit(U, ODD[case], 0.01, order=2, delay=1)
            assert np.isfinite(model.simulate(U)).all()
            assert str(model).splitlines()[-1] == model.verdict


def test_unknown_signals_of_a_log(tmp_path):
    log = aw.identification.read_log(log_file(tmp_path, {"a": ("fit", data())}))
    for options, place in (({"input": "volts"}, "input"), ({"output": "q"}, "output"), ({"joint": "elbow"}, "joint"),
                           ({"input": "qd"}, "output")):  # fmt: skip
        with pytest.raises(ArmwrightError) as caught:
            aw.identification.fit_oe(log, signals=LogSignals(**options))
        assert caught.value.place == place

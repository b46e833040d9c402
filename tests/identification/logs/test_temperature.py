"""Temperatures of motors beside the fast signals of a log."""

from __future__ import annotations

import numpy as np

import armwright as aw
from identification.logs.example_logs import ALL, columns, written
from raises_at import raises_at

OF_ALL = '[[signals]]\nquantity = "temperature"\ncolumns = "T"\nunit = "{unit}"\n'
OF_EACH = '[[signals]]\nquantity = "temperature"\ncolumns = ["T", "T2"]\nunit = "°C"\n'


def table(**more: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    return {"arm.csv": {**columns(), **more}}


def warm(rows: int = 4001) -> np.ndarray:
    """[°C] of a motor that warms up, as drives report it: in whole degrees."""
    return np.round(25.0 + 20.0 * (1 - np.exp(-np.arange(rows) / 2000.0)))


def test_one_temperature_stands_for_all_joints(tmp_path):
    log = aw.identification.read_log(written(tmp_path, ALL + OF_ALL.format(unit="degC"), table(T=warm())))
    values = log.dataset()["temperature"]
    assert values.attrs["units"] == "°C"
    np.testing.assert_allclose(values, np.stack([warm(), warm()], axis=1))
    prepared = aw.identification.prepare_log(log)["temperature"]
    np.testing.assert_allclose(prepared[:, 0], np.interp(prepared.time, np.arange(4001) / 500.0, warm()), atol=0.8)


def test_temperatures_of_each_joint_and_in_kelvin(tmp_path):
    log = aw.identification.read_log(written(tmp_path, ALL + OF_EACH, table(T=warm(), T2=warm() + 3.0)))
    np.testing.assert_allclose(np.diff(log.dataset()["temperature"].values, axis=1), 3.0)
    log = aw.identification.read_log(written(tmp_path, ALL + OF_ALL.format(unit="K"), table(T=warm() + 273.15)))
    np.testing.assert_allclose(log.dataset()["temperature"].values[:, 1], warm(), atol=1e-9)


def test_kelvin_taken_for_celsius(tmp_path):
    with raises_at(aw.ArmwrightError, "run 'run1' temperature shoulder", "kelvin"):
        aw.identification.read_log(written(tmp_path, ALL + OF_ALL.format(unit="°C"), table(T=warm() + 273.15)))


def test_a_slow_temperature_does_not_hide_rows_that_repeat(tmp_path):
    """Its own steps are few, and it changes between rows where all else is held."""
    held = {name: np.repeat(values[::2], 2)[: len(values)] for name, values in columns().items() if name != "t"}
    drift = warm() + np.arange(4001) * 1e-4
    for temperature in (warm(), drift):
        tables = {"arm.csv": {"t": columns()["t"], **held, "T": temperature}}
        log = aw.identification.read_log(written(tmp_path, ALL + OF_ALL.format(unit="°C"), tables))
        assert any("repeat the row before" in str(note) for note in log.notes)


SLOW = """
[files.slow]
path = "slow.csv"
time = { column = "t", unit = "s" }
[[signals]]
quantity = "temperature"
file = "slow"
columns = "T"
unit = "°C"
"""


def test_a_temperature_with_a_clock_of_its_own(tmp_path):
    seconds = np.arange(0.0, 10.0, 1.0)
    text = ALL.replace("[time]", '[time]\nfile = "arm"').replace("[[signals]]", '[[signals]]\nfile = "arm"') + SLOW
    log = aw.identification.read_log(
        written(tmp_path, text, {**table(), "slow.csv": {"t": seconds, "T": 20.0 + seconds}})
    )
    data = log.dataset()
    np.testing.assert_allclose(data["temperature"][:, 0], 20.0 + data.time.values)
    assert len(log.run().stretches) == 1

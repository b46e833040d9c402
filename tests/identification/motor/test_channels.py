"""Wrong signs and exchanged columns are named before a fit; right logs pass."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import LogError
from armwright.identification.motor.channels import check_channels, feedback_remark
from armwright.identification.motor.guess import guess
from armwright.identification.motor.measured import MotorReading, measured
from identification.motor_truth import write_log
from raises_at import raises_at

NAMES = {"u": "voltage", "i": "current", "w": "speed", "q": "position"}


def check(path: Path, ratio: float | None = None) -> None:
    log = aw.identification.read_log(path)
    data = measured(log, list(log.fit), ["motor"], MotorReading())
    direction = float(np.sign(ratio or 1.0))
    check_channels(data, 0, guess(data, 0, 10, direction), ratio, True, log.path)


@pytest.mark.parametrize("signals", [("current", "q", "qd"), ("current", "qd"), ("qd",), ("q",)], ids="-".join)
@pytest.mark.parametrize("changes", [{}, {"coulomb": 0.05}, {"J": 2e-3}, {"R": 8.0}], ids=str)
def test_right_logs_pass(tmp_path, signals, changes):
    check(write_log(tmp_path, 1, signals, rows=1000, **changes))


def with_signs(path: Path, *columns: str) -> Path:
    """The log with the signs of some columns changed."""
    text = path.read_text()
    for column in columns:
        text = text.replace(f'columns = "{column}"', f'columns = "{column}"\nsigns = [-1]')
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("signals", "wrong", "named"),
    [
        (("current", "qd"), "i", "of the current"),
        (("current", "qd"), "u", "of the voltage:"),
        (("current", "qd"), "w", "of the speed"),
        (("current", "q"), "q", "of the position"),
        (("qd",), "w", "voltage or speed"),
        (("q",), "u", "voltage or position"),
    ],
)
def test_a_wrong_sign_is_named(tmp_path, signals, wrong, named):
    with pytest.raises(LogError, match=named) as error:
        aw.identification.identify_motor(with_signs(write_log(tmp_path, 2, signals, rows=1000), wrong))
    assert "signs = [-1]" in str(error.value)


def test_a_gear_of_the_wrong_sign_is_named(tmp_path):
    path = write_log(tmp_path, 2, rows=1000)
    with raises_at(LogError, "joint 'motor'", r"50, not -50\?"):
        check(path, -50.0)
    check(with_signs(path, "q", "w"), -50.0)


@pytest.mark.parametrize(
    ("signals", "columns"),
    [
        (("current", "qd"), "ui"), (("current", "qd"), "uw"), (("current", "qd"), "iw"), (("qd",), "uw"), (("q",), "uq"),
    ],
)  # fmt: skip
def test_exchanged_columns_are_named(tmp_path, signals, columns):
    """As exchanged, not as a wrong sign."""
    path = write_log(tmp_path, 2, signals, rows=1000)
    first, second = columns
    table = np.genfromtxt(tmp_path / "log.csv", delimiter=",", names=True)
    kept = {name: table[{first: second, second: first}.get(name, name)].copy() for name in table.dtype.names}
    if columns == "uq":  # both in the unit that its head states
        kept = {"t": kept["t"], "u": kept["u"] / 100, "q": np.round(kept["q"] * 100)}
    np.savetxt(
        tmp_path / "log.csv", np.column_stack([*kept.values()]), delimiter=",", header=",".join(kept), comments=""
    )
    with pytest.raises(LogError, match="exchanged") as error:
        check(path)
    assert NAMES[first] in str(error.value)
    assert NAMES[second] in str(error.value)


@pytest.mark.parametrize("gain", [0.0, 0.02])
def test_a_closed_loop_is_noticed(tmp_path, gain):
    """A speed with disturbances of its torque, and a command that is a reference, or is fed back."""
    rng = np.random.default_rng(3)
    path = write_log(tmp_path, 3, ("qd",), rows=2000)
    table = np.genfromtxt(tmp_path / "log.csv", delimiter=",", names=True)
    reference, w, rows = table["u"], 0.0, []
    for t, r in zip(table["t"], reference, strict=True):
        u = r + gain * (15.0 * r - w)
        rows.append((t, u, w))
        w = 0.87 * w + 0.13 * 15.0 * u + 3.0 * rng.standard_normal()
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t,u,w", comments="")
    log = aw.identification.read_log(path)
    found = feedback_remark(measured(log, list(log.fit), ["motor"], MotorReading(speed="instant")), 0)
    assert len(found) == (gain > 0)


def test_more_unknowns_than_rows_carry_are_refused(tmp_path):
    with raises_at(LogError, "rows", "33 measurements.* 7 unknowns"):
        aw.identification.identify_motor(
            write_log(tmp_path, 1, ("qd",), rows=33), search=aw.identification.MotorSearch(starts=1)
        )

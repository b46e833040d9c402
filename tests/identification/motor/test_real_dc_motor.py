"""A geared DC motor that was measured: published figures of free simulation, and one set of constants for all of its logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

import armwright as aw
from identification.real_logs import DATA, DC_MOTOR, log_of

FOLDER = DATA / "dc_motor"
STATIC = """
joints = ["motor"]
time.rate_hz = 1
files.log.path = "{folder}/DCmotor_static_gain_response.csv"
signals = [
    {{ quantity = "voltage", columns = "u", unit = "V" }},
    {{ quantity = "speed", columns = "y", unit = "deg/s", side = "joint" }},
]
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return aw.read_log(log_of(tmp_path_factory.mktemp("dc"), "dc_motor", DC_MOTOR))


def test_the_prbs_log_alone(log):
    """A linear model with offset and initial state reaches 80.0 %."""
    found = aw.identify_motor(log).estimate
    assert found.fit["prbs: qd"]["fit_percent"] > 80.3
    text = str(found)
    for words in ("resistance", "rotor inertia", "cannot be told apart", "a log of the current"):
        assert words in text
    assert not found.identifiable[found.number("motor.motor.resistance_ohm")]


def test_one_set_of_constants_for_all_logs(log, tmp_path):
    path = tmp_path / "static.log.toml"
    path.write_text(STATIC.format(folder=FOLDER.as_posix()))
    found = aw.identify_motor(
        log, runs=["prbs", "step"], static=path, pwm="coast", fixed={"limits.voltage_v": 5.0}, per_run=["coulomb"]
    ).estimate
    assert found.fit["static: qd"]["r2"] > 0.999
    assert found.fit["prbs: qd"]["fit_percent"] > 76
    assert found.fit["step: qd"]["fit_percent"] > 80
    name = "motor.friction.coulomb_positive_n_m"
    own = [found[f"{run}: {name}"] for run in ("prbs", "step", "static")]
    assert max(own) / min(own) < 1.05
    assert "drifts by" in str(found)


def test_held_out_stretches_are_predicted_better_than_by_a_linear_model(log, tmp_path):
    """Both fitted to the first half; offset and initial state of each are free in the second."""
    rows = (FOLDER / "DCmotor_prbs_open_exp.csv").read_text().splitlines()
    half = len(rows) // 2
    for name, part in (("first", rows[1:half]), ("second", rows[half:])):
        (tmp_path / f"{name}.csv").write_text("\n".join([rows[0], *part]) + "\n")
        text = DC_MOTOR[: DC_MOTOR.index("[[runs]]")] + DC_MOTOR[DC_MOTOR.index("[[signals]]") :]
        (tmp_path / f"{name}.log.toml").write_text(text.replace("[files.log]", f'[files.log]\npath = "{name}.csv"'))
    record = aw.identify_motor(tmp_path / "first.log.toml").write(tmp_path / "fitted.toml")
    own = aw.identify_motor(tmp_path / "second.log.toml", record, free=["offset"], delay=0.0, starts=1)
    (measures,) = own.estimate.fit.values()
    assert measures["fit_percent"] > linear(tmp_path / "first.csv", tmp_path / "second.csv") - 0.05


def linear(first: Path, second: Path) -> float:
    """Fit % on the second file of a first-order model with offset and initial state, fitted to the first."""

    def predicted(gain, pole, offset, start, u):
        steady = gain * np.concatenate([u[:1], u[:-1]]) + offset
        return lfilter([1 - pole], [1, -pole], steady) + start * pole ** np.arange(len(u))

    u, y = np.loadtxt(first, delimiter=",", skiprows=1, usecols=(1, 2)).T
    gain, pole, *_ = least_squares(
        lambda z: predicted(*z, u) - y, [1700.0, 0.95, -500.0, 0.0], x_scale=[1e3, 1e-2, 1e2, 1e2]
    ).x
    u, y = np.loadtxt(second, delimiter=",", skiprows=1, usecols=(1, 2)).T
    rest = least_squares(lambda z: predicted(gain, pole, *z, u) - y, [-500.0, 0.0]).fun
    return 100.0 * (1.0 - np.linalg.norm(rest) / np.linalg.norm(y - y.mean()))

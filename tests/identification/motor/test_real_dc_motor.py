"""A geared DC motor that was measured: published figures of free simulation, and one set of constants for all of its logs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

import armwright as aw
from armwright.identification import MotorReading, MotorSearch
from identification.real_logs import DC_MOTOR, LOGS, log_of

FOLDER = LOGS / "dc_motor"
FOLDS = 4  # of the PRBS log
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
    return aw.identification.read_log(log_of(tmp_path_factory.mktemp("dc"), "dc_motor", DC_MOTOR))


def test_the_prbs_log_alone(log):
    """A linear model with offset and initial state reaches 80.0 %."""
    found = aw.identification.identify_motor(log).estimate
    assert found.fit["prbs: qd"]["fit_percent"] > 80.3
    text = str(found)
    for words in ("resistance", "rotor inertia", "cannot be distinguished", "a log of the current"):
        assert words in text
    assert not found.identifiable[found.number("motor.motor.resistance_ohm")]


@pytest.mark.study
def test_one_set_of_constants_for_all_logs(log, tmp_path):
    path = tmp_path / "static.log.toml"
    path.write_text(STATIC.format(folder=FOLDER.as_posix()))
    found = aw.identification.identify_motor(
        log,
        fixed={"limits.voltage_v": 5.0},
        reading=MotorReading(runs=["prbs", "step"], static=path),
        search=MotorSearch(pwm="coast", per_run=["coulomb"]),
    ).estimate
    assert found.fit["static: qd"]["r2"] > 0.999
    assert found.fit["prbs: qd"]["fit_percent"] > 76
    assert found.fit["step: qd"]["fit_percent"] > 80
    name = "motor.friction.coulomb_positive_n_m"
    own = [found[f"{run}: {name}"] for run in ("prbs", "step", "static")]
    assert max(own) / min(own) < 1.05
    assert "drifts by" in str(found)


@pytest.mark.sample(1)
@pytest.mark.parametrize("fold", range(FOLDS))
def test_held_out_stretches_are_predicted_better_than_by_a_linear_model(log, tmp_path, fold):
    """Both fitted to the rows before and behind the fold; offset and initial state of each are free in it."""
    prbs = np.loadtxt(FOLDER / "DCmotor_prbs_open_exp.csv", delimiter=",", skiprows=1)
    ends = np.linspace(0, len(prbs), FOLDS + 1).astype(int)
    before, held, behind = np.split(prbs, ends[fold : fold + 2])
    others = [part for part in (before, behind) if len(part)]
    fit = aw.identification.identify_motor(log_of_parts(tmp_path, "fitted", others), search=MotorSearch(starts=4))
    record = fit.write(tmp_path / "motor.toml")
    delay = fit.estimate["delay_s"] if "delay_s" in fit.estimate.names else 0.0
    own = aw.identification.identify_motor(
        log_of_parts(tmp_path, "held", [held]),
        record,
        free=["offset"],
        fixed={"delay": delay},
        search=MotorSearch(starts=1),
    )
    (measures,) = own.estimate.fit.values()
    assert measures["fit_percent"] > linear(others, held)


def log_of_parts(folder: Path, name: str, parts: Sequence[np.ndarray]) -> Path:
    """Path of a log whose runs are some parts of a table of time, volts and speed."""
    text = DC_MOTOR[: DC_MOTOR.index("[[runs]]")]
    for k, part in enumerate(parts):
        np.savetxt(folder / f"{name}{k}.csv", part, delimiter=",", header="t,u,y", comments="")
        text += f'[[runs]]\nname = "part{k}"\nfiles.log = "{name}{k}.csv"\n'
    path = folder / f"{name}.log.toml"
    path.write_text(text + DC_MOTOR[DC_MOTOR.index("[[signals]]") :])
    return path


def linear(parts: Sequence[np.ndarray], held: np.ndarray) -> float:
    """Fit % on held-out rows of a first-order model with offset and initial states, fitted to other parts of the log."""

    def error(gain, pole, offset, start, part):
        steady = gain * np.concatenate([part[:1, 1], part[:-1, 1]]) + offset
        return lfilter([1 - pole], [1, -pole], steady) + start * pole ** np.arange(len(part)) - part[:, 2]

    def errors(z):
        return np.concatenate([error(*z[:3], start, part) for start, part in zip(z[3:], parts, strict=True)])

    begin = [1700.0, 0.95, -500.0] + [0.0] * len(parts)
    gain, pole, *_ = least_squares(errors, begin, x_scale=[1e3, 1e-2] + [1e2] * (1 + len(parts))).x
    rest = least_squares(lambda z: error(gain, pole, *z, held), [-500.0, 0.0]).fun
    return 100.0 * (1.0 - float(np.linalg.norm(rest) / np.linalg.norm(held[:, 2] - held[:, 2].mean())))

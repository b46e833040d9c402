"""Standard deviations that identifications state are those of their estimates, for noise of any correlation from row to row.

Of motor, linear, friction, payload and arm, the stated deviation by the true one, the root mean square over seeded draws of noise
 e_t = rho e_{t-1} + fresh noise.
"""

from __future__ import annotations

from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from scipy.signal import lfilter

import armwright as aw
from armwright.identification.arm.base import BaseParameters, regrouped
from armwright.identification.arm.equations import equations_of, stacked
from armwright.identification.arm.fit import fit_arm, with_correlation
from armwright.identification.arm.friction import _covariance
from armwright.identification.arm.friction_law import FittedFriction, FrictionRows, fitted_law
from armwright.identification.arm.payload import payload_model
from armwright.identification.arm.samples import Samples
from armwright.identification.arm.torque_model import TorqueModel, torque_model
from armwright.identification.linear.fit import fit_armax, fit_arx, fit_oe
from armwright.identification.logs.read import read_log
from armwright.identification.motor.conclusion import covariance
from armwright.identification.motor.identify import identify_motor
from fitting.noise import RHOS, ar1, ratios
from identification.arm.moved_arm import multisine
from identification.motor_truth import COLUMNS, LOG, PATHS, PERIOD, SIGNALS, TRUE, commands, exact, true_record

A, B = np.array([1.0, -1.6, 0.63]), np.array([0.0, 0.0, 0.05, 0.04])
ROWS = 4000
FRICTION = {"viscous": 1.5, "coulomb_positive": 2.0, "coulomb_negative": 2.6}
STRIBECK = {**FRICTION, "stribeck_torque": 4.0, "stribeck_speed": 0.3}


def linear(fit, of_equation: bool, rho: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients, from a random binary input."""
    u = np.repeat(np.random.default_rng(99).choice([-1.0, 1.0], ROWS // 4), 4)
    noise = 0.1 * ar1(rho, ROWS, 1, seed)[:, 0]
    y = lfilter(B, A, u) + 3.0 + (lfilter([0.2], A, noise) if of_equation else noise)
    model = fit(u, y, 0.01, order=2, delay=2)
    return model.values, np.sqrt(np.diag(model.covariance))


def friction(values: dict[str, float], rho: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of a friction law."""
    terms = ("viscous", "coulomb", "stribeck")[: 3 if "stribeck_torque" in values else 2]
    t = np.linspace(0.0, 80.0, ROWS)
    speed = 2 * np.sin(t) + 0.8 * np.sin(2.3 * t + 1)
    rows = FrictionRows(np.cumsum(speed) * 0.02, speed, 0 * t, 20 * np.sin(0.7 * t) ** 2, np.full(ROWS, np.nan))
    torque = FittedFriction(terms, values)(rows) + 0.3 * ar1(rho, ROWS, 1, seed)[:, 0]
    rows = FrictionRows(rows.q, speed, torque, rows.load, rows.warming).part(np.abs(speed) > 0.06)
    law = fitted_law(rows, terms)
    return np.array(list(law.values.values())), np.sqrt(np.diag(_covariance(rows, law)))


@cache
def rows_of(model: TorqueModel) -> tuple[np.ndarray, ...]:
    """t, q, q̇, q̈ and the columns of a motion."""
    t, *motion = multisine(model.arm.n, ROWS / 50.0, 50.0, 0, 1.0, 12)
    return t, *motion, model.rows(*motion)


def on_arm(model: TorqueModel, rho: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Base parameters of an arm, or a payload's, of torques that are noise alone."""
    *motion, columns = rows_of(model)
    noise = ar1(rho, ROWS, model.arm.n, seed) * np.arange(1.0, model.arm.n + 1)
    samples = [Samples("run", 0, *motion, noise, columns=columns, known=np.zeros_like(noise))]
    equations = equations_of(samples, model)
    base = based(model)
    fit = with_correlation(lambda: samples, fit_arm(equations, base))
    return fit.values, fit.std


@cache
def based(model: TorqueModel) -> BaseParameters:
    *motion, columns = rows_of(model)
    samples = [Samples("run", 0, *motion, np.zeros_like(motion[1]), columns=columns, known=np.zeros_like(motion[1]))]
    return regrouped(model.columns, stacked(equations_of(samples, model).factors, len(model))[0][:, :-1])


ARM = aw.load("two-link")
arm_model, carried_model = cache(partial(torque_model, ARM)), cache(partial(payload_model, ARM))


def motor_log(folder: Path, rows: int, rho: float = 0.0, seed: int = 0, noise: float = 0.0) -> Path:
    """A log of a motor under random levels of voltage."""
    u = commands(np.random.default_rng(5), rows)
    columns = {"t": np.arange(rows) * PERIOD, "u": u}
    for k, name in enumerate(("current", "qd")):
        values = exact(TRUE, u)[name]
        columns[COLUMNS[name]] = values + noise * np.abs(values).max() * ar1(rho, rows, 2, seed)[:, k]
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / "log.csv", table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    path = folder / "motor.log.toml"
    path.write_text(LOG.format(name="log", signals=SIGNALS["current"] + SIGNALS["qd"]))
    return path


@cache
def motor_problem():
    """The problem of a motor's log at its solution, with its Jacobian."""
    found = []
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "armwright.identification.motor.conclusion.covariance",
            lambda problem, residuals, jacobian: (
                found.append((problem, jacobian)) or covariance(problem, residuals, jacobian)
            ),
        )
        path = motor_log(Path(folder), 2000, noise=0.01)
        identify_motor(path, true_record(Path(folder)), search=aw.identification.MotorSearch(starts=1), progress=False)
    return found[0]


def motor_about(rho: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates of a motor, linear about the solution."""
    problem, jacobian = motor_problem()
    noise = (
        ar1(rho, len(problem.stretches[0].t), problem.stretches[0].weights.shape[1], seed)
        * problem.stretches[0].weights
    )
    z = np.linalg.lstsq(jacobian, noise.ravel(), rcond=None)[0]
    spread = covariance(problem, noise.ravel() - jacobian @ z, jacobian)
    own = [k for k, each in enumerate(problem.unknowns) if each.paths]
    return z[own], np.sqrt(np.diag(spread))[own]


def motor(rho: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of a motor, from a log; deviations are not widened by terms that slow noise leaves open."""
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr("armwright.identification.motor.candidates._widened", lambda done, other, term: done)
        path = motor_log(Path(folder), 2000, rho, seed, 0.02)
        found = identify_motor(
            read_log(path), true_record(Path(folder)), search=aw.identification.MotorSearch(starts=1), progress=False
        ).estimate
    places = [found.number(name) for name in PATHS.values()]
    return found.values[places], found.std[places]


FITS = {
    "OE": partial(linear, fit_oe, False),
    "ARX": partial(linear, fit_arx, True),
    "ARMAX": partial(linear, fit_armax, False),
    "friction": partial(friction, FRICTION),
    "Stribeck friction": partial(friction, STRIBECK),
    "arm": lambda rho, seed: on_arm(arm_model(), rho, seed),
    "payload": lambda rho, seed: on_arm(carried_model(), rho, seed),
    "motor": motor_about,
}
DRAWS = {"OE": 120, "ARX": 60, "ARMAX": 60}  # in `make test-all`, of what takes long; of others 300
MEAN = (
    "ARX",
    "ARMAX",
)  # judged by the mean over their coefficients: few draws, and at rho 0.98 single ones from 0.81 to 1.14


def stated_by_true(fit, rho: float, draws: int) -> np.ndarray:
    """(p,) ratios of deviations."""
    return ratios(*zip(*(fit(rho, seed) for seed in range(draws)), strict=True))


@pytest.mark.study
@pytest.mark.parametrize("name", FITS)
def test_deviations_are_about_those_of_the_fits(name):
    """Few draws of slow noise tell the mean of several ratios to 10 %."""
    found = stated_by_true(FITS[name], 0.9, 24 if name in DRAWS else 40)
    assert 0.8 < np.exp(np.log(found).mean()) < 1.2, found


@pytest.mark.study
@pytest.mark.parametrize("rho", RHOS)
@pytest.mark.parametrize("name", FITS)
def test_deviations_are_those_of_the_fits(name, rho):
    found = stated_by_true(FITS[name], rho, DRAWS.get(name, 300))
    judged = np.exp(np.log(found).mean(keepdims=True)) if name in MEAN else found
    assert (np.abs(judged - 1.0) < 0.15).all(), found


@pytest.mark.study
def test_deviations_of_motors_from_logs_are_those_of_the_fits():
    found = stated_by_true(motor, 0.98, 40)
    assert 0.85 < np.exp(np.log(found).mean()) < 1.15, found

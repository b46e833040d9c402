"""The compiled response against the closed form of a motor with dry friction, and its derivatives against differences."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.identification.motor.response import DriveInputs, Response, response_of
from armwright.model.vary import Varied
from identification import motor_simulator
from identification.motor_truth import DELAY, PATHS, PERIOD, RECORD, TRUE, commands, exact, true_record

ROWS = 600


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return aw.load(true_record(tmp_path_factory.mktemp("motor")))


@pytest.fixture(scope="module")
def response(arm):
    return Response(Varied(arm, list(PATHS.values())), ["q", "qd", "current"], 6, 3)


def run(response, delay=DELAY, change=0.0, at=None, start=(0.3, 5.0)):
    u = commands(np.random.default_rng(1), ROWS)[:, None]
    p, x = np.append(response.varied.nominal, 0.0), np.array(start)
    if at is not None and at < len(p):
        p[at] += change
    return response.run(response.table(DriveInputs(np.full(ROWS, PERIOD), u)), p[None], np.array([delay]), x[None])


def test_the_response_is_the_closed_form(response):
    y, _ = run(response, start=(0.3, 0.0))
    truth = exact(TRUE, commands(np.random.default_rng(1), ROWS))
    for k, (name, error) in enumerate({"q": 1e-11, "qd": 1e-9, "current": 1e-10}.items()):
        np.testing.assert_allclose(y[0, :, k], truth[name], atol=error)
    assert (truth["qd"] == 0.0).sum() > 50, "the motor sticks in some rows"
    np.testing.assert_array_equal(y[0, :, 1] == 0.0, truth["qd"] == 0.0)


def test_steps_that_end_at_rest_converge_fast(arm, monkeypatch):
    """Of drives that are not affine, which go by substeps."""
    monkeypatch.setattr("armwright.identification.motor.response.is_affine", lambda plant: False)
    u = commands(np.random.default_rng(1), ROWS)
    truth, errors = exact(TRUE, u)["q"], []
    for substeps in (1, 2, 4):
        response = Response(Varied(arm, [PATHS["R"]]), ["q"], 3, substeps)
        table = response.table(DriveInputs(np.full(ROWS, PERIOD), u[:, None]))
        y, _ = response.run(table, np.array([[TRUE["R"], 0.0]]), np.array([DELAY]), np.array([[0.3, 0.0]]))
        errors.append(np.abs(y[0, :, 0] - truth).max())
    assert errors[0] / errors[1] > 4.0
    assert errors[2] < 5e-6


@pytest.mark.sample(1)
@pytest.mark.parametrize("inductance", [1e-6, 4e-4, 4e-3], ids=["stiff", "real poles", "complex poles"])
def test_a_winding_is_the_matrix_exponential(tmp_path, inductance):
    """Of a simulator on SciPy alone; the delay has a fraction, and the rotor stops, rests and breaks loose."""
    motor, bench = motor_simulator.Motor(L=inductance), motor_simulator.Bench(rows=400)
    truth = motor_simulator.simulated(motor, bench, 1)
    numbers = {"R": motor.R, "Kt": motor.K, "J": motor.J, "viscous": motor.B, "coulomb": motor.C}
    path = tmp_path / "motor.toml"
    line = f"[joints.motor]\ninductance_h = {inductance}"
    path.write_text(RECORD.format(**numbers).replace("[joints.motor]", line))
    response = Response(Varied(aw.load(path), ["motor.motor.inductance_h"]), ["q", "qd", "current"], 2, 1)
    table = response.table(DriveInputs(np.full(bench.rows, bench.period), truth["u"][:, None]))
    start = np.tile([truth["true_q"][0], 0.0, 0.0], (3, 1))
    lanes = np.array([[inductance, 0.0], [inductance * (1 + 1e-5), 0.0], [inductance * (1 - 1e-5), 0.0]])
    y, slopes = response.run(table, lanes, np.full(3, bench.delay), start)
    assert (truth["true_w"] == 0.0).sum() > 20
    for k, name in enumerate(("true_q", "true_w", "true_i")):
        np.testing.assert_allclose(y[0, :, k], truth[name], atol=1e-8 * np.abs(truth[name]).max())
        expected = (y[1, :, k] - y[2, :, k]) / (2e-5 * inductance)
        np.testing.assert_allclose(slopes[0, :, k, 0], expected, atol=1e-3 * np.abs(expected).max(), err_msg=name)


@pytest.mark.parametrize("name", [*PATHS, "offset"])
def test_derivatives_by_parameters(response, name):
    at = [*PATHS, "offset"].index(name)
    size = 1e-6 * (1.0 if name == "offset" else TRUE[name])
    _, slopes = run(response)
    ends = [run(response, change=sign * size, at=at)[0] for sign in (1, -1)]
    direction = at if name != "offset" else len(PATHS) + 1
    expected = (ends[0] - ends[1]) / (2 * size)
    np.testing.assert_allclose(slopes[..., direction], expected, atol=2e-4 * np.abs(expected).max())


@pytest.mark.parametrize("delay", [0.4, 2.3, 3.0])
def test_the_derivative_by_the_delay_holds_in_position_across_whole_samples(response, delay):
    _, slopes = run(response, delay)
    ends = [run(response, delay + sign * 1e-6)[0] for sign in (1, -1)]
    expected = (ends[0] - ends[1])[0, :, 0] / 2e-6
    np.testing.assert_allclose(slopes[0, :, 0, len(PATHS)], expected, atol=1e-3 * np.abs(expected).max())


def test_derivatives_by_the_initial_state(response):
    _, slopes = run(response)
    ends = [run(response, start=(0.3, 5.0 + sign * 1e-6))[0] for sign in (1, -1)]
    expected = (ends[0] - ends[1]) / 2e-6
    np.testing.assert_allclose(slopes[..., -1], expected, atol=1e-4 * np.abs(expected).max())
    np.testing.assert_allclose(slopes[0, :, 0, -2], 1.0, atol=1e-12)


def test_lanes_are_independent(response):
    table = response.table(DriveInputs(np.full(ROWS, PERIOD), commands(np.random.default_rng(1), ROWS)[:, None]))
    rng = np.random.default_rng(2)
    p = np.append(response.varied.nominal, 0.0) * rng.uniform(0.5, 2.0, (11, len(PATHS) + 1))
    delay, start = rng.uniform(0.0, 6.5, 11), rng.normal(size=(11, 2))
    y, dy = response.run(table, p, delay, start)
    one, slopes = response.run(table, p[7:8], delay[7:8], start[7:8])
    np.testing.assert_array_equal(y[7], one[0])
    np.testing.assert_array_equal(dy[7], slopes[0])


def test_a_structure_is_traced_once(tmp_path):
    """Arms that differ in numbers that vary have one response; one that differs in another number has its own."""
    names = [PATHS["R"], PATHS["Kt"]]
    found = [
        response_of(Varied(aw.load(true_record(tmp_path, **changes)), names), ["qd"], 2, 1)
        for changes in ({}, {"R": 2.0, "Kt": 0.1}, {"J": 1e-4})
    ]
    assert found[0] is found[1]
    assert found[0] is not found[2]

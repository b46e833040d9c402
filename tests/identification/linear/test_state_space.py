"""State-space forms: simulation, delay, and a model as a sensor of a simulated loop."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import dlsim, lfilter

import armwright as aw
from armwright.errors import ScenarioError
from armwright.identification.linear.state_space import FilteredSensor, StateSpace, realised, states
from raises_at import raises_at


@pytest.mark.parametrize(
    "a", [np.diag([0.9, 0.5]), np.array([[0.9, 1.0], [0.0, 0.9]]), np.array([[0.8, 0.3], [-0.3, 0.8]])]
)
def test_states_are_scipys(a):  # the second has no full set of eigenvectors
    b, u = np.array([[1.0, 0.0], [0.5, 2.0]]), np.random.default_rng(0).standard_normal((200, 2))
    start = np.array([1.0, -2.0])
    expected = dlsim((a, b, np.eye(2), np.zeros((2, 2)), 1.0), u, x0=start)[2]
    assert states(a, b, u, start) == pytest.approx(expected, abs=1e-9)


def test_realisation_is_the_filter():
    b, a, u = np.array([0.0, 0.0, 0.3, -0.1]), np.array([1.0, -1.2, 0.5]), np.random.default_rng(1).standard_normal(300)
    assert realised(a, b, 2.0, 0.1).simulate(u[:, None])[:, 0] == pytest.approx(lfilter(b, a, u) + 2.0, abs=1e-10)


def test_a_model_is_a_sensor_of_a_compiled_loop():
    draw = np.random.default_rng(2)
    u = np.repeat(draw.choice([-1.0, 1.0], 300), 4)
    y = lfilter([0.0, 0.0, 0.3], [1.0, -0.7], u) + 0.5
    model = aw.identification.fit_oe(u, y, 1e-3, order=1, delay=2)
    arm = aw.load("two-link")
    tachometer = model.sensor(of="qd", name="tacho", unit="V")
    loop = aw.Loop(
        lambda t, r, m: 20.0 * (r.q - m.q) - 2.0 * m.tacho,
        np.array([0.4, -0.3]),
        1e-3,
        sensors=[aw.Sensors(), tachometer],
    )
    run = aw.simulate(aw.Scenario(arm, duration=0.3, loop=loop))
    assert run.attrs["controller"] == "compiled"
    assert run["tacho_measured"].units == "V"
    qd = run["qd"].values
    expected = np.stack([model.simulate(np.concatenate([np.full(50, v[0]), v]))[50:] for v in qd.T], axis=1)
    assert run["tacho_measured"].values[:-1] == pytest.approx(expected[:-1], abs=1e-6 * np.abs(expected).max())


def test_a_model_is_an_actuator_of_a_compiled_loop():
    """Commands reach the drives as the model passes them on, which SciPy's filter says too."""
    u = np.repeat(np.random.default_rng(2).choice([-1.0, 1.0], 300), 4)
    model = aw.identification.fit_oe(u, lfilter([0.0, 0.0, 0.3], [1.0, -0.7], u), 1e-3, order=1, delay=2)
    arm = aw.load("two-link")

    def command(t, r, m):
        return 30.0 * (r.q - m.q) - 4.0 * m.qd

    def run_of(controller):
        loop = aw.Loop(controller, np.array([0.4, -0.3]), 1e-3)
        return aw.simulate(aw.Scenario(arm, duration=0.3, loop=loop))

    run = run_of(model.actuator(command))
    assert run.attrs["controller"] == "compiled"
    asked = 30.0 * (np.array([0.4, -0.3]) - run["q_measured"].values) - 4.0 * run["qd_measured"].values
    passed = np.stack([lfilter([0.0, 0.0, 0.3], [1.0, -0.7], each) for each in asked.T], axis=1)
    first = run["tau"].values[0]
    began = np.stack([value * 0.7 ** np.maximum(np.arange(len(asked)) - 1, 0) for value in first], axis=1)
    expected = passed + began
    scale = np.abs(expected).max()
    assert run["tau"].values[3:-1] == pytest.approx(expected[3:-1], abs=0.02 * scale)
    assert np.abs(run["q"].values - run_of(command)["q"].values).max() > 1e-3
    with raises_at(ScenarioError, "period of the loop", r"0\.001 s", value=0.002):
        aw.simulate(aw.Scenario(arm, duration=0.1, loop=aw.Loop(model.actuator(command), np.zeros(2), 2e-3)))


def test_a_sensor_has_one_input_and_one_output():
    model = StateSpace(np.eye(1) * 0.5, np.ones((1, 2)), np.ones((1, 1)), np.zeros((1, 2)), np.zeros(1), 0.1)
    with pytest.raises(ScenarioError, match="2 inputs"):
        FilteredSensor(model, "qd", "x")

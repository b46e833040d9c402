"""Zero-order hold with delay beside closed forms, SciPy's discretisation, and a simulated continuous system."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete

from armwright.control.analysis import sampled_system, zero_order_hold
from armwright.errors import ScenarioError
from raises_at import raises_at

DELAYS = [0.0, 0.3, 1.0, 1.25, 2.999, 3.0]


@pytest.mark.parametrize("periods", DELAYS)
def test_double_integrator(periods):
    """x = (position, speed), u an acceleration: Γ(t) = (t²/2, t)."""
    h, whole = 0.004, int(periods)
    part = periods - whole
    held = zero_order_hold([[0, 1], [0, 0]], [[0], [1]], h, periods * h)
    now, late = (1 - part) * h, part * h
    assert held.ticks == whole
    assert np.abs(held.a - [[1, h], [0, 1]]).max() < 1e-15
    assert np.abs(held.new[:, 0] - [now**2 / 2, now]).max() < 1e-15
    assert np.abs(held.old[:, 0] - [late**2 / 2 + now * late, late]).max() < 1e-15


@pytest.mark.parametrize("periods", DELAYS)
def test_first_order(periods):
    h, pole, gain = 0.01, 30.0, 7.0
    part = periods - int(periods)
    held = zero_order_hold([[-pole]], [[gain]], h, periods * h)
    assert held.a[0, 0] == pytest.approx(np.exp(-pole * h), abs=1e-12)
    assert held.new[0, 0] == pytest.approx(gain / pole * (1 - np.exp(-pole * (1 - part) * h)), abs=1e-12)
    expected = gain / pole * (np.exp(-pole * (1 - part) * h) - np.exp(-pole * h))
    assert held.old[0, 0] == pytest.approx(expected, abs=1e-12)


def test_scipy_s_discretisation_without_delay():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(5, 4, 4)), rng.normal(size=(5, 4, 2))
    held = zero_order_hold(a, b, 0.05)
    for k in range(5):
        expected = cont2discrete((a[k], b[k], np.eye(4), np.zeros((4, 2))), 0.05)
        assert np.abs(held.a[k] - expected[0]).max() < 1e-13
        assert np.abs(held.new[k] - expected[1]).max() < 1e-13
    assert not held.old.any()


@pytest.mark.parametrize("periods", [0.0, 0.4, 1.0, 2.7])
def test_a_sampled_system_goes_as_the_continuous_one(periods):
    pytest.importorskip("control", reason="python-control holds the system")
    rng = np.random.default_rng(1)
    a, b, c, h = rng.normal(size=(3, 3)), rng.normal(size=(3, 2)), rng.normal(size=(2, 3)), 0.1
    u = rng.normal(size=(2, 12))
    system = sampled_system(a, b, c, h, periods * h)
    state, sampled = np.zeros(system.nstates), []
    for k in range(12):
        sampled.append(system.C @ state)
        state = system.A @ state + system.B @ u[:, k]

    def rate(t, x):
        k = int(np.floor((t - periods * h) / h + 1e-9))
        return a @ x + b @ (u[:, k] if k >= 0 else np.zeros(2))

    x, switches = np.zeros(3), sorted({k * h for k in range(13)} | {(k + periods) * h for k in range(13)})
    continuous = []
    for start, end in pairwise(switches):
        if abs(start / h - round(start / h)) < 1e-9 and len(continuous) < 12:
            continuous.append(c @ x)
        if end - start > 1e-12:
            middle = 0.5 * (start + end)
            x = solve_ivp(lambda t, x: rate(middle, x), (start, end), x, rtol=1e-12, atol=1e-14).y[:, -1]  # noqa: B023
    assert np.abs(np.array(sampled) - np.array(continuous)).max() < 1e-9


@pytest.mark.parametrize(
    ("arguments", "place"),
    [
        ((np.eye(2), np.eye(2), 0.0), "period"),
        ((np.eye(2), np.eye(2), np.nan), "period"),
        ((np.eye(2), np.eye(2), 0.1, -1.0), "delay"),
        ((np.eye(2), np.eye(3), 0.1), "a, b"),
        ((np.ones(2), np.eye(2), 0.1), "a, b"),
        ((np.ones((3, 1, 1)), np.ones((2, 1, 1)), 0.1), "a, b"),
        (([[np.inf]], [[1.0]], 0.1), "a"),
        (([[np.nan]], [[1.0]], 0.1), "a"),
        (([[10**400]], [[1.0]], 0.1), "a"),
        (("a", [[1.0]], 0.1), "a"),
        (([[1.0]], [[1j]], 0.1), "b"),
        (([[1e6]], [[1.0]], 0.1), "a, b"),
        ((np.eye(2), np.eye(2), 0.1, np.inf), "delay"),
        ((np.eye(2), np.eye(2), 1e-3, 1e308), "delay"),
        ((np.eye(2), np.eye(2), 1e-3, "1"), "delay"),
        ((np.eye(2), np.eye(2), np.inf), "period"),
    ],
)
def test_refused(arguments, place):
    with pytest.raises(ScenarioError) as error:
        zero_order_hold(*arguments)
    assert error.value.problems[0].place == place


def test_a_sampled_system_is_refused_where_its_matrix_would_fill_the_memory():
    pytest.importorskip("control", reason="python-control holds the system")
    a, b, c = [[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]]
    for delay in (1e6, 4.0):
        with raises_at(ScenarioError, "delay", r"3\.997 s") as error:
            sampled_system(a, b, c, 1e-3, delay)
        assert error.value.problems[0].place == "delay"
    assert sampled_system(a, b, c, 1e-2, 3.997).nstates == 402
    for wrong in ([[1.0]], [1.0, 0.0], [[np.nan, 0.0]]):
        with pytest.raises(ScenarioError):
            sampled_system(a, b, wrong, 1e-3)
    with pytest.raises(ScenarioError):
        sampled_system([a, a], b, c, 1e-3)

"""Subspace models against known truth, and as systems of python-control."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ArmwrightError
from armwright.identification import OrderSearch, SubspaceMethod

A = np.array([[0.9, 0.1, 0.0], [-0.1, 0.8, 0.0], [0.0, 0.1, 0.6]])
B = np.array([[0.1, 0.0], [0.0, 0.2], [0.3, 0.1]])
C = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, -1.0]])
D = np.array([[0.2, 0.0], [0.0, 0.0]])
DIRECT = SubspaceMethod(direct=True)


def plant(seed, rows=1500, noise=0.0, direct=True):
    draw = np.random.default_rng(seed)
    u, x, y = draw.choice([-1.0, 1.0], (rows, 2)), np.array([1.0, -1.0, 0.5]), np.zeros((rows, 2))
    for k in range(rows):
        y[k] = C @ x + (D @ u[k] if direct else 0.0)
        x = A @ x + B @ u[k]
    return u, y + [4.0, -7.0] + noise * draw.standard_normal((rows, 2))


@pytest.mark.parametrize("weighting", ["cva", "moesp"])
@pytest.mark.parametrize("direct", [True, False])
def test_exact_data_give_the_exact_system(weighting, direct):
    u, y = plant(0, direct=direct)
    method = SubspaceMethod(weighting=weighting, direct=direct)
    model = aw.identification.fit_n4sid(u, y, 0.01, order=3, method=method)
    expected = sorted(np.linalg.eigvals(A), key=lambda p: (p.real, p.imag))
    assert sorted(model.poles, key=lambda p: (p.real, p.imag)) == pytest.approx(expected, abs=1e-7)
    gain = C @ np.linalg.solve(np.eye(3) - A, B) + (D if direct else 0.0)
    assert model.gain == pytest.approx(gain, abs=1e-6)
    assert model.core.offset == pytest.approx([4.0, -7.0], abs=1e-6)
    assert model.simulate(u, y) == pytest.approx(y, abs=1e-6)
    assert (model.singular[3:] < 1e-4 * model.singular[2]).all()


def test_an_integrator_stays_one():
    """Poles are drawn back from beyond 1 + 1 / rows alone: one of 1 is none of them."""
    u = np.random.default_rng(5).choice([-1.0, 1.0], 500)
    y = np.concatenate([[0.0], 0.01 * np.cumsum(u)[:-1]])
    model = aw.identification.fit_n4sid(u, y, 0.01, order=1)
    assert model.poles == pytest.approx([1.0], abs=1e-7)
    assert model.simulate(u, y) == pytest.approx(y, abs=1e-9)


def test_order_is_chosen():
    u, y = plant(1, rows=2500, noise=0.1)
    for by in ("bic", "cv"):
        model = aw.identification.fit_n4sid(u, y, 0.01, search=OrderSearch(by, most_order=6), method=DIRECT)
        assert model.order == 3


@pytest.mark.study
def test_the_jackknife_tells_the_deviations():
    gain, squares = C @ np.linalg.solve(np.eye(3) - A, B) + D, []
    for seed in range(8):
        u, y = plant(seed, rows=1500, noise=0.1)
        model = aw.identification.fit_n4sid(u, y, 0.01, order=3, method=DIRECT)
        squares.append(((model.gain - gain) / model.gain_std) ** 2)
    assert 0.5 < np.mean(squares) < 2.5  # 9/7 of a t distribution with 9 degrees of freedom


def test_one_input_one_output_with_delay_and_several_runs():
    u, _ = plant(2, rows=1200, noise=0.01, direct=False)
    late = np.concatenate([np.zeros(5), u[:-5, 0]])
    x, out = np.zeros(3), np.zeros(1200)
    for k in range(1200):
        out[k] = C[0] @ x
        x = A @ x + B[:, 0] * late[k]
    out += 0.01 * np.random.default_rng(0).standard_normal(1200)
    runs_u, runs_y = [u[:500, 0], u[550:, 0]], [out[:500], out[550:]]
    model = aw.identification.fit_n4sid(runs_u, runs_y, 1.0, order=3)
    assert model.delay == 6
    assert min(row["fit_percent"] for row in model.fit.values()) > 95.0
    f = np.array([0.01, 0.1, 0.3])
    z = np.exp(2j * np.pi * f)
    truth = [C[0] @ np.linalg.solve(each * np.eye(3) - A, B[:, 0]) * each**-5 for each in z]
    assert model.response(f) == pytest.approx(truth, abs=0.03)
    assert model.state_space.response(f)[:, 0, 0] == pytest.approx(model.response(f), abs=1e-12)


def test_an_input_that_excites_too_little():
    t = np.arange(800)
    with pytest.raises(ArmwrightError) as caught:
        aw.identification.fit_n4sid(np.sin(0.1 * t), np.sin(0.1 * t + 1), 1.0, order=2, delay=1)
    assert "excites 3 of 16 lags" in str(caught.value)


def test_to_control():
    control = pytest.importorskip("control", reason="python-control is not installed (extra control)")
    u, y = plant(3, noise=0.01)
    model = aw.identification.fit_n4sid(u, y, 0.01, order=3, method=DIRECT)
    system = model.to_control()
    assert system.dt == 0.01
    assert control.dcgain(system) == pytest.approx(model.gain)
    single = aw.identification.fit_oe(u[:, 0], y[:, 0], 0.01, order=3, delay=0)
    assert np.sort_complex(single.to_control().poles()) == pytest.approx(np.sort_complex(single.poles), abs=1e-8)
    forced = control.forced_response(single.to_control(), inputs=u[:, 0], timepts=0.01 * np.arange(len(u))).outputs
    rest = single.simulate(np.concatenate([np.zeros(300), u[:, 0]]))[300:] - single.core.offset
    assert forced == pytest.approx(rest, abs=1e-6)
    response = aw.identification.frequency_response(u[:, 0], y[:, 0], 0.01)
    assert response.to_control().omega == pytest.approx(2 * np.pi * response.frequency)

"""ARX, OE and ARMAX against known truth, SciPy's least squares, SIPPY, and their own statistics."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

import armwright as aw
from armwright.identification import OrderSearch, SubspaceMethod
from armwright.identification.linear.prediction_error import Orders, minimise, starts
from armwright.identification.linear.records import RecordedStretch
from identification.linear.random_systems import random_truth, sampled_truth

A, B = np.array([1.0, -1.6, 0.63]), np.array([0.0, 0.0, 0.05, 0.04])
POLES = [0.9, 0.7]


def bench(seed, rows=1500, noise=0.1, offset=3.0, colour=(1.0,)):
    draw = np.random.default_rng(seed)
    u = np.repeat(draw.choice([-1.0, 1.0], rows // 4), 4)
    return u, lfilter(B, A, u) + offset + noise * lfilter(colour, [1.0], draw.standard_normal(rows))


def test_gradients_are_those_of_differences():
    u, y = bench(0, rows=300)
    stretches = [RecordedStretch("", u[:, None], y[:, None])]
    for orders in (Orders("oe", 2, 2, 0, 2, True), Orders("armax", 2, 2, 2, 2, True)):
        theta = orders.theta(orders.polynomials(starts(orders, stretches, orders.past, True)[0]))

        def errors(x, orders=orders):
            return minimise(orders, stretches, orders.past, False, x, rounds=0).errors

        # initial states at 0: with them the projection would turn with the parameters
        got = minimise(orders, stretches, orders.past, False, theta, rounds=0).jacobian
        for k in range(orders.count):
            step = 1e-6 * np.eye(orders.count)[k]
            difference = (errors(theta + step) - errors(theta - step)) / 2e-6
            assert got[:, k] == pytest.approx(difference, abs=1e-6 * np.abs(difference).max())


def test_exact_data_give_the_exact_system():
    u, y = bench(1, noise=0.0)
    for fit in (aw.identification.fit_arx, aw.identification.fit_oe):
        model = fit(u, y, 0.01, order=2, delay=2)
        assert model.values == pytest.approx([-1.6, 0.63, 0.05, 0.04, 3.0 * A.sum()], abs=1e-8)
        assert model.simulate(u, y) == pytest.approx(y, abs=1e-8)
        assert sorted(model.poles.real) == pytest.approx(sorted(POLES))
        time_constants = [each.value for each in model.quantities if each.name.startswith("time")]
        assert time_constants == pytest.approx([-0.01 / np.log(0.9), -0.01 / np.log(0.7)], rel=1e-6)


def test_oe_is_where_scipy_finds_the_minimum():
    u, y = bench(2, rows=600)
    model = aw.identification.fit_oe(u, y, 1.0, order=2, delay=2)

    def errors(x):  # free simulation with initial outputs among the unknowns
        a = np.concatenate([[1.0], x[:2]])
        b = np.concatenate([[0.0, 0.0], x[2:4]])
        return lfilter([1.0], a, lfilter(b, [1.0], u)[3:] + x[4] + np.r_[x[5:7], np.zeros(595)]) - y[3:]

    start = np.r_[-1.5, 0.55, 0.05, 0.04, 0.1, 0.0, 0.0]
    found = least_squares(errors, start, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert model.values == pytest.approx(found.x[:5], abs=3e-4 * np.abs(found.x[:5]).max())
    rms = next(iter(model.fit.values()))["rms"]
    assert rms == pytest.approx(np.sqrt(np.mean(errors(found.x) ** 2)), rel=1e-6)


def test_arx_is_least_squares():
    u, y = bench(3)
    matrix = np.stack([-y[2:-1], -y[1:-2], u[1:-2], u[:-3], np.ones(len(y) - 3)], axis=1)
    expected = np.linalg.lstsq(matrix, y[3:], rcond=None)[0]
    assert aw.identification.fit_arx(u, y, 1.0, order=2, delay=2).values == pytest.approx(expected, rel=1e-8)


def test_measurement_noise_biases_arx_and_not_oe():
    u, y = bench(4, rows=4000, noise=0.2)
    free = {
        fit: fit(u, y, 1.0, order=2, delay=2)
        for fit in (aw.identification.fit_arx, aw.identification.fit_oe, aw.identification.fit_armax)
    }
    truth = lfilter(B, A, u) + 3.0
    error = {fit: (model.simulate(u, y) - truth).std() for fit, model in free.items()}
    assert error[aw.identification.fit_oe] < 0.1 * error[aw.identification.fit_arx]
    assert error[aw.identification.fit_armax] < 0.2 * error[aw.identification.fit_arx]


def test_armax_finds_the_noise():
    draw = np.random.default_rng(5)
    u, c = np.repeat(draw.choice([-1.0, 1.0], 1000), 4), np.array([1.0, 0.6, 0.2])
    y = lfilter(B, A, u) + lfilter(c, A, 0.05 * draw.standard_normal(4000))
    model = aw.identification.fit_armax(u, y, 1.0, order=2, delay=2)
    assert model.polynomials is not None
    assert model.polynomials.c == pytest.approx(c, abs=0.06)
    deviations = (model.values - [-1.6, 0.63, 0.05, 0.04, 0.6, 0.2, 0.0]) / np.sqrt(np.diag(model.covariance))
    assert np.abs(deviations).max() < 3.5
    assert not any("white" in remark for remark in model.remarks)


@pytest.mark.study
@pytest.mark.parametrize("colour", [(1.0,), tuple(0.8 ** np.arange(20))])
def test_intervals_cover_the_truth(colour):
    true_gain, inside = B.sum() / A.sum(), []
    for seed in range(60):
        u, y = bench(seed, rows=800, noise=0.1, colour=colour)
        model = aw.identification.fit_oe(u, y, 1.0, order=2, delay=2)
        inside.append(abs(model.gain[0, 0] - true_gain) < 1.96 * model.gain_std[0, 0])
    assert np.mean(inside) >= 0.87  # 95 % of 60: below 52 in 1 of 100 tries


def test_offset_and_initial_state():
    u, y = bench(6, noise=0.0, offset=100.0)
    u, y = u[200:], y[200:]  # in full motion
    assert aw.identification.fit_oe(u, y, 1.0, order=2, delay=2).fit_percent(u, y) > 99.999
    without = aw.identification.fit_oe(u, y, 1.0, order=2, delay=2, offset=False)
    assert "no offset" in without.method
    assert next(iter(without.fit.values()))["fit_percent"] < 99.0
    noisy = y + 0.2 * np.random.default_rng(0).standard_normal(len(y))
    with_state, without_state = (
        aw.identification.fit_oe(u, noisy, 1.0, order=2, delay=2, initial=each) for each in (True, False)
    )
    assert "initial states as measured" in without_state.method
    assert np.abs(with_state.values[:4] - [-1.6, 0.63, 0.05, 0.04]).max() < 0.05


def test_several_runs_have_states_of_their_own():
    u, y = bench(7, rows=1200, noise=0.05)
    runs = [(u[a:b], y[a:b]) for a, b in ((0, 400), (450, 800), (830, 1200))]
    model = aw.identification.fit_oe([u for u, _ in runs], [y for _, y in runs], 1.0, order=2, delay=2)
    assert sorted(model.poles.real) == pytest.approx(sorted(POLES), abs=0.03)
    assert list(model.fit) == ["run1 (fit): y", "run2 (fit): y", "run3 (fit): y"]


def test_an_integrator_is_found_and_said():
    draw = np.random.default_rng(8)
    u = np.repeat(draw.choice([-1.0, 1.0], 300), 5)
    y = lfilter([0.0, 0.01], [1.0, -1.0], u) + 0.001 * draw.standard_normal(1500)
    model = aw.identification.fit_oe(u, y, 1.0, order=1, delay=1)
    assert model.poles[0].real == pytest.approx(1.0, abs=1e-3)
    assert any("integrator" in remark for remark in model.remarks)
    assert model.fit_percent(u, y) > 95.0


def test_feedback_is_noticed_and_armax_stands_it():
    draw = np.random.default_rng(9)
    rows, gain = 4000, 4.0
    u, y, x = np.zeros(rows), np.zeros(rows), np.zeros(2)
    r, noise = np.repeat(draw.choice([-1.0, 1.0], rows // 8), 8), 0.05 * draw.standard_normal(rows)
    for k in range(rows):
        y[k] = 0.9 * x[0] + 0.1 * x[1] + noise[k]
        u[k] = gain * (0.3 * r[k] - y[k])
        x = np.array([y[k], u[k]])
    closed = aw.identification.fit_oe(u, y, 1.0, order=1, delay=1)
    assert any("closed loop" in remark for remark in closed.remarks)
    assert any("closed loop" in remark for remark in aw.identification.frequency_response(u, y, 1.0).remarks)
    assert any("closed loop" in remark for remark in aw.identification.fit_n4sid(u, y, 1.0, order=1, delay=1).remarks)
    assert aw.identification.fit_armax(u, y, 1.0, order=1, delay=1).poles[0].real == pytest.approx(0.9, abs=0.02)
    assert aw.identification.fit_n4sid(u, y, 1.0, order=1).delay >= 1  # though the input answers to y in the same row
    found = aw.identification.fit_oe(u, y, 1.0, order=1)
    assert found.delay > 0 or any("delay=1" in remark for remark in found.remarks)
    false = 0
    for seed in range(30):
        u, y = bench(seed, rows=800, colour=tuple(0.9 ** np.arange(20)))
        false += any(
            "closed loop" in remark for remark in aw.identification.fit_oe(u, y, 1.0, order=2, delay=2).remarks
        )
    assert false <= 1


@pytest.mark.parametrize("seed", [1, 2])
def test_a_held_input_of_a_slow_resonance_is_no_closed_loop(seed):
    """Two poles at 12 rad/s and a delay of 8 rows, 200 a second, with a sensor's noise: no short ARX model whitens it."""
    draw = np.random.default_rng(seed)
    pole = np.exp(12.0 * (-0.15 + 1j * np.sqrt(1.0 - 0.15**2)) / 200.0)
    u, a = np.repeat(draw.standard_normal(400), 10), np.poly([pole, pole.conjugate()]).real
    y = lfilter([0.0] * 8 + [3.0 * a.sum()], a, u)
    y += 0.05 * y.std() * draw.standard_normal(len(y))
    assert not any("closed loop" in remark for remark in aw.identification.frequency_response(u, y, 0.005).remarks)
    short = aw.identification.SubspaceMethod(horizon=6)
    late = aw.identification.fit_n4sid(
        u[:2000], y[:2000], 0.005, order=2, delay=15, method=short
    )  # of a delay that is too long, too
    assert not any("closed loop" in remark for remark in late.remarks)


@pytest.mark.parametrize("seed", range(3))
def test_speed_loop_with_steps_of_its_reference_is_noticed(seed):
    """A PI controller on a motor's measured speed, its reference stepping: the steps hide how it answers to noise."""
    draw = np.random.default_rng(seed)
    rows, pole = 4000, np.exp(-1e-3 / 0.05)
    u, y, speed, integral = np.zeros(rows), np.zeros(rows), 0.0, 0.0
    reference = np.repeat(draw.uniform(-10, 10, rows // 200), 200)
    for k in range(rows):
        y[k] = speed + 0.05 * draw.standard_normal()
        integral += 20.0 * 1e-3 * (reference[k] - y[k])
        u[k] = 0.5 * (reference[k] - y[k]) + integral
        speed = pole * speed + (1 - pole) * 5.0 * u[k]
    remarks = aw.identification.fit_oe(u, y, 1e-3, order=1, delay=1).remarks
    assert any("closed loop" in remark for remark in remarks)
    open_loop = lfilter([0.0, 5.0 * (1 - pole)], [1.0, -pole], reference) + 0.05 * draw.standard_normal(rows)
    remarks = aw.identification.fit_oe(reference, open_loop, 1e-3, order=1, delay=1).remarks
    assert not any("closed loop" in remark for remark in remarks)


@pytest.mark.study
def test_order_and_delay_of_random_systems():
    truth = [random_truth(seed, rows=1200) for seed in range(4)]
    found = [
        aw.identification.fit_oe(t.u, t.y, 1.0, search=OrderSearch("bic" if k else "cv", most_order=4))
        for k, t in enumerate(truth)
    ]
    assert [model.delay for model in found] == [t.delay for t in truth]
    assert all(each.tried for each in found)
    for by in ("aic", "bic", "fpe", "mdl"):
        model = aw.identification.fit_arx(truth[0].u, truth[0].y, 1.0, search=OrderSearch(by))
        assert model.criterion == by
        best = min(model.tried, key=lambda row, by=by: row[by])
        assert model.order == best["na"]


def test_an_input_without_influence_is_not_identified():
    draw = np.random.default_rng(10)
    model = aw.identification.fit_oe(draw.standard_normal(800), draw.standard_normal(800), 1.0, order=1, delay=1)
    assert model.verdict == "not identified"
    assert not model.good
    assert "does not answer" in " ".join(model.remarks)


def test_a_sine_does_not_tell_a_third_order():
    t = np.arange(800)
    u = np.sin(0.1 * t)
    y = lfilter(B, A, u) + 0.01 * np.random.default_rng(0).standard_normal(800)
    model = aw.identification.fit_oe(u[300:], y[300:], 1.0, order=np.int64(3), delay=2)
    assert model.verdict == "not identified"
    assert "cannot be distinguished" in " ".join(model.remarks)
    found = aw.identification.fit_oe(u, y, 1.0, order=1, delay=2, offset=False)
    assert found.verdict == found.sentences()[0] == "identified"
    assert found.good


@pytest.mark.study
def test_beside_sippy():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sippy = pytest.importorskip("sippy_unipi", reason="SIPPY is not installed (extra bench)")
        u, y = bench(11, rows=1000, noise=0.02, offset=0.0)
        ours, theirs = aw.identification.fit_oe(u, y, 1.0, order=2, delay=2, offset=False), {}
        theirs["oe"] = sippy.system_identification(y, u, "OE", OE_orders=[2, 2, 1], tsample=1.0).G
        theirs["arx"] = sippy.system_identification(y, u, "ARX", ARX_orders=[2, 2, 1], tsample=1.0).G
        state = sippy.system_identification(y, u, "N4SID", SS_fixed_order=2, SS_f=15, tsample=1.0)
    f = np.array([0.005, 0.02, 0.1])

    def response(system):
        return np.ravel(system(np.exp(2j * np.pi * f)))

    assert ours.response(f) == pytest.approx(response(theirs["oe"]), rel=5e-3)  # theirs begins at rest
    arx = aw.identification.fit_arx(u, y, 1.0, order=2, delay=2, offset=False)
    assert arx.response(f) == pytest.approx(response(theirs["arx"]), rel=2e-2)
    n4sid = aw.identification.fit_n4sid(u, y, 1.0, order=2, delay=1, method=SubspaceMethod(15))
    assert np.sort(n4sid.poles) == pytest.approx(
        np.sort(np.linalg.eigvals(state.A)), abs=4 * n4sid.pole_std.max() + 0.01
    )


def test_delays_that_the_data_cannot_tell_apart():
    pole = np.exp(-1.0 / np.array([10.0, 15.0, 20.0]))  # three lags in series: the first coefficient is 2 % of the sum
    a = np.poly(pole)
    b = np.concatenate([np.zeros(6), a.sum() * np.array([0.17, 0.66, 0.17])])
    draw = np.random.default_rng(0)
    u = np.repeat(draw.choice([-1.0, 1.0], 300), 5)
    clean, white = lfilter(b, a, u), draw.standard_normal(1500)
    noisy, exact = (aw.identification.fit_oe(u, clean + noise * white, 1.0, order=3) for noise in (0.02, 1e-6))
    assert noisy.delays[0] <= 6 <= noisy.delays[1]
    assert noisy.delays[0] < noisy.delays[1]
    assert any("do not distinguish delays" in remark for remark in noisy.remarks)
    assert (exact.delay, exact.delays) == (6, (6, 6))
    assert not any("do not distinguish delays" in remark for remark in exact.remarks)
    assert aw.identification.fit_oe(u, clean + white, 1.0, order=1, delay=3).delays == (3, 3)


@pytest.mark.study
def test_the_interval_of_delays_allows_for_coloured_noise():
    inside, widths = [], []
    for seed in range(16):
        u, y = bench(seed, rows=800, noise=0.1, colour=tuple(0.8 ** np.arange(20)))
        low, high = aw.identification.fit_oe(u, y, 1.0, order=2, search=OrderSearch("bic")).delays
        inside.append(low <= 2 <= high)
        widths.append(high - low + 1)
    assert np.mean(inside) >= 0.8  # 95 % of 16: below 13 in 1 of 100 tries
    assert np.mean(widths) < 4.0


def test_sampled_systems_follow_from_their_continuous_ones():
    truth = sampled_truth(3, noise=0.0)
    assert np.sum(truth.b) / np.sum(truth.a) == pytest.approx(1.0)
    assert truth.b[truth.delay] != 0.0
    assert not truth.b[: truth.delay].any()
    assert np.abs(np.roots(truth.a)).max() < 1.0

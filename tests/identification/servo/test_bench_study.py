"""Servos on a bench: what fits of simulated and of real logs are worth, beside published parameters."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.identification.servo.bench import PATHS, loop_of, with_arm_mass
from armwright.identification.servo.bench_log import read_bench_log
from armwright.identification.servo.orders import DELAY, OFFSET, Scales, order_of
from armwright.identification.servo.output_error import BenchProblem
from identification.servo.bench_truth import BENCHES, SERVOS, bench_logs, published

pytestmark = pytest.mark.study
NAMES = {path: name for name, path in PATHS.items()} | {OFFSET: OFFSET}


@pytest.fixture(scope="module")
def simulated():
    """Logs of some servos by other code, to fit and held out."""
    return bench_logs(names=FITTED)


def record_numbers(p):
    """Numbers of a record from published ones."""
    return {**p, "coulomb_back": p["coulomb"], "still": p["coulomb"] + p["fall"]}


def errors_of(logs, loop, numbers):
    """Mean absolute errors of logs (logs,) with numbers of a record [rad]."""
    logs = with_arm_mass(logs, None)[0]
    order = order_of("M6", loop, Scales.of(logs), ("offset",))
    problem = BenchProblem(tuple(logs), loop, order)
    known = {
        "gain": loop.p_scale_per_rad,
        "goal_speed": loop.goal_speed_rad_per_s,
        "stribeck_speed": 1.0,
        "exponent": 1.0,
    }
    values = np.array([numbers.get(each, known.get(each, 0.0)) for each in order.columns])
    wrong = np.abs(problem.measured - problem.predictions(values[None])[0])
    return np.array([wrong[part].mean() for part in problem.parts])


def fitted_numbers(fit):
    """Numbers of a record by name."""
    return {
        NAMES[name]: value for name, value in zip(fit.estimate.names, fit.estimate.values, strict=True) if name != DELAY
    }


# Three of seven: tools/servo_bench.py fits them all, and docs/identify-motor.md has what comes of it.
FITTED = ("sts3215", "xl320", "xl330")


def fitted(name, logs, held_out):
    """A fit, held-out errors with its numbers and with the true ones [rad], which true numbers are within 95 %, CPU [s]."""
    loop, true = BENCHES[name].loop, record_numbers(published(BENCHES[name].parameters))
    begin = time.process_time()
    fit = aw.identification.identify_servo(logs, loop, progress=False)
    spent = time.process_time() - begin
    ours, theirs = (errors_of(held_out, loop, each).mean() for each in (fitted_numbers(fit), true))
    found = fit.estimate
    known = [k for k in range(len(found.names)) if np.isfinite(found.std[k])]
    inside = [abs(found.values[k] - true[NAMES[found.names[k]]]) <= 1.96 * found.std[k] for k in known]
    return fit, ours, theirs, inside, spent


def test_simulated_logs_return_their_servo(simulated):
    """Held-out errors at most 1.1 times those of the true numbers, which are within 85 % of the intervals of all together."""
    inside = []
    for name in FITTED:
        _, ours, theirs, covered, _ = fitted(name, *simulated[name])
        assert ours <= 1.1 * theirs, name
        inside += covered
    assert np.mean(inside) >= 0.85


def real_logs(*names):
    paths = [path for name in names for path in sorted((SERVOS / "logs").glob(f"{name}_*.json"))]
    if not paths:
        pytest.skip("the real logs are not here")
    return [read_bench_log(path) for path in paths]


@pytest.mark.parametrize(
    ("fitted", "tested"),
    [
        pytest.param(("xl330_kp100", "xl330_kp200"), ("xl330_kp800",), id="from the lower gains"),
        pytest.param(("xl330_kp800",), ("xl330_kp100", "xl330_kp200"), id="from the highest gain"),
    ],
)
def test_a_fit_of_real_logs_predicts_other_gains(fitted, tested):
    """Better than published parameters, which were fitted to all gains of a possibly other unit, on the same logs."""
    fit, test = aw.identification.identify_servo(real_logs(*fitted), progress=False), real_logs(*tested)
    loop = loop_of(test, None)
    ours = errors_of(test, loop, fitted_numbers(fit)).mean()
    theirs = {each: errors_of(test, loop, record_numbers(published(f"xl330/{each}"))).mean() for each in ("m1", "m6")}
    print(f"fitted to {fitted}: {fit.order}, {ours:.4f} rad on {tested}; published {theirs}")
    assert ours < min(theirs.values())


def test_published_parameters_err_as_their_authors_say():
    """0.068 rad of M6 and 0.082 rad of M1 over 16 logs by BAM's simulator; 12 of them are here."""
    logs = real_logs("xl330")
    loop = loop_of(logs, None)
    for name, error in (("m1", 0.082), ("m6", 0.068)):
        assert errors_of(logs, loop, record_numbers(published(f"xl330/{name}"))).mean() == pytest.approx(error, rel=0.1)


def test_two_logs_of_another_servo_are_described():
    fit = aw.identification.identify_servo(real_logs("sts3250"), progress=False)
    print(f"sts3250: {fit.order}, {fit.error:.4f} rad, {fitted_numbers(fit)}")
    assert fit.error < 0.015
    assert fit.estimate.verdict == "not identified"  # one gain and one load do not determine Kt and R
    assert any(each.startswith("kt ±") for each in fit.sentences())


def test_logs_without_a_sag_are_described_worse():
    """The supply as logged counts: with its mean instead, the same servo predicts its own logs worse."""
    logs = real_logs("xl330_kp800")
    loop = loop_of(logs, None)
    numbers = record_numbers(published("xl330/m6"))
    flat = [replace(each, supply=np.full(len(each.t), 7.4)) for each in logs]
    assert errors_of(flat, loop, numbers).mean() > errors_of(logs, loop, numbers).mean()

"""Black-box models: ARX, OE, ARMAX, subspace models and frequency responses of made signals and of a log."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.signal import lfilter

import armwright as aw
from armwright.identification import LogSignals, OrderSearch, SubspaceMethod
from armwright.identification.linear.held import best_held, continuous, held_polynomials
from armwright.identification.linear.modes import matched, modes, root_gradient
from armwright.identification.linear.prediction_error import Orders, estimate, prediction_errors
from armwright.identification.linear.records import RecordedStretch
from armwright.identification.linear.residuals import cross_correlation, feedback, whiteness
from armwright.identification.linear.state_space import StateSpace, realised, states
from armwright.results.csv_tables import write_table
from frozen.answers import all_refused, beside, real
from frozen.numbers import Case
from identification.linear.random_systems import sampled_truth
from identification.linear.test_n4sid import plant
from identification.linear.test_records import HEAD, data

ident = aw.identification
A, B = np.array([1.0, -1.6, 0.63]), np.array([0.0, 0.0, 0.05, 0.04])
FIELDS = ("values", "covariance", "poles", "pole_std", "zeros", "zero_std", "gain", "gain_std", "delay", "singular")
HERTZ = np.array([0.0, 0.3, 2.0, 11.0])
CLOSE = 1e-4  # of searches that end at a tolerance


def bench(seed=0, rows=500, noise=0.1, colour=(1.0,), b=B, hold=4, offset=3.0):
    """Random levels and what a second-order system with noise makes of them."""
    draw = np.random.default_rng(seed)
    u = np.repeat(draw.choice([-1.0, 1.0], rows // hold), hold)
    return u, lfilter(b, A, u) + offset + noise * lfilter(colour, [1.0], draw.standard_normal(len(u)))


def of(model, u, y):
    """Everything that a model says of itself and of data."""
    model = replace(model, method=model.method)
    return beside(
        model, *FIELDS, simulated=model.simulate(u, y), at_rest=model.simulate(u[:60]), percent=model.fit_percent(u, y),
        response=real(model.response(HERTZ)), delays=model.delays, order=model.order, condition=np.log(model.condition),
    )  # fmt: skip


def fitted(fit, order=2, delay=2, seed=0, noise=0.1, colour=(1.0,), **options):
    u, y = bench(seed, noise=noise, colour=colour)
    return of(fit(u, y, 0.01, order=order, delay=delay, **options), u, y)


def in_runs(fit, **options):
    u, y = bench(7, 700, 0.05)
    parts = [slice(0, 200), slice(230, 420), slice(430, 700)]
    return of(fit([u[each] for each in parts], [y[each] for each in parts], 0.02, **options), u, y)


def searched(fit, by, rows=400, order="auto", delay="auto", **options):
    u, y = bench(3, rows, 0.1)
    model = fit(u, y, 0.01, order=order, delay=delay, search=OrderSearch(by, **options))
    return {"order": model.order, "delays": model.delays, "tried": model.tried, "values": model.values, "model": model}


def lags_in_series():
    """Delays that the noise does not tell apart."""
    a = np.poly(np.exp(-1.0 / np.array([10.0, 15.0, 20.0])))
    b = np.concatenate([np.zeros(6), a.sum() * np.array([0.17, 0.66, 0.17])])
    draw = np.random.default_rng(0)
    u = np.repeat(draw.choice([-1.0, 1.0], 160), 5)
    model = ident.fit_oe(u, lfilter(b, a, u) + 0.02 * draw.standard_normal(800), 1.0, order=3)
    return beside(model, "values", "delays")


def of_feedback():
    """A loop that answers to the noise."""
    draw, rows = np.random.default_rng(9), 1200
    u, y, x = np.zeros(rows), np.zeros(rows), np.zeros(2)
    r, noise = np.repeat(draw.choice([-1.0, 1.0], rows // 8), 8), 0.05 * draw.standard_normal(rows)
    for k in range(rows):
        y[k] = 0.9 * x[0] + 0.1 * x[1] + noise[k]
        u[k] = 4.0 * (0.3 * r[k] - y[k])
        x = np.array([y[k], u[k]])
    fits = (ident.fit_oe, ident.fit_arx, ident.fit_armax, ident.fit_n4sid)
    models = {fit.__name__: fit(u, y, 1.0, order=1, delay=1) for fit in fits}
    return models | {"response": beside(ident.frequency_response(u, y, 1.0, segment=128), "averages")}


def doubtful():
    draw = np.random.default_rng(10)
    u, y = bench(2, 400)
    t = np.arange(400)
    sine = np.sin(0.1 * t)
    steps = np.repeat(draw.choice([-1.0, 1.0], 100), 5)
    summed = lfilter([0.0, 0.01], [1.0, -1.0], steps) + 0.001 * draw.standard_normal(500)
    growing = lfilter([0.0, 0.01], [1.0, -1.02], steps[:300])
    return {
        "no answer": ident.fit_oe(draw.standard_normal(400), draw.standard_normal(400), 1.0, order=1, delay=1),
        "a sine": {"verdict": ident.fit_oe(sine, lfilter(B, A, sine) + 0.01 * y, 1.0, order=3, delay=2).verdict},
        "an integrator": ident.fit_oe(steps, summed, 1.0, order=1, delay=1),
        "unstable": beside(ident.fit_arx(steps[:300], growing, 1.0, order=1, delay=1), "poles"),
        "too early": ident.fit_oe(u, y, 1.0, order=2, delay=4),
        "few coefficients": ident.fit_oe(u, y, 1.0, order=(1, 1), delay=2),
        "few for arx": ident.fit_arx(u, y, 1.0, order=(1, 1), delay=1),
        "few for armax": ident.fit_armax(u, y, 1.0, order=(1, 1, 1), delay=1),
    }


def subspace(rows=500, order=3, noise=0.1, method=None, **options):
    u, y = plant(4, rows, noise)
    model = ident.fit_n4sid(u, y, 0.01, order=order, method=method or SubspaceMethod(direct=True), **options)
    poles = np.sort_complex(model.poles)
    return {
        "model": model, "poles": real(poles), "gain": model.gain, "gain_std": model.gain_std, "fit": model.fit,
        "pole_std": np.sort(model.pole_std), "singular": model.singular, "simulated": model.simulate(u, y),
        "response": real(model.response(HERTZ)), "offset": model.core.offset,
    }  # fmt: skip


def subspace_of_one(**options):
    u, y = bench(5, 600, 0.02)
    model = ident.fit_n4sid(u, y, 0.01, **options)
    return {"model": model, "delay": model.delay, "gain": model.gain, "std": model.gain_std, "tried": model.tried}


def log_of(folder, runs, periods=None):
    """A log of runs by use, of voltage and speed."""
    text = HEAD
    for k, (name, use) in enumerate(runs.items()):
        t, u, y = data(k, rows=300 + 60 * k, period=(periods or {}).get(name, 0.01))
        write_table(folder / f"{name}.csv", {"t": t, "u": u, "y": y})
        text += f'[[runs]]\nname = "{name}"\nfiles.log = "{name}.csv"\nuse = "{use}"\n'
    path = folder / "motor.log.toml"
    path.write_text(text)
    return ident.read_log(path)


def of_a_log(folder):
    log = log_of(folder, {"a": "fit", "b": "fit", "c": "hold-out"})
    model = ident.fit_oe(log, order=1, delay=1, signals=LogSignals("voltage", "qd", "motor"))
    estimate = model.estimate()
    response = ident.frequency_response(log, segment=64)
    return {
        "model": beside(model, *FIELDS), "estimate": beside(estimate, "values", "covariance", "fit"),
        "fits": model.fit, "units": [*model.input_units, *model.output_units, *estimate.units],
        "arx": ident.fit_arx(log, order=1, delay=1).fit, "n4sid": ident.fit_n4sid(log, order=1).fit,
        "response": beside(response, "std", "averages", "units"),
    }  # fmt: skip


def of_several_joints(folder):
    (t, u1, y1), (_, u2, y2) = data(0), data(1)
    keep = np.r_[0:200, 230:600]
    table = {"t": t, "u1": u1, "u2": u2, "y1": y1 + 0.5 * y2, "y2": y2}
    write_table(folder / "a.csv", {name: column[keep] for name, column in table.items()})
    text = HEAD.replace('["motor"]', '["one", "two"]').replace('"u"', '["u1", "u2"]').replace('"y"', '["y1", "y2"]')
    (folder / "two.log.toml").write_text(text + '[[runs]]\nfiles.log = "a.csv"\n')
    log = ident.read_log(folder / "two.log.toml")
    both = ident.fit_n4sid(log, order=2, signals=LogSignals(joint=["one", "two"]))
    second = ident.fit_oe(log, order=1, delay=1, signals=LogSignals(joint="two"))
    crossed = ident.fit_n4sid(log, order=2, signals=LogSignals("voltage", "qd", ["two"]))
    return {"both": both, "gain": both.gain, "second": second, "values": second.values, "crossed": crossed}


@cache
def tachometer():
    u, y = bench(2, 400, 0.0)
    return ident.fit_oe(u, y, 1e-3, order=2, delay=2)


def command(t, r, m):
    return 30.0 * (r.q - m.q) - 4.0 * m.qd


def in_a_loop(sensors=None, controller=command):
    loop = aw.Loop(controller, np.array([0.4, -0.3]), 1e-3, sensors=sensors or aw.Sensors())
    return aw.simulate(aw.Scenario("two-link", 0.1, loop=loop))


def system():
    a = np.array([[0.8, 0.3, 0.0], [-0.3, 0.8, 0.1], [0.0, 0.0, 0.5]])
    b, c = np.array([[1.0, 0.0], [0.5, 2.0], [0.3, 0.1]]), np.array([[1.0, 0.0, 0.5], [0.0, 1.0, -1.0]])
    model = StateSpace(a, b, c, np.array([[0.2, 0.0], [0.0, 0.0]]), np.array([4.0, -7.0]), 0.01)
    u = np.random.default_rng(0).standard_normal((80, 2))
    defective = np.array([[0.9, 1.0], [0.0, 0.9]])
    return {
        "poles": real(np.sort_complex(model.poles)), "gain": model.gain, "response": real(model.response(HERTZ)),
        "simulated": model.simulate(u), "from a start": model.simulate(u, np.array([1.0, -2.0, 3.0])),
        "states": states(defective, b[:2], u, np.array([1.0, -2.0])),
        "realised": realised(np.array([1.0, -1.2, 0.5]), np.array([0.0, 0.0, 0.3, -0.1]), 2.0, 0.1).simulate(u[:, :1]),
    }  # fmt: skip


def roots():
    a = np.poly([0.9 * np.exp(0.3j), 0.9 * np.exp(-0.3j), 0.7, -0.2, 1.05, 1.0]).real
    root = np.random.default_rng(0).standard_normal((6, 6))
    found, gradient = root_gradient(a)
    order = np.argsort(np.round(found.real, 8) + 1e-3 * found.imag)
    named = modes(found, gradient, 1e-8 * root @ root.T, 0.01)
    return {
        "roots": real(found[order]), "gradient": real(gradient[order]),
        "modes": sorted(named, key=lambda each: each.name),
        "matched": real(matched(found[order], found[order][::-1] + 0.01)),
    }  # fmt: skip


def held():
    p = np.real(np.poly([-0.1, -0.2 + 0.3j, -0.2 - 0.3j]))[1:]
    a, b = held_polynomials(p)
    truth = sampled_truth(3, rows=500, noise=0.02)
    stretches = [RecordedStretch("", truth.u[:, None], truth.y[:, None])]
    free = estimate(Orders("oe", truth.order, 1, 0, truth.delay + 1, True), stretches, truth.delay + 6, True)
    best = best_held(free, stretches, truth.delay + 6, True)
    return {
        "a": a, "b": b, "back": continuous(a), "several": held_polynomials(np.stack([p, 2.0 * p]))[1],
        "delay": best and best.fit.orders.delay, "zeros": best and best.zeros, "cost": best and best.fit.cost,
        "poles": best and best.poles,
    }  # fmt: skip


def tests_of_errors():
    u, y = bench(4, 400, 0.1)
    errors = [lfilter([1.0], [1.0, -0.6], np.random.default_rng(1).standard_normal(200)) for _ in range(2)]
    stretches = [RecordedStretch("", u[:, None], y[:, None])]
    polynomials = Orders("armax", 2, 2, 1, 2, True).polynomials(np.array([-1.5, 0.6, 0.05, 0.04, 0.3, 0.4]))
    return {
        "white": whiteness(errors[0]), "cross": cross_correlation(errors, [u[:200], u[200:]], 20),
        "before": cross_correlation(errors, [u[:200], u[200:]], -20), "feedback": feedback(stretches, 2),
        "errors": prediction_errors(polynomials, stretches[0], 3, True),
        "errors as measured": prediction_errors(polynomials, stretches[0], 3, False),
    }  # fmt: skip


def responses():
    draw = np.random.default_rng(0)
    u = draw.standard_normal(1500)
    y = lfilter([0.0, 0.2], [1.0, -0.8], u) + 0.05 * draw.standard_normal(1500)
    period = np.tile(draw.choice([-1.0, 1.0], 64), 8)
    again = lfilter([0.0, 0.2], [1.0, -0.8], period) + 0.1 * draw.standard_normal(512)
    t = np.arange(1000)
    lines = sum(np.cos(2 * np.pi * k * t / 200 + k) for k in (3, 7, 20, 45))
    calls = {
        "usual": ((u, y, 0.01), {}), "segments": ((u, y, 0.01), {"segment": 100}),
        "runs": (([u[:700], u[720:]], [y[:700], y[720:]], 0.01), {"segment": 90}),
        "by times": ((u[:300], y[:300], 0.02 * np.arange(300)), {"segment": 50}),
        "periodic": ((period, again, 0.01), {}), "as asked": ((period, again, 0.01), {"repeats": 128}),
        "multisine": ((lines, lfilter([0.0, 0.2], [1.0, -0.8], lines) + 12.0, 0.005), {}),
    }  # fmt: skip
    found = {name: ident.frequency_response(*each, **options) for name, (each, options) in calls.items()}
    return {
        name: beside(
            each, "frequency", "response", "coherence", "std", "averages", radius=each.radius(0.9), band=each.band()
        )
        for name, each in found.items()
    }


def refusals(folder):
    t, u, y = data()
    oe = ident.fit_oe
    two = log_of(folder, {"a": "fit", "b": "fit"}, {"b": 0.02})
    return all_refused({
        "not a number": lambda: oe(u, np.where(np.arange(600) == 7, np.nan, y), 0.01),
        "constant input": lambda: oe(np.full(600, 2.0), y, 0.01), "constant output": lambda: oe(u, 0 * y + 2.0, 0.01),
        "few rows": lambda: oe(u[:40], y[:40], 0.01, order=5), "few to hold out": lambda: oe(u[:150], y[:150], 0.01),
        "just enough": lambda: oe(u[:64], y[:64], 0.01, order=5, delay=1),
        "gap": lambda: oe(u, y, np.where(t > 3, t + 1, t)),
        "period": lambda: oe(u, y, -1.0), "no period": lambda: oe(u, y), "rows": lambda: oe(u, y[:-1], 0.01),
        "runs": lambda: oe([u, u], [y], 0.01), "text": lambda: oe(["a"], y, 0.01),
        "absurd": lambda: oe(u, y * 1e200, 0.01),
        "complex": lambda: oe(u * 1j, y, 0.01), "empty": lambda: oe([], [], 0.01),
        "order": lambda: oe(u, y, 0.01, order=0),
        "orders": lambda: oe(u, y, 0.01, order=(1, 2, 3)), "delay": lambda: oe(u, y, 0.01, delay=-1),
        "two inputs": lambda: oe(np.stack([u, u[::-1]], 1), y, 0.01), "two clocks": lambda: oe(two),
        "input": lambda: oe(two, signals=LogSignals("volts")),
        "output": lambda: oe(two, signals=LogSignals(output="q")),
        "joint": lambda: oe(two, signals=LogSignals(joint="elbow")),
        "segment": lambda: ident.frequency_response(u, y, 1.0, segment=301),
        "two": lambda: ident.frequency_response(u, y, 1.0, segment=2),
        "repeats": lambda: ident.frequency_response(u, y, 1.0, repeats=301),
        "sine": lambda: ident.fit_n4sid(np.sin(0.1 * t), np.sin(0.1 * t + 1), 1.0, order=2, delay=1),
        "states": lambda: ident.fit_n4sid(u, y, 0.01, order=9, method=SubspaceMethod(8)),
        "early": lambda: ident.fit_n4sid(u, y, 0.01, order=1, delay=0), "horizon": lambda: SubspaceMethod(0),
        "weighting": lambda: SubspaceMethod(weighting="n4sid"), "select": lambda: OrderSearch("best"),
        "most order": lambda: OrderSearch(most_order=0), "most delay": lambda: OrderSearch(most_delay=-1),
    }, folder)  # fmt: skip


CASES = {
    "arx": lambda _: fitted(ident.fit_arx), "arx of unequal orders": lambda _: fitted(ident.fit_arx, (2, 3)),
    "arx without offset": lambda _: fitted(ident.fit_arx, offset=False),
    "arx of exact data": Case(lambda _: fitted(ident.fit_arx, noise=0.0), 1e-5, ("cov", "std", "cond", "±", "RMS")),
    "oe": Case(lambda _: fitted(ident.fit_oe), CLOSE),
    "oe of unequal orders": Case(lambda _: fitted(ident.fit_oe, (2, 1)), CLOSE),
    "oe as measured": Case(lambda _: fitted(ident.fit_oe, initial=False), CLOSE),
    "oe without offset": Case(lambda _: fitted(ident.fit_oe, offset=False, order=1), CLOSE),
    "oe of coloured noise": Case(lambda _: fitted(ident.fit_oe, colour=tuple(0.8 ** np.arange(20))), CLOSE),
    "oe at once": Case(lambda _: fitted(ident.fit_oe, 1, 0), CLOSE),
    "oe of third order": Case(lambda _: fitted(ident.fit_oe, 3), 1e-3),
    "armax": Case(lambda _: fitted(ident.fit_armax, colour=(1.0, 0.6, 0.2)), CLOSE),
    "armax of unequal orders": Case(lambda _: fitted(ident.fit_armax, (2, 1, 1), initial=False), CLOSE),
    "arx in runs": lambda _: in_runs(ident.fit_arx, order=2, delay=2),
    "oe in runs": Case(lambda _: in_runs(ident.fit_oe, order=2, delay=2), CLOSE),
    "n4sid in runs": Case(lambda _: in_runs(ident.fit_n4sid, order=2, delay=2), CLOSE),
    **{
        f"arx by {by}": Case(lambda _, by=by: searched(ident.fit_arx, by, most_order=3, most_delay=6), CLOSE)
        for by in ("cv", "aic", "bic", "fpe", "mdl")
    },
    "oe by bic": Case(lambda _: searched(ident.fit_oe, "bic", 300, most_order=2, most_delay=4), CLOSE),
    "oe of known order": Case(lambda _: searched(ident.fit_oe, "bic", 300, order=2, most_delay=5), CLOSE),
    "oe of known delay": Case(lambda _: searched(ident.fit_oe, "cv", 400, delay=2, most_order=2), CLOSE),
    "armax by aic": Case(lambda _: searched(ident.fit_armax, "aic", 300, most_order=1, most_delay=3), CLOSE),
    "delays alike": Case(lambda _: lags_in_series(), 1e-3), "feedback": Case(lambda _: of_feedback(), CLOSE),
    "doubts": Case(lambda _: doubtful(), 1e-3, ("± std", "RMS", "unstable.result.sentences")),
    "n4sid": Case(lambda _: subspace(), CLOSE), "n4sid of two states": Case(lambda _: subspace(order=2), CLOSE),
    "n4sid by moesp": Case(lambda _: subspace(method=SubspaceMethod(8, "moesp", True)), CLOSE),
    "n4sid without D": Case(lambda _: subspace(method=SubspaceMethod(), initial=False), CLOSE),
    "n4sid by cv": Case(lambda _: subspace_of_one(search=OrderSearch("cv", 3, 6)), CLOSE),
    "n4sid by bic": Case(lambda _: subspace_of_one(search=OrderSearch("bic", 4), delay=2), CLOSE),
    "n4sid of a short horizon": Case(
        lambda _: subspace_of_one(search=OrderSearch("bic", 6), delay=2, method=SubspaceMethod(4)), CLOSE
    ),
    "n4sid of one": Case(lambda _: subspace_of_one(order=2, initial=False), CLOSE),
    "log": Case(of_a_log, CLOSE, ("sha", "estimate.result.sentences")),
    "several joints": Case(of_several_joints, CLOSE),
    "sensor": Case(lambda _: in_a_loop([aw.Sensors(), tachometer().sensor(of="qd", name="tacho", unit="V")]), CLOSE),
    "actuator": Case(lambda _: in_a_loop(controller=tachometer().actuator(command)), CLOSE),
    "state space": lambda _: system(), "roots": Case(lambda _: roots(), 1e-5),
    "held input": Case(lambda _: held(), 1e-3),
    "errors": lambda _: tests_of_errors(), "frequency responses": Case(lambda _: responses(), 1e-5),
    "refusals": refusals,
}  # fmt: skip

"""Parameters of arms from logs: every method, friction, gear loss and what fits of damaged logs say."""

from __future__ import annotations

from functools import cache

import numpy as np

import armwright as aw
from armwright.identification import ArmTerms, FitRows
from armwright.identification.arm.closed_loop import Feedback
from armwright.identification.arm.methods import METHODS
from armwright.model import build_model
from frozen.answers import all_refused, record, shared_folder
from frozen.numbers import Case
from identification.arm.moved_arm import moved, multisine, written_log
from identification.arm.test_closed_loop import KD, KP, PERIOD, loop_of, reference
from identification.arm.test_hold_out import FRICTION, STRIBECK
from identification.arm.two_runs import two_runs
from identification.logs.example_logs import written

ident = aw.identification
CLOSE = 1e-4
ESTIMATE = ("values", "covariance", "condition", "fit", "at_bound", "identifiable")
IGNORED = ("sha", "version", "method")
PLAIN = FitRows(cutoff=20.0, decimate=2)


@cache
def arm_with(name="two-link", **friction):
    """A built-in arm with friction at its joints."""
    rows = aw.load(name).record
    law = {**FRICTION, **friction}
    return build_model(rows.replace(joints=tuple(each.replace(friction=law) for each in rows.joints)))


@cache
def log_of(which="plain", **options):
    """A log of the arm of two links with friction, or with something else."""
    folder = shared_folder(f"{which}{len(options)}{sorted(options.items())}".replace("/", ""))
    arms = {
        "plain": arm_with, "stribeck": lambda: arm_with(**STRIBECK), "six": lambda: aw.load("lwa4p"),
        "sliding": lambda: aw.load("cmu-dd"), "asymmetric": lambda: arm_with(coulomb_negative_n_m=2.0),
    }  # fmt: skip
    given = {"seconds": 12.0, "rate": 200.0, "torque_noise": 0.1, "position_noise": 1e-5} | options
    return moved(folder, "log", arms[which](), **given)


@cache
def looped():
    """A log of a loop with noisy encoders."""
    arm, start = aw.load("two-link"), aw.Start(*(each[0] for each in reference(np.zeros(1))[:2]))
    run = aw.simulate(aw.Scenario(arm, duration=2.0, loop=loop_of(3e-4), start=start, lanes=range(2), seed=3))
    t, q, tau = run["time"].values, run["q_measured"].values[0], run["tau"].values[0]
    tau = 0.5 * (tau + np.concatenate([tau[:1], tau[:-1]]))
    return written_log(shared_folder("looped"), "loop", arm.names, t, q, tau)


def all_of(found):
    """Everything that a fit of an arm says and keeps."""
    fit, curve, physical = found.fit, found.cutoffs, found.record
    parts = {
        "estimate": {name: getattr(found.estimate, name) for name in ESTIMATE}, "remarks": list(found.estimate.remarks),
        "rms": fit.rms, "torque_rms": fit.torque_rms, "r2": fit.r2, "weights": fit.weights, "freedom": fit.freedom,
        "part_effect": fit.part_effect, "names": list(found.estimate.names), "formulas": list(found.formulas),
        "structural": found.structural, "sensitive": list(found.sensitive), "held_out": found.held_out, "std": fit.std,
        "preparation": {key: each for key, each in found.estimate.preparation.items() if not isinstance(each, str)},
        "bootstrap": found.bootstrap, "curve": None if curve is None else [curve.hz, curve.chosen, curve.reason],
        "record": None if physical is None else [physical.values, physical.kept, physical.r2, physical.physical.at_bound],
        "outliers": None if fit.outliers is None else fit.outliers.dropped, "hold_out": found.hold_out,
    }  # fmt: skip
    return {"result": found} | parts


def fitted(log, arm=None, **options):
    given = {"rows": PLAIN, "checks": (), "record": False} | options
    return all_of(ident.identify_arm(log, aw.load("two-link") if arm is None else arm, **given))


def by_method(method, **more):
    """A fit of the loop's log by a method."""
    feedback = Feedback(reference, KP, KD, PERIOD, begin=0.0, speed="difference")
    options = {"friction": (), "terms": ArmTerms(lacks=("rotors",)), "feedback": feedback} | more
    return fitted(looped(), aw.load("two-link").replace(rotors=None), method=method, **options)


def whole(folder):
    """The default fit with all checks, and its record."""
    log, arm = log_of(), aw.load("two-link")
    found = ident.identify_arm(log, arm, checks=("cutoff", "bootstrap"))
    path = found.write(folder / "found.toml", key="own")
    q = np.random.default_rng(9).uniform(-1, 1, (3, 8, 2))
    return all_of(found) | {"torque": aw.compile(path).inverse_dynamics(*q), "written": record(path)["joints"]}


def held_out(folder):
    """A fit that a second run judges, and what the record then says."""
    log = ident.read_log(two_runs(folder, arm_with(**STRIBECK), seconds=12.0))
    found = ident.identify_arm(log, aw.load("two-link"), checks=())
    path = found.write(folder / "found.toml")
    verdict = ident.validate(path, log, simulation=False)
    return all_of(found) | {"validation": verdict, "fits": record(path)["fits"]["fit"]["measures"]}


def of_six(folder):
    """Six joints, of which two rest for the whole log."""
    t, q, qd, qdd = multisine(6, 10.0, 100.0, 3, np.array([0.5, 0.5, 0.0, 0.5, 0.0, 0.5]), 5)
    arm = aw.load("lwa4p")
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    tau += 0.1 * np.random.default_rng(1).normal(size=tau.shape)
    log = written_log(folder, "rests", arm.names, t, q, tau)
    found = fitted(log, arm, rows=FitRows(cutoff=10.0), friction=("viscous", "asymmetric"))
    return found | {"record": None}


def damaged(change, **options):
    """A fit of a log with a mistake, and what it says of it."""

    def case(folder):
        arm = arm_with()
        t, q, qd, qdd = multisine(2, 12.0, 200.0, 5)
        tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
        tau = tau + 0.1 * np.random.default_rng(6).normal(size=tau.shape)
        q, tau = change(t, q, tau)
        written_log(folder, "damaged", arm.names, t, q, abs(tau))  # a sign that is wrong is no error here
        np.savetxt(
            folder / "damaged.csv", np.c_[t, q, tau], delimiter=",", header="t,q0,q1,u0,u1", comments="", fmt="%.12g"
        )
        log = ident.read_log(folder / "damaged.log.toml", on_error="keep")
        return fitted(log, arm, **options)

    return case


def wild(t, q, tau):
    draw = np.random.default_rng(7)
    return q, tau + (draw.random(tau.shape) < 0.01) * 40.0 * draw.normal(size=tau.shape)


def drifting(t, q, tau):
    slow = tau.copy()
    slow[:, 1] += 0.4 * (t / t[-1]) * np.sign(np.gradient(q[:, 1]))
    return q, slow


def late(t, q, tau):
    return q, np.stack([np.interp(t - 0.01, t, tau[:, 0]), tau[:, 1]], axis=1)


def cut_off(t, q, tau):
    return q, np.clip(tau, -0.5 * np.abs(tau).max(axis=0), 0.5 * np.abs(tau).max(axis=0))


MISTAKES = {
    "wrong sign": lambda t, q, tau: (q, -tau), "one wrong sign": lambda t, q, tau: (q, tau * [1.0, -1.0]),
    "torque scale": lambda t, q, tau: (q, tau * [1.0, 1.2]), "position scale": lambda t, q, tau: (q * [1.1, 1.0], tau),
    "zero": lambda t, q, tau: (q + np.array([0.0, 0.3]), tau), "exchanged": lambda t, q, tau: (q, tau[:, ::-1]), "late": late,
    "drift": drifting, "outliers": wild, "cut off": cut_off, "noise": lambda t, q,
    tau: (q, tau + 9 * np.cos(1e4 * tau)),
}  # fmt: skip


SMALL = {
    "torque scale": lambda t, q, tau: (q, tau * [1.0, 1.075]), "position scale": lambda t, q, tau: (q * [1.03, 1.0], tau),
    "zero": lambda t, q, tau: (q + np.array([0.0, 0.03]), tau),
    "late": lambda t, q, tau: (q, np.stack([np.interp(t - 0.003, t, each) for each in tau.T], axis=1)),
    "drift": lambda t, q, tau: (q, tau + 0.15 * (t / t[-1])[:, None] * np.sign(np.gradient(q, axis=0))),
}  # fmt: skip


def in_current(folder):
    """Fits of currents and of voltages of an arm whose motors have constants."""
    arm = aw.load("cmu-dd")
    t, q, qd, qdd = multisine(6, 8.0, 100.0, 2, 0.5)
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    gears = np.array([float(each.drive.gear_ratio) for each in arm.coordinates])
    kt = np.array([float(each.drive.torque_constant) for each in arm.coordinates])
    resistance = np.array([float(each.drive.resistance) for each in arm.coordinates])
    current = tau / (gears * kt)
    volts = resistance * current + gears * kt * qd
    noise = 0.01 * np.random.default_rng(3).normal(size=tau.shape)
    found = {}
    for quantity, values in (("current", current), ("voltage", volts)):
        log = written_log(folder, quantity, arm.names, t, q, values + noise * values.std(axis=0), quantity)
        found[quantity] = fitted(log, arm, rows=FitRows(cutoff=10.0, decimate=3))
    return found


def refusals(folder):
    log, two = log_of(), aw.load("two-link")
    none = ident.read_log(written(folder, _NO_TORQUE), on_error="keep")

    def fit(of=log, arm=two, **options):
        return lambda: ident.identify_arm(of, arm, **options)

    return all_refused({
        "method": fit(method="lsq"), "check": fit(checks=("all",)), "friction": fit(friction=("sticky",)),
        "no arm": fit(arm=None), "arm": fit(arm=aw.load("puma560")), "runs": fit(rows=FitRows(runs=["b"])),
        "cutoff": fit(rows=FitRows(cutoff=100.0)), "decimate": fit(rows=FitRows(cutoff=20.0, decimate=9)),
        "spring": fit(terms=ArmTerms(springs=("wrist",))), "lacks": fit(terms=ArmTerms(lacks=("wind",))),
        "efficiency": fit(terms=ArmTerms(fit_efficiency=("elbow",))), "stribeck": fit(friction=("stribeck",)),
        "forgetting": fit(method="recursive", forgetting=1.1), "short memory": fit(method="recursive", forgetting=0.5),
        "feedback": fit(method="iv"), "bootstrap": fit(method="irls", checks=("bootstrap",)), "torque": fit(none),
        "rows": lambda: FitRows(runs="a"), "names": lambda: ArmTerms(springs="elbow"),
        "options": fit(rows=3, terms=None),
        "terms": fit(terms={"springs": ()}),
    }, folder)  # fmt: skip


_NO_TORQUE = """
joints = ["shoulder", "elbow"]
[files.arm]
path = "arm.csv"
[time]
column = "t"
unit = "s"
[[signals]]
quantity = "position"
columns = ["q1", "q2"]
unit = "rad"
side = "joint"
"""


def case(call, close=CLOSE, ignored=(), study=False):
    return Case(lambda folder: call(folder), close, (*IGNORED, *ignored), study)


CASES = {
    **{
        f"by {method}": case(lambda _, method=method: by_method(method), 1e-3 if method in ("cloe", "didim", "iv") else CLOSE)
        for method in METHODS
        if method not in ("cloe", "didim")  # which take seconds
    },
    "by recursive, forgetting": case(lambda _: by_method("recursive", forgetting=0.999)),
    "by iv of gains": case(lambda _: by_method("iv", feedback=(KP, KD, PERIOD)), 1e-3),
    "whole": case(whole, 1e-3, study=True), "held out": case(held_out, 1e-3), "six joints": case(of_six),
    "currents and voltages": case(in_current),
    "no friction": case(lambda _: fitted(log_of(), friction=())),
    "viscous": case(lambda _: fitted(log_of(), friction=("viscous",))),
    "asymmetric": case(lambda _: fitted(log_of("asymmetric"), friction=("viscous", "asymmetric"), record=True), 1e-3),
    "stribeck": case(
        lambda _: fitted(log_of("stribeck"), friction=("viscous", "coulomb", "stribeck"), terms=ArmTerms(stribeck_speed=0.3))
    ),
    "springs": case(lambda _: fitted(log_of(), terms=ArmTerms(springs=("elbow", "shoulder")), record=True), 1e-3),
    "lacks gravity": case(lambda _: fitted(log_of(), terms=ArmTerms(lacks=("gravity", "viscous")))),
    "lacks rotors": case(lambda _: fitted(log_of(), terms=ArmTerms(lacks=("rotors", "offset")))),
    "chosen cut-off": case(lambda _: fitted(log_of(), rows=FitRows(), checks=("cutoff",)), 1e-3),
    "irls of wild torques": case(damaged(wild, method="irls")),
    "tukey of wild torques": case(damaged(wild, method="tukey")),
    **{f"damaged: {name}": case(damaged(change, record=name == "wrong sign"), 1e-3) for name, change in MISTAKES.items()},
    **{f"slightly damaged: {name}": case(damaged(change), 1e-3) for name, change in SMALL.items()},
    "refusals": refusals,
}  # fmt: skip

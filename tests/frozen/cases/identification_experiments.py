"""Experiments that are designed and compared, and links that are weighed."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

import armwright as aw
from armwright.identification.experiments.columns import DRIVES, BaseRegressor
from armwright.identification.experiments.expected import (
    deviations,
    experiments_that_separate,
    joints_that_separate,
    weak_directions,
)
from armwright.identification.experiments.information import condition_number
from armwright.identification.experiments.limits import excitation_limits
from armwright.trajectory import Fourier
from frozen.answers import all_refused, beside, record, table
from frozen.numbers import Case
from physics.arms import arm

ident = aw.identification
GUESS = ident.MotorGuess(gain=12.0, time_constant=0.05, most=12.0)
NARROW = {
    "free": GUESS, "dead zone": replace(GUESS, dead_zone=0.3), "slow": replace(GUESS, speed=60.0),
    "near": replace(GUESS, travel=6.0, unit="A", joint="elbow"),
}  # fmt: skip
BOTH = Fourier.at_rest(
    [0.2, -0.3], [[0.5, 0.2, -0.3], [-0.4, 0.6, 0.2]], [[0.2, -0.4, 0.3], [0.5, 0.1, -0.3]], 4.0, cycles=1
)
ONE = Fourier.at_rest([0.2, -0.3], [[0.5, 0.2, -0.3], [0, 0, 0]], [[0.2, -0.4, 0.3], [0, 0, 0]], 4.0, cycles=1)
AXES = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]]


def played(kind, guess, folder, **options):
    """A command, what it is expected to do, and its file."""
    found = ident.motor_experiment(kind, guess, **options)
    speed, angle = guess.response(found.values, found.period)
    return {
        "text": str(found), "values": found.values, "period": found.period, "duration": found.duration,
        "crest": found.crest,
        "times": found.times, "speed": speed, "angle": angle, "schedule": found.schedule.at(0.4 * found.duration),
        "file": table(found.save(folder / "experiment.csv")), "corner": guess.corner_hz,
    }  # fmt: skip


def guesses():
    """What the records of drives say."""
    model = arm("cmu-dd")
    pose = np.linspace(0.1, 0.6, model.n)
    return {
        "first": ident.MotorGuess.of(model), "third": ident.MotorGuess.of(model, model.names[2], pose),
        "of a supply": ident.MotorGuess.of(model, model.names[1], most=9.0),
    }  # fmt: skip


def limits_of(model, **most):
    return aw.trajectories.MotionLimits.of(model, **most)


@cache
def designed(criterion="condition", name="two-link", **options):
    most = options.pop("most", (("velocity", (2.0, 3.0)), ("torque", (60.0, 30.0)), ("position", 2.5)))
    model = arm(name)
    given = {"cycle": 4.0, "harmonics": 3, "starts": 2} | options
    return ident.design_excitation(
        model, criterion=criterion, limits=limits_of(model, **{key: np.asarray(each) for key, each in most}), **given
    )


def bounds():
    """Limits of designs that records and callers state."""
    panda = arm("panda")
    some = {
        "two-link": excitation_limits(arm("two-link"), limits_of(arm("two-link"), velocity=[1.0, 2.0], position=1.0)),
        "panda": excitation_limits(panda, limits_of(panda)),
        "box": excitation_limits(arm("puma560"), limits_of(arm("puma560"), velocity=2.0), [[-1, -2, 0], [1, 2, 1.5]]),
        "voltage": excitation_limits(arm("cmu-dd"), limits_of(arm("cmu-dd"), velocity=3.0, acceleration=9.0)),
    }
    return {
        name: {
            "low": each.low, "high": each.high, "middle": each.middle, "most": each.most, "box": each.box,
            "has": each.has_box,
            "names": list(each.used_names), "reasons": list(each.reasons),
            "bounded": {quantity: each.bounded(quantity) for quantity in each.most},
        }
        for name, each in some.items()
    }  # fmt: skip


def regressor(drives=DRIVES, name="two-link"):
    return BaseRegressor.of(arm(name), drives, np.full(arm(name).n, 1e-3))


def rows_of(drives, name="two-link"):
    model = regressor(drives, name)
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 6, arm(name).n))
    information = model.information(q, qd, qdd)
    return {
        "rows": model.rows(q, qd, qdd), "information": information,
        "condition": condition_number(information + np.eye(len(information))),
        "condition si": condition_number(information + np.eye(len(information)), "none"),
    }  # fmt: skip


def compared():
    given = {"both": BOTH, "one": ONE}
    calls = {
        "all": ident.compare_experiments(given, arm=arm("two-link"), noise=[0.5, 0.2], rate=50.0),
        "one": ident.compare_experiments({"one": ONE}, arm=arm("two-link"), noise=0.5, drives=("viscous", "offset")),
        "two": ident.compare_experiments(given, arm=arm("two-link"), noise=0.1, rate=20.0, drives=()),
    }
    return {
        name: beside(each, "best", "remarks", std=[one.std for one in each.experiments.values()])
        for name, each in calls.items()
    }


def compared_scenarios():
    model = arm("cmu-dd").with_locked(dict.fromkeys(arm("cmu-dd").names[1:], 0.0))
    joint = model.names[0]
    by = [f"{joint}.motor.resistance_ohm", f"{joint}.motor.torque_constant_n_m_per_a"]
    solver = aw.Solver(integrator="rk4", step=1e-3)
    runs = {
        name: aw.Scenario(model, duration=time, command=[20.0], solver=solver)
        for name, time in (("short", 0.05), ("long", 0.3))
    }
    found = ident.compare_experiments(runs, by=by, noise={"qd": 0.01, "q": 0.002})
    return beside(found, "best", "remarks", std=[one.std for one in found.experiments.values()])


def told():
    """Directions that experiments show, and sentences on what would show more."""
    names = ["R", "Kt", "J", "f"]
    jacobian = np.array([[1.0, -2.0, 0.0, 0.0], [1.0, -2.0, 1.0, 0.0], [1.0, -2.0, 0.0, 1.0]])
    log, current = jacobian.T @ jacobian, np.diag([0.0, 4.0, 0.0, 0.0])
    strong = log + 1e-5 * np.eye(4)
    t = np.linspace(0.0, 4.0, 80)
    still = regressor().information(*ONE.at(t))
    return {
        "deviations": [deviations(each) for each in (log, log + current, strong)],
        "weak": [[each.shown for each in weak_directions(which)] for which in (log, log + current, strong)],
        "sentences": [
            *experiments_that_separate(names, log, {"more of the same": log, "a current": current}),
            *experiments_that_separate(names, log, {"more of the same": log}),
            *experiments_that_separate(names, log + current, {}),
            *experiments_that_separate(names, strong, {"a current": current}),
        ],
        "joints": joints_that_separate(regressor(), still, len(t)),
        "joints of both": joints_that_separate(regressor(), regressor().information(*BOTH.at(t)), len(t)),
    }  # fmt: skip


def tensors():
    points = np.random.default_rng(3).normal(size=(20, 3)) * [0.1, 0.05, 0.03]
    tensor = 0.2 * (np.trace(points.T @ points) * np.eye(3) - points.T @ points)
    u = np.array(AXES) / np.linalg.norm(AXES, axis=1, keepdims=True)
    moments = np.einsum("ki,ij,kj->k", u, tensor, u)
    rough = [(float(m), 0.02 * float(m)) for m in moments * (1 + 0.01 * np.cos(np.arange(7.0)))]
    found = {"exact": (AXES[:6], list(moments[:6])), "seven": (AXES, rough), "six": (AXES[:6], rough[:6])}
    named = ident.measured_tensor(AXES[:6], [ident.measured_inertia_bifilar((1.5, 0.01), 2.0, 1.0, 0.3)] * 6)
    tensors = {key: ident.measured_tensor(*each) for key, each in found.items()} | {"of measured": named}
    return {key: beside(each, "values", "covariance", "remarks", "condition") for key, each in tensors.items()}


def weighed():
    """Numbers by scale, supports and pendulums."""
    mass = ident.measured_mass([2.61, 2.614, 2.612], scale_std=0.002, resolution=0.001, tare=(0.3, 0.001))
    numbers = {
        "mass": mass, "one mass": ident.measured_mass([1.0]), "coarse": ident.measured_mass([1.0, 1.0], resolution=0.1),
        "tare": ident.measured_mass([1.5], tare=0.25),
        "centre": ident.measured_centre((1.05, 0.002), (0.4, 0.001), (2.3, 0.004)),
        "centre from an origin": ident.measured_centre(1.05, (0.4, 0.001), (2.3, 0.004), origin=(-0.05, 0.002)),
        "pendulum": ident.measured_inertia_pendulum((1.18, 0.002), (2.3, 0.004), (0.21, 0.0006)),
        "wide swing": ident.measured_inertia_pendulum((1.18, 0.002), 2.3, (0.21, 0.0006), amplitude=0.4, gravity=9.7),
        "bifilar": ident.measured_inertia_bifilar((1.5, 0.004), (2.3, 0.004), (1.2, 0.003), (0.3, 0.001)),
        "two spacings": ident.measured_inertia_bifilar((1.5, 0.004), 2.3, 1.2, 0.3, spacing_top=(0.22, 0.002), gravity=9.7),
    }  # fmt: skip
    return {key: beside(each, "value", "std", "interval", "readings", "unit", "how") for key, each in numbers.items()}


def written(folder):
    """Records with weighed numbers, and what their arms weigh."""
    one = {"mass": ident.measured_mass([2.5], scale_std=0.01)}
    more = {
        "com_x": ident.measured_centre((1.5, 0.001), 0.2, 3.0), "com_y": ident.measured_centre((0.1, 0.001), 0.2, 3.0),
        "izz": ident.measured_inertia_pendulum((1.4954, 1e-3), 3.0, 0.2),
    }  # fmt: skip
    paths = [
        ident.write_measured("two-link", "forearm", one, folder / "one.toml", key="scales"),
        ident.write_measured(arm("two-link"), "forearm", more, folder / "more.toml"),
        ident.write_measured("two-link", "forearm", _tensor(), folder / "tensor.toml"),
    ]
    q = np.array([[0.1, 0.2], [0.7, -0.4]])
    return {path.stem: aw.compile(path).inverse_dynamics(q, 2 * q, -q) for path in paths} | {"text": record(paths[1])}


def _tensor():
    moments = [(0.1 + 0.01 * k, 1e-3) for k in (0, 1, 2)] + [(0.105, 1e-3), (0.11, 1e-3), (0.115, 1e-3)]
    return ident.measured_tensor(AXES[:6], moments)


def refusals(folder):
    two, mass = arm("two-link"), ident.measured_mass([1.0])
    swing = {"velocity": 1.0}

    def design(**options):
        most = {name: options.pop(name) for name in ("velocity", "position", "torque") if name in options}
        return lambda: ident.design_excitation(two, limits=limits_of(two, **most), **options)

    return all_refused({
        "gain": lambda: ident.MotorGuess(0.0, 0.05, 12.0), "constant": lambda: ident.MotorGuess(1.0, np.inf, 12.0),
        "zone": lambda: ident.MotorGuess(1.0, 0.1, 12.0, dead_zone=-1.0),
        "wide zone": lambda: ident.MotorGuess(1.0, 0.1, 12.0, dead_zone=7.0),
        "most": lambda: ident.MotorGuess(1.0, 0.1, -1.0),
        "edge of the zone": lambda: ident.MotorGuess(1.0, 0.1, 12.0, dead_zone=6.0),
        "open": lambda: ident.MotorGuess(1.0, 0.1, 12.0, speed=np.inf),
        "speed": lambda: ident.MotorGuess(1.0, 0.1, 12.0, speed=0.0),
        "no constants": lambda: ident.MotorGuess.of(two), "joint": lambda: ident.MotorGuess.of(arm("cmu-dd"), "joint9"),
        "kind": lambda: ident.motor_experiment("prbs9", GUESS),
        "period": lambda: ident.motor_experiment("prbs", GUESS, period=0.06),
        "whole period": lambda: ident.motor_experiment("prbs", GUESS, period=0.05),
        "travel": lambda: ident.motor_experiment("step", replace(GUESS, travel=0.05)),
        "fast": lambda: ident.motor_experiment("chirp", replace(GUESS, speed=0.5)),
        "zone and travel": lambda: ident.motor_experiment("staircase", replace(GUESS, travel=2.0, dead_zone=3.0)),
        "no limits": design(), "harmonics": design(**swing, harmonics=1), "criterion": design(**swing, criterion="det"),
        "drives": design(**swing, drives=["rotr"]), "box": design(**swing, box=[[0, 0, 0]]),
        "cycle": design(**swing, cycle=0.0),
        "starts": design(**swing, starts=0), "bounds": design(**swing, position=[[1.0, 0.0], [0.0, 1.0]]),
        "no candidates": lambda: ident.compare_experiments({}, noise=1.0),
        "no motion": lambda: ident.compare_experiments({"a": 3}, noise=1.0),
        "noise": lambda: ident.compare_experiments({"a": BOTH}, arm=two, noise=-1.0),
        "noises": lambda: ident.compare_experiments({"a": BOTH}, arm=two, noise=[1.0, 2.0, 3.0]),
        "readings": lambda: ident.measured_mass([]), "negative": lambda: ident.measured_mass([1.0], tare=2.0),
        "span": lambda: ident.measured_centre(1.0, 0.0, 2.0), "beyond": lambda: ident.measured_centre(2.1, 0.4, 2.0),
        "before": lambda: ident.measured_centre(-0.1, 0.4, 2.0),
        "std": lambda: ident.measured_centre(1.0, (0.2, -0.1), 2.0),
        "short": lambda: ident.measured_inertia_pendulum(0.1, 2.0, 0.5),
        "two": lambda: ident.measured_inertia_bifilar(1.0, "two", 1.0, 1.0),
        "wide": lambda: ident.measured_inertia_pendulum(1.0, 2.0, 0.1, amplitude=2.0),
        "plane": lambda: ident.measured_tensor([[1, k, 0] for k in range(6)], [1.0] * 6),
        "five": lambda: ident.measured_tensor(AXES[:5], [1.0] * 5),
        "zero": lambda: ident.measured_tensor([[0, 0, 0], *AXES[:5]], [1.0] * 6),
        "impossible": lambda: ident.measured_tensor(AXES[:6], [1.0, 1.0, 5.0, 1.0, 3.0, 3.0]),
        "key": lambda: ident.write_measured(two, "forearm", {"com_x": mass}, folder / "a.toml"),
        "link": lambda: ident.write_measured(two, "link9", {"mass": mass}, folder / "a.toml"),
        "measured": lambda: ident.write_measured(two, "forearm", 3.0, folder / "a.toml"),
        "inertia": lambda: ident.write_measured(
            two, "forearm", {"izz": ident.measured_inertia_bifilar(20.0, 3.0, 1.0, 0.5)}, folder / "a.toml"
        ),
    }, folder)  # fmt: skip


CASES = {
    **{
        f"{kind}, {word}": lambda folder, kind=kind, guess=guess: played(kind, guess, folder, seed=3)
        for kind in ("step", "staircase", "prbs", "multisine", "chirp")
        for word, guess in NARROW.items()
        if (kind, word) != ("chirp", "near")
    },
    "a slow device": lambda folder: played("prbs", GUESS, folder, period=0.007),
    "guesses": lambda _: guesses(),
    "bounds": lambda _: bounds(),
    "regressor": lambda _: rows_of(DRIVES), "regressor without drives": lambda _: rows_of(()),
    "regressor of six": lambda _: rows_of(("viscous", "coulomb"), "puma560"),
    "comparison": Case(lambda _: compared(), 1e-2), "comparison of scenarios": Case(lambda _: compared_scenarios(), 1e-4),
    "directions": lambda _: told(), "tensors": Case(lambda _: tensors(), ignored=("relative",)), "weighed": lambda _: weighed(),
    "records": written, "refusals": refusals,
}  # fmt: skip

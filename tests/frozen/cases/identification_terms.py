"""Parts of arms' fits: friction laws, payloads, torque constants, gear loss, base and physically possible parameters."""

from __future__ import annotations

import importlib.util
import sys
from functools import cache

import numpy as np

import armwright as aw
from armwright.identification import ArmTerms, FitRows
from armwright.identification.arm.base import base_parameters
from armwright.identification.arm.equations import equations_of, stacked
from armwright.identification.arm.essential import essential_parameters
from armwright.identification.arm.fit import cross_validated, fit_arm, fit_robust, with_correlation
from armwright.identification.arm.friction import friction_over_speed, friction_rows, with_identified_friction
from armwright.identification.arm.friction_law import choose_terms, fitted_law
from armwright.identification.arm.gear_loss import lossy_model
from armwright.identification.arm.payload import payload_model, with_identified_payload
from armwright.identification.arm.physical import PhysicalBounds, physical_by_log_cholesky, physical_by_sdp
from armwright.identification.arm.recursive import RecursiveEstimate
from armwright.identification.arm.torque_model import random_states, torque_model
from armwright.model import build_model
from frozen.answers import all_refused, beside, record, shared_folder
from frozen.cases.identification_arm import CLOSE, IGNORED, all_of, arm_with
from frozen.numbers import Case
from identification.arm import test_gear_loss
from identification.arm.moved_arm import moved
from identification.arm.test_equations import samples
from identification.arm.test_friction import PENDULUM, USUAL, WARMS, rows, warming_log
from identification.arm.test_physical import DRIVES, LINKS, NAMES, bodies, problem
from identification.arm.weighed_arm import four_joints, weighed

ident = aw.identification
FIELDS = ("values", "covariance", "fit", "remarks", "at_bound", "identifiable", "names", "units")
MASS, COM = 2.0, (0.02, -0.03, 0.08)
INERTIA = np.array([[0.012, 0.001, 0.002], [0.001, 0.010, -0.001], [0.002, -0.001, 0.006]])


def of(estimate, **more):
    return beside(estimate, *FIELDS, **more)


# --- friction ---------------------------------------------------------------------------------------------------------


def laws():
    """Laws that are fitted to made rows, and the terms that stay."""
    found = {}
    for term, more in {
        None: {}, "stribeck": {"stribeck_torque": 4.0, "stribeck_speed": 0.3}, "load": {"load_coefficient": 0.08},
        "coulomb by temperature": {"coulomb_temperature_coefficient_per_k": -0.02},
        "viscous by temperature": {"viscous_temperature_coefficient_per_k": -0.02},
        "counterbalance": {"sine": 1.0, "cosine": -0.7},
        "spring": {"stiffness": 3.0},
        "sigmoid": {"sigmoid_amplitude": 4.0, "sigmoid_slope": 3.0, "sigmoid_shift": 0.05, "offset": 0.3},
    }.items():  # fmt: skip
        terms = ("viscous", "sigmoid") if term == "sigmoid" else ("viscous", "coulomb", *([term] if term else []))
        usual = {"viscous": 0.5} if term == "sigmoid" else USUAL
        measured = rows(terms, {**usual, **more}, count=300)
        law = fitted_law(measured, terms)
        found[str(term)] = {"values": law.values, "torque": law(measured)}
        if term in ("stribeck", "sigmoid"):
            found[str(term)]["choice"] = choose_terms(measured, ("stribeck", "sigmoid", "load"))
    return found


def friction(folder, change=None, candidates=(), arm=None, **options):
    """Friction of an arm from a log, and the record with it."""
    arm = arm_with(coulomb_negative_n_m=1.4) if arm is None else arm
    true = arm if change is None else change(arm)
    log = moved(folder, "friction", true, seconds=12.0, rate=200.0, torque_noise=0.1, position_noise=1e-5)
    found = ident.identify_friction(log, arm, candidates=candidates, **options)
    model = with_identified_friction(arm, found)
    q, qd, qdd = np.random.default_rng(2).normal(size=(3, 6, arm.n))
    several = friction_rows(log, arm)
    return of(
        found, torque=aw.compile(model).inverse_dynamics(q, qd, qdd),
        curve=[friction_over_speed(each, 9) for each in several],
        rows=[[len(each.q), each.torque, each.load, each.number] for each in several],
    )  # fmt: skip


def sprung(arm):
    joints = list(arm.record.joints)
    joints[1] = joints[1].replace(spring={"stiffness_n_m_per_rad": 12.0, "rest_rad": 0.2})
    return build_model(arm.record.replace(joints=tuple(joints)))


def warming(folder):
    (folder / "arm.toml").write_text(PENDULUM.replace("0.06", WARMS), encoding="utf-8")
    (folder / "plain.toml").write_text(PENDULUM, encoding="utf-8")
    arm = aw.load(folder / "arm.toml")
    log = warming_log(folder, arm)
    candidates = ("coulomb by temperature", "viscous by temperature")
    found = ident.identify_friction(log, arm, candidates=candidates)
    path = ident.write_into(with_identified_friction(arm, found), found, folder / "warm.toml", key="friction")
    said = ident.identify_friction(log, arm, candidates=candidates, warming={"run1": 5.0})
    return {
        "found": of(found), "plain": of(ident.identify_friction(log, aw.load(folder / "plain.toml"), candidates=())),
        "stated": of(said), "record": record(path)["joints"],
    }  # fmt: skip


# --- payloads and torque constants ------------------------------------------------------------------------------------


def payload(folder, two=False, **options):
    """A payload of an arm of six joints by one log or by two, and the record with it."""
    arm = aw.load("lwa4p")
    given = {"seconds": 4.0, "rate": 80.0, "torque_noise": 0.5, "position_noise": 2e-5}
    loaded = moved(folder, "loaded", arm.with_payload(MASS, COM, INERTIA), seed=3, **given)
    log, more = (moved(folder, "unloaded", arm, **given), {"loaded_log": loaded}) if two else (loaded, {})
    found = ident.identify_payload(log, arm, **more, **options)
    carrying = with_identified_payload(arm, found)
    q, qd, qdd = np.random.default_rng(2).normal(size=(3, 6, arm.n))
    return of(
        found, torque=aw.compile(carrying).inverse_dynamics(q, qd, qdd), columns=payload_model(arm).rows(q, qd, qdd)
    )


def planar_payload(folder, mass=1.5, com=(0.1, 0.04, 0.0)):
    """A payload of two links in a plane, of which a part is not told; also none, and one that is lighter than nothing."""
    arm = arm_with()
    true = arm if mass is None else arm.with_payload(mass, com, 0.01 * np.eye(3))
    found = ident.identify_payload(moved(folder, "planar", true, seconds=10.0, rate=100.0, torque_noise=0.05), arm)
    return of(found)


def constants(folder, com=None, inertia=None, bought=True, factors=None, **options):
    """Torque constants by a payload that was weighed."""
    true, plain = four_joints(folder, constants=True), four_joints(folder, constants=False)
    empty = weighed(folder, "empty", true, 0, factors=factors)
    at, about = (0.05, -0.04, 0.08), np.diag([0.03, 0.04, 0.02])
    loaded = weighed(folder, "loaded", true.with_payload(5.0, at, about), 1, factors=factors)
    found = ident.identify_drive_gains(
        empty, loaded, plain if bought else true, 5.0, at if com else None, about if inertia else None, **options
    )
    return of(found)


# --- gear loss --------------------------------------------------------------------------------------------------------


@cache
def lossy():
    """The arm of four joints with gears of 75 % of `tools/gear_loss_seeds.py`."""
    spec = importlib.util.spec_from_file_location("gear_loss_seeds", test_gear_loss.PATH)
    module = importlib.util.module_from_spec(spec)
    sys.modules["gear_loss_seeds"] = module  # dataclasses look for it
    try:
        spec.loader.exec_module(module)
        return module.four_joints(shared_folder("lossy"))
    finally:
        del sys.modules["gear_loss_seeds"]


def loss_terms(variant, free=()):
    """Columns and known torques of a lossy arm about a point, and their derivatives by efficiencies."""
    arm = test_gear_loss.VARIANTS[variant](lossy())
    model = lossy_model(torque_model(arm), free)
    model = model.at(np.nan_to_num(model.prior) * 1.1)
    q, qd, qdd = random_states(arm, 30, seed=4)
    qd[:4, 2], qd[4:6] = 0.0, 0.0
    columns, known = model.terms(q, qd, qdd)
    return {"rows": columns, "known": known, "about": model.about, "of_joint": model.of_joint}


def with_loss(variant, **options):
    """A fit of a lossy arm."""
    arm = test_gear_loss.VARIANTS[variant](lossy())
    log = moved(
        shared_folder(f"loss {variant} {len(options)}"),
        "moved",
        arm,
        seconds=8.0,
        rate=125.0,
        harmonics=10,
        size=0.7,
        torque_noise=0.2,
    )
    given = {"rows": FitRows(cutoff=10.0, decimate=2), "checks": ()} | options
    return all_of(ident.identify_arm(log, test_gear_loss.record_of(arm), **given))


# --- columns, base parameters, fits of rows ---------------------------------------------------------------------------


def columns(name, **options):
    """Columns of an arm, their base parameters and what they are at some states."""
    model = torque_model(aw.load(name), **options)
    base = base_parameters(model)
    q, qd, qdd = random_states(model.arm, 5, seed=1)
    values = base.of(np.nan_to_num(model.prior))
    return {
        "names": [each.name for each in model.columns], "units": [each.unit for each in model.columns],
        "kinds": [each.kind for each in model.columns], "prior": model.prior, "rows": model.rows(q, qd, qdd),
        "formulas": base.formulas, "base": base.names, "independent": base.independent, "absent": base.absent,
        "values": values, "expanded": base.expanded(values),
        "nearest": base.nearest(values * 1.1, np.nan_to_num(model.prior), 1.0 + np.abs(np.nan_to_num(model.prior))),
    }  # fmt: skip


def fits_of_rows():
    """Least squares of random states, plain, weighted and robust."""
    model = torque_model(arm_with())
    base, data = base_parameters(model), samples(arm_with(), count=500, noise=0.3)
    draw = np.random.default_rng(6)
    wild = draw.random(data.tau.shape) < 0.05
    data.tau[wild] += 30 * draw.normal(size=int(wild.sum())) + 20
    data.tau[100:105, 1] = np.nan
    equations = equations_of([data.part(slice(0, 150)), data.part(slice(150, None))], model, part_seconds=1.0, rows=37)
    fits = {method: fit_arm(equations, base, method) for method in ("ols", "wls")}
    fits |= {weight: fit_robust(lambda: [data], equations, base, weight) for weight in ("huber", "tukey")}
    fits["correlated"] = with_correlation(lambda: [data], fits["wls"])
    return {
        name: {
            "values": fit.values, "covariance": fit.covariance, "weights": fit.weights, "rms": fit.rms, "r2": fit.r2,
            "condition": fit.condition, "freedom": fit.freedom, "correlation": fit.correlation,
            "parameters": fit.parameters,
            "outliers": fit.outliers, "held out": cross_validated(fit) if name in ("ols", "wls") else None,
            "effect": fit.part_effect,
        }
        for name, fit in fits.items()
    } | {"stacked": np.abs(stacked(equations.factors, len(model), np.array([1.0, 4.0]))[0])}  # fmt: skip


def essential():
    draw = np.random.default_rng(0)
    truth = np.concatenate([[3.0, -2.0, 1.0, 0.5, -0.4], 1e-3 * draw.normal(size=5)])
    A = draw.normal(size=(600, 10)) * np.geomspace(0.1, 10, 10) ** 0.3
    factor = np.linalg.qr(np.column_stack([A, A @ truth + 0.2 * draw.normal(size=600)]), mode="r")
    given = factor[:10, :10], factor[:10, 10], abs(factor[10, 10]), 600
    return [essential_parameters(*given, growth=growth) for growth in (0.0, 0.02, 0.5)] + [essential_parameters(*given)]


def recursive():
    draw = np.random.default_rng(0)
    Y = draw.normal(size=(60, 4)) * [1e-3, 1.0, 1e2, 1.0]
    y = Y @ [1.0, -2.0, 0.5, 3.0] + 0.1 * draw.normal(size=60)
    found = {}
    for name, begun in {
        "plain": RecursiveEstimate.begin(4), "fading": RecursiveEstimate.begin(4, 0.95),
        "prior": RecursiveEstimate.begin(4, start=np.ones(4), std=np.array([1.0, 2.0, 3.0, 4.0])),
    }.items():  # fmt: skip
        for count in (3, 5, 60):
            each = begun.with_rows(Y[:count], y[:count], weights=2.0)
            known = (
                {"values": each.values, "variance": each.variance, "covariance": each.covariance} if count > 3 else {}
            )
            found[f"{name} {count}"] = known | {"memory": each.memory, "known": each.identifiable, "rows": each.rows}
    return found


def possible(seed, noise, **options):
    """Physically possible parameters by both methods."""
    R, z, _ = problem(seed, noise, options.pop("rank", 22))
    prior = options.pop("prior", None)
    bounds = PhysicalBounds(NAMES, LINKS, DRIVES, **options)
    if prior is not None:
        prior = np.concatenate([bodies(np.random.default_rng(99), 2).ravel(), [0.02, 1.5]])
    more = {} if prior is None else {"prior": prior, "weight": 0.5}
    found = {"sdp": physical_by_sdp(R, z, bounds, **more)}
    if not options:
        found["cholesky"] = physical_by_log_cholesky(R, z, bounds, **more)
    return {
        name: {key: each for key, each in vars(one).items() if key != "margins"} | {"margins": one.margins.round(4)}
        for name, one in found.items()
    }


def refusals(folder):
    arm, two = aw.load("lwa4p"), aw.load("two-link")
    log = moved(folder, "log", two, seconds=4.0)
    return all_refused({
        "candidate": lambda: ident.identify_friction(log, two, candidates=("magic",)),
        "arm": lambda: ident.identify_friction(log, arm),
        "payload": lambda: ident.identify_payload(log, arm),
        "frame": lambda: ident.identify_payload(log, two, frame="hand"),
        "gains": lambda: ident.identify_drive_gains(log, log, two, 1.0),
        "mass": lambda: ident.identify_drive_gains(log, log, two, -1.0),
        "spread": lambda: ident.identify_drive_gains(log, log, two, 1.0, mass_std=-1.0),
        "both": lambda: torque_model(two, friction=("coulomb", "asymmetric")),
        "gears": lambda: torque_model(two, gears=np.eye(3)),
        "essential": lambda: essential_parameters(np.eye(3), np.ones(3), 1.0, 3),
        "memory": lambda: RecursiveEstimate.begin(3, 1.1),
        "places": lambda: PhysicalBounds(NAMES, LINKS, (19, 21)),
        "light": lambda: PhysicalBounds(NAMES, LINKS, DRIVES, mass={0: (2.0, 1.0)}),
        "total": lambda: PhysicalBounds(NAMES, LINKS, DRIVES, mass={0: (1.0, 2.0), 1: (1.0, 2.0)}, total_mass=(5.0, 6.0)),
        "friction of a loss": lambda: ident.identify_arm(log, lossy()),
        "method": lambda: with_loss("efficiency", method="essential"),
    }, folder)  # fmt: skip


def case(call, close=CLOSE, ignored=(), study=False):
    return Case(call, close, (*IGNORED, *ignored), study)


CASES = {
    "friction laws": case(lambda _: laws(), 1e-3, ("tried.load",)),
    "friction": case(friction),
    "friction of springs": case(lambda folder: friction(folder, sprung, ("spring", "counterbalance")), 1e-3),
    "friction by speed": case(
        lambda folder: friction(
            folder,
            lambda _: arm_with(stribeck_torque_n_m=4.0, stribeck_speed_rad_per_s=0.3),
            ("stribeck", "load", "sigmoid"),
        ),
        1e-2,
    ),
    "friction of another arm": case(
        lambda folder: friction(folder, lambda arm: arm.with_values({"forearm.mass_kg": 9.0}))
    ),
    "friction by temperature": case(warming, 1e-3),
    "payload": case(payload),
    "payload by two logs": case(lambda folder: payload(folder, True)),
    "payload in a plane": case(planar_payload),
    "no payload": case(lambda folder: planar_payload(folder, None)),
    "constants": case(constants, 1e-3),
    "constants by the centre": case(lambda folder: constants(folder, True, mass_std=0.02), 1e-3),
    "constants by all": case(lambda folder: constants(folder, True, True, False, np.array([1.0, 0.8, 1.2, 1.0])), 1e-3),
    **{f"loss: {name}": case(lambda _, name=name: loss_terms(name), 1e-6) for name in test_gear_loss.VARIANTS},
    "loss: free efficiencies": case(lambda _: loss_terms("efficiency", "all"), 1e-6),
    "loss: one free efficiency": case(lambda _: loss_terms("motor side", ("elbow",)), 1e-6),
    "fit with loss by load": case(lambda _: with_loss("friction by load", record=False), 1e-3),
    "fit of efficiencies": case(
        lambda _: with_loss("efficiency", terms=ArmTerms(fit_efficiency="all"), record=False), 1e-2
    ),
    **{
        f"columns of {name}": case(lambda _, name=name: columns(name), 1e-6, ("formulas",) if name == "so101" else ())
        for name in ("two-link", "puma560", "cmu-dd", "so101")
    },
    "columns of laws": case(
        lambda _: columns(
            "two-link", friction=("viscous", "asymmetric", "stribeck"), springs=("elbow",), stribeck_speed=0.2
        ),
        1e-6,
    ),
    "columns that lack": case(lambda _: columns("puma560", lacks=("gravity", "rotors", "coulomb")), 1e-6),
    "columns of gears": case(lambda _: columns("two-link", gears=np.array([[50.0, 0.0], [10.0, 40.0]])), 1e-6),
    "fits of rows": case(lambda _: fits_of_rows(), ignored=("stacked",)),
    "essential": lambda _: essential(),
    "recursive": lambda _: recursive(),
    "possible": case(lambda _: possible(2, 1e-2), 1e-2, ("cost",)),
    "possible of much noise": case(lambda _: possible(3, 3.0), 2e-2, ("cost",)),
    "possible near a prior": case(lambda _: possible(4, 0.1, rank=14, prior=True), 1e-2, ("cost",)),
    "possible of known masses": case(
        lambda _: possible(5, 0.5, mass={0: (1.0, 1.2)}, total_mass=(2.0, 2.5)), 2e-2, ("cost",)
    ),
    "refusals": refusals,
}

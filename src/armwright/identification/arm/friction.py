"""Friction of joints against speed, load and temperature, from a log of an arm that is known but for it.

The torque that the arm without friction leaves unexplained, row by row, is fitted by

    f = offset + viscous q̇ + s [ Fc± + (Fs − Fc) exp(−(q̇/vs)²) + share |load| ],   s = sgn q̇,  [BittencourtGunnarsson2012]

Fc± and viscous times (1 + coefficient · warming), or by the sigmoid law [Gaz2019]. Viscous and Coulomb friction are always
fitted; every other term is a candidate that stays only if it lowers the held-out error, on parts of the log, by a stated share.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from armwright.description.friction import key_of
from armwright.errors import IdentificationError
from armwright.identification.arm.equations import samples_of
from armwright.identification.arm.spring_record import spring_keys
from armwright.identification.arm.torque_model import torque_model
from armwright.identification.estimate import Estimate
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import Preparation, choose_preparation
from armwright.model import Model

WORTH = 0.01  # share of the held-out error that a candidate must take away
FOLDS = 8  # parts of the log, each held out once
ENOUGH = 600  # rows for the choice of terms: neighbours say nearly the same
CLUSTERS = 40  # parts of the log whose residuals count as independent of each other's
SLOWEST = 0.02  # of a joint's largest speed: slower rows are left out, the direction of dry friction is not known there
WIDER, HIGHEST = 4.0, 0.2  # cut-off by the one that suits the positions, and its largest share of the rate
FEWEST = 50  # rows of a joint
BINS = 12  # of a table over speed, either way
BOUND = 1e-9  # of a parameter's scale


@dataclass(frozen=True, eq=False)
class FrictionRows:
    """Rows of one joint in motion.

    Attributes:
        q, speed: (k,) [rad, rad/s | m, m/s].   torque: (k,) what the arm without friction leaves unexplained [N m | N].
        load: (k,) torque at the joint's links [N m | N].   warming: (k,) [K], NaN where it is not known.
    """

    q: np.ndarray
    speed: np.ndarray
    torque: np.ndarray
    load: np.ndarray
    warming: np.ndarray

    def part(self, chosen: np.ndarray) -> FrictionRows:
        """Some of the rows."""
        return FrictionRows(*(each[chosen] for each in vars(self).values()))


@dataclass(frozen=True)
class Term:
    """A number of the friction law.

    Attributes:
        stem: of the record's key, and its dimension.   start: where the search begins, from rows.   low: its lower bound.
    """

    stem: str
    dimension: Any
    start: Any
    low: float = 0.0


def _slope(rows: FrictionRows) -> float:
    return float(np.abs(rows.torque).mean() / np.abs(rows.speed).max())


def _level(rows: FrictionRows) -> float:
    return float(np.abs(rows.torque).mean())


def _speed(share: float, rows: FrictionRows) -> float:
    return share * float(np.abs(rows.speed).max())


VISCOUS = Term("viscous", "damping", _slope)
TERMS: dict[str, tuple[Term, ...]] = {
    "viscous": (VISCOUS,),
    "coulomb": (
        Term("coulomb_positive", "torque", _level, -np.inf),
        Term("coulomb_negative", "torque", _level, -np.inf),
    ),
    "stribeck": (
        Term("stribeck_torque", "torque", _level),
        Term("stribeck_speed", "speed", partial(_speed, 0.1), 1e-6),
    ),
    "load": (Term("load_coefficient", None, lambda _: 0.01),),
    "coulomb by temperature": (Term("coulomb_temperature_coefficient_per_k", None, lambda _: -1e-3, -np.inf),),
    "viscous by temperature": (Term("viscous_temperature_coefficient_per_k", None, lambda _: -1e-3, -np.inf),),
    "sigmoid": (
        Term("sigmoid_amplitude", "torque", lambda rows: 2 * _level(rows)),
        Term("sigmoid_slope", "slope", lambda rows: 10 / _speed(1.0, rows), 1e-6),
        Term("sigmoid_shift", "speed", lambda _: 0.0, -np.inf),
        Term("offset", "torque", lambda rows: float(rows.torque.mean()), -np.inf),
    ),
    "spring": (
        Term("stiffness", "spring", _level),
    ),  # its torque at 0 is in the levels of Coulomb, or the sigmoid's offset
    "counterbalance": (
        Term("sine", "spring", _level, -np.inf),
        Term("cosine", "spring", _level, -np.inf),
    ),
}
USUAL = ("viscous", "coulomb")
CANDIDATES = (
    "stribeck",
    "load",
    "coulomb by temperature",
    "viscous by temperature",
    "sigmoid",
    "spring",
    "counterbalance",
)


@dataclass(frozen=True, eq=False)
class FrictionLaw:
    """A friction law with its numbers.

    Attributes:
        terms: keys of `TERMS`.   values: by the stem of each number.
    """

    terms: tuple[str, ...]
    values: Mapping[str, float]

    def __call__(self, rows: FrictionRows) -> np.ndarray:
        """Friction torque (k,) [N m | N]."""
        v, speed, s = self.values, rows.speed, np.sign(rows.speed)
        warming = np.nan_to_num(rows.warming)
        torque = v["viscous"] * (1 + v.get("viscous_temperature_coefficient_per_k", 0.0) * warming) * speed
        if "sigmoid" in self.terms:
            a, b, c = (v[f"sigmoid_{name}"] for name in ("amplitude", "slope", "shift"))
            torque = torque + v["offset"] + a * (_logistic(b * (speed + c)) - _logistic(np.array(b * c)))
        else:
            level = np.where(speed > 0, v["coulomb_positive"], v["coulomb_negative"])
            if "stribeck" in self.terms:
                level = level + (v["stribeck_torque"] - level) * np.exp(-((speed / v["stribeck_speed"]) ** 2))
            level = level * (1 + v.get("coulomb_temperature_coefficient_per_k", 0.0) * warming)
            torque = torque + s * (level + v.get("load_coefficient", 0.0) * np.abs(rows.load))
        torque = torque + v.get("stiffness", 0.0) * rows.q
        return torque + v.get("sine", 0.0) * np.sin(rows.q) + v.get("cosine", 0.0) * np.cos(rows.q)


def _logistic(x: np.ndarray) -> np.ndarray:
    return 0.5 * (1 + np.tanh(0.5 * x))


def terms_of(names: Sequence[str]) -> tuple[Term, ...]:
    """The numbers of some terms; the sigmoid takes the place of Coulomb's levels."""
    return tuple(term for name in names for term in TERMS[name])


def fitted_law(rows: FrictionRows, names: Sequence[str], start: Mapping[str, float] | None = None) -> FrictionLaw:
    """The law of these terms that fits rows best, by least squares with its bounds."""
    terms = terms_of(names)
    stems = [term.stem for term in terms]
    low = np.array([term.low for term in terms])
    x0 = np.array([(start or {}).get(term.stem, term.start(rows)) for term in terms])
    scale = np.maximum(np.abs(np.array([term.start(rows) for term in terms])), 1e-3)
    residuals = lambda x: FrictionLaw(tuple(names), dict(zip(stems, x, strict=True)))(rows) - rows.torque  # noqa: E731
    inside = np.maximum(x0, low + 1e-9 * scale)
    found: Any = least_squares(residuals, inside, bounds=(low, np.inf), x_scale=scale, max_nfev=100)
    return FrictionLaw(tuple(names), dict(zip(stems, map(float, found.x), strict=True)))


def held_out_error(rows: FrictionRows, names: Sequence[str], folds: int = FOLDS) -> float:
    """Root mean square error [N m | N] on parts of the rows that were each held out once."""
    rows = rows.part(np.arange(0, len(rows.speed), max(len(rows.speed) // ENOUGH, 1)))
    parts, square = np.array_split(np.arange(len(rows.speed)), folds), 0.0
    start = fitted_law(rows, names).values
    for part in parts:
        others = np.setdiff1d(np.arange(len(rows.speed)), part)
        law = fitted_law(rows.part(others), names, start)
        square += float(np.sum((law(rows.part(part)) - rows.torque[part]) ** 2))
    return float(np.sqrt(square / len(rows.speed)))


@dataclass(frozen=True)
class Choice:
    """Terms of a joint's friction, and why.

    Attributes:
        terms: those that stay.   error: held-out [N m | N].   tried: candidate → share of the held-out error that it takes away.
    """

    terms: tuple[str, ...]
    error: float
    tried: Mapping[str, float]


def choose_terms(rows: FrictionRows, candidates: Sequence[str] = CANDIDATES, worth: float = WORTH) -> Choice:
    """Terms that lower the held-out error by `worth` at least, the best one first, until none is left that does."""
    terms: tuple[str, ...] = USUAL
    error, tried = held_out_error(rows, terms), {}
    left = [each for each in candidates if "temperature" not in each or np.ptp(rows.warming) > 0]
    while left:
        errors = {each: held_out_error(rows, _with(terms, each)) for each in left}
        for each, value in errors.items():
            tried[each] = 1 - value / error if error > 0 else 0.0
        best = min(errors, key=lambda each: errors[each])
        if tried[best] < worth:
            break
        terms, error = _with(terms, best), errors[best]
        left = [
            each for each in left if each != best and ("sigmoid" not in terms or each in ("spring", "counterbalance"))
        ]
    return Choice(terms, error, tried)


def _with(terms: Sequence[str], candidate: str) -> tuple[str, ...]:
    """Terms with one more; the sigmoid law has no other dry friction, nor what depends on it."""
    if candidate == "sigmoid":
        return (*(each for each in terms if each in ("viscous", "spring", "counterbalance")), "sigmoid")
    return (*terms, candidate)


def friction_rows(
    log: Log, robot: Model, preparation: Preparation | None = None, warming: Mapping[str, float] | None = None
) -> list[FrictionRows]:
    """Rows of every joint of a known arm in motion, for `choose_terms` and `fitted_law`.

    Rows near a turn are left out: there the low-pass has rounded off the change of sign.

    Args:
        log: with torques, currents or voltages.   robot: the arm; its own friction is not used.
        preparation: None: chosen.   warming: [K] of each run, by its name.
    Raises:
        IdentificationError: an arm without masses, or a log that does not fit.
    """
    if not np.any(np.asarray(robot.inertial_parameters, dtype=float)):
        what = "an arm without masses: its gravity cannot be taken off"
        raise IdentificationError(what, place=robot.name, expected="identify it first: armwright identify arm")
    from armwright.kernels.compiled import compile_arm

    plain = compile_arm(robot.replace(friction=None))
    links = compile_arm(robot.replace(friction=None, rotors=None))
    choice = preparation or _wider(log)
    model, parts = torque_model(robot), [[] for _ in range(robot.n)]
    for block in samples_of(log, model, None, choice):
        rest = block.tau - plain.inverse_dynamics(block.q, block.qd, block.qdd)
        load = links.inverse_dynamics(block.q, block.qd, block.qdd)
        near = max(round(1.0 / (choice.cutoff * max(np.median(np.diff(block.t)), 1e-9))), 1) if len(block.t) > 1 else 1
        warm = np.full(len(block.t), np.nan if warming is None else warming.get(block.run, np.nan))
        for j in range(robot.n):
            speed = block.qd[:, j]
            turns = np.flatnonzero(np.diff(np.sign(speed)) != 0)
            away = np.ones(len(speed), dtype=bool)
            for turn in turns:
                away[max(turn + 1 - near, 0) : turn + 1 + near] = False
            kept = away & np.isfinite(rest[:, j])
            parts[j].append(FrictionRows(block.q[kept, j], speed[kept], rest[kept, j], load[kept, j], warm[kept]))
    joined = []
    for each in parts:
        rows = FrictionRows(*(np.concatenate([getattr(part, name) for part in each]) for name in vars(each[0])))
        largest = np.abs(rows.speed).max(initial=0.0)
        joined.append(rows.part(np.abs(rows.speed) > SLOWEST * largest))
    return joined


def _wider(log: Log) -> Preparation:
    """A low-pass wider than the positions need: the wider, the fewer rows near a turn are left out."""
    chosen = choose_preparation(log).cutoff
    return choose_preparation(log, cutoff=max(chosen, min(WIDER * chosen, HIGHEST / log.run().period)))


def friction_over_speed(rows: FrictionRows, bins: int = BINS) -> np.ndarray:
    """A table of friction: (≤ 2 bins, 4) mean speed, mean friction, its standard deviation, and number of rows."""
    edges = np.linspace(0.0, np.abs(rows.speed).max(initial=1e-9), bins + 1)
    table = []
    for sign in (-1, 1):
        for low, high in pairwise(edges):
            chosen = (sign * rows.speed > low) & (sign * rows.speed <= high)
            if chosen.sum() >= 2:
                values = rows.torque[chosen]
                table.append([rows.speed[chosen].mean(), values.mean(), values.std(ddof=1), chosen.sum()])
    return np.array(sorted(table)) if table else np.zeros((0, 4))


def identify_friction(
    log: Log,
    robot: Model,
    *,
    preparation: Preparation | None = None,
    warming: Mapping[str, float] | None = None,
    candidates: Sequence[str] = CANDIDATES,
    worth: float = WORTH,
) -> Estimate:
    """Friction of every joint against its speed, load and temperature, from a log of an arm that is known but for it.

    Args:
        log: with positions, and torques, currents or voltages.   robot: the arm; its masses count, its friction does not.
        preparation: None: chosen.   warming: [K] above the reference temperature, of each run by its name.
        candidates: of "stribeck", "load", "coulomb by temperature", "viscous by temperature", "sigmoid", "spring" and
            "counterbalance", which stay only if they lower the held-out error by `worth`, a share.   worth: 0.01.
    Returns:
        estimate: numbers under the record's own keys, such as `joint1.friction.viscous_n_m_s_per_rad`; those of springs, of which
            the record may make a table, under names of their own. Remarks say what each candidate brought.
    Raises:
        IdentificationError: an arm without masses, an unknown candidate, a log that does not fit.
    """
    for each in candidates:
        if each not in CANDIDATES:
            raise IdentificationError("unknown", place="candidates", value=each, choices=CANDIDATES)
    names: list[str] = []
    values, bounds, blocks, remarks, measures = [], [], [], [], {}
    for body, rows in zip(robot.coordinates, friction_rows(log, robot, preparation, warming), strict=True):
        moved = len(rows.speed) >= FEWEST and (rows.speed > 0).any() and (rows.speed < 0).any()
        linear = body.kind == "prismatic"
        if not moved:
            remarks.append(
                f"{body.joint}: does not move both ways for long enough; its friction stays as the record has it"
            )
            continue
        choice = choose_terms(rows, candidates, worth)
        law = fitted_law(rows, choice.terms)
        covariance = _covariance(rows, law)
        for term, value, at_bound in _recorded(rows, law):
            names.append(_name(body.joint, term, linear))
            values.append(value)
            bounds.append(at_bound)
        blocks.append(_spread(law, covariance))
        rest = law(rows) - rows.torque
        measures[body.joint] = {
            "r2": 1 - float(rest.var() / rows.torque.var()),
            "rms": float(np.sqrt(np.mean(rest**2))),
            "held_out_rms": choice.error,
        }
        remarks += _said(body.joint, law, choice, worth)
    if not names:
        raise IdentificationError(
            "no joint moves both ways", place="log", expected="motion of the joints, forward and back"
        )
    from scipy.linalg import block_diag

    at_bound = np.array(bounds)
    remarks += [f"{name} is at its bound" for name, at in zip(names, bounds, strict=True) if at]
    return Estimate(
        tuple(names), np.array(values), np.asarray(block_diag(*blocks)), log.sha256,
        "friction: least squares of the torque that the arm without friction leaves unexplained, candidates by held-out error",
        units=tuple(_unit(name) for name in names), at_bound=at_bound, remarks=tuple(remarks),
        fit=measures, log=log.path.name,
    )  # fmt: skip


OFFSET = Term("offset", "torque", _level, -np.inf)


def _is_shifted(law: FrictionLaw) -> bool:
    """True if a Coulomb level is below 0, which no record has: then the levels are equal and there is an offset."""
    return min(law.values.get("coulomb_positive", 0.0), law.values.get("coulomb_negative", 0.0)) < 0


def _recorded(rows: FrictionRows, law: FrictionLaw) -> list[tuple[Term, float, bool]]:
    """Every number of a law as a record has it, and whether it is at its bound."""
    values = dict(law.values)
    terms = list(terms_of(law.terms))
    if _is_shifted(law):
        plus, minus = values["coulomb_positive"], values["coulomb_negative"]
        values |= dict.fromkeys(("coulomb_positive", "coulomb_negative"), 0.5 * (plus + minus))
        values["offset"] = 0.5 * (plus - minus)
        terms.append(OFFSET)
    result = []
    for term in terms:
        low = 0.0 if term.stem.startswith("coulomb_") and term.dimension else term.low
        value = max(values[term.stem], low)
        result.append((term, value, value - low < BOUND * max(abs(term.start(rows)), 1e-3)))
    return result


def _spread(law: FrictionLaw, covariance: np.ndarray) -> np.ndarray:
    """Covariance of `_recorded`."""
    if not _is_shifted(law):
        return covariance
    stems = [term.stem for term in terms_of(law.terms)]
    plus, minus = stems.index("coulomb_positive"), stems.index("coulomb_negative")
    change = np.eye(len(stems) + 1, len(stems))
    change[np.ix_([plus, minus], [plus, minus])] = 0.5
    change[-1, [plus, minus]] = 0.5, -0.5
    return change @ covariance @ change.T


SPRING = " of a spring or counterbalance"
OF_SPRING = {
    "stiffness": "spring",
    "rest": "constant",
    "sine": "sine",
    "cosine": "cosine",
}  # stem → value of `spring_keys`


def _name(joint: str, term: Term, linear: bool) -> str:
    if term.dimension == "spring":
        return f"{joint}: {term.stem}{SPRING}"
    return f"{joint}.friction.{term.stem if term.dimension is None else key_of(term.stem, term.dimension, linear)}"


def _unit(name: str) -> str:
    from armwright.description.paths import unit_at

    return unit_at(name) if ".friction." in name else "N m/rad" if "stiffness" in name else "N m"


def _said(joint: str, law: FrictionLaw, choice: Choice, worth: float) -> list[str]:
    """What every candidate brought."""
    said = []
    for name, share in choice.tried.items():
        if name in choice.terms:
            said.append(f"{joint}: {name} lowers the held-out error by {share:.1%}: kept")
        elif share > 0.1 * worth:
            said.append(f"{joint}: {name} lowers the held-out error by {share:.1%}, less than {worth:.0%}: left out")
    below = [side for side in ("coulomb_positive", "coulomb_negative") if law.values.get(side, 0.0) < 0]
    return said + [
        f"{joint}: {side} is below 0: an offset of the torque is larger than the dry friction" for side in below
    ]


def _covariance(rows: FrictionRows, law: FrictionLaw) -> np.ndarray:
    """Covariance of a law's numbers, robust against correlation of the residuals within parts of the log. [LiangZeger1986]"""
    stems = [term.stem for term in terms_of(law.terms)]
    x = np.array([law.values[stem] for stem in stems])
    J = np.zeros((len(rows.speed), len(x)))
    for k in range(len(x)):
        h = 1e-6 * max(abs(x[k]), 1e-3)
        ends = [FrictionLaw(law.terms, {**law.values, stems[k]: x[k] + sign * h})(rows) for sign in (1, -1)]
        J[:, k] = (ends[0] - ends[1]) / (2 * h)
    rest = rows.torque - law(rows)
    size = np.linalg.norm(J, axis=0)
    scale = np.where(size > 0, size, 1.0)
    inverse = np.linalg.pinv((J / scale).T @ (J / scale))
    scores = np.array([(J[part] / scale).T @ rest[part] for part in np.array_split(np.arange(len(rest)), CLUSTERS)])
    covariance = (inverse @ (scores.T @ scores) @ inverse) * CLUSTERS / (CLUSTERS - 1) / np.outer(scale, scale)
    covariance[size == 0, :] = covariance[:, size == 0] = np.nan  # the torque does not depend on it
    return covariance


def with_identified_friction(robot: Model, estimate: Estimate) -> Model:
    """The arm with the friction of an estimate in place of its own, and with the estimate's springs added to its own.

    Raises:
        DescriptionError: the record cannot have these numbers.
    """
    from dataclasses import replace as with_changes

    from armwright.description.drive import LinearFriction, RotaryFriction
    from armwright.model.variants.edits import checked, replaced

    numbers: dict[str, dict[str, Any]] = {}
    springs: dict[str, dict[str, float]] = {}
    for name, value, std in zip(estimate.names, estimate.values, estimate.std, strict=True):
        joint, _, key = name.partition(".friction.")
        if name.endswith(SPRING):
            joint, _, stem = name.removesuffix(SPRING).rpartition(": ")
            springs.setdefault(joint, {})[OF_SPRING[stem]] = float(value)
        if key:
            spread = {"std": float(std)} if np.isfinite(std) else {}
            numbers.setdefault(joint, {})[key] = {"value": float(value), "source": "fit", **spread}
    joints, bodies = [], {body.joint: body for body in robot.coordinates}
    for joint in robot.record.joints:
        keys = numbers.get(joint.name)
        if keys is not None and joint.type != "fixed":
            kind = RotaryFriction if joint.type == "revolute" else LinearFriction
            law = "sigmoid" if any(key.startswith("sigmoid") for key in keys) else "coulomb"
            smoothing = "smoothing_rad_per_s" if joint.type == "revolute" else "smoothing_m_per_s"
            old = getattr(joint.friction, smoothing, None)
            kept = {smoothing: old} if old is not None and law == "coulomb" else {}
            friction = checked(kind, f"{joint.name}.friction", law=law, **kept, **keys)
            joint = joint.replace(friction=friction)
        if joint.name in springs:
            joint = joint.replace(**spring_keys(bodies[joint.name], springs[joint.name], "fit")[0])
        joints.append(joint)
    record = replaced(robot.record, "with_identified_friction", joints=tuple(joints))
    from armwright.model import build_model

    return with_changes(build_model(record, on_impossible="warn"), changes={})

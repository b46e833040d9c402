"""Friction laws of a joint as sums of terms, and the choice of terms by cross-validation.

    f = offset + viscous q̇ + s [ Fc± + (Fs − Fc) exp(−(q̇/vs)²) + share |load| ],   s = sgn q̇,  [BittencourtGunnarsson2012]

Fc± and viscous times (1 + coefficient · warming), or by the sigmoid law [Gaz2019]. Viscous and Coulomb friction are always
fitted; every other term is a candidate that stays only if it lowers the held-out error, on parts of the rows, by a stated share.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from armwright.friction_laws import LAWS, FrictionLaw

WORTH = 0.01  # share of the held-out error that a candidate must take away
FOLDS = 8  # parts of the log, each held out once
ENOUGH = 600  # rows for the choice of terms: neighbours say nearly the same


@dataclass(frozen=True, eq=False)
class FrictionRows:
    """Rows of one joint in motion.

    Attributes:
        q, speed: (k,) [rad, rad/s | m, m/s].   torque: (k,) what the arm without friction leaves unexplained [N m | N].
        load: (k,) torque at the joint's links [N m | N].   warming: (k,) [K], NaN where it is not known.
        number: (k,) of the rows in the log, successive ones a period apart; by default there are no gaps.
    """

    q: np.ndarray
    speed: np.ndarray
    torque: np.ndarray
    load: np.ndarray
    warming: np.ndarray
    number: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))

    def __post_init__(self) -> None:
        if not len(self.number):
            object.__setattr__(self, "number", np.arange(len(self.speed)))

    def part(self, chosen: np.ndarray) -> FrictionRows:
        """A selection of the rows."""
        return FrictionRows(*(each[chosen] for each in vars(self).values()))


@dataclass(frozen=True)
class FrictionTerm:
    """One parameter of a friction law.

    Attributes:
        stem: of the record's key, and its dimension.   start: where the search begins, from rows.   low: its lower bound.
    """

    stem: str
    dimension: Any
    start: Any
    low: float = 0.0


def _slope(rows: FrictionRows) -> float:
    return float(np.abs(rows.torque).mean() / np.abs(rows.speed).max())


def level_of(rows: FrictionRows) -> float:
    """Mean magnitude of the torque [N m | N], the start value of a search for a friction level."""
    return float(np.abs(rows.torque).mean())


def _speed(share: float, rows: FrictionRows) -> float:
    return share * float(np.abs(rows.speed).max())


def _of_law(law: FrictionLaw) -> tuple[FrictionTerm, ...]:
    """The own numbers of a law of robot files, and its offset."""

    def started(start: Any) -> Any:
        return lambda rows: start(level_of(rows), _speed(1.0, rows))

    own = (FrictionTerm(key.stem, key.dimension, started(key.start), key.low) for key in law.own)
    return (*own, FrictionTerm("offset", "torque", lambda rows: float(rows.torque.mean()), -np.inf))


VISCOUS = FrictionTerm("viscous", "damping", _slope)
TERMS: dict[str, tuple[FrictionTerm, ...]] = {
    "viscous": (VISCOUS,),
    "coulomb": (
        FrictionTerm("coulomb_positive", "torque", level_of, -np.inf),
        FrictionTerm("coulomb_negative", "torque", level_of, -np.inf),
    ),
    "stribeck": (
        FrictionTerm("stribeck_torque", "torque", level_of),
        FrictionTerm("stribeck_speed", "speed", partial(_speed, 0.1), 1e-6),
    ),
    "load": (FrictionTerm("load_coefficient", None, lambda _: 0.01),),
    "coulomb by temperature": (FrictionTerm("coulomb_temperature_coefficient_per_k", None, lambda _: -1e-3, -np.inf),),
    "viscous by temperature": (FrictionTerm("viscous_temperature_coefficient_per_k", None, lambda _: -1e-3, -np.inf),),
    **{name: _of_law(law) for name, law in LAWS.items() if law.is_candidate},
    # its torque at 0 is in the levels of Coulomb, or the sigmoid's offset
    "spring": (FrictionTerm("stiffness", "spring", level_of),),
    "counterbalance": (
        FrictionTerm("sine", "spring", level_of, -np.inf),
        FrictionTerm("cosine", "spring", level_of, -np.inf),
    ),
}
USUAL, SPRINGS = ("viscous", "coulomb"), ("spring", "counterbalance")
CANDIDATES = tuple(name for name in TERMS if name not in USUAL)


@dataclass(frozen=True, eq=False)
class FittedFriction:
    """A friction law with parameter values.

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
        law = own_law(self.terms)
        if law is not None:
            torque = torque + v["offset"] + law.fitted(v, speed)
        else:
            level = np.where(speed > 0, v["coulomb_positive"], v["coulomb_negative"])
            if "stribeck" in self.terms:
                level = level + (v["stribeck_torque"] - level) * np.exp(-((speed / v["stribeck_speed"]) ** 2))
            level = level * (1 + v.get("coulomb_temperature_coefficient_per_k", 0.0) * warming)
            torque = torque + s * (level + v.get("load_coefficient", 0.0) * np.abs(rows.load))
        torque = torque + v.get("stiffness", 0.0) * rows.q
        return torque + v.get("sine", 0.0) * np.sin(rows.q) + v.get("cosine", 0.0) * np.cos(rows.q)


def own_law(terms: Sequence[str]) -> FrictionLaw | None:
    """The law that replaces Coulomb's in a choice of terms; None without one."""
    return next((LAWS[name] for name in terms if name in LAWS and LAWS[name].is_candidate), None)


def terms_of(names: Sequence[str]) -> tuple[FrictionTerm, ...]:
    """Parameters of some terms; a law of its own keys replaces the Coulomb levels."""
    return tuple(term for name in names for term in TERMS[name])


def fitted_law(rows: FrictionRows, names: Sequence[str], start: Mapping[str, float] | None = None) -> FittedFriction:
    """The law of these terms that fits rows best, by least squares with its bounds."""
    terms = terms_of(names)
    stems = [term.stem for term in terms]
    low = np.array([term.low for term in terms])
    x0 = np.array([(start or {}).get(term.stem, term.start(rows)) for term in terms])
    scale = np.maximum(np.abs(np.array([term.start(rows) for term in terms])), 1e-3)
    residuals = lambda x: FittedFriction(tuple(names), dict(zip(stems, x, strict=True)))(rows) - rows.torque  # noqa: E731
    inside = np.maximum(x0, low + 1e-9 * scale)
    found: Any = least_squares(residuals, inside, bounds=(low, np.inf), x_scale=scale, max_nfev=100)
    return FittedFriction(tuple(names), dict(zip(stems, map(float, found.x), strict=True)))


def held_out_error(rows: FrictionRows, names: Sequence[str]) -> float:
    """Root mean square error [N m | N] of a cross-validation: each part held out once."""
    rows = rows.part(np.arange(0, len(rows.speed), max(len(rows.speed) // ENOUGH, 1)))
    parts, square = np.array_split(np.arange(len(rows.speed)), FOLDS), 0.0
    start = fitted_law(rows, names).values
    for part in parts:
        others = np.setdiff1d(np.arange(len(rows.speed)), part)
        law = fitted_law(rows.part(others), names, start)
        square += float(np.sum((law(rows.part(part)) - rows.torque[part]) ** 2))
    return float(np.sqrt(square / len(rows.speed)))


@dataclass(frozen=True)
class Choice:
    """Chosen terms of a joint's friction, with reasons.

    Attributes:
        terms: those that stay.   error: held-out [N m | N].   tried: candidate → share of the held-out error that it takes away.
    """

    terms: tuple[str, ...]
    error: float
    tried: Mapping[str, float]


def choose_terms(rows: FrictionRows, candidates: Sequence[str] = CANDIDATES, worth: float = WORTH) -> Choice:
    """Friction terms added one by one, the best first, as long as each lowers the held-out error by `worth` at least."""
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
        left = [each for each in left if each != best and (own_law(terms) is None or each in SPRINGS)]
    return Choice(terms, error, tried)


def _with(terms: Sequence[str], candidate: str) -> tuple[str, ...]:
    """Terms with one more; a law of its own keys has no other dry friction, nor what depends on it."""
    if own_law((candidate,)) is not None:
        return (*(each for each in terms if each in ("viscous", *SPRINGS)), candidate)
    return (*terms, candidate)

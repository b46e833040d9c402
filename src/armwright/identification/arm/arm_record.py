"""The robot's record with the parameters of a fit: links, rotors and friction, each with the source `fit`."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from armwright.description.paths import path_name
from armwright.description.robot import RobotDescription, Source
from armwright.errors import IdentificationError
from armwright.friction_laws import LAWS
from armwright.identification.arm.equations import Equations, SampleSource, equations_of, stacked
from armwright.identification.arm.fit import ArmFit, measures_of
from armwright.identification.arm.gear_loss import EFFICIENCY, LOWEST as LEAST_EFFICIENCY, LossyModel
from armwright.identification.arm.physical import (
    PER_LINK,
    PhysicalBounds,
    PhysicalEstimate,
    inertial_parameters,
    physical_by_log_cholesky,
    physical_by_sdp,
    pseudo_inertias,
)
from armwright.identification.arm.spring_record import SPRINGS, spring_keys
from armwright.identification.arm.torque_model import TorqueColumn, TorqueModel
from armwright.identification.estimate import Estimate, write_into
from armwright.joint_kinds import ROTARY

MASSLESS = "massless"  # in a remark of an arm that was read without masses, and which are known now
NOT_NEGATIVE = ("spring", "rotor", "viscous", "coulomb", "coulomb+", "coulomb-")
Paths = dict[int, list[tuple[str, float]]]  # column → path of a number and the factor from the column's value to it
# of friction: column, stem and dimension of the key, power of the gear ratio
NUMBERS: tuple[tuple[str, str, Any, int], ...] = (
    ("viscous", "viscous", "damping", -2),
    ("coulomb", "coulomb_positive", "torque", -1),
    ("coulomb", "coulomb_negative", "torque", -1),
    ("coulomb+", "coulomb_positive", "torque", -1),
    ("coulomb-", "coulomb_negative", "torque", -1),
    ("offset", "offset", "torque", -1),
    ("stribeck", "stribeck_torque", "torque", -1),
)
NEAR = 0.01  # weight of a link's prior values beside the log's torques


@dataclass(frozen=True, eq=False)
class RecordParameters:
    """Parameters of all columns as a record can hold them: physically possible, one friction and one rotor a joint.

    Attributes:
        values: (p,); 0 for columns that a record has no number for.   kept: numbers of the columns that it has.
        physical: how they were found.   r2: (n,) of these values on the fitted rows.
    """

    values: np.ndarray
    kept: tuple[int, ...]
    physical: PhysicalEstimate
    r2: np.ndarray


def record_parameters(fit: ArmFit, rows: Callable[[TorqueModel], SampleSource]) -> RecordParameters:
    """Physically possible parameters nearest to the fit, of the columns that a record can hold.

    The record's own links are the prior for what the log does not determine; an arm with kinematics alone has none.

    Args:
        fit: of a log.   rows: of the log, by a model: that of an arm with gear loss is linear about other parameters.
    Raises:
        IdentificationError: no solution.
    """
    equations = fit.weighted or fit.equations
    model = equations.model
    kept = _columns_of_record(equations, fit.weights, fit.base.independent)
    # |R (A π − β)|² is what π costs beyond β
    matrix, target = fit.information @ fit.base.matrix, fit.information @ fit.values
    links = np.arange(PER_LINK * len(model.arm.bodies)).reshape(-1, PER_LINK)
    columns = [model.columns[k] for k in kept]
    positive = [k for k, column in enumerate(columns) if column.kind in NOT_NEGATIVE]
    bounds = PhysicalBounds([column.name for column in columns], links, positive)
    prior = model.prior[kept]
    known = {} if np.isnan(prior[links]).any() else {"prior": np.nan_to_num(prior), "weight": NEAR}
    try:
        found = _physical(matrix[:, kept], target, bounds, known)
    except IdentificationError as error:
        if not known or error.place != "prior":
            raise
        found = _physical(matrix[:, kept], target, bounds, {})
    values = np.zeros(len(model))
    values[kept] = found.values
    factors = fit.equations.factors
    if isinstance(model, LossyModel):
        about = model.at(values)
        factors = equations_of(rows(about)(), about).factors
    return RecordParameters(values, tuple(kept), found, measures_of(factors, values)[2])


def _physical(R: np.ndarray, z: np.ndarray, bounds: PhysicalBounds, options: dict[str, Any]) -> PhysicalEstimate:
    """By semidefinite programming where cvxpy is installed, else by log-Cholesky."""
    try:
        import cvxpy
    except ImportError:
        return physical_by_log_cholesky(R, z, bounds, **options)
    del cvxpy
    return physical_by_sdp(R, z, bounds, **options)


def _columns_of_record(equations: Equations, weights: np.ndarray, independent: np.ndarray) -> list[int]:
    """Numbers of the columns that a record has numbers for.

    Of a coupled motor its rotor, and the friction of it or of its joint, whichever explains more; of springs and counterbalances
    those that are base parameters: the fit has left out the others, or they are links' gravity.
    """
    model = equations.model
    kept = [k for k, column in enumerate(model.columns) if column.kind not in SPRINGS or k in independent]
    for joint in _coupled(model):
        of_joint = [k for k in kept if model.columns[k].joint == joint and _is_drive(model.columns[k])]
        several = [k for k in of_joint if len(model.columns[k].turned) > 1]
        own = [k for k in of_joint if len(model.columns[k].turned) == 1]
        rotors = [k for k in own if model.columns[k].kind == "rotor"]
        friction = [k for k in own if model.columns[k].kind not in ("rotor", "offset", "zero", EFFICIENCY)]
        of_motor = [k for k in several if model.columns[k].kind != "rotor"]
        choices = [rotors + drop for drop in (friction, of_motor)]
        kept = min(
            ([k for k in kept if k not in dropped] for dropped in choices),
            key=lambda columns: _residual(equations, weights, columns),
        )
    return kept


def _coupled(model: TorqueModel) -> list[str]:
    return list(dict.fromkeys(column.joint for column in model.columns if len(column.turned) > 1))


def _is_drive(column: TorqueColumn) -> bool:
    return column.kind not in ("inertial", *SPRINGS)


def _residual(equations: Equations, weights: np.ndarray, columns: Sequence[int]) -> float:
    """Weighted squares that are left with some of the columns."""
    matrix, _ = stacked(equations.factors, len(equations.model), weights)
    chosen = matrix[:, list(columns)]
    solution = np.linalg.lstsq(chosen, matrix[:, -1], rcond=1e-12)[0]
    return float(((chosen @ solution - matrix[:, -1]) ** 2).sum())


def write_record(
    fit: ArmFit,
    found: RecordParameters,
    gears: np.ndarray | None,
    estimate: Estimate,
    output: str | os.PathLike[str],
    key: str = "fit",
) -> Path:
    """Writes the arm's record with fitted links, rotors and friction, numbers of kind `fit`, and with all base parameters.

    Args:
        fit: of a log.   found: its parameters as a record can hold them.   gears: N of the log, where the record has no motors.
        estimate: base parameters.   output: path of a TOML file.   key: of the source and of the fit.
    Raises:
        OutputError, DescriptionError: as `write_into`; values that no record can hold.
    """
    text = f"{estimate.method}; log {estimate.log}, sha256 {estimate.sha256}"
    written = _Written(fit.equations.model, found, gears, key)
    record = written.description(Source(kind="fit", text=text))
    return write_into(record, _of_record(estimate, fit, found, written.paths), output, key)


def _of_record(estimate: Estimate, fit: ArmFit, found: RecordParameters, paths: Paths) -> Estimate:
    """Numbers of the record that are base parameters by themselves, then all base parameters by their formulas."""
    base = fit.base
    at_bound = dict(zip(found.kept, found.physical.at_bound, strict=True))
    numbers = [
        (path, factor, b, int(k))
        for b, k in enumerate(base.independent)
        if not np.any(base.regroup[b])
        for path, factor in paths.get(int(k), ())
    ]
    order = [b for _, _, b, _ in numbers] + list(range(len(base)))
    scale = np.array([factor for _, factor, _, _ in numbers] + [1.0] * len(base))
    values = np.array([*(found.values[k] for *_, k in numbers), *fit.values]) * scale
    return replace(
        estimate,
        names=(*(path for path, *_ in numbers), *base.formulas),
        values=values,
        covariance=estimate.covariance[np.ix_(order, order)] * np.outer(scale, scale),
        units=(*(base.columns[k].unit for *_, k in numbers), *base.units),
        at_bound=np.array([*(bool(at_bound[k]) for *_, k in numbers), *[False] * len(base)]),
        identifiable=None,
    )


@dataclass(frozen=True, eq=False)
class _Written:
    """A record as it is written: model of the fit, its parameters, N of the log, key of the source, and paths by column."""

    model: TorqueModel
    found: RecordParameters
    gears: np.ndarray | None
    key: str
    paths: Paths = field(default_factory=dict)

    def description(self, source: Source) -> RobotDescription:
        """The record; then `paths` has the paths of drive numbers by column."""
        record = self.model.arm.record
        joints = tuple(self.joint(joint) for joint in record.joints)
        links = tuple(self.link(link, record) for link in record.links)
        remarks = tuple(each for each in record.remarks if MASSLESS not in each)
        sources = {**record.sources, self.key: source}
        return record.replace(joints=joints, links=links, sources=sources, remarks=remarks)

    def link(self, link: Any, record: RobotDescription) -> Any:
        """A link with the fitted values: the whole body's for the link that moves, 0 for those that are fixed to it."""
        for i, body in enumerate(self.model.arm.bodies):
            if link.name == body.link:
                return link.replace(**inertia_table(self.found.values[PER_LINK * i : PER_LINK * (i + 1)], self.key))
            if link.name in _fixed_to(record, body.link):
                return link.replace(**inertia_table(np.zeros(PER_LINK), self.key))
        return link

    def joint(self, joint: Any) -> Any:
        """A joint with fitted rotor, gear efficiency, friction and spring."""
        model = self.model
        if joint.name not in model.arm.names:
            return joint
        own = {model.columns[k].kind: k for k in self.found.kept if model.columns[k].joint == joint.name}
        columns = {kind: k for kind, k in own.items() if _is_drive(model.columns[k])}
        index, place = model.arm.names.index(joint.name), path_name(joint.name)
        ratio = 1.0 if self.gears is None else float(self.gears[index, index])
        ratio = ratio if joint.motor is None else float(joint.motor.gear_ratio)
        known = {"value": ratio, "source": "definition"}
        bare = {"gear_ratio": known, "rotor_inertia_kg_m2": _number(0.0, self.key)}
        changes: dict[str, Any] = {}
        if "rotor" in columns:
            k, factor = columns["rotor"], ratio**-2
            self.paths[k] = [(f"{place}.motor.rotor_inertia_kg_m2", factor)]
            changes["rotor_inertia_kg_m2"] = _number(max(float(self.found.values[k]), 0.0) * factor, self.key)
            bare["coupling"] = [
                {"joint": model.arm.names[j], "ratio": {"value": share * ratio, "source": "definition"}}
                for j, share in model.columns[k].turned[1:]
            ]
        if EFFICIENCY in columns:
            k = columns[EFFICIENCY]
            self.paths[k] = [(f"{place}.motor.gear_efficiency", 1.0)]
            efficiency = float(np.clip(self.found.values[k], LEAST_EFFICIENCY, 1.0))
            changes["gear_efficiency"] = _number(efficiency, self.key)
        motor = joint.motor
        if changes:
            motor = {**bare, **changes} if motor is None else motor.replace(**changes)
        springs = {kind: float(self.found.values[k]) for kind, k in own.items() if kind in SPRINGS}
        spring, path = spring_keys(model.arm.coordinates[index], springs, self.key)
        if path is not None:
            self.paths[own["spring"]] = [(f"{place}.spring.{path}", 1.0)]
        return joint.replace(**({"motor": motor} if changes else {}), **self.friction(joint, columns, ratio), **spring)

    def friction(self, joint: Any, columns: dict[str, int], ratio: float) -> dict[str, Any]:
        """Keys of a joint's friction; none where no friction was fitted."""
        fitted = {kind: k for kind, k in columns.items() if kind not in ("rotor", "zero", EFFICIENCY)}
        if not fitted:
            return {}
        model, old, found = self.model, joint.friction, self.found.values
        lossy = isinstance(model, LossyModel) and model.lossy[model.arm.names.index(joint.name)]
        on_motor = any(len(model.columns[k].turned) > 1 for k in fitted.values()) or (
            lossy and old is not None and old.side == "motor"
        )
        key_of = (ROTARY if on_motor else joint.kind.units).key
        n = abs(ratio) if on_motor else 1.0
        values: dict[str, Any] = {"side": "motor"} if on_motor else {}
        # what loads add stays the record's
        if old is not None and model.unrubbed is not None and LAWS[old.law].by_loads:
            values |= {name: value for name, value in dict(old).items() if value is not None}
        if lossy and old is not None and old.load_coefficient is not None and "coulomb" in "".join(fitted):
            values["load_coefficient"] = old.load_coefficient
        if old is not None and old.law == "coulomb":  # the fit took Coulomb's sign over this speed
            smoothing = getattr(old, old.units.key("smoothing", "speed"))
            if smoothing is not None:
                turns = n / abs(ratio) if old.side == "motor" else n  # speeds of the new side by those of the old one
                values[key_of("smoothing", "speed")] = _scaled(smoothing, turns)
        stribeck = "stribeck" in fitted and "coulomb" in fitted
        for kind, stem, dimension, factor in NUMBERS:
            if kind in fitted and (kind != "stribeck" or stribeck):
                value = float(found[fitted[kind]])
                if kind == "offset":
                    value = self.offset(joint.name)
                if kind == "stribeck":
                    value = max(value + float(found[fitted["coulomb"]]), 0.0)
                name, scale = key_of(stem, dimension), n**factor
                path = f"{path_name(joint.name)}.friction.{name}"
                self.paths.setdefault(fitted[kind], []).append((path, scale))
                values[name] = _number(value * scale, self.key)
        if stribeck:
            speed = model.columns[fitted["stribeck"]].speed * n
            values[key_of("stribeck_speed", "speed")] = _number(speed, self.key)
        return {"friction": values}

    def offset(self, joint: str) -> float:
        """Constant torque of a joint's record: a coupled motor's acts on all its joints, so theirs are less by its share.

        Columns of offsets are the joints' own, o = Bᵀ o_record with rows of B only for motors whose friction is the motor's.
        """
        n, names = self.model.arm.n, self.model.arm.names
        shares, total = np.eye(n), np.zeros(n)
        for k in self.found.kept:
            column = self.model.columns[k]
            if column.kind == "offset":
                total[names.index(column.joint)] = self.found.values[k]
            elif len(column.turned) > 1 and column.kind != "rotor":
                for j, share in column.turned:
                    shares[names.index(column.joint), j] = share
        return float(np.linalg.solve(shares.T, total)[names.index(joint)])


def _fixed_to(record: RobotDescription, link: str) -> set[str]:
    """Links that fixed joints hang on a link."""
    found, added = {link}, True
    while added:
        more = {joint.child for joint in record.joints if not joint.kind.moves and joint.parent in found} - found
        found, added = found | more, bool(more)
    return found - {link}


def inertia_table(parameters: np.ndarray, key: str) -> dict[str, Any]:
    """Keys of a link's record from its inertial parameters (10,) about the link frame's origin.

    They are lifted to the edge of the possible where rounding has left them beyond it.
    """
    pseudo = pseudo_inertias(parameters)
    values, vectors = np.linalg.eigh(pseudo)
    if values[0] < 0 <= values[-1]:
        parameters = inertial_parameters((vectors * np.maximum(values, 1e-12 * values[-1])) @ vectors.T)
    mass = float(parameters[0])
    com = parameters[1:4] / mass if mass > 0 else np.zeros(3)
    xx, xy, xz, yy, yz, zz = parameters[4:]
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    tensor = tensor - mass * (com @ com * np.eye(3) - np.outer(com, com))
    names = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
    return {
        "mass_kg": _number(mass, key),
        "com_m": {"value": [float(c) for c in com], "source": key},
        "inertia_kg_m2": {name: _number(float(tensor[place]), key) for name, place in names.items()},
    }


def _number(value: float, key: str) -> dict[str, Any]:
    return {"value": value, "source": key}


def _scaled(quantity: Any, factor: float) -> Any:
    """The quantity with value and deviation times a factor, from the same source."""
    if factor == 1.0:
        return quantity
    std = None if quantity.std is None else quantity.std * factor
    return quantity.replace(value=quantity.number * factor, std=std)

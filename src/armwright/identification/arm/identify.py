"""Identification of an arm: a log of positions and torques → base parameters with error bars → a record."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armwright.description.robot import Source
from armwright.errors import IdentificationError
from armwright.identification.arm.arm_record import Paths, RecordParameters, described, record_parameters
from armwright.identification.arm.base import BaseParameters, base_parameters, regrouped
from armwright.identification.arm.equations import Equations, Samples, equations_of, samples_of, stacked
from armwright.identification.arm.fit import (
    AT_REST,
    ArmFit,
    HeldOut,
    cross_validated,
    fit_arm,
    fit_robust,
    measures_of,
    with_correlation,
)
from armwright.identification.arm.separating import sentences
from armwright.identification.arm.spring_record import SPRINGS
from armwright.identification.arm.torque_model import USUAL_FRICTION, TorqueModel, torque_model
from armwright.identification.estimate import HALF_95, Estimate, write_into
from armwright.identification.identifiability import MEANINGLESS
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import Preparation, choose_preparation
from armwright.model import Model

METHODS = ("ols", "wls", "irls", "tukey")
FOLDS = 8  # parts of a log with few runs
MANY_RUNS = 4  # from here on each run is a part
IN_MEMORY = 20_000_000  # numbers of prepared rows that stay in memory: 160 MB; longer logs are read again
GAIN = 0.01  # of the held-out error, that a spring must bring
SMALLER, LARGER = 0.7, 1.3  # cut-offs that the fit is compared at
MOST_NAMED = 6  # parameters in one remark
POOR = 0.8  # R² of a joint below which a remark says so
LEAST_HELD_OUT = 0.5  # R² of a joint that moves, on rows that were not fitted, for "identified"
FACTOR = 5.0  # between the record's links and the identified ones, from which the torque's unit is in doubt


@dataclass(frozen=True, eq=False)
class ArmEstimate:
    """Result of `identify_arm`.

    Attributes:
        estimate: base parameters with covariance, measures by joint, remarks and verdict.   fit: least squares behind it.
        formulas: of the base parameters.   structural: their number by the arm's structure alone, whatever its motion.
        held_out: errors on each part, of fits to the others.   hold_out: (n,) R² on the runs that the log holds out, together;
            None where there are none.
        sensitive: names of parameters that leave their 95 % interval at another cut-off.
        record: physically possible parameters for a record; None where it was not asked for.   gears: N of the log, or None.
    """

    estimate: Estimate
    fit: ArmFit
    formulas: tuple[str, ...]
    structural: int
    held_out: tuple[HeldOut, ...]
    hold_out: np.ndarray | None
    sensitive: tuple[str, ...]
    record: RecordParameters | None
    gears: np.ndarray | None

    @property
    def verdict(self) -> str:
        """ "identified" or "not identified"."""
        return self.estimate.verdict

    def __str__(self) -> str:
        return str(self.estimate)

    def write(self, output: str | os.PathLike[str], key: str = "fit") -> Path:
        """Writes the robot's record with the fitted links, rotors and friction, source of kind `fit`.

        Links are physically possible and have the fitted base parameters as nearly as that allows; the base parameters
        themselves, with their deviations, stand in `[fits.KEY]`.

        Args:
            output: path of a TOML file.   key: of the source and of the fit.
        Raises:
            IdentificationError: the record's values were not asked for.   OutputError, DescriptionError: as `write_into`.
        """
        if self.record is None:
            raise IdentificationError("no values for a record", place="record", expected="identify_arm(…, record=True)")
        model, estimate = self.fit.equations.model, self.estimate
        text = f"{estimate.method}; log {estimate.log}, sha256 {estimate.sha256}"
        record, paths = described(model, self.record, self.gears, Source(kind="fit", text=text), key)
        return write_into(record, self._of_record(paths), output, key)

    def _of_record(self, paths: Paths) -> Estimate:
        """Numbers of the record that are base parameters by themselves, then all base parameters by their formulas."""
        assert self.record is not None
        base, found, estimate = self.fit.base, self.record, self.estimate
        at_bound = dict(zip(found.kept, found.physical.at_bound, strict=True))
        numbers = [
            (path, factor, b, int(k))
            for b, k in enumerate(base.independent)
            if not np.any(base.regroup[b])
            for path, factor in paths.get(int(k), ())
        ]
        order = [b for _, _, b, _ in numbers] + list(range(len(base)))
        scale = np.array([factor for _, factor, _, _ in numbers] + [1.0] * len(base))
        values = np.array([*(found.values[k] for *_, k in numbers), *self.fit.values]) * scale
        return replace(
            estimate,
            names=(*(path for path, *_ in numbers), *self.formulas),
            values=values,
            covariance=estimate.covariance[np.ix_(order, order)] * np.outer(scale, scale),
            units=(*(base.columns[k].unit for *_, k in numbers), *base.units),
            at_bound=np.array([*(bool(at_bound[k]) for *_, k in numbers), *[False] * len(base)]),
            identifiable=None,
        )


def identify_arm(
    log: Log,
    robot: Model | None = None,
    *,
    runs: Sequence[str] | None = None,
    method: str = "wls",
    friction: Collection[str] = USUAL_FRICTION,
    springs: Collection[str] = (),
    lacks: Collection[str] | None = None,
    stribeck_speed: float | None = None,
    cutoff: float | None = None,
    decimate: int | None = None,
    record: bool = True,
    sensitivity: bool = True,
) -> ArmEstimate:
    """Masses, rotors and friction of an arm from a log of positions and motor torques, currents or voltages.

    tau = Y(q, q̇, q̈) π  is linear in the parameters; the combinations of them that torques depend on, the base parameters, are
    fitted by least squares to prepared rows, read in blocks. [GautierKhalil1990]

    Args:
        log: what `read_log` returned.   robot: a full record or kinematics alone; None: the log's robot.
        runs: names of those to fit; None: those that the log marks so.
        method: "ols"; "wls", every joint weighted by its residuals; "irls" or "tukey", which also let outliers count less.
        friction: terms, of "viscous", "coulomb", "offset", "asymmetric" (Coulomb's level by direction) and "stribeck".
        springs: names of joints whose spring and counterbalance stay if they lower the held-out error by 1 % or more.
        stribeck_speed: of the term "stribeck", at the joint [rad/s | m/s].
        lacks: terms that the measured torque is without, such as "gravity"; None: what the log's file says.
        cutoff: of the low-pass, in Hz.   decimate: every how many rows to keep; None: chosen.
        record: also find physically possible values for a record.   sensitivity: also fit at cut-offs 30 % lower and higher.
    Returns:
        result: `result.estimate` has the base parameters, `result.write(path)` writes the record.
    Raises:
        IdentificationError: no robot, no torques, too few rows, an unknown term.
        LogError: joints of the robot that are not in the log, a filter that the log's rate does not allow.
    """
    if method not in METHODS:
        raise IdentificationError(place="method", value=method, choices=METHODS)
    arm = log.arm if robot is None else robot
    if arm is None:
        raise IdentificationError(
            "missing", place="robot", expected="an arm, or kinematics alone, here or in the log's file"
        )
    runs = list(log.fit if runs is None else runs)
    gears = None if log.gears is None or len(log.gears) != arm.n else log.gears
    model = torque_model(
        arm, friction=friction, springs=springs, lacks=_lacks(log, lacks), stribeck_speed=stribeck_speed, gears=gears
    )
    prepared = {run: choose_preparation(log, run, cutoff=cutoff, decimate=decimate) for run in runs}
    source = _Rows(log, model, runs, prepared)
    seconds = _part_seconds(log, runs)
    equations = equations_of(source(), model, part_seconds=seconds)
    dropped = _useless_springs(equations)
    structural = base_parameters(model, dropped)
    base = _of_log(model, equations, structural, dropped)
    fit = _fitted(source, equations, base, method, seconds)
    held_out = tuple(cross_validated(fit)) if len(equations.parts) > 1 else ()
    kept_back = [run for run in log.hold_out if run not in runs]
    hold_out, moved = _predicted(log, model, kept_back, cutoff, decimate, fit) if kept_back else (None, None)
    sensitive = _sensitive(log, model, prepared, fit) if sensitivity else ()
    values = record_parameters(fit) if record else None
    remarks = _remarks(fit, structural, sentences(fit, source()), sensitive, held_out, values, prepared[runs[0]])
    doubts = [*_unpredicted(fit, held_out, hold_out, moved), *_unlike_the_record(fit)]
    about = f"{_METHOD[method]} of {equations.rows.max()} rows, {model.arm.n} joints, cut-off {prepared[runs[0]].cutoff:.4g} Hz"
    estimate = Estimate(
        names=tuple(base.names), values=fit.values, covariance=fit.covariance, sha256=log.sha256, method=about,
        units=tuple(base.units), remarks=(*remarks, *doubts), condition=fit.condition, fit=_measures(fit, held_out, hold_out),
        verdict="not identified" if doubts else _verdict(fit, structural), log=log.path.name,
    )  # fmt: skip
    return ArmEstimate(
        estimate, fit, tuple(base.formulas), len(structural), held_out, hold_out, sensitive, values, gears
    )


_METHOD = {
    "ols": "ordinary least squares",
    "wls": "least squares weighted by joint",
    "irls": "least squares with Huber's weights",
    "tukey": "least squares with Tukey's weights",
}


def _lacks(log: Log, lacks: Collection[str] | None) -> Collection[str]:
    """Terms that the measured torque is without: as asked for, else as the log's file says."""
    if lacks is not None:
        return lacks
    return tuple(dict.fromkeys(term for signal in log.table.signals for term in signal.lacks))


class _Rows:
    """Prepared rows of a log, in memory where they are few, else read again at each call."""

    def __init__(self, log: Log, model: TorqueModel, runs: Sequence[str], prepared: Mapping[str, Preparation]):
        self._read = lambda: samples_of(log, model, runs, prepared)
        rows = sum(log.run(run).rows / prepared[run].decimate for run in runs)
        self._few = rows * (4 * model.arm.n + 1) < IN_MEMORY
        self._kept: list[Samples] | None = None

    def __call__(self) -> Iterator[Samples]:
        """The rows, block by block."""
        if not self._few:
            return self._read()
        if self._kept is None:
            self._kept = list(self._read())
        return iter(self._kept)


def _part_seconds(log: Log, runs: Sequence[str]) -> float:
    """Length of a part [s]: whole runs where there are several, else a share of the time."""
    if len(runs) >= MANY_RUNS:
        return np.inf
    return max(sum(log.run(run).duration for run in runs) / FOLDS, 1e-9)


def _of_log(
    model: TorqueModel, equations: Equations, structural: BaseParameters, dropped: Sequence[int]
) -> BaseParameters:
    """Base parameters that the log can tell: those of the structure, regrouped further where its motion leaves columns equal."""
    own = _regrouped_without(equations, dropped)
    return own if len(own) < len(structural) else structural


def _regrouped_without(equations: Equations, dropped: Sequence[int]) -> BaseParameters:
    """Base parameters of a log's rows without some columns."""
    columns = len(equations.model)
    matrix = stacked(equations.factors, columns)[0][:, :columns]
    matrix[:, list(dropped)] = 0.0
    return regrouped(equations.model.columns, matrix)


def _useless_springs(equations: Equations) -> list[int]:
    """Numbers of spring and counterbalance columns of joints whose candidates lower the held-out error by less than 1 %."""
    columns, dropped = equations.model.columns, []
    candidates = dict.fromkeys(column.joint for column in columns if column.kind in SPRINGS)
    if not candidates:
        return []
    if len(equations.parts) < 2:
        raise IdentificationError("one part", place="springs", expected="a longer log, to hold parts out")
    for joint in candidates:
        own = [k for k, column in enumerate(columns) if column.kind in SPRINGS and column.joint == joint]
        with_it, without = (_held_out_error(equations, each) for each in (dropped, dropped + own))
        if with_it > (1 - GAIN) * without:
            dropped += own
    return dropped


def _held_out_error(equations: Equations, dropped: Sequence[int]) -> float:
    """Root mean square of the held-out errors over all parts that move."""
    parts = cross_validated(fit_arm(equations, _regrouped_without(equations, dropped)))
    return float(np.sqrt(np.nanmean([each.error**2 for each in parts if not each.at_rest])))


def _fitted(source: _Rows, equations: Equations, base: BaseParameters, method: str, seconds: float) -> ArmFit:
    if method in ("irls", "tukey"):
        fit = fit_robust(source, equations, base, "huber" if method == "irls" else "tukey", seconds)
    else:
        fit = fit_arm(equations, base, method)
    return with_correlation(source, fit)


def _predicted(
    log: Log, model: TorqueModel, runs: Sequence[str], cutoff: float | None, decimate: int | None, fit: ArmFit
) -> tuple[np.ndarray, np.ndarray]:
    """R² (n,) of a fit on runs that it has not seen, and which joints (n,) move there."""
    prepared = {run: choose_preparation(log, run, cutoff=cutoff, decimate=decimate) for run in runs}
    equations = equations_of(samples_of(log, model, runs, prepared), model, part_seconds=np.inf)
    return measures_of(equations.factors, fit.parameters)[2], _moving(equations)


def _moving(equations: Equations) -> np.ndarray:
    """Which joints (n,) are faster than a hundredth of the fastest, in root mean square."""
    motion = np.sum([part.motion for part in equations.parts], axis=0)
    return motion > AT_REST**2 * motion.max()


def _unpredicted(
    fit: ArmFit, held_out: Sequence[HeldOut], hold_out: np.ndarray | None, moved: np.ndarray | None
) -> list[str]:
    """Sentences about joints that move and whose torque is not predicted where it was not fitted.

    That is on the runs that the log holds out, or where there are none on its parts, each by a fit to the others.
    """
    where, moving, r2s = "on the runs held out", _moving(fit.equations), hold_out
    if r2s is None or moved is None:
        parts = [each.relative**2 for each in held_out if not each.at_rest]
        if not parts:
            return []
        with np.errstate(divide="ignore", invalid="ignore"):
            spread = fit.rms**2 / (1.0 - fit.r2)  # of the measured torque
            r2s = 1.0 - np.mean(parts, axis=0) * fit.torque_rms**2 / spread
        where = "on parts held out"
    else:
        moving &= moved
    return [
        f"{joint}: R² {r2:.2f} {where}, below {LEAST_HELD_OUT:g}: its torque is not told by this model"
        for joint, r2, moves in zip(fit.equations.model.arm.names, r2s, moving, strict=True)
        if moves and r2 < LEAST_HELD_OUT
    ]


def _unlike_the_record(fit: ArmFit) -> list[str]:
    """A sentence where links as identified take 5 times the torque of the record's own or more, or a fifth or less.

    Both are compared by their base parameters, over the rows of the log and weighted as the fit; those that a rotor has part in
    of which the record does not speak are left out.
    """
    base, prior = fit.base, fit.equations.model.prior
    unknown = (base.matrix[:, np.isnan(prior)] != 0).any(axis=1)
    of_links = [b for b, k in enumerate(base.independent) if base.columns[k].kind == "inertial" and not unknown[b]]
    own = base.of(np.nan_to_num(prior))[of_links]
    size = np.linalg.norm(fit.information[:, of_links] @ own)
    if size == 0:
        return []
    times = float(np.linalg.norm(fit.information[:, of_links] @ fit.values[of_links]) / size)
    if 1 / FACTOR <= times <= FACTOR:
        return []
    return [
        f"the links' masses and inertias take {times:.2g} times the torque of the record's own: is the unit or the side of "
        "the torque right?"
    ]


def _sensitive(log: Log, model: TorqueModel, prepared: Mapping[str, Preparation], fit: ArmFit) -> tuple[str, ...]:
    """Names of parameters that leave their 95 % interval where the cut-off is 30 % lower or higher."""
    moved = np.zeros(len(fit.base), dtype=bool)
    for factor in (SMALLER, LARGER):
        other = {}
        for run, each in prepared.items():
            cutoff = min(factor * each.cutoff, 0.45 * each.rate)
            most = max(int(each.rate / (2 * cutoff)), 1)
            other[run] = choose_preparation(
                log, run, cutoff=cutoff, order=each.order, decimate=min(each.decimate, most),
                differentiation=each.differentiation,
            )  # fmt: skip
        try:
            equations = equations_of(samples_of(log, model, list(prepared), other), model)
            again = fit_arm(equations, fit.base, "wls", fit.weights)
        except IdentificationError:  # a filter so slow that too few rows are left
            continue
        moved |= np.abs(again.values - fit.values) > HALF_95 * fit.std
    return tuple(name for name, out in zip(fit.base.names, moved, strict=True) if out)


def _measures(fit: ArmFit, held_out: Sequence[HeldOut], hold_out: np.ndarray | None) -> dict[str, dict[str, float]]:
    """Measures by joint: R², RMS of the residual, error on held-out parts that move, R² on the hold-out runs."""
    moving = [each.relative for each in held_out if not each.at_rest]
    measures = {}
    for j, joint in enumerate(fit.equations.model.arm.names):
        if np.isnan(fit.rms[j]):
            continue
        measures[joint] = {"r2": float(fit.r2[j]), "rms": float(fit.rms[j])}
        if moving:
            measures[joint]["held_out"] = float(np.sqrt(np.mean([each[j] ** 2 for each in moving])))
        if hold_out is not None:
            measures[joint]["hold_out_r2"] = float(hold_out[j])
    return measures


def _verdict(fit: ArmFit, structural: BaseParameters) -> Any:
    """ "not identified" where the log tells fewer parameters than the arm has, or too badly for their values to mean anything."""
    poor = len(fit.base) < len(structural) or fit.condition > MEANINGLESS or bool((fit.r2 <= 0).any())
    return "not identified" if poor else "identified"


def _remarks(
    fit: ArmFit,
    structural: BaseParameters,
    directions: Sequence[str],
    sensitive: Sequence[str],
    held_out: Sequence[HeldOut],
    values: RecordParameters | None,
    prepared: Preparation,
) -> list[str]:
    """Sentences for the user."""
    model, base = fit.equations.model, fit.base
    remarks = [f"{len(base)} of {len(structural)} base parameters, condition number {fit.condition:.3g}"]
    if len(base) < len(structural):
        lost = [base.columns[k].about for k in structural.independent if k not in set(base.independent)]
        remarks.append(f"this motion tells nothing apart of: {_listed(lost)}")
    if fit.condition > MEANINGLESS:
        remarks.append("at this condition number single parameters mean nothing; design a motion that excites more")
    remarks += directions
    untold = [
        name for name, value, std in zip(base.names, fit.values, fit.std, strict=True) if abs(value) < HALF_95 * std
    ]
    if untold:
        remarks.append(f"not told from 0: {_listed(untold)}")
    negative = [
        base.columns[k].about
        for k, value, row in zip(base.independent, fit.values, base.regroup, strict=True)
        if value < 0 and not np.any(row) and base.columns[k].kind in ("rotor", "viscous", "coulomb")
    ]
    if negative:
        remarks.append(f"negative without being possible, which a record cannot hold: {_listed(negative)}")
    if sensitive:
        remarks.append(
            f"leave their 95 % interval at a cut-off 30 % off {prepared.cutoff:.4g} Hz: {_listed(list(sensitive))}"
        )
    for joint, r2 in zip(model.arm.names, fit.r2, strict=True):
        if r2 < POOR:
            remarks.append(
                f"{joint}: R² {r2:.2f}, {1 - r2:.0%} of the torque's variance is not of this model; look at its friction, "
                "its springs and at what the torque column lacks"
            )
        elif np.isnan(r2):
            remarks.append(f"{joint}: no torque was measured, or it never changes")
    resting = sum(each.at_rest for each in held_out)
    if resting:
        remarks.append(
            f"{resting} of {len(held_out)} held-out parts are at rest, where friction has no known direction"
        )
    candidates = {column.joint: column.kind in SPRINGS for column in model.columns if column.kind in SPRINGS}
    kept = {base.columns[k].joint for k in base.independent if base.columns[k].kind in SPRINGS}
    remarks += [
        f"{joint}: its spring and counterbalance {'stay' if joint in kept else 'are left out'}: they lower the held-out error by "
        f"{'1 % or more' if joint in kept else 'less than 1 %'}"
        for joint in candidates
    ]
    if fit.outliers is not None and fit.outliers.dropped > 0:
        remarks.append(f"{fit.outliers.dropped:.1%} of the torques count less than half as outliers")
    if any(body.drive.efficiency is not None for body in model.arm.coordinates):
        remarks.append("gear losses of the record are not part of this model: friction and inertia contain them")
    if values is not None:
        worst = float(np.nanmax(fit.r2 - values.r2))
        remarks.append(f"physically possible values for the record: R² at most {max(worst, 0.0):.3f} lower")
        remarks += values.physical.remarks
    return remarks


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:MOST_NAMED])
    return shown if len(names) <= MOST_NAMED else f"{shown} and {len(names) - MOST_NAMED} more"

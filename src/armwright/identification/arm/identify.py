"""Identification of an arm: a log of positions and torques → base parameters with error bars → a record."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from armwright.description.robot import Source
from armwright.entry import as_arm, as_log
from armwright.errors import ArmwrightError, IdentificationError
from armwright.identification.arm.arm_record import Paths, RecordParameters, described, record_parameters
from armwright.identification.arm.base import (
    BaseParameters,
    base_parameters,
    regrouped,
    regrouped_further,
    told_parameters,
)
from armwright.identification.arm.closed_loop import Feedback, following
from armwright.identification.arm.equations import Equations, SampleSource, equations_of, part_seconds
from armwright.identification.arm.fit import ArmFit, HeldOut, cross_validated, fit_arm, measures_of
from armwright.identification.arm.fit_noise import error_by_noise
from armwright.identification.arm.gear_loss import (
    GearProblem,
    LossyModel,
    check_losses,
    distance,
    doubtful_losses,
    fit_gears,
    loss_remarks,
    lossy_model,
)
from armwright.identification.arm.methods import METHODS, FitProblem
from armwright.identification.arm.misread import late_torques, misread_columns
from armwright.identification.arm.remarks import (
    MOST_NAMED,
    driving_frictions,
    impossible_parameters,
    measures_by_joint,
    negative_inertias,
    remarks_on,
    unexplained,
    unlike_the_record,
    unpredicted,
    verdict_of,
)
from armwright.identification.arm.samples import Memory, Stream, checked, samples_of
from armwright.identification.arm.separating import sentences
from armwright.identification.arm.spring_record import SPRINGS
from armwright.identification.arm.torque_model import SUPPORT, USUAL_FRICTION, TorqueModel, torque_model
from armwright.identification.estimate import HALF_95, Estimate, write_into
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import Preparation, choose_preparation
from armwright.identification.validation.comparison import NO_HOLD_OUT, RecordComparison, compare_records
from armwright.identification.validation.validate import Validation
from armwright.model import Model
from armwright.model.load import load
from armwright.results.page_parts import definitions, sentence
from armwright.results.result import Result
from armwright.results.table import Table, number

GAIN = 0.01  # of the held-out error, that a spring must bring
MOST_PASSES, SETTLED = 5, 0.05  # fits of a lossy arm about the last one, until it moves by less than so many deviations
JOINTS = ("joint", "R²", "RMS", "of the torque [%]", "held out [%]", "unit")
SMALLER, LARGER = 0.7, 1.3  # cut-offs that the fit is compared at


@dataclass(frozen=True, eq=False)
class ArmEstimate(Result):
    """Result of `identify_arm`.

    Attributes:
        estimate: base parameters with covariance, measures by joint, remarks and verdict.   fit: least squares behind it.
        formulas: of the base parameters.   structural: their number by the arm's structure alone, whatever its motion.
        held_out: errors on each part, of fits to the others.
        hold_out: the record judged on the runs that the log holds out, by the measures of `validate`; None where there are none.
        sensitive: names of parameters that leave their 95 % interval at another cut-off.
        record: physically possible parameters for a record; None where it was not asked for.   gears: N of the log, or None.
    """

    estimate: Estimate
    fit: ArmFit
    formulas: tuple[str, ...]
    structural: int
    held_out: tuple[HeldOut, ...]
    hold_out: RecordComparison | None
    sensitive: tuple[str, ...]
    record: RecordParameters | None
    gears: np.ndarray | None

    @property
    def verdict(self) -> str:
        """ "identified" or "not identified"."""
        return self.estimate.verdict

    @property
    def good(self) -> bool:
        """True if the log determines the parameters."""
        return self.estimate.good

    def sentences(self) -> list[str]:
        """Remarks, then the verdict."""
        return [*map(sentence, self.estimate.remarks), self.verdict]

    def tables(self) -> list[Table]:
        """Base parameters by their formulas; measures of each joint; the record on the runs held out."""
        parameters, *_ = self.estimate.tables()
        named = [[formula, *row[1:]] for formula, row in zip(self.formulas, parameters.cells, strict=True)]
        joints = []
        for j, body in enumerate(self.fit.equations.model.arm.coordinates):
            held = self.estimate.fit.get(body.joint, {}).get("held_out")
            share = 100.0 * self.fit.rms[j] / self.fit.torque_rms[j] if self.fit.torque_rms[j] > 0 else None
            unit = body.kind.units.torque
            shares = (number(share, ".3g"), number(None if held is None else 100.0 * held, ".3g"))
            joints.append([body.joint, number(self.fit.r2[j]), number(self.fit.rms[j]), *shares, unit])
        found = [replace(parameters, cells=named), Table("joints", JOINTS, joints, ("unit",))]
        return found if self.hold_out is None else [*found, self.hold_out.table()]

    def report(self, path: str | os.PathLike[str], validation: Validation | None = None) -> Path:
        """Writes a page: verdict, what to do next, parameters, correlations, fits, and how base parameters are grouped.

        Args:
            path: ending in .html.   validation: of the record that was written, if it was compared with the log.
        Returns:
            path: of the page.
        Raises:
            OutputError: the file cannot be written.
        """
        from armwright.identification.validation.report import write_report  # which draws

        formulas = [pair for pair in zip(self.estimate.names, self.formulas, strict=True) if pair[0] != pair[1]]
        grouped = definitions("Regrouping", formulas)
        return write_report(path, f"{self.estimate.log}: arm", self.estimate, validation, grouped)

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
    arm: Model | None = None,
    *,
    runs: Sequence[str] | None = None,
    method: str = "wls",
    friction: Collection[str] = USUAL_FRICTION,
    springs: Collection[str] = (),
    lacks: Collection[str] | None = None,
    stribeck_speed: float | None = None,
    cutoff: float | None = None,
    decimate: int | None = None,
    feedback: Feedback | tuple[Any, Any, float] | None = None,
    forgetting: float = 1.0,
    fit_efficiency: Collection[str] | Literal["all"] = (),
    record: bool = True,
    sensitivity: bool = True,
) -> ArmEstimate:
    """Masses, rotors and friction of an arm from a log of positions and motor torques, currents or voltages.

    tau = Y(q, q̇, q̈) π  is linear in the parameters; the combinations of them that torques depend on, the base parameters, are
    fitted by least squares to prepared rows, read in blocks. [GautierKhalil1990]  Of an arm whose record has gear efficiencies or
    load-proportional friction, links and friction are those beside this loss (`gear_loss`).

    Args:
        log: what `read_log` returned.   arm: a full record or kinematics alone; None: the log's robot.
        runs: names of those to fit; None: those that the log marks so.
        method: least squares "ols"; "wls", every joint weighted by its residuals; "irls" or "tukey", which also let outliers
            count less; "essential", which leaves out what the log hardly tells; "recursive", row by row. Or by a simulated loop:
            "iv", instruments against the bias of feedback; "didim", from torques alone; "cloe", from positions alone.
        friction: terms, of "viscous", "coulomb", "offset", "asymmetric" (Coulomb's level by direction) and "stribeck".
        springs: names of joints whose spring and counterbalance stay if they lower the held-out error by 1 % or more.
        stribeck_speed: of the term "stribeck", at the joint [rad/s | m/s].
        lacks: terms that the measured torque is without, such as "gravity"; None: what the log's file says.
        cutoff: of the low-pass, in Hz.   decimate: every how many rows to keep; None: chosen.
        feedback: of the log's one run, for "iv", "didim" and "cloe"; or (kp, kd, period) of a controller whose reference is not
            known, in whose place the logged positions stand.   forgetting: of "recursive", for each row, at most 1.
        fit_efficiency: names of joints whose gear efficiency is one more parameter, or "all"; others have the record's.
        record: also find physically possible values for a record; runs held out judge it, so that then it is found in any case.
        sensitivity: also fit at cut-offs 30 % lower and higher.
    Returns:
        result: `result.estimate` has the base parameters, `result.write(path)` writes the record.
    Raises:
        IdentificationError: no robot, no torques, too few rows, an unknown term; of gears with loss a method or a torque that
            goes without, an efficiency to fit of which the log hardly says anything.
        LogError: joints of the robot that are not in the log, a filter that the log's rate does not allow.
    """
    if method not in METHODS:
        raise IdentificationError(place="method", value=method, choices=tuple(METHODS))
    log = as_log(log)
    arm = log.arm if arm is None else as_arm(arm)
    if arm is None:
        raise IdentificationError(
            "missing", place="arm", expected="an arm, or kinematics alone, here or in the log's file"
        )
    log = checked(log, arm, runs)
    stream = Stream(log, arm, runs, cutoff=cutoff, decimate=decimate)
    absent = stream.lacks if lacks is None else lacks
    model = torque_model(
        arm, friction=friction, springs=springs, lacks=absent, stribeck_speed=stribeck_speed, gears=stream.gears
    )
    lossy = lossy_model(model, fit_efficiency)
    if lossy is not None:
        check_losses(lossy, method, absent)
    fitted = _fitted(stream, model, lossy, method, feedback, forgetting, strict=fit_efficiency != "all")
    return judged(_estimate(fitted, method, sensitivity, record or bool(stream.hold_out)), log, arm, stream.hold_out)


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A fit of a stream's rows.

    Attributes:
        stream: of the log.   rows: its samples for the fit's model.   fit: found.   base: identifiable from the log.
        structural: base parameters of the arm.   untold: joints whose efficiency stays the record's, each with the reason.
    """

    stream: Stream
    rows: SampleSource
    fit: ArmFit
    base: BaseParameters
    structural: BaseParameters
    untold: Mapping[str, str]


def _fitted(
    stream: Stream,
    model: TorqueModel,
    lossy: LossyModel | None,
    method: str,
    feedback: Feedback | tuple[Any, Any, float] | None,
    forgetting: float,
    strict: bool,
) -> _Fitted:
    """The fit by a method; of a lossy arm about its own solution."""
    seconds, untold = part_seconds(stream.runs, stream.seconds), {}
    memory: Memory | None = None if lossy is None else {}

    def read(model: TorqueModel) -> tuple[SampleSource, Equations]:
        rows = stream.kept(model, memory)
        return rows, equations_of(rows(), model, part_seconds=seconds)

    if lossy is None:
        rows, equations = read(model)
        dropped = _useless_springs(equations)
    else:
        problem = GearProblem(lambda each: read(each)[1], told_parameters, method)
        gears_fit = fit_gears(problem, lossy, _useless_springs, lambda each: stream.kept(each, memory)(), strict=strict)
        model, equations, dropped, untold = gears_fit.model, gears_fit.equations, gears_fit.dropped, gears_fit.untold
        rows = stream.kept(model, memory)
    structural = base_parameters(model, dropped)
    base = regrouped_further(structural, equations.factor)
    loop = None if feedback is None else _loop(feedback, rows, stream.prepared[stream.runs[0]], model.arm.n)
    fit = METHODS[method].fit(FitProblem(rows, equations, base, seconds, loop, forgetting))
    for _ in range(MOST_PASSES):
        if not isinstance(model, LossyModel) or distance(fit) < SETTLED:
            break
        model = model.at(fit.parameters)
        rows, equations = read(model)
        fit = METHODS[method].fit(FitProblem(rows, equations, base, seconds, loop, forgetting))
    return _Fitted(stream, rows, fit, base, structural, untold)


def _estimate(found: _Fitted, method: str, sensitivity: bool, record: bool) -> ArmEstimate:
    """The estimate with remarks, measures and a verdict on the fitted rows."""
    fit, base, structural, rows, prepared = found.fit, found.base, found.structural, found.rows, found.stream.prepared
    model, equations = fit.equations.model, fit.equations
    held_out = tuple(cross_validated(fit)) if len(equations.parts) > 1 and METHODS[method].parts else ()
    sensitive = _sensitive(found.stream, fit) if sensitivity and METHODS[method].parts else ()
    values = record_parameters(fit) if record else None
    if values is not None and isinstance(model, LossyModel):
        again = model.at(values.values)
        factors = equations_of(found.stream.kept(again)(), again).factors
        values = replace(values, r2=measures_of(factors, values.values)[2])
    some, cut = next(iter(rows())), next(iter(prepared.values()))
    directions = [*sentences(fit, rows()), *_separating(equations, base, structural)]
    remarks = remarks_on(fit, base, structural, directions, sensitive, held_out, values, cut)
    driving, negative, impossible = (
        driving_frictions(fit),
        negative_inertias(fit, some),
        impossible_parameters(fit, values),
    )
    doubts = [*unlike_the_record(fit), *driving, *negative]
    measures, verdict = measures_by_joint(fit, held_out), verdict_of(fit, len(base), len(structural))
    remarks += late_torques(fit, some)
    doubts += [*([] if driving else misread_columns(fit, some)), *impossible]
    remarks += [*loss_remarks(fit, found.untold), *SUPPORT.notes(model.arm)]
    doubts = [*doubtful_losses(fit), *doubts]
    about = f"{METHODS[method].about} of {equations.rows.max()} rows, {model.arm.n} joints, cut-off {cut.cutoff:.4g} Hz"
    estimate = Estimate(
        names=tuple(fit.base.names), values=fit.values, covariance=fit.covariance, sha256=found.stream.sha256, method=about,
        units=tuple(fit.base.units), remarks=(*remarks, *doubts, *found.stream.warnings), condition=fit.condition,
        fit=measures, verdict="not identified" if doubts else verdict, log=found.stream.name,
    )  # fmt: skip
    return ArmEstimate(
        estimate, fit, tuple(fit.base.formulas), len(structural), held_out, None, sensitive, values, found.stream.gears
    )


def judged(found: ArmEstimate, log: Log, arm: Model, runs: Sequence[str]) -> ArmEstimate:
    """The estimate with its record's torques on the runs held out, or where there are none with those of the parts held out.

    A joint that is predicted with R² below 0.5, or worse than by the record that came in, makes it "not identified".
    """
    fit, said, comparison = found.fit, [], None
    if runs:
        try:
            with TemporaryDirectory() as folder:
                written = load(found.write(Path(folder) / "arm.toml"))
            noise = error_by_noise(fit, log, runs)
            comparison = compare_records(written, arm, log, runs, simulation=False, noise=noise)
            said = comparison.remarks
        except ArmwrightError as error:
            said = [f"the runs held out do not judge the record: {error}"]
    else:
        said = [NO_HOLD_OUT]
    doubts = unpredicted(fit, found.held_out) if comparison is None else unexplained(fit, comparison) + comparison.worse
    estimate = replace(
        found.estimate,
        remarks=(*found.estimate.remarks, *said, *doubts),
        verdict="not identified" if doubts else found.verdict,
        fit={**found.estimate.fit, **(comparison.measures if comparison else {})},
    )  # fmt: skip
    return replace(found, estimate=estimate, hold_out=comparison)


def _loop(feedback: Feedback | tuple[Any, Any, float], source: SampleSource, prepared: Preparation, n: int) -> Feedback:
    """The log's loop, with the low-pass that its rows went through."""
    if isinstance(feedback, Feedback):
        return replace(feedback, cutoff=prepared.cutoff, order=prepared.order)
    kp, kd, period = feedback
    for place, gains in (("feedback kp", kp), ("feedback kd", kd)):
        if np.size(gains) not in (1, n) or not np.isfinite(np.asarray(gains, dtype=float)).all():
            raise IdentificationError(place=place, value=gains, expected=f"{n} numbers, one for each joint")
    if not period > 0:
        raise IdentificationError(place="feedback period", value=period, expected="a number above 0 [s]")
    loop = following(list(source()), np.broadcast_to(kp, n), np.broadcast_to(kd, n), period)
    return replace(loop, cutoff=prepared.cutoff, order=prepared.order)


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
    """Root mean square of the held-out errors over all parts that move, of a fit without some columns."""
    factor = equations.factor
    factor[:, list(dropped)] = 0.0
    parts = cross_validated(fit_arm(equations, regrouped(equations.model.columns, factor)))
    return float(np.sqrt(np.nanmean([each.error**2 for each in parts if not each.at_rest])))


def _separating(equations: Equations, base: BaseParameters, structural: BaseParameters) -> list[str]:
    """Sentences on further motions of one joint that would make more of the structure's parameters identifiable."""
    if len(base) == len(structural):
        return []
    from armwright.identification.experiments.columns import BaseRegressor
    from armwright.identification.experiments.expected import joints_that_separate

    model = equations.model
    R = equations.factor[:, structural.independent]
    regressor = BaseRegressor(model, structural, np.zeros(model.arm.n))
    return list(joints_that_separate(regressor, R.T @ R, int(equations.rows.max())))[:MOST_NAMED]


def _sensitive(stream: Stream, fit: ArmFit) -> tuple[str, ...]:
    """Names of parameters that leave their 95 % interval where the cut-off is 30 % lower or higher."""
    model, moved = fit.equations.model, np.zeros(len(fit.base), dtype=bool)
    for factor in (SMALLER, LARGER):
        other = {}
        for run, each in stream.prepared.items():
            cutoff = min(factor * each.cutoff, 0.45 * each.rate)
            most = max(int(each.rate / (2 * cutoff)), 1)
            other[run] = choose_preparation(
                stream.log, run, cutoff=cutoff, order=each.order, decimate=min(each.decimate, most),
                differentiation=each.differentiation,
            )  # fmt: skip
        try:
            equations = equations_of(samples_of(stream.log, model, stream.runs, other), model)
            again = fit_arm(equations, fit.base, "wls", fit.weights)
        except IdentificationError:  # a filter so slow that too few rows are left
            continue
        moved |= np.abs(again.values - fit.values) > HALF_95 * fit.std
    return tuple(name for name, out in zip(fit.base.names, moved, strict=True) if out)

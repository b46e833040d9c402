"""From the rows of a log to base parameters: methods of fitting, by name, and the fit of a whole log by one of them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import norm

from armwright.errors import IdentificationError
from armwright.identification.arm.base import (
    BaseParameters,
    base_parameters,
    regrouped,
    regrouped_further,
    told_parameters,
)
from armwright.identification.arm.closed_loop import ClosedLoopMethod, Feedback, feedback_of, fit_closed_loop
from armwright.identification.arm.equations import Equations, Samples, SampleSource, equations_of, part_seconds, stacked
from armwright.identification.arm.essential import essential_parameters
from armwright.identification.arm.fit import (
    ArmFit,
    cross_validated,
    fit_arm,
    fit_robust,
    measures_of,
    residuals_of,
    with_correlation,
    with_loads,
)
from armwright.identification.arm.gear_loss import GearProblem, LossyModel, distance, fit_gears
from armwright.identification.arm.recursive import RecursiveEstimate
from armwright.identification.arm.regressor_errors import regressor_errors
from armwright.identification.arm.samples import Memory, Stream
from armwright.identification.arm.spring_record import SPRINGS
from armwright.identification.arm.torque_model import TorqueModel

GAIN = 0.01  # of the held-out error, that a spring must bring
CORRECTED = ("ols", "wls")  # methods that are corrected for noise of the columns, of arms without gear loss
DRY = ("coulomb", "coulomb+", "coulomb-", "stribeck")  # kinds of columns that jump where a joint turns back
FALSE_ALARMS = 0.01  # share of logs without sticking that lose their rows near standstill
MOST_PASSES, SETTLED = 5, 0.05  # fits of a lossy arm about the last one, until it moves by less than so many deviations


@dataclass(frozen=True, eq=False)
class FitProblem:
    """Data of a fit.

    Attributes:
        source: gives the samples, anew at each call.   equations: of these samples.   base: regrouping of the log.
        part_seconds: length of a part [s].   feedback: of the log's loop, or None.   forgetting: λ of a row, at most 1.
        errors: (n, p, p) of the columns, as of `regressor_errors`, for "ols" and "wls".
    """

    source: SampleSource
    equations: Equations
    base: BaseParameters
    part_seconds: float
    feedback: Feedback | None = None
    forgetting: float = 1.0
    errors: np.ndarray | None = None


@dataclass(frozen=True)
class Method:
    """A fitting method.

    Attributes:
        about: in words.   fit: problem → fit.
        parts: whether least squares of all parts but one says how it predicts what it has not seen.
        knows_loss: it fits a model of an arm with gear loss, which is linear about a point.
    """

    about: str
    fit: Callable[[FitProblem], ArmFit]
    parts: bool = True
    knows_loss: bool = False


def _least_squares(method: str, problem: FitProblem) -> ArmFit:
    return with_correlation(problem.source, fit_arm(problem.equations, problem.base, method, errors=problem.errors))


def _robust(weight: str, problem: FitProblem) -> ArmFit:
    fit = fit_robust(problem.source, problem.equations, problem.base, weight, problem.part_seconds)
    return with_correlation(problem.source, fit)


def _essential(problem: FitProblem) -> ArmFit:
    """Weighted least squares of the essential parameters alone, the others 0."""
    whole = fit_arm(problem.equations, problem.base)
    white, base = whole.std, problem.base
    whole = with_correlation(problem.source, whole)
    matrix, size = stacked(problem.equations.factors, len(problem.equations.model), whole.weights)
    Q, R = np.linalg.qr(matrix[:, base.independent])
    z = matrix[:, -1] @ Q
    residual = float(np.sqrt(max(size - z @ z, 0.0)))
    rows = int(problem.equations.rows.sum())
    found = essential_parameters(R, z, residual, rows, inflation=whole.std / np.maximum(white, np.finfo(float).tiny))
    essential = base.without(np.delete(base.independent, found.kept))
    return with_correlation(problem.source, fit_arm(problem.equations, essential, "wls", whole.weights))


def _recursive(problem: FitProblem) -> ArmFit:
    """Least squares row by row with the weights of the batch: its result at the end of the log."""
    batch = fit_arm(problem.equations, problem.base)
    if problem.forgetting == 1.0:
        batch = with_correlation(problem.source, batch)
    n = problem.equations.model.arm.n
    estimate = RecursiveEstimate.begin(len(problem.base), problem.forgetting ** (1.0 / n))
    for _, values, rest in residuals_of(problem.source(), batch):
        known = np.isfinite(rest)
        weights = np.broadcast_to(batch.weights, rest.shape)[known]
        estimate = estimate.with_rows(values[known], (rest + values @ batch.values)[known], weights)
    if not estimate.identifiable or np.isinf(estimate.variance):
        raise IdentificationError(
            "the rows that still count do not determine all parameters", place="forgetting", value=problem.forgetting,
            expected="nearer to 1",
        )  # fmt: skip
    covariance = batch.covariance if problem.forgetting == 1.0 else estimate.covariance
    return _with_values(batch, estimate.values, covariance, "recursive")


def _closed_loop(method: ClosedLoopMethod, problem: FitProblem) -> ArmFit:
    """From a simulated loop that begins with the parameters of weighted least squares."""
    if problem.feedback is None:
        expected = "the controller of the log: gains, period and reference"
        raise IdentificationError("missing", place="feedback", expected=expected)
    start, samples = fit_arm(problem.equations, problem.base), list(problem.source())
    if len({(each.run, each.stretch) for each in samples}) > 1:
        raise IdentificationError("several runs or stretches", place="runs", expected="one, with one reference")
    found = fit_closed_loop(samples, problem.equations.model, problem.base, problem.feedback, start.values, method)
    if not found.settled:
        expected = "a feedback that is the log's own, or a log with more motion"
        what = f"no solution after {found.iterations} simulations of the loop"
        raise IdentificationError(what, place="feedback", expected=expected)
    return _with_values(start, found.values, found.covariance, found.method)


def _with_values(fit: ArmFit, values: np.ndarray, covariance: np.ndarray, method: str) -> ArmFit:
    rms, torque_rms, r2 = measures_of(fit.equations.factors, fit.base.expanded(values))
    return replace(fit, values=values, covariance=covariance, method=method, rms=rms, torque_rms=torque_rms, r2=r2)


METHODS = {
    "ols": Method("ordinary least squares", partial(_least_squares, "ols"), knows_loss=True),
    "wls": Method("least squares weighted by joint", partial(_least_squares, "wls"), knows_loss=True),
    "irls": Method("least squares with Huber's weights", partial(_robust, "huber"), knows_loss=True),
    "tukey": Method("least squares with Tukey's weights", partial(_robust, "tukey"), knows_loss=True),
    "essential": Method("least squares of the essential parameters", _essential),
    "recursive": Method("recursive least squares", _recursive, parts=False),
    "iv": Method("instrumental variables of a simulated loop (IDIM-IV)", partial(_closed_loop, "idim-iv"), parts=False),
    "didim": Method("torques of a simulated loop (DIDIM)", partial(_closed_loop, "didim"), parts=False),
    "cloe": Method("positions of a simulated loop (CLOE)", partial(_closed_loop, "cloe"), parts=False),
}


@dataclass(frozen=True, eq=False)
class FittedLog:
    """A fit of a stream's rows.

    Attributes:
        rows: its samples for the fit's model.   fit: found.   base: identifiable from the log.
        structural: base parameters of the arm.   unfitted: joints whose efficiency stays the record's, each with the reason.
        stuck: deviations by which the numbers change with the rows near standstill, which are not fitted then; 0: they are.
    """

    rows: SampleSource
    fit: ArmFit
    base: BaseParameters
    structural: BaseParameters
    unfitted: Mapping[str, str]
    stuck: float = 0.0


def fitted(
    stream: Stream,
    model: TorqueModel,
    method: str,
    feedback: Feedback | tuple[Any, Any, float] | None = None,
    forgetting: float = 1.0,
    strict: bool = True,
) -> FittedLog:
    """The fit of a log by a method; of an arm with gear loss about its own solution.

    Args:
        stream: rows of the log.   model: its columns.   method: key of `METHODS`.
        feedback: of the log's loop, or (kp, kd, period).   forgetting: of a row.
        strict: refuse a gear efficiency that the log does not tell.
    Raises:
        IdentificationError: as the method.
    """
    seconds, unfitted = part_seconds(list(stream.filters), stream.seconds), {}
    memory: Memory | None = {} if isinstance(model, LossyModel) else None

    def read(model: TorqueModel) -> tuple[SampleSource, Equations]:
        rows = stream.kept(model, memory)
        return rows, equations_of(rows(), model, part_seconds=seconds)

    if isinstance(model, LossyModel):
        problem = GearProblem(lambda each: read(each)[1], told_parameters, method)
        found = fit_gears(problem, model, _useless_springs, lambda each: stream.kept(each, memory)(), strict=strict)
        model, equations, dropped, unfitted = found.model, found.equations, found.dropped, found.unfitted
        rows = stream.kept(model, memory)
    else:
        rows, equations = read(model)
        dropped = _useless_springs(equations) if model.sprung_joints else []
    structural = base_parameters(model, dropped)
    base = regrouped_further(structural, equations.factor)
    first = next(iter(stream.filters.values())).narrow
    loop = None if feedback is None else feedback_of(feedback, rows, first, model.arm.n)
    errors = regressor_errors(stream, model) if method in CORRECTED and not isinstance(model, LossyModel) else None
    fit = METHODS[method].fit(FitProblem(rows, equations, base, seconds, loop, forgetting, errors))
    for _ in range(MOST_PASSES):
        if not isinstance(model, LossyModel) or distance(fit) < SETTLED:
            break
        model = model.at(fit.parameters)
        rows, equations = read(model)
        fit = METHODS[method].fit(FitProblem(rows, equations, base, seconds, loop, forgetting, errors))
    found = FittedLog(rows, fit, base, structural, unfitted)
    if METHODS[method].knows_loss and not isinstance(model, LossyModel):
        problem = FitProblem(rows, equations, base, seconds, errors=errors)
        found = _without_standstill(found, problem, METHODS[method].fit)
    return found if model.unrubbed is None else replace(found, fit=with_loads(found.rows, found.fit))


def _without_standstill(found: FittedLog, problem: FitProblem, fit: Callable[[FitProblem], ArmFit]) -> FittedLog:
    """The fit of rows in motion alone, where it differs from that of all rows by more than chance; else the one that came in.

    The friction of a joint that sticks is whatever keeps it at rest, but low-passes leave it a speed, and the model a direction.
    Without sticking both fits have the same expectation, and differ by less than their deviations together. [Hausman1978]

    Args:
        found: fit of all rows.   problem: that it solves.   fit: of a problem.
    """
    base = found.fit.base
    dry = [b for b, k in enumerate(base.independent) if base.columns[k].kind in DRY]
    if not dry:
        return found

    def rows() -> Iterator[Samples]:
        return (each.in_motion() for each in found.rows())

    equations = equations_of(rows(), problem.equations.model, part_seconds=problem.part_seconds)
    if len(regrouped_further(found.structural, equations.factor)) < len(base):
        return found
    try:
        moving = fit(replace(problem, source=rows, equations=equations))
    except IdentificationError:  # too few rows are left
        return found
    differences = np.abs(moving.values - found.fit.values) / np.hypot(moving.std, found.fit.std)
    limit, of_dry = (float(norm.isf(FALSE_ALARMS / (4 * count))) for count in (len(base), len(dry)))
    if differences.max() < limit and differences[dry].max() < of_dry:
        return found
    return replace(found, rows=rows, fit=moving, stuck=float(differences.max()))


def check_losses(model: LossyModel, method: str, lacks: Collection[str]) -> None:
    """Refuses a method or a measured torque that goes without gear loss.

    Raises:
        IdentificationError: names the first joint with loss.
    """
    joint = model.arm.names[int(np.flatnonzero(model.lossy)[0])]
    without = "arm.replace(efficiency=None), whose friction and inertia then contain the loss"
    if not METHODS[method].knows_loss:
        known = ", ".join(name for name, each in METHODS.items() if each.knows_loss)
        what = f"does not know gear loss, and {joint!r} has it"
        raise IdentificationError(what, place="method", value=method, expected=f"{known}; or {without}")
    if lacks:
        what = f"a torque without {', '.join(lacks)} is not what goes through the lossy gear of {joint!r}"
        raise IdentificationError(what, place="lacks", expected=f"the motors' whole torque; or {without}")


def _useless_springs(equations: Equations) -> list[int]:
    """Numbers of spring and counterbalance columns of joints whose candidates lower the held-out error by less than 1 %."""
    model, dropped = equations.model, []
    if not model.sprung_joints:
        return dropped
    if len(equations.parts) < 2:
        raise IdentificationError("one part", place="springs", expected="a longer log, to hold parts out")
    for joint in model.sprung_joints:
        own = [k for k, column in enumerate(model.columns) if column.kind in SPRINGS and column.joint == joint]
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

"""Methods of fitting base parameters, by name, for `identify_arm` and its command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from armwright.errors import IdentificationError
from armwright.identification.arm.base import BaseParameters
from armwright.identification.arm.closed_loop import ClosedLoopMethod, Feedback, fit_closed_loop
from armwright.identification.arm.equations import Equations, SampleSource, stacked
from armwright.identification.arm.essential import essential_parameters
from armwright.identification.arm.fit import (
    ArmFit,
    fit_arm,
    fit_robust,
    measures_of,
    residuals_of,
    with_correlation,
)
from armwright.identification.arm.recursive import RecursiveEstimate


@dataclass(frozen=True, eq=False)
class FitProblem:
    """Data of a fit.

    Attributes:
        source: gives the samples, anew at each call.   equations: of these samples.   base: regrouping of the log.
        part_seconds: length of a part [s].   feedback: of the log's loop, or None.   forgetting: λ of a row, at most 1.
    """

    source: SampleSource
    equations: Equations
    base: BaseParameters
    part_seconds: float
    feedback: Feedback | None = None
    forgetting: float = 1.0


@dataclass(frozen=True)
class Method:
    """A fitting method.

    Attributes:
        about: in words.   fit: problem → fit.
        parts: whether least squares of all parts but one says how it predicts what it has not seen.
    """

    about: str
    fit: Callable[[FitProblem], ArmFit]
    parts: bool = True


def _least_squares(method: str, problem: FitProblem) -> ArmFit:
    return with_correlation(problem.source, fit_arm(problem.equations, problem.base, method))


def _robust(weight: str, problem: FitProblem) -> ArmFit:
    fit = fit_robust(problem.source, problem.equations, problem.base, weight, problem.part_seconds)
    return with_correlation(problem.source, fit)


def _essential(problem: FitProblem) -> ArmFit:
    """Weighted least squares of the essential parameters alone, the others 0."""
    whole = fit_arm(problem.equations, problem.base)
    white, base = whole.std, problem.base
    whole = with_correlation(problem.source, whole)
    matrix, size = stacked(problem.equations.factors, len(problem.equations.model), whole.weights)
    z = matrix[:, -1] @ np.linalg.qr(matrix[:, base.independent])[0]
    R = np.linalg.qr(matrix[:, base.independent])[1]
    residual = float(np.sqrt(max(size - z @ z, 0.0)))
    rows = int(problem.equations.rows.sum())
    found = essential_parameters(R, z, residual, rows, inflation=whole.std / np.maximum(white, np.finfo(float).tiny))
    dropped = np.delete(base.independent, found.kept)
    essential = BaseParameters(
        base.columns,
        base.independent[found.kept],
        base.dependent,
        np.sort(np.r_[base.absent, dropped]),
        base.regroup[found.kept],
    )
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
    if not estimate.identifiable:
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
    "ols": Method("ordinary least squares", partial(_least_squares, "ols")),
    "wls": Method("least squares weighted by joint", partial(_least_squares, "wls")),
    "irls": Method("least squares with Huber's weights", partial(_robust, "huber")),
    "tukey": Method("least squares with Tukey's weights", partial(_robust, "tukey")),
    "essential": Method("least squares of the essential parameters", _essential),
    "recursive": Method("recursive least squares", _recursive, parts=False),
    "iv": Method("instrumental variables of a simulated loop (IDIM-IV)", partial(_closed_loop, "idim-iv"), parts=False),
    "didim": Method("torques of a simulated loop (DIDIM)", partial(_closed_loop, "didim"), parts=False),
    "cloe": Method("positions of a simulated loop (CLOE)", partial(_closed_loop, "cloe"), parts=False),
}

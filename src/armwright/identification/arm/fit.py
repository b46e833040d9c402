"""Least squares on triangular factors: ordinary, weighted by joint, and with weights for outliers. [GautierPoignet2001]

    β = argmin Σ_j w_j |Y_j β - τ_j|²,   w_j = 1 / σ_j²,   σ_j² = |Y_j β - τ_j|² / (rows_j - b_j)

Standard deviations come from the residuals' own covariance with their correlation in time (`correlation`): filtered and decimated
noise is not white, and errors of the model are less so.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
import scipy.linalg

from armwright.actuators.friction import by_loads
from armwright.errors import IdentificationError, check_known
from armwright.fitting.covariance import correlated, inverse_of
from armwright.fitting.measures import r_squared
from armwright.fitting.triangular import triangle
from armwright.identification.arm.base import BaseParameters
from armwright.identification.arm.equations import (
    Equations,
    Factor,
    LogPart,
    Samples,
    SampleSource,
    all_but_one,
    equations_of,
    stacked,
)

MOST_ITERATIONS = 50
SETTLED = 1e-6  # relative change of the joints' variances
HUBER, TUKEY = 1.345, 4.685  # standard deviations; both keep 95 % of the efficiency on normal noise [HollandWelsch1977]
ROBUST = ("huber", "tukey")
NORMAL_MEDIAN = 0.6744897501960817  # of |x|, x normal with deviation 1
ROBUST_PASSES = 10  # over the rows
CHANGE = 1e-2  # of a standard deviation: less is settled
BINS = 4096  # of the histogram of residuals
FEWEST_PARTS, CERTAINLY = 4, 3.0  # parts that tell an effect of their own, and deviations of r
MOST_ALIKE = 0.85  # correlation of effects of neighbouring parts
MOST_NOISE = 0.8  # share of a direction's information that is taken for noise of the columns, at most
AT_REST = 0.01  # of the whole log's root mean square speed: slower parts rest


@dataclass(frozen=True, eq=False)
class ArmFit:
    """Base parameters of an arm from a log.

    Attributes:
        equations: what was fitted.   base: the parameters' regrouping.   method: key of `methods.METHODS`.
        values: β (b,).   covariance: (b, b).   weights: w_j (n,).   rms: (n,) of the residuals [N m | N].
        torque_rms: (n,) of the measured torques.   r2: (n,) 1 - residual variance over torque variance; NaN without torque.
        condition: of the weighted regressor, its columns scaled to length 1.   information: R (b, b), weighted.
        outliers: weights of single torques; None: 1.   weighted: the problem with these weights.
        part_effect: r, by how much the variance between parts of the log is larger than that of noise; 1: no more.
        freedom: degrees of freedom of the covariance: βᵀ C⁻¹ β of errors β is Hotelling's T², nearly; infinite: not counted.
    """

    equations: Equations
    base: BaseParameters
    method: str
    values: np.ndarray
    covariance: np.ndarray
    weights: np.ndarray
    rms: np.ndarray
    torque_rms: np.ndarray
    r2: np.ndarray
    condition: float
    information: np.ndarray
    outliers: OutlierWeights | None = None
    weighted: Equations | None = None
    freedom: float = inf
    part_effect: float = 1.0

    @property
    def std(self) -> np.ndarray:
        """(b,) standard deviations."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def correlation(self) -> np.ndarray:
        """(b, b)."""
        std = np.where(self.std > 0, self.std, 1.0)
        return self.covariance / np.outer(std, std)

    @property
    def parameters(self) -> np.ndarray:
        """(p,) parameters of the model with these base parameters, regrouped ones 0: for predictions."""
        return self.base.expanded(self.values)


def fit_arm(
    equations: Equations,
    base: BaseParameters,
    method: str = "wls",
    weights: np.ndarray | None = None,
    errors: np.ndarray | None = None,
) -> ArmFit:
    """Base parameters by ordinary or weighted least squares, from factors alone.

    Args:
        equations: of a log.   base: regrouping of the model's columns.   method: "ols" or "wls".
        weights: w_j (n,) kept as they are, instead of the method's.
        errors: (n, p, p) what noise of the motion adds to the normal matrix, by row and joint (`regressor_errors`); None: 0.
    Returns:
        fit: its covariance is (YᵀWY)⁻¹ with the residuals' variances, as if they were white: `with_correlation` counts more.
    Raises:
        IdentificationError: fewer rows than parameters, or parameters that the rows do not determine.
    """
    factors, rows = equations.factors, equations.rows
    if rows.sum() < 2 * len(base):  # with fewer, residuals say nothing about the deviations
        expected = f"twice the {len(base)} parameters at least: a longer log, or a higher cut-off"
        what = f"too few rows: {int(rows.sum())} torques of all joints are left after low-pass and decimation"
        raise IdentificationError(what, place="log", expected=expected)
    known = rows > 0
    chosen = known.astype(float) if weights is None else weights
    values, information = _solved(factors, base, chosen, errors)
    variance = _variances(factors, base, values)
    if method != "ols" and weights is None:
        for _ in range(MOST_ITERATIONS):
            floor = 1e-12 * max(variance.max(), np.finfo(float).tiny)  # of a log that the model explains exactly
            last, chosen = chosen, np.where(known, 1.0 / np.maximum(variance, floor), 0.0)
            values, information = _solved(factors, base, chosen, errors)
            variance = _variances(factors, base, values)
            if (np.abs(chosen - last)[known] <= SETTLED * chosen[known]).all():
                break
    size = np.linalg.norm(information, axis=0)
    inverse = scipy.linalg.solve_triangular(information / size, np.eye(len(size))) / size[:, None]
    meat = sum(chosen[j] ** 2 * variance[j] * gram(factor, base) for j, factor in enumerate(factors) if factor.rows)
    covariance = inverse @ (inverse.T @ np.asarray(meat) @ inverse) @ inverse.T
    measures = measures_of(factors, base.expanded(values))
    condition = float(np.linalg.cond(information / size))
    return ArmFit(equations, base, method, values, covariance, chosen, *measures, condition, information)


def _variances(factors: Sequence[Factor], base: BaseParameters, values: np.ndarray) -> np.ndarray:
    """σ_j² (n,): squares of residuals by rows less a joint's share of the parameters."""
    rows = np.array([factor.rows for factor in factors])
    squares = np.array([factor.residual(base.expanded(values)) for factor in factors])
    return squares / np.maximum(rows - len(base) * rows / rows.sum(), 1.0)


def measures_of(factors: Sequence[Factor], parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residual's and torque's root mean square [N m | N] and R² of parameters (p,), each (n,); NaN for joints without torque."""
    rows = np.array([factor.rows or np.nan for factor in factors])
    squares = np.array([factor.residual(parameters) for factor in factors])
    sums = np.array([factor.sum_of_squares for factor in factors])
    spread = sums - np.array([factor.total for factor in factors]) ** 2 / rows
    r2 = r_squared(squares, np.where(spread > 1e-12 * sums, spread, 0.0))  # the difference of sums leaves rounding
    return np.sqrt(squares / rows), np.sqrt(sums / rows), r2


def gram(factor: Factor, base: BaseParameters) -> np.ndarray:
    """Y_jᵀ Y_j (b, b) of a joint."""
    values = factor.over_all(len(base.columns))[:, base.independent]
    return values.T @ values


def _solved(
    factors: Sequence[Factor], base: BaseParameters, weights: np.ndarray, errors: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """β (b,) and R (b, b) of the weighted problem, RᵀR less what errors (n, p, p) of the columns add to it.

    Raises:
        IdentificationError: columns that the rows cannot distinguish.
    """
    matrix, _ = stacked(factors, len(base.columns), weights)
    chosen = matrix[:, [*base.independent, -1]]
    size = np.linalg.norm(chosen, axis=0)
    size[size == 0] = 1.0
    factor = triangle(chosen / size)
    b = len(base)
    diagonal = np.abs(np.diag(factor)[:b])
    if (diagonal < 1e-13).any():
        what, expected = "parameters that these rows cannot distinguish", "the base parameters of the log itself"
        raise IdentificationError(what, place="log", expected=expected)
    R, z = factor[:b, :b], factor[:b, -1]
    if errors is not None:
        rows = np.array([each.rows for each in factors])
        added = np.tensordot(weights * rows, errors, axes=1)[base.independent][:, base.independent]
        added = added / np.outer(size[:b], size[:b])
        share, vectors = np.linalg.eigh(_divided(R, _divided(R, added).T))
        less = (vectors * np.sqrt(1.0 - np.clip(share, 0.0, MOST_NOISE))) @ vectors.T  # RᵀR − E = (less R)ᵀ(less R)
        Q, R = np.linalg.qr(less @ R)
        z = Q.T @ np.linalg.solve(less, z)
    values = scipy.linalg.solve_triangular(R, z) * size[-1] / size[:b]
    return values, R * size[:b]


def _divided(R: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """R⁻ᵀ times a matrix."""
    return scipy.linalg.solve_triangular(R, matrix, trans=1)


def fit_robust(
    source: SampleSource,
    equations: Equations,
    base: BaseParameters,
    weight: str = "huber",
    part_seconds: float | None = None,
) -> ArmFit:
    """Base parameters by iteratively reweighted least squares: rows with large residuals count less. [HollandWelsch1977]

    Weights of Huber min(1, 1.345/|u|) or Tukey (1 - (u/4.685)²)², u the residual by the joint's deviation, which is its median
    over 0.6745. Tukey begins where Huber ended. Every iteration reads the rows twice more.

    Args:
        source: gives the samples, anew at each call.   equations: of these samples.   base: regrouping.
        weight: "huber" or "tukey".   part_seconds: as in `equations_of`.
    Raises:
        IdentificationError: an unknown weight, or as `fit_arm`.
    """
    check_known(IdentificationError, weight, ROBUST, place="weight")
    fit, law = fit_arm(equations, base), OutlierWeights("huber", np.ones(1))
    for name in ROBUST[: ROBUST.index(weight) + 1]:
        for _ in range(ROBUST_PASSES):
            law = OutlierWeights(name, residual_scale(source(), fit))
            reweighted = equations_of(
                source(), equations.model, part_seconds=part_seconds, row_weights=law, parameters=fit.parameters
            )
            new = fit_arm(reweighted, base, "irls", np.where(equations.rows > 0, 1.0 / law.scale**2, 0.0))
            change = np.abs(new.information @ (new.values - fit.values)).max()
            fit = new
            if change < CHANGE:
                break
    rms, torque_rms, r2 = measures_of(equations.factors, fit.parameters)
    measured = {"rms": rms, "torque_rms": torque_rms, "r2": r2}
    return replace(fit, equations=equations, weighted=fit.equations, outliers=law, **measured)


@dataclass
class OutlierWeights:
    """Weights w(u) of single torques by their residuals, "huber" or "tukey"; counts those below one half.

    Attributes:
        law: name.   scale: (n,) deviations of the residuals [N m | N].
    """

    law: str
    scale: np.ndarray
    counted: int = 0
    small: int = 0
    total: float = 0.0
    slopes: float = 0.0

    def __call__(self, residuals: np.ndarray) -> np.ndarray:
        """Weights (rows, n) of residuals (rows, n)."""
        u = np.abs(residuals) / self.scale
        if self.law == "huber":
            weights, slopes = HUBER / np.maximum(u, HUBER), u < HUBER
        else:
            inside = np.clip(1 - (u / TUKEY) ** 2, 0, None)
            weights, slopes = inside**2, inside * (5 * inside - 4)
        self.counted += int(np.isfinite(u).sum())
        self.small += int((weights < 0.5).sum())
        self.total += float(np.nansum(weights))
        self.slopes += float(np.nansum(slopes))
        return weights

    @property
    def dropped(self) -> float:
        """Share of torques with a weight below one half."""
        return self.small / max(self.counted, 1)

    @property
    def slope(self) -> float:
        """Mean slope ψ' of ψ(u) = u w(u), by the mean weight."""
        return self.slopes / self.total if self.total > 0 else 1.0


def residual_scale(samples: Iterable[Samples], fit: ArmFit) -> np.ndarray:
    """Deviation (n,) of each joint's residuals from the median of their magnitudes, by a histogram. [N m | N]"""
    model, rms = fit.equations.model, np.where(fit.rms > 0, fit.rms, 1.0)
    edges = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, BINS)])
    counts = np.zeros((model.arm.n, BINS))
    for _, _, residuals in residuals_of(samples, fit):
        for j in range(model.arm.n):
            each = np.abs(residuals[:, j]) / rms[j]
            counts[j] += np.histogram(np.clip(each[np.isfinite(each)], 0, 9e3), edges)[0]
    shares = np.cumsum(counts, axis=1) / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    middle = np.array([np.interp(0.5, share, edges[1:]) for share in shares])
    return np.maximum(middle * rms / NORMAL_MEDIAN, 1e-9 * np.maximum(fit.torque_rms, np.finfo(float).tiny))


def residuals_of(samples: Iterable[Samples], fit: ArmFit, rows: int = 4096):
    """Samples, values of the base columns (rows, n, b) and residuals τ - Y β (rows, n), chunk by chunk."""
    model = fit.equations.model
    for block in samples:
        for begin in range(0, len(block.t), rows):
            piece = block.part(slice(begin, begin + rows))
            values = piece.regressor(model)[:, :, fit.base.independent]
            yield piece, values, piece.unknown_torque(model) - values @ fit.values


def with_correlation(source: SampleSource, fit: ArmFit) -> ArmFit:
    """The fit with a covariance that accounts for correlation of the residuals in time and between joints (`correlated`).

    Residuals of a robust fit count as its weights let them, and H by the weights' slope: ψ(u) = u w(u), H ∝ mean ψ' / mean w.

    Args:
        source: gives the samples, anew at each call.   fit: of these samples.
    """
    weigh = fit.outliers or (lambda residuals: 1.0)
    inverse = scipy.linalg.solve_triangular(fit.information, np.eye(len(fit.base)))
    slope = 1.0 if fit.outliers is None else fit.outliers.slope
    found = correlated(
        lambda: ((values, rest * weigh(rest)) for _, values, rest in residuals_of(source(), fit)),
        fit.weights,
        inverse @ inverse.T / slope,
    )
    return _with_part_effects(replace(fit, covariance=found.covariance, freedom=found.freedom))


def with_loads(source: SampleSource, fit: ArmFit) -> ArmFit:
    """The fit with a covariance that counts how wrong the record may be about the friction that loads add, as the log lets it.

    A share ε_j of these torques D_j that is missing moves the parameters by  −H⁻¹ XᵀWD ε,  H = XᵀWX. With the part of D that X
    does not explain,  D̃ = D + X S,  S = −H⁻¹ XᵀWD,  the log determines ε to (D̃ᵀWD̃)⁻¹, with the scores' correlation in time.
    S cov(ε) Sᵀ is added, which makes it the covariance of a fit that has ε among its unknowns.

    Args:
        source: gives the samples, anew at each call.   fit: of these samples.
    """
    joints = np.flatnonzero([by_loads(body) for body in fit.equations.model.arm.coordinates])
    one = np.eye(fit.equations.model.arm.n)[:, joints]

    def added(piece: Samples) -> np.ndarray:
        assert piece.loaded is not None
        return piece.loaded[:, :, None] * one

    products = np.zeros((len(fit.base), len(joints)))
    for piece, values, rest in residuals_of(source(), fit):
        weight = np.where(np.isfinite(rest), fit.weights, 0.0)
        products += np.einsum("tjk,tj,tjl->kl", values, weight, added(piece))
    moves = -scipy.linalg.solve_triangular(fit.information, _divided(fit.information, products))

    def unexplained() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for piece, values, rest in residuals_of(source(), fit):
            yield added(piece) + values @ moves, rest

    squares = sum(
        np.einsum("tjk,tj,tjl->kl", each, np.where(np.isfinite(rest), fit.weights, 0.0), each)
        for each, rest in unexplained()
    )
    found = correlated(unexplained, fit.weights, inverse_of(np.asarray(squares)))
    return replace(fit, covariance=fit.covariance + moves @ found.covariance @ moves.T)


def _with_part_effects(fit: ArmFit) -> ArmFit:
    """The fit with a covariance that has a random effect of each part of the log, where parts differ by more than noise.

    Parts with the scores g_k = Σ XᵀWe, less their mean, move the parameters by  a_k = C^(−1/2) H⁻¹ g_k, in deviations. Of K parts
    of noise alone  r = Σ a_kᵀa_k K / (b (K − 1))  is 1 ± √(2/(b (K − 1))), and neighbours are not alike. Where r or Σ a_kᵀa_{k+1}
    is larger by three deviations, the effects' variance (1 − 1/r) Σ H⁻¹ g_k g_kᵀ H⁻¹ is added, times (1 + ρ)/(1 − ρ) if they
    are alike from part to part, as those of a drift are, with the correlation ρ, which K parts show (1 + 3 ρ)/K too small.
    [Kendall1954]
    """
    parts = [part for part in (fit.weighted or fit.equations).parts if sum(each.rows for each in part.factors) > 0]
    b, count = len(fit.base), len(parts)
    if count < FEWEST_PARTS:
        return fit
    scores = np.array([score(part, fit) for part in parts])
    moves = scipy.linalg.solve_triangular(
        fit.information, _divided(fit.information, (scores - scores.mean(axis=0)).T)
    ).T
    size = np.sqrt(np.maximum(np.diag(fit.covariance), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(fit.covariance / np.outer(size, size))
    a = (moves / size) @ vectors / np.sqrt(np.maximum(values, 1e-9 * values[-1]))
    squares, products = float(np.sum(a * a)), float(np.sum(a[1:] * a[:-1]))
    ratio = squares * count / (b * (count - 1))
    alike = (products + b * (count - 1) / count**2) * count / np.sqrt(b * (count - 1))
    if ratio < 1.0 + CERTAINLY * np.sqrt(2.0 / (b * (count - 1))) and alike < CERTAINLY:
        return fit
    excess = max(squares - b * (count - 1) / count, 1e-3 * squares)
    rho = (products + b * (count - 1) / count**2) / excess
    rho = float(np.clip((count * rho + 1.0) / max(count - 3.0, 1.0), 0.0, MOST_ALIKE))
    added = excess / squares * (1.0 + rho) / (1.0 - rho) * count / (count - 1) * moves.T @ moves
    return replace(fit, covariance=fit.covariance + added, part_effect=max(ratio, 1.0 + np.sqrt(2.0 / b)))


def score(part: LogPart, fit: ArmFit) -> np.ndarray:
    """Σ XᵀWe (b,) over a part of the log."""
    total = np.zeros(len(fit.base))
    for weight, factor in zip(fit.weights, part.factors, strict=True):
        own = factor.over_all(len(fit.base.columns))[:, fit.base.independent]
        total += weight * own.T @ (factor.matrix[:, -1] - own @ fit.values)
    return total


@dataclass(frozen=True)
class HeldOut:
    """Error of a fit on held-out rows.

    Attributes:
        run, begin, end: which rows [s].   relative: (n,) residual's root mean square by that of the whole log's torque.
        r2: (n,) on these rows.   at_rest: nothing moves there, so that friction is not in a known direction.
        squares: (n,) sum of the residuals' squares.
    """

    run: str
    begin: float
    end: float
    relative: np.ndarray
    r2: np.ndarray
    at_rest: bool
    squares: np.ndarray

    @property
    def error(self) -> float:
        """Root mean square of the joints' relative errors."""
        return float(np.sqrt(np.nanmean(self.relative**2)))


def cross_validated(fit: ArmFit) -> list[HeldOut]:
    """Errors on each part of a log, of fits to all other parts, with the weights of the whole fit.

    Raises:
        IdentificationError: there is one part only.
    """
    equations, parts = fit.equations, (fit.weighted or fit.equations).parts
    if len(parts) < 2:
        raise IdentificationError("one part", place="equations.parts", expected="two or more, to hold one out")
    result = []
    for part, others in zip(equations.parts, all_but_one(parts), strict=True):
        try:
            parameters = fit_arm(Equations(equations.model, (others,)), fit.base, fit.method, fit.weights).parameters
        except IdentificationError:  # the others do not determine all of them
            parameters = np.full(len(equations.model), np.nan)
        result.append(held_out(part, parameters, fit))
    return result


def held_out(part: LogPart, parameters: np.ndarray, fit: ArmFit) -> HeldOut:
    """Errors of parameters (p,) on a part of a log, relative to the torques and speeds of the fitted log."""
    speed = np.sqrt(sum((p.motion for p in fit.equations.parts), np.zeros(1)) / np.maximum(fit.equations.rows, 1))
    rms, _, r2 = measures_of(part.factors, parameters)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(fit.torque_rms > 0, rms / fit.torque_rms, np.nan)
    rows = np.maximum([factor.rows for factor in part.factors], 1)
    at_rest = bool((np.sqrt(part.motion / rows) <= AT_REST * speed).all())
    squares = np.array([factor.residual(parameters) for factor in part.factors])
    return HeldOut(part.run, part.begin, part.end, relative, r2, at_rest, squares)

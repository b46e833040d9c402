"""Drive gains, an arm's parameters and a payload's unknown numbers from two logs at once. [GautierBriot2014]

With Y the columns of the arm and, in the second log, of the payload, θ their unknown parameters and c the torques of what is
known (the payload's mass, springs of the record), the measured efforts of joint j are

    u_j = h_j (Y_j θ + c_j) + noise of deviation σ_j,      h_j = 1 / g_j.

All joints share θ, so a gain is identifiable where its torque depends on a number that is known, or on one that another joint
feels. The noise is in u alone:  min Σ_j |u_j - h_j (Y_j θ + c_j)|² / σ_j²  by Levenberg and Marquardt, σ_j of joint j by itself,
from the total least squares of  g_j u_j = Y_j θ + λ c_j  scaled to λ = 1. Triangular factors suffice; no row is read again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from armwright.errors import IdentificationError
from armwright.fitting.levenberg_marquardt import Descent, descended
from armwright.identification.arm.base import regrouped
from armwright.identification.arm.equations import Factor
from armwright.identification.arm.torque_model import TorqueColumn

ITERATIONS = 100
SETTLED = 1e-7  # of the residual's deviation: a step that changes predictions less ends the iteration
SEEN = 0.5  # deviation of a gain by the gain: above, the linear deviation says nothing, and the joint leaves the fit
UNSEEN = 1e-6  # singular value of the gains' factor that counts as 0: a deviation of a million times the gain
ALIKE = 25.0  # squares by σ² that two solutions of the total least squares may differ by, to count as equally good
EXACT = 1e-12  # of an effort's mean square: the smallest variance of its noise, for logs without any


@dataclass(frozen=True, eq=False)
class GainProblem:
    """Triangular factors of two logs with the unknown and the known torques of every joint.

    Attributes:
        columns: of the model.   factors: of both logs together, one for each joint.   candidates: numbers of the unknown columns.
        known: (p,) parameters of the known columns, others 0.   joints: numbers of the joints that take part.
    """

    columns: Sequence[TorqueColumn]
    factors: Sequence[Factor]
    candidates: np.ndarray
    known: np.ndarray
    joints: np.ndarray

    @cached_property
    def full(self) -> list[np.ndarray]:
        """R (k, p + 1) of [Y_j u_j] in the places of the model's columns, each joint that takes part."""
        return [self.factors[j].over_all(len(self.columns)) for j in self.joints]

    @cached_property
    def unknown(self) -> np.ndarray:
        """Numbers of the candidate columns that these rows distinguish. Efforts of size 1 make it independent of their units."""
        sizes = [max(float(np.linalg.norm(block[:, -1])), np.finfo(float).tiny) for block in self.full]
        stacked = np.concatenate(
            [block[:, self.candidates] / size for block, size in zip(self.full, sizes, strict=True)]
        )
        base = regrouped(tuple(self.columns[k] for k in self.candidates), stacked)
        return self.candidates[base.independent]

    @cached_property
    def parts(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Y_j (k, b), c_j (k,) and u_j (k,) of each joint."""
        return [(block[:, self.unknown], block[:, :-1] @ self.known, block[:, -1]) for block in self.full]

    @cached_property
    def alone(self) -> list[tuple[float, int]]:
        """Squares of residuals of u_j on [Y_j c_j], whatever the other joints say, and the columns' rank, of each joint."""
        found = []
        for j, (Y, c, u) in zip(self.joints, self.parts, strict=True):
            columns = np.column_stack([Y, c])
            size = np.linalg.norm(columns, axis=0)
            columns = columns[:, size > 0] / size[size > 0]
            values, _, rank, _ = np.linalg.lstsq(columns, u, rcond=1e-10)
            rows = self.factors[j].rows
            if rows < 2 * rank:  # with fewer, residuals say nothing about the deviations
                what, expected = f"too few rows: {rows} are left", f"twice the {rank} parameters of a joint at least"
                raise IdentificationError(what, place="log", expected=f"{expected}: longer logs, or a higher cut-off")
            found.append((float(np.sum((u - columns @ values) ** 2)), int(rank)))
        return found

    @cached_property
    def variances(self) -> np.ndarray:
        """σ_j² of each joint by itself."""
        found = []
        for j, (squares, rank) in zip(self.joints, self.alone, strict=True):
            factor = self.factors[j]
            found.append(max(squares / (factor.rows - rank), EXACT * factor.sum_of_squares / factor.rows))
        return np.array(found)


@dataclass(frozen=True, eq=False)
class GainFit:
    """Gains of the joints that take part, with the arm's and the payload's parameters.

    Attributes:
        problem: what was fitted.   parameters: θ (b,) of `problem.unknown`.   inverse: h (k,).
    """

    problem: GainProblem
    parameters: np.ndarray
    inverse: np.ndarray

    @cached_property
    def jacobian(self) -> np.ndarray:
        """(rows, b + k) of predictions by [θ, h], in units of σ."""
        return _jacobian(self.problem, self.parameters, self.inverse)

    @property
    def deviations(self) -> np.ndarray:
        """(k,) of h by h, for white noise; 1 / UNSEEN where nothing tells the gain."""
        return _relative(self.jacobian, self.inverse)

    @cached_property
    def squares(self) -> np.ndarray:
        """(k,) squares of the residuals, in units of the efforts."""
        rest = _residuals(self.problem, self.parameters, self.inverse)
        return np.array([each @ each for each in rest]) * self.problem.variances

    def with_heavier(self, times: float, payload: np.ndarray) -> np.ndarray:
        """(k,) deviations of h by h that the same motion would have with a payload as many times as heavy.

        Args:
            times: the true one.   payload: numbers of its columns.
        """
        p = self.problem
        scale, known = np.ones(len(p.columns)), p.known.copy()
        scale[payload] = times
        known[payload] *= times
        heavier = GainProblem(p.columns, p.factors, p.candidates, known, p.joints)
        heavier.__dict__.update(unknown=p.unknown, full=p.full, variances=p.variances)  # what the mass does not change
        return _relative(_jacobian(heavier, self.parameters * scale[p.unknown], self.inverse), self.inverse)


def fit_gains(problem: GainProblem) -> tuple[GainFit, GainFit]:
    """The fit of all joints, and that of the joints whose gains show at all.

    The second leaves out, one after the other, the joint whose gain is least certain, while its deviation is over half of it: a
    gain of any size would bend what the joint says of the shared parameters.

    Raises:
        IdentificationError: too few rows, or an iteration that does not settle.
    """
    whole = fit = _fitted(problem)
    while len(fit.inverse) and fit.deviations.max() > SEEN:
        p = fit.problem
        rest = np.delete(p.joints, int(np.argmax(fit.deviations)))
        fit = _fitted(GainProblem(p.columns, p.factors, p.candidates, p.known, rest))
    return whole, fit


def _fitted(problem: GainProblem) -> GainFit:
    if not len(problem.joints):
        return GainFit(problem, np.zeros(0), np.zeros(0))
    inverse = 1.0 / _total_least_squares(problem)
    count, at = len(problem.unknown), np.concatenate([_parameters(problem, inverse), inverse])

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        parts = x[0, :count], x[0, count:]
        return -np.concatenate(_residuals(problem, *parts))[None], _jacobian(problem, *parts)[None]

    found = descended(
        evaluate, Descent.begin(evaluate, at[None]), rounds=ITERATIONS,
        ends=lambda _, cost, moved: moved <= SETTLED**2 * np.maximum(1.0, cost),
    )  # fmt: skip
    if not found.ended[0]:
        what = f"gains and parameters do not settle within {ITERATIONS} iterations"
        raise IdentificationError(what, place="log", expected="logs of one arm without and with one payload")
    return GainFit(problem, found.x[0, :count], found.x[0, count:])


def _total_least_squares(problem: GainProblem) -> np.ndarray:
    """g (k,) of  g_j u_j = Y_j θ + c_j  with the noise in u_j: twice, first with all joints alike, then weighted by g_j σ_j."""
    gains = 1.0 / np.sqrt(problem.variances)
    alike = np.array([np.linalg.norm(Y) for Y, _, _ in problem.parts])
    weights = 1.0 / np.where(alike > 0, alike, 1.0)
    for _ in range(3):
        gains = _smallest(problem, weights)
        weights = 1.0 / (np.abs(gains) * np.sqrt(problem.variances))
    return gains


def _smallest(problem: GainProblem, weights: np.ndarray) -> np.ndarray:
    """g of the least  gᵀ A g / gᵀ D g,  A of u less what [Y c] explains, D of the noise; the shortest of equally good ones."""
    k, weighted = len(problem.joints), list(zip(weights, problem.parts, strict=True))
    of_gains = np.asarray(scipy.linalg.block_diag(*(w * u[:, None] for w, (_, _, u) in weighted)))
    matrix = np.column_stack([np.concatenate([w * np.column_stack([Y, c]) for w, (Y, c, _) in weighted]), of_gains])
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0] = 1.0
    R = np.asarray(np.linalg.qr(matrix / size, mode="r"))
    b = R.shape[1] - k - 1
    rows = np.array([problem.factors[j].rows for j in problem.joints])
    D = weights**2 * rows * problem.variances / size[-k:] ** 2
    quotient, G = scipy.linalg.eigh(R[b + 1 :, -k:].T @ R[b + 1 :, -k:], np.diag(D))
    G = G[:, quotient <= quotient[0] + ALIKE / rows.sum()]
    of_known = R[b, -k:] @ G / (R[b, b] if abs(R[b, b]) > 1e-10 else np.inf) / size[b]  # λ of each solution
    length = float(of_known @ of_known)
    gains = (G @ of_known / length if length > 0 else G[:, 0]) / size[-k:]
    least = 1e-3 * np.abs(gains * size[-k:]).max() / size[-k:]  # a gain of 0 would ask for infinite h
    return np.where(np.abs(gains) < least, np.copysign(least, gains), gains)


def _parameters(problem: GainProblem, inverse: np.ndarray) -> np.ndarray:
    """θ (b,) for gains that are kept."""
    J = _jacobian(problem, np.zeros(len(problem.unknown)), inverse)
    rest = np.concatenate(_residuals(problem, np.zeros(len(problem.unknown)), inverse))
    of_parameters = J[:, : len(problem.unknown)]
    size = np.linalg.norm(of_parameters, axis=0)
    size[size == 0] = 1.0
    return np.linalg.lstsq(of_parameters / size, rest, rcond=1e-12)[0] / size


def _residuals(problem: GainProblem, parameters: np.ndarray, inverse: np.ndarray) -> list[np.ndarray]:
    """u_j - h_j (Y_j θ + c_j) of each joint in units of σ_j."""
    return [
        (u - h * (Y @ parameters + c)) / np.sqrt(variance)
        for (Y, c, u), h, variance in zip(problem.parts, inverse, problem.variances, strict=True)
    ]


def _jacobian(problem: GainProblem, parameters: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    parts = list(zip(problem.parts, inverse, np.sqrt(problem.variances), strict=True))
    of_parameters = np.concatenate([h * Y / std for (Y, _, _), h, std in parts])
    of_gains = np.asarray(
        scipy.linalg.block_diag(*((Y @ parameters + c)[:, None] / std for (Y, c, _), _, std in parts))
    )
    return np.column_stack([of_parameters, of_gains])


def _relative(jacobian: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """(k,) deviations of h by h: of the factor of h once θ is eliminated, (RᵀR)⁻¹ without its zeros."""
    k = len(inverse)
    if not k:
        return np.zeros(0)
    size = np.linalg.norm(jacobian[:, :-k], axis=0)
    size[size == 0] = 1.0
    R = np.asarray(np.linalg.qr(np.column_stack([jacobian[:, :-k] / size, jacobian[:, -k:] * inverse]), mode="r"))
    _, values, V = np.linalg.svd(R[len(size) :, -k:], full_matrices=True)
    values = np.concatenate([values, np.zeros(k - len(values))])
    floor = UNSEEN + 1e-9 * np.linalg.norm(jacobian[:, -k:] * inverse)  # rounding of an exact zero
    return np.sqrt(np.sum((V / np.maximum(values, floor)[:, None]) ** 2, axis=0))

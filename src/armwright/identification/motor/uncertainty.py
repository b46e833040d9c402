"""Covariance of a fit with correlated residuals and an imperfect model, and directions that its Jacobian cannot distinguish."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armwright.identification.motor.output_error import Problem

WEAK = 0.5  # standard deviation of the logarithm of a product of numbers beyond which the log does not tell it
NOTHING = 1e-6  # standard deviations of all residuals together that a nuisance of its size makes: less is none
PART = 0.25  # of the largest entry of a direction: numbers with more take part in it


def covariance(problem: Problem, residuals: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """(k, k) of coordinates, for correlated residuals.  H⁻¹ G H⁻¹, H = JᵀJ, G = Σ_l w_l Σ_k s_k sᵀ_{k+l}.  [NeweyWest1987]

    The score s_k is the sum over the signals of row k; weights w_l fall linearly to 0 at twice the last lag over which the
    residuals are correlated, positively or, as differences of rounded positions are, negatively; without any, G = Σ s sᵀ.

    Args:
        residuals: (m,).   jacobian: (m, k), as `Problem.evaluate` gives them.
    """
    k = jacobian.shape[1]
    inverse = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-14)
    columns = problem.targets[0].shape[1]
    middle, begin = np.zeros((k, k)), 0
    for stretch in problem.stretches:
        rows = len(stretch.t)
        part = slice(begin, begin + rows * columns)
        begin = part.stop
        own, slopes = residuals[part].reshape(rows, columns), jacobian[part].reshape(rows, columns, k)
        scores = np.einsum("rc,rck->rk", own, slopes)
        middle += scores.T @ scores
        most = max(_memory(own[:, c]) for c in range(columns))
        for lag in range(1, most):
            cross = scores[lag:].T @ scores[:-lag]
            middle += (1.0 - lag / most) * (cross + cross.T)
    if problem.prior is not None:
        middle += np.diag(1.0 / problem.prior[1] ** 2)
    free = max(residuals.size - k, 1) / max(residuals.size, 1)
    return inverse @ middle @ inverse / free


def _memory(residuals: np.ndarray) -> int:
    """1 more than twice the last lag before the autocorrelation first is 0 within its own error; 1 where it is so at once."""
    rows, own = len(residuals), residuals - residuals.mean()
    power = float(own @ own)
    if power == 0.0:
        return 1
    spectrum = np.fft.rfft(own, 2 * rows)
    correlation = np.fft.irfft(spectrum * spectrum.conj())[: max(rows // 4, 1)] / power
    below = np.flatnonzero(np.abs(correlation) < 2.0 / np.sqrt(rows))
    return max(1, min(2 * int(below[0]) - 1 if len(below) else rows // 4, rows // 4))


@dataclass(frozen=True)
class Direction:
    """Indistinguishable parameters: exponents of their product, the largest of which is 1."""

    unknowns: tuple[int, ...]
    exponents: tuple[float, ...]
    deviation: float  # of the logarithm of that product


def untold(jacobian: np.ndarray, candidates: Sequence[int]) -> list[Direction]:
    """Directions of the candidates that are not identifiable from a log, nuisances free, the worst first.

    Args:
        jacobian: (m, k) of residuals in standard deviations, by coordinates in their sizes.   candidates: numbers of unknowns.
    """
    others = [k for k in range(jacobian.shape[1]) if k not in candidates]
    own, nuisance = jacobian[:, list(candidates)], np.zeros((len(jacobian), 0))
    if others:
        nuisance = jacobian[:, others]
        lengths = np.linalg.norm(nuisance, axis=0)  # a column of rounding alone, made longer, looks like any other
        nuisance = nuisance[:, lengths > NOTHING] / lengths[lengths > NOTHING]
    if nuisance.shape[1]:
        basis, sizes, _ = np.linalg.svd(nuisance, full_matrices=False)
        basis = basis[:, sizes > 1e-8]
        own = own - basis @ (basis.T @ own)
    _, sizes, directions = np.linalg.svd(own, full_matrices=False)
    found = []
    for size, direction in zip(sizes[::-1], directions[::-1], strict=True):
        deviation = 1.0 / size if size > 1e-9 * max(sizes[0], 1e-300) else np.inf
        if deviation < WEAK:
            break
        largest = np.abs(direction).max()
        parts = [j for j in range(len(direction)) if abs(direction[j]) > PART * largest]
        scale = direction[max(parts, key=lambda j: abs(direction[j]))]
        found.append(
            Direction(
                tuple(candidates[j] for j in parts), tuple(float(direction[j] / scale) for j in parts), float(deviation)
            )
        )
    return found

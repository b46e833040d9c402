"""Fit of a calibration: robust least squares [Huber1981], a prior that its held-out error chooses, and deviations that hold.

    min Σ_i w_i |e_i(δ)|² + σ²/τ² Σ_k (s_k δ_k)²,      s_k the rms effect of δ_k on what is measured

Errors e_i of one pose belong together: they have one weight w_i, they are held out together, and their noise has a part in
common, since the markers of a tool move together. τ is the effect that a correction of the record is presumed to have; τ = ∞ is
plain least squares. What the record does not know (measuring frame, points) has no prior.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from armwright.errors import IdentificationError
from armwright.fitting.levenberg_marquardt import Descent, descended
from armwright.identification.geometry.problem import DISTANCE, POSITION, ROTATION, Rows
from armwright.identification.geometry.setting import Setting

Loss = Literal["tukey", "huber", "squares"]
STRENGTHS = (0.0, 0.1, 0.2, 0.4, 0.6, 1.0, 2.0, 4.0)  # σ/τ that are tried
# of a pose's error, by its richest group: markers of a tool move together
FREEDOM = {POSITION: 3, ROTATION: 6, DISTANCE: 1}
CHI2_MEDIAN = {1: 0.4549, 3: 2.366, 6: 5.348}  # of so many degrees of freedom
CHI2_95 = {1: 3.841, 3: 7.815, 6: 12.59}
TUKEY, HUBER = 4.685, 1.345  # of an error in deviations, for 95 % efficiency in one dimension
PASSES, SETTLED = 30, 1e-2  # of weights, until none changes by more
GAIN = 1e-8  # of the squares, by which the last step lowers them


@dataclass(frozen=True, eq=False)
class GeometryFit:
    """Corrections that fit the measurements.

    Attributes:
        setting: what was fitted.   values: (b,) of the identifiable parameters.   weights: (poses,) 0 to 1.
        strength: σ/τ.   sizes: (b,) s_k; 0 of what has no prior.   scales: (rows,) deviation of each row by that of positions.
    """

    setting: Setting
    values: np.ndarray
    weights: np.ndarray
    strength: float
    sizes: np.ndarray
    scales: np.ndarray

    @cached_property
    def rows(self) -> Rows:
        """Errors and derivatives there."""
        return self.setting.rows(self.values)

    @property
    def outliers(self) -> list[int]:
        """Numbers of the poses that do not count."""
        measured = np.unique(self.rows.pose)
        return [int(k) for k in measured if self.weights[k] == 0.0]


def lengths(rows: Rows) -> dict[str, np.ndarray]:
    """Length of every error by group; positions and rotations have three numbers each."""
    found = {}
    for group in dict.fromkeys(rows.group.tolist()):
        errors = rows.errors[rows.group == group]
        found[group] = np.linalg.norm(errors.reshape(-1, 1 if group == DISTANCE else 3), axis=1)
    return found


def fitted(
    setting: Setting, loss: Loss = "tukey", strength: float = 0.0, begun: GeometryFit | None = None
) -> GeometryFit:
    """The fit with one strength of the prior.

    Args:
        setting: what to fit.   loss: what large errors cost.   strength: σ/τ.   begun: a fit to go on from.
    Raises:
        IdentificationError: the search diverges.
    """
    fit, stages = begun, STAGES[loss][-1:]
    if fit is None:
        count, first = len(setting.grouped), setting.rows(np.zeros(len(setting.grouped)))
        by_pose, sizes = np.ones(len(setting.q)), prior_sizes(setting, first)
        fit = GeometryFit(setting, np.zeros(count), by_pose, 0.0, sizes, np.ones(len(first.pose)))
        stages = STAGES[loss]
    fit = replace(fit, strength=strength)
    for weigh in stages:
        for _ in range(PASSES):
            fit = replace(fit, values=minimised(fit, fit.weights))
            weights, scales = weigh(*deviations(fit)), row_scales(fit)
            change = max(np.abs(weights - fit.weights).max(), np.abs(scales / fit.scales - 1.0).max())
            fit = replace(fit, weights=weights, scales=scales)
            if change < SETTLED:
                break
    return fit


def minimised(fit: GeometryFit, weights: np.ndarray) -> np.ndarray:
    """(b,) values of least squares with weights (poses,), from the fit's values on.

    Raises:
        IdentificationError: no finite point.
    """
    prior = fit.strength * fit.sizes
    if not len(prior):
        return fit.values

    def evaluate(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rows = fit.setting.rows(points[0])
        by = np.sqrt(weights[rows.pose]) / fit.scales
        errors = np.concatenate([rows.errors * by, prior * points[0]])
        return errors[None], np.concatenate([rows.jacobian * by[:, None], np.diag(prior)])[None]

    begun = Descent.begin(evaluate, fit.values[None])
    found = descended(evaluate, begun, ends=lambda gained, cost, _: gained <= GAIN * cost)
    if not np.isfinite(found.cost[0]):
        raise IdentificationError("diverges", place="measurements", expected="poses and points of this arm")
    return found.x[0]


def prior_sizes(setting: Setting, rows: Rows) -> np.ndarray:
    """(b,) rms effect of each correction of the record on what is measured; 0 of what the record does not know."""
    sizes = np.linalg.norm(rows.jacobian, axis=0) / np.sqrt(len(rows.errors))
    return np.where([column.kind in ("frame", "point") for column in setting.kept], 0.0, sizes)


def row_scales(fit: GeometryFit) -> np.ndarray:
    """(rows,) rms of the errors of each row's group by that of the first group, which is positions where there are any."""
    rows = fit.rows
    weights, scales = fit.weights[rows.pose], np.ones(len(rows.errors))
    groups = list(dict.fromkeys(rows.group.tolist()))
    groups.sort(key=lambda group: group != POSITION)
    size = {g: np.sqrt(np.average(rows.errors[rows.group == g] ** 2, weights=weights[rows.group == g])) for g in groups}
    for group in groups[1:]:
        if size[groups[0]] > 0 and size[group] > 0:
            scales[rows.group == group] = size[group] / size[groups[0]]
    return scales


def deviations(fit: GeometryFit) -> tuple[np.ndarray, int]:
    """(poses,) length of each pose's error in standard deviations, and its degrees of freedom; 0 where nothing was measured.

    The deviation is that of the middle one: half of the poses may be wrong.
    """
    rows = fit.rows
    freedom = max(FREEDOM[group] for group in set(rows.group.tolist()))
    count = np.bincount(rows.pose, minlength=len(fit.weights))
    squares = np.bincount(rows.pose, (rows.errors / fit.scales) ** 2, minlength=len(fit.weights))
    squares = squares / np.maximum(count, 1) * freedom
    middle = np.median(squares[count > 0]) / CHI2_MEDIAN[freedom]
    return np.sqrt(squares / max(middle, np.finfo(float).tiny)), freedom


def _huber(deviation: np.ndarray, freedom: int) -> np.ndarray:
    limit = HUBER * np.sqrt(CHI2_95[freedom] / CHI2_95[1])
    return np.minimum(1.0, limit / np.maximum(deviation, limit))


def _tukey(deviation: np.ndarray, freedom: int) -> np.ndarray:
    limit = TUKEY * np.sqrt(CHI2_95[freedom] / CHI2_95[1])
    return np.where(deviation < limit, (1.0 - (deviation / limit) ** 2) ** 2, 0.0)


Weigh = Callable[[np.ndarray, int], np.ndarray]
STAGES: dict[str, tuple[Weigh, ...]] = {
    "squares": (lambda deviation, _: np.ones(len(deviation)),), "huber": (_huber,), "tukey": (_huber, _tukey),
}  # fmt: skip


@dataclass(frozen=True)
class Noise:
    """Variance of the errors of positions (and of others by their scale).

    Attributes:
        own: of each number [m²].   common: of what all points of a pose have in common [m²].
    """

    own: float
    common: float

    @property
    def deviation(self) -> float:
        """Standard deviation of one coordinate [m]."""
        return float(np.sqrt(self.own + self.common))


def noise_of(fit: GeometryFit) -> Noise:
    """Noise from what least squares without prior leave, by the expectation of two squares. [Henderson1953]

    With r = (1 − H) ε, Z the poses' common parts and  Σ = own 1 + common Z Zᵀ:

        E rᵀr = tr((1−H) Σ),   E rᵀZZᵀr = tr(Zᵀ(1−H) Σ (1−H)Z)

    Poses that do not count are left out.
    """
    rows = fit.rows
    counted = fit.weights[rows.pose] > 0.0
    r = rows.errors[counted] / fit.scales[counted]
    q, _ = np.linalg.qr(rows.jacobian[counted] / fit.scales[counted, None])
    r = r - q @ (q.T @ r)
    shared = _shared(rows, counted)
    left = len(r) - q.shape[1]
    if left <= 0 or not (shared >= 0).any():
        return Noise(float(r @ r) / max(left, 1), 0.0)
    count = np.bincount(shared[shared >= 0]).astype(float)  # diagonal of Zᵀ Z
    of_fit = _sums(shared, q)  # Zᵀ Q, of  H = Q Qᵀ
    inner = count.sum() - (of_fit**2).sum()  # tr Zᵀ(1−H)Z, and the squares of its entries
    squares = (count**2).sum() - 2.0 * count @ (of_fit**2).sum(axis=1) + ((of_fit.T @ of_fit) ** 2).sum()
    matrix = np.array([[left, inner], [inner, squares]])
    own, common = np.linalg.solve(matrix, [r @ r, (_sums(shared, r[:, None]) ** 2).sum()])
    if own <= 0.0 or common <= 0.0:
        return Noise(float(r @ r) / left, 0.0)
    return Noise(float(own), float(common))


def _shared(rows: Rows, counted: np.ndarray) -> np.ndarray:
    """(counted rows,) number of the coordinate of a pose that a row shares with those of other points; -1 of others."""
    positions = np.flatnonzero(rows.group == POSITION)
    axis = np.zeros(len(rows.pose), dtype=int)
    axis[positions] = np.arange(len(positions)) % 3  # x, y, z of one point after the other
    label = np.where(rows.group == POSITION, 3 * rows.pose + axis, -1)[counted]
    names, which, count = np.unique(label, return_inverse=True, return_counts=True)
    kept = (names >= 0) & (count[names >= 0].max(initial=0) > 1)  # a single point of some poses has the common part too
    return np.where(kept, np.cumsum(kept) - 1, -1)[which]


def _sums(shared: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Zᵀ A (k, columns): sums of the rows of A (rows, columns) that share a coordinate."""
    sums = np.zeros((int(shared.max(initial=-1)) + 1, matrix.shape[1]))
    np.add.at(sums, shared[shared >= 0], matrix[shared >= 0])
    return sums


def covariance_of(fit: GeometryFit, noise: Noise) -> np.ndarray:
    """(b, b) covariance of the values, for correlated noise and a prior that is as wide as it says.

    A⁻¹ (Jᵀ W Σ W J + σ² Λ) A⁻¹  with  A = Jᵀ W J + Λ  and Λ the prior's weights.
    """
    rows = fit.rows
    weights = fit.weights[rows.pose]
    J = rows.jacobian / fit.scales[:, None]
    prior = np.diag((fit.strength * fit.sizes) ** 2)
    A = J.T @ (weights[:, None] * J) + prior
    weighted = weights[:, None] * J
    common = _sums(_shared(rows, np.ones(len(weights), dtype=bool)), weighted)
    middle = noise.own * weighted.T @ weighted + noise.common * common.T @ common
    middle += (noise.own + noise.common) * prior
    size = np.sqrt(np.diag(A))
    inverse = np.linalg.pinv(A / np.outer(size, size)) / np.outer(size, size)
    return inverse @ middle @ inverse


def folds_of(fit: GeometryFit, count: int) -> list[np.ndarray]:
    """Parts of the measured poses (poses,) bool, which take turns in being held out."""
    measured = np.unique(fit.rows.pose)
    count = min(count, len(measured))
    return [np.isin(np.arange(len(fit.weights)), measured[k::count]) for k in range(count)]


def held_out(fit: GeometryFit, folds: Sequence[np.ndarray]) -> Rows:
    """Errors of every pose under a fit to the other parts, weights as in the whole fit."""
    errors = fit.rows.errors.copy()
    for fold in folds:
        values = minimised(fit, np.where(fold, 0.0, fit.weights))
        rows = fit.setting.rows(values)
        errors[fold[rows.pose]] = rows.errors[fold[rows.pose]]
    return replace(fit.rows, errors=errors)


def nearly_held_out(fit: GeometryFit, folds: Sequence[np.ndarray]) -> Rows:
    """As `held_out`, to first order in the difference of the fits: one solution instead of a search each."""
    rows, errors = fit.rows, fit.rows.errors.copy()
    prior = (fit.strength * fit.sizes) ** 2
    by = fit.weights[rows.pose] / fit.scales**2
    size = np.sqrt(by @ rows.jacobian**2 + prior)
    unit = rows.jacobian / size
    whole = unit.T @ (by[:, None] * unit) + np.diag(prior / size**2)
    downhill = -unit.T @ (by * rows.errors) - prior / size * fit.values
    for fold in folds:
        out = fold[rows.pose]
        part, weight = unit[out], by[out]
        matrix = whole - part.T @ (weight[:, None] * part)
        step = np.linalg.lstsq(matrix, downhill + part.T @ (weight * rows.errors[out]), rcond=1e-12)[0]
        errors[out] += part @ step
    return replace(rows, errors=errors)


def squares_of_poses(fit: GeometryFit, rows: Rows) -> np.ndarray:
    """(poses that count,) mean square of each pose's errors, in units of the first group."""
    counted = np.unique(rows.pose[fit.weights[rows.pose] > 0.0])
    squares = np.bincount(rows.pose, (rows.errors / fit.scales) ** 2, minlength=len(fit.weights))
    return squares[counted] / np.bincount(rows.pose, minlength=len(fit.weights))[counted]


def chosen_fit(setting: Setting, loss: Loss, count: int) -> tuple[GeometryFit, GeometryFit, dict[float, float]]:
    """The fit with the prior that its held-out error chooses.

    Args:
        setting: what to fit.   loss: what large errors cost.   count: of parts.
    Returns:
        fit: the chosen one.   plain: without a prior.   tried: held-out rms by strength.
    """
    plain = fit = fitted(setting, loss)
    folds, tried, found = folds_of(plain, count), {}, {}
    for strength in STRENGTHS if np.any(plain.sizes) else STRENGTHS[:1]:
        fit = plain if strength == 0.0 else fitted(setting, loss, strength, fit)
        same = replace(fit, weights=np.where(plain.weights > 0.0, fit.weights, 0.0))
        tried[strength] = float(np.sqrt(squares_of_poses(plain, nearly_held_out(same, folds)).mean()))
        found[strength] = fit
    return found[min(tried, key=lambda strength: tried[strength])], plain, tried

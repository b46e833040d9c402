"""Covariance of least-squares estimates whose residuals are correlated in time and between joints.

    C = H⁻¹ Γ H⁻¹,   Γ = cov(Σ_t X_tᵀ W e_t),   H = XᵀWX

An estimate of Γ from the scores X_tᵀ W e_t alone needs windows as long as the noise is slow, and a log has few of them. So each
joint's residuals are whitened first, which changes nothing of the sum [AndrewsMonahan1992]: with an autoregression A of order p,

    ε_t = e_t − Σ a_k e_{t+k},   z_t = x_t + Σ a_k z_{t−k},   Σ_t z_t ε_t = Σ_t x_t e_t.

The correlation that the scores z_t ε_t still have is counted by Parzen's window, whose width follows from it [Andrews1991]. A fit
takes from the noise what its columns can follow, X δ with δ ~ C: the autocovariance of X δ is added to that of the residuals, and
each residual is what it would be of a fit without its row, ε / (1 − h), h = w zᵀ(ZᵀWZ)⁻¹z. [MacKinnonWhite1985]
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np
from scipy.signal import lfilter

from armwright.fitting.autoregression import autoregression, lagged_products
from armwright.fitting.triangular import triangle

ORDER = 12  # of the autoregressions, at most
# share of the residuals' variance that a fit takes: below, its autocovariance is not worth two more passes
TAKEN = 1e-3
MOST_LEVERAGE = 0.9  # h of a row that alone determines a parameter is 1
LARGEST = 0.97  # correlation from row to row that a width is made for

Source = Callable[[], Iterable[tuple[np.ndarray, np.ndarray]]]  # blocks of X (rows, n, b) and residuals e (rows, n)


@dataclass(frozen=True, eq=False)
class LongRun:
    """Covariance of an estimate.

    Attributes:
        root: (b, b), rootᵀ root = C.   orders: (n,) of the joints' autoregressions.   width: rows that Parzen's window spans.
        freedom: independent rows behind Γ: δᵀ C⁻¹ δ is T² with as many degrees of freedom, nearly. [Hotelling1931]
    """

    root: np.ndarray
    orders: np.ndarray
    width: int
    freedom: float

    @property
    def covariance(self) -> np.ndarray:
        """C (b, b)."""
        return self.root.T @ self.root


def correlated(source: Source, weights: np.ndarray, bread: np.ndarray, alone: bool = False) -> LongRun:
    """Covariance of an estimate from its residuals.

    Args:
        source: gives blocks of X and e anew at each call; missing residuals are NaN.   weights: (n,) W of the joints.
        bread: (b, b) H⁻¹; of instruments Z, which take the place of X, (ZᵀWX)⁻¹.
        alone: the columns are those of b estimates, each of one column alone.
    """
    own, rows = _autocovariances(source(), None)
    found = _with_noise(source, weights, bread, own, rows, alone)
    if _variance_taken(found.root, bread) > TAKEN * float(weights @ (own[0] * rows)):
        fitted, _ = _autocovariances(source(), found.root)
        found = _with_noise(source, weights, bread, own + fitted, rows, alone)
    return found


def covariance_of(blocks: Sequence[tuple[np.ndarray, np.ndarray]], prior: np.ndarray | None = None) -> np.ndarray:
    """Covariance C (b, b) of least squares, whose errors are weighted already.

    Args:
        blocks: derivatives X (rows, n, b) and errors e (rows, n) of stretches without gaps; NaN where an error is missing.
        prior: (b, b) information about the parameters beside these rows; None: none.
    """
    prior = np.zeros((blocks[0][0].shape[2],) * 2) if prior is None else prior
    information = sum((np.einsum("tji,tjk->ik", X, X) for X, _ in blocks), prior)
    bread = inverse_of(information)
    return correlated(lambda: blocks, np.ones(blocks[0][0].shape[1]), bread).covariance + bread @ prior @ bread


def _variance_taken(root: np.ndarray, bread: np.ndarray) -> float:
    """tr(C H): what the columns' part of the noise, X δ, adds to the weighted sum of squares."""
    size = np.sqrt(np.abs(np.diag(bread)))
    size = np.where(size > 0.0, size, 1.0)
    return float(np.sum((root / size) @ np.linalg.pinv(bread / np.outer(size, size), hermitian=True) * (root / size)))


def _with_noise(
    source: Source, weights: np.ndarray, bread: np.ndarray, noise: np.ndarray, rows: np.ndarray, alone: bool
) -> LongRun:
    """The covariance for noise with these autocovariances (lags, n), each over rows (n,)."""
    most = np.maximum(rows // 10, 1).astype(int)
    models = [autoregression(noise[: most[j], j], max(rows[j], 1.0)) for j in range(len(rows))]
    half, inverse = _first_pass(_scores(source(), weights, models, None), alone)
    window = 1.0 - np.abs(np.arange(1 - half, half)) / half
    window /= np.linalg.norm(window)
    sums, count = np.zeros((len(bread),) * 2), 0
    for scores, missing, _ in _scores(source(), weights, models, inverse):
        count += len(scores)
        beyond = np.zeros((len(window) - 1, scores.shape[1]))
        sums = triangle(np.asarray(lfilter(window, [1.0], np.concatenate([scores, beyond]), axis=0)), sums)
        sums = triangle(missing, sums)
    kernel = np.correlate(window, window, "full")
    orders = np.array([len(each) - 1 for each, _ in models])
    return LongRun(sums @ bread.T, orders, len(kernel), count / float(kernel @ kernel))


def _autocovariances(
    blocks: Iterable[tuple[np.ndarray, np.ndarray]], root: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Autocovariances (lags, n) of the residuals, or with a root of C those of X δ, δ ~ C; and the rows (n,) behind them."""
    sums, pairs, places = (np.zeros(()) for _ in range(3))
    for X, e in blocks:
        known = np.isfinite(e)
        each = np.where(known, e, 0.0)[:, :, None] if root is None else (X @ root.T) * known[:, :, None]
        sums = sums + lagged_products(each, ORDER)
        pairs = pairs + lagged_products(known.astype(float), ORDER)
        places = places + np.maximum(len(e) - np.arange(ORDER + 1.0), 0.0)[:, None]
    pairs, places = np.asarray(pairs), np.asarray(places)
    # of the rows that have one so many later: small for long lags, as it should
    share = places / np.maximum(places[0], 1.0)
    return np.asarray(sums) / np.maximum(pairs, 1.0) * share, pairs[0]


def _scores(
    blocks: Iterable[tuple[np.ndarray, np.ndarray]],
    weights: np.ndarray,
    models: Sequence[tuple[np.ndarray, float]],
    inverse: np.ndarray | None,
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """By block: scores Σ_j w_j z_tj ε_tj / (1 − h_tj) (rows, b), w_j z_tj σ_j where no ε is known, and √w_j z_tj (n, rows, b).

    Args:
        inverse: (b, b) (ZᵀWZ)⁻¹; None: h is 0.
    """
    for X, e in blocks:
        scores, missing, columns = np.zeros((len(X), X.shape[2])), [], []
        for j, (a, variance) in enumerate(models):
            white = np.asarray(lfilter(a, [1.0], e[::-1, j]))[::-1]
            x = np.where(np.isfinite(e[:, j, None]), X[:, j], 0.0)
            z = np.sqrt(weights[j]) * np.asarray(lfilter([1.0], a, x, axis=0))
            columns.append(z)
            if inverse is not None:
                white = white / (1.0 - np.minimum(np.einsum("ti,ti->t", z @ inverse, z), MOST_LEVERAGE))
            z = np.sqrt(weights[j]) * z
            scores += np.nan_to_num(white)[:, None] * z
            missing.append(z[np.isnan(white)] * np.sqrt(variance))
        yield scores, np.concatenate(missing), np.array(columns)


def _first_pass(
    blocks: Iterable[tuple[np.ndarray, np.ndarray, np.ndarray]], alone: bool
) -> tuple[int, np.ndarray | None]:
    """Half of the width of Parzen's window and (ZᵀWZ)⁻¹ (b, b), None of columns that are alone.

    The width is 2.6614 (4 ρ² N / (1 − ρ)⁴)^(1/5), ρ of the median column. [Andrews1991]
    """
    rows, sums, squares = 0, np.zeros(()), np.zeros(())
    for scores, _, columns in blocks:
        pairs = [(scores[k:] * scores[: len(scores) - k]).sum(axis=0) for k in (0, 1)]
        sums, rows = sums + pairs, rows + len(scores)
        squares = squares + sum(z.T @ z for z in columns)
    size, product = np.asarray(sums)
    share = np.clip(product[size > 0] / size[size > 0], -LARGEST, LARGEST)
    strength = float(np.median(4 * share**2 / (1 - share) ** 4)) if len(share) else 0.0
    half = int(np.clip(ceil(0.5 * 2.6614 * (strength * rows) ** 0.2), 1, max(rows // 20, 1)))
    return half, None if alone else inverse_of(np.asarray(squares))


def inverse_of(information: np.ndarray) -> np.ndarray:
    """(b, b) H⁻¹, its columns scaled first; directions that H says nothing of count as known."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return np.linalg.pinv(information / np.outer(size, size), rcond=1e-14) / np.outer(size, size)

"""Delays between two signals, in fractions of a sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import signal

MOST = 50  # samples that are searched either way
SHORTEST = 80  # rows
LEAST, ROUNDING = 1e-100, 1e-12  # change of a signal, whose squares would underflow, and as a share of its size
ALIKE = 0.7  # correlation of two signals between which a delay can be told
REMOVED = 0.2  # of the unexplained power, that a shift has to take away to be a delay
SHORT = 0.3  # rows: a shift that takes nothing away says that there is no delay
ROUNDS = 5  # of the refinement; each reduces the error about tenfold


@dataclass(frozen=True)
class SignalDelay:
    """Result of `delay_between`.

    Attributes:
        samples: of the second signal behind the first.   std: standard deviation [samples].
        gain: ratio of the second signal's size to the first's, negative where they move against each other.
        correlation: of the two once they are aligned, 0 to 1.
    """

    samples: float
    std: float
    gain: float
    correlation: float


def delay_between(first: np.ndarray, second: np.ndarray) -> SignalDelay | None:
    """Delay of the second signal behind the first:  second(k) = gain · first(k − d) + offset.

    The largest cross-correlation says d to a sample; Gauss-Newton steps on the least squares problem, whose derivative with
    respect to d is −ḟirst, refine it; the standard deviation counts only as many independent residuals as their own correlation
    leaves.

    Args:
        first, second: (k,) evenly sampled.
    Returns:
        delay: None where one of them does not change.
    """
    sizes = np.ptp(first), np.ptp(second)
    least = [max(LEAST, ROUNDING * float(np.abs(each).max())) for each in (first, second)]
    if len(first) < SHORTEST or sizes[0] <= least[0] or sizes[1] <= least[1]:
        return None
    a, b = (first - first.mean()) / sizes[0], (second - second.mean()) / sizes[1]
    most = min(MOST, len(a) // 4)
    lags = signal.correlation_lags(len(b), len(a))
    products = signal.correlate(b, a, method="fft")
    near = np.abs(lags) <= most
    d = float(lags[near][np.argmax(np.abs(products[near]))])
    k = np.arange(len(a), dtype=float)
    slope = np.gradient(a)
    inside = slice(most + 2, len(a) - most - 2)
    std = np.inf
    for _ in range(ROUNDS):
        shifted, rate = np.interp(k - d, k, a)[inside], np.interp(k - d, k, slope)[inside]
        matrix = np.stack([shifted, -rate, np.ones(len(rate))], axis=1)
        solution, *_ = np.linalg.lstsq(matrix, b[inside], rcond=None)
        if not solution[0]:
            return None
        rest = b[inside] - matrix @ solution
        around = max(float(np.corrcoef(rest[1:], rest[:-1])[0, 1]), 0.0) if rest.std() > 0 else 0.0
        independent = max(len(rest) * (1 - around) / (1 + around), 1.0)
        covariance = np.linalg.pinv(matrix.T @ matrix) * (len(rest) / independent)
        std = float(np.sqrt(rest.var() * covariance[1, 1])) / abs(float(solution[0]))
        d = float(np.clip(d + solution[1] / solution[0], -most, most))
    aligned = np.interp(k - d, k, a)[inside]
    correlation = float(np.corrcoef(aligned, b[inside])[0, 1]) if aligned.std() > 0 else 0.0
    gain = np.sign(correlation) * b[inside].std() / aligned.std() if aligned.std() > 0 else 0.0
    return SignalDelay(d, std, float(gain) * float(sizes[1] / sizes[0]), abs(correlation))


def delay_of(measured: np.ndarray, predicted: np.ndarray, parts: Sequence[slice]) -> SignalDelay | None:
    """Delay of the measured signal behind the predicted one, in rows; of several stretches the mean weighted by 1 / std².

    A stretch counts where the shift takes away a fifth at least of what the unshifted signals do not have in common: else
    another error looks like a delay.

    Args:
        measured, predicted: (rows,).   parts: stretches of rows.
    Returns:
        delay: None where no stretch tells one.
    """
    delays = []
    for part in parts:
        with np.errstate(invalid="ignore", divide="ignore"):
            found = delay_between(predicted[part], measured[part])
            plain = float(np.corrcoef(predicted[part], measured[part])[0, 1]) if found is not None else 0.0
        if found is None or not np.isfinite(found.std) or not np.isfinite(plain) or found.correlation < ALIKE:
            continue
        if abs(found.samples) < SHORT or 1.0 - found.correlation**2 < (1.0 - REMOVED) * (1.0 - plain**2):
            delays.append(found)
    if not delays:
        return None
    weights = np.array([1.0 / max(each.std, 1e-9) ** 2 for each in delays])
    samples, gain, correlation = np.average(
        [(d.samples, d.gain, d.correlation) for d in delays], axis=0, weights=weights
    )
    return SignalDelay(float(samples), float(weights.sum() ** -0.5), float(gain), float(correlation))

"""Random sampled systems with known truth, and what a bench would log of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import cont2discrete, lfilter


@dataclass(frozen=True, eq=False)
class Truth:
    """y = B/A u + 5 + white noise; b has `delay` leading zeros."""

    a: np.ndarray
    b: np.ndarray
    delay: int
    u: np.ndarray
    y: np.ndarray

    @property
    def order(self) -> int:
        return len(self.a) - 1


def random_truth(seed: int, rows: int = 2000, noise: float = 0.1) -> Truth:
    """Stable systems of order 1 to 3, poles of magnitude 0.3 to 0.95, 1 to `order` coefficients of B, delay 0 to 15 samples.

    The input is a random binary signal that holds each value for two samples; noise is a share of the output's size. The first
    coefficient of B is at least 0.3 of the largest: a response that begins in the noise has no delay that could be found.
    """
    draw = np.random.default_rng(seed)
    order, poles = int(draw.integers(1, 4)), []
    while len(poles) < order:
        if order - len(poles) >= 2 and draw.random() < 0.5:
            pole = draw.uniform(0.3, 0.95) * np.exp(1j * draw.uniform(0.1, 1.2))
            poles += [pole, pole.conjugate()]
        else:
            poles.append(draw.uniform(0.3, 0.95))
    a, count = np.real(np.poly(poles)), int(draw.integers(1, order + 1))
    delay = int(draw.integers(0, 16))
    b = np.concatenate([np.zeros(delay), draw.uniform(0.3, 1.0, count) * draw.choice([-1.0, 1.0], count)])
    u = np.repeat(draw.choice([-1.0, 1.0], rows // 2), 2)
    y = lfilter(b, a, u)
    return Truth(a, b, delay, u, y + noise * y.std() * draw.standard_normal(rows) + 5.0)


def sampled_truth(seed: int, rows: int = 2000, noise: float = 0.1) -> Truth:
    """Continuous systems of order 1 to 3 behind a dead time of 0 to 15 samples, their input held from sample to sample.

    Time constants are 2 to 30 samples, resonances last 10 to 100 samples with a damping of 0.2 to 1; there are 0 to order - 1
    zeros in the left half plane. Where poles outnumber zeros by 2 or 3, the first coefficient of B can be 0.001 of the
    largest. The input is a random binary signal that holds each value for five samples.
    """
    draw = np.random.default_rng(seed)
    order, poles = int(draw.integers(1, 4)), []
    while len(poles) < order:
        if order - len(poles) >= 2 and draw.random() < 0.5:
            damping, angular = draw.uniform(0.2, 1.0), 2 * np.pi / np.exp(draw.uniform(np.log(10.0), np.log(100.0)))
            pole = angular * (-damping + 1j * np.sqrt(1.0 - damping**2))
            poles += [pole, pole.conjugate()]
        else:
            poles.append(-1.0 / np.exp(draw.uniform(np.log(2.0), np.log(30.0))))
    zeros = -1.0 / np.exp(draw.uniform(np.log(2.0), np.log(30.0), int(draw.integers(0, order))))
    numerator, denominator = np.atleast_1d(np.poly(zeros)), np.real(np.poly(poles))
    scale = denominator[-1] / numerator[-1]  # gain 1
    sampled, a, _ = cont2discrete((scale * numerator, denominator), 1.0, method="zoh")
    delay = int(draw.integers(0, 16)) + 1  # the held input answers one sample later
    b = np.concatenate([np.zeros(delay), sampled.ravel()[1:]])
    u = np.repeat(draw.choice([-1.0, 1.0], rows // 5), 5)
    y = lfilter(b, a, u)
    return Truth(np.asarray(a), b, delay, u, y + noise * y.std() * draw.standard_normal(rows) + 5.0)

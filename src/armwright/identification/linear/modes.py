"""Poles, zeros, time constants and gain of a sampled model, with their standard deviations to first order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SAME = 1e-9  # imaginary part of a root that is real


@dataclass(frozen=True)
class ModelQuantity:
    """A quantity derived from a model: name, value, standard deviation, unit."""

    name: str
    value: float
    std: float
    unit: str


def root_gradient(polynomial: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Roots r (n,) in z and ∂r/∂(coefficients 1 …) (n, n) of a polynomial that begins with 1:  ∂r/∂p_k = -r^(n-k) / p'(r)."""
    roots = np.roots(polynomial)
    n = len(polynomial) - 1
    if len(roots) < n:  # trailing zeros of the polynomial are roots at 0
        roots = np.concatenate([roots, np.zeros(n - len(roots))])
    slope = np.polyval(np.polyder(polynomial), roots) if n else np.zeros(0)
    slope = np.where(np.abs(slope) < 1e-300, 1e-300, slope)
    powers = roots[:, None] ** (n - np.arange(1, n + 1))[None, :]
    return roots, -powers / slope[:, None]


def gain_of(a: np.ndarray, b: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Gain B(1)/A(1) and its derivatives by a1 … and by all of b; infinite for an integrator."""
    down, up = float(a.sum()), float(b.sum())
    if down == 0.0:
        return float("inf"), np.zeros(len(a) - 1), np.zeros(len(b))
    return up / down, np.full(len(a) - 1, -up / down**2), np.full(len(b), 1.0 / down)


def modes(poles: np.ndarray, gradient: np.ndarray, covariance: np.ndarray, period: float) -> list[ModelQuantity]:
    """Time constants of real poles, natural frequency and damping of pairs, slowest first, with standard deviations.

        p = exp(s T):  time constant -1/s,  natural frequency |s| / 2π,  damping -Re s / |s|

    Args:
        poles: (n,).   gradient: (n, k) ∂poles/∂parameters.   covariance: (k, k) of the parameters.   period: T [s].
    """
    found: list[ModelQuantity] = []
    for p, g in sorted(zip(poles, gradient, strict=True), key=lambda each: -abs(each[0])):
        real = abs(p.imag) <= SAME * max(abs(p), 1.0)
        if p.imag < 0 and not real:
            continue
        k = 1 + len([each for each in found if each.name.startswith(("time", "natural", "pole"))])
        if real and not 0.0 < p.real < 1.0:  # an integrator, a ringing or an unstable pole
            found.append(ModelQuantity(f"pole{k}", float(p.real), _std(g.real, covariance), ""))
        elif real:
            log = np.log(p.real)
            slope = period / (p.real * log**2)
            found.append(
                ModelQuantity(f"time_constant{k}", float(-period / log), slope * _std(g.real, covariance), "s")
            )
        else:
            s, ds = np.log(p) / period, g / (p * period)
            size = abs(s)
            d_size = np.real(np.conj(s) * ds) / size
            d_damping = -np.real(ds) / size + np.real(s) * d_size / size**2
            found.append(
                ModelQuantity(f"natural_frequency{k}", size / (2 * np.pi), _std(d_size, covariance) / (2 * np.pi), "Hz")
            )
            found.append(ModelQuantity(f"damping{k}", float(-np.real(s) / size), _std(d_damping, covariance), ""))
    return found


def _std(gradient: np.ndarray, covariance: np.ndarray) -> float:
    return float(np.sqrt(max(float(np.real(gradient @ covariance @ gradient)), 0.0)))


def matched(poles: np.ndarray, others: np.ndarray) -> np.ndarray:
    """`others` in the order of `poles`, each the nearest that is left."""
    left = list(others)
    order = []
    for pole in poles:
        k = int(np.argmin([abs(pole - each) for each in left]))
        order.append(left.pop(k))
    return np.array(order)


def magnitude_std(roots: np.ndarray, gradient: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Standard deviations of |roots| (n,)."""
    size = np.maximum(np.abs(roots), 1e-300)
    slope = np.real(np.conj(roots)[:, None] * gradient) / size[:, None]
    return np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slope, covariance, slope), 0.0))

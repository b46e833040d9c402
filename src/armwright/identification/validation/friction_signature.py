"""Residual torque against speed: friction that the record lacks. [ArmstrongHelouvry1991]"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SLOW = 0.02  # of the largest speed: below it the direction is noise
CERTAIN = 3.0  # standard deviations
SHARE = 0.05  # of the residual's power that a term explains, to be called missing
STRIBECK_SPEEDS = (0.03, 0.06, 0.12)  # of the largest speed, over which the peak falls
ACTS = 0.1  # of a term's largest value: below it the term plays no part, as Stribeck's beyond low speeds
WORTH = 0.01  # of the measured torque
BINS = 16  # of either direction
LEAST = 40  # rows
TERMS = ("offset", "Coulomb", "viscous", "inertia", "Stribeck")


@dataclass(frozen=True)
class SignatureTerm:
    """A term of friction or inertia in residual torques.

    Attributes:
        name: one of TERMS.   value: what the record lacks; below 0: has too much.   std: its standard deviation.   unit.
        share: of the residual's power that is gone with it, among the rows in which it acts.   rms: of its torques.
    """

    name: str
    value: float
    std: float
    unit: str
    share: float
    rms: float = np.inf

    @property
    def is_missing(self) -> bool:
        """True if significant and worth 5 % of the residual's power, beside all other terms."""
        return abs(self.value) > CERTAIN * self.std and self.share >= SHARE


@dataclass(frozen=True, eq=False)
class FrictionSignature:
    """Residual torque of a joint by its speed.

    Attributes:
        terms: offset, Coulomb, viscous, inertia and, where speeds reach low enough, Stribeck.
        explained: share of the residual's power that all terms explain together.
        speed, mean, std: (k,) means of the residual in bins of speed.   least: RMS of a term that is worth its name.
    """

    terms: tuple[SignatureTerm, ...]
    explained: float
    speed: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    least: float = 0.0

    @property
    def missing(self) -> tuple[SignatureTerm, ...]:
        """Terms that the record lacks or has too much of, the largest first."""
        found = [term for term in self.terms if term.is_missing and term.rms >= self.least]
        return tuple(sorted(found, key=lambda term: -term.share))


def friction_signature(
    residual: np.ndarray,
    speed: np.ndarray,
    acceleration: np.ndarray,
    unit: str = "N m",
    length: str = "rad",
    direction: np.ndarray | None = None,
    size: float = 0.0,
) -> FrictionSignature | None:
    """Least squares fit of  e = offset + F_c sgn q̇ + F_v q̇ + J q̈ (+ F_s sgn q̇ exp(−(q̇/v_s)²))  to residual torques.

    A term's share is by how much the residual's power rises without it. Standard deviations count only as many independent
    rows as the correlation of neighbours leaves.

    Args:
        residual: (rows,) measured less predicted torque [N m | N].   speed: (rows,) [rad/s | m/s].
        acceleration: (rows,) [rad/s² | m/s²].   unit: of the torque.   length: of the position.
        direction: (rows,) sgn q̇ through the filter that the torques have passed; None: unfiltered.
        size: RMS of the measured torque: a term below a hundredth of it is none that a record lacks.
    Returns:
        signature: None of a joint that hardly moves.
    """
    top = float(np.abs(speed).max()) if len(speed) else 0.0
    moving = np.abs(speed) > SLOW * top
    if top == 0.0 or moving.sum() < LEAST:
        return None
    e, v, a = residual[moving], speed[moving], acceleration[moving]
    sign = np.sign(v) if direction is None else direction[moving]
    columns = {"offset": np.ones(len(v)), "Coulomb": sign, "viscous": v, "inertia": a}
    columns = {
        name: column for name, column in columns.items() if name != "Coulomb" or ((v > 0).any() and (v < 0).any())
    }
    peaks = {}
    for part in STRIBECK_SPEEDS:
        peak = np.sign(v) * np.exp(-((v / (part * top)) ** 2))
        if (np.abs(v) < part * top).sum() >= LEAST:
            matrix = np.stack([*columns.values(), peak], axis=1)
            peaks[part] = float(((e - matrix @ np.linalg.lstsq(matrix, e, rcond=None)[0]) ** 2).sum())
    if peaks and "Coulomb" in columns:
        best = min(peaks, key=lambda part: peaks[part])
        columns["Stribeck"] = np.sign(v) * np.exp(-((v / (best * top)) ** 2))
    units = {
        "offset": unit, "Coulomb": unit, "Stribeck": unit, "viscous": f"{unit} s/{length}",
        "inertia": "kg m²" if length == "rad" else "kg",
    }  # fmt: skip
    return FrictionSignature(*_terms(e, columns, units), *_by_speed(e, v), WORTH * size)


def _terms(
    e: np.ndarray, columns: dict[str, np.ndarray], units: dict[str, str]
) -> tuple[tuple[SignatureTerm, ...], float]:
    """Every column's coefficient with its standard deviation and share of the power of e, and the share of all together."""
    matrix = np.stack(list(columns.values()), axis=1)
    scales = np.linalg.norm(matrix, axis=0)
    scales[scales == 0] = 1.0
    solution = np.linalg.lstsq(matrix / scales, e, rcond=None)[0]
    rest = e - matrix @ (solution / scales)
    lag1 = float(rest[1:] @ rest[:-1] / (rest @ rest)) if rest @ rest > 0 else 0.0
    independent = max(len(e) * (1.0 - max(lag1, 0.0)) / (1.0 + max(lag1, 0.0)) - len(scales), 1.0)
    inverse = np.linalg.pinv((matrix / scales).T @ (matrix / scales))
    std = np.sqrt(np.diag(inverse) * float(rest @ rest) / independent) / scales
    # Power rises by c² / (AᵀA)⁻¹ without a column of coefficient c: the partial sum of squares.
    rises = solution**2 / np.where(np.diag(inverse) > 0, np.diag(inverse), np.inf)
    acts = np.abs(matrix) > ACTS * np.abs(matrix).max(axis=0)
    powers = (e[:, None] ** 2 * acts).sum(axis=0)
    shares = np.divide(rises, powers, out=np.zeros_like(rises), where=powers > 0)
    terms = tuple(
        SignatureTerm(name, float(c), float(s), units[name], float(min(share, 1.0)), float(size))
        for name, c, s, share, size in zip(
            columns, solution / scales, std, shares, np.abs(solution) / len(e) ** 0.5, strict=True
        )
    )
    return terms, 1.0 - float(rest @ rest) / float(e @ e) if e.any() else 0.0


def _by_speed(e: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean speed, mean and standard deviation of e in bins with as many rows each, of either direction."""
    order = np.argsort(v)
    either_way = (order[v[order] < 0], order[v[order] > 0])  # friction jumps between them
    bins = [part for side in either_way for part in np.array_split(side, BINS) if len(part)]
    mean, spread = ([f(e[part]) for part in bins] for f in (np.mean, np.std))
    return np.array([v[part].mean() for part in bins]), np.array(mean), np.array(spread)

"""Statistics of arm identification over many seeds: do the errors of base parameters have the covariance that the fit states?

    python tools/arm_seeds.py --robot lwa4p --seeds 50

Every seed is a motion of its own with coloured noise of its own in the torques. For each, T² = eᵀ C⁻¹ e of the errors e of the
inertial base parameters, C the robust covariance of the fit. C is itself an estimate with ν degrees of freedom, so that T² is
Hotelling's: (ν − b + 1) T² / (ν b) has the distribution F(b, ν − b + 1), and the χ² of b degrees of freedom with the same
probability is the statistic of the seed. Their sum must be inside the central 99 % of χ²(base parameters × seeds). Further, the
torques of a fresh motion must be predicted with R² of 0.99 and more. Exit code 1 where either is not so.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from scipy.stats import chi2, f

import armwright as aw
from armwright.identification.arm.base import BaseParameters, base_parameters
from armwright.identification.arm.equations import equations_of
from armwright.identification.arm.fit import fit_arm, with_correlation
from armwright.identification.arm.samples import Samples
from armwright.identification.arm.torque_model import TorqueModel, torque_model

RATE, HARMONICS = 100.0, 8  # Hz of the rows, and of the motion's Fourier series
NOISE = 0.05  # of each torque's root mean square
CENTRAL, LEAST_R2 = 0.99, 0.99


@dataclass(frozen=True)
class Seed:
    """Result of one seed: χ² of the base parameters, and the least R² over the joints on a fresh motion."""

    chi2: float
    r2: float


def motion(n: int, seconds: float, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """t, q, q̇, q̈ of a random Fourier series; higher harmonics are smaller, so that accelerations are even."""
    t = np.arange(round(seconds * RATE)) / RATE
    order = np.arange(1, HARMONICS + 1)
    w = 2 * np.pi * order * max(1.0, np.floor(seconds / 10)) / seconds
    a, b = 1.5 * rng.normal(size=(2, HARMONICS, n)) / order[:, None]
    s, c = np.sin(w * t[:, None]), np.cos(w * t[:, None])
    return t, s @ a + c @ b, (w * c) @ a - (w * s) @ b, -(w**2 * s) @ a - (w**2 * c) @ b


def inertial(base: BaseParameters) -> np.ndarray:
    """Numbers of the base parameters of links; those of rotors and friction are beside them."""
    return np.array([b for b, k in enumerate(base.independent) if base.columns[k].kind == "inertial"])


def chi_square(t_square: float, count: int, freedom: float) -> float:
    """The χ² of `count` degrees of freedom with the probability of a Hotelling's T² of `freedom` degrees.  [Hotelling1931]"""
    rest = freedom - count + 1
    return float(chi2.isf(f.sf(t_square * rest / (freedom * count), count, rest), count))


def one_seed(
    model: TorqueModel, base: BaseParameters, truth: np.ndarray, seconds: float, seed: int, colour: float
) -> Seed:
    """χ² and prediction of a motion with noise.

    Args:
        model, base: of the arm.   truth: (p,) parameters.   seconds: of the motion.   seed: of motion and noise.
        colour: correlation of the noise from row to row.
    """
    rng = np.random.default_rng([seed, 15])
    t, *state = motion(model.arm.n, seconds, rng)
    clean = model.rows(*state) @ truth
    white = rng.normal(size=(len(t) + 200, model.arm.n)) * np.sqrt(1 - colour**2)
    noise = np.asarray(lfilter([1.0], [1.0, -colour], white, axis=0))[200:] * NOISE * np.sqrt((clean**2).mean(axis=0))
    rows = [Samples("run", 0, t, *state, clean + noise)]
    fit = with_correlation(lambda: rows, fit_arm(equations_of(rows, model), base))
    chosen = inertial(base)
    error = (fit.values - base.of(truth))[chosen]
    fresh = motion(model.arm.n, seconds, rng)[1:]
    torque, predicted = (model.rows(*fresh) @ each for each in (truth, fit.parameters))
    r2 = 1 - ((torque - predicted) ** 2).sum(axis=0) / ((torque - torque.mean(axis=0)) ** 2).sum(axis=0)
    t_square = float(error @ np.linalg.solve(fit.covariance[np.ix_(chosen, chosen)], error))
    return Seed(chi_square(t_square, len(chosen), fit.freedom), float(r2.min()))


def study(robot: str, seeds: range, seconds: float, colour: float) -> tuple[int, list[Seed]]:
    """Number of inertial base parameters, and the result of each seed."""
    model = torque_model(aw.load(robot))
    base = base_parameters(model)
    truth = np.nan_to_num(model.prior)
    return len(inertial(base)), [one_seed(model, base, truth, seconds, seed, colour) for seed in seeds]


def main() -> int:
    """Runs the study and prints its verdict."""
    parser = argparse.ArgumentParser(description="Errors of base parameters against their stated covariance.")
    parser.add_argument("--robot", default="lwa4p")
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=300.0, help="length of each motion [s]")
    parser.add_argument("--colour", type=float, default=0.3, help="correlation of the noise from row to row")
    options = parser.parse_args()
    begin = time.perf_counter()
    count, results = study(options.robot, range(options.seeds), options.seconds, options.colour)
    total, freedom = sum(each.chi2 for each in results), count * options.seeds
    low, high = chi2.ppf([0.5 - 0.5 * CENTRAL, 0.5 + 0.5 * CENTRAL], freedom)
    worst = min(each.r2 for each in results)
    print(f"{options.robot}: {count} inertial base parameters, {options.seeds} seeds of {options.seconds:g} s")
    print(f"sum of chi² {total:.1f}; central {CENTRAL:.0%} of chi²({freedom}): {low:.1f} to {high:.1f}")
    print(f"least R² of a joint's torque on a fresh motion: {worst:.5f}")
    print(f"{time.perf_counter() - begin:.1f} s")
    return 0 if low <= total <= high and worst >= LEAST_R2 else 1


if __name__ == "__main__":
    sys.exit(main())

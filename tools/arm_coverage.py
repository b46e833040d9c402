"""Coverage of the stated 95 % intervals of base parameters, on logs that Pinocchio and NumPy make; a table for the docs.

    python tools/arm_coverage.py [--seeds 40] [--joints 3 6 7] [--cases noise quantised both loop] [--cutoff HZ]

Each seed is a random arm with rotors and friction on a random multisine, 20 s at 500 Hz. `noise`: 3 % of the torques;
`quantised`: positions in steps of 0.1 mrad and torque noise of 0.2 %, `truncated`: the same, cut to whole counts; `both`: white
noise of 0.1 mrad and 0.2 %; `loop`: a controller holds the arm to the motion, positions with noise of 0.02 mrad go into its
torques, which act until the next row. Default fits.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

import armwright as aw
from identification.arm.logged_machine import Machine, Motion, counted, read, written

RATE, SECONDS = 500.0, 20.0
STEP = 1e-4  # [rad] of encoders
HALF_95 = 1.96

Signals = tuple[np.ndarray, np.ndarray]


def noisy(values: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Values (rows, n) with white noise, a share of each column's deviation."""
    return values + share * values.std(axis=0) * rng.normal(size=values.shape)


def open_loop(share: float, positions: Callable[[np.ndarray, np.random.Generator], np.ndarray]):
    """Positions and torques of a known motion."""

    def signals(machine: Machine, motion: Motion, t: np.ndarray, rng: np.random.Generator, seed: int) -> Signals:
        states = motion.at(t)
        return positions(states[0], rng), noisy(machine.torque(*states), share, rng)

    return signals


def in_loop(machine: Machine, motion: Motion, t: np.ndarray, rng: np.random.Generator, seed: int) -> Signals:
    """Positions and torques of a controller that follows the motion."""
    q, tau = machine.controlled(motion, t, 2e-5, seed)
    return q, noisy(tau, 0.002, rng)


CASES = {
    "noise": open_loop(0.03, lambda q, rng: q),
    "quantised": open_loop(0.002, lambda q, rng: counted(q, STEP, rng)),
    "truncated": open_loop(0.002, lambda q, rng: counted(q, STEP, rng, truncated=True)),
    "both": open_loop(0.002, lambda q, rng: q + STEP * rng.normal(size=q.shape)),
    "loop": in_loop,
}


def fitted(case: str, joints: int, seed: int, cutoff: float | None = None, **options):
    """The fit of a seed's log, and the true parameters (p,) of its model."""
    with TemporaryDirectory() as made:
        machine, motion = Machine.written(Path(made), joints, seed), Motion.of(joints, seed)
        t, rng = np.arange(round(RATE * SECONDS)) / RATE, np.random.default_rng([seed, 3])
        q, tau = CASES[case](machine, motion, t, rng, seed)
        columns = {"t": t, "position": q, "torque": tau}
        log = read(written(Path(made), case, machine.names, columns, "torque" if case == "loop" else None))
        rows = aw.identification.FitRows(cutoff=cutoff)
        options = {"record": False, "checks": ()} | options
        found = aw.identification.identify_arm(log, machine.arm, rows=rows, **options)
        return found, machine.truth(found.fit.equations.model)


def deviations(case: str, joints: int, seed: int, cutoff: float | None = None):
    """z (b,) of the base parameters of a seed's default fit, and its cut-off [Hz]."""
    found, truth = fitted(case, joints, seed, cutoff)
    return (found.fit.values - found.fit.base.of(truth)) / found.fit.std, found.estimate.preparation["cutoff_hz"]


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description="Coverage of stated intervals.")
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--joints", type=int, nargs="+", default=[3, 6, 7])
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=CASES)
    parser.add_argument("--cutoff", type=float, default=None)
    options = parser.parse_args()
    print("joints | case | cut-off [Hz] | coverage | rms z | seconds a seed")
    for joints in options.joints:
        for case in options.cases:
            begin = time.process_time()
            z, cutoffs = zip(*(deviations(case, joints, s, options.cutoff) for s in range(options.seeds)), strict=True)
            z, seconds = np.concatenate(z), (time.process_time() - begin) / options.seeds
            cover, size = (np.abs(z) < HALF_95).mean(), np.sqrt((z**2).mean())
            print(
                f"{joints} | {case} | {np.median(cutoffs):.3g} | {cover:.3f} | {size:.2f} | {seconds:.1f}", flush=True
            )


if __name__ == "__main__":
    main()

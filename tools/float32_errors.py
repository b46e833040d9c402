"""Writes docs/data/float32-errors.csv: errors of the float32 kernels over a million states, and the worst that a search finds.

    .venv/bin/python tools/float32_errors.py [ARM …]

Every entry of every input is uniform within ±π in its unit (rad, rad/s, rad/s², N m, V; metres for slides), rounded to float32.
An error is the largest difference of a result from the float64 kernel's at the same inputs, in roundings (2⁻²⁴) of the result's
largest entry, or of 1 in its unit where that is less; of energies, whose terms cancel, of the largest in the sample. The search
starts at the worst states of the sample and changes one or two entries at a time: half of the proposals draw them anew, half
move them a little, by steps of all sizes down to the last bit. It finds a lower bound of the largest error there is.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import armwright as aw
from armwright.errors import ModelError
from armwright.kernels.signatures import SIGNATURES

TABLE = Path(__file__).resolve().parent.parent / "docs" / "data" / "float32-errors.csv"
ROUNDING = 2.0**-24
LARGEST_INPUT = np.float32(np.pi)
QUANTILES = (0.5, 0.99, 0.9999)
HEAD = ("function", "arm", "half below", "99 % below", "99.99 % below", "largest of a million", "largest found")
CHUNK = 32_768  # states at once
SEED = 13

Errors = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Sample:
    """Errors of one function for one arm, in roundings.

    Attributes:
        quantiles: those of QUANTILES.   largest: of the sample.
        found: the largest that the search came to.   state: (inputs,) float32 where that is.
    """

    quantiles: tuple[float, ...]
    largest: float
    found: float
    state: np.ndarray


class KernelErrors:
    """Errors of an arm's float32 kernel at rows of inputs, (states, numbers of all inputs) → (states,).

    Raises:
        ModelError: the arm lacks what the kernel needs.
    """

    def __init__(self, arm: aw.Model, kernel: str):
        self.single, self.double = (aw.compile(arm, dtype=dtype).kernel(kernel) for dtype in ("float32", "float64"))
        self.shapes = [argument.sized(arm) for argument in SIGNATURES[kernel].inputs]
        self.sizes = [int(np.prod(shape)) for shape in self.shapes]
        self.scales: list[float] | None = None  # of energies, from the sample
        self.of_sample = kernel == "energy"

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """[roundings] The error at each row; infinite where one of both results is not finite."""
        columns = np.split(rows, np.cumsum(self.sizes)[:-1], axis=1)
        inputs = [np.ascontiguousarray(c).reshape(-1, *shape) for c, shape in zip(columns, self.shapes, strict=True)]
        found, exact = self.single(*inputs), self.double(*(array.astype(float) for array in inputs))
        found, exact = (each if isinstance(each, tuple) else (each,) for each in (found, exact))
        if self.of_sample and self.scales is None:
            self.scales = [float(np.abs(result).max()) for result in exact]
        largest = np.zeros(len(rows))
        for k, (single, double) in enumerate(zip(found, exact, strict=True)):
            single, double = single.reshape(len(rows), -1).astype(float), double.reshape(len(rows), -1)
            scale = np.maximum(np.abs(double).max(axis=1) if self.scales is None else self.scales[k], 1.0)
            with np.errstate(invalid="ignore"):  # infinite results, beside a singular pose
                error = np.abs(single - double).max(axis=1) / (ROUNDING * scale)
            largest = np.maximum(largest, np.where(np.isfinite(error), error, np.inf))
        return largest


def drawn(random: np.random.Generator, states: int, numbers: int) -> np.ndarray:
    """(states, numbers) float32, uniform within ±π."""
    return random.uniform(-LARGEST_INPUT, LARGEST_INPUT, (states, numbers)).astype(np.float32)


def searched(
    errors: Errors, starts: np.ndarray, rounds: int, proposals: int, random: np.random.Generator
) -> tuple[float, np.ndarray]:
    """The largest error found from those states, and its state: each keeps the best of its proposals, round by round."""
    points, values = starts.copy(), errors(starts)
    count, numbers = points.shape
    for _ in range(rounds):
        tried = np.repeat(points, proposals, axis=0)
        rows = np.arange(len(tried))
        for _ in range(2):  # the same entry twice is a change of one
            entry = random.integers(0, numbers, len(tried))
            step = LARGEST_INPUT * 10.0 ** random.uniform(-7.0, 0.0, len(tried)) * random.normal(size=len(tried))
            anew = random.random(len(tried)) < 0.5
            moved = np.where(anew, drawn(random, len(tried), 1)[:, 0], tried[rows, entry] + step)
            tried[rows, entry] = np.clip(moved, -LARGEST_INPUT, LARGEST_INPUT)
        found = errors(tried).reshape(count, proposals)
        best = found.argmax(axis=1)
        better = found[np.arange(count), best] > values
        points[better] = tried.reshape(count, proposals, numbers)[better, best[better]]
        values = np.maximum(values, found.max(axis=1))
    worst = int(values.argmax())
    return float(values[worst]), points[worst]


def sampled(
    errors: Errors, numbers: int, states: int, rounds: int, starts: int = 64, proposals: int = 128, seed: int = SEED
) -> Sample:
    """Quantiles of the errors of random states, and the largest that a search from the worst of them finds."""
    random = np.random.default_rng(seed)
    every, worst = [], np.empty((0, numbers), np.float32)
    for first in range(0, states, CHUNK):
        rows = drawn(random, min(CHUNK, states - first), numbers)
        every.append(errors(rows))
        candidates = np.concatenate([worst, rows[np.argsort(every[-1])[-starts:]]])
        worst = candidates[np.argsort(errors(candidates))[-starts:]]
    values = np.concatenate(every)
    found, state = searched(errors, worst, rounds, proposals, random)
    quantiles = tuple(float(value) for value in np.quantile(values, QUANTILES, method="higher"))
    return Sample(quantiles, float(values.max()), found, state)


def shown(error: float) -> str:
    """An error in the table: two digits."""
    return "no digit" if error > 1.0 / ROUNDING else f"{float(f'{error:.2g}'):g}"


def main() -> None:
    """Examines every function of the arms, all built-in ones by default, and writes the table."""
    rows = []
    for kernel in SIGNATURES:
        for name in sys.argv[1:] or aw.builtin_names():
            arm = aw.load(name)
            try:
                errors = KernelErrors(arm, kernel)
            except ModelError:
                continue
            sample = sampled(errors, sum(errors.sizes), states=2**20, rounds=200)
            rows.append((kernel, name, *map(shown, (*sample.quantiles, sample.largest, sample.found))))
            print(*rows[-1], flush=True)
    with open(TABLE, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows([HEAD, *rows])


if __name__ == "__main__":
    main()

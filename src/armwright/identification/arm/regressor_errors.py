"""Errors of the columns of an arm's torque model by noise and quantisation of the measured motion.

Errors Δ of the columns make the normal matrix of least squares too large, E[(Y + Δ)ᵀW(Y + Δ)] = YᵀWY + E[ΔᵀWΔ], and the
parameters too small.  [Fuller1987]  E[ΔᵀWΔ] is estimated from rows that are disturbed once more, by errors uniform over a count
of the encoder or as white as the floor of the signal's spectrum, and pass the whole preparation. Columns of dry friction are left
out: an error only turns its direction round, which makes no square larger.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from armwright.identification.arm.equations import Samples
from armwright.identification.arm.samples import Stream
from armwright.identification.arm.torque_model import KINDS, TorqueModel
from armwright.identification.logs.census import Census
from armwright.identification.logs.even_rows import EvenStretch
from armwright.identification.logs.quantisation import quantisation_step
from armwright.identification.logs.spectrum import longest_finite, spectrum

DRAWS, ROWS = 2, 10_000  # draws of noise, and rows of the log that they disturb
FEWEST = 64  # rows that noise is estimated from


@dataclass(frozen=True, eq=False)
class MotionNoise:
    """Noise of a run's motion: by signal, steps (joints,) of quantised columns and deviations (joints,) of the others."""

    steps: Mapping[str, np.ndarray]
    deviations: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, census: Census) -> MotionNoise:
        """As a run's excerpt shows it."""
        steps, deviations, rows = {}, {}, census.longest
        for name in ("q", "qd"):
            if name not in census.excerpt.values or rows is None or len(rows.t) < FEWEST:
                continue
            raw = [longest_finite(column) for column in census.excerpt.values[name].T]
            steps[name] = np.array([quantisation_step(each) or 0.0 if len(each) > FEWEST else 0.0 for each in raw])
            deviations[name] = np.array([_white(each, 1.0 / rows.period) for each in rows.values[name].T])
        return cls(steps, deviations)

    def disturbed(self, rows: EvenStretch, rng: np.random.Generator) -> EvenStretch:
        """The rows with such noise once more."""
        values = dict(rows.values)
        for name, steps in self.steps.items():
            shape = values[name].shape
            counted, white = steps * rng.uniform(-0.5, 0.5, shape), self.deviations[name] * rng.normal(size=shape)
            values[name] = values[name] + np.where(steps > 0.0, counted, white)
        return replace(rows, values=values)


def _white(column: np.ndarray, rate: float) -> float:
    """Deviation of white noise with the density of the floor of a column's spectrum."""
    f, power = spectrum(column, rate)
    return float(np.sqrt(np.median(power[f > 0.25 * rate]) * rate / 2)) if np.ptp(column) > 0.0 else 0.0


def disturbed_samples(stream: Stream, model: TorqueModel) -> Iterator[tuple[Samples, Samples]]:
    """Samples of the excerpts of the stream's runs, and the same with the noise of their motion once more."""
    count = sum(len(run.census.even) for run in map(stream.log.run, stream.filters))
    settles = max(each.narrow.edge for each in stream.filters.values())
    most = max(ROWS // max(count, 1), 4 * settles)
    clean = list(stream.of_excerpts(model, lambda _, rows: rows.middle(most)))
    noise = {run: MotionNoise.of(stream.log.run(run).census) for run in stream.filters}
    for draw in range(DRAWS):
        rng = np.random.default_rng(draw)
        disturbed = stream.of_excerpts(model, lambda run, rows, rng=rng: noise[run].disturbed(rows.middle(most), rng))
        yield from zip(clean, disturbed, strict=True)


def regressor_errors(stream: Stream, model: TorqueModel) -> np.ndarray:
    """E[δᵀδ] (n, p, p) of a row's errors δ in the columns of each joint, from the excerpts of the stream's runs."""
    total, rows = np.zeros((model.arm.n, len(model), len(model))), 0
    smooth = np.array([column.kind == "inertial" or KINDS[column.kind].lack != "coulomb" for column in model.columns])
    for before, after in disturbed_samples(stream, model):
        errors = (after.regressor(model) - before.regressor(model)) * smooth
        total += np.einsum("tji,tjk->jik", errors, errors)
        rows += len(errors)
    return total / max(rows, 1)

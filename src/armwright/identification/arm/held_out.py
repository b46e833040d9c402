"""Verdict on the record of a fit by the runs that the log holds out, or by the parts of the log that were held out.

Runs held out judge the record as it would be written, beside the record that it replaces (`validation.comparison`). What the
fit's own deviations add to the torque's error there is no fault of the record: with C the covariance of the base parameters and
G_j = Σ xᵀx / rows of joint j's columns there, the mean square error δᵀ G_j δ of errors δ ~ N(0, C) is nearly c χ²_h,
c = tr(G C G C) / tr(G C),  h = tr(G C) / c. [Satterthwaite1946]
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy import stats

from armwright.errors import ArmwrightError
from armwright.identification.arm.arm_record import RecordParameters, write_record
from armwright.identification.arm.equations import Samples, equations_of, stacked
from armwright.identification.arm.fit import ArmFit
from armwright.identification.arm.samples import Stream
from armwright.identification.estimate import Estimate
from armwright.identification.validation.comparison import NO_VERDICT, FitNoise, RecordComparison, compare_records
from armwright.model import Model
from armwright.model.load import load

CERTAIN = 0.99


def judged_record(
    stream: Stream, arm: Model, fit: ArmFit, values: RecordParameters, estimate: Estimate
) -> tuple[RecordComparison | None, list[str]]:
    """The record of a fit on the runs held out, beside the arm that came in; and remarks. None where they do not judge it.

    Args:
        stream: of the log.   arm: that came in.   fit: of the log.   values: for the record.   estimate: base parameters.
    """
    try:
        fresh = replace(stream, filters=stream.fresh).samples(fit.equations.model)
        noise = error_by_noise(fit, fresh)
        with TemporaryDirectory() as folder:
            path = write_record(fit, values, stream.gears, estimate, Path(folder) / "arm.toml")
            written = load(path, on_impossible="warn")  # of links that came in so
        found = compare_records(
            written, arm, stream.log, list(stream.fresh), simulation=False, noise=noise, cutoff=stream.cutoff
        )
    except ArmwrightError as error:
        return None, [f"{NO_VERDICT}: {error}"]
    return found, found.remarks


def error_by_noise(fit: ArmFit, samples: Iterable[Samples]) -> dict[str, FitNoise]:
    """Mean square torque error [(N m)² | N²] by joint that 99 % of fits with these deviations stay below on some rows.

    Args:
        fit: with its covariance.   samples: of other runs.
    """
    model, base, found = fit.equations.model, fit.base, {}
    equations = equations_of(samples, model, part_seconds=np.inf)
    for joint, factor, rms in zip(model.arm.names, equations.factors, fit.rms, strict=True):
        if factor.rows and rms > 0.0:
            columns = stacked([factor], len(model), np.ones(1))[0][:, base.independent]
            product = columns.T @ columns @ fit.covariance / factor.rows
            mean, square = float(np.trace(product)), float(np.sum(product * product.T))
            if mean > 0.0 and square > 0.0:
                error = square / mean * float(stats.chi2.ppf(CERTAIN, mean**2 / square))
                found[joint] = FitNoise(error, float(rms**2))
    return found

"""Torque error on other runs that the deviations of a fit make.

With C the covariance of the base parameters and G_j = Σ xᵀx / rows of joint j's columns there, the mean square error δᵀ G_j δ of
errors δ ~ N(0, C) is nearly c χ²_h,  c = tr(G C G C) / tr(G C),  h = tr(G C) / c. [Satterthwaite1946]
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from armwright.identification.arm.equations import equations_of, stacked
from armwright.identification.arm.fit import ArmFit
from armwright.identification.arm.samples import samples_of
from armwright.identification.logs.log import Log
from armwright.identification.validation.comparison import FitNoise
from armwright.identification.validation.prediction import preparation_for

CERTAIN = 0.99


def error_by_noise(fit: ArmFit, log: Log, runs: Sequence[str]) -> dict[str, FitNoise]:
    """Mean square torque error [(N m)² | N²] by joint that 99 % of fits with these deviations stay below on some runs.

    Args:
        fit: with its covariance.   log: with the runs.   runs: names.
    """
    model, base, found = fit.equations.model, fit.base, {}
    prepared = {run: preparation_for(log, run) for run in runs}
    equations = equations_of(samples_of(log, model, runs, prepared), model, part_seconds=np.inf)
    for joint, factor, rms in zip(model.arm.names, equations.factors, fit.rms, strict=True):
        if factor.rows and rms > 0.0:
            columns = stacked([factor], len(model), np.ones(1))[0][:, base.independent]
            product = columns.T @ columns @ fit.covariance / factor.rows
            mean, square = float(np.trace(product)), float(np.sum(product * product.T))
            if mean > 0.0 and square > 0.0:
                error = square / mean * float(stats.chi2.ppf(CERTAIN, mean**2 / square))
                found[joint] = FitNoise(error, float(rms**2))
    return found

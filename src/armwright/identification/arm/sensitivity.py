"""Sensitivity of a fit to the cut-off of its low-pass."""

from __future__ import annotations

import numpy as np

from armwright.errors import IdentificationError
from armwright.identification.arm.equations import equations_of
from armwright.identification.arm.fit import ArmFit, fit_arm
from armwright.identification.arm.samples import Stream
from armwright.identification.estimate import HALF_95

SMALLER, LARGER = 0.7, 1.3  # cut-offs that the fit is compared at


def sensitive_parameters(stream: Stream, fit: ArmFit) -> tuple[str, ...]:
    """Names of parameters that leave their 95 % interval where the cut-off is 30 % lower or higher."""
    decimate = next(iter(stream.filters.values())).narrow.decimate
    model, moved = fit.equations.model, np.zeros(len(fit.base), dtype=bool)
    for factor in (SMALLER, LARGER):
        rows = stream.at(factor * stream.cutoff, decimate).samples(model)
        try:
            again = fit_arm(equations_of(rows, model), fit.base, "wls", fit.weights)
        except IdentificationError:  # a filter so slow that too few rows are left
            continue
        moved |= np.abs(again.values - fit.values) > HALF_95 * fit.std
    return tuple(name for name, out in zip(fit.base.names, moved, strict=True) if out)

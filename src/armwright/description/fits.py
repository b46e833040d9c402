"""Fits of a description's numbers to measurements: correlation and quality, beyond the standard deviations."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from armwright.description.built_from import Sha256
from armwright.quantity import Number, Record, optional
from armwright.validation import Invalid

SLACK = 1e-6  # of a correlation's smallest eigenvalue: its numbers are rounded


def _below_diagonal(rows: object) -> object:
    """Rows of the part of a correlation matrix below its diagonal: the first has no number, the next one, and so on."""
    if not isinstance(rows, (list, tuple)) or not all(isinstance(row, (list, tuple)) for row in rows):
        raise Invalid(expected="a list of rows, the first with no number, the next with one, and so on")
    for k, row in enumerate(rows):
        if len(row) != k:
            raise Invalid(f"row {k} has {len(row)} numbers", expected=f"{k}: those below the diagonal")
        for number in row:
            if not isinstance(number, (int, float)) or not math.isfinite(number) or abs(number) > 1.0:
                raise Invalid(value=number, expected="a correlation, from -1 to 1")
    return rows


Correlation = Annotated[tuple[tuple[float, ...], ...], BeforeValidator(_below_diagonal)]


class PreparationRecord(Record):
    """Low-pass of a log's rows before a fit; a comparison with a log takes the same one."""

    cutoff_hz: float = Field(gt=0.0, description="Where amplitudes are halved.")
    order: int = Field(
        default=4, ge=1, le=10, description="Of the Butterworth filter, which runs forward and backward."
    )
    differentiation: Literal["central", "savgol", "three rows"] = Field(
        default="central", description="Of positions or speeds."
    )


class FitRecord(Record):
    """A fit to a log: which numbers it gave, how they are correlated, and how well it predicts. [fits.KEY] of a robot file.

    The covariance of two numbers is their correlation times the standard deviations that stand beside them.
    """

    source: str = Field(min_length=1, description="Key of [sources] that its numbers name; of the kind fit.")
    method: str = Field(min_length=1, description="How it was fitted.")
    log_sha256: Sha256 = Field(description="Checksum of the log, as `armwright log` shows it.")
    verdict: Literal["identified", "not identified"] = Field(
        description='"not identified" if the log does not determine a requested number, one is at its bound, or runs held out '
        "are predicted worse than by the record before."
    )
    names: tuple[str, ...] = Field(
        default=(), description="Paths of the numbers that the log gave, `joint1.motor.resistance_ohm`."
    )
    correlation: Correlation = Field(
        default=(), description="Of these numbers: rows of the part below the diagonal of their correlation matrix."
    )
    at_bound: tuple[str, ...] = Field(
        default=(), description="Those of them that stand at a bound: their standard deviations mean nothing."
    )
    unidentified: tuple[str, ...] = Field(
        default=(), description="Paths of requested numbers that the log does not determine: kept as they were."
    )
    condition: float | None = Field(
        default=None, ge=1.0, description="Condition number of the fit's scaled Jacobian, or of its regressor."
    )
    others: dict[str, Number] = Field(
        default_factory=dict,
        description="What was estimated beside the robot's numbers: delays, offsets of a run, base parameters.",
    )
    measures: dict[str, dict[str, float]] = Field(
        default_factory=dict, description="How well it predicts, by signal or joint: fit_percent, r2, rms."
    )
    preparation: PreparationRecord | None = optional("Of the log; `armwright validate` takes the same.")
    remarks: tuple[str, ...] = Field(default=(), description="What a user of these numbers should know.")

    @model_validator(mode="after")
    def _whole(self) -> FitRecord:
        if self.correlation and len(self.correlation) != len(self.names):
            raise Invalid(place="correlation", expected=f"{len(self.names)} rows, one for each of names")
        if self.correlation and np.linalg.eigvalsh(self.correlation_matrix())[0] < -SLACK:
            raise Invalid("is of no random numbers", place="correlation", expected="a positive semidefinite matrix")
        return self

    def without(self, prefixes: tuple[str, ...]) -> FitRecord:
        """The fit of its other numbers: those whose path begins so come from elsewhere now."""
        kept = [k for k, name in enumerate(self.names) if not name.startswith(prefixes)]
        rows = self.correlation and tuple(tuple(self.correlation[k][j] for j in kept if j < k) for k in kept)
        names = {key: getattr(self, key) for key in ("names", "at_bound", "unidentified")}
        names = {key: tuple(each for each in every if not each.startswith(prefixes)) for key, every in names.items()}
        return self.replace(**names, correlation=rows)

    def correlation_matrix(self) -> np.ndarray:
        """(n, n) symmetric matrix of correlations in the order of `names`, 1 on its diagonal."""
        matrix = np.eye(len(self.correlation))
        for k, row in enumerate(self.correlation):
            matrix[k, :k] = matrix[:k, k] = row
        return matrix

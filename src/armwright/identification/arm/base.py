"""Base parameters: the combinations of an arm's parameters that its torques depend on. [GautierKhalil1990], [Gautier1991]

Columns of the regressor that depend on earlier ones are regrouped:  Y π = Y_b (π_b + K π_d) = Y_b β.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armwright.errors import IdentificationError
from armwright.identification.arm.equations import Equations, Samples, equations_of
from armwright.identification.arm.torque_model import ZERO, TorqueColumn, TorqueModel, random_states

DEPENDENT = 1e-8  # sine of the angle between a column and the space of those before it: below, it depends on them
# The same, of an arm's structure: real ones have 0.03 or more. What is left below are angles that a file rounds, such as a right
# angle of 1.5708, which make two columns differ by parts in a million, or leave a column of such a part of others in its unit. No
# log tells these, and their values would be of any size.
NEARLY = 1e-4
SMALLEST = 0.1  # of that sine: a regrouping's coefficients that are smaller, of columns of length 1, are rounding
PREFERRED = {("inertial", unit): place for place, unit in enumerate(("kg m²", "kg m", "kg"))}  # who stays; then drives
LAST = len(PREFERRED)
STATES = 20  # random states for each column


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Base parameters β = π_b + K π_d of a model, whose columns have names.

    Attributes:
        columns: of the model, all of them.   independent: (b,) numbers of the columns that stay.
        dependent: (d,) numbers of those that are regrouped.   absent: (a,) numbers of those without any effect.
        regroup: K (b, d).
    """

    columns: tuple[TorqueColumn, ...]
    independent: np.ndarray
    dependent: np.ndarray
    absent: np.ndarray
    regroup: np.ndarray

    def __len__(self) -> int:
        return len(self.independent)

    @cached_property
    def matrix(self) -> np.ndarray:
        """A (b, p) of  β = A π."""
        matrix = np.zeros((len(self), len(self.columns)))
        matrix[np.arange(len(self)), self.independent] = 1.0
        matrix[:, self.dependent] = self.regroup
        return matrix

    def without(self, columns: Sequence[int] | np.ndarray) -> BaseParameters:
        """The base parameters but for those of some columns, which count as without effect, with all that is regrouped."""
        kept = ~np.isin(self.independent, columns)
        absent = np.sort(np.concatenate([self.absent, self.independent[~kept]]))
        return replace(self, independent=self.independent[kept], absent=absent, regroup=self.regroup[kept])

    @property
    def names(self) -> list[str]:
        """Short names: that of the kept parameter, with "*" if others were added to it."""
        return [
            self.columns[k].name + ("*" if np.any(row) else "")
            for k, row in zip(self.independent, self.regroup, strict=True)
        ]

    @property
    def units(self) -> list[str]:
        """Units of the base parameters."""
        return [self.columns[k].unit for k in self.independent]

    @property
    def formulas(self) -> list[str]:
        """Every base parameter as a formula: "Izz2 + 0.2025 m3"."""
        names = [column.name for column in self.columns]
        return [self._formula(b, names) for b in range(len(self))]

    def _formula(self, b: int, names: list[str]) -> str:
        text = names[self.independent[b]]
        for k, value in zip(self.dependent, self.regroup[b], strict=True):
            if value != 0:
                size = f"{abs(value):.6g}"
                text += f" {'-' if value < 0 else '+'} {'' if size == '1' else f'{size} '}{names[k]}"
        return text

    def of(self, parameters: np.ndarray) -> np.ndarray:
        """β (b,) of parameters (p,)."""
        return self.matrix @ parameters

    def expanded(self, values: np.ndarray) -> np.ndarray:
        """Parameters (p,) with these base parameters (b,), all regrouped ones 0."""
        parameters = np.zeros(len(self.columns))
        parameters[self.independent] = values
        return parameters

    def nearest(self, values: np.ndarray, prior: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """Parameters (p,) with these base parameters (b,), nearest to a prior (p,) in units of `scale` (p,).

        argmin |(π - π₀)/scale|  with  A π = β.  Columns without effect keep their prior.
        """
        weighted = self.matrix * scale
        change = np.linalg.lstsq(weighted, values - self.of(prior), rcond=None)[0]
        return prior + scale * change


def base_parameters(model: TorqueModel, without: Sequence[int] = ()) -> BaseParameters:
    """The base parameters of an arm by structure: for all motions.

    Args:
        model: the arm and its columns.   without: numbers of columns that count as 0.
    Returns:
        base: rank and regrouping of the columns at random states.
    """
    factor = structural_factor(model)
    factor[:, list(without)] = 0.0
    return regrouped(model.columns, _without_negligible(model.columns, factor), NEARLY)


def _without_negligible(columns: Sequence[TorqueColumn], factor: np.ndarray) -> np.ndarray:
    """R with columns of 0 where they are less than `NEARLY` of the largest of the same unit."""
    size = np.linalg.norm(factor, axis=0)
    largest: dict[str, float] = {}
    for column, each in zip(columns, size, strict=True):
        largest[column.unit] = max(largest.get(column.unit, 0.0), float(each))
    least = NEARLY * np.array([largest[column.unit] for column in columns])
    return np.where(size < least, 0.0, factor)


def regrouped_further(structural: BaseParameters, factor: np.ndarray, dependent: float = DEPENDENT) -> BaseParameters:
    """Base parameters identifiable from a log: those of the structure, regrouped if their columns coincide in its motion.

    Args:
        structural: of the arm.   factor: R (r, p) of the log's columns.   dependent: as of `regrouped`.
    """
    kept, columns = structural.independent, structural.columns
    own = regrouped(tuple(columns[k] for k in kept), factor[:, kept], dependent)
    if len(own) == len(structural):
        return structural
    matrix = own.matrix @ structural.matrix
    others = np.sort(np.concatenate([structural.dependent, kept[own.dependent]]))
    absent = np.sort(np.concatenate([structural.absent, kept[own.absent]]))
    return BaseParameters(columns, kept[own.independent], others, absent, matrix[:, others])


def told_parameters(equations: Equations, without: Sequence[int] = ()) -> BaseParameters:
    """Base parameters identifiable from a log, without some columns."""
    return regrouped_further(base_parameters(equations.model, without), equations.factor)


def structural_factor(model: TorqueModel) -> np.ndarray:
    """R (≤ p, p) of the model's columns at random states."""
    states = random_states(model.arm, STATES * max(len(model) // model.arm.n, 1))
    zero = np.zeros_like(states[0])
    equations = equations_of([Samples("random", 0, zero[:, 0], *states, zero)], model)
    return equations.factor[: len(model)]


def regrouped(columns: tuple[TorqueColumn, ...], factor: np.ndarray, dependent: float = DEPENDENT) -> BaseParameters:
    """Base parameters from R of the columns.

    Columns below 1e-10 of the largest are zero, before any scaling. Of the others, each one that depends on those before
    it is regrouped into them: tensors come first, then first moments, masses and drives, each from the base outward.

    Args:
        columns: of the model.   factor: R (r, p), or any matrix with the same RᵀR.
        dependent: sine of the angle to the earlier columns below which a column depends on them.
    Raises:
        IdentificationError: numbers that are not finite.
    """
    if not np.isfinite(factor).all():
        raise IdentificationError(
            "not finite", place="regressor", expected="positions and their derivatives in numbers"
        )
    size = np.linalg.norm(factor, axis=0)
    largest = size.max(initial=0.0)
    present = size > ZERO * largest if largest > 0 else np.zeros(len(size), dtype=bool)
    basis = np.zeros((len(factor), 0))
    kept, left = [], []
    order = sorted(np.flatnonzero(present), key=lambda k: PREFERRED.get((columns[k].kind, columns[k].unit), LAST))
    for k in order:
        column = factor[:, k] / size[k]
        for _ in range(2):  # once more takes away what rounding left of the first projection
            column = column - basis @ (basis.T @ column)
        length = np.linalg.norm(column)
        if length > dependent:
            basis = np.column_stack([basis, column / length])
            kept.append(k)
        else:
            left.append(k)
    independent, others = np.array(sorted(kept), dtype=int), np.array(sorted(left), dtype=int)
    regroup = np.zeros((len(independent), len(others)))
    if len(others) and len(independent):
        scaled = factor[:, independent] / size[independent]
        regroup = np.linalg.lstsq(scaled, factor[:, others], rcond=None)[0] / size[independent][:, None]
        in_scale = np.abs(regroup) * size[independent][:, None] / size[others]
        regroup[in_scale < SMALLEST * dependent] = 0.0
    return BaseParameters(columns, independent, others, np.flatnonzero(~present), regroup)

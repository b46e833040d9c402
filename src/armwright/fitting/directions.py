"""Weak directions: combinations of parameters that a log hardly tells, by the singular values of a Jacobian or regressor.

A direction v (p,) of the parameters changes the prediction by |R v|, R the triangular factor of its derivatives by these.
Of columns of length 1, a singular value near 0 belongs to parameters that cannot be distinguished; of columns in standard
deviations of the noise and in sizes of the parameters, its inverse is the standard deviation along v.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

MEANINGLESS = 1000.0  # condition number above which single parameters mean nothing
WEAK = 100.0  # condition number above which a direction is worth a word
MOST_NAMES = 4  # in a sentence
SMALL = 0.3  # of a direction's largest component: parameters below it are not named
ENOUGH = 2.0  # factor by which an experiment must raise the smallest singular value
ROUNDING = 1e-13  # of the largest singular value: less is none
EXPLAINED = 1e-8  # singular value of nuisances of length 1, below which they are no further one


@dataclass(frozen=True, eq=False)
class Direction:
    """A direction of the parameters.

    Attributes:
        vector: (p,) of length 1.   shown: |R v|, the singular value.
        condition: largest singular value by it; infinite where the data show nothing of it.
    """

    vector: np.ndarray
    shown: float
    condition: float

    def members(self, small: float = SMALL) -> list[int]:
        """Numbers of the parameters that it mixes, the largest component first, those below a share of it left out."""
        size = np.abs(self.vector) / np.abs(self.vector).max()
        order = np.argsort(-size.round(6), kind="stable")  # equal ones in their order, whatever rounding makes of them
        return [int(k) for k in order if size[k] >= small]

    def names(self, names: Sequence[str], small: float = SMALL) -> list[str]:
        """Names of the largest of them."""
        return [str(names[k]) for k in self.members(small)[:MOST_NAMES]]


def directions(factor: np.ndarray) -> list[Direction]:
    """All directions, the weakest first.

    Args:
        factor: R (r, p), or any matrix with the same RᵀR.
    """
    _, values, rows = np.linalg.svd(np.linalg.qr(factor, mode="r"))
    return _sorted(np.concatenate([values, np.zeros(len(rows) - len(values))]), rows)


def directions_of(information: np.ndarray) -> list[Direction]:
    """As `directions`, from RᵀR (p, p), which has half of the digits."""
    values, vectors = np.linalg.eigh(information)
    return _sorted(np.sqrt(np.maximum(values, 0.0)), vectors.T)


def _sorted(values: np.ndarray, rows: np.ndarray) -> list[Direction]:
    largest = values.max(initial=0.0)
    conditions = [float(largest / value) if value > ROUNDING * largest else np.inf for value in values]
    return [Direction(rows[k], float(values[k]), conditions[k]) for k in np.argsort(values, kind="stable")]


def scaled(factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R with columns of length 1, and the lengths (p,) that they had; columns of zeros stay."""
    size = np.linalg.norm(factor, axis=0)
    return factor / np.where(size > 0, size, 1.0), size


def without(columns: np.ndarray, nuisances: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Columns (m, p) less what nuisances (m, k) explain; of these columns of no more than a length are none."""
    unit, size = scaled(nuisances)
    basis, values, _ = np.linalg.svd(unit[:, size > least], full_matrices=False)
    basis = basis[:, values > EXPLAINED]
    return columns - basis @ (basis.T @ columns)


def listed(names: Sequence[str]) -> str:
    """ "a, b and c"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def in_words(direction: Direction, names: Sequence[str], remedy: str = "") -> str:
    """A sentence about a weak direction: "mass of link6 and first moment along z of link6 cannot be distinguished …".

    Args:
        direction: of columns of length 1.   names: of the parameters, in words.   remedy: what would tell, as a clause.
    """
    words, unseen = direction.names(names), direction.condition > MEANINGLESS
    if len(words) == 1:
        verb = "cannot be identified from this motion" if unseen else "is only weakly identifiable from this motion"
    else:
        verb = "cannot be distinguished with this motion" if unseen else "are distinguished only weakly by this motion"
    return f"{listed(words)} {verb} (condition {direction.condition:.3g})" + (f"; {remedy}" if remedy else "")


def gain(factor: np.ndarray, rows: np.ndarray) -> float:
    """Factor by which further rows (m, p) raise the smallest singular value of R (r, p), its columns scaled.

    Both are scaled by the columns of the two together, so that what R does not show at all counts.
    """
    both, size = scaled(np.concatenate([factor, rows]))
    size[size == 0] = 1.0
    before, after = directions(factor / size)[0], directions(both)
    return float(after[0].shown / max(before.shown, ROUNDING * after[-1].shown))

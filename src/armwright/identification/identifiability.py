"""Identifiability in words: weakly identifiable directions of the parameters, and motions that would identify them.

Of R (the triangular factor of a Jacobian or regressor) with its columns scaled to length 1, singular values near 0 belong to
combinations of parameters that change the prediction little.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

MEANINGLESS = 1000.0  # condition number above which single parameters mean nothing
WEAK = 100.0  # condition number above which a direction is worth a word
MOST_NAMES = 4  # in a sentence
SMALL = 0.3  # of a direction's largest component: parameters below it are not named
ENOUGH = 2.0  # factor by which an experiment must raise the smallest singular value


@dataclass(frozen=True)
class Direction:
    """A weakly identifiable combination of parameters.

    Attributes:
        names: of its largest parts, the largest first.   shares: theirs, of unit vectors in scaled parameters.
        condition: largest singular value by that of the direction; infinite where the data shows nothing of it.
        vector: (p,) all of it, in scaled parameters.
    """

    names: tuple[str, ...]
    shares: tuple[float, ...]
    condition: float
    vector: np.ndarray


def scaled(factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R with columns of length 1, and the lengths (p,) that they had; columns of zeros stay."""
    size = np.linalg.norm(factor, axis=0)
    return factor / np.where(size > 0, size, 1.0), size


def weak_directions(factor: np.ndarray, names: Sequence[str], limit: float = WEAK) -> list[Direction]:
    """Directions whose condition is above a limit, the weakest first.

    Args:
        factor: R (r, p), or any matrix with the same RᵀR.   names: of the p parameters.   limit: of the condition.
    """
    unit, _ = scaled(factor)
    _, values, rows = np.linalg.svd(unit)
    values = np.concatenate([values, np.zeros(len(names) - len(values))])
    found = []
    for value, vector in sorted(zip(values, rows, strict=True), key=lambda each: each[0]):
        condition = float(values[0] / value) if value > 1e-13 * values[0] else np.inf
        if condition <= limit:
            break
        order = [int(k) for k in np.argsort(-np.abs(vector)) if abs(vector[k]) >= SMALL * np.abs(vector).max()]
        order = order[:MOST_NAMES]
        shares = tuple(float(vector[k]) for k in order)
        found.append(Direction(tuple(names[k] for k in order), shares, condition, vector))
    return found


def in_words(direction: Direction, about: Mapping[str, str], remedy: str = "") -> str:
    """A sentence about a weak direction: "mass of link6 and first moment along z of link6 cannot be distinguished …".

    Args:
        direction: of `weak_directions`.   about: what each name stands for.   remedy: what would tell, as a clause.
    """
    words = [about.get(name, name) for name in direction.names]
    listed = words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
    unseen = direction.condition > MEANINGLESS
    if len(words) == 1:
        verb = "cannot be identified from this motion" if unseen else "is only weakly identifiable from this motion"
    else:
        verb = "cannot be distinguished with this motion" if unseen else "are distinguished only weakly by this motion"
    return f"{listed} {verb} (condition {direction.condition:.3g})" + (f"; {remedy}" if remedy else "")


def gain(factor: np.ndarray, rows: np.ndarray) -> float:
    """Factor by which further rows (m, p) raise the smallest singular value of R (r, p), its columns scaled.

    Both are scaled by the columns of the two together, so that what R does not show at all counts.
    """
    both = np.concatenate([factor, rows])
    size = np.linalg.norm(both, axis=0)
    size[size == 0] = 1.0
    before = np.linalg.svd(factor / size, compute_uv=False)
    after = np.linalg.svd(both / size, compute_uv=False)
    smallest = before[-1] if len(before) == factor.shape[1] else 0.0
    return float(after[-1] / max(smallest, 1e-13 * after[0]))

"""Bootstrap of blocks of a log: how far the estimates move when blocks count more or less, a check of the stated deviations.

Blocks k of the log count w_k, independent with the exponential distribution of mean 1 [Rubin1981]. Least squares of all of them,

    β(w) = β + (Σ w_k X_kᵀWX_k)⁻¹ Σ w_k X_kᵀW e_k,

spreads as it would over logs of other blocks, whatever correlates within one. [Kunsch1989]
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf

import numpy as np

from armwright.errors import IdentificationError
from armwright.identification.arm.equations import Samples, equations_of
from armwright.identification.arm.fit import ArmFit, gram, score

BLOCKS, DRAWS, FEWEST = 40, 400, 10


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Deviations of a fit's parameters by the bootstrap of blocks.

    Attributes:
        std: (b,) deviations.   ratios: (b,) of them by those stated.   blocks: how many.
    """

    std: np.ndarray
    ratios: np.ndarray
    blocks: int

    @property
    def words(self) -> str:
        """A sentence."""
        low, middle, high = np.quantile(self.ratios, [0.05, 0.5, 0.95])
        return (
            f"bootstrap of {self.blocks} blocks of the log: deviations are {middle:.2f} times those stated in the median, "
            f"{low:.2f} to {high:.2f} times nine of ten"
        )


def block_bootstrap(samples: Iterable[Samples], fit: ArmFit, seconds: float, runs: int) -> Bootstrap:
    """The bootstrap of a log.

    Args:
        samples: of the fit, in order.   fit: by "ols" or "wls".   seconds: of the log.
        runs: how many; where there are many, each is a block.
    Raises:
        IdentificationError: another method, or too few blocks.
    """
    if fit.method not in ("ols", "wls"):
        raise IdentificationError(place="checks", value="bootstrap", expected=f"method ols or wls, not {fit.method}")
    length = inf if runs >= BLOCKS else seconds / BLOCKS
    parts = equations_of(samples, fit.equations.model, part_seconds=length).parts
    if len(parts) < FEWEST:
        raise IdentificationError(
            f"{len(parts)} blocks", place="checks", value="bootstrap", expected=f"a log with {FEWEST} at least"
        )
    grams = np.array(
        [sum(w * gram(factor, fit.base) for w, factor in zip(fit.weights, part.factors, strict=True)) for part in parts]
    )
    scores, rng = np.array([score(part, fit) for part in parts]), np.random.default_rng(0)
    size = np.sqrt(np.maximum(np.einsum("kii->i", grams), np.finfo(float).tiny))
    grams, scores = grams / np.outer(size, size), scores / size
    scores -= scores.mean(axis=0)
    draws = rng.exponential(size=(DRAWS, len(parts)))
    moves = [np.linalg.solve(np.tensordot(weights, grams, axes=1), weights @ scores) / size for weights in draws]
    std = np.std(moves, axis=0) * np.sqrt(len(parts) / (len(parts) - 1.0))
    return Bootstrap(std, std / fit.std, len(parts))

"""Rows of a log reduced to triangular factors: the least-squares problem of any number of rows, in bounded memory.

Per joint and part of the log, R of the QR decomposition of [Y_j τ_j] is kept, updated block by block (TSQR):
R ← qr([R; block]). Then RᵀR = [Y τ]ᵀ[Y τ] without the loss of digits of normal equations, and weights per joint, fits to
some parts and residuals over others follow from the factors alone. [DemmelEtAl2012]
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate
from math import inf

import numpy as np

from armwright.errors import IdentificationError
from armwright.fitting.stretch import LogStretch
from armwright.fitting.triangular import triangle
from armwright.identification.arm.torque_model import TorqueModel
from armwright.identification.logs.preparation import LITTLE

CHUNK_VALUES = 2**18  # of the regressor in one block: 2 MB
FOLDS = 8  # parts of a log with few runs
MANY_RUNS = 4  # from here on each run is a part

SampleSource = Callable[[], Iterable["Samples"]]
RowWeights = Callable[[np.ndarray], np.ndarray]  # residuals (rows, n) → weights (rows, n)


@dataclass(frozen=True, eq=False)
class Samples(LogStretch):
    """Some prepared rows of a log for an arm.

    Attributes:
        run, stretch: which part of the log.   t: (rows,) [s].   q, qd, qdd: (rows, n).
        tau: (rows, n) [N m | N] measured motor torque, joint side; NaN for joints without.
        temperature: (rows, n) [°C] of the motors, NaN for joints without; None if it is not logged.
        columns, known: (rows, n, p) `rows` and (rows, n) `known_torques` of the model, filtered as the torques are; None: not yet
            computed, then those of the states.
        fitted: (rows, n) False where a torque is not fitted (`TorqueModel.known_rows`); None: all are.
        loaded: (rows, n) `loaded_friction`, a part of `known`, filtered; None where there is none.
        slow: (rows, n) share of rows near standstill in the torques' low-pass; None: not known.
    """

    stretch: int
    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    tau: np.ndarray
    temperature: np.ndarray | None = None
    columns: np.ndarray | None = None
    known: np.ndarray | None = None
    fitted: np.ndarray | None = None
    loaded: np.ndarray | None = None
    slow: np.ndarray | None = None

    def regressor(self, model: TorqueModel) -> np.ndarray:
        """Y (rows, n, p) of the model that the samples were prepared for."""
        return model.rows(self.q, self.qd, self.qdd) if self.columns is None else self.columns

    def unknown_torque(self, model: TorqueModel) -> np.ndarray:
        """Y π (rows, n) [N m | N]: measured torque without what the model knows; NaN where it is not fitted."""
        known = model.known_torques(self.q, self.qd, self.qdd) if self.known is None else self.known
        unknown = self.tau - known
        return unknown if self.fitted is None else np.where(self.fitted, unknown, np.nan)

    def in_motion(self) -> Samples:
        """The samples with torques near standstill not fitted."""
        if self.slow is None:
            return self
        moves = np.abs(self.slow) < LITTLE
        return replace(self, fitted=moves if self.fitted is None else self.fitted & moves)


@dataclass(frozen=True, eq=False)
class Factor:
    """R of [Y_j τ_j] of one joint over some rows.

    Attributes:
        columns: (k,) numbers of the model's columns in Y_j.   matrix: (k + 1, k + 1), triangular, the torque's column last.
        rows: how many.   total: Σ τ, for the torque's variance.
    """

    columns: np.ndarray
    matrix: np.ndarray
    rows: int = 0
    total: float = 0.0

    @property
    def sum_of_squares(self) -> float:
        """τᵀ τ."""
        return float(self.matrix[:, -1] @ self.matrix[:, -1])

    def over_all(self, columns: int) -> np.ndarray:
        """R (k, p + 1) of [Y τ] over all p columns of the model, 0 in those that the joint does not have."""
        block = np.zeros((len(self.matrix), columns + 1))
        block[:, self.columns], block[:, -1] = self.matrix[:, :-1], self.matrix[:, -1]
        return block

    def residual(self, parameters: np.ndarray) -> float:
        """|τ - Y π|² for parameters (p,) of the model."""
        difference = self.matrix[:, -1] - self.matrix[:, :-1] @ parameters[self.columns]
        return float(difference @ difference)

    def with_rows(self, values: np.ndarray, tau: np.ndarray, weights: np.ndarray | None = None) -> Factor:
        """The factor over more rows: values (rows, k) of its columns, tau (rows,), weights (rows,) of the squares."""
        block = np.column_stack([values, tau])
        if weights is not None:
            block *= np.sqrt(weights)[:, None]
        return Factor(self.columns, triangle(block, self.matrix), self.rows + len(tau), self.total + float(tau.sum()))

    def merged(self, other: Factor) -> Factor:
        """The factor over the rows of both."""
        return Factor(
            self.columns, triangle(other.matrix, self.matrix), self.rows + other.rows, self.total + other.total
        )


@dataclass(frozen=True, eq=False)
class LogPart:
    """Consecutive rows of a run.

    Attributes:
        run: its name.   begin, end: [s].   factors: one for each joint.   motion: Σ q̇² (n,) over the rows.
    """

    run: str
    begin: float
    end: float
    factors: tuple[Factor, ...]
    motion: np.ndarray

    def joined(self, other: LogPart) -> LogPart:
        """Both parts as one."""
        return replace(self, end=other.end, factors=joined((self, other)), motion=self.motion + other.motion)


@dataclass(frozen=True, eq=False)
class Equations:
    """The least-squares problem of a log and a torque model, as triangular factors of its parts.

    Attributes:
        model: its columns are those of the factors.   parts: in the order of the log.
        factors: one for each joint, over all parts.
    """

    model: TorqueModel
    parts: tuple[LogPart, ...]
    factors: tuple[Factor, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "factors", joined(self.parts))

    @property
    def factor(self) -> np.ndarray:
        """R (p + 1, p) of the model's columns, all joints together, each with weight 1."""
        return stacked(self.factors, len(self.model))[0][:, :-1]

    @property
    def rows(self) -> np.ndarray:
        """(n,) number of rows of each joint."""
        return np.array([factor.rows for factor in self.factors])


def part_seconds(runs: Sequence[str], seconds: float) -> float:
    """Length of a part [s] for hold-outs: whole runs if there are several, else a share of their time."""
    return inf if len(runs) >= MANY_RUNS else max(seconds / FOLDS, 1e-9)


def joined(parts: Sequence[LogPart]) -> tuple[Factor, ...]:
    """A factor for each joint, over all rows of the parts."""
    factors = list(parts[0].factors)
    for part in parts[1:]:
        factors = [mine.merged(other) for mine, other in zip(factors, part.factors, strict=True)]
    return tuple(factors)


def all_but_one(parts: Sequence[LogPart]) -> list[LogPart]:
    """For each of two parts or more all others as one."""
    before = list(accumulate(parts[:-1], LogPart.joined))
    after = list(accumulate(parts[:0:-1], LogPart.joined))[::-1]
    between = [one.joined(other) for one, other in zip(before, after[1:], strict=False)]
    return [after[0], *between, before[-1]]


def stacked(factors: Sequence[Factor], columns: int, weights: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """R (p + 1, p + 1) of all joints together,  |R [π; -1]|² = Σ_j w_j |Y_j π - τ_j|²,  and Σ_j w_j τ_jᵀ τ_j.

    Args:
        factors: one for each joint.   columns: p of the model.   weights: (n,) of the squares; None: 1.
    """
    blocks, size = [], 0.0
    for j, factor in enumerate(factors):
        weight = 1.0 if weights is None else float(weights[j])
        blocks.append(np.sqrt(weight) * factor.over_all(columns))
        size += weight * factor.sum_of_squares
    return triangle(np.concatenate(blocks)), size


def equations_of(
    samples: Iterable[Samples],
    model: TorqueModel,
    *,
    part_seconds: float | None = None,
    rows: int | None = None,
    row_weights: RowWeights | None = None,
    parameters: np.ndarray | None = None,
) -> Equations:
    """The least-squares problem of samples, which are read once, in bounded memory.

    Args:
        samples: prepared rows, in order.   model: the columns.
        part_seconds: length of a part [s]; None: the parts are the runs' stretches.   rows: of a chunk of the regressor.
        row_weights, parameters: weights of single rows from the residuals at those parameters (p,), for robust fits.
    Raises:
        IdentificationError: there are no rows.
    """
    chunk = rows or max(CHUNK_VALUES // (model.arm.n * len(model)), 1)
    parts: list[LogPart] = []
    last: tuple[str, float] | None = None
    for block in _chunks(samples, chunk):
        for key, piece in _by_part(block, part_seconds):
            if key != last:
                last = key
                begin = float(piece.t[0])
                parts.append(LogPart(piece.run, begin, begin, tuple(_empty(model)), np.zeros(model.arm.n)))
            values, tau = piece.regressor(model), piece.unknown_torque(model)
            weights = None
            if row_weights is not None and parameters is not None:
                weights = row_weights(tau - values @ parameters)
            factors = [
                _with_rows(factor, values[:, j], tau[:, j], None if weights is None else weights[:, j])
                for j, factor in enumerate(parts[-1].factors)
            ]
            motion = parts[-1].motion + (piece.qd**2).sum(axis=0)
            parts[-1] = LogPart(piece.run, parts[-1].begin, float(piece.t[-1]), tuple(factors), motion)
    if not parts:
        raise IdentificationError("no rows to fit", place="log", expected="prepared rows of a run")
    return Equations(model, tuple(parts))


def _with_rows(factor: Factor, values: np.ndarray, tau: np.ndarray, weights: np.ndarray | None) -> Factor:
    """The factor of a joint with a chunk's rows; rows without a torque are left out."""
    known = np.isfinite(tau)
    if not known.all():
        values, tau, weights = values[known], tau[known], None if weights is None else weights[known]
    return factor.with_rows(values[:, factor.columns], tau, weights) if len(tau) else factor


def _empty(model: TorqueModel) -> Iterator[Factor]:
    for used in model.of_joint:
        columns = np.flatnonzero(used)
        yield Factor(columns, np.zeros((len(columns) + 1,) * 2))


def _chunks(samples: Iterable[Samples], rows: int) -> Iterator[Samples]:
    for block in samples:
        for begin in range(0, len(block.t), rows):
            yield block.part(slice(begin, begin + rows))


def _by_part(block: Samples, seconds: float | None) -> Iterator[tuple[tuple[str, float], Samples]]:
    """Rows of a block by the part that they belong to: its run and number."""
    if seconds is None:
        yield (block.run, float(block.stretch)), block
        return
    numbers = np.floor(block.t / seconds)
    for number in np.unique(numbers):
        yield (block.run, float(number)), block.part(numbers == number)

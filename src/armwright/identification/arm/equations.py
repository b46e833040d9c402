"""Rows of a log as triangular factors: everything that least squares needs of any number of rows, in bounded memory.

Per joint and part of the log, R of the QR decomposition of [Y_j τ_j] is kept, updated block by block (TSQR):
R ← qr([R; block]). Then RᵀR = [Y τ]ᵀ[Y τ] without the loss of digits of normal equations, and weights per joint, fits to
some parts and residuals over others follow from the factors alone. [DemmelEtAl2012]
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import sosfiltfilt

from armwright.actuators.coupling import shares_of, to_joints
from armwright.errors import IdentificationError, LogError
from armwright.identification.arm.torque_model import TorqueModel
from armwright.identification.arm.triangular import triangle
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import (
    EDGE,
    SEAM,
    Preparation,
    choose_preparation,
    prepared_blocks,
    settling,
)

CHUNK_VALUES = 2**21  # of the regressor in one block: 16 MB
PARTS = 32  # of a log's runs together, at most but for one each: for hold-outs
FOLDS = 8  # parts of a run at least, where it has the rows
FEWEST = 20  # rows of a part

RowWeights = Callable[[np.ndarray], np.ndarray]  # residuals (rows, n) → weights (rows, n)


@dataclass(frozen=True, eq=False)
class Samples:
    """Some prepared rows of a log for an arm.

    Attributes:
        run, stretch: which part of the log.   t: (rows,) [s].   q, qd, qdd: (rows, n).
        tau: (rows, n) [N m | N] measured motor torque, joint side; NaN for joints without.
        dry: (rows, d) values of the model's `dry` columns, filtered as the torques are; None: not filtered.
    """

    run: str
    stretch: int
    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    tau: np.ndarray
    dry: np.ndarray | None = None

    def part(self, chosen: slice | np.ndarray) -> Samples:
        """Some of its rows."""
        dry = None if self.dry is None else self.dry[chosen]
        parts = {name: getattr(self, name)[chosen] for name in ("t", "q", "qd", "qdd", "tau")}
        return replace(self, **parts, dry=dry)


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
class Part:
    """Consecutive rows of a run.

    Attributes:
        run: its name.   begin, end: [s].   factors: one for each joint.   motion: Σ q̇² (n,) over the rows.
    """

    run: str
    begin: float
    end: float
    factors: tuple[Factor, ...]
    motion: np.ndarray


@dataclass(frozen=True, eq=False)
class Equations:
    """The least-squares problem of a log and a torque model, as triangular factors of its parts.

    Attributes:
        model: its columns are those of the factors.   parts: in the order of the log.
    """

    model: TorqueModel
    parts: tuple[Part, ...]

    @property
    def factors(self) -> tuple[Factor, ...]:
        """A factor for each joint, over all parts."""
        return joined(self.parts)

    def only(self, chosen: Sequence[int] | np.ndarray) -> Equations:
        """The problem of some parts."""
        return Equations(self.model, tuple(self.parts[k] for k in chosen))

    @property
    def rows(self) -> np.ndarray:
        """(n,) how many rows each joint has."""
        return np.array([factor.rows for factor in self.factors])


def joined(parts: Sequence[Part]) -> tuple[Factor, ...]:
    """A factor for each joint, over all rows of the parts."""
    factors = list(parts[0].factors)
    for part in parts[1:]:
        factors = [mine.merged(other) for mine, other in zip(factors, part.factors, strict=True)]
    return tuple(factors)


def stacked(factors: Sequence[Factor], columns: int, weights: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """R (p + 1, p + 1) of all joints together,  |R [π; -1]|² = Σ_j w_j |Y_j π - τ_j|²,  and Σ_j w_j τ_jᵀ τ_j.

    Args:
        factors: one for each joint.   columns: p of the model.   weights: (n,) of the squares; None: 1.
    """
    blocks, size = [], 0.0
    for j, factor in enumerate(factors):
        weight = 1.0 if weights is None else float(weights[j])
        block = np.zeros((len(factor.matrix), columns + 1))
        block[:, factor.columns] = factor.matrix[:, :-1]
        block[:, -1] = factor.matrix[:, -1]
        blocks.append(np.sqrt(weight) * block)
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
    parts: list[Part] = []
    last: tuple[str, float] | None = None
    for block in _chunks(samples, chunk):
        for key, piece in _by_part(block, part_seconds):
            if key != last:
                last = key
                begin = float(piece.t[0])
                parts.append(Part(piece.run, begin, begin, tuple(_empty(model)), np.zeros(model.arm.n)))
            values, tau = model.rows(piece.q, piece.qd, piece.qdd, piece.dry), piece.tau - model.known_torques(piece.q)
            weights = None
            if row_weights is not None and parameters is not None:
                weights = row_weights(tau - values @ parameters)
            factors = [
                _grown(factor, values[:, j], tau[:, j], None if weights is None else weights[:, j])
                for j, factor in enumerate(parts[-1].factors)
            ]
            motion = parts[-1].motion + (piece.qd**2).sum(axis=0)
            parts[-1] = Part(piece.run, parts[-1].begin, float(piece.t[-1]), tuple(factors), motion)
    if not parts:
        raise IdentificationError("no rows to fit", place="log", expected="prepared rows of a run")
    return Equations(model, tuple(parts))


def _grown(factor: Factor, values: np.ndarray, tau: np.ndarray, weights: np.ndarray | None) -> Factor:
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


def samples_of(
    log: Log,
    model: TorqueModel,
    runs: Sequence[str] | None = None,
    preparation: Preparation | Mapping[str, Preparation] | None = None,
) -> Iterator[Samples]:
    """Prepared rows of a log's runs as an arm's states and motor torques, block by block in bounded memory.

    Torques are the log's, or follow from its currents by Kt of the record, or from its voltages by eq. (12).

    Args:
        log: a checked log.   model: of the arm; its joints are in the log, by name.
        runs: names; None: those to fit.   preparation: of all runs, or of each by its name; None: chosen for each run.
    Raises:
        LogError: joints of the arm that are not in the log.
        IdentificationError: joints of the arm without positions, or neither torque, current nor voltage.
        ModelError: currents or voltages of motors without constants.
    """
    order = joints_of(log, model.arm.names)
    source = torque_source(log)
    for run in log.fit if runs is None else runs:
        chosen = preparation[run] if isinstance(preparation, Mapping) else preparation or choose_preparation(log, run)
        for stretch, t, values, dry in _with_dry(log, run, model, chosen, order):
            yield Samples(
                run, stretch, t, values["q"], values["qd"], values["qdd"], _torque(model, source, values), dry
            )


def _with_dry(
    log: Log, run: str, model: TorqueModel, chosen: Preparation, order: list[int]
) -> Iterator[tuple[int, np.ndarray, dict[str, np.ndarray], np.ndarray]]:
    """Stretch, times, signals (rows, n) and dry friction's columns (rows, d), these filtered too, then decimated.

    A torque that jumps leaves the filter as a smooth step; its column must do the same, or Coulomb friction takes what is
    inertia's. The columns are made of all rows, and rows on either side of a block are kept until the filter has settled.
    """
    seam, behind = settling(chosen.sections, SEAM), None
    for stretch, block in prepared_blocks(log, run, replace(chosen, decimate=1)):
        values = {name: _full(log, name, each)[:, order] for name, each in block.values.items()}
        if behind is not None and behind.stretch != stretch:
            yield behind.rows(model, chosen, 0)
            behind = None
        behind = _Behind(stretch, block.t, values, 0, 0) if behind is None else behind.plus(block.t, values)
        if len(behind.t) - behind.done > 2 * seam:
            yield behind.rows(model, chosen, seam)
            behind = behind.after(seam)
    if behind is not None:
        yield behind.rows(model, chosen, 0)


@dataclass(frozen=True, eq=False)
class _Behind:
    """Rows of a stretch that wait for those after them; the first `done` are only there for the filter."""

    stretch: int
    t: np.ndarray
    values: dict[str, np.ndarray]
    done: int
    first: int  # number of the first row in the stretch

    def plus(self, t: np.ndarray, values: dict[str, np.ndarray]) -> _Behind:
        """With the rows after them."""
        joined = {name: np.concatenate([each, values[name]]) for name, each in self.values.items()}
        return replace(self, t=np.concatenate([self.t, t]), values=joined)

    def rows(
        self, model: TorqueModel, chosen: Preparation, seam: int
    ) -> tuple[int, np.ndarray, dict[str, np.ndarray], np.ndarray]:
        """Every k-th of the rows but for the last `seam`."""
        dry = model.dry_values(self.values["qd"])
        if dry.size and len(dry) > 1:
            pad = min(3 * settling(chosen.sections, EDGE), len(dry) - 1)
            dry = np.asarray(sosfiltfilt(chosen.sections, dry, axis=0, padlen=pad))
        numbers = np.arange(self.done, len(self.t) - seam)
        numbers = numbers[(self.first + numbers) % chosen.decimate == 0]
        return self.stretch, self.t[numbers], {name: each[numbers] for name, each in self.values.items()}, dry[numbers]

    def after(self, seam: int) -> _Behind:
        """What is left when all rows but the last `seam` are done, with as many before them for the filter."""
        cut = max(len(self.t) - 2 * seam, 0)
        rest = {name: each[cut:] for name, each in self.values.items()}
        return _Behind(self.stretch, self.t[cut:], rest, len(self.t) - seam - cut, self.first + cut)


def joints_of(log: Log, names: Sequence[str]) -> list[int]:
    """Numbers of the log's joints in the order of an arm's, by name.

    Raises:
        LogError: the log has not all joints of the arm.   IdentificationError: it has no positions of one.
    """
    if not set(names) <= set(log.joints):
        theirs, ours = (", ".join(map(repr, each)) for each in (log.joints, names))
        what = f"the log has {len(log.joints)} ({theirs}), the arm has {len(names)} ({ours})"
        raise LogError(what, place="joints", expected="the same joints by name, in the log's joints", file=log.path)
    order = [log.joints.index(name) for name in names]
    measured = () if "q" not in log.layout else log.layout["q"].joints or ()
    for name, k in zip(names, order, strict=True):
        if k not in measured:
            raise IdentificationError(f"no positions of {name!r}", place="signals", expected="position", file=log.path)
    return order


def torque_source(log: Log) -> str:
    """The signal that motor torques come from: "tau", else "current", else "voltage".

    Raises:
        IdentificationError: the log has none of them.
    """
    for name in ("tau", "current", "voltage"):
        if name in log.layout:
            return name
    expected = "a torque, current or voltage: without one no mass can be told"
    raise IdentificationError("no torques", place="signals", expected=expected, file=log.path)


def _full(log: Log, name: str, values: np.ndarray) -> np.ndarray:
    """A signal (rows, joints of the log), NaN for joints that do not have it."""
    source = name if name in log.layout else "qd" if name == "qdd" and "qd" in log.layout else "q"
    joints = list(log.layout[source].joints or ())
    full = np.full((len(values), len(log.joints)), np.nan)
    full[:, joints] = values
    return full


def _torque(model: TorqueModel, source: str, values: dict[str, np.ndarray]) -> np.ndarray:
    """Motor torques (rows, n) referred to the joints."""
    if source == "tau":
        return values["tau"]
    arm = model.arm
    if source == "voltage":
        own = model.dyn.motor_torque(values["qd"], values["voltage"])
    else:
        lacking = [b.joint for b in arm.coordinates if b.drive.torque_constant is None]
        if lacking:
            raise IdentificationError(
                "currents of a motor without a torque constant",
                place=f"joint {lacking[0]!r} motor.torque_constant_n_m_per_a",
                expected="Kt in the robot's record, or torques in the log",
            )
        factors = [float(b.drive.gear_ratio) * float(b.drive.torque_constant or 0) for b in arm.coordinates]
        own = values["current"] * np.array(factors)
    shares = shares_of(arm)
    if not any(shares):
        return own
    return np.asarray(to_joints(shares, own.T)).astype(float).T

"""Subspace estimate of a state-space model (N4SID). [VanOverscheeDeMoor1996], algorithm 3 of chapter 4."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armwright.errors import LogError
from armwright.identification.linear.records import RecordedStretch
from armwright.identification.linear.state_space import StateSpace, states

FAR = 1e-10  # singular values below this share of the largest are rounding


@dataclass(frozen=True, eq=False)
class Projection:
    """Directions of future outputs predictable from past inputs and outputs, for all orders at once.

    Attributes:
        observability: (horizon × outputs, k) columns scaled by the roots of the singular values.   singular: (k,) them.
        horizon: rows of the past and of the future.   outputs: number.
    """

    observability: np.ndarray
    singular: np.ndarray
    horizon: int
    outputs: int


def project(stretches: Sequence[RecordedStretch], horizon: int, weighting: str, constant: bool) -> Projection:
    """Oblique projection of future outputs along future inputs on the past, weighted.

    With U_f, Y_f the block Hankel matrices of the future and W_p that of the past, the LQ factors of [U_f; W_p; Y_f] give
    Y_f Π (projected off U_f) and its part that W_p explains. Its singular value decomposition, weighted by (Y_f Π Y_fᵀ)^(-1/2)
    for "cva" or by 1 for "moesp", gives the observability matrix.

    Args:
        stretches: scaled.   horizon: rows of past and of future.   weighting: "cva" or "moesp".
        constant: True: a constant counts as a further input of the future, so that no offset passes for a slow mode.
    """
    inputs, outputs = stretches[0].u.shape[1], stretches[0].y.shape[1]
    triangle = np.zeros((0, 2 * horizon * (inputs + outputs) + constant))
    for each in stretches:  # one stretch after the other into one triangular factor: rows of different runs never mix
        if len(each.y) >= 2 * horizon:
            future, past = ([_hankel(v, begin, horizon) for v in (each.u, each.y)] for begin in (horizon, 0))
            ones = [np.ones((len(past[0]), 1))] if constant else []
            rows = np.hstack([*ones, future[0], *past, future[1]])
            triangle = np.asarray(np.linalg.qr(np.vstack([triangle, rows]), mode="r"))
    width = triangle.shape[1]
    if len(triangle) < width:
        what = f"{len(triangle)} rows of data for {width} columns"
        raise LogError(what, place="horizon", value=horizon, expected="longer runs, a lower order or a shorter horizon")
    l = triangle.T  # lower triangular: rows are signals, columns orthonormal directions of time
    f, p = horizon * inputs + constant, horizon * (inputs + outputs)
    of_past, own = l[f + p :, f : f + p], l[f + p :, f + p :]
    _check_excited(l[:f, :f])
    weight = np.eye(horizon * outputs)
    if weighting == "cva":
        values, vectors = np.linalg.eigh(of_past @ of_past.T + own @ own.T)
        values = np.maximum(values, FAR**2 * values.max())
        weight = vectors @ np.diag(values**-0.5) @ vectors.T
    left, singular, _ = np.linalg.svd(weight @ of_past, full_matrices=False)
    kept = singular > FAR * singular[0]
    columns = np.linalg.solve(weight, left[:, kept] * np.sqrt(singular[kept]))
    return Projection(columns, singular[kept], horizon, outputs)


def _check_excited(factor: np.ndarray) -> None:
    """Refuses inputs that do not excite all lags of the horizon.

    Raises:
        LogError: the input does not move enough.
    """
    sizes = np.linalg.svd(factor, compute_uv=False)
    if sizes[-1] <= FAR * sizes[0]:
        rank = int(np.sum(sizes > FAR * sizes[0]))
        what = f"excites {rank} of {len(sizes)} lags of the subspace method's horizon"
        raise LogError(what, place="input", expected="an input with more frequencies, such as a PRBS; or a lower order")


def _hankel(values: np.ndarray, begin: int, count: int) -> np.ndarray:
    """Rows (time, count × signals) with `count` successive samples each, from row `begin` on."""
    columns = len(values) - 2 * count + 1
    return np.hstack([values[begin + k : begin + k + columns] for k in range(count)])


def dynamics(projection: Projection, order: int, limit: float) -> tuple[np.ndarray, np.ndarray, bool]:
    """A (n, n) and C (outputs, n) from the observability matrix's shift; poles beyond `limit` are drawn back onto it.

    Returns:
        a, c.   moved: True where a pole was beyond.
    """
    gamma, p = projection.observability[:, :order], projection.outputs
    a = np.linalg.lstsq(gamma[:-p], gamma[p:], rcond=None)[0]
    values, vectors = np.linalg.eig(a)
    size = np.abs(values)
    if size.max(initial=0.0) > limit:
        a = np.real(vectors @ np.diag(values * np.minimum(1.0, limit / size)) @ np.linalg.inv(vectors))
        return a, gamma[:p], True
    return a, gamma[:p], False


def inputs_of(
    a: np.ndarray,
    c: np.ndarray,
    stretches: Sequence[RecordedStretch],
    period: float,
    *,
    direct: bool,
    constant: bool,
    initial: bool,
) -> tuple[StateSpace, np.ndarray]:
    """B, D and offset by least squares of the free simulation's error, given A and C; initial states of every stretch with them.

    Args:
        direct: whether D is estimated; else it is 0.   constant: the same of the offset.   initial: the same of initial states.
    Returns:
        model.   errors: (rows, outputs) of all stretches.
    """
    n, p, m = len(a), len(c), stretches[0].u.shape[1]
    blocks, targets = [], []
    for each in stretches:
        rows = len(each.y)
        columns = []
        for j in range(m):
            for i in range(n):
                x = states(a, np.eye(n)[:, i : i + 1], each.u[:, j : j + 1])
                columns.append((x @ c.T).ravel())
        if direct:
            columns += [np.kron(each.u[:, j], np.eye(p)[k]) for j in range(m) for k in range(p)]
        if constant:
            columns += [np.kron(np.ones(rows), np.eye(p)[k]) for k in range(p)]
        matrix, target = np.stack(columns, axis=1), each.y.ravel()
        if initial:
            base = np.linalg.qr(_free(a, c, rows))[0]
            matrix, target = matrix - base @ (base.T @ matrix), target - base @ (base.T @ target)
        blocks.append(matrix)
        targets.append(target)
    matrix, target = np.concatenate(blocks), np.concatenate(targets)
    scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    solution = np.linalg.lstsq(matrix / scale, target, rcond=1e-12)[0] / scale
    errors = (target - matrix @ solution).reshape(-1, p)
    b = solution[: m * n].reshape(m, n).T
    d = solution[m * n : m * n + m * p].reshape(m, p).T if direct else np.zeros((p, m))
    offset = solution[-p:] if constant else np.zeros(p)
    return StateSpace(a, b, c, d, offset, period), errors


def initial_state(model: StateSpace, each: RecordedStretch) -> np.ndarray:
    """State (n,) at a stretch's first row with which its free simulation is nearest to the outputs."""
    free = _free(model.a, model.c, len(each.y))
    return np.linalg.lstsq(free, (each.y - model.simulate(each.u)).ravel(), rcond=None)[0]


def _free(a: np.ndarray, c: np.ndarray, rows: int) -> np.ndarray:
    """Outputs (rows × outputs, n) without input from each unit state."""
    n, zero = len(a), np.zeros((rows, 1))
    return np.stack([(states(a, np.zeros((n, 1)), zero, np.eye(n)[i]) @ c.T).ravel() for i in range(n)], axis=1)

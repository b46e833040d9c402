"""Gears that give way in an arm's log, of which its record knows nothing, as mistakes of the fit (`score_tests`).

A gear that gives way by u/K, u the torque on its links, turns the motor to θ = q + u/K. With I the rotor inertia, v the viscous
friction of the motor and τ_l the links' torque, d of 1/K is

    of logged motors' positions θ:  -(∂τ_l/∂q u + ∂τ_l/∂q̇ u̇ + ∂τ_l/∂q̈ ü),    of links' positions q:  I ü + v u̇.  [Spong1987]
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

from armwright.fitting.covariance import correlated
from armwright.identification.arm.equations import Samples
from armwright.identification.arm.fit import ArmFit
from armwright.identification.arm.mistakes import ELASTIC, KINDS, LATE, Score, limit_of
from armwright.identification.arm.spring_record import SPRINGS

STEP = 1e-5  # of a position, for derivatives [rad | m], and of its scale
INVISIBLE = 1e-9  # share of a column's squares that the model leaves
WORTH = 0.2  # of a joint's squared residuals: an elasticity that explains less is not worth a word
SHARES = (0.0, 0.2, 0.4, 0.6, 0.8)  # of a joint's least inertia, that its rotor is tried to have
POSES = 50  # of a block, for that inertia
FEWEST = 4  # rows of a block that is tested for elasticity
OF_NOISE = 0.5  # of a compliance, that is not the motion's noise

Disturbed = Callable[[], Iterable[tuple[Samples, Samples]]]


def elasticities(
    fit: ArmFit, blocks: Sequence[Samples], columns: Sequence[np.ndarray], effects: Sequence[np.ndarray],
    errors: list[np.ndarray], disturbed: Disturbed,
) -> tuple[list[Score], list[np.ndarray], list[np.ndarray]]:  # fmt: skip
    """Scores of gears that give way, their columns, and the errors without them; none where another kind explains more.

    Where late torques explain more, both are tested beside these: those of a controller, which are held, seem to come early.

    Args:
        blocks: samples.   columns, effects: (rows, n, …) of them, of the fit, and of `KINDS` by joint.   errors: (rows, n).
        disturbed: gives some of the samples and the same with their motion's noise once more.
    """
    twists = [(rotors, [_twists(fit, block, rotors) for block in blocks]) for rotors in _rotors(fit, blocks)]
    late = [each[:, :, KINDS.index(LATE) :: len(KINDS)] for each in effects]
    delayed, _ = unexplained(columns, late, fit.weights)
    delays, _ = _together(delayed, errors, fit.weights)
    prompt = [e - d @ delays for d, e in zip(delayed, errors, strict=True)]
    total = np.sum([np.nansum(e * e, axis=0) for e in errors], axis=0)
    for known, rest in ((columns, errors), (joined(columns, late), prompt)):
        tests, _ = unexplained(known, effects, fit.weights)
        others = [_together([d[:, :, k :: len(KINDS)] for d in tests], rest, fit.weights)[1] for k in range(len(KINDS))]
        gears = min((_gears(known, *each, rest, fit.weights) for each in twists), key=lambda found: found.left)
        scores = _scores_of(fit, gears, rest, total, disturbed) if gears.left < min(others) else []
        if scores:
            seen = [fit.equations.model.arm.names.index(each.joint) for each in scores]
            found = [each[:, :, seen] for each in gears.twists]
            clean, _ = unexplained(columns, found, fit.weights)
            return scores, found, [e - d @ gears.size[seen] for d, e in zip(clean, errors, strict=True)]
    return [], [], errors


def unexplained(
    columns: Sequence[np.ndarray], effects: Sequence[np.ndarray], weights: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray]:
    """Blocks d̃ (rows, n, k) of effects d, the part that the columns (rows, n, b) leave, and their weighted squares (k,).

    Those that the columns explain wholly are 0.
    """
    root = np.sqrt(weights)[:, None]
    X, D = (
        np.concatenate([(root * each).reshape(-1, each.shape[2]) for each in every]) for every in (columns, effects)
    )
    Q, _ = np.linalg.qr(X)
    taken = Q.T @ D
    sizes = (D * D).sum(axis=0)
    left = sizes - (taken * taken).sum(axis=0)
    left = np.where(left > INVISIBLE * np.maximum(sizes, np.finfo(float).tiny), left, 0.0)
    rest = np.where(left > 0.0, D - Q @ taken, 0.0)
    parts = np.split(rest, np.cumsum([each.shape[0] * each.shape[1] for each in effects])[:-1])
    size = np.where(root > 0.0, root, 1.0)  # of joints without torque
    return [each.reshape(d.shape) / size for each, d in zip(parts, effects, strict=True)], left


def joined(columns: Sequence[np.ndarray], others: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Blocks (rows, n, a + b) of columns (rows, n, a) and others (rows, n, b)."""
    return [np.concatenate(each, axis=2) for each in zip(columns, others, strict=True)]


def _together(
    clean: Sequence[np.ndarray], errors: Sequence[np.ndarray], weights: np.ndarray, above: bool = False
) -> tuple[np.ndarray, float]:
    """Sizes (k,) of effects d̃ (rows, n, k) together, all 0 or `above` if wished, and the weighted squares that they leave."""
    root = np.sqrt(weights)[:, None]
    matrix = np.concatenate([(root * d).reshape(-1, d.shape[2]) for d in clean])
    target = np.concatenate([(root[:, 0] * np.nan_to_num(e)).ravel() for e in errors])
    length = np.linalg.norm(matrix, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    matrix = matrix / length
    size = nnls(matrix, target)[0] if above else np.linalg.lstsq(matrix, target, rcond=1e-10)[0]
    return size / length, float(np.sum((target - matrix @ size) ** 2))


@dataclass(frozen=True, eq=False)
class _Gears:
    """Elasticity of all joints: kind, sizes (n,), blocks (rows, n, n) of its columns and of d̃, and the squares that it leaves."""

    kind: str
    size: np.ndarray
    rotors: np.ndarray
    twists: list[np.ndarray]
    clean: list[np.ndarray]
    left: float


def _gears(
    columns: Sequence[np.ndarray], rotors: np.ndarray, both: Sequence[np.ndarray], errors: Sequence[np.ndarray],
    weights: np.ndarray,
) -> _Gears:  # fmt: skip
    """The kind of elasticity that explains more, of blocks (rows, n, 2 n) of `both`."""
    found = []
    for side, kind in enumerate(ELASTIC):
        twists = [
            np.where(np.isfinite(e)[:, :, None], d[:, :, side :: len(ELASTIC)], 0.0)
            for d, e in zip(both, errors, strict=True)
        ]
        clean, _ = unexplained(columns, twists, weights)
        size, left = _together(clean, errors, weights, above=True)  # no gear pushes back
        found.append(_Gears(kind, size, rotors, twists, clean, left))
    return min(found, key=lambda each: each.left)


def _scores_of(
    fit: ArmFit, gears: _Gears, errors: Sequence[np.ndarray], total: np.ndarray, disturbed: Disturbed
) -> list[Score]:
    """Scores of the joints that give way by more than chance and explain enough of their squared residuals (n,), `total`."""
    scores, limit, noise, of_noise = [], limit_of(len(total) * (len(KINDS) + 1)), None, 0.0
    left = [e - d @ gears.size for d, e in zip(gears.clean, errors, strict=True)]
    gone = np.sum([np.nansum(a * a - b * b, axis=0) for a, b in zip(errors, left, strict=True)], axis=0)
    for j, joint in enumerate(fit.equations.model.arm.coordinates):
        size, explains = float(gears.size[j]), float(gone[j] / max(total[j], np.finfo(float).tiny))
        if size == 0.0 or explains < WORTH:
            continue
        blocks = [(d[:, :, [j]], e) for d, e in zip(gears.clean, left, strict=True)]
        squares = sum(float(fit.weights @ (d * d).sum(axis=(0, 2))) for d, _ in blocks)
        bread = np.array([[1.0 / squares]])
        std = float(np.sqrt(correlated(lambda blocks=blocks: blocks, fit.weights, bread).covariance[0, 0]))
        if size > limit * std:
            noise = _by_noise(fit, gears, disturbed) if noise is None else noise
            of_noise = float(noise[j]) * sum(len(d) for d, _ in blocks) / squares
        if size > limit * std and size - of_noise > max(limit * std, OF_NOISE * size):
            units = joint.kind.units
            unit = f"{units.position}/({units.torque})" if gears.kind == ELASTIC[0] else "s²"
            scores.append(Score(joint.joint, unit, gears.kind, size, std, size / std, explains))
    return scores


def _by_noise(fit: ArmFit, gears: _Gears, disturbed: Disturbed) -> np.ndarray:
    """E[Σ w d e] (n,) of a row by noise of the motion, which is in the errors, and by its fourth derivative in ü."""
    model, n, sums, rows = fit.equations.model, len(gears.size), np.zeros(len(gears.size)), 0
    for before, after in disturbed():
        errors = (before.regressor(model) - after.regressor(model)) @ fit.parameters
        twists = _twists(fit, after, gears.rotors) - _twists(fit, before, gears.rotors)
        own = twists.reshape(len(errors), n, n, len(ELASTIC))[..., ELASTIC.index(gears.kind)]
        sums, rows = sums + np.einsum("i,ti,tij->j", fit.weights, errors, own), rows + len(errors)
    return sums / max(rows, 1)


def _rotors(fit: ArmFit, samples: Sequence[Samples]) -> Iterator[np.ndarray]:
    """Rotor inertias (n,) to try [kg m² | kg]: as fitted; the record's, or shares, where the links' inertia has it within."""
    model, base = fit.equations.model, fit.base
    rotors, within = np.zeros(model.arm.n), np.zeros(model.arm.n, dtype=bool)
    q = np.concatenate([each.q[:: max(len(each.t) // POSES, 1)] for each in samples])
    rest = np.zeros_like(q)
    for j, joint in enumerate(model.arm.names):
        own = [k for k, column in enumerate(model.columns) if column.kind == "rotor" and column.joint == joint]
        if any(k in base.independent for k in own) or not own:
            rotors[j] = fit.parameters[own].sum()
            continue
        if np.isfinite(model.prior[own]).all():
            rotors[j] = model.prior[own].sum()
            continue
        unit = rest + np.eye(model.arm.n)[j]
        inertia = (model.rows(q, rest, unit) - model.rows(q, rest, rest))[:, j] @ fit.parameters
        rotors[j], within[j] = max(float(inertia.min()), 0.0), True
    for share in SHARES if within.any() else (1.0,):
        yield np.where(within, share * rotors, rotors)


def _twists(fit: ArmFit, block: Samples, rotors: np.ndarray) -> np.ndarray:
    """Columns d (rows, n, 2 n) of each joint's elasticity, in the order of `ELASTIC`; that of links' positions by I/K.

    Args:
        rotors: (n,) I [kg m² | kg].
    """
    model, parameters, names = fit.equations.model, fit.parameters, fit.equations.model.arm.names
    n, motion = model.arm.n, (block.q, block.qd, block.qdd)
    found = np.zeros((len(block.t), n, n, len(ELASTIC)))
    if len(block.t) < FEWEST:
        return found.reshape(len(block.t), n, -1)
    links = [k for k, column in enumerate(model.columns) if column.kind in ("inertial", *SPRINGS)]
    fitted, viscous = np.zeros(n), np.zeros(n)
    for k, column in enumerate(model.columns):
        if column.kind in ("rotor", "viscous"):
            (fitted if column.kind == "rotor" else viscous)[names.index(column.joint)] += parameters[k]

    def taken(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        own = model.rows(q, qd, qdd)[:, :, links] @ parameters[links] + model.known_torques(q, qd, qdd)
        return own - (rotors - fitted) * qdd  # what is a rotor's of the links' inertia

    u = taken(*motion)
    curve = CubicSpline(block.t, u)  # rows are few behind the low-pass: differences of neighbours would be too small
    twist = u, curve(block.t, 1), curve(block.t, 2)
    for j in range(n):
        moved = [each.copy() for each in motion]
        for each, by in zip(moved, twist, strict=True):
            each[:, j] -= STEP * by[:, j]
        found[:, :, j, 0] = (taken(*moved) - u) / STEP
        rubbed = viscous[j] / rotors[j] if rotors[j] > 0.0 and viscous[j] > 0.0 else 0.0
        found[:, j, j, 1] = twist[2][:, j] + rubbed * twist[1][:, j]
    return found.reshape(len(block.t), n, -1)

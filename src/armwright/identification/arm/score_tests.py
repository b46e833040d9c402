"""Tests for mistakes of single columns of a log, joint by joint, on the residuals that a fit leaves.

A mistake of size a that is not in the model adds a d to the torques Y π. With d̃ the part of d that Y does not explain,

    a = Σ d̃ᵀWe / Σ d̃ᵀWd̃,   var a = var(Σ d̃ᵀWe) / (Σ d̃ᵀWd̃)²

with the scores' correlation in time (`fitting.covariance`). [BreuschPagan1980]  A mistake that may be there is taken out of the
residuals before its deviation is estimated, which it would make larger. What Y explains wholly is invisible: the log says nothing
about it, and its deviation is infinite.

Elasticity shakes whatever else is tested: where it explains more of the log than mistakes of any other kind do, of all joints
together, the others are tested beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import product

import numpy as np

from armwright.actuators.coupling import motor_shares
from armwright.actuators.friction import by_loads
from armwright.actuators.gear import loses_power
from armwright.fitting.covariance import correlated
from armwright.identification.arm.elastic_gears import STEP, Disturbed, elasticities, joined, unexplained
from armwright.identification.arm.equations import Samples
from armwright.identification.arm.fit import ArmFit
from armwright.identification.arm.gear_loss import LossyModel
from armwright.identification.arm.mistakes import GEAR, KINDS, LOAD, MISTAKES, Score
from armwright.identification.arm.spring_record import SPRINGS
from armwright.identification.arm.torque_model import TorqueModel

ROWS = 1000  # that the tests are made on, nearly
LIKELY = 2.0  # deviations from which a mistake is taken out
FRICTION = ("viscous", "coulomb", "coulomb+", "coulomb-", "stribeck")
KNOWN = 10.0  # deviations of the links' torque, in root mean square, from which it tells what grows with it

Torques = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def score_tests(fit: ArmFit, samples: Iterable[Samples], disturbed: Disturbed) -> list[Score]:
    """All mistakes of all joints, each tested alone, beside the elasticity of gears where the log shows it.

    Args:
        fit: of the samples.   samples: prepared rows, in order.
        disturbed: gives some of them and the same with their motion's noise once more.
    """
    model, base = fit.equations.model, fit.base
    blocks, count = [], 0
    for block in samples:
        blocks.append(block.part(slice(0, ROWS - count)))
        count += len(blocks[-1].t)
        if count >= ROWS:
            break
    times = np.concatenate([block.t for block in blocks])
    middle, span = float(times.mean()), max(float(np.ptp(times)), np.finfo(float).tiny)
    torque, moved = (
        np.nan_to_num(np.concatenate(each)).std(axis=0) for each in zip(*((b.tau, b.q) for b in blocks), strict=True)
    )
    # of springs with the torques' spread
    stiffness = np.divide(torque, moved, out=np.zeros_like(moved), where=moved > 0.0)
    columns, effects, errors = [], [], []
    for block in blocks:
        Y = block.regressor(model)[:, :, base.independent]
        e = block.unknown_torque(model) - Y @ fit.values
        known = np.isfinite(e)[:, :, None]
        columns.append(np.where(known, Y, 0.0))
        effects.append(np.where(known, _effects(model, fit.parameters, block, (middle, span), stiffness), 0.0))
        errors.append(e)
    if count < 2 * len(base):
        return []
    scores, own, errors = elasticities(fit, blocks, columns, effects, errors, disturbed)
    if scores:
        columns = joined(columns, own)
    tests = unexplained(columns, effects, fit.weights)
    size, std, left = _alone(tests, errors, fit.weights)
    squares = fit.weights * np.sum([np.nansum(e * e, axis=0) for e in errors], axis=0)
    geared = _gears_to_test(fit, columns)
    for k, (joint, mistake) in enumerate(product(model.arm.coordinates, KINDS)):
        if (mistake != LOAD or by_loads(joint)) and (mistake != GEAR or joint.joint in geared):
            z = float(size[k] / std[k]) if std[k] > 0.0 else 0.0
            share = float(size[k] ** 2 * left[k] / max(squares[k // len(KINDS)], np.finfo(float).tiny))
            unit = joint.kind.units.position
            scores.append(Score(joint.joint, unit, mistake, float(size[k]), float(std[k]), z, share))
    return scores


def _alone(
    tests: tuple[list[np.ndarray], np.ndarray], errors: Sequence[np.ndarray], weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sizes (k,) of the mistakes of KINDS by joint, their deviations, and squares that they leave."""
    clean, left = tests
    visible = left > 0.0
    clean = [each[:, :, visible] for each in clean]
    bread = np.diag(1.0 / left[visible])
    found = correlated(lambda: zip(clean, errors, strict=True), weights, bread, alone=True)
    slopes = sum(
        np.einsum("tjk,tj->k", d * weights[:, None], np.nan_to_num(e)) for d, e in zip(clean, errors, strict=True)
    )
    size, std = np.zeros(len(visible)), np.full(len(visible), np.inf)
    size[visible], std[visible] = slopes / left[visible], np.sqrt(np.diag(found.covariance))
    least = np.array([MISTAKES[each].least for each in KINDS] * len(weights))
    for at, k in enumerate(np.flatnonzero(visible)):
        if abs(size[k]) > max(LIKELY * std[k], least[k]):
            own = [(d[:, :, [at]], e - size[k] * d[:, :, at]) for d, e in zip(clean, errors, strict=True)]
            alone = correlated(lambda own=own: own, weights, bread[[at]][:, [at]])
            std[k] = float(np.sqrt(alone.covariance[0, 0]))
    return size, std, left


def _gears_to_test(fit: ArmFit, columns: Iterable[np.ndarray]) -> list[str]:
    """Joints without friction that loads add to, whose links take a torque that is known well enough to be a load.

    Args:
        columns: blocks (rows, n, b) of the fit's columns.
    """
    model, base = fit.equations.model, fit.base
    links = [b for b, k in enumerate(base.independent) if base.columns[k].kind in ("inertial", *SPRINGS)]
    Y = np.concatenate([each[:, :, links] for each in columns])
    taken = Y @ fit.values[links]
    variance = np.einsum("tjk,kl,tjl->j", Y, fit.covariance[np.ix_(links, links)], Y)
    known = (taken**2).sum(axis=0) > KNOWN**2 * variance
    return [
        joint.joint
        for i, joint in enumerate(model.arm.coordinates)
        if known[i]
        and not (by_loads(joint) or loses_power(joint) or (isinstance(model, LossyModel) and model.lossy[i]))
    ]


def _levels(model: TorqueModel, joint: int) -> list[int]:
    """Numbers of the columns of Coulomb friction, 1 or -1 in motion, of a joint's motor; of its joint where it has one alone."""
    own = [
        k for k, column in enumerate(model.columns)
        if column.kind in ("coulomb", "coulomb+", "coulomb-") and column.joint == model.arm.names[joint]
    ]  # fmt: skip
    return [k for k in own if len(model.columns[k].turned) > 1] or own


def _effects(
    model: TorqueModel, parameters: np.ndarray, block: Samples, times: tuple[float, float], stiffness: np.ndarray
) -> np.ndarray:
    """Columns d (rows, n, 8 n) of the mistakes of each joint, in the order of `KINDS`.

    Args:
        times: middle and span of the log [s].   stiffness: (n,) of the springs that are tried [N m/rad | N/m].
    """
    n = model.arm.n
    motion = block.q, block.qd, block.qdd

    def torques(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        return model.rows(q, qd, qdd) @ parameters + model.known_torques(q, qd, qdd)

    columns, of_motors = block.regressor(model), np.linalg.inv(motor_shares(model.arm))
    rub = [k for k, column in enumerate(model.columns) if column.kind in FRICTION]
    friction = columns[:, :, rub] @ parameters[rub]
    links = [k for k, column in enumerate(model.columns) if column.kind in ("inertial", *SPRINGS)]
    taken = (model.rows(*motion)[:, :, links] @ parameters[links] + model.known_torques(*motion)) @ of_motors
    own = torques(*motion)  # as predicted: measured ones have the residuals themselves in them
    late = -np.gradient(own, block.t, axis=0) if len(block.t) > 2 else np.zeros_like(own)
    later = (block.t - times[0]) / times[1]
    found = np.zeros((len(block.t), n, n, len(KINDS)))
    for j in range(n):
        found[:, j, j, 0], found[:, j, j, 1], found[:, j, j, 2] = own[:, j], late[:, j], later * friction[:, j]
        found[:, j, j, 5] = stiffness[j] * block.q[:, j]
        if block.loaded is not None:
            found[:, j, j, 6] = block.loaded[:, j]
        found[:, :, j, 7] = columns[:, :, _levels(model, j)].sum(axis=2) * np.abs(taken[:, j, None])
        for place, moves in ((3, [np.ones(len(block.t)), 0.0, 0.0]), (4, [each[:, j] for each in motion])):
            moved = [each.copy() for each in motion]
            for each, by in zip(moved, moves, strict=True):
                each[:, j] += STEP * by
            found[:, :, j, place] = (torques(*moved) - own) / STEP
    return found.reshape(len(block.t), n, -1)

"""Tests for mistakes of single columns of a log, joint by joint, on the residuals that a fit leaves.

A mistake of size a that is not in the model adds a d to the torques Y π. With d̃ the part of d that Y does not explain,

    a = Σ d̃ᵀWe / Σ d̃ᵀWd̃,   var a = var(Σ d̃ᵀWe) / (Σ d̃ᵀWd̃)²

with the scores' correlation in time (`fitting.covariance`). [BreuschPagan1980]  A mistake that may be there is taken out of the
residuals before its deviation is estimated, which it would make larger. What Y explains wholly is invisible: the log says nothing
about it, and its deviation is infinite.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import stats

from armwright.actuators.coupling import motor_shares
from armwright.actuators.friction import by_loads
from armwright.actuators.gear import loses_power
from armwright.fitting.covariance import correlated
from armwright.identification.arm.equations import Samples
from armwright.identification.arm.fit import ArmFit
from armwright.identification.arm.gear_loss import LossyModel
from armwright.identification.arm.spring_record import SPRINGS
from armwright.identification.arm.torque_model import TorqueModel

ROWS = 1000  # that the tests are made on, nearly
FALSE_ALARMS = 0.01  # share of clean logs
STEP = 1e-5  # of a position, for derivatives [rad | m], and of its scale
LIKELY = 2.0  # deviations from which a mistake is taken out
INVISIBLE = 1e-9  # share of a column's squares that the model leaves
FRICTION = ("viscous", "coulomb", "coulomb+", "coulomb-", "stribeck")
LOAD, SPRING, GEAR = "load", "spring", "gear"
MOST = {"load": 0.0, "spring": 0.75, "gear": 0.5}  # of a joint's squared residuals: one that explains more is missing
KNOWN = 10.0  # deviations of the links' torque, in root mean square, from which it tells what grows with it
BESIDE = 0.7  # of the largest |z|: mistakes with less follow from that one

Torques = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Mistake:
    """A kind of mistake: in words with its size, the least size that counts, and its unit."""

    words: str
    least: float


MISTAKES = {
    "torque scale": Mistake(
        "its torques are {size:+.0%} off in scale: is the torque constant, or the unit, right?", 0.05
    ),
    "lateness": Mistake("its torques come {size:.3g} s after its motion", 2e-3),
    "friction": Mistake("its friction changes by {size:+.0%} over the log", 0.1),
    "position zero": Mistake("the zero of its position is {size:+.3g} {unit} off", 0.02),
    "position scale": Mistake("its positions are {size:+.1%} off in scale: are counts and gear ratio right?", 0.02),
    "spring": Mistake(
        "its torques change with its position by {size:+.0%} of their spread, as with a spring that the record lacks or "
        "has otherwise, and masses make up for it: --springs fits one",
        0.02,
    ),
    "load": Mistake("what loads add to its friction is {size:+.0%} off the record's, and masses make up for it", 0.005),
    "gear": Mistake(
        "its friction grows by {size:.1%} of the torque that its links take, as of a gear with loss that the record lacks, and "
        "Coulomb friction makes up for it: --fit-efficiency fits one",
        0.005,
    ),
}


@dataclass(frozen=True)
class Score:
    """A mistake of a joint: size a, its deviation, and a by it; infinite deviation: the log says nothing about it.

    Attributes:
        unit: of the joint's position.   explains: share of the joint's squared residuals that goes with the mistake.
    """

    joint: str
    unit: str
    mistake: str
    size: float
    std: float
    z: float
    explains: float


def score_tests(fit: ArmFit, samples: Iterable[Samples]) -> list[Score]:
    """All mistakes of all joints, each tested alone.

    Args:
        fit: of the samples.   samples: prepared rows, in order.
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
    root = np.sqrt(fit.weights)[:, None]
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
    X, D = (
        np.concatenate([(root * each).reshape(-1, each.shape[2]) for each in every]) for every in (columns, effects)
    )
    Q, _ = np.linalg.qr(X)
    taken = Q.T @ D
    sizes = (D * D).sum(axis=0)
    left = sizes - (taken * taken).sum(axis=0)
    visible = left > INVISIBLE * np.maximum(sizes, np.finfo(float).tiny)
    rest = D - Q @ taken
    parts = np.split(rest, np.cumsum([each.shape[0] * each.shape[1] for each in errors])[:-1])
    size = np.where(root > 0.0, root, 1.0)  # of joints without torque
    clean = [each.reshape(*e.shape, -1)[:, :, visible] / size for each, e in zip(parts, errors, strict=True)]
    bread = np.diag(1.0 / left[visible])
    found = correlated(lambda: zip(clean, errors, strict=True), fit.weights, bread, alone=True)
    slopes = sum(
        np.einsum("tjk,tj->k", d * fit.weights[:, None], np.nan_to_num(e)) for d, e in zip(clean, errors, strict=True)
    )
    size, std = np.zeros(len(visible)), np.full(len(visible), np.inf)
    squares = fit.weights * np.sum([np.nansum(e * e, axis=0) for e in errors], axis=0)
    size[visible], std[visible] = slopes / left[visible], np.sqrt(np.diag(found.covariance))
    least = np.array([each.least for each in MISTAKES.values()] * model.arm.n)
    for at, k in enumerate(np.flatnonzero(visible)):
        if abs(size[k]) > max(LIKELY * std[k], least[k]):
            own = [(d[:, :, [at]], e - size[k] * d[:, :, at]) for d, e in zip(clean, errors, strict=True)]
            alone = correlated(lambda own=own: own, fit.weights, bread[[at]][:, [at]])
            std[k] = float(np.sqrt(alone.covariance[0, 0]))
    geared, scores = _gears_to_test(fit, columns), []
    for k, (joint, mistake) in enumerate(product(model.arm.coordinates, MISTAKES)):
        if (mistake != LOAD or by_loads(joint)) and (mistake != GEAR or joint.joint in geared):
            z = float(size[k] / std[k]) if std[k] > 0.0 else 0.0
            share = float(size[k] ** 2 * left[k] / max(squares[k // len(MISTAKES)], np.finfo(float).tiny))
            unit = joint.kind.units.position
            scores.append(Score(joint.joint, unit, mistake, float(size[k]), float(std[k]), z, share))
    return scores


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


def _seen(scores: list[Score]) -> list[Score]:
    """Mistakes that are there, on one in a hundred clean logs."""
    limit = float(stats.norm.isf(FALSE_ALARMS / max(2 * len(scores), 1)))
    return [
        each
        for each in scores
        if abs(each.z) > limit
        and abs(each.size) > MISTAKES[each.mistake].least
        and (
            each.mistake not in (SPRING, GEAR) or each.size > 0.0
        )  # no spring pushes from its rest, no gear gives power
    ]


def made_up_for(scores: list[Score]) -> list[str]:
    """Sentences about mistakes of the record that masses make up for.

    Friction that grows otherwise with the load than the record says, whose numbers the fit takes; a spring or a gear's loss with
    which most of a joint's residual would be gone.
    """
    return [_words(each) for each in _seen(scores) if _is_made_up_for(each)]


def _is_made_up_for(score: Score) -> bool:
    return score.explains > MOST.get(score.mistake, np.inf)


def _words(score: Score) -> str:
    words = MISTAKES[score.mistake].words.format(size=score.size, unit=score.unit)
    return f"{score.joint}: {words} ({abs(score.z):.0f} deviations)"


def suspicions(scores: list[Score], all_late: bool = False) -> Iterator[str]:
    """Sentences about mistakes that are there, but for those of `made_up_for`.

    Args:
        scores: of all joints.   all_late: the lateness of all joints together is said already.
    """
    seen = [each for each in _seen(scores) if not _is_made_up_for(each)]
    first = max(seen, key=lambda each: abs(each.z), default=None)
    for each in seen:
        assert first is not None
        follows = (
            abs(each.z) < BESIDE * abs(first.z) and not each.mistake == first.mistake == GEAR
        )  # each gear has its own loss
        if not follows and not (all_late and each.mistake == "lateness"):
            yield _words(each)


def _effects(
    model: TorqueModel, parameters: np.ndarray, block: Samples, times: tuple[float, float], stiffness: np.ndarray
) -> np.ndarray:
    """Columns d (rows, n, 8 n) of the mistakes of each joint, in the order of `MISTAKES`.

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
    found = np.zeros((len(block.t), n, n, len(MISTAKES)))
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

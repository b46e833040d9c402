"""Tests for mistakes of single columns of a log, joint by joint, on the residuals that a fit leaves.

A mistake of size a that is not in the model adds a d to the torques Y π. With d̃ the part of d that Y does not explain,

    a = Σ d̃ᵀWe / Σ d̃ᵀWd̃,   var a = var(Σ d̃ᵀWe) / (Σ d̃ᵀWd̃)²

with the scores' correlation in time (`fitting.covariance`). [BreuschPagan1980]  A mistake that may be there is taken out of the
residuals before its deviation is estimated, which it would make larger. What Y explains wholly is invisible: the log says nothing
about it, and its deviation is infinite.

A gear that gives way by u/K, u the torque on its links, turns the motor to θ = q + u/K. With I the rotor inertia, v the viscous
friction of the motor and τ_l the links' torque, d of 1/K is

    of logged motors' positions θ:  -(∂τ_l/∂q u + ∂τ_l/∂q̇ u̇ + ∂τ_l/∂q̈ ü),    of links' positions q:  I ü + v u̇.  [Spong1987]

Elasticity shakes whatever else is tested: where it explains more of the log than mistakes of any other kind do, of all joints
together, the others are tested beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import stats
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

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
LOAD, SPRING, GEAR, ZERO, LATE = "load", "spring", "gear", "position zero", "lateness"
ELASTIC = ("elasticity", "elasticity of links")  # by the side of the logged positions
# of a joint's squared residuals: one that explains more is missing
MOST = {"load": 0.0, "spring": 0.75, "gear": 0.5, **dict.fromkeys(ELASTIC, 0.5)}
KNOWN = 10.0  # deviations of the links' torque, in root mean square, from which it tells what grows with it
HALF_TURN = np.pi  # [rad]: no zero is farther off
WORTH = 0.2  # of a joint's squared residuals: an elasticity that explains less is not worth a word
SHARES = (0.0, 0.2, 0.4, 0.6, 0.8)  # of a joint's least inertia, that its rotor is tried to have
POSES = 50  # of a block, for that inertia
FEWEST = 4  # rows of a block that is tested for elasticity
OF_NOISE = 0.5  # of a compliance, that is not the motion's noise
BESIDE = 0.7  # of the largest |z|: mistakes with less follow from that one

Disturbed = Callable[[], Iterable[tuple[Samples, Samples]]]
Torques = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Mistake:
    """A kind of mistake: in words with its size, the least size that counts, and its unit."""

    words: str
    least: float


REMEDY = "the fit takes it for rigid; state `elasticity` in its record, and fit slower motion"
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
    ELASTIC[0]: Mistake(
        "its gear gives way by {size:.2g} {unit} under the torque of its links, as its motor's positions show, and masses make "
        "up for it: " + REMEDY,
        0.0,
    ),
    ELASTIC[1]: Mistake(
        "its torque is that of a rotor behind a gear that gives way (inertia by stiffness: {size:.2g} {unit}), as its links' "
        "positions show, and masses make up for it: " + REMEDY,
        0.0,
    ),
}
KINDS = [each for each in MISTAKES if each not in ELASTIC]


@dataclass(frozen=True)
class Score:
    """A mistake of a joint: size a, its deviation, and a by it; infinite deviation: the log says nothing about it.

    Attributes:
        unit: of the joint's position; of elasticity that of the size.
        explains: share of the joint's squared residuals that goes with the mistake.
    """

    joint: str
    unit: str
    mistake: str
    size: float
    std: float
    z: float
    explains: float


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
    twists = [(rotors, [_twists(fit, block, rotors) for block in blocks]) for rotors in _rotors(fit, blocks)]
    scores, own, errors = _elasticities(fit, columns, effects, twists, errors, disturbed)
    if scores:
        columns = _joined(columns, own)
    tests = _unexplained(columns, effects, fit.weights)
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


def _unexplained(
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


def _joined(columns: Sequence[np.ndarray], others: Sequence[np.ndarray]) -> list[np.ndarray]:
    return [np.concatenate(each, axis=2) for each in zip(columns, others, strict=True)]


def _elasticities(
    fit: ArmFit, columns: Sequence[np.ndarray], effects: Sequence[np.ndarray],
    twists: Sequence[tuple[np.ndarray, list[np.ndarray]]], errors: list[np.ndarray], disturbed: Disturbed,
) -> tuple[list[Score], list[np.ndarray], list[np.ndarray]]:  # fmt: skip
    """Scores of gears that give way, their columns, and the errors without them; none where another kind explains more.

    Where late torques explain more, both are tested beside these: those of a controller, which are held, seem to come early.

    Args:
        columns, effects: blocks (rows, n, …) of the fit, and of `KINDS` by joint.
        twists: of `ELASTIC` by joint, for some rotor inertias.   disturbed: as of `score_tests`.
    """
    late = [each[:, :, KINDS.index(LATE) :: len(KINDS)] for each in effects]
    delayed, _ = _unexplained(columns, late, fit.weights)
    delays, _ = _together(delayed, errors, fit.weights)
    prompt = [e - d @ delays for d, e in zip(delayed, errors, strict=True)]
    total = np.sum([np.nansum(e * e, axis=0) for e in errors], axis=0)
    for known, rest in ((columns, errors), (_joined(columns, late), prompt)):
        tests, _ = _unexplained(known, effects, fit.weights)
        others = [_together([d[:, :, k :: len(KINDS)] for d in tests], rest, fit.weights)[1] for k in range(len(KINDS))]
        gears = min((_gears(known, *each, rest, fit.weights) for each in twists), key=lambda found: found.left)
        scores = _scores_of(fit, gears, rest, total, disturbed) if gears.left < min(others) else []
        if scores:
            seen = [fit.equations.model.arm.names.index(each.joint) for each in scores]
            found = [each[:, :, seen] for each in gears.twists]
            clean, _ = _unexplained(columns, found, fit.weights)
            return scores, found, [e - d @ gears.size[seen] for d, e in zip(clean, errors, strict=True)]
    return [], [], errors


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
        clean, _ = _unexplained(columns, twists, weights)
        size, left = _together(clean, errors, weights, above=True)  # no gear pushes back
        found.append(_Gears(kind, size, rotors, twists, clean, left))
    return min(found, key=lambda each: each.left)


def _scores_of(
    fit: ArmFit, gears: _Gears, errors: Sequence[np.ndarray], total: np.ndarray, disturbed: Disturbed
) -> list[Score]:
    """Scores of the joints that give way by more than chance and explain enough of their squared residuals (n,), `total`."""
    scores, limit, noise, of_noise = [], _limit(len(total) * (len(KINDS) + 1)), None, 0.0
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


def _limit(count: int) -> float:
    """Deviations that the largest of so many scores leaves in one of a hundred clean logs."""
    return float(stats.norm.isf(FALSE_ALARMS / max(2 * count, 1)))


def _seen(scores: list[Score]) -> list[Score]:
    """Mistakes that are there, on one in a hundred clean logs."""
    limit = _limit(len(scores))
    return [
        each
        for each in scores
        if each.mistake in ELASTIC
        or (
            abs(each.z) > limit
            and abs(each.size) > MISTAKES[each.mistake].least
            # no spring pushes from its rest, no gear gives power
            and (each.mistake not in (SPRING, GEAR) or each.size > 0.0)
            and not (each.mistake == ZERO and each.unit == "rad" and abs(each.size) > HALF_TURN)
        )
    ]


def gives_way(scores: list[Score]) -> bool:
    """Whether the log shows gears that give way, which seem to shift torques in time."""
    return any(each.mistake in ELASTIC for each in scores)


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
    first = max(seen, key=lambda each: abs(each.z) * (each.mistake not in ELASTIC), default=None)
    for each in seen:
        assert first is not None
        follows = (
            abs(each.z) < BESIDE * abs(first.z)
            and not each.mistake == first.mistake == GEAR  # each gear has its own loss
            and each.mistake not in ELASTIC
        )
        if not follows and not (all_late and each.mistake == "lateness"):
            yield _words(each)


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

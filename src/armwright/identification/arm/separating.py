"""Further motions that would make parameters identifiable: candidates are simulated, and the best is described in words."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from armwright.fitting.directions import ENOUGH, WEAK, directions, gain, in_words, scaled
from armwright.identification.arm.base import BaseParameters
from armwright.identification.arm.equations import Equations, Samples
from armwright.identification.arm.fit import ArmFit

STATES = 240  # of the log that a candidate repeats
TURN = 0.5 * np.pi  # [rad]; slides move by as much of a quarter of a metre
SLIDE = 0.25  # [m]
MOST_SENTENCES = 6


def sentences(fit: ArmFit, samples: Iterable[Samples], base: BaseParameters, structural: BaseParameters) -> list[str]:
    """Weakly identifiable directions, the weakest first, each with the motion that would identify it; then motions for more.

    Args:
        fit: of the log.   samples: of it, for the poses that were used.   base: identifiable.   structural: of the arm.
    """
    weak = [each for each in directions(scaled(fit.information)[0]) if each.condition > WEAK][:MOST_SENTENCES]
    candidates = motions(fit, samples) if weak else {}
    words = [fit.base.columns[k].about for k in fit.base.independent]
    said = [in_words(each, words, _remedy(fit, each.vector, candidates)) for each in weak]
    return [*said, *_motions_for_more(fit.equations, structural)] if len(base) < len(structural) else said


def _motions_for_more(equations: Equations, structural: BaseParameters) -> list[str]:
    """Sentences on further motions of one joint that would make more of the structure's parameters identifiable."""
    from armwright.identification.experiments.columns import BaseRegressor
    from armwright.identification.experiments.expected import joints_that_separate

    model = equations.model
    R = equations.factor[:, structural.independent]
    regressor = BaseRegressor(model, structural, np.zeros(model.arm.n))
    return list(joints_that_separate(regressor, R.T @ R, int(equations.rows.max())))[:MOST_SENTENCES]


def _remedy(fit: ArmFit, vector: np.ndarray, candidates: dict[str, np.ndarray]) -> str:
    """The candidate that shows a direction best, as a clause; "" where none at least doubles what is known of it."""
    _, size = scaled(fit.information)
    known = np.linalg.norm(fit.information @ (vector / size))
    shown = {name: float(np.linalg.norm(rows @ (vector / size))) for name, rows in candidates.items()}
    best = max(shown, key=lambda name: shown[name], default="")
    if not best or np.hypot(shown[best], known) < ENOUGH * known or gain(fit.information, candidates[best]) < 1.01:
        return "no motion of one joint more would"
    return f"{best} would"


def motions(fit: ArmFit, samples: Iterable[Samples]) -> dict[str, np.ndarray]:
    """Candidate motions in words with weighted rows (m, b), as many as in the log: the same motion with a joint elsewhere, and
    a joint that swings while the others rest.
    """
    seen = _thinned(samples)
    model, base, n = fit.equations.model, fit.base, fit.equations.model.arm.n
    weight = np.sqrt(fit.weights)[None, :, None] * np.sqrt(max(fit.equations.rows.max(), 1) / max(len(seen.t), 1))

    def rows(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        return (model.rows(q, qd, qdd)[:, :, base.independent] * weight).reshape(-1, len(base))

    middle, speed = np.median(seen.q, axis=0), np.sqrt((seen.qd**2).mean(axis=0))
    phase = 2 * np.pi * np.arange(len(seen.t)) / max(len(seen.t), 1)
    found = {}
    for j, body in enumerate(model.arm.coordinates):
        linear = body.kind.units.linear
        step = SLIDE if linear else TURN
        q = seen.q.copy()
        q[:, j] += step
        turned = f"moved by {SLIDE:g} m" if linear else "turned by 90°"
        found[f"the same motion with {body.joint} {turned}"] = rows(q, seen.qd, seen.qdd)
        rate = max(speed[j], speed.max(initial=0.0), 0.1) / step * np.sqrt(2)
        still = np.zeros((len(phase), n))
        q, qd, qdd = still + middle, still.copy(), still.copy()
        q[:, j] += step * np.sin(phase)
        qd[:, j] = step * rate * np.cos(phase)
        qdd[:, j] = -step * rate**2 * np.sin(phase)
        amount = f"±{SLIDE:g} m" if linear else "±90°"
        found[f"a swing of {body.joint} by {amount}"] = rows(q, qd, qdd)
    return found


def _thinned(samples: Iterable[Samples]) -> Samples:
    """Some states of a log, evenly spread over its blocks."""
    blocks, rows = [], 0
    for block in samples:
        blocks.append(block.part(slice(None, None, max(len(block.t) // STATES, 1))))
        rows += len(blocks[-1].t)
        if rows > 20 * STATES:
            break
    joined = [np.concatenate([getattr(b, name) for b in blocks]) for name in ("t", "q", "qd", "qdd", "tau")]
    step = max(len(joined[0]) // STATES, 1)
    return Samples(blocks[0].run, 0, *(each[::step] for each in joined))

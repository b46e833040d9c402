"""Likely errors in a log's file: a wrong sign, exchanged columns, or motor values declared as joint values.

A fit of the wrong columns often looks good. Here each likely mistake is undone, and the same base parameters are fitted to some
rows again: a mistake that explains three quarters of the squares that are left is named.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from armwright.fitting.triangular import triangle
from armwright.identification.arm.equations import Samples
from armwright.identification.arm.fit import ArmFit
from armwright.identification.arm.torque_model import TorqueModel

ROWS = 400  # that mistakes are tried on
BETTER = 0.25  # squares of the errors with a mistake undone, by those as logged: less is in doubt
LATE = 0.5  # the same with a delay, which is one number for all joints and no more than said
EXACT = 1e-4  # of the torques' squares: where no more is left, nothing is in doubt


def misread_columns(fit: ArmFit, samples: Samples) -> list[str]:
    """Sentences about likely errors in a log's file, each of whose corrections would explain far more of the log.

    What is left is counted over all joints, weighted as the fit, and of each joint by itself where all together gain too.

    Args:
        fit: of all rows.   samples: some of them.
    """
    model, n = fit.equations.model, fit.equations.model.arm.n
    some = samples.part(slice(None, None, max(len(samples.t) // ROWS, 1)))
    known = np.isfinite(some.unknown_torque(model))
    tau, one = np.where(known, some.tau, 0.0), np.eye(n)
    by_torque = 1.0 / np.maximum((tau * tau).mean(axis=0), np.finfo(float).tiny)

    def left(position: np.ndarray, torque: np.ndarray) -> tuple[float, np.ndarray]:
        """Squares that q' = position q, tau' = torque tau leave: weighted as the fit, and of each joint by its torque's."""
        motion = [each @ position.T for each in (some.q, some.qd, some.qdd)]
        target = tau @ torque.T - model.known_torques(*motion)
        rows = np.concatenate([model.rows(*motion)[:, :, fit.base.independent], target[:, :, None]], axis=2)
        squares = []
        for weights in (fit.weights, by_torque):
            weighted = (rows * np.where(known, np.sqrt(weights), 0.0)[:, :, None]).reshape(tau.size, -1)
            R = triangle(weighted)
            solution = np.linalg.lstsq(R[:-1, :-1], R[:-1, -1], rcond=1e-12)[0]
            squares.append(((weighted[:, -1] - weighted[:, :-1] @ solution) ** 2).reshape(-1, n).sum(axis=0))
        return float(squares[0].sum()), squares[1]

    as_logged, by_joint = left(one, one)
    if by_joint.max() < EXACT * len(tau):
        return []
    # columns of a filtered motion, which can be computed for each mistake, are not those that were fitted: of a good fit
    # they leave far more, and some mistake always explains much of that
    fitted = np.where(known, some.unknown_torque(model) - some.regressor(model) @ fit.parameters, 0.0)
    most = float((by_torque * fitted**2).sum())
    said, exchanged = [], (BETTER, "")
    measured = np.count_nonzero(known, axis=0) > 0
    for places, what, position, torque in _mistakes(model):
        if not all(measured[j] for j in places):
            continue
        found, of_joint = left(position, torque)
        if of_joint.sum() > most:
            continue
        ratio = found / as_logged
        if of_joint.sum() < by_joint.sum():
            ratio = min(ratio, *(of_joint[places] / np.maximum(by_joint[places], EXACT * len(tau))))
        words = f"{' and '.join(model.arm.names[j] for j in places)}: {1 - np.sqrt(ratio):.0%} of the error goes with {what}"
        if len(places) > 1:
            # whatever else is exchanged with these gains something too
            exchanged = min(exchanged, (float(ratio), words))
        elif ratio < BETTER:
            said.append(words)
    return [*said, exchanged[1]] if exchanged[1] else said


def late_torques(fit: ArmFit, samples: Samples) -> list[str]:
    """A sentence about torques delayed against the motion, if the delay explains at least half of the remaining squares.

    With a delay d the torques are  Y π - d τ̇,  so that d is one more parameter.
    """
    if len(samples.t) < 3:
        return []
    target = samples.unknown_torque(fit.equations.model)
    weight = np.sqrt(fit.weights)[:, None]
    columns = samples.regressor(fit.equations.model)[:, :, fit.base.independent]
    rate = np.gradient(samples.tau, samples.t, axis=0)
    rows = np.concatenate([columns, rate[:, :, None], target[:, :, None]], axis=2)
    rows[np.isnan(target)] = 0.0
    rows = (rows * weight).reshape(target.size, -1)
    R = triangle(rows)
    without, with_it = R[-2, -1] ** 2 + R[-1, -1] ** 2, R[-1, -1] ** 2
    if with_it > LATE * without or without < EXACT * float((rows[:, -1] ** 2).sum()):
        return []
    delay = -R[-2, -1] / R[-2, -2]
    late = f"{1e3 * abs(delay):.3g} ms {'before' if delay < 0 else 'after'}"
    return [f"torques come {late} the motion that they belong to: are both logged by one clock?"]


def _mistakes(model: TorqueModel) -> Iterator[tuple[Sequence[int], str, np.ndarray, np.ndarray]]:
    """Numbers of joints, words, and matrices (n, n) that undo the mistake in positions and in torques."""
    n = model.arm.n
    one = np.eye(n)
    for j in range(n):
        mirrored, asked = one - 2 * np.diag(one[j]), "is it wrong in the log's file, or the axis in the robot's?"
        yield [j], f"the other sign of its position: {asked}", mirrored, one
        yield [j], f"the other sign of its torque: {asked}", one, mirrored
    for j, k in combinations(range(n), 2):
        swapped, asked = one.copy(), "are columns in the order of the joints?"
        swapped[[j, k]] = one[[k, j]]
        yield [j, k], f"their positions exchanged: {asked}", swapped, one
        yield [j, k], f"their torques exchanged: {asked}", one, swapped
        yield [j, k], f"their positions and torques exchanged: {asked}", swapped, swapped
    motors = one.copy()  # B: the motors' angles by the joints', each referred by its own ratio
    for column in model.columns:
        for j, share in column.turned[1:]:
            motors[model.arm.names.index(column.joint), j] = share
    coupled = np.flatnonzero((motors != one).any(axis=0) | (motors != one).any(axis=1)).tolist()
    if coupled:
        what = "taken as those of the motors, each by its own ratio"
        asked = 'is side = "motor" right in the log\'s file?'
        yield coupled, f"positions {what}: {asked}", np.linalg.inv(motors), one
        yield coupled, f"torques {what}: {asked}", one, motors.T

"""Singular values of the Jacobian: how well the arm moves its tip in a pose, and how far it is from a singular one."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from armwright import scalar
from armwright.errors import ModelError
from armwright.kinematics.aim import EXPECTED, POSE, Aim, turning_rows
from armwright.kinematics.forward_kinematics import forward_kinematics
from armwright.kinematics.jacobian import jacobian
from armwright.model import Model, one_state
from armwright.program import Program, call, trace
from armwright.scalar import Array, Scalar

# of rotations: random 6 × 7 matrices are done to rounding after 6, those with one tiny singular value after 7
SWEEPS = 6


def checked_task(task: str) -> tuple[bool, Aim]:
    """True where the position counts in a task, and its part of the rotation.

    Raises:
        ModelError: no such task.
    """
    try:
        return task != "rotation", POSE if task == "rotation" else Aim.of(task)
    except ModelError:
        raise ModelError(place="aim", value=task, expected=f"'rotation', {EXPECTED}") from None


def task_jacobian(arm: Model, q: Array, frame: str | None, task: str, length: float) -> np.ndarray:
    """Rows of the Jacobian that a task needs, angles times a length:  [J_v; L J_ω]  [m/rad | -].

    Args:
        arm: the model.   q: (n,) [rad | m].   frame: by default the tip.   length: L [m], what a turn by 1 rad counts as.
        task: "rotation" (3 rows), or part of the pose that counts, as `Aim` has it: "pose" (6), "position" (3), "axis" (5),
            "pitch" (4), ….
    Raises:
        ModelError: no such task or frame.
    """
    placed, aim = checked_task(task)
    rows = jacobian(arm, q, frame)
    linear, angular = rows[:3], rows[3:] * length
    if aim.kind != "pose":  # turns that change what counts
        angular = turning_rows(aim, forward_kinematics(arm, q, frame)[:3, :3]) @ angular
    return scalar.array([*linear, *angular] if placed else [*angular])


@one_state
def singular_values(
    arm: Model, q: Array, frame: str | None = None, aim: str = "pose", length: float = 1.0
) -> np.ndarray:
    """Singular values of the Jacobian, the largest first:  J = U diag(σ) Vᵀ,  by Jacobi's rotations from one side.
    [Hestenes1958]

    Each rotation makes two rows (columns, where there are fewer) orthogonal; when all are, their lengths are σ. So small
    ones keep their digits, which those from J Jᵀ do not.

    Args:
        arm: the model.   q: (n,) [rad | m].   frame: name of a frame of the arm; by default its tip.
        aim: "rotation", or part of the pose that counts: "pose", "position", "axis", "pitch", …, as in `inverse_kinematics`.
        length: [m] that a turn by 1 rad counts as, so that all have one unit.
    Returns:
        sigma: (m,) [m/rad | -], m the smaller of n and the rows: 3 of a position, and the turns that count.
    Raises:
        ModelError: no such frame or aim, or the arm branches and names no tip.
    """
    matrix = task_jacobian(arm, q, frame, aim, length)
    rows = matrix if matrix.shape[0] <= matrix.shape[1] else matrix.T
    symbolic = scalar.is_symbolic(rows)
    for _ in range(SWEEPS):
        rows = call(_sweep_of(rows.shape), rows) if symbolic else _sweep(rows)
    return _sorted([scalar.sqrt(row @ row) for row in rows])


@lru_cache(maxsize=16)
def _sweep_of(shape: tuple[int, int]) -> Program:
    """One sweep as a program that is called, so that code is made once for all of them."""
    return trace("sweep", _sweep, {"rows": shape}, ("turned",), noinline=True)


def _sweep(rows: Array) -> np.ndarray:
    """Rows (m, k) after every two of them were turned once."""
    turned = [*rows]
    for i in range(len(turned)):
        for j in range(i + 1, len(turned)):
            turned[i], turned[j] = _rotated(turned[i], turned[j])
    return scalar.stack(turned)


def _rotated(a: Array, b: Array) -> tuple[np.ndarray, np.ndarray]:
    """Two rows turned in their plane until they are orthogonal, by the smaller of the two angles."""
    along, difference = 2.0 * (a @ b), b @ b - a @ a
    root = scalar.sqrt(difference * difference + along * along)
    divisor = difference + scalar.where(scalar.less(difference, 0.0), -root, root)
    some = scalar.less(0.0, scalar.abs(divisor))
    tangent = scalar.where(some, along / scalar.where(some, divisor, 1.0), 0.0)
    cosine = 1.0 / scalar.sqrt(1.0 + tangent * tangent)
    sine = cosine * tangent
    return cosine * a - sine * b, sine * a + cosine * b


def _sorted(values: list[Scalar]) -> np.ndarray:
    """Values, the largest first, by exchanging neighbours."""
    for end in range(len(values) - 1, 0, -1):
        for k in range(end):
            pair = values[k], values[k + 1]
            values[k], values[k + 1] = scalar.maximum(*pair), scalar.minimum(*pair)
    return scalar.array(values)

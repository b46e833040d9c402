"""Measures of poses from the Jacobian's singular values and the joint limits, compiled, for any number of poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from armwright.entry import AnyArm, as_arm
from armwright.errors import ModelError, ShapeError
from armwright.ik.targets import checked_array
from armwright.kernels.batch import Kernel
from armwright.kernels.target import select_target
from armwright.kinematics import forward_kinematics
from armwright.kinematics.manipulability import checked_task as known_task, singular_values
from armwright.model import Model
from armwright.program import trace
from armwright.results.result import Result
from armwright.scalar import Array, real_number


@dataclass(frozen=True, eq=False)
class Manipulability(Result):
    """Measures of poses, `…` as the joint positions have it.

    Attributes:
        singular_values: (…, m) of the Jacobian whose angular rows are multiplied by `length`, the largest first.
        limit_margin: (…,) least distance to a joint limit, as a share of that joint's range: 1/2 in the middle of all,
            0 at a limit, negative beyond it; 1/2 where no joint has two limits.
        aim: rows that count.   length: [m] that a turn by 1 rad counts as.
    """

    singular_values: np.ndarray
    limit_margin: np.ndarray
    aim: str
    length: float

    @property
    def yoshikawa(self) -> np.ndarray:
        """(…,) manipulability  w = √det(J Jᵀ), the product of the singular values; with fewer joints than rows √det(Jᵀ J).
        [Yoshikawa1985]
        """
        return self.singular_values.prod(axis=-1)

    @property
    def smallest(self) -> np.ndarray:
        """(…,) smallest singular value: the distance, in the spectral norm, to the nearest Jacobian that is singular. A tip
        motion of 1 in the worst direction needs joint speeds of 1 / smallest.
        """
        return self.singular_values[..., -1]

    @property
    def condition(self) -> np.ndarray:
        """(…,) largest by smallest singular value: 1 where all directions are alike, infinite in singular poses."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.singular_values[..., 0] / self.singular_values[..., -1]


def manipulability(
    arm: AnyArm, q: Any, *, frame: str | None = None, aim: str = "pose", length: float = 1.0, threads: int = 1
) -> Manipulability:
    """Yoshikawa's manipulability, condition number, distance to singularity and distance to limits of joint positions.

    All from the singular values σ of the Jacobian [J_v; L J_ω]: w = Π σ, condition = σ_max / σ_min, distance = σ_min.
    Lengths and angles have no common unit, so all but a task of position alone depend on the length L.

    Args:
        arm: whose joints move.   q: (…, n) [rad | m].   frame: name of a frame of the arm; by default its tip.
        aim: rows that count: "rotation" (3), or those of a part of the pose as in `inverse_kinematics`: "pose" (6),
            "position" (3), "axis" (5), "pitch" (4), ….
        length: L [m], what a turn by 1 rad counts as; 1 m is what textbooks and other libraries have without saying so.
        threads: for large batches.
    Returns:
        measures: arrays (…,) by name; `yoshikawa`, `condition`, `smallest`, `limit_margin`, and `singular_values` (…, m).
    Raises:
        ShapeError: q has another shape.   ModelError: no such frame or aim, a length that is not above 0, or an arm that
            branches and names no tip.
    Example:
        >>> found = aw.kinematics.manipulability("two-link", [0.3, 1.5708], aim="position")
        >>> round(float(found.yoshikawa), 3)  # best with the elbow at a right angle
        0.8
    """
    arm = as_arm(arm)
    checked_task(arm, aim, length)
    positions = checked_array(q, "q")
    if positions.shape[-1:] != (arm.n,):
        raise ShapeError(f"shape {positions.shape}", place="q", expected=f"(…, {arm.n}) joint positions")
    _, sigma = measures(arm, frame, aim, float(length))(positions, threads=threads)
    return Manipulability(sigma, limit_margin(arm, positions), aim, float(length))


def checked_task(arm: Model, aim: str, length: float) -> None:
    """Refuses what is no arm, no aim or no length.

    Raises:
        ModelError: names it.
    """
    arm = as_arm(arm)
    known_task(aim)
    number = real_number(length)
    if number is None or not 0.0 < number < np.inf:
        raise ModelError(place="length", value=length, expected="a number above 0 [m]")


@lru_cache(maxsize=16)
def measures(arm: Model, frame: str | None, aim: str, length: float) -> Kernel:
    """Compiled  q → position of the frame (3,) [m], singular values (m,)."""

    def both(q: Array) -> tuple[np.ndarray, np.ndarray]:
        return forward_kinematics(arm, q, frame)[:3, 3], singular_values(arm, q, frame, aim, length)

    return Kernel(trace("measures", both, {"q": (arm.n,)}, ("position", "singular_values")), select_target())


def limit_margin(arm: Model, q: np.ndarray) -> np.ndarray:
    """(…,) least distance of positions (…, n) to a limit, as a share of that joint's range; 1/2 without limits."""
    low, high = np.array([body.limits.position for body in arm.coordinates]).T
    limited = np.isfinite(high - low) & (high > low)
    if not limited.any():
        return np.full(q.shape[:-1], 0.5)
    q, low, high = q[..., limited], low[limited], high[limited]
    return (np.minimum(q - low, high - q) / (high - low)).min(axis=-1)

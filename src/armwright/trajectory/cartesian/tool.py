"""A frame of an arm that follows a path: its compiled kinematics, and joint rates for its twist."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from armwright.kernels.compiled import compile_arm
from armwright.kinematics.reach import reach
from armwright.model import Model

Aim = Literal["pose", "position"]
CUT = 1e-9  # of the largest singular value: smaller ones are 0
ANGLE_SHARE = 1.0 / 3.0  # of the reach: what a turn by 1 rad counts as


@dataclass(frozen=True, eq=False)
class Tool:
    """The frame that follows a path.

    Attributes:
        arm: the model.   frame: its name; None: the tip.   aim: what of a pose counts.
    """

    arm: Model
    frame: str | None
    aim: Aim

    @cached_property
    def _kernels(self) -> tuple[Any, Any, Any]:
        compiled = compile_arm(self.arm)
        options = {} if self.frame is None else {"frame": self.frame}
        names = ("forward_kinematics", "jacobian", "jacobian_dot_qd")
        forward, jacobian, change = (compiled.kernel(name, **options) for name in names)
        return forward, jacobian, change

    @cached_property
    def radian(self) -> float:
        """Length equivalent to an angle of 1 rad [m]."""
        length = float(reach(self.arm, self.frame))
        return ANGLE_SHARE * length if np.isfinite(length) and length > 0.0 else 1.0

    @property
    def rows(self) -> int:
        """Indices of the twist entries that the path constrains."""
        return 6 if self.aim == "pose" else 3

    @property
    def redundant(self) -> bool:
        """True for an arm with more joints than the path needs."""
        return self.arm.n > self.rows

    def pose(self, q: np.ndarray) -> np.ndarray:
        """(k, 4, 4) of the frame at positions q (k, n)."""
        return self._kernels[0](q)

    def errors(self, q: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances [m] and angles [rad], (k,) each, of the frame at q from poses."""
        error = self.difference(q, poses)
        return np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)

    def difference(self, q: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """(k, rows) from the frame at q to poses: distance [m] and rotation vector [rad], in base axes."""
        reached = self.pose(q)
        way = poses[:, :3, 3] - reached[:, :3, 3]
        if self.aim == "position":
            return way
        turn = Rotation.from_matrix(poses[:, :3, :3] @ np.swapaxes(reached[:, :3, :3], 1, 2)).as_rotvec()
        return np.concatenate([way, turn], axis=1)

    def inverse(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pseudoinverses J⁺ (k, n, rows), J itself, and the least singular value as a share of the largest (k,).

        Angles are weighted by `radian`, so that both have a unit in common.
        """
        jacobian, weights = self._weighted(q)
        u, sigma, vt = np.linalg.svd(jacobian, full_matrices=False)
        kept = sigma > CUT * sigma[:, :1]
        inverted = np.where(kept, 1.0 / np.where(kept, sigma, 1.0), 0.0)
        inverse = np.swapaxes(vt, 1, 2) @ (inverted[:, :, None] * np.swapaxes(u, 1, 2)) * weights
        return inverse, jacobian / weights[:, None], sigma[:, -1] / np.maximum(sigma[:, 0], 1e-300)

    def hardest(self, q: np.ndarray, twist: np.ndarray) -> tuple[int, float]:
        """The joint that moves most in the direction in which the arm at q (n,) is weakest, and its rate for a twist (6,)."""
        jacobian, weights = self._weighted(q[None])
        u, sigma, vt = np.linalg.svd(jacobian[0], full_matrices=False)
        share = np.abs(vt[-1])
        joint = int(np.argmax(share > (1.0 - 1e-6) * share.max()))  # of two that move alike the first
        with np.errstate(divide="ignore"):
            return joint, float(np.abs(u[:, -1] @ (weights * twist[: self.rows]) * vt[-1, joint]) / sigma[-1])

    def _weighted(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Jacobians (k, rows, n) with their angular rows times `radian`, so that all have a unit in common, and the weights."""
        weights = np.array([1.0, 1.0, 1.0, *[self.radian] * 3])[: self.rows]
        return weights[:, None] * self._kernels[1](q)[:, : self.rows], weights

    def twist(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Speed J q̇ and acceleration J q̈ + J̇ q̇ of the frame, (k, 6) each, linear rows first, in base axes."""
        jacobian = self._kernels[1](q)
        return (jacobian @ qd[..., None])[..., 0], (jacobian @ qdd[..., None])[..., 0] + self._kernels[2](q, qd)

    def drift(self, q: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """J̇ q̇ (k, rows)."""
        return self._kernels[2](q, rates)[:, : self.rows]

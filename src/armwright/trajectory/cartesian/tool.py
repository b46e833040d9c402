"""A frame of an arm that follows a path: its compiled kinematics, and joint rates for its twist."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from armwright.kernels.compiled import compile_arm
from armwright.kinematics.aim import Aim
from armwright.kinematics.reach import turn_length
from armwright.model import Model
from armwright.trajectory.cartesian.pieces import PathPoints
from armwright.trajectory.cartesian.turning import turning

CUT = 1e-9  # of the largest singular value: smaller ones are 0


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
        return turn_length(self.arm, self.frame)

    @property
    def rows(self) -> int:
        """Number of equations that the path sets the joint rates; one of pitch is void where the axis is not vertical."""
        return 3 + self.aim.counted + (self.aim.kind == "pitch")

    @property
    def partial(self) -> bool:
        """True where a part of the orientation counts."""
        return self.aim.kind not in ("pose", "position")

    @property
    def redundant(self) -> bool:
        """True for an arm with more joints than the path needs."""
        return self.arm.n > 3 + self.aim.counted

    def pose(self, q: np.ndarray) -> np.ndarray:
        """(k, 4, 4) of the frame at positions q (k, n)."""
        return self._kernels[0](q)

    def errors(self, q: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances [m] and angles [rad], (k,) each, of the frame at q from what counts of poses."""
        error = self.difference(q, poses)
        return np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)

    def difference(self, q: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """(k, rows) from the frame at q to poses: distance [m] in base axes, and of the rotation [rad] what counts.

        All of it is the rotation vector in base axes, a part of it is `smooth_error`.
        """
        reached = self.pose(q)
        way = poses[:, :3, 3] - reached[:, :3, 3]
        if self.aim.kind == "position":
            return way
        if self.partial:
            return np.concatenate([way, self._turning(reached, poses)[0]], axis=1)
        turn = Rotation.from_matrix(poses[:, :3, :3] @ np.swapaxes(reached[:, :3, :3], 1, 2)).as_rotvec()
        return np.concatenate([way, turn], axis=1)

    def asked(self, q: np.ndarray, points: PathPoints) -> np.ndarray:
        """(k, rows) what J q' must be at positions q (k, n) on a path."""
        if not self.partial:
            return points.first[:, : self.rows]
        turned = self._turning(self.pose(q), points.pose, first=points.first)[2]
        return np.concatenate([points.first[:, :3], turned], axis=1)

    def change(self, q: np.ndarray, rates: np.ndarray, points: PathPoints) -> np.ndarray:
        """(k, rows) what J q'' must be at positions q (k, n) on a path, with q' = rates (k, n)."""
        drift = self._kernels[2](q, rates)
        if not self.partial:
            return points.second[:, : self.rows] - drift[:, : self.rows]
        w = (self._kernels[1](q)[:, 3:] @ rates[:, :, None])[:, :, 0]
        turned = self._turning(self.pose(q), points.pose, w, drift[:, 3:], points.first, points.second)[3]
        return np.concatenate([points.second[:, :3] - drift[:, :3], turned], axis=1)

    def inverse(self, q: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pseudoinverses J⁺ (k, n, rows), J itself, and the least singular value as a share of the largest (k,).

        Angles are weighted by `radian`, so that both have a unit in common.
        """
        jacobian, weights = self._weighted(q, poses)
        u, sigma, vt = np.linalg.svd(jacobian, full_matrices=False)
        kept = sigma > CUT * sigma[:, :1]
        inverted = np.where(kept, 1.0 / np.where(kept, sigma, 1.0), 0.0)
        inverse = np.swapaxes(vt, 1, 2) @ (inverted[:, :, None] * np.swapaxes(u, 1, 2)) * weights
        least = np.take_along_axis(sigma, self._last(jacobian)[:, None], axis=1)[:, 0]
        return inverse, jacobian / weights[:, None], least / np.maximum(sigma[:, 0], 1e-300)

    def hardest(self, q: np.ndarray, points: PathPoints) -> tuple[int, float]:
        """The joint that moves most in the direction in which the arm at q (n,) is weakest, and its rate there on a path."""
        jacobian, weights = self._weighted(q[None], points.pose)
        u, sigma, vt = np.linalg.svd(jacobian[0], full_matrices=False)
        last = int(self._last(jacobian)[0])
        share = np.abs(vt[last])
        joint = int(np.argmax(share > (1.0 - 1e-6) * share.max()))  # of two that move alike the first
        with np.errstate(divide="ignore"):
            asked = weights * self.asked(q[None], points)[0]
            return joint, float(np.abs(u[:, last] @ asked * vt[last, joint]) / sigma[last])

    def twists(self, q: np.ndarray, first: np.ndarray, second: np.ndarray, points: PathPoints) -> PathPoints:
        """The tool's pose on its path with the motion that joints with q' and q'' (k, n) give it: free parts turn as they do."""
        if self.aim.kind == "pose":
            return points
        jacobian = self._kernels[1](q)[:, 3:]
        turned = (jacobian @ np.stack([first, second], axis=2)) + np.stack(
            [np.zeros((len(q), 3)), self._kernels[2](q, first)[:, 3:]], axis=2
        )
        return PathPoints(
            points.pose,
            np.concatenate([points.first[:, :3], turned[:, :, 0]], axis=1),
            np.concatenate([points.second[:, :3], turned[:, :, 1]], axis=1),
        )

    def _turning(
        self,
        reached: np.ndarray,
        poses: np.ndarray,
        w: np.ndarray | None = None,
        dw: np.ndarray | None = None,
        first: np.ndarray | None = None,
        second: np.ndarray | None = None,
    ) -> tuple[np.ndarray, ...]:
        """Outputs of `turning` for poses (k, 4, 4); rates (k, 3 or 6) that are not needed are 0."""
        still = np.zeros((len(reached), 6))
        rates = [still[:, :3] if each is None else each for each in (w, dw)]
        rates += [(still if each is None else each)[:, 3:] for each in (first, second)]
        return turning(self.aim)(reached[:, :3, :3], rates[0], rates[1], poses[:, :3, :3], rates[2], rates[3])

    def _last(self, jacobian: np.ndarray) -> np.ndarray:
        """(k,) number of the least singular value of Jacobians (k, rows, n), but for that of a void row."""
        void = self.aim.kind == "pitch" and ~jacobian[:, -1].any(axis=1)
        return np.broadcast_to(np.minimum(self.rows - void, self.arm.n) - 1, len(jacobian))

    def _weighted(self, q: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Jacobians (k, rows, n) with their angular rows times `radian`, so that all have a unit in common, and the weights."""
        weights = np.array([1.0] * 3 + [self.radian] * (self.rows - 3))
        jacobian = self._kernels[1](q)
        if self.partial:
            turned = self._turning(self.pose(q), poses)[1] @ jacobian[:, 3:]
            jacobian = np.concatenate([jacobian[:, :3], turned], axis=1)
        return weights[:, None] * jacobian[:, : self.rows], weights

    def twist(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Speed J q̇ and acceleration J q̈ + J̇ q̇ of the frame, (k, 6) each, linear rows first, in base axes."""
        jacobian = self._kernels[1](q)
        return (jacobian @ qd[..., None])[..., 0], (jacobian @ qdd[..., None])[..., 0] + self._kernels[2](q, qd)

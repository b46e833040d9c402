"""Inertia, gravity and coupling of each joint over an arm's workspace, from many sampled poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.dynamics import holding_torques, mass_matrix
from armwright.entry import AnyArm, as_arm
from armwright.errors import ScenarioError
from armwright.kernels.batch import Kernel
from armwright.kernels.target import select_target
from armwright.model import Model
from armwright.program import trace
from armwright.results.result import Result
from armwright.scalar import Array
from armwright.simulation.checks import check_whole


@dataclass(frozen=True, eq=False)
class JointInertias(Result):
    """Inertia, gravity and coupling of each joint at sampled poses.

    Attributes:
        q: (poses, n) [rad | m].   held: (poses, n) H_jj, the others held still [kg m² | kg], rotors included.
        free: (poses, n) 1/(H⁻¹)_jj, the others without torque [kg m² | kg].
        slope: (poses, n) ∂g_j/∂q_j of weight and springs [N m/rad | N/m].
    """

    q: np.ndarray
    held: np.ndarray
    free: np.ndarray
    slope: np.ndarray

    @property
    def coupling(self) -> np.ndarray:
        """(poses, n) 1 - free / fixed inertia: 0 for a joint that moves independently, near 1 for strong coupling."""
        return 1.0 - self.free / self.held

    def extremes(self) -> np.ndarray:
        """Indices of the poses of least or greatest inertia, slope or coupling of any joint."""
        columns = np.hstack([self.held, self.free, self.slope, self.coupling])
        return np.unique(np.concatenate([columns.argmin(axis=0), columns.argmax(axis=0)]))


def checked_poses(q: Any, n: int) -> np.ndarray:
    """Poses (…, n) as numbers.

    Raises:
        ScenarioError: another shape, or what is no finite number.
    """
    expected = f"finite poses (…, {n})"
    try:
        poses = scalar.real_numbers(q)
    except ValueError:
        raise ScenarioError(place="q", value=q, expected=expected) from None
    if poses.shape[-1:] != (n,) or not np.isfinite(poses).all():
        what = f"shape {poses.shape}" if poses.shape[-1:] != (n,) else "is not finite"
        raise ScenarioError(what, place="q", expected=expected)
    return poses


def sampled_poses(arm: Model, count: int, seed: int = 0) -> np.ndarray:
    """(count, n) poses drawn uniformly within the position limits, of more than a turn within one (`Body.sampled_range`).

    Raises:
        ScenarioError: a count below 1, or a sliding joint without limits.
    """
    check_whole("poses", count, 1)
    check_whole("seed", seed, 0)
    ranges = []
    for body in arm.coordinates:
        if body.kind.units.linear and not np.isfinite(body.limits.position).all():
            raise ScenarioError(f"sliding joint {body.joint!r} has no position limits", place="poses", file=arm.name)
        ranges.append(body.sampled_range)
    low, high = np.array(ranges).T
    return low + (high - low) * np.random.default_rng(seed).uniform(size=(count, arm.n))


def joint_inertias(arm: AnyArm, poses: int | np.ndarray = 100_000, seed: int = 0) -> JointInertias:
    """Inertia, gravity's slope and coupling of every joint over the workspace, by one compiled kernel.

    Args:
        arm: the model, with or without a payload.   poses: how many are drawn (`sampled_poses`), or (k, n) [rad | m].
        seed: of the poses.
    Returns:
        inertias: at each pose.
    Raises:
        ScenarioError: as `sampled_poses`, or poses of another arm.
    Example:
        >>> found = aw.loops.joint_inertias("two-link", poses=1000)
        >>> found.held.max(axis=0).round(2)  # stretched out
        array([10.05,  0.85])
    """
    arm = as_arm(arm)
    listed = isinstance(poses, (np.ndarray, list, tuple))
    q = np.atleast_2d(checked_poses(poses, arm.n)) if listed else sampled_poses(arm, poses, seed)

    def of_joints(q: Array) -> tuple[Array, Array, Array]:
        mass = mass_matrix(arm, q)
        inverse = scalar.inverse_factored(scalar.factor_symmetric(mass))
        slope = scalar.jacobian(lambda q: holding_torques(arm, q), q)
        joints = range(arm.n)
        return (
            scalar.array([mass[i, i] for i in joints]),
            scalar.array([1.0 / inverse[i, i] for i in joints]),
            scalar.array([slope[i, i] for i in joints]),
        )

    program = trace("joint_inertias", of_joints, {"q": (arm.n,)}, ("held", "free", "slope"), by_content=True)
    return JointInertias(q, *Kernel(program, select_target(None))(q))

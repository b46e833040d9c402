"""Effect of a difference between two arms: mass, holding torques and inertias of their common joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright.dynamics import holding_torques, mass_matrix
from armwright.model import Model

POSES = 32  # beside q = 0


@dataclass(frozen=True, eq=False)
class DynamicEffect:
    """Mass, holding torques and inertias of two arms; arrays have one entry for each common joint.

    Attributes:
        mass: of all links [kg], of each arm.   joints: the names of the joints.   poses: (k, joints) [rad | m].
        gravity: (2, k, joints) [N m | N] torques that hold each arm against gravity and springs.
        inertia: (2, k, joints) [kg m² | kg] diagonal of the mass matrix of each arm, rotors included.
    """

    mass: tuple[float, float]
    joints: tuple[str, ...]
    poses: np.ndarray
    gravity: np.ndarray
    inertia: np.ndarray

    @property
    def gravity_change(self) -> np.ndarray:
        """(joints,) [N m | N] largest difference in holding torque, second arm minus first."""
        return _largest(self.gravity[1] - self.gravity[0])

    @property
    def inertia_change(self) -> np.ndarray:
        """(joints,) [-] largest relative difference in inertia, second arm to first; nan if the first has none."""
        one, other = self.inertia
        return _largest(np.divide(other, one, out=np.full_like(one, np.nan), where=one > 0) - 1)


def dynamic_effect(a: Model, b: Model) -> DynamicEffect | None:
    """Holding torques and inertias of two arms at q = 0 and at 32 poses within the limits of the first.

    Joints go by their names; one that only one arm has stays at 0. None without a joint in common.
    """
    names = tuple(name for name in a.names if name in b.names)
    if not names:
        return None
    poses = sample_poses(a, names)
    gravity, inertia = (np.empty((2, *poses.shape)) for _ in range(2))
    for k, arm in enumerate((a, b)):
        places = [arm.names.index(name) for name in names]
        for pose, g, i in zip(poses, gravity[k], inertia[k], strict=True):
            q = np.zeros(arm.n)
            q[places] = pose
            g[:] = holding_torques(arm, q)[places]
            i[:] = np.diag(mass_matrix(arm, q))[places]
    return DynamicEffect((_mass(a), _mass(b)), names, poses, gravity, inertia)


def sample_poses(arm: Model, names: tuple[str, ...]) -> np.ndarray:
    """q = 0, then points of a Halton sequence within the limits: (k, joints) [rad | m]. [Halton1960]

    A joint without limits turns half a turn either way; a slide without limits stays at 0.
    """
    from scipy.stats import qmc

    bodies = {body.joint: body for body in arm.bodies}
    ranges = []
    for name in names:
        low, high = bodies[name].limits.position
        unbounded = (-np.pi, np.pi) if not bodies[name].kind.slides else (0.0, 0.0)
        ranges.append((low, high) if -np.inf < low <= high < np.inf else unbounded)
    low, high = np.array(ranges).T
    points = qmc.Halton(len(names), scramble=False).random(POSES + 1)[1:]  # the first of them is a corner
    return np.vstack([np.zeros(len(names)), low + points * (high - low)])


def _mass(arm: Model) -> float:
    assert arm.description is not None
    return arm.description.total_mass


def _largest(values: np.ndarray) -> np.ndarray:
    """Of each column (k, n) the entry of largest magnitude, with its sign; nan where one is."""
    return np.take_along_axis(values, np.abs(values).argmax(axis=0)[None], axis=0)[0]

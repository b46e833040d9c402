"""Linear model of an arm about a state, for control design."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.actuators import drive_torque
from armwright.dynamics.derivatives import driven_derivatives
from armwright.model import Model, one_state_with_masses
from armwright.scalar import Array


@one_state_with_masses
def forward_arm_linearised(arm: Model, q: Array, qd: Array, u: Array) -> tuple[np.ndarray, np.ndarray]:
    """A and B of  δẋ = A δx + B δu,  x = (q, q̇), about a state and its drive commands: the slopes of `forward_arm`.

    A = [[0, 1], [∂q̈/∂q, ∂q̈/∂q̇]],  B = [[0], [∂q̈/∂u]],  back EMF, friction and gear loss included.
    [CarpentierMansard2018] The state need not be an equilibrium. Where a slope jumps as a joint
    turns back (lossy gears, unequal Coulomb friction), at rest it is that for motion in the positive direction. Dry friction and
    gear loss without a smoothing speed count 0 at rest, where they would hold a joint: their jump is in neither matrix.

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        u: (n,) [V | A | N m | N], each in the unit of its joint's drive command; no limit is applied.
    Returns:
        A: (2n, 2n) [1/s, 1/s², mixed joints as in `forward_dynamics_derivatives`].
        B: (2n, n) [rad/s² | m/s²] per unit of u.
    Raises:
        ModelError: a drive without the constants that its command needs.
    Example:
        >>> arm = aw.load("cmu-dd")
        >>> q, qd, volts = np.zeros(6), np.zeros(6), [8, 12, 8, 4, 2, 1]
        >>> [each.shape for each in aw.forward_arm_linearised(arm, q, qd, volts)]
        [(12, 12), (12, 6)]
    """
    by_q, by_qd, by_u = driven_derivatives(arm, q, qd, u, lambda qd, u: drive_torque(arm, qd, u))
    unit, none = np.eye(arm.n), scalar.zeros(arm.n, arm.n)
    a = np.concatenate([np.concatenate([none, unit], axis=1), np.concatenate([by_q, by_qd], axis=1)])
    return scalar.array(a), scalar.array(np.concatenate([none, by_u]))

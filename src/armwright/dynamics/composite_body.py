"""Forward dynamics by composite bodies and a symmetric solve. [WalkerOrin1982] method 3, eqs (13)-(15) of the CMU report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armwright import scalar
from armwright.actuators.friction import link_friction
from armwright.dynamics.gears import Gear, motors, through_gears
from armwright.dynamics.inverse import external_torques, newton_euler
from armwright.dynamics.mass_matrix import mass_matrix
from armwright.model import Model, one_state_with_masses
from armwright.scalar import Array


@one_state_with_masses
def composite_body(arm: Model, q: Array, qd: Array, tau: Array, wrench: Array | None = None) -> np.ndarray:
    """Accelerations that motor torques give, by the mass matrix: what `forward_dynamics` gives, cheapest for short arms.

    q̈ = M⁻¹ ( tau - C q̇ - g - s - f + Jᵀ wrench ),  M = L D Lᵀ solved without pivots; with gear loss by Newton's method on the
    equation of `forward_dynamics`, one such solve a step.  [WalkerOrin1982]

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        tau: (n,) [N m | N] motor torque referred to the joints, before rotor, gear loss and friction.
        wrench: (6,) [N, N m] force and moment of the environment on the arm at the tip, in base axes.
    Returns:
        qdd: (n,) [rad/s² | m/s²]; not finite where M is singular.
    Raises:
        ModelError: a wrench on an arm that branches and names no tip.
    Example:
        >>> arm = aw.load("two-link")
        >>> aw.composite_body(arm, [0.3, 0.5], [1.0, -0.5], [20.0, 5.0]).round(3)
        array([-10.674,  20.384])
    """
    arm, driven, gears = motors(arm, qd, tau, external_torques(arm, q, qd, wrench))
    return composite_accelerations(arm, q, qd, driven, link_friction(arm, qd), wrench, gears)


def composite_accelerations(
    arm: Model,
    q: Array,
    qd: Array,
    driven: Array,
    resisting: Array,
    wrench: Array | None = None,
    gears: Sequence[Gear] = (),
) -> np.ndarray:
    """`forward.accelerations` by the mass matrix."""
    bias = newton_euler(arm, q, qd, scalar.zeros(arm.n), wrench) + resisting
    mass = mass_matrix(arm, q)
    if gears:
        return through_gears(mass, bias - driven, gears)[0]
    return scalar.solve_symmetric(mass, driven - bias)  # (15)

"""Forward dynamics by whichever way takes fewer operations: composite bodies for short arms, articulated ones for long."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armwright.actuators import drive_torque
from armwright.actuators.coupling import shares_of
from armwright.actuators.friction import link_friction
from armwright.dynamics.articulated_body import articulated_accelerations
from armwright.dynamics.composite_body import composite_accelerations
from armwright.dynamics.gears import Gear, motors
from armwright.dynamics.inverse import external_torques
from armwright.model import Model, one_state_with_masses
from armwright.scalar import Array

SHORT = 5  # joints from the base to a body, itself included, on average: a chain of 9. Operations counted on 90 random trees
# and on chains: at 9 joints composite bodies take 1 % fewer, at 10 1 % more, at 14 a fifth, at 30 twice as many.


@one_state_with_masses
def forward_dynamics(arm: Model, q: Array, qd: Array, tau: Array, wrench: Array | None = None) -> np.ndarray:
    """Accelerations that motor torques give, the exact inverse of `inverse_dynamics`.  [WalkerOrin1982] [Featherstone2008]

    Without gear loss  q̈ = M⁻¹ ( tau - C q̇ - g - s - f + Jᵀ wrench ).  With it  M_links q̈ + C q̇ + g + s + f_links - Jᵀ wrench =
    Bᵀ G(tau - n² J_m B q̈ - f_m),  which has one solution; Newton's method finds it (`dynamics.gears`). Friction by loads is that
    of tau and the state.

    By `composite_body` where bodies stand at most `SHORT` joints from the base on average, and where joints follow others,
    motors are coupled or gears lose power; else by `articulated_body`: they agree to rounding.

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        tau: (n,) [N m | N] motor torque referred to the joints, before rotor, gear loss and friction.
        wrench: (6,) [N, N m] force and moment of the environment on the arm at the tip, in base axes.
    Returns:
        qdd: (n,) [rad/s² | m/s²]; not finite where M is singular, NaN where 12 of Newton's steps do not end.
    Raises:
        ModelError: a wrench on an arm that branches and names no tip.
    Example:
        >>> arm = aw.load("two-link")
        >>> aw.forward_dynamics(arm, [0.3, 0.5], [1.0, -0.5], [20.0, 5.0]).round(3)
        array([-10.674,  20.384])
    """
    arm, driven, gears = motors(arm, qd, tau, external_torques(arm, q, qd, wrench))
    return accelerations(arm, q, qd, driven, link_friction(arm, qd), wrench, gears)


def accelerations(
    arm: Model,
    q: Array,
    qd: Array,
    driven: Array,
    resisting: Array,
    wrench: Array | None = None,
    gears: Sequence[Gear] = (),
) -> np.ndarray:
    """Accelerations for torques that reach the joints, torques that resist there, and lossy gears that drive them as well.

    M q̈ = driven - resisting - C q̇ - g - s + Jᵀ wrench + Σ Bᵢᵀ Gᵢ,  by the way that `forward_dynamics` chooses. Friction and gear
    loss of the model itself have no part.

    Args:
        arm: the arm, without the rotors of those gears.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        driven, resisting: (n,) [N m | N].   wrench: (6,) [N, N m] of the environment on the arm at the tip, in base axes.
        gears: from `gears.lossy_gears`.
    Returns:
        qdd: (n,) [rad/s² | m/s²]; not finite where M is singular.
    """
    far = sum(len(arm.path(i)) for i in range(len(arm.bodies))) > SHORT * arm.n
    if far and not gears and arm.mimics is None and not any(shares_of(arm)):
        return articulated_accelerations(arm, q, qd, driven, resisting, wrench)
    return composite_accelerations(arm, q, qd, driven, resisting, wrench, gears)


@one_state_with_masses
def forward_arm(arm: Model, q: Array, qd: Array, u: Array) -> np.ndarray:
    """The report's Forward Arm: drive commands in, accelerations out.  tau by eq. (12), then `forward_dynamics`.

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        u: (n,) [V | A | N m | N], each in the unit of its joint's drive command; no limit is applied.
    Returns:
        qdd: (n,) [rad/s² | m/s²].
    Raises:
        ModelError: a drive without the constants that its command needs.
    Example:
        >>> arm = aw.load("cmu-dd")
        >>> aw.forward_arm(arm, np.zeros(6), np.zeros(6), [8, 12, 8, 4, 2, 1]).round(2)
        array([ 10.01,   5.43,  29.46,  -5.61,  -1.26, -59.94])
    """
    return forward_dynamics(arm, q, qd, drive_torque(arm, qd, u))

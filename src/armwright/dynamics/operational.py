"""The inertia that a frame of the arm shows to the world."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.dynamics.mass_matrix import mass_matrix
from armwright.errors import ModelError
from armwright.kinematics import jacobian
from armwright.model import Model, one_state_with_masses
from armwright.scalar import Array


@one_state_with_masses
def operational_inertia(arm: Model, q: Array, frame: str | None = None) -> np.ndarray:
    """Inertia of the tip or of another frame, the operational space's:  Λ = (J M⁻¹ Jᵀ)⁻¹, rotors included.  [Khatib1987]

    A wrench w at the frame, the arm at rest and nothing else acting, gives it the acceleration Λ⁻¹ w. At a singular
    position Λ⁻¹ has no inverse: entries of Λ grow without bound near it and are huge or not finite there. Where that
    happens, Λ⁻¹ = J M⁻¹ Jᵀ itself is the thing to compute, with `jacobian` and `forward_dynamics_derivatives`.

    Args:
        arm: the model.   q: (n,) [rad | m].   frame: name of a frame of the arm; by default its tip.
    Returns:
        Lambda: (6, 6) symmetric, linear rows first, in base axes; [kg | kg m | kg m²].
    Raises:
        ModelError: no such frame, no tip, or fewer than six joints carry the frame, so that Λ exists nowhere.
    Example:
        >>> arm = aw.load("ur5e")
        >>> aw.operational_inertia(arm, [0.0, -1.0, 1.2, -0.5, 0.8, 0.0]).shape
        (6, 6)
    """
    path = arm.path(arm.frame(frame).body)
    carried = len(path if arm.mimics is None else {arm.mimics.coordinate[i] for i in path})
    if carried < 6:
        place = f"joints that carry {frame or arm.tip!r}"
        raise ModelError(
            "operational_inertia needs more", place=place, value=carried, expected="six or more", file=arm.name
        )
    factors = scalar.factor_symmetric(mass_matrix(arm, q))
    half = scalar.solve_lower(factors, jacobian(arm, q, frame).T)  # Λ⁻¹ = halfᵀ D⁻¹ half
    scaled = half * factors.inverse.reshape(arm.n, 1)
    mobility = scalar.zeros(6, 6)
    for i in range(6):
        for j in range(i + 1):
            mobility[i, j] = half[:, i] @ scaled[:, j]
    return scalar.inverse_factored(scalar.factor_symmetric(mobility))

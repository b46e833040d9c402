"""Centre of mass of the arm."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.errors import ModelError
from armwright.kinematics.forward_kinematics import body_placements
from armwright.model import Model, one_state_with_masses
from armwright.scalar import Array


@one_state_with_masses
def centre_of_mass(arm: Model, q: Array) -> np.ndarray:
    """Centre of mass of all moving links:  p = Σ m p_c / Σ m.  [Featherstone2008]

    Links that stand on the base do not count.

    Args:
        arm: the model.   q: (n,) [rad | m].
    Returns:
        p: (3,) in base axes, from the base's origin [m].
    Raises:
        ModelError: the moving links have no mass.
    Example:
        >>> arm = aw.load("two-link")
        >>> aw.centre_of_mass(arm, [0.3, 0.5]).round(3)
        array([0.78 , 0.322, 0.   ])
    """
    total = sum(body.mass for body in arm.bodies)
    if not scalar.is_symbolic(total) and not total > 0.0:
        raise ModelError(place="mass of the moving links [kg]", value=total, expected="more than 0", file=arm.name)
    placed = body_placements(arm, q)
    first = sum(placed[i].rotation @ body.first_moment + body.mass * placed[i].position for i, body in arm.outward())
    return scalar.array(first * (1.0 / total))

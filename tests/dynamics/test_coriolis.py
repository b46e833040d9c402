"""The Coriolis matrix: Christoffel's symbols of M, and what they are for."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.dynamics import bias_torques, coriolis_matrix, mass_matrix
from physics.arms import NAMES, arm, gradient, random_state


@pytest.mark.sample(8)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(3))
def test_laws(name, seed):
    """C is made of Christoffel's symbols of the traced M, C q̇ are the velocity torques, and Ṁ - 2C is skew."""
    model = arm(name).replace(friction=None, springs=None, gravity=np.zeros(3))
    q, qd, _ = random_state(model, seed)
    (slope,) = gradient("mass_matrix", lambda q: mass_matrix(model, q), q)  # ∂M_ij/∂q_k
    c = coriolis_matrix(arm(name), q, qd)
    size = np.abs(slope).max() * np.abs(qd).max() + 1e-3
    symbols = 0.5 * (slope + slope.transpose(0, 2, 1) - slope.transpose(2, 1, 0))
    np.testing.assert_allclose(c, symbols @ qd, rtol=0, atol=1e-13 * size)
    torques = bias_torques(model, q, qd)
    np.testing.assert_allclose(c @ qd, torques, rtol=0, atol=1e-12 * (size + np.abs(torques).max()))
    skew = slope @ qd - 2.0 * c
    np.testing.assert_allclose(skew, -skew.T, rtol=0, atol=1e-12 * size)

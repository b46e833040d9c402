"""Normal equations by the kernel of base columns against dense products."""

import numpy as np
import pytest

import armwright as aw
from armwright.identification.arm.normal import normal_equations


@pytest.mark.parametrize("name", ["lwa4p", "two-link"])
def test_normal_equations_are_the_dense_products(name):
    arm = aw.load(name)
    q, qd, qdd, tau = np.random.default_rng(0).normal(size=(4, 1500, arm.n))  # more than one block
    weights = np.arange(1.0, arm.n + 1)
    gram = normal_equations(arm)(q, qd, qdd, tau, weights)
    rows = np.concatenate([aw.compile(arm).regressor(q, qd, qdd), tau[:, :, None]], axis=2) * np.sqrt(weights)[:, None]
    rows = rows.reshape(-1, rows.shape[-1])
    np.testing.assert_allclose(gram, rows.T @ rows, atol=1e-11 * np.abs(gram).max())

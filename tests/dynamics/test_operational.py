"""The operational-space inertia."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.dynamics import mass_matrix, operational_inertia
from armwright.errors import ModelError
from armwright.kinematics import jacobian
from physics.arms import arm, random_state
from raises_at import raises_at

SIX = ["cmu-dd", "lwa4p", "panda", "puma560"]


@pytest.mark.parametrize("name", SIX)
@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_inverse_of_the_mobility(name, seed):
    """Λ J M⁻¹ Jᵀ = 1 within 1e-12 of the condition, symmetric; ½ vᵀ Λ v is the least energy that moves the tip with v."""
    model = arm(name)
    q, v, _ = random_state(model, seed)
    j, inertia = jacobian(model, q), operational_inertia(model, q)
    mobility = j @ np.linalg.inv(mass_matrix(model, q)) @ j.T
    assert np.abs(inertia @ mobility - np.eye(6)).max() <= 1e-12 * np.linalg.cond(mobility)
    np.testing.assert_array_equal(inertia, inertia.T)
    tip = j @ v
    assert tip @ inertia @ tip <= v @ mass_matrix(model, q) @ v * (1.0 + 1e-6)


def test_any_frame():
    """The same at a frame that is named."""
    model = arm("panda")
    q = random_state(model, 0)[0]
    frame = model.bodies[-1].link
    moved = model.replace(tip=frame)
    np.testing.assert_array_equal(operational_inertia(model, q, frame), operational_inertia(moved, q))
    assert not np.allclose(operational_inertia(model, q), operational_inertia(moved, q))


def test_fewer_than_six_joints_are_refused():
    """Λ⁻¹ is singular everywhere then."""
    for name, carried in (("two-link", 2), ("workshop", 3)):
        model = arm(name)
        with raises_at(ModelError, f"joints that carry {model.tip!r}", "six", value=carried):
            operational_inertia(model, np.zeros(model.n))


def test_singular_position_shows():
    """A stretched elbow arm cannot give way along its own line: Λ is huge there or not finite."""
    model = arm("lwa4p")
    near = random_state(model, 0)[0]
    with np.errstate(all="ignore"):
        stretched = operational_inertia(model, np.zeros(6))
    assert (
        not np.isfinite(stretched).all()
        or np.abs(stretched).max() > 1e6 * np.abs(operational_inertia(model, near)).max()
    )

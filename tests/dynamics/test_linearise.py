"""The linearised arm: slopes of `forward_arm`."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.dynamics import forward_arm, forward_arm_linearised
from armwright.errors import ModelError
from armwright.model.changes import without_servos
from physics.arms import NAMES, arm, random_state
from physics.differences import assert_slope, differences
from raises_at import raises_at


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(2))
def test_slopes_of_the_state_are_differences(name, seed):
    """A and B of ẋ = (q̇, q̈) within 1e-7, commands in each drive's unit; friction, back EMF and gear loss are in."""
    model = without_servos(arm(name))
    n = model.n
    q, qd, u = random_state(model, seed)
    a, b = forward_arm_linearised(model, q, qd, u)

    def rate(x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[n : 2 * n], forward_arm(model, x[:n], x[n : 2 * n], x[2 * n :])])

    slope = differences(rate, np.concatenate([q, qd, u]))
    assert_slope(a, slope[:, : 2 * n])
    assert_slope(b, slope[:, 2 * n :])
    assert np.array_equal(a[:n], np.eye(2 * n)[n:])
    assert not b[:n].any()


def test_missing_constants_are_named():
    """As `forward_arm` says it."""
    import dataclasses

    model = arm("cmu-dd")
    bare = dataclasses.replace(model.bodies[1], drive=dataclasses.replace(model.bodies[1].drive, resistance=None))
    model = dataclasses.replace(model, bodies=(model.bodies[0], bare, *model.bodies[2:]))
    with raises_at(ModelError, f"{bare.joint}.motor.resistance_ohm"):
        forward_arm_linearised(model, *random_state(model, 0))

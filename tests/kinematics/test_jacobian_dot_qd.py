"""J̇ q̇ against differences and Pinocchio; poses and Jacobians at any frame."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError
from armwright.kinematics import forward_kinematics, jacobian, jacobian_dot_qd
from armwright.model import build_model
from physics.arms import NAMES, all_positions, arm, description, projection, random_state
from physics.differences import differences
from reference.random_trees import random_description


@pytest.mark.parametrize("which", [*NAMES, *range(1, 37, 3)])
def test_rate_of_the_jacobian(which):
    """J̇ q̇ = d/dt J(q + t q̇) q̇ within 1e-9, at the tip and at every other frame."""
    model = arm(which) if isinstance(which, str) else build_model(random_description(which))
    q, qd, _ = random_state(model, 0)
    for frame in (None, *list(model.frames)[:3]):
        expected = differences(lambda t, frame=frame: jacobian(model, q + t[0] * qd, frame) @ qd, np.zeros(1))[:, 0]
        ours = jacobian_dot_qd(model, q, qd, frame)
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-9 * max(1.0, np.abs(expected).max()))


@pytest.mark.sample(13)
@pytest.mark.parametrize("which", [*NAMES, *range(1, 37, 3)])
def test_acceleration_is_pinocchios(which):
    """Pinocchio's classical acceleration of the tip at q̈ = 0."""
    pytest.importorskip("pinocchio", exc_type=ImportError)
    from reference.peers import Pinocchio

    record = description(which) if isinstance(which, str) else random_description(which)
    model = build_model(record)
    q, qd, _ = random_state(model, 1)
    theirs = Pinocchio(record, model.tree.names).jacobian_dot_qd(all_positions(model, q), projection(model) @ qd)
    np.testing.assert_allclose(
        jacobian_dot_qd(model, q, qd), theirs, rtol=0, atol=1e-10 * max(1.0, np.abs(theirs).max())
    )


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["puma560", "workshop"])
def test_any_frame_plain_and_compiled(name):
    """`frame=` is what `replace(tip=...)` gives, in the plain functions and in the kernels; unknown names list what exists."""
    model = arm(name)
    dyn = aw.compile(model)
    q, qd, _ = random_state(model, 2)
    for frame in model.frames:
        moved = model.replace(tip=frame)
        for function, inputs in ((forward_kinematics, (q,)), (jacobian, (q,)), (jacobian_dot_qd, (q, qd))):
            expected = function(moved, *inputs)
            np.testing.assert_array_equal(function(model, *inputs, frame=frame), expected)
            result = getattr(dyn, function.__name__)(*inputs, frame=frame)
            np.testing.assert_allclose(result, expected, rtol=0, atol=1e-12 * max(1.0, np.abs(expected).max()))
    for call in (forward_kinematics, jacobian):
        with pytest.raises(ModelError, match="frame = 'nowhere': "):
            call(model, q, frame="nowhere")

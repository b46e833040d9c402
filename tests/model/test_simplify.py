"""The simplifying steps: another way of telling the same arm, with fewer operations in it."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.kernels.signatures import SIGNATURES
from armwright.model import build_model
from armwright.model.simplify import STEPS, aligned_frames, base_parameters, simplified
from armwright.program import trace
from reference.random_trees import random_description

ARMS = [*aw.builtin_names(), *range(25)]


def arm_of(which) -> aw.Model:
    """A built-in arm by name, or a random tree by its seed."""
    return aw.load(which) if isinstance(which, str) else build_model(random_description(which))


def operations(arm: aw.Model, kernel: str) -> int:
    """Operations of a kernel traced for the arm as it stands."""
    signature = SIGNATURES[kernel]
    inputs = {argument.name: argument.sized(arm) for argument in signature.inputs}
    return sum(
        trace(kernel, lambda *values: signature.function(arm, *values), inputs, ("y",)).operation_counts().values()
    )


@pytest.mark.sample(3)
@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.__name__)
@pytest.mark.parametrize("which", ARMS)
def test_motion_is_unchanged(which, step):
    """Every step by itself keeps torques, mass matrix, kinetic energy and differences of potential energy."""
    arm = arm_of(which)
    same = step(arm)
    rng = np.random.default_rng(0)
    q, qd, qdd = rng.normal(size=(3, arm.n))
    for function, inputs in (
        (aw.inverse_dynamics, (q, qd, qdd)),
        (aw.mass_matrix, (q,)),
        (aw.gravity_torques, (q,)),
        (aw.bias_torques, (q, qd)),
        (aw.kinetic_energy, (q, qd)),
        (lambda arm, q: aw.potential_energy(arm, q) - aw.potential_energy(arm, 0.0 * q), (q,)),
    ):
        expected = np.asarray(function(arm, *inputs))
        assert np.abs(function(same, *inputs) - expected).max() <= 1e-11 * max(1.0, np.abs(expected).max())


@pytest.mark.sample(5)
@pytest.mark.parametrize("which", ARMS)
def test_frames_stay_where_they_are(which):
    """Aligned frames move no named frame."""
    arm = arm_of(which)
    same = aligned_frames(arm)
    q = np.random.default_rng(1).normal(size=arm.n)
    for name in arm.frames:
        expected = aw.forward_kinematics(arm.replace(tip=name), q)
        assert np.allclose(aw.forward_kinematics(same.replace(tip=name), q), expected, rtol=0, atol=1e-12)


@pytest.mark.sample(5)
@pytest.mark.parametrize("which", ARMS)
def test_seven_parameters_are_left(which):
    """Regrouped, a revolute body has no mass, no m c_z and no ∫z² dm; a sliding one has no tensor, a screw no Iyy."""
    for body in base_parameters(arm_of(which)).bodies:
        if not body.kind.slides:
            assert body.mass == 0.0
            assert body.first_moment[2] == 0.0
            xx, yy, zz = np.diagonal(body.inertia)
            assert xx + yy - zz == pytest.approx(0.0, abs=1e-12)
        elif body.kind.turns:
            assert body.inertia[1, 1] == 0.0
        else:
            assert not body.inertia.any()


def test_a_urdf_like_arm_becomes_denavit_hartenberg():
    """Frames turned and slid at random along the axes cost nothing once they are aligned."""
    for name in ("puma560", "lwa4p", "panda", "cmu-dd"):
        arm = aw.load(name).replace(friction=None)
        skewed = skew_frames(arm)
        for kernel in ("inverse_dynamics", "mass_matrix"):
            plain, spoilt = operations(simplified(arm), kernel), operations(skewed, kernel)
            mended = operations(simplified(skewed), kernel)
            assert spoilt > 1.3 * plain
            assert mended <= plain + 8  # angles that are no longer right cost an addition each


def skew_frames(arm: aw.Model) -> aw.Model:
    """The same arm with every body's frame turned about and slid along its own axis by some odd number."""
    from dataclasses import replace

    from armwright.model import BASE
    from armwright.model.simplify import _reframed
    from armwright.spatial import Placement, rotation_z

    rng = np.random.default_rng(2)
    odd = [Placement(rotation_z(a), np.array([0.0, 0.0, s])) for a, s in rng.uniform(0.1, 0.9, (arm.n, 2))]
    bodies = [_reframed(body, odd[i]) for i, body in enumerate(arm.bodies)]
    bodies = [
        body if body.parent == BASE else replace(body, placement=odd[body.parent].inverse() @ body.placement)
        for body in bodies
    ]
    return replace(arm, bodies=tuple(bodies), frames={}, tip=None)


@pytest.mark.parametrize(
    ("name", "products", "sums"),
    [("puma560", 200, 178), ("lwa4p", 201, 181), ("cmu-dd", 184, 157), ("panda", 303, 289)],
)
def test_counts_of_inverse_dynamics(name, products, sums):
    """Khalil and Kleinfinger count 425 and 369 for a general 6R, a code generator 494/402 for the PUMA."""
    arm = simplified(aw.load(name).replace(friction=None))
    inputs = dict.fromkeys(("q", "qd", "qdd"), (arm.n,))
    count = trace("id", lambda *values: aw.inverse_dynamics(arm, *values), inputs, ("tau",)).operation_counts()
    assert count["MUL"] + count["SQ"] <= products
    assert count["ADD"] + count["SUB"] + count["TWICE"] <= sums

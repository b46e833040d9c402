"""Articulated bodies on every arm, regrouped or not, and in as few operations as the literature has them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from armwright import scalar
from armwright.dynamics import articulated_body, composite_body, mass_matrix
from armwright.dynamics.articulated_body import articulated_shares
from armwright.joint_kinds import Prismatic, Revolute
from armwright.kinematics.axial_motion import AxialMotion
from armwright.kinematics.joint_motion import joint_motions
from armwright.model import Model, build_model
from armwright.model.simplify import base_parameters, simplified
from armwright.program import interpret, trace
from armwright.program.passes import optimised
from physics.arms import FREE, arm
from reference.chains import chain
from reference.random_trees import random_description, random_position


def model_of(which: str | int) -> Model:
    """A named arm, or a random tree by its seed, without gear loss."""
    model = arm(which) if isinstance(which, str) else build_model(random_description(which))
    return model.replace(efficiency=None)


def pivots(model: Model, q: np.ndarray) -> np.ndarray:
    """D of every joint."""
    axial = [
        AxialMotion(body, motion, q[i])
        for i, (body, motion) in enumerate(zip(model.bodies, joint_motions(model, q), strict=True))
    ]
    d = articulated_shares(model, axial)[1]
    return np.array([d[i] for i in range(model.n)])


@pytest.mark.parametrize("which", [*FREE, *range(200)])
@pytest.mark.sample(7)
def test_regrouped_bodies_serve_as_well(which):
    """D > 0 though no regrouped body could exist: D are pivots of M, which is the same; and so are the accelerations."""
    model = model_of(which)
    rng = np.random.default_rng(0)
    q, (qd, tau) = random_position(model, rng), rng.normal(size=(2, model.n))
    for same in (model, base_parameters(model), simplified(model)):
        matrix = mass_matrix(same, q)
        # pivots, the tips eliminated first
        expected = [1.0 / np.linalg.inv(matrix[i:, i:])[0, 0] for i in range(model.n)]
        d, condition = pivots(same, q), np.linalg.cond(matrix)
        assert (d > 0.0).all()
        np.testing.assert_allclose(d, expected, rtol=1e-13 * condition)
        qdd = composite_body(same, q, qd, tau)
        error = np.abs(articulated_body(same, q, qd, tau) - qdd).max()
        assert error <= 1e-13 * condition * max(1.0, np.abs(qdd).max())


@pytest.mark.parametrize("which", ["puma560", "workshop", 3, 30])
def test_geometry_may_be_symbols(which):
    """Traced with every placement left open, as where lengths vary: the same accelerations."""
    model = model_of(which)
    rng = np.random.default_rng(1)
    q, (qd, tau) = random_position(model, rng), rng.normal(size=(2, model.n))
    rotations = np.array([body.placement.rotation for body in model.bodies])
    positions = np.array([body.placement.position for body in model.bodies])

    def accelerations(rotations, positions):
        bodies = tuple(
            dataclasses.replace(body, placement=dataclasses.replace(body.placement, rotation=r, position=p))
            for body, r, p in zip(model.bodies, rotations, positions, strict=True)
        )
        return articulated_body(dataclasses.replace(model, bodies=bodies), q, qd, tau)

    program = trace("open", accelerations, {"r": rotations.shape, "p": positions.shape}, ("qdd",))
    expected = articulated_body(model, q, qd, tau)
    np.testing.assert_allclose(
        interpret(program, rotations, positions), expected, rtol=0, atol=1e-9 * np.abs(expected).max()
    )


@pytest.mark.sample(1)
@pytest.mark.parametrize(("straight", "most"), [(False, 445), (True, 330)])
def test_operations_per_joint(straight, most):
    """Brandl, Johanni and Otter take 250 products and 220 sums a joint, without a rotor and with frames as ours."""
    counts = []
    for n in (12, 13, 14, 15):
        model = simplified(chain(n, straight=straight))
        inputs: dict[str, tuple[int, ...]] = dict.fromkeys(("q", "qd", "tau"), (n,))
        program = trace("aba", lambda *x, model=model: articulated_body(model, *x), inputs, ("qdd",))
        counts.append(program.operation_counts().total())
    assert (counts[3] - counts[0]) / 3 <= most


def test_pieces_of_equal_length_are_equal_work():
    """Linear in the number of joints: each three more joints of a periodic chain take the same operations."""

    def operations(n: int) -> int:
        model = simplified(chain(n, straight=True))
        inputs: dict[str, tuple[int, ...]] = dict.fromkeys(("q", "qd", "tau"), (n,))
        return len(optimised(trace("aba", lambda *x: articulated_body(model, *x), inputs, ("qdd",)).instructions))

    short, middle, long = (operations(n) for n in (9, 15, 21))
    assert long - middle == pytest.approx(middle - short, rel=0.02)


def test_no_joint_row_is_left_without_a_rotor():
    """What a joint hands on takes no force along it: exactly 0, so nothing is computed with it."""
    model = arm("puma560").replace(rotors=None)
    for kind, rows in ((Revolute(), ("coupling", "angular")), (Prismatic(), ("linear",))):
        body = model.bodies[3]
        inertia = _rigid(body)
        u, un = inertia.column(kind)
        d = kind.project(un, u)[2]
        left = inertia.without(kind, (u / d, un / d), 0.0)
        for name in rows:
            assert not getattr(left, name)[2].any()


def _rigid(body):
    from armwright.spatial import ArticulatedInertia

    return ArticulatedInertia.rigid(body.mass, body.first_moment, scalar.array(body.inertia))

"""The regressors: times the parameters they are the torques, and their rank is what the literature says."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.actuators import friction_torques
from armwright.dynamics import inverse_dynamics, regressor, regressor_drive, spring_torques
from armwright.errors import ModelError
from armwright.model import build_model
from armwright.model.simplify import aligned_frames
from armwright.spatial import inertia_about_origin
from dynamics.test_gears import coupled
from physics.arms import NAMES, arm, description, has_friction_by_loads, projection, random_state, traced
from raises_at import raises_at
from reference.random_trees import random_description

ARMS = [*NAMES, *range(1, 37, 3)]


def arm_of(which):
    """A built-in arm by name, or a random tree by its seed."""
    return arm(which) if isinstance(which, str) else build_model(random_description(which))


@pytest.mark.sample(3)
@pytest.mark.parametrize("which", ARMS)
def test_regressor_times_parameters_is_inverse_dynamics(which):
    """tau = Y π + Y_d π_d + s within 1e-10, with rotors and every friction law but that by loads, where gears lose nothing."""
    model = arm_of(which).replace(efficiency=None)
    model = model.replace(friction=None) if has_friction_by_loads(model) else model
    for seed in range(3):
        q, qd, qdd = random_state(model, seed)
        tau = inverse_dynamics(model, q, qd, qdd)
        links = regressor(model, q, qd, qdd) @ model.inertial_parameters
        drive = regressor_drive(model, qd, qdd) @ model.drive_parameters
        assert links + drive + spring_torques(model, q) == pytest.approx(tau, rel=0, abs=1e-10 * abs(tau).max())
        g, armature = projection(model), [body.drive.armature for body in model.bodies]
        rotors = g.T @ (armature * (g @ qdd))
        assert drive == pytest.approx(friction_torques(model, qd) + rotors, rel=0, abs=1e-12 * abs(tau).max())


def test_coupled_motors_are_refused_as_their_parameters_are():
    """Their rotors and friction lie between joints: no column of one joint holds them."""
    model = coupled(arm("lwa4p"), 0.5)
    with pytest.raises(ModelError) as parameters:
        _ = model.drive_parameters
    with pytest.raises(ModelError) as refused:
        regressor_drive(model, np.ones(6), np.ones(6))
    assert refused.value.problems == parameters.value.problems
    with raises_at(ModelError, "motor.coupling", "'joint5'"):
        aw.compile(model).regressor_drive(np.ones(6), np.ones(6))
    assert regressor(model, np.ones(6), np.ones(6), np.ones(6)).shape == (6, 60)


@pytest.mark.sample(1)
@pytest.mark.parametrize(("name", "rank"), [("puma560", 36), ("lwa4p", 36), ("panda", 43)])
def test_rank_is_the_number_of_base_parameters(name, rank):
    """As many parameters as decide the motion: 36 of 60, 43 of 70, with a gap of ten decades below. [GautierKhalil1990]"""
    model = arm(name)
    rows = np.concatenate([regressor(model, *random_state(model, seed)) for seed in range(25)])
    sizes = np.linalg.svd(rows, compute_uv=False)
    assert sizes[rank - 1] > 1e-6 * sizes[0]
    assert sizes[rank:].max() < 1e-13 * sizes[0]


@pytest.mark.parametrize("name", NAMES)
def test_parameters_are_those_of_the_record(name):
    """Mass, first moment and tensor about the link's own origin, in its own axes, as the file has them; fixed links merged."""
    model, record = arm(name), description(name)
    merged = {joint.parent for joint in record.joints if joint.type == "fixed"}
    for body, parameters in zip(model.bodies, model.inertial_parameters.reshape(-1, 10), strict=True):
        link = record.link(body.link)
        if link.name in merged:
            continue
        mass, com = float(link.mass_kg), np.array(link.com_m.value)
        tensor = inertia_about_origin(mass, com, link.inertia_kg_m2.matrix())
        expected = [mass, *(mass * com), *(tensor[i, j] for i in range(3) for j in range(i, 3))]
        assert parameters == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.sample(4)
@pytest.mark.parametrize("which", ARMS)
def test_frames_inside_do_not_show(which):
    """Columns and parameters belong to the link's frame, wherever the body's own frame was turned and slid to."""
    model = arm_of(which)
    other = aligned_frames(model)
    state = random_state(model, 5)
    expected = regressor(model, *state)
    assert np.abs(regressor(other, *state) - expected).max() <= 1e-12 * np.abs(expected).max()
    difference = other.inertial_parameters - model.inertial_parameters
    assert np.abs(difference).max() <= 1e-12 * np.abs(model.inertial_parameters).max()


@pytest.mark.parametrize("name", NAMES)
def test_body_with_its_own_parameters_is_itself(name):
    """`with_inertial_parameters` undoes `inertial_parameters`."""
    for body in arm(name).bodies:
        again = body.with_inertial_parameters(body.inertial_parameters)
        assert again.mass == body.mass
        np.testing.assert_allclose(again.first_moment, body.first_moment, rtol=0, atol=1e-13)
        np.testing.assert_allclose(again.inertia, body.inertia, rtol=0, atol=1e-13)


def test_traced_regressor_costs_less_than_the_literatures():
    """A code generator needs 979 products and 686 sums for the PUMA 560, 841 and 568 for the LWA-4P."""
    from armwright.program import trace

    for name, products, sums in (("puma560", 530, 470), ("lwa4p", 540, 500)):
        model = aligned_frames(arm(name))
        inputs = dict.fromkeys(("q", "qd", "qdd"), (model.n,))
        count = trace("y", lambda *x, model=model: regressor(model, *x), inputs, ("Y",)).operation_counts()
        assert count["MUL"] + count["SQ"] <= products
        assert count["ADD"] + count["SUB"] + count["TWICE"] <= sums


def test_traced_is_float():
    """Tracing differentiates the same way."""
    model = arm("workshop")
    q, qd, qdd = random_state(model, 2)
    y = traced("y", lambda *x: regressor(model, *x), q, qd, qdd)
    np.testing.assert_allclose(y, regressor(model, q, qd, qdd), rtol=0, atol=1e-12 * np.abs(y).max())

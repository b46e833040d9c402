"""The centre of mass, against the links one by one and against Pinocchio."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armwright.dynamics import centre_of_mass, energy, kinetic_energy, potential_energy
from armwright.errors import ModelError
from armwright.kinematics.forward_kinematics import body_placements
from armwright.model import build_model
from physics.arms import NAMES, all_positions, arm, description, random_state
from raises_at import raises_at
from reference.random_trees import random_description


@pytest.mark.parametrize("name", NAMES)
def test_mean_of_the_bodies(name):
    """Σ m p_c / Σ m, and the potential energy is that of the whole mass there."""
    model = arm(name)
    q, qd, _ = random_state(model, 0)
    placed = body_placements(model, q)
    masses = [body.mass for body in model.bodies]
    points = [placed[i].point(body.com) for i, body in model.outward()]
    p = centre_of_mass(model, q)
    np.testing.assert_allclose(p, np.average(points, axis=0, weights=masses), rtol=0, atol=1e-14)
    assert energy(model, q, qd) == (kinetic_energy(model, q, qd), potential_energy(model, q))
    height = potential_energy(model.replace(springs=None), q)
    assert height == pytest.approx(-sum(masses) * model.gravity @ p)


@pytest.mark.parametrize("which", [*NAMES, *range(1, 37, 3)])
def test_pinocchios(which):
    """Within 1e-12 m."""
    pytest.importorskip("pinocchio", exc_type=ImportError)
    from reference.peers import Pinocchio

    record = description(which) if isinstance(which, str) else random_description(which)
    model = build_model(record)
    q = random_state(model, 1)[0]
    theirs = Pinocchio(record, model.tree.names).centre_of_mass(all_positions(model, q))
    np.testing.assert_allclose(centre_of_mass(model, q), theirs, atol=1e-12)


def test_no_mass_has_no_centre():
    """An error, not NaN."""
    model = arm("two-link")
    model = replace(model, bodies=tuple(body.with_inertial_parameters(np.zeros(10)) for body in model.bodies))
    with raises_at(ModelError, "mass of the moving links [kg]", value=0.0):
        centre_of_mass(model, np.zeros(2))

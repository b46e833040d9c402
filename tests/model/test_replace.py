"""Variants of an arm by `replace`: the arm itself stays as it is."""

from __future__ import annotations

import copy
import dataclasses
import pickle

import numpy as np
import pytest

from armwright.actuators import friction_torques
from armwright.dynamics import gravity_torques, inverse_dynamics, mass_matrix
from armwright.dynamics.gears import gear_losses
from armwright.errors import ModelError
from armwright.kinematics import forward_kinematics
from physics.arms import NAMES, arm, projection, random_state
from raises_at import raises_at


@pytest.mark.parametrize("name", NAMES)
def test_what_is_taken_away_is_away(name):
    """Without friction, rotors and gear loss only the links' mechanics is left, and the arm keeps its own."""
    model = arm(name)
    q, qd, qdd = random_state(model, 0)
    before = inverse_dynamics(model, q, qd, qdd)
    bare = model.replace(friction=None, rotors=None, efficiency=None)
    assert not friction_torques(bare, qd).any()
    assert gear_losses(bare, qd) == [None] * bare.n
    g = projection(model)
    rotors = g.T @ np.diag([body.drive.armature for body in model.bodies]) @ g
    np.testing.assert_allclose(mass_matrix(model, q), mass_matrix(bare, q) + rotors, rtol=1e-14, atol=1e-14)
    np.testing.assert_array_equal(inverse_dynamics(model, q, qd, qdd), before)


def test_gravity():
    """Another gravity, or none; three finite numbers."""
    model = arm("lwa4p")
    q = random_state(model, 0)[0]
    np.testing.assert_allclose(gravity_torques(model.replace(gravity=-model.gravity), q), -gravity_torques(model, q))
    assert not gravity_torques(model.replace(gravity=[0, 0, 0]), q).any()
    for wrong in ([0, 0], 9.81, [0, 0, np.nan], [0, 0, np.inf]):
        with raises_at(ModelError, "replace.gravity", r"three.* \[m/s²\]"):
            model.replace(gravity=wrong)


def test_tip():
    """Another frame of the record as tip; an unknown one suggests the nearest."""
    model = arm("workshop")
    q = random_state(model, 0)[0]
    at_hand = forward_kinematics(model.replace(tip="hand"), q)
    assert np.linalg.norm(at_hand[:3, 3] - forward_kinematics(model, q)[:3, 3]) == pytest.approx(
        np.linalg.norm([0.02, 0.03, 0.15])
    )
    np.testing.assert_array_equal(forward_kinematics(model.replace(tip="base"), q), np.eye(4))
    with raises_at(ModelError, "frame", r"tool\?", value="tol"):
        model.replace(tip="tol")


def test_unknown_changes_are_refused():
    """A misspelt change suggests the nearest; a value that is not offered says what is."""
    with raises_at(ModelError, "replace", r"\bfriction\b", value="frictions"):
        arm("panda").replace(frictions=None)
    with pytest.raises(ModelError, match="expected None") as error:
        arm("panda").replace(friction=0.0)
    assert (error.value.place, error.value.value) == ("replace.friction", 0.0)


def test_frozen():
    """A model is data that no one can change in place."""
    with pytest.raises(dataclasses.FrozenInstanceError):
        arm("panda").tip = "link3"  # type: ignore[misc]
    with pytest.raises(dataclasses.FrozenInstanceError):
        arm("panda").bodies[0].mass = 2.0  # type: ignore[misc]


def test_frozen_inside():
    """Neither its arrays, nor those of its bodies and frames, nor its frames can be changed; all hold floats."""
    model = arm("panda")
    arrays = [model.gravity]
    for body in model.bodies:
        arrays += [body.first_moment, body.inertia]
    for placed in (*model.bodies, *model.frames.values()):
        arrays += [placed.placement.rotation, placed.placement.position]
    for array in arrays:
        assert array.dtype == float
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 5.0
    with pytest.raises(AttributeError):
        model.frames.pop("base")  # type: ignore[attr-defined]
    with pytest.raises(TypeError):
        model.frames["base"] = model.frames[model.tip]  # type: ignore[index]


@pytest.mark.parametrize("again", [copy.deepcopy, lambda model: pickle.loads(pickle.dumps(model))])
@pytest.mark.parametrize("name", NAMES)
def test_copies_are_the_same_arm(again, name):
    """Deep copies and pickles move alike, are as frozen, and keep the record."""
    model = arm(name)
    other = again(model)
    state = random_state(model, 0)
    np.testing.assert_array_equal(inverse_dynamics(other, *state), inverse_dynamics(model, *state))
    assert (other.names, other.tip, other.warnings) == (model.names, model.tip, model.warnings)
    assert list(other.frames) == list(model.frames)
    assert other.description == model.description
    with pytest.raises(ValueError, match="read-only"):
        other.bodies[0].inertia[0, 0] = 5.0


@pytest.mark.parametrize(
    ("change", "value", "place"),
    [
        ("tip", 3, "frame"),
        ("tip", ["tool"], "frame"),
        ("gravity", [1, 2, "a"], "replace.gravity"),
        ("gravity", [[1], [2, 3], 4], "replace.gravity"),
        ("gravity", None, "replace.gravity"),
    ],
)
def test_values_of_a_wrong_kind_are_refused(change, value, place):
    with pytest.raises(ModelError) as error:
        arm("two-link").replace(**{change: value})
    assert (error.value.place, error.value.value) == (place, value)

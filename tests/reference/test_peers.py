"""Against Pinocchio and MuJoCo: the same arms, built there from the description by other code than ours.

Agreement is asked for within 1e-10 of the largest entry, with the condition of M below 1e6; friction and gear loss,
which the peers do not have, are taken away, rotors' inertia stays.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest

from armwright.description import RobotDescription, builtin_names, read_description
from armwright.dynamics import articulated_body, forward_dynamics, gravity_torques, inverse_dynamics, mass_matrix
from armwright.kinematics import forward_kinematics, jacobian
from armwright.model import Model, build_model
from armwright.program import Program, interpret, trace
from reference.peers import MuJoCo, Pinocchio
from reference.random_trees import WORST_CONDITION, joint_count, random_description, random_position

TREES = 200
STATES = 3
TOLERANCE = 1e-10


def assert_agree(ours: np.ndarray, theirs: np.ndarray) -> None:
    """Max-norm relative."""
    assert ours.shape == theirs.shape
    assert np.isfinite(theirs).all()
    assert np.abs(ours - theirs).max() <= TOLERANCE * np.abs(theirs).max()


@pytest.fixture
def pinocchio():
    """Pinocchio for a description, or a skip that says what to install."""
    pytest.importorskip("pinocchio", exc_type=ImportError)
    return Pinocchio


@pytest.fixture
def mujoco():
    """MuJoCo for a description, or a skip that says what to install."""
    pytest.importorskip("mujoco", reason="MuJoCo is the oracle here: pip install mujoco")
    return MuJoCo


def lossless(description: RobotDescription) -> Model:
    """Friction and gear loss away, rotors on."""
    return build_model(description).replace(friction=None, efficiency=None)


def random_states(model: Model, seed: int) -> list[np.ndarray]:
    """(q, qd, qdd or tau) a few times, at positions where M is well conditioned."""
    rng = np.random.default_rng([seed, 1])
    states: list[np.ndarray] = []
    while len(states) < STATES:
        q = random_position(model, rng)
        if np.linalg.cond(mass_matrix(model, q)) < WORST_CONDITION:
            states.append(np.array([q, rng.normal(size=model.n), rng.normal(size=model.n)]))
    return states


def everything(model: Model) -> Program:
    """All that is compared with the peers, as one traced program of (q, qd, x, wrench); x is qdd or tau."""

    def compute(q, qd, x, wrench):
        return (
            inverse_dynamics(model, q, qd, x, wrench),
            forward_dynamics(model, q, qd, x, wrench),
            mass_matrix(model, q),
            forward_kinematics(model, q),
            jacobian(model, q),
        )

    n = model.n
    shapes = {"q": (n,), "qd": (n,), "x": (n,), "wrench": (6,)}
    return trace("everything", compute, shapes, ("inverse", "forward", "mass", "pose", "jac"))


@pytest.mark.parametrize("seed", range(TREES))
@pytest.mark.sample(2)
def test_random_trees_against_pinocchio(pinocchio, seed):
    """Traced dynamics and kinematics of trees, with a wrench, are Pinocchio's RNEA, ABA, CRBA, pose and Jacobian."""
    compare_traced(pinocchio, random_description(seed), seed)


@pytest.mark.parametrize("seed", range(0, TREES, 5))
@pytest.mark.sample(3)
def test_trees_with_screws_against_pinocchio(pinocchio, seed):
    """The same of trees with joints that turn and slide at once."""
    compare_traced(pinocchio, random_description(seed, screws=True), seed)


def compare_traced(pinocchio: type[Pinocchio], description: RobotDescription, seed: int) -> None:
    """Asserts that traced dynamics and kinematics are Pinocchio's."""
    model = lossless(description)
    assert model.n == joint_count(seed)
    program, peer = everything(model), pinocchio(description, model.names)
    wrench = np.random.default_rng([seed, 2]).normal(size=6)
    for q, qd, x in random_states(model, seed):
        inverse, forward, mass, pose, jac = interpret(program, q, qd, x, wrench)
        assert np.linalg.cond(peer.mass_matrix(q)) < WORST_CONDITION
        assert_agree(inverse, peer.inverse_dynamics(q, qd, x, wrench))
        assert_agree(forward, peer.forward_dynamics(q, qd, x, wrench))
        assert_agree(mass, peer.mass_matrix(q))
        assert_agree(pose, peer.forward_kinematics(q))
        assert_agree(jac, peer.jacobian(q))


@pytest.mark.parametrize("seed", range(TREES))
@pytest.mark.sample(7)
def test_random_trees_against_mujoco(mujoco, seed):
    """Float dynamics and kinematics of trees are MuJoCo's: a peer that shares no formula with Pinocchio."""
    description = random_description(seed)
    model = lossless(description)
    compare_floats(model, mujoco(description, model.names), seed)


@pytest.mark.sample(13)
@pytest.mark.parametrize("seed", range(0, TREES, 10))
@pytest.mark.parametrize("screws", [False, True])
def test_articulated_bodies_of_random_trees_against_pinocchio(pinocchio, seed, screws):
    """Our articulated bodies, on floats and with a wrench, give Pinocchio's accelerations."""
    description = random_description(seed, screws)
    model = lossless(description)
    peer = pinocchio(description, model.names)
    wrench = np.random.default_rng([seed, 2]).normal(size=6)
    for q, qd, tau in random_states(model, seed):
        assert_agree(articulated_body(model, q, qd, tau, wrench), peer.forward_dynamics(q, qd, tau, wrench))


def compare_floats(model: Model, peer: Pinocchio | MuJoCo, seed: int) -> None:
    """The float functions against a peer's, without a wrench."""
    for q, qd, x in random_states(model, seed):
        assert_agree(inverse_dynamics(model, q, qd, x), peer.inverse_dynamics(q, qd, x))
        assert_agree(forward_dynamics(model, q, qd, x), peer.forward_dynamics(q, qd, x))
        assert_agree(articulated_body(model, q, qd, x), peer.forward_dynamics(q, qd, x))
        assert_agree(gravity_torques(model, q), peer.inverse_dynamics(q, 0 * q, 0 * q))
        assert_agree(mass_matrix(model, q), peer.mass_matrix(q))
        assert_agree(forward_kinematics(model, q), peer.forward_kinematics(q))
        assert_agree(jacobian(model, q), peer.jacobian(q))


@functools.cache
def possible_puma560() -> RobotDescription:
    """The PUMA with numbers in place of two links' published ones that no body can have and MuJoCo refuses."""
    puma = read_description("puma560")
    possible = {
        "link1": {"mass_kg": 13.0, "inertia_kg_m2": {"xx": 1.1, "xy": 0, "xz": 0, "yy": 0.35, "yz": 0, "zz": 1.1}},
        "link3": {"inertia_kg_m2": {"xx": 0.066, "xy": 0, "xz": 0, "yy": 0.066, "yz": 0, "zz": 0.0125}},
    }
    data = puma.model_dump(exclude_unset=True)
    for link in data["links"]:
        if link["name"] in possible:
            link.update(possible[link["name"]], accept_impossible=None)
    return RobotDescription.model_validate(data)


@pytest.mark.parametrize("name", builtin_names())
def test_builtin_arms_against_pinocchio(pinocchio, name):
    """Classic DH, modified DH and explicit frames of real arms, the published PUMA included, agree with Pinocchio."""
    description = read_description(name)
    model = lossless(description)
    compare_floats(model, pinocchio(description, model.names), 0)


@pytest.mark.parametrize("name", ["lwa4p", "panda", "puma560", "cmu-dd", "two-link"])
def test_builtin_arms_against_mujoco(mujoco, name):
    """Real arms agree with MuJoCo; `puma560` with possible inertias of links 1 and 3, as MuJoCo refuses the published."""
    description = possible_puma560() if name == "puma560" else read_description(name)
    model = lossless(description)
    assert not any("impossible" in warning for warning in model.warnings)
    compare_floats(model, mujoco(description, model.names), 0)


@pytest.mark.parametrize("name", builtin_names())
def test_wrench_on_builtin_arms_against_pinocchio(pinocchio, name):
    """A force and moment of the environment at the tip, in base axes, does what Pinocchio's external forces do."""
    description = read_description(name)
    model = lossless(description)
    peer = pinocchio(description, model.names)
    rng = np.random.default_rng(3)
    for q, qd, x in random_states(model, 1):
        wrench = rng.normal(scale=20.0, size=6)
        assert_agree(inverse_dynamics(model, q, qd, x, wrench), peer.inverse_dynamics(q, qd, x, wrench))
        assert_agree(forward_dynamics(model, q, qd, x, wrench), peer.forward_dynamics(q, qd, x, wrench))
        assert_agree(articulated_body(model, q, qd, x, wrench), peer.forward_dynamics(q, qd, x, wrench))


@pytest.mark.sample(2)
@pytest.mark.parametrize("seed", range(0, 55, 11))
def test_random_trees_have_what_they_are_for(seed):
    """The trees branch, slide, turn, carry rotors and fixed links: else the comparisons above show little."""
    assert {joint_count(k) for k in range(TREES)} == set(range(1, 31))
    kinds, drives, parents = set(), 0, []
    for k in range(seed, seed + 11):
        description = random_description(k)
        kinds |= {joint.type for joint in description.joints}
        drives += sum(body.drive.armature > 0 for body in build_model(description).bodies)
        parents += [joint.parent for joint in description.joints if joint.parent != "base"]
    assert kinds == {"revolute", "prismatic", "fixed"}
    assert drives > 0
    assert len(set(parents)) < len(parents)

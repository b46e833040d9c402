"""The 69 robots of `example-robot-data` against Pinocchio, which reads the same files with other code than ours."""

from __future__ import annotations

import sys
from collections import Counter
from typing import Any

import numpy as np
import pytest

from armwright.description.urdf import read_urdf
from armwright.dynamics import inverse_dynamics, mass_matrix
from armwright.model import build_model
from reference.example_robots import Verdict, examined, robot_files

TOLERANCE = 1e-9
ROBOTS = 69
AGREE = 66

pytestmark = [
    pytest.mark.study,
    pytest.mark.skipif(not robot_files(), reason="needs the robots: pip install example-robot-data"),
]

# Nothing of these moves or is there: the only ones that are refused for good.
REFUSED = {
    "hector_description/robots/quadrotor_base.urdf": "expected at least one joint that moves",
    "iris_description/robots/iris_simple.urdf": "expected at least one joint that moves",
    "ur_description/urdf/ur3.urdf": "<robot> name: missing",
}


@pytest.fixture(scope="module")
def verdicts() -> dict[str, Verdict]:
    """All robots, examined once."""
    pytest.importorskip("pinocchio", exc_type=ImportError)
    return {name: examined(path) for name, path in robot_files().items()}


def test_all_that_move_agree_with_pinocchio(verdicts):
    assert len(verdicts) == ROBOTS
    agree = [name for name, verdict in verdicts.items() if verdict.error is not None and verdict.error <= TOLERANCE]
    wrong = {name: v.error for name, v in verdicts.items() if v.error is not None and not v.error <= TOLERANCE}
    assert not wrong
    assert len(agree) == AGREE
    assert {*agree, *REFUSED} == set(verdicts)


def test_what_is_refused_is_refused_truly(verdicts):
    """For good: nothing moves. As it stands: joints that mimic none, or an inertia whose link and margin are named."""
    for name, verdict in verdicts.items():
        if name in REFUSED:
            assert verdict.refused is not None
            assert REFUSED[name] in verdict.refused
        elif verdict.refused is not None:
            assert ("does not move or is not there" in verdict.refused) == verdict.mimic
            text = verdict.refused if not verdict.mimic else " ".join(verdict.arm.warnings if verdict.arm else ())
            assert ("impossible inertia" in text) == verdict.impossible
            assert all(line.startswith("  ") for line in verdict.refused.splitlines()[1:])
    kinds = Counter((v.refused is not None, v.mimic, v.impossible) for v in verdicts.values())
    assert kinds[False, False, False] + len(REFUSED) < ROBOTS  # some of the files are wrong
    assert kinds[False, False, False] >= 35  # and most are not


def test_links_without_inertia_say_so(verdicts):
    arm = verdicts["human_description/robots/human.urdf"].arm
    assert arm is not None
    assert any("left_foot_virtual" in warning and "massless" in warning for warning in arm.warnings)


def test_the_old_ur5_wrists_are_named(verdicts):
    for file in ("ur5_robot", "ur5_gripper", "ur5_joint_limited_robot"):
        arm = verdicts[f"ur_description/urdf/{file}.urdf"].arm
        assert arm is not None
        found = [warning for warning in arm.warnings if "old UR5" in warning]
        assert len(found) == 2
        assert "'wrist_1_link', 'wrist_2_link'" in found[0]
        assert "256 times too large" in found[1]
    for file in ("ur3_robot", "ur10_robot"):
        arm = verdicts[f"ur_description/urdf/{file}.urdf"].arm
        assert arm is not None
        assert not [warning for warning in arm.warnings if "no tip is named" not in warning]


def test_no_mesh_is_opened():
    """Reading finds meshes by their names."""
    path = robot_files()["solo_description/robots/solo12.urdf"].resolve()
    opened: set[str] = set()
    watching = [True]
    sys.addaudithook(lambda event, given: opened.add(str(given[0])) if watching and event == "open" else None)
    description = read_urdf(path)
    watching.clear()  # hooks stay
    assert {file for file in opened if str(path.parents[2]) in file} == {str(path)}
    files = [visual.solid.file for link in description.links for visual in link.visuals]
    assert files
    assert all(path.parents[2].as_posix() in file for file in files)


@pytest.mark.parametrize(("mimic", "joints"), [("coupled", 8), ("independent", 9), ("fixed", 8)])
def test_mimic_joints(mimic, joints):
    path = robot_files()["panda_description/urdf/panda.urdf"]
    moving = [joint.name for joint in read_urdf(path, mimic=mimic).joints if joint.type != "fixed"]
    assert ("panda_finger_joint2" in moving) == (mimic != "fixed")
    assert "panda_finger_joint1" in moving
    arm = build_model(read_urdf(path, mimic=mimic))
    assert arm.n == joints
    assert "panda_finger_joint1" in arm.names
    assert (arm.mimics is not None) == (mimic == "coupled")


COUPLED = {  # coordinates, joints that move
    "baxter_description/urdf/baxter.urdf": (17, 19),
    "panda_description/urdf/panda.urdf": (8, 9),
    "panda_description/urdf/panda_collision.urdf": (8, 9),
    "pr2_description/urdf/pr2.urdf": (20, 30),
    "romeo_description/urdf/romeo.urdf": (33, 55),
    "talos_data/robots/talos_full_v2.urdf": (32, 44),
    "talos_data/robots/talos_full_v2_box.urdf": (32, 44),
    "tiago_pro_description/robots/tiago_pro.urdf": (23, 33),
}


def test_robots_with_mimics(verdicts):
    """All of them as their files say; one mimics a joint that is not there, and says so with file and line."""
    found = {name: v.arm for name, v in verdicts.items() if v.arm is not None and v.arm.mimics is not None}
    assert {name: (arm.n, arm.tree.n) for name, arm in found.items()} == COUPLED
    assert [name for name, v in verdicts.items() if v.mimic] == ["alex_description/urdf/alex_psyonic_hands.urdf"]
    refused = verdicts["alex_description/urdf/alex_psyonic_hands.urdf"].refused
    assert refused is not None
    assert "joint 'Left_index_q2' <mimic joint> = 'index_q1'" in refused


@pytest.mark.parametrize("file", ["panda_description/urdf/panda.urdf", "tiago_pro_description/robots/tiago_pro.urdf"])
def test_pinocchios_own_mimics(file):
    """Pinocchio reading the mimics itself: same coordinates, same torques and inertia."""
    pin = pytest.importorskip("pinocchio", exc_type=ImportError)
    path = robot_files()[file]
    theirs: Any = pin.buildModelFromUrdf(str(path), mimic=True)
    data = theirs.createData()
    ours = build_model(read_urdf(path)).replace(friction=None, rotors=None, gravity=theirs.gravity.linear)
    assert theirs.nv == ours.n
    joints = [theirs.joints[theirs.getJointId(name)] for name in ours.names]
    at = [joint.idx_v for joint in joints]
    for seed in range(3):
        states = np.random.default_rng(seed).normal(size=(3, ours.n))
        there = [pin.neutral(theirs), np.zeros(theirs.nv), np.zeros(theirs.nv)]
        for joint, q, qd, qdd in zip(joints, *states, strict=True):
            there[0][joint.idx_q : joint.idx_q + joint.nq] = [np.cos(q), np.sin(q)] if joint.nq == 2 else [q]
            there[1][joint.idx_v], there[2][joint.idx_v] = qd, qdd
        tau = pin.rnea(theirs, data, *there)[at]
        np.testing.assert_allclose(inverse_dynamics(ours, *states), tau, rtol=0, atol=TOLERANCE * np.abs(tau).max())
        upper = np.triu(pin.crba(theirs, data, there[0]))
        m = (upper + np.triu(upper, 1).T)[np.ix_(at, at)]
        np.testing.assert_allclose(mass_matrix(ours, states[0]), m, rtol=0, atol=TOLERANCE * np.abs(m).max())

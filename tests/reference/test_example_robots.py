"""The 69 robots of `example-robot-data` against Pinocchio, which reads the same files with other code than ours."""

from __future__ import annotations

from collections import Counter

import pytest

from armwright.description.urdf import read_urdf
from armwright.errors import DescriptionError
from reference.example_robots import Verdict, examined, robot_files

TOLERANCE = 1e-9
ROBOTS = 69
AGREE = 66

pytestmark = pytest.mark.skipif(not robot_files(), reason="needs the robots: pip install example-robot-data")

# Nothing of these moves or is there: the only ones that are refused for good.
REFUSED = {
    "hector_description/robots/quadrotor_base.urdf": "expected at least one joint that moves",
    "iris_description/robots/iris_simple.urdf": "expected at least one joint that moves",
    "ur_description/urdf/ur3.urdf": "<robot> has no name",
}


@pytest.fixture(scope="module")
def verdicts() -> dict[str, Verdict]:
    """All robots, examined once."""
    pytest.importorskip("pinocchio", reason="Pinocchio is the oracle here: pip install pin")
    return {name: examined(path) for name, path in robot_files().items()}


def test_all_that_move_agree_with_pinocchio(verdicts):
    assert len(verdicts) == ROBOTS
    agree = [name for name, verdict in verdicts.items() if verdict.error is not None and verdict.error <= TOLERANCE]
    apart = {name: v.error for name, v in verdicts.items() if v.error is not None and not v.error <= TOLERANCE}
    assert not apart
    assert len(agree) == AGREE
    assert {*agree, *REFUSED} == set(verdicts)


def test_what_is_refused_is_refused_truly(verdicts):
    """For good: nothing moves. As it stands: coupled joints, or an inertia whose link and margin are named."""
    for name, verdict in verdicts.items():
        if name in REFUSED:
            assert verdict.refused is not None
            assert REFUSED[name] in verdict.refused
        elif verdict.refused is not None:
            assert ("coupled joints" in verdict.refused) == verdict.mimic
            told = verdict.refused if not verdict.mimic else " ".join(verdict.arm.warnings if verdict.arm else ())
            assert ("impossible inertia" in told) == verdict.impossible
            assert "\n" not in verdict.refused
    kinds = Counter((v.refused is not None, v.mimic, v.impossible) for v in verdicts.values())
    assert kinds[False, False, False] + len(REFUSED) < ROBOTS  # some of the files are wrong
    assert kinds[False, False, False] >= 35  # and most are not


def test_links_without_inertia_say_so(verdicts):
    arm = verdicts["human_description/robots/human.urdf"].arm
    assert arm is not None
    assert any("left_foot_virtual" in told and "massless" in told for told in arm.warnings)


def test_the_old_ur5_wrists_are_named(verdicts):
    for file in ("ur5_robot", "ur5_gripper", "ur5_joint_limited_robot"):
        arm = verdicts[f"ur_description/urdf/{file}.urdf"].arm
        assert arm is not None
        told = [warning for warning in arm.warnings if "old UR5" in warning]
        assert len(told) == 2
        assert "wrist_1_link, wrist_2_link" in told[0]
        assert "256 times too large" in told[1]
    for file in ("ur3_robot", "ur10_robot"):
        arm = verdicts[f"ur_description/urdf/{file}.urdf"].arm
        assert arm is not None
        assert not arm.warnings


def test_no_mesh_is_opened(monkeypatch):
    """Reading finds meshes by their names."""
    opened = []
    real = open

    def watched(file, *args, **kwargs):
        opened.append(str(file))
        return real(file, *args, **kwargs)

    monkeypatch.setattr("builtins.open", watched)
    path = robot_files()["solo_description/robots/solo12.urdf"]
    description = read_urdf(path)
    assert opened == [str(path)]
    files = [visual.solid.file for link in description.links for visual in link.visuals]
    assert files
    assert all(path.parents[2].as_posix() in file for file in files)


@pytest.mark.parametrize("mimic", ["refuse", "independent", "fixed"])
def test_mimic_joints(mimic):
    path = robot_files()["panda_description/urdf/panda.urdf"]
    if mimic == "refuse":
        with pytest.raises(DescriptionError, match=r"panda\.urdf:348: joint 'panda_finger_joint2' follows"):
            read_urdf(path)
        return
    moving = [joint.name for joint in read_urdf(path, mimic=mimic).joints if joint.type != "fixed"]
    assert ("panda_finger_joint2" in moving) == (mimic == "independent")
    assert "panda_finger_joint1" in moving

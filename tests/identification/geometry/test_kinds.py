"""Poses, distances and touched points: each finds known mistakes within its intervals; files of each are read."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import armwright as aw
from armwright.errors import IdentificationError, LogError
from identification.geometry.measured_arm import Truth, measured, nominal, rpy, shift, true_values, truth
from raises_at import raises_at

JOINTS = [f"joint{k}" for k in range(1, 7)]
TOOL = shift(0.03, -0.02, 0.12) @ rpy(0.2, -0.1, 0.4)
Measured, Measurements = aw.identification.Measured, aw.identification.Measurements


def _within(found, real: Truth) -> None:
    scaled = [(value - true) / std for value, true, std in true_values(found, real).values()]
    assert found.good
    assert len(scaled) >= 10
    assert np.mean(np.abs(scaled) < 1.96) > 0.8
    assert np.max(np.abs(scaled)) < 4.5


def _poses(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng([seed, 7]).uniform(-2.5, 2.5, (count, 6))


def test_poses_of_a_tool(tmp_path):
    """Position to 0.1 mm and rotation to 0.3 mrad: the scales are found, and the tool's frame goes into the record."""
    real, rng = truth("frame", 11), np.random.default_rng(11)
    q = _poses(40, 11)
    placed = np.linalg.inv(real.tracker) @ np.array([real.pose(each) for each in q]) @ TOOL
    turns = Rotation.from_rotvec(rng.normal(0, 3e-4, (40, 3))) * Rotation.from_matrix(placed[:, :3, :3])
    values = np.c_[placed[:, :3, 3] + rng.normal(0, 1e-4, (40, 3)), turns.as_quat()[:, [3, 0, 1, 2]]]
    found = aw.calibrate(Measurements(JOINTS, q, [Measured("gripper", "pose", values)]), nominal("frame", tmp_path))
    _within(found, real)
    scales = found.fit.scales[found.fit.rows.group == "rotation"]
    assert scales[0] == pytest.approx(3.0, rel=0.2)  # rad by m
    calibrated = aw.load(found.write(tmp_path / "out.toml"), kinematics_only=True)
    assert calibrated.tip == "gripper"  # the tip was a link: now it is the frame whose pose was measured
    away = _poses(5, 12)
    frames = [
        np.linalg.inv(aw.forward_kinematics(calibrated, each, frame="measuring"))
        @ aw.forward_kinematics(calibrated, each)
        for each in away
    ]
    assert np.allclose(
        frames, np.linalg.inv(real.tracker) @ np.array([real.pose(each) for each in away]) @ TOOL, atol=5e-4
    )


@pytest.mark.parametrize("known", [True, False])
def test_distances_from_an_anchor(tmp_path, known):
    """A laser or a draw-wire from two anchors to a point of the tool, to 0.1 mm."""
    real, rng, point = truth("frame", 12), np.random.default_rng(12), np.array([0.05, 0.02, 0.1])
    q = _poses(150, 13)
    at = np.array([(each[:3, :3] @ point + each[:3, 3]) for each in map(real.pose, q)])
    given = []
    for name, anchor in (("left", [1.2, 0.3, 0.1]), ("right", [0.2, -1.4, 0.4])):
        distance = np.linalg.norm(at - anchor, axis=1) + rng.normal(0, 1e-4, len(q))
        given.append(Measured(name, "distance", distance[:, None], place=point, anchor=anchor if known else None))
    found = aw.calibrate(Measurements(JOINTS, q, given), nominal("frame", tmp_path))
    _within(found, real)
    assert found.errors[0].group == "distance"


def test_a_point_that_is_touched_from_many_sides(tmp_path):
    """A probe's ball in a socket, 50 sides, readings to 0.05 mrad: nothing but joints is measured, so the size is kept."""
    real, rng, point = truth("frame", 14), np.random.default_rng(14), np.array([0.0, 0.02, 0.1])
    sockets, rows, labels = (np.array([0.3, 0.1, 0.5]), np.array([-0.1, 0.35, 0.4])), [], []
    for k in range(50):
        socket = sockets[k % 2]

        def away(q, socket=socket):
            placed = real.pose(q)
            return placed[:3, :3] @ point + placed[:3, 3] - socket

        found = least_squares(away, rng.uniform(-2, 2, 6), xtol=1e-14, ftol=1e-14, gtol=1e-14)
        if found.cost < 1e-20:
            rows.append(found.x)
            labels.append([float(k % 2)])
    assert len(rows) > 35
    q = np.array(rows) + rng.normal(0, 5e-5, (len(rows), 6))
    data = Measurements(JOINTS, q, [Measured("probe", "fixed point", np.array(labels))])
    found = aw.calibrate(data, nominal("frame", tmp_path))
    assert any("say nothing about the arm's size" in each for each in found.estimate.remarks)
    assert found.good
    assert found.errors[0].calibrated < 0.05 * found.errors[0].record
    assert not any("cannot be distinguished" in each for each in found.estimate.remarks)
    assert np.abs(found.estimate.values).max() < 0.01  # the arm does not shrink into the point
    known = aw.load(found.write(tmp_path / "out.toml"), kinematics_only=True)
    between = [aw.forward_kinematics(known, np.zeros(6), frame=f"probe point {k}")[:3, 3] for k in (0, 1)]
    assert np.linalg.norm(np.subtract(*between)) == pytest.approx(np.linalg.norm(np.subtract(*sockets)), rel=0.015)


def test_a_known_tracker_and_known_points_leave_the_base_to_the_record(tmp_path):
    """With the tracker's place known the first joint's frame is identifiable as a whole."""
    real, rng = truth("frame", 15), np.random.default_rng(15)
    q = _poses(40, 15)
    points = np.array([real.points(each) for each in q]) + rng.normal(0, 1e-4, (40, 3, 3))
    xyz, turn = real.tracker[:3, 3], Rotation.from_matrix(real.tracker[:3, :3]).as_euler("xyz")
    places = ([0.1, 0.0, 0.05], [-0.05, 0.1, 0.06], [-0.05, -0.08, 0.1])
    given = [Measured(f"m{k}", "point", points[:, k], place=places[k]) for k in range(3)]
    found = aw.calibrate(Measurements(JOINTS, q, given, placed=[*xyz, *turn]), nominal("frame", tmp_path))
    _within(found, real)
    assert {"joint1 shift x", "joint1 shift y", "joint1 tilt x", "joint1 tilt y", "joint1 zero"} <= set(
        found.estimate.names
    )
    assert "joint6 zero" in found.estimate.names


FILE = """
file.path = "points.csv"
[[joints]]
columns = ["a", "b"]
names = ["joint1", "joint2"]
unit = "deg"
signs = [1, -1]
[[measured]]
name = "hand"
kind = "pose"
columns = ["x", "y", "z", "r", "p", "w"]
unit = "mm"
rotation = "rpy"
angle_unit = "deg"
[[measured]]
name = "wire"
kind = "distance"
columns = ["d"]
anchor_m = [1, 0, 0]
"""


def test_units_and_rotations_of_a_file(tmp_path):
    """Degrees, millimetres, roll-pitch-yaw and a cell left empty."""
    rows = [
        f"{10 * k},{-5 * k},{100 + k},{200},{300},{k},{2 * k},{3 * k},{'' if k == 2 else 0.5 + k}" for k in range(5)
    ]
    (tmp_path / "points.csv").write_text("a,b,x,y,z,r,p,w,d\n" + "\n".join(rows) + "\n")
    (tmp_path / "x.calibration.toml").write_text(FILE)
    data = aw.identification.read_measurements(tmp_path / "x.calibration.toml")
    assert np.allclose(data.q[3], np.deg2rad([30, 15]))
    hand, wire = data.measured
    assert np.allclose(hand.values[3, :3], [0.103, 0.2, 0.3])
    turned = Rotation.from_quat(hand.values[3, [4, 5, 6, 3]]).as_euler("xyz", degrees=True)
    assert np.allclose(turned, [3, 6, 9])
    assert wire.seen.tolist() == [True, True, False, True, True]
    assert "5 poses" in str(data)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('kind = "pose"', 'kind = "point"', "columns"),
        ('unit = "deg"\nsigns', 'unit = "turns"\nsigns', "unit"),
        ('columns = ["d"]', 'columns = ["nothing"]', "nothing"),
        ("signs = [1, -1]", "signs = [1, 2]", "signs"),
        ('"points.csv"', '"other.csv"', "other.csv"),
        ("anchor_m = [1, 0, 0]", "place_mm = [1, 0, 0]", "place_mm"),
    ],
)
def test_mistakes_of_a_file_are_named(tmp_path, old, new, said):
    """The file, the key and the value."""
    (tmp_path / "points.csv").write_text(
        "a,b,x,y,z,r,p,w,d\n" + "\n".join(",".join(["1"] * 9) for _ in range(5)) + "\n"
    )
    path = tmp_path / "x.calibration.toml"
    path.write_text(FILE.replace(old, new))
    with pytest.raises(LogError) as caught:
        aw.identification.read_measurements(path)
    assert said in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_the_verdict_is_not_given_to_a_good_record_or_to_few_poses(tmp_path):
    """An arm as its record has it, and eight poses of one that is off by less than the noise."""
    arm = nominal("frame", tmp_path)
    for real, poses, noise in ((Truth("frame", {}, shift(1.0, 0.5, 0.2)), 40, 1e-4), (truth("frame", 3), 12, 2e-2)):
        found = aw.calibrate(measured(real, 3, poses, noise=noise), arm)
        assert not found.good
        assert found.verdict == "not identified"


def test_points_that_are_not_rigid_are_named():
    """A marker in millimetres that was read as metres, and one that slipped are told by their distance."""
    q = _poses(20, 1)
    points = np.array([truth("frame", 1).points(each) for each in q])
    given = [Measured("a", "point", points[:, 0]), Measured("b", "point", 1e-3 * points[:, 1])]
    assert any("a and b are fixed to one frame" in each for each in Measurements(JOINTS, q, given).findings)
    good = [Measured(name, "point", points[:, k]) for k, name in enumerate("abc")]
    assert not Measurements(JOINTS, q, good).findings


def test_what_cannot_be_calibrated_is_refused(tmp_path):
    """Too few poses, joints of another arm, unknown frames and losses."""
    arm, q = nominal("frame", tmp_path), _poses(6, 1)
    point = Measured("m", "point", np.ones((6, 3)) * np.arange(6)[:, None])
    with raises_at(IdentificationError, "measurements", r"18 .* 27 "):
        aw.calibrate(Measurements(JOINTS, q, [point]), arm)
    with pytest.raises(IdentificationError, match="elbow"):
        aw.calibrate(Measurements(["elbow", *JOINTS[1:]], q, [point]), arm)
    with pytest.raises(IdentificationError, match="loss"):
        aw.calibrate(Measurements(JOINTS, q, [point]), arm, loss="cubes")
    with pytest.raises(IdentificationError, match="no arm"):
        aw.calibrate(Measurements(JOINTS, q, [point]))
    with raises_at(IdentificationError, "arm 'tx40'", "without compliance"):
        aw.calibrate(Measurements(JOINTS, q, [point]), arm, terms=["joint compliance"])
    with pytest.raises(aw.ArmwrightError, match="hand"):
        aw.calibrate(Measurements(JOINTS, q, [Measured("m", "point", point.values, "hand")]), arm)
    with pytest.raises(LogError, match="4 or more"):
        Measurements(JOINTS, q[:3], [Measured("m", "point", np.ones((3, 3)))])

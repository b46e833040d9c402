"""`armwright ik`: joint positions for tables of points, of angles and of quaternions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armwright as aw
from armwright.results.csv_tables import write_table
from cli.test_commands import run
from ik.small_arms import forward, small_arm


def poses(tmp_path, columns):
    path = tmp_path / "poses.csv"
    write_table(path, {name: np.atleast_1d(values) for name, values in columns.items()})
    return str(path)


def test_positions_of_all_kinds_of_tables(tmp_path):
    arm, out = aw.load("puma560"), tmp_path / "q.csv"
    point = {"x [m]": [0.4, 0.3], "y [m]": [0.1, -0.3], "z [m]": [0.3, 0.2]}
    angles = {"roll [rad]": [0.1, 3.0], "pitch [rad]": [0.3, 0.2], "yaw [rad]": [-0.2, 1.0]}
    turned = {"qw": [1.0, 0.5], "qx": [0.0, 0.5], "qy": [0.0, -0.5], "qz": [0.0, 0.5]}
    for columns in (point, point | angles, point | turned):
        shown = run("ik", "puma560", poses(tmp_path, columns), "-o", str(out)).stdout
        assert "2 of 2 solved" in shown
        rows = np.genfromtxt(out, delimiter=",", skip_header=1)
        tips = aw.compile(arm).forward_kinematics(rows[:, :6])
        assert np.abs(tips[:, :3, 3] - np.stack(list(point.values()), axis=1)).max() < 1e-7
        if columns == point | turned:
            assert np.abs(tips[0, :3, :3] - np.eye(3)).max() < 1e-7


def test_a_pose_out_of_reach_is_nan_and_exit_code_1(tmp_path):
    done = run("ik", "puma560", poses(tmp_path, {"x": [9.0], "y": [0.0], "z": [0.0]}), code=1)
    assert "0 of 1 solved" in done.stderr
    assert "not reached" in done.stderr
    assert done.stdout.splitlines()[1].startswith("nan,nan,nan,nan,nan,nan,")


TURNED = {"x": [0.4], "y": [0.1], "z": [0.3], "roll": [0.1], "pitch": [0.3], "yaw": [-0.2]}


def test_all_branches_are_listed_with_their_pose(tmp_path):
    arm, out = aw.load("puma560"), tmp_path / "q.csv"
    columns = {name: [*values, *values] for name, values in TURNED.items()}
    columns["x"] = [0.4, 9.0]
    shown = run("ik", "puma560", poses(tmp_path, columns), "--all", "-o", str(out), code=1).stdout
    assert "1 of 2 solved, in closed form (axes 4, 5 and 6 meet" in shown
    assert "target 1: no joint positions reach it" in shown
    rows = np.genfromtxt(out, delimiter=",", skip_header=1)
    assert out.read_text().startswith("pose,branch,q_waist [rad],")
    assert len(rows) >= 2
    assert (rows[:, 0] == 0.0).all()
    assert len(np.unique(rows[:, 1])) == len(rows)
    tips = aw.compile(arm).forward_kinematics(rows[:, 2:8])
    assert np.abs(tips - tips[0]).max() < 1e-12
    assert np.abs(tips[0, :3, 3] - [0.4, 0.1, 0.3]).max() < 1e-12


@pytest.mark.parametrize(
    ("name", "way"),
    [
        ("puma560", "inverse  closed form, axes 4, 5 and 6 meet, axes 2 and 3 are parallel"),
        ("panda", "inverse  numeric"),
    ],
)
def test_info_says_how_an_arm_is_solved(name, way):
    assert way in run("info", name).stdout


@pytest.mark.parametrize(
    ("columns", "words", "names"),
    [
        ({"x": [1.0], "y": [2.0]}, (), "x, y, z"),
        ({"x": [1.0], "y": [2.0], "z": [3.0], "qw": [2.0], "qx": [0.0], "qy": [0.0], "qz": [0.0]}, (), "length 2"),
        ({"x [mm]": [1.0], "y": [2.0], "z": [3.0]}, (), "mm"),
        ({"x": [0.1], "y": [0.2], "z": [0.3]}, ("--near", "1,2"), "--near"),
        ({"x": [0.1], "y": [0.2], "z": [0.3]}, ("--frame", "hand"), "hand"),
        ({"x": [0.1], "y": [0.2], "z": [0.3]}, ("--tolerance", "0"), "tolerance"),
        ({"x": [0.1], "y": [0.2], "z": [0.3]}, ("--all",), "closed form"),
        ({"x": [0.1], "y": [0.2], "z": [0.3]}, ("--method", "exact"), "method"),
        (TURNED, ("--all", "--method", "numeric"), "--all"),
    ],
)
def test_bad_tables_and_options_are_one_line(tmp_path, columns, words, names):
    done = run("ik", "puma560", poses(tmp_path, columns), *words, code=2)
    assert names in done.stderr
    assert done.stderr.count("\n") == 1


def test_the_poses_are_not_replaced(tmp_path):
    path = poses(tmp_path, {"x": [0.4], "y": [0.1], "z": [0.3]})
    assert "would be replaced" in run("ik", "puma560", path, "-o", path, code=2).stderr


PLACES = {"x [m]": [0.28, 0.2], "y [m]": [0.1, -0.12], "z [m]": [0.1, 0.2]}


@pytest.mark.parametrize(
    ("columns", "words", "aim"),
    [
        ({"pitch [rad]": [0.5, np.pi / 2]}, (), "pitch"),
        ({"pitch [rad]": [0.5, -0.2]}, ("--aim", "pitch x"), "pitch x"),
        ({"yaw [rad]": [0.5, -0.4]}, (), "yaw"),
        ({"ax": [0.0, 0.0], "ay": [0.0, 0.0], "az": [-2.0, -1.0]}, (), "axis"),
        ({"ax": [1.0, 0.3], "ay": [0.0, 0.0], "az": [-2.0, -1.0]}, ("--aim", "pitch"), "pitch"),
        ({"roll": [0.1, 0.2], "pitch": [1.3, 1.2], "yaw": [0.3, 0.2]}, ("--aim", "pitch"), "pitch"),
        ({"qw": [1.0, 0.0], "qx": [0.0, 1.0], "qy": [0.0, 0.0], "qz": [0.0, 0.0]}, ("--aim", "yaw"), "yaw"),
    ],
)
def test_tables_with_a_part_of_the_orientation(columns, words, aim, tmp_path):
    name = "servo-5"
    small_arm(name, tmp_path)
    out = tmp_path / "q.csv"
    table = poses(tmp_path, PLACES | columns)
    shown = run("ik", str(tmp_path / f"{name}.urdf"), table, *words, "-o", str(out)).stdout
    assert "2 of 2 solved" in shown
    at, turned = forward(name, np.genfromtxt(out, delimiter=",", skip_header=1)[:, :5])
    np.testing.assert_allclose(at, np.stack(list(PLACES.values()), axis=1), atol=1e-7)
    values = np.stack(list(columns.values()), axis=1)
    x, z = turned.apply([1.0, 0.0, 0.0]), turned.apply([0.0, 0.0, 1.0])
    if len(columns) == 1:  # as the page defines them
        axis = x if aim in ("pitch x", "yaw") else z
        meant = (
            np.arctan2(axis[:, 1], axis[:, 0])
            if aim == "yaw"
            else np.arctan2(-axis[:, 2], np.hypot(axis[:, 0], axis[:, 1]))
        )
        np.testing.assert_allclose(meant, values[:, 0], atol=1e-6)
    elif "ax" in columns and aim == "axis":
        np.testing.assert_allclose(z, values / np.linalg.norm(values, axis=1, keepdims=True), atol=1e-7)
    elif "ax" in columns:
        np.testing.assert_allclose(z[:, 2], values[:, 2] / np.linalg.norm(values, axis=1), atol=1e-7)
    elif "roll" in columns:
        wanted = Rotation.from_euler("xyz", values).apply([0.0, 0.0, 1.0])
        np.testing.assert_allclose(z[:, 2], wanted[:, 2], atol=1e-7)
    else:
        np.testing.assert_allclose(np.arctan2(x[:, 1], x[:, 0]), 0.0, atol=1e-7)


@pytest.mark.parametrize(
    ("columns", "words", "names"),
    [
        ({"pitch": [0.5, 2.0]}, (), ":3: column pitch: 2; expected an angle from"),
        ({"ax": [1.0, 0.0], "ay": [0.0, 0.0], "az": [0.0, 0.0]}, (), ":3: columns ax, ay, az: length 0"),
        ({"pitch": [0.5, 0.2]}, ("--aim", "axis"), "--aim = 'axis': with columns pitch"),
        ({"yaw": [0.5, 0.2]}, ("--aim", "pose"), "--aim = 'pose'"),
        ({"ax": [1.0, 1.0], "ay": [0.0, 0.0], "az": [0.0, 0.0]}, ("--aim", "base xy"), "--aim"),
        ({}, ("--aim", "pitch"), "with columns x, y, z"),
        ({"pitch": [0.5, 0.2]}, ("--aim", "slope"), "aim = 'slope'"),
        ({"pitch": [0.5, 0.2]}, ("--method", "closed-form"), "a closed form needs whole poses, not aim = 'pitch'"),
        ({"pitch [deg]": [0.5, 0.2]}, (), "deg"),
    ],
)
def test_parts_of_the_orientation_that_cannot_be(columns, words, names, tmp_path):
    done = run("ik", "puma560", poses(tmp_path, PLACES | columns), *words, code=2)
    assert names in done.stderr

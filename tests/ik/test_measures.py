"""Measures of poses against NumPy's singular values, the Robotics Toolbox and closed forms; workspaces against geometry."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError, OutputError, ShapeError
from armwright.kinematics.manipulability import singular_values
from ik.arms import arm_of, samples


def rows_of(arm, q, aim, length):
    """The Jacobian's rows (k, m, n), angles times the length, by NumPy."""
    dyn = aw.compile(arm)
    every, z = dyn.jacobian(q), dyn.forward_kinematics(q)[:, :3, :3]
    linear, angular = every[:, :3], length * every[:, 3:]
    if aim == "axis":
        angular = z[:, :, :2].transpose(0, 2, 1) @ angular
    return {"position": linear, "rotation": angular}.get(aim, np.concatenate([linear, angular], axis=1))


@pytest.mark.sample(4)
@pytest.mark.parametrize("name", ["puma560", "panda", "two-link"])
@pytest.mark.parametrize("aim", ["pose", "position", "rotation", "axis"])
def test_singular_values_are_those_of_numpy(name, aim, tmp_path):
    arm = arm_of(name, tmp_path)
    q, _ = samples(arm, 500)
    q[:50, -1] = q[:50, 0] = 0.0
    q[50:60] = 0.0  # singular
    q[60:70] = 1e-7
    found = aw.kinematics.manipulability(arm, q, aim=aim, length=0.4)
    truth = np.linalg.svd(rows_of(arm, q, aim, 0.4), compute_uv=False)
    assert np.abs(found.singular_values - truth).max() < 1e-13
    assert np.abs(found.yoshikawa - truth.prod(axis=1)).max() < 1e-13
    assert np.array_equal(found.smallest, found.singular_values[:, -1])
    well = truth[:, -1] > 1e-3
    assert np.allclose(found.condition[well], truth[well, 0] / truth[well, -1], rtol=1e-9)
    alone = singular_values(arm, q[7], aim=aim, length=0.4)
    assert np.abs(alone - truth[7]).max() < 1e-13  # the float function defines the compiled one


def test_small_singular_values_keep_their_digits():
    """A straight two-link arm bent by δ: det J = l1 l2 sin δ, so σ_min = l1 l2 sin δ / σ_max, far below √eps."""
    arm = aw.load("two-link")
    q = np.array([[0.3, bend] for bend in (1e-2, 1e-5, 1e-9)])
    rows = aw.compile(arm).jacobian(q)[:, :3]
    found = aw.kinematics.manipulability(arm, q, aim="position")
    area = np.sqrt(np.linalg.det(rows[0].T @ rows[0])) / np.sin(1e-2)  # l1 l2
    assert np.allclose(found.yoshikawa, area * np.sin(q[:, 1]), rtol=1e-6)


@pytest.mark.study
def test_manipulability_is_that_of_the_robotics_toolbox():
    rtb = pytest.importorskip("roboticstoolbox", reason="needs the toolbox: pip install roboticstoolbox-python")
    robot, arm = rtb.models.DH.Panda(), aw.load("panda")
    q, _ = samples(arm, 20)
    ours = aw.kinematics.manipulability(arm, q, frame=None).yoshikawa
    theirs = np.array([robot.manipulability(each, method="yoshikawa", axes="all") for each in q])
    if not np.allclose(aw.compile(arm).forward_kinematics(q[0]), robot.fkine(q[0]).A, atol=1e-6):
        tool = np.linalg.inv(robot.fkine(q[0]).A) @ aw.compile(arm).forward_kinematics(q[0])
        robot.tool = robot.tool.A @ tool  # its model of the flange differs
        theirs = np.array([robot.manipulability(each, method="yoshikawa", axes="all") for each in q])
    assert np.allclose(ours, theirs, rtol=1e-6)


def test_distance_to_limits():
    arm = aw.load("puma560")
    low, high = np.array([body.limits.position for body in arm.bodies]).T
    q = np.stack([(low + high) / 2, low, low - 0.1 * (high - low)])
    assert np.allclose(aw.kinematics.manipulability(arm, q).limit_margin, [0.5, 0.0, -0.1])
    assert aw.kinematics.manipulability(arm, q[0]).limit_margin.shape == ()


@pytest.mark.parametrize(
    ("options", "place"),
    [({"aim": "turn"}, "aim"), ({"length": 0.0}, "length"), ({"length": np.nan}, "length"), ({"frame": "nose"}, None)],
)
def test_bad_input_is_named(options, place):
    arm = aw.load("two-link")
    for function in (
        lambda: aw.kinematics.manipulability(arm, np.zeros(2), **options),
        lambda: aw.kinematics.workspace(arm, 10, **options),
    ):
        with pytest.raises(ModelError) as error:
            function()
        assert place is None or error.value.place == place
    with pytest.raises(ShapeError):
        aw.kinematics.manipulability(arm, np.zeros(3))
    for value in (0, 1.5, True):
        with pytest.raises(ModelError, match="samples"):
            aw.kinematics.workspace(arm, value)


def test_the_workspace_of_two_links_is_an_annulus(tmp_path):
    """Radii |l1 - l2| and l1 + l2 with joints that turn around; w = l1 l2 |sin q2|."""
    arm = aw.load("two-link")
    found = aw.kinematics.workspace(arm, 20_000, aim="position", seed=3)
    dyn = aw.compile(arm)
    assert np.abs(dyn.forward_kinematics(found.q.values)[:, :3, 3] - found.position.values).max() < 1e-12
    low, high = np.array([body.limits.position for body in arm.bodies]).T
    assert (found.q >= np.maximum(low, -np.pi)).all()
    assert (found.q <= np.minimum(high, np.pi)).all()
    truth = np.linalg.svd(rows_of(arm, found.q.values, "position", 1.0), compute_uv=False)
    assert np.abs(found.manipulability.values - truth.prod(axis=1)).max() < 1e-13
    assert float(found.reach_percentiles.sel(percentile=100.0)) == found.reach.values.max()
    assert abs(float(found.reach_percentiles.sel(percentile=50.0)) - np.median(found.reach.values)) < 1e-3
    again = aw.kinematics.workspace(arm, 20_000, aim="position", seed=3, threads=2)
    assert again.identical(found)
    for name in ("cloud.png", "cloud.html"):
        aw.pictures.draw_workspace(found, tmp_path / name)
        assert (tmp_path / name).stat().st_size > 10_000
    with pytest.raises(OutputError):
        aw.pictures.draw_workspace(found, tmp_path / "cloud.txt")


@pytest.mark.parametrize(
    ("axis", "titles"), [("0 0 1", ("From above", "z = 0.3 m")), ("0 1 0", ("xz plane", "y = 0 m"))]
)
def test_arms_in_a_plane_are_seen_from_in_front_of_it(axis, titles, tmp_path):
    from armwright.pictures.workspace_maps import draw, flat_axes

    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/><origin xyz="{xyz}"/>'
        f'<axis xyz="{axis}"/><limit lower="-1.5" upper="1.5" velocity="1" effort="1"/></joint>'
        for k, xyz in enumerate(("0 0 0.3", "0.5 0 0"))
    )
    links = "".join(f'<link name="l{k}"/>' for k in range(4))
    hand = '<joint name="h" type="fixed"><parent link="l2"/><child link="l3"/><origin xyz="0.4 0 0"/></joint>'
    path = tmp_path / "planar.urdf"
    path.write_text(f'<robot name="planar">{links}{joints}{hand}</robot>')
    found = aw.kinematics.workspace(aw.load(path, kinematics_only=True), 2000)
    assert flat_axes(found.position.values) == titles[1][0]
    left, right, *_ = draw(found).axes
    assert titles[0] in left.get_title(loc="left")
    assert titles[1] in right.get_title(loc="left")
    aw.pictures.draw_workspace(found, tmp_path / "planar.html")
    assert "left out" not in (tmp_path / "planar.html").read_text(encoding="utf-8")


@pytest.mark.study
@pytest.mark.parametrize("name", ["examples/scara.toml"])
def test_sliding_joints_and_few_samples_are_drawn(name, tmp_path):
    found = aw.kinematics.workspace(aw.load(name), 1)
    aw.pictures.draw_workspace(found, tmp_path / "one.png")
    aw.pictures.draw_workspace(found, tmp_path / "one.html")
    assert not [*tmp_path.glob("*.part")]


def test_the_command_draws_and_refuses(tmp_path):
    from typer.testing import CliRunner

    from armwright.cli.app import app

    def run(*words):
        return CliRunner().invoke(app, ["workspace", "two-link", "--samples", "500", *words])

    for name in ("w.png", "w.html", "w.nc"):
        done = run("-o", str(tmp_path / name), "--aim", "position")
        assert done.exit_code == 0, done.output
        assert "median" in done.output
        assert (tmp_path / name).exists()
    for words in (("-o", str(tmp_path / "w.txt")), ("--aim", "turn"), ("--samples", "0"), ("--length", "-1")):
        done = run(*words)
        assert (done.exit_code, len(done.stderr.splitlines())) == (2, 1), words

"""Animated glTF: valid by the specification's rules, and wherever it is played the hand is where kinematics puts it."""

import io

import numpy as np
import pytest
import trimesh

import armwright as aw
from armwright.description.database import read_toml
from armwright.model import build_model
from armwright.pictures.arm_glb import animated_arm
from armwright.pictures.posed_arm import upright
from physics.arms import OWN, arm as arm_of
from pictures.gltf_rules import Gltf
from pictures.playing import pose_of
from simulation.runs import MIXED, mixed_arm

TO_Z_UP = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])  # glTF's y is up


def to_base(arm):
    """(4, 4) from a file's axes to those of the base."""
    at = np.eye(4)
    at[:3, :3] = upright(arm).T
    return at @ TO_Z_UP


ARMS = ["lathe", *OWN, *aw.builtin_names()]


@pytest.fixture(params=ARMS)
def arm(request, tmp_path):
    return mixed_arm(tmp_path) if request.param == "lathe" else arm_of(request.param)


def motion(arm, rows=301, duration=3.0):
    """Uneven times; turns of several radians, and an angle far from 0."""
    t = duration * np.linspace(0.0, 1.0, rows) ** 1.3
    k = np.arange(arm.n)
    return t, 1.5 * np.sin(2.0 * t[:, None] + k) + 0.4 * k * t[:, None] + np.where(k == 1, 0.0, 20.0)


@pytest.mark.sample(3)
def test_file_follows_the_specification_and_joints_move(arm):
    t, q = motion(arm)
    gltf = Gltf(animated_arm(arm, t, {"run": q, "reference": 0.9 * q}))
    assert [animation["name"] for animation in gltf.json["animations"]] == ["run", "reference"]
    for animation in gltf.json["animations"]:
        targets = [channel["target"] for channel in animation["channels"]]
        moved = [(gltf.json["nodes"][target["node"]]["name"], target["path"]) for target in targets]
        paths = {"rotation": lambda kind: kind.turns, "translation": lambda kind: kind.slides}
        expected = [(body.joint, path) for body in arm.bodies for path, has in paths.items() if has(body.kind)]
        assert moved[: len(expected)] == expected  # cylinders follow


@pytest.mark.sample(2)
def test_hand_is_where_kinematics_puts_it(arm):
    t, q = motion(arm)
    gltf = Gltf(animated_arm(arm, t, {"run": q}))
    tip = f"tip {arm.tip}"
    for k in (0, 1, 57, 200, len(t) - 1):
        expected = aw.forward_kinematics(arm, q[k])
        assert np.abs(to_base(arm) @ pose_of(gltf, "run", tip, t[k] - t[0]) - expected).max() < 1e-5
    rng = np.random.default_rng(3)
    for now in rng.uniform(t[0], t[-1], 20):  # between keyframes: on the straight line between rows
        between = np.array([np.interp(now, t, q[:, k]) for k in range(arm.n)])
        off = to_base(arm) @ pose_of(gltf, "run", tip, now - t[0]) - aw.forward_kinematics(arm, between)
        assert np.linalg.norm(off[:3, 3]) < 1e-5


@pytest.mark.sample(5)
def test_an_independent_reader_sees_the_same_arm(arm):
    t, q = motion(arm, rows=5)
    data = animated_arm(arm, t, {"run": q})
    scene = trimesh.load(io.BytesIO(data), file_type="glb")
    assert isinstance(scene, trimesh.Scene)
    first = to_base(arm) @ scene.graph.get(f"tip {arm.tip}")[0]
    assert np.abs(first - aw.forward_kinematics(arm, q[0])).max() < 1e-6
    gltf = Gltf(data)
    for channel in gltf.animation("run")["channels"]:  # the last keyframes, put into the reader's own scene
        name = gltf.json["nodes"][channel["target"]["node"]]["name"]
        last = gltf.arrays[gltf.animation("run")["samplers"][channel["sampler"]]["output"]][-1]
        parent = scene.graph.transforms.parents[name]
        local = np.array(scene.graph.transforms.edge_data[parent, name]["matrix"])
        if channel["target"]["path"] == "rotation":
            x, y, z, w = last
            local[:3, :3] = trimesh.transformations.quaternion_matrix([w, x, y, z])[:3, :3]
        else:
            local[:3, 3] = last
        scene.graph.update(name, parent, matrix=local)
    hand = to_base(arm) @ scene.graph.get(f"tip {arm.tip}")[0]
    assert np.abs(hand - aw.forward_kinematics(arm, q[-1])).max() < 1e-5
    assert sum(len(mesh.faces) for mesh in scene.geometry.values()) > 100


def test_sizes_and_colours_are_the_arms(tmp_path):
    """A box of a known size and colour on a link's frame, at the end of a slide."""
    visual = """
    [[links.visuals]]
    solid = { shape = "box", size_m = [0.2, 0.4, 0.6] }
    xyz_m = [0.0, 0.0, 0.1]
    rpy_rad = [0.0, 0.0, 0.0]
    colour = [1.0, 0.5, 0.0]
    """
    path = tmp_path / "lathe.toml"
    path.write_text(MIXED + visual, encoding="utf-8")
    arm = build_model(read_toml(path))
    gltf = Gltf(animated_arm(arm, np.array([0.0, 1.0]), {"run": np.zeros((2, 3))}))
    (mesh,) = gltf.json["meshes"]
    (part,) = mesh["primitives"]
    box = gltf.json["accessors"][part["attributes"]["POSITION"]]
    assert np.subtract(box["max"], box["min"]) == pytest.approx([0.2, 0.4, 0.6])
    red, green, blue, alpha = gltf.json["materials"][part["material"]]["pbrMetallicRoughness"]["baseColorFactor"]
    assert (red, blue, alpha) == (1, 0, 1)
    assert green == pytest.approx(0.214041, abs=1e-6)  # half of a screen's green is a fifth of its light


@pytest.mark.sample(2)
def test_gravity_points_down(arm):
    """As y is up in the file, whichever way gravity has in the base; the turn is a rotation, and none where z is up."""
    q = np.zeros((1, arm.n))
    turned = pose_of(Gltf(animated_arm(arm, np.zeros(1), {"run": q})), "run", "base", 0.0)[:3, :3]
    gravity = np.asarray(arm.gravity, dtype=float)
    np.testing.assert_allclose(turned @ gravity, [0.0, -np.linalg.norm(gravity), 0.0], atol=1e-12 * 9.81)
    np.testing.assert_allclose(turned @ turned.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turned) > 0.0
    if not gravity[:2].any() and gravity[2] < 0.0:
        np.testing.assert_allclose(turned, TO_Z_UP[:3, :3].T, atol=1e-12)


def test_an_arm_hangs_or_stands_and_floats_as_it_is():
    assert (upright(aw.load("cmu-dd")) == np.diag([1.0, -1.0, -1.0])).all()
    assert (upright(aw.load("puma560")) == np.eye(3)).all()
    np.testing.assert_array_equal(upright(aw.load("two-link")) @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    assert (upright(aw.load("puma560").replace(gravity=[0.0, 0.0, 0.0])) == np.eye(3)).all()


def test_one_row_stands_still():
    arm = aw.load("two-link")
    gltf = Gltf(animated_arm(arm, np.array([4.0]), {"run": np.array([[0.3, -0.2]])}))
    hand = to_base(arm) @ pose_of(gltf, "run", f"tip {arm.tip}", 0.0)
    assert np.abs(hand - aw.forward_kinematics(arm, np.array([0.3, -0.2]))).max() < 1e-6

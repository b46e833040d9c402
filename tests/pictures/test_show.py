"""Pictures of arms: PNG, page and scene file."""

from __future__ import annotations

import base64
import dataclasses
import io
import zlib
from pathlib import Path

import numpy as np
import pytest
import trimesh

import armwright as aw
from armwright.description.database import parse
from armwright.errors import ModelError, OutputError, ShapeError
from armwright.kinematics.forward_kinematics import body_placements
from armwright.model import build_model
from armwright.pictures.body_shapes import body_shapes
from armwright.pictures.joint_figure import CYLINDER, bone_size
from armwright.pictures.png import spacing, write_png
from armwright.pictures.posed_arm import posed_arm, upright
from physics.arms import NAMES, arm, random_state, workshop
from pictures.paper import on_white
from raises_at import raises_at

Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])  # glTF's y is up


def pixels(path) -> np.ndarray:
    return on_white(path) / 255


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", NAMES)
def test_a_png_shows_the_arm(name, tmp_path):
    write_png(posed_arm(arm(name)), tmp_path / "arm.png", longer=240)
    image = pixels(tmp_path / "arm.png")
    assert max(image.shape) == 240
    assert 0.02 < (image.min(axis=-1) < 0.6).mean() < 0.9  # something stands on the paper, and does not hide it
    assert image[:3].min() > 0.5  # nothing runs out of the picture at the top


@pytest.mark.sample(4)
@pytest.mark.parametrize("name", NAMES)
def test_a_scene_has_a_node_for_each_link_where_it_stands(name, tmp_path):
    model = arm(name)
    q = random_state(model, 1)[0]
    shown = aw.show(model, tmp_path / "arm.glb", q)
    assert shown.notes == ()
    scene = trimesh.load_scene(tmp_path / "arm.glb")
    stands = np.eye(4)
    stands[:3, :3] = upright(model)
    for k, placed in body_placements(model, q).items():
        link = model.bodies[k].link if k >= 0 else "base"
        np.testing.assert_allclose(scene.graph[link][0], Y_UP @ stands @ placed.matrix(), atol=1e-6)
    box = posed_arm(model, q).surfaces().corners.reshape(-1, 3) @ Y_UP[:3, :3].T
    np.testing.assert_allclose(scene.bounds, [box.min(axis=0), box.max(axis=0)], atol=1e-5)


def test_a_cylinder_is_drawn_from_end_to_end():
    """As a shape of its own colour in the base's frame, whose far points are at both anchors."""
    model = arm("sprung")
    q = random_state(model, 1)[0]
    (drawn,) = [shape for shape in posed_arm(model, q).shapes[-1] if shape.colour == CYLINDER]
    placed = body_placements(model, q)
    for cylinder in model.cylinders:
        for body, end in zip(cylinder.bodies, cylinder.ends, strict=True):
            distance = np.linalg.norm(drawn.positions - placed[body].point(end), axis=1).min()
            assert distance < bone_size(model)
    assert not any(shape.colour == CYLINDER for shape in posed_arm(arm("workshop"), q).shapes[-1])


def test_a_page_needs_nothing_else(tmp_path):
    path = aw.show(arm("two-link"), tmp_path / "arm.html").path
    page = path.read_text(encoding="utf-8")
    assert "<title>two-link</title>" in page
    for loads in ('src="http', "src='http", 'href="http', "import("):
        assert loads not in page
    start = page.index('id="arm">') + len('id="arm">')
    glb = zlib.decompress(base64.b64decode(page[start : page.index("<", start)]))
    assert len(trimesh.load_scene(io.BytesIO(glb), file_type="glb").geometry) > 1


def test_names_cannot_break_out_of_a_page(tmp_path):
    data = workshop()
    data["name"] = "</script><b>arm"
    page = aw.show(build_model(parse(data, "x")), tmp_path / "arm.html").path.read_text(encoding="utf-8")
    assert "</script><b>" not in page


def test_holes_are_seen_through(tmp_path):
    """A plate with a bore, seen from above, shows the ground in its middle."""
    data = workshop()
    plate = {"shape": "box", "size_m": [1.0, 1.0, 0.1]}
    bore = {"shape": "cylinder", "radius_m": 0.3, "length_m": 0.1}
    place = {"xyz_m": [0.0, 0.0, 0.0], "rpy_rad": [0.0, 0.0, 0.0]}
    data["links"][0]["visuals"] = [{"solid": plate, **place}, {"solid": bore, "hole": True, **place}]
    solid = posed_arm(build_model(parse(data, "x"))).surfaces()
    bored = solid.corners.reshape(-1, 3)
    middle = np.unique(bored.round(9), axis=0)
    away = np.linalg.norm(middle - 0.5 * (middle.min(axis=0) + middle.max(axis=0)), axis=1)
    assert away.min() > 0.29


def test_a_bushing_in_the_bore_of_another_part_stays():
    from armwright.pictures.body_shapes import holes_of

    data = workshop()
    place = {"xyz_m": [0.0, 0.0, 0.0], "rpy_rad": [0.0, 0.0, 0.0]}
    rod = {"shape": "cylinder", "radius_m": 0.1, "length_m": 0.1}
    data["links"][0]["visuals"] = [
        {"name": "10 block", "solid": {"shape": "box", "size_m": [1.0, 1.0, 0.1]}, **place},
        {"name": "10 bore", "solid": rod, "hole": True, **place},
        {"name": "20 bushing", "solid": rod, **place},
        {"solid": rod, **place},
    ]
    link = parse(data, "x").links[0]
    assert [len(holes_of(link, visual)) for visual in link.visuals if not visual.hole] == [1, 0, 0]


def test_without_a_mesh_that_can_be_read_it_is_a_figure(tmp_path):
    data = workshop()
    mesh = {"shape": "mesh", "file": "gone.stl", "scale": 1.0}
    data["links"][0]["visuals"] = [{"solid": mesh, "xyz_m": [0, 0, 0], "rpy_rad": [0, 0, 0]}]
    shown = aw.show(build_model(parse(data, "x", folder=tmp_path)), tmp_path / "arm.glb")
    assert shown.notes[0].value == "gone.stl"
    assert "figure of its joints" in shown.notes[0].what
    bare = dataclasses.replace(arm("workshop"), description=None)
    assert len(posed_arm(bare).shapes) == len(posed_arm(arm("workshop")).shapes)


@pytest.mark.parametrize("size", [120, 301])
def test_a_png_is_as_large_as_asked(tmp_path, size):
    aw.show(arm("panda"), tmp_path / "arm.png", size=size)
    assert max(pixels(tmp_path / "arm.png").shape) == size


def test_ground_and_shadow_fade_before_the_edge(tmp_path):
    """Nothing but the arm, the axes and the scale ends at the picture's border."""
    aw.show(arm("two-link"), tmp_path / "arm.png", [0.3, 0.5], size=300)
    image = pixels(tmp_path / "arm.png")
    assert min(image[:, 0].min(), image[:, -1].min(), image[0].min(), image[-1].min()) > 0.97


@pytest.mark.parametrize(("size", "grid"), [(0.8, 0.1), (1.6, 0.2), (4.0, 0.5), (0.15, 0.01), (16.0, 2.0)])
def test_the_grid_is_round(size, grid):
    assert spacing(size) == pytest.approx(grid)


def test_refused(tmp_path):
    with pytest.raises(OutputError, match=r"expected \.png, \.html or \.glb"):
        aw.show(arm("panda"), tmp_path / "arm.bmp")
    for wrong in ([0.0], np.full(7, np.nan)):
        with raises_at(ShapeError, "q", "7 finite numbers"):
            aw.show(arm("panda"), tmp_path / "arm.png", wrong)
    with raises_at(ModelError, "arm", value=7):
        aw.show(7, tmp_path / "arm.png")  # type: ignore[arg-type]
    for size in (10, 10**6, 300.0, True):
        with pytest.raises(OutputError) as caught:
            aw.show(arm("panda"), tmp_path / "arm.png", size=size)  # type: ignore[arg-type]
        assert (caught.value.place, caught.value.value) == ("size", size)
        assert caught.value.expected.startswith("120 to 4000 pixels")
    with raises_at(OutputError, "size", r"only a \.png", value=300):
        aw.show(arm("panda"), tmp_path / "arm.glb", size=300)
    assert not list(tmp_path.iterdir())


def test_a_sliding_joint_stands_on_a_rail_from_its_zero():
    model = aw.load(Path(__file__).parents[2] / "examples" / "scara.toml")
    quill, out = model.names.index("quill"), 0.33
    zero, moved = (body_placements(model, [0, 0, q, 0]) for q in (0.0, out))
    shapes = posed_arm(model, [0, 0, out, 0])
    parent = model.bodies[quill].parent
    points = np.vstack([shape.positions for shape in shapes.shapes[parent]]) @ moved[parent].rotation.T
    points += moved[parent].position
    low, high = sorted((zero[quill].position[2], moved[quill].position[2]))
    assert high - low == pytest.approx(out)
    near = points[np.hypot(*(points[:, :2] - moved[quill].position[:2]).T) < 0.02]
    assert near[:, 2].min() == pytest.approx(low, abs=1e-9)
    assert near[:, 2].max() >= high - 1e-9
    lengths = [
        np.ptp(np.vstack([s.positions for s in body_shapes(model, travel)[0][parent]])[:, 2])
        for travel in ({}, {quill: (0.1, 0.2)}, {quill: (-0.1, 0.2)})
    ]
    assert lengths[0] < lengths[1] < lengths[2]

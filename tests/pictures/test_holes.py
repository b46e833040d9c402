"""Holes cut out of solids: the surface that is left bounds just what is left, and is as smooth as it was."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import armwright as aw
from armwright.description.database import parse
from armwright.model import build_model
from armwright.pictures.body_shapes import body_shapes
from armwright.pictures.posed_arm import posed_arm
from armwright.solids.shapes import SHAPES
from armwright.solids.surface import surface
from armwright.spatial import rotation_rpy
from physics.arms import workshop

BOX = {"shape": "box", "size_m": [0.2, 0.2, 0.04]}
SOLIDS = {
    "cylinder": {"radius_m": 0.1, "length_m": 0.3},
    "semi-cylinder": {"radius_m": 0.12, "length_m": 0.2},
    "box": {"size_m": [0.1, 0.2, 0.3]},
    "sphere": {"radius_m": 0.12},
    "prism": {"outline_m": [[0, 0], [0.2, 0], [0.2, 0.1], [0.1, 0.1], [0.1, 0.2], [0, 0.2]], "length_m": 0.1},
    "tube": {"outer_radius_m": 0.12, "inner_radius_m": 0.05, "length_m": 0.2},
    "cone": {"bottom_radius_m": 0.12, "top_radius_m": 0.0, "length_m": 0.2},
    "ellipsoid": {"semi_axes_m": [0.1, 0.15, 0.2]},
}


def visual(solid, xyz=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0), **more):
    return {"solid": solid, "xyz_m": list(xyz), "rpy_rad": list(rpy), **more}


def drawn(*visuals, folder=None) -> tuple[trimesh.Trimesh, trimesh.Trimesh, tuple[str, ...]]:
    """Triangles of a link in its frame, the same with equal corners merged, and notes."""
    data = workshop()
    for link in data["links"]:
        link["visuals"] = list(visuals) if link is data["links"][0] else []
    arm = build_model(parse(data, "x", folder=folder))
    shapes, notes = body_shapes(arm)
    (shape,) = [shape for each in shapes.values() for shape in each]
    at = arm.frames[data["links"][0]["name"]].placement
    positions = (shape.positions - at.position) @ at.rotation
    as_drawn = trimesh.Trimesh(positions, shape.triangles, vertex_normals=shape.normals @ at.rotation, process=False)
    return as_drawn, trimesh.Trimesh(positions, shape.triangles), notes


def inside(solid, points, xyz, rpy):
    mesh, local = surface(SHAPES[solid["shape"]](**solid)), (points - xyz) @ rotation_rpy(*rpy)
    normals, offsets = mesh.face_normals, np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles[:, 0])
    if solid["shape"] == "tube":
        away = np.hypot(*local.T[:2])
        return (
            (solid["inner_radius_m"] <= away)
            & (away <= solid["outer_radius_m"])
            & (abs(local[:, 2]) <= solid["length_m"] / 2)
        )
    if solid["shape"] == "prism":
        x, y, z = local.T
        return (
            (abs(z) <= solid["length_m"] / 2)
            & (x >= 0)
            & (y >= 0)
            & (np.maximum(x, y) <= 0.2)
            & (np.minimum(x, y) <= 0.1)
        )
    return (local @ normals.T <= offsets).all(axis=1)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("shape", sorted(SOLIDS))
@pytest.mark.sample(5)
def test_what_is_left_closes_and_has_the_volume(shape, seed):
    """Two holes of any kind, some square to the solid: the faces close, and bound the solid less the holes."""
    rng = np.random.default_rng([seed, sorted(SOLIDS).index(shape)])
    small = {"cylinder": {"radius_m": 0.04, "length_m": 0.4}, "box": {"size_m": [0.06, 0.05, 0.5]}}
    solid, holes = {"shape": shape, **SOLIDS[shape]}, []
    for k in range(2):
        kind = ("box", "cylinder", "tube", "prism")[rng.integers(4)]
        angles = rng.choice([0.0, np.pi / 2, rng.uniform(-3, 3)], 3)
        position = rng.choice([0.0, 0.05, rng.uniform(-0.1, 0.1)], 3) + 1e-4 * k
        holes.append(({"shape": kind, **small.get(kind, SOLIDS[kind])}, position, angles))
    _, left, notes = drawn(visual(solid), *(visual(*hole, hole=True) for hole in holes))
    assert not notes
    assert left.is_watertight
    whole = surface(SHAPES[shape](**solid))
    low, high = whole.bounds
    points = np.random.default_rng(2).uniform(low, high, (40_000, 3))
    filled = inside(solid, points, np.zeros(3), np.zeros(3))
    for hole, position, angles in holes:
        filled &= ~inside(hole, points, position, angles)
    assert left.volume == pytest.approx(filled.mean() * np.prod(high - low), abs=0.03 * whole.volume)


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (0.3, 0.4, 0.5)])
@pytest.mark.parametrize("short", [0.0, 1e-9, 1e-6])
def test_a_bore_as_long_as_its_plate_goes_through(short, rpy):
    """Ends in one plane up to rounding: no film across the mouth, whichever way the plate is turned."""
    bore = {"shape": "cylinder", "radius_m": 0.05, "length_m": 0.04 - short}
    _, left, _ = drawn(visual(BOX, rpy=rpy), visual(bore, rpy=np.add(rpy, short), hole=True))
    solid, cut = (surface(SHAPES[each["shape"]](**each)).volume for each in (BOX, bore))
    assert left.volume == pytest.approx(solid - cut, rel=2e-4)
    assert left.euler_number == 0  # of a ring
    middles = left.triangles_center @ rotation_rpy(*rpy)
    assert (np.hypot(*middles[:, :2].T) > 0.048).all()


def test_a_hole_that_only_touches_takes_nothing_that_is_seen():
    _, left, _ = drawn(visual(BOX), visual(BOX, xyz=(0.0, 0.0, 0.04), hole=True))
    assert left.volume == pytest.approx(0.2 * 0.2 * 0.04, rel=1e-4)


def test_a_step_of_two_bores():
    """A counterbore on a bore: no wall between the two."""
    wide = visual({"shape": "box", "size_m": [0.1, 0.1, 0.02]}, xyz=(0.0, 0.0, 0.01), hole=True)
    narrow = visual({"shape": "box", "size_m": [0.05, 0.05, 0.02]}, xyz=(0.0, 0.0, -0.01), hole=True)
    _, left, _ = drawn(visual(BOX), wide, narrow)
    assert left.volume == pytest.approx(0.2 * 0.2 * 0.04 - 0.1 * 0.1 * 0.02 - 0.05 * 0.05 * 0.02, rel=1e-3)
    assert left.euler_number == 0
    step = np.abs(left.triangles[..., 2]).max(axis=1) < 1e-5
    assert left.area_faces[step].sum() == pytest.approx(0.1 * 0.1 - 0.05 * 0.05, rel=1e-3)


def test_round_walls_stay_smooth():
    """Normals on the wall of a bore point at its axis, those of the plate along it."""
    bore = {"shape": "cylinder", "radius_m": 0.05, "length_m": 0.04}
    shown, _, _ = drawn(visual(BOX), visual(bore, hole=True))
    away = np.hypot(*shown.vertices[:, :2].T)
    wall = (away < 0.0501) & (np.abs(shown.vertex_normals[:, 2]) < 0.5)
    assert wall.sum() >= 72
    np.testing.assert_allclose(shown.vertex_normals[wall, :2], -shown.vertices[wall, :2] / away[wall, None], atol=1e-6)
    flat = np.abs(shown.vertex_normals).max(axis=1) > 1 - 1e-6
    assert (wall | flat).all()


@pytest.mark.parametrize("turn", [0.0, 0.1, 0.7])
def test_outlines_with_points_on_their_edges_are_cut(turn):
    """Triangles of hardly any area, as rounding makes them there, leave no gap."""
    steps = np.arange(7)[:, None] / 7
    corners = 0.1 * np.array([[1, 0.3], [0.2, 1], [-1, 0.1], [0.1, -1]])
    outline = np.vstack([a + steps * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    outline = outline @ rotation_rpy(0.0, 0.0, turn)[:2, :2]
    outline[3] += 1e-10
    prism = {"shape": "prism", "outline_m": outline.tolist(), "length_m": 0.04}
    bore = {"shape": "cylinder", "radius_m": 0.02, "length_m": 0.04}
    _, left, notes = drawn(visual(prism), visual(bore, hole=True))
    assert not notes
    solid, cut = (surface(SHAPES[each["shape"]](**each)).volume for each in (prism, bore))
    assert left.volume == pytest.approx(solid - cut, rel=1e-3)


def test_a_solid_within_its_hole_is_gone():
    shell = visual({"shape": "box", "size_m": [1.0, 1.0, 1.0]}, hole=True, name="10 hole")
    _, left, _ = drawn(visual(BOX, name="10 gone"), shell, visual(BOX, name="20 stays"))
    assert left.volume == pytest.approx(0.2 * 0.2 * 0.04)


def test_meshes_are_cut_if_they_are_closed(tmp_path):
    """A concave mesh is cut as it is, one with a triangle of no area too; an open one is drawn whole, with a note."""
    ring = trimesh.creation.annulus(0.05, 0.1, 0.04)
    ring.export(tmp_path / "ring.stl")
    ring.update_faces(np.arange(len(ring.faces)) > 0)
    ring.export(tmp_path / "open.stl")
    slot = visual({"shape": "box", "size_m": [0.3, 0.02, 0.1]}, hole=True)
    mesh = {"shape": "mesh", "file": "ring.stl", "scale": 1.0}
    _, left, notes = drawn(visual(mesh), slot, folder=tmp_path)
    assert left.body_count == 2
    assert not notes
    box = trimesh.creation.box([0.2, 0.2, 0.04])
    a, b, c = box.faces[0]
    middle = box.vertices[[a, b]].mean(axis=0)
    faces = [*box.faces[1:], [a, 8, c], [8, b, c], [a, b, 8]]  # the last has no area
    trimesh.Trimesh([*box.vertices, middle], faces, process=False).export(tmp_path / "sliver.ply")
    _, left, notes = drawn(visual({**mesh, "file": "sliver.ply"}), slot, folder=tmp_path)
    assert left.body_count == 2
    assert not notes
    data = workshop()
    data["links"][0]["visuals"] = [visual({**mesh, "file": "open.stl"}, name="ring"), slot]
    arm = build_model(parse(data, "x", folder=tmp_path))
    (note,) = posed_arm(arm).notes
    assert note.place.endswith("visual 'ring'")
    assert "expected a closed surface" in note.what
    assert note.what.endswith("drawn without its holes")
    assert aw.show(arm, tmp_path / "arm.glb").notes == (note,)

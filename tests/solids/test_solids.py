"""Solids: closed forms of the textbook, fine meshes, and points that are counted all give the same volume, centre and inertia."""

from __future__ import annotations

import re
from math import pi

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings, strategies as st
from pydantic import TypeAdapter, ValidationError

from armwright.errors import DescriptionError
from armwright.solids.manifold import manifold
from armwright.solids.self_intersection import crossing_faces
from armwright.solids.shapes import SHAPES, Mesh, Solid
from raises_at import raises_at

R, r, L = 0.31, 0.12, 0.7
OUTLINE = [[0.1, 0.2], [0.9, 0.1], [1.0, 0.8], [0.5, 0.3]]  # not convex
SOLIDS = {
    "cylinder": {"radius_m": R, "length_m": L},
    "semi-cylinder": {"radius_m": R, "length_m": L},
    "box": {"size_m": [0.3, 0.4, 0.55]},
    "sphere": {"radius_m": R},
    "prism": {"outline_m": OUTLINE, "length_m": L},
    "tube": {"outer_radius_m": R, "inner_radius_m": r, "length_m": L},
    "cone": {"bottom_radius_m": R, "top_radius_m": r, "length_m": L},
    "ellipsoid": {"semi_axes_m": [0.3, 0.2, 0.5]},
}


def solid(shape: str, **dimensions):
    """Validated like a file's."""
    return TypeAdapter(Solid).validate_python({"shape": shape, **(dimensions or SOLIDS[shape])})


def hull(points):
    return trimesh.Trimesh(points).convex_hull


def circle(radius, z, angle=2 * pi, corners=512):
    turns = np.linspace(0, angle, corners)
    return np.column_stack([radius * np.cos(turns), radius * np.sin(turns), np.full(corners, z)])


def extruded(corners):
    return hull([[x, y, z] for x, y in corners for z in (-L / 2, L / 2)])


def fine_mesh(shape: str) -> list[trimesh.Trimesh]:
    """The same solid in triangles; a body that is not convex in convex pieces."""
    a, b, c, d = OUTLINE
    return {
        "cylinder": lambda: [trimesh.creation.cylinder(R, L, sections=512)],
        "semi-cylinder": lambda: [hull(np.vstack([circle(R, -L / 2, pi), circle(R, L / 2, pi)]))],
        "box": lambda: [trimesh.creation.box([0.3, 0.4, 0.55])],
        "sphere": lambda: [trimesh.creation.icosphere(5, R)],
        "prism": lambda: [extruded([a, b, d]), extruded([b, c, d])],
        "tube": lambda: [trimesh.creation.annulus(r, R, L, sections=512)],
        "cone": lambda: [hull(np.vstack([circle(R, -L / 2), circle(r, L / 2)]))],
        "ellipsoid": lambda: [trimesh.creation.icosphere(5).apply_scale([0.3, 0.2, 0.5])],
    }[shape]()


@pytest.mark.parametrize("shape", SOLIDS)
def test_against_a_fine_mesh(shape):
    """trimesh's sums over triangles agree to a thousandth."""
    one, pieces = solid(shape), fine_mesh(shape)
    volume = sum(piece.volume for piece in pieces)
    centre = sum(piece.volume * piece.center_mass for piece in pieces) / volume
    tensor = sum(piece.moment_inertia_frame(trimesh.transformations.translation_matrix(centre)) for piece in pieces)
    assert one.volume_m3 == pytest.approx(volume, rel=1e-3)
    np.testing.assert_allclose(one.centroid_m, centre, atol=1e-3 * volume ** (1 / 3))
    np.testing.assert_allclose(one.second_moments_m5, tensor, atol=1e-3 * np.trace(tensor))


def textbook(shape: str):
    """Volume, centroid and principal tensor at unit density as handbooks print them."""
    frustum = pi * L / 3 * (R * R + R * r + r * r)
    zz = 3 / 10 * frustum * (R**5 - r**5) / (R**3 - r**3)
    height = -L / 2 + L / 4 * (R * R + 2 * R * r + 3 * r * r) / (R * R + R * r + r * r)
    slices, weights = np.polynomial.legendre.leggauss(12)
    radius = (R + r) / 2 + (r - R) / 2 * slices
    xx = L / 2 * weights @ (pi * radius**4 / 4 + pi * radius**2 * (L / 2 * slices - height) ** 2)
    a, b, c = 0.3, 0.4, 0.55
    e, f, g = 0.3, 0.2, 0.5

    def cylinder(m, square):
        return m * (3 * square + L * L) / 12, m * (3 * square + L * L) / 12, m * square / 2

    full, half, wall = pi * R * R * L, pi * R * R * L / 2, pi * (R * R - r * r) * L
    ball, egg = 4 / 3 * pi * R**3, 4 / 3 * pi * e * f * g
    across = half * (1 / 4 - 16 / (9 * pi**2)) * R * R + half * L * L / 12
    return {
        "cylinder": (full, [0, 0, 0], cylinder(full, R * R)),
        "semi-cylinder": (
            half,
            [0, 4 * R / (3 * pi), 0],
            (across, half * (3 * R * R + L * L) / 12, half * (1 / 2 - 16 / (9 * pi**2)) * R * R),
        ),
        "box": (a * b * c, [0, 0, 0], [a * b * c * s / 12 for s in (b * b + c * c, a * a + c * c, a * a + b * b)]),
        "sphere": (ball, [0, 0, 0], [2 / 5 * ball * R * R] * 3),
        "tube": (wall, [0, 0, 0], cylinder(wall, R * R + r * r)),
        "cone": (frustum, [0, 0, height], (xx, xx, zz)),
        "ellipsoid": (egg, [0, 0, 0], [egg * s / 5 for s in (f * f + g * g, e * e + g * g, e * e + f * f)]),
    }[shape]


@pytest.mark.parametrize("shape", [shape for shape in SOLIDS if shape != "prism"])
def test_against_the_textbook(shape):
    """Formulas about the centroid, written another way, agree to rounding."""
    one, (volume, centre, principal) = solid(shape), textbook(shape)
    assert one.volume_m3 == pytest.approx(volume, rel=1e-12)
    np.testing.assert_allclose(one.centroid_m, centre, atol=1e-12)
    np.testing.assert_allclose(one.second_moments_m5, np.diag(principal), atol=1e-12 * max(principal))


def test_prisms_are_boxes_and_sums_of_triangles():
    """A rectangle is a box; any polygon is the signed sum of triangles to its corners."""
    box = solid("box", size_m=[0.4, 0.6, L])
    prism = solid("prism", outline_m=[[-0.2, -0.3], [-0.2, 0.3], [0.2, 0.3], [0.2, -0.3]], length_m=L)
    np.testing.assert_allclose(prism.moments().matrix, box.moments().matrix, atol=1e-15)
    a, b, c, d = OUTLINE
    pieces = [solid("prism", outline_m=piece, length_m=L).moments().matrix for piece in ([a, b, d], [b, c, d])]
    np.testing.assert_allclose(solid("prism").moments().matrix, sum(pieces), rtol=1e-12, atol=1e-16)


def test_meshes(tmp_path):
    """A file in millimetres, one that is mirrored, and all formats: the same solid."""
    body = trimesh.creation.annulus(120, 310, 700, sections=128)
    wanted = solid("tube").moments().matrix
    for kind in ("stl", "obj", "ply"):
        body.export(tmp_path / f"tube.{kind}")
        for scale in (0.001, [0.001, 0.001, -0.001]):
            mesh = Mesh(shape="mesh", file=str(tmp_path / f"tube.{kind}"), scale=scale)
            np.testing.assert_allclose(mesh.moments().matrix, wanted, atol=1e-3 * wanted.max())
    np.testing.assert_allclose(mesh.surface().bounds, [[-R, -R, -L / 2], [R, R, L / 2]], atol=1e-4)


def broken(kind: str) -> trimesh.Trimesh:
    """Meshes that bound nothing."""
    box, other = trimesh.creation.box([1, 1, 1]), trimesh.creation.box([1, 1, 1]).apply_translation([0.4, 0.3, 0.2])
    if kind == "open":
        box.update_faces(np.arange(len(box.faces)) > 0)
    elif kind == "crossing":
        box = trimesh.util.concatenate([box, other])
    elif kind == "flat":
        box.vertices[:, 2] = 0
    elif kind == "turned":
        box.faces[0] = box.faces[0][::-1]
    return box


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("open", "an open mesh has no volume"),
        ("crossing", "faces cross near"),
        ("flat", "a volume of|an open mesh|faces cross"),
        ("turned", "which side is out|faces cross|an open mesh"),
    ],
)
def test_meshes_that_bound_nothing(kind, message, tmp_path):
    path = tmp_path / f"{kind}.ply"
    broken(kind).export(path)
    with pytest.raises(DescriptionError) as caught:
        Mesh(shape="mesh", file=str(path), scale=1).moments()
    assert re.search(message, caught.value.what)
    assert caught.value.value == str(path)


@pytest.mark.parametrize("scale", [1e300, 1e13, [1.0, 1.0, -1e200]])
def test_meshes_beyond_any_robot(scale, tmp_path):
    """Volumes of such would leave the range of floats."""
    path = tmp_path / "box.stl"
    trimesh.creation.box([1, 1, 1]).export(path)
    with raises_at(DescriptionError, " mesh", r"1e\+12 m", value=str(path)):
        Mesh(shape="mesh", file=str(path), scale=scale).moments()


def test_an_object_file_opens_nothing_beside_it(tmp_path, monkeypatch):
    """A mesh names materials, which name textures: no business of its mass."""
    path = tmp_path / "box.obj"
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    lines = ["mtllib secret.mtl", *(f"v {x} {y} {z}" for x, y, z in corners), "usemtl red"]
    path.write_text("\n".join([*lines, "f 1 3 2", "f 1 2 4", "f 1 4 3", "f 2 3 4"]))
    (tmp_path / "secret.mtl").mkdir()  # opening it would fail
    opened = []
    monkeypatch.setattr("armwright.solids.mesh.read_file", lambda name, *rest: opened.append(name) or path.read_bytes())
    assert Mesh(shape="mesh", file=str(path), scale=1.0).moments().matrix[3, 3] == pytest.approx(1 / 6)
    assert opened == [path]


def nested(*sizes: float, turned: tuple[int, ...] = (), at: float = 0.0) -> trimesh.Trimesh:
    """Boxes in each other, some of them with their faces inward, the smaller ones moved along x."""
    boxes = []
    for k, size in enumerate(sizes):
        box = trimesh.creation.box([size] * 3).apply_translation([at if k else 0.0, 0.0, 0.0])
        if k in turned:
            box.invert()
        boxes.append(box)
    return trimesh.util.concatenate(boxes)


@pytest.mark.parametrize(
    ("mesh", "volume"),
    [
        (nested(3, 2, turned=(1,)), 27 - 8),
        (nested(3, 2, 1, turned=(1,)), 27 - 8 + 1),
        (nested(3, 2, 1, turned=(0, 2)), 27 - 8 + 1),
        (nested(3, 2, at=5.0), 27 + 8),
        (nested(3, 1, turned=(1,), at=0.5), 27 - 1),
        (nested(3, 2), "lies in another: its inside counts 2 times"),
        (nested(3, 1, at=0.5), "lies in another: its inside counts 2 times"),
        (nested(3, 2, turned=(0, 1)), "lies in another: its inside counts 2 times"),
        (nested(3, 2, 1, turned=(1, 2)), "points inward and lies in nothing"),
        (nested(3, 2, turned=(1,), at=5.0), "points inward and lies in nothing"),
    ],
)
def test_shells_of_one_mesh(mesh, volume, tmp_path):
    """Cavities, material in cavities and bodies apart add up; nothing counts twice."""
    mesh.export(tmp_path / "a.ply")
    read = Mesh(shape="mesh", file=str(tmp_path / "a.ply"), scale=1)
    if isinstance(volume, str):
        with pytest.raises(DescriptionError) as caught:
            read.moments()
        assert caught.value.what.endswith(volume)
    else:
        assert read.moments().amount == pytest.approx(volume, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("no.stl", None, "cannot be read: No such file"),
        ("text.stl", b"solid\nnothing\n", "no triangles|not a mesh"),
        ("cut.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 9\n", "not a mesh|no triangles"),
        ("arm.step", b"x", "no kind of mesh that is read"),
    ],
)
def test_files_that_are_no_meshes(name, content, message, tmp_path):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(DescriptionError) as caught:
        Mesh(shape="mesh", file=str(tmp_path / name), scale=1).moments()
    assert re.search(message, caught.value.what)
    assert "\n" not in str(caught.value)


def test_sound_meshes_do_not_cross():
    """Shared corners and edges are no crossing; a spike through a wall is."""
    for body in (
        trimesh.creation.torus(1, 0.3),
        trimesh.creation.annulus(0.1, 0.3, 0.7),
        trimesh.creation.icosphere(3),
    ):
        assert crossing_faces(np.asarray(body.triangles)) is None
    cubes = [trimesh.creation.box([1, 1, 1]), trimesh.creation.box([1, 1, 1]).apply_translation([0.5, 0.5, 0.5])]
    assert crossing_faces(np.asarray(trimesh.util.concatenate(cubes).triangles)) is not None
    twisted = trimesh.creation.box([1, 1, 1]).subdivide()  # its lower half mirrored: one shell through itself
    twisted.vertices[twisted.vertices[:, 2] < 0.1, 0] *= -1
    assert crossing_faces(np.asarray(twisted.triangles)) is not None
    assert manifold(twisted.vertices, twisted.faces).volume() > 0  # manifold3d sees nothing wrong with it


@pytest.mark.parametrize(
    ("shape", "dimensions", "message"),
    [
        ("prism", {"outline_m": [[0, 0], [1, 1], [1, 0], [0, 1]], "length_m": 1}, "edge 1 meets edge 3"),
        ("prism", {"outline_m": [[0, 0], [1, 0], [0.5, 0], [0.5, 1]], "length_m": 1}, "edge"),
        ("prism", {"outline_m": [[0, 0], [1, 0]], "length_m": 1}, "3 or more points"),
        ("prism", {"outline_m": [[0, 0], [1, 0], [2, 0]], "length_m": 1}, "runs back|bounds"),
        ("prism", {"outline_m": [[0, 0], [1, 0], [1, 0], [0, 1]], "length_m": 1}, "are the same"),
        ("prism", {"outline_m": [[1, 1], [1, 1], [1, 1]], "length_m": 1}, "points that differ"),
        ("tube", {"outer_radius_m": 0.1, "inner_radius_m": 0.1, "length_m": 1}, "expected less than outer_radius_m"),
        ("cone", {"bottom_radius_m": 0, "top_radius_m": 0, "length_m": 1}, "are both 0"),
        ("sphere", {"radius_m": 0}, "above 0"),
        ("box", {"size_m": [1, 0, 1]}, "above 0"),
    ],
)
def test_solids_that_are_none(shape, dimensions, message):
    with pytest.raises(ValidationError, match=message):
        solid(shape, **dimensions)


def test_every_shape_is_tested():
    assert set(SHAPES) == {*SOLIDS, "mesh"}


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    kind=st.sampled_from(["stl", "ply", "obj"]),
    noise=st.binary(max_size=200),
    where=st.integers(0, 400),
    text=st.booleans(),
)
def test_any_bytes_are_a_mesh_or_refused(kind, noise, where, text, tmp_path):
    """Noise in the middle of a sound file, or alone: our exception or a solid, nothing else."""
    body = trimesh.creation.box([1, 1, 1])
    sound = body.export(file_type="stl_ascii" if text and kind == "stl" else kind)
    sound = sound.encode() if isinstance(sound, str) else sound
    path = tmp_path / f"noise.{kind}"
    path.write_bytes(sound[:where] + noise + sound[where + len(noise) :])
    refusal = ""
    try:
        assert np.isfinite(Mesh(shape="mesh", file=str(path), scale=1).moments().matrix).all()
    except DescriptionError as error:
        refusal = str(error)
    assert "\n" not in refusal

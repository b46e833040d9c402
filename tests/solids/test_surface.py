"""Surfaces of solids: closed, facing outward, and of the solid's own volume as far as flat sides can be."""

import numpy as np
import pytest
from pydantic import TypeAdapter

from armwright.errors import DescriptionError
from armwright.solids.shapes import SHAPES, Solid
from armwright.solids.surface import extruded, surface

ELL = [[0, 0], [0.2, 0], [0.2, 0.1], [0.1, 0.1], [0.1, 0.2], [0, 0.2]]
SOLIDS = [
    {"shape": "cylinder", "radius_m": 0.1, "length_m": 0.3},
    {"shape": "semi-cylinder", "radius_m": 0.1, "length_m": 0.3},
    {"shape": "box", "size_m": [0.1, 0.2, 0.3]},
    {"shape": "sphere", "radius_m": 0.1},
    {"shape": "prism", "outline_m": ELL, "length_m": 0.3},
    {"shape": "prism", "outline_m": ELL[::-1], "length_m": 0.3},
    {"shape": "tube", "outer_radius_m": 0.1, "inner_radius_m": 0.09, "length_m": 0.3},
    {"shape": "cone", "bottom_radius_m": 0.1, "top_radius_m": 0.05, "length_m": 0.3},
    {"shape": "cone", "bottom_radius_m": 0.1, "top_radius_m": 0, "length_m": 0.3},
    {"shape": "cone", "bottom_radius_m": 0, "top_radius_m": 0.1, "length_m": 0.3},
    {"shape": "ellipsoid", "semi_axes_m": [0.1, 0.2, 0.05]},
]


@pytest.mark.parametrize(("around", "error"), [(36, 0.015), (128, 0.0015)])
@pytest.mark.parametrize("record", SOLIDS, ids=lambda record: record["shape"])
def test_closed_outward_and_of_the_right_size(record, around, error):
    """Volume and centre are those of the closed forms, the nearer the more sides there are."""
    solid = TypeAdapter(Solid).validate_python(record)
    mesh = surface(solid, around)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(solid.volume_m3, rel=error)  # positive: it faces outward
    assert mesh.center_mass == pytest.approx(solid.centroid_m, abs=0.1 * error)
    np.testing.assert_allclose(mesh.moment_inertia, solid.second_moments_m5, atol=3 * error * 0.05 * solid.volume_m3)


def test_every_shape_has_a_surface():
    assert {record["shape"] for record in SOLIDS} == set(SHAPES) - {"mesh"}


def teeth(count):
    """A comb: corners that see few others."""
    top = [[x, y] for k in range(count) for x, y in ((k, 0.0), (k + 0.5, 3.0))]
    return np.array([*top, [count, 0.0], [count, -1.0], [0.0, -1.0]], dtype=float)


def spiral(turns, wall=0.2):
    angle = np.linspace(0.0, 2 * np.pi * turns, 24 * turns)
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([rim * (1 + angle)[:, None], (rim * (1 + wall + angle)[:, None])[::-1]])


def with_points_on_edges(outline, count):
    steps = np.arange(count)[:, None] / count
    edges = zip(outline, np.roll(outline, -1, axis=0), strict=True)
    return np.vstack([a + steps * (b - a) for a, b in edges])


OUTLINES = {
    "comb": teeth(6),
    "spiral": spiral(3),
    "points on edges": with_points_on_edges(np.array(ELL), 5),
    "thin": np.array([[0, 0], [1, 0], [1, 1e-7], [0.5, 2e-7], [0, 1e-7]]),
    "many": with_points_on_edges(teeth(40), 20),
}


@pytest.mark.parametrize("turn", [0.0, 0.7])
@pytest.mark.parametrize("name", OUTLINES)
def test_polygons_are_covered_once(name, turn):
    """Lids of any polygon, either way round, close the prism and have the polygon's area."""
    outline = OUTLINES[name] @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    x, y = outline.T
    area = abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    for corners in (outline, outline[::-1]):
        mesh = extruded([corners], 2.0)
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        assert mesh.volume == pytest.approx(2 * area, rel=1e-9)
        lid = mesh.triangles[np.isclose(mesh.triangles[..., 2], 1.0).all(axis=1)]
        assert len(lid) == len(outline) - 2
        (a, b, c) = np.moveaxis(lid[..., :2], 1, 0)
        assert (np.linalg.det(np.stack([b - a, c - a], axis=1)) >= -1e-12 * area).all()


def test_a_collada_mesh_asks_for_its_extra(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    (tmp_path / "a.dae").write_text("<COLLADA/>")
    solid = TypeAdapter(Solid).validate_python({"shape": "mesh", "file": str(tmp_path / "a.dae"), "scale": [1, 1, 1]})
    with pytest.raises(DescriptionError, match=r"pip install armwright\[meshes\]"):
        surface(solid)

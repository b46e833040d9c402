"""Holes cut out of solids: the surface that is left bounds just what is left."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.description.solids.shapes import SHAPES
from armwright.pictures.cells import cells
from armwright.pictures.cut import Cuttable, without
from armwright.pictures.surfaces import surface
from armwright.spatial import Placement, rotation_rpy

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


def solid(shape: str, at: Placement | None = None, **sizes) -> Cuttable:
    at = Placement.identity() if at is None else at
    made = SHAPES[shape](shape=shape, **(sizes or SOLIDS[shape]))
    mesh = surface(made).copy()
    mesh.apply_transform(at.matrix())
    faces = [np.hstack([t, np.broadcast_to(n, (3, 3))]) for t, n in zip(mesh.triangles, mesh.face_normals, strict=True)]
    return Cuttable(faces, [cell.placed(at) for cell in cells(made)])


def volume(faces: list[np.ndarray]) -> float:
    """Of what closed faces bound, by the divergence theorem."""
    fans = np.array([face[[0, k, k + 1], :3] for face in faces for k in range(1, len(face) - 1)])
    return float(np.linalg.det(fans).sum()) / 6 if len(fans) else 0.0


def area(faces: list[np.ndarray]) -> np.ndarray:
    """(3,): the sum of all faces' area vectors, 0 where they close."""
    return sum(
        (0.5 * np.cross(f[k, :3] - f[0, :3], f[k + 1, :3] - f[0, :3]) for f in faces for k in range(1, len(f) - 1)),
        np.zeros(3),
    )


def share(points: np.ndarray, solid: Cuttable) -> np.ndarray:
    return np.any([(points @ cell.normals.T <= cell.offsets).all(axis=1) for cell in solid.cells], axis=0)


@pytest.mark.parametrize("shape", sorted(SOLIDS))
def test_cells_fill_the_solid(shape):
    """The surface and the cells tell of the same body."""
    body = solid(shape)
    low, high = body.box()
    points = np.random.default_rng(1).uniform(low, high, (40_000, 3))
    filled = share(points, body).mean() * np.prod(high - low)
    assert filled == pytest.approx(volume(body.faces), rel=0.03)
    assert without(body, []) == body.faces


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("shape", sorted(SOLIDS))
def test_what_is_left_closes_and_has_the_volume(shape, seed):
    """Two holes of any kind, some square to the solid: the faces close, and bound the solid less the holes."""
    rng = np.random.default_rng([seed, sorted(SOLIDS).index(shape)])
    small = {"cylinder": {"radius_m": 0.04, "length_m": 0.4}, "box": {"size_m": [0.06, 0.05, 0.5]}}
    body, holes = solid(shape), []
    for k in range(2):
        kind = ("box", "cylinder", "tube", "prism")[rng.integers(4)]
        angles = rng.choice([0.0, np.pi / 2, rng.uniform(-3, 3)], 3)
        position = rng.choice([0.0, 0.05, rng.uniform(-0.1, 0.1)], 3) + 1e-4 * k
        holes.append(solid(kind, Placement(rotation_rpy(*angles), position), **small.get(kind, {})))
    left = without(body, holes)
    np.testing.assert_allclose(area(left), 0.0, atol=2e-6)
    low, high = body.box()
    points = np.random.default_rng(2).uniform(low, high, (40_000, 3))
    gone = share(points, holes[0]) | share(points, holes[1])
    filled = (share(points, body) & ~gone).mean() * np.prod(high - low)
    assert volume(left) == pytest.approx(filled, abs=0.03 * volume(body.faces))


def test_a_hole_as_long_as_its_solid_goes_through():
    """Ends in one plane: no lid stays."""
    plate = solid("box", size_m=[0.2, 0.2, 0.02])
    bore = solid("cylinder", radius_m=0.05, length_m=0.02)
    left = without(plate, [bore])
    assert volume(left) == pytest.approx(volume(plate.faces) - volume(bore.faces), rel=1e-9)
    middles = np.array([face[:, :3].mean(axis=0) for face in left])
    assert (np.hypot(*middles[:, :2].T) > 0.048).all()


def test_a_hole_that_only_touches_takes_nothing():
    plate = solid("box", size_m=[0.2, 0.2, 0.02])
    above = solid("box", Placement(np.eye(3), np.array([0.0, 0.0, 0.02])), size_m=[0.1, 0.1, 0.02])
    assert volume(without(plate, [above])) == pytest.approx(volume(plate.faces))


def test_a_step_of_two_bores():
    """A counterbore on a bore: no wall between the two."""
    plate = solid("box", size_m=[0.2, 0.2, 0.04])
    wide = solid("box", Placement(np.eye(3), np.array([0.0, 0.0, 0.01])), size_m=[0.1, 0.1, 0.02])
    narrow = solid("box", Placement(np.eye(3), np.array([0.0, 0.0, -0.01])), size_m=[0.05, 0.05, 0.02])
    left = without(plate, [wide, narrow])
    assert volume(left) == pytest.approx(0.2 * 0.2 * 0.04 - 0.1 * 0.1 * 0.02 - 0.05 * 0.05 * 0.02)
    np.testing.assert_allclose(area(left), 0.0, atol=1e-12)
    step = [f for f in left if (np.abs(f[:, 2]) < 1e-9).all()]
    assert sum(float(np.linalg.norm(area([f]))) for f in step) == pytest.approx(0.1 * 0.1 - 0.05 * 0.05)

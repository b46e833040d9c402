"""Bodies that are cut out of each other: faces in one plane, cavities, and surfaces that bound nothing."""

import numpy as np
import pytest
import trimesh
from trimesh.creation import box, cylinder

from armwright.errors import DescriptionError
from armwright.solids.manifold import manifold
from armwright.spatial import rotation_rpy

TURNED = rotation_rpy(0.3, 0.4, 0.5)


def body(mesh, at=(0.0, 0.0, 0.0), turn=None):
    vertices = (mesh.vertices + np.array(at)) @ (np.eye(3) if turn is None else turn).T
    return manifold(vertices, mesh.faces)


@pytest.mark.parametrize("turn", [None, TURNED])
def test_boxes_that_touch(turn):
    """A face, an edge or a corner in common is no volume; together they have that of both."""
    one = body(box([1, 1, 1]), turn=turn)
    for at in ([1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0.5, 0.25]):
        two = body(box([1, 1, 1]), at, turn)
        assert (one ^ two).volume() == pytest.approx(0.0, abs=1e-15)
        assert (one + two).volume() == pytest.approx(2.0)
        assert (one - two).volume() == pytest.approx(1.0)


@pytest.mark.parametrize("turn", [None, TURNED])
def test_faces_in_one_plane(turn):
    """A bore as long as its plate, a body in another that has its face, the same body twice."""
    plate, bore = box([2, 2, 0.2]), cylinder(radius=0.5, height=0.2, sections=64)
    assert (body(plate, turn=turn) - body(bore, turn=turn)).volume() == pytest.approx(0.8 - bore.volume)
    assert (body(plate, turn=turn) ^ body(bore, turn=turn)).volume() == pytest.approx(bore.volume)
    assert (body(plate, turn=turn) - body(plate, turn=turn)).volume() == pytest.approx(0.0, abs=1e-12)
    assert (body(plate, turn=turn) + body(plate, turn=turn)).volume() == pytest.approx(0.8)


def test_cavities_and_surfaces_that_face_inward():
    hole = box([1, 1, 1])
    hole.invert()
    assert body(hole).volume() == pytest.approx(1.0)
    hollow = body(trimesh.util.concatenate([box([2, 2, 2]), hole]))
    assert hollow.volume() == pytest.approx(7.0)
    assert (hollow ^ body(box([1, 1, 1]))).volume() == pytest.approx(0.0)
    assert (hollow ^ body(box([4, 1, 1]))).volume() == pytest.approx(1.0)


def test_triangles_that_share_no_vertices():
    """Vertices of one place count as one, whatever else they carry; that is interpolated."""
    loose = box([1, 1, 1]).triangles.reshape(-1, 3)
    split = np.column_stack([loose, 2 * loose[:, 0] + 3])
    cut = manifold(split, np.arange(36).reshape(-1, 3)) - body(box([1, 1, 1]), [0.75, 0, 0])
    left = cut.trim_by_plane([-1, 0, 0], -1).to_mesh64().vert_properties
    assert cut.volume() == pytest.approx(0.75)
    own = left[:, 3] != 0  # the other body carries nothing
    assert left[own, 3] == pytest.approx(2 * left[own, 0] + 3)
    assert left[~own, 0] == pytest.approx(0.25)
    assert set(left[own, 0]) == {-0.5, 0.25}


def test_surfaces_that_bound_nothing():
    opened, turned = box([1, 1, 1]), box([1, 1, 1])
    opened.update_faces(np.arange(12) > 0)
    turned.faces[0] = turned.faces[0][::-1]
    for mesh in (opened, turned):
        with pytest.raises(DescriptionError, match="closed surface"):
            body(mesh)

"""Closed surfaces as bodies that can be united, intersected and subtracted.  [Smith2009]

manifold3d is called directly, in double precision: through trimesh it gets single precision, 0.1 µm on a robot. It accepts any
surface whose triangles pair up along every edge, in opposite directions. It does not notice faces that cross, which
`self_intersection.py` finds, nor a shell that counts twice, which `shells.py` finds. A million triangles take about a gigabyte
and a few seconds, less than the search for crossing faces that a mesh has passed before.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armwright.errors import DescriptionError

if TYPE_CHECKING:
    from manifold3d import Manifold


def manifold(vertices: np.ndarray, triangles: np.ndarray) -> Manifold:
    """Body that a closed surface bounds; a surface that faces inward is turned.

    Args:
        vertices: (v, 3 + k) positions [m], and k numbers more that are interpolated where the body is cut. Vertices may be
            there several times in one place, with other numbers.
        triangles: (f, 3) indices of vertices.
    Raises:
        DescriptionError: an open surface, or one whose faces disagree on which side is out.
    """
    from manifold3d import Error, Manifold, Mesh64

    a, b, c = np.moveaxis(vertices[triangles][..., :3] - vertices[0, :3], 1, 0)
    if np.einsum("ij,ij->", a, np.cross(b, c)) < 0:  # six times the volume that it bounds
        triangles = triangles[:, ::-1]
    mesh = Mesh64(np.ascontiguousarray(vertices, dtype=float), np.ascontiguousarray(triangles, dtype=np.uint64))
    mesh.merge()
    body = Manifold(mesh)
    if body.status() != Error.NoError:
        raise DescriptionError(expected="a closed surface whose faces agree on which side is out")
    return body

"""The solids of a link with its holes taken out, as patches of triangles."""

from __future__ import annotations

import numpy as np

from armwright.description.robot import Link
from armwright.solids.manifold import manifold
from armwright.solids.visual import Visual

# [m] by which a hole is larger when it is drawn. A bore as long as its plate ends in the plate's faces only up to the
# rounding of its pose, 1e-9 m after `parts build` and 1e-6 m where angles have six digits; subtracted as it is, it leaves a
# film across its mouth. Nobody sees 2 µm.
GROWN = 2e-6

Patch = tuple[np.ndarray, np.ndarray, np.ndarray]  # positions (v, 3), normals (v, 3), triangles (f, 3)


def holes_of(link: Link, visual: Visual) -> list[Visual]:
    """The holes that are taken out of a solid: those of its part, if there are parts, or all of the link.

    Visuals that were made of parts are called "PART SECTION", and a bushing in the bore of another part is not bored.
    """
    holes = [other for other in link.visuals if other.hole]
    own = [hole for hole in holes if _part(hole) is not None and _part(hole) == _part(visual)]
    solids = {_part(other) for other in link.visuals if not other.hole}
    return own + [hole for hole in holes if _part(hole) is None or _part(hole) not in solids]


def _part(visual: Visual) -> str | None:
    """The part that a visual is a section of, by its name."""
    part, _, section = (visual.name or "").partition(" ")
    return part if section else None


def bored(solid: Patch, holes: list[Patch]) -> Patch:
    """The patch of a solid less its holes; what was smooth stays smooth, as normals are interpolated along.

    Raises:
        DescriptionError: the solid or a hole is no closed surface.
    """
    from manifold3d import Manifold, OpType

    bodies = [manifold(np.hstack([solid[0], solid[1]]), solid[2])]
    bodies += [manifold(np.hstack([positions, -normals]), triangles) for positions, normals, triangles in holes]
    left = Manifold.batch_boolean(bodies, OpType.Subtract).to_mesh64()
    positions, normals = np.hsplit(left.vert_properties.reshape(-1, 6), 2)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return positions, normals, left.tri_verts.astype(int)

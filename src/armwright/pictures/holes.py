"""The solids of a link with its holes taken out, as patches of triangles."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.description.robot import Link
from armwright.description.solids.visual import Visual
from armwright.pictures.cells import cells
from armwright.pictures.cut import Cuttable, Face, without
from armwright.spatial import Placement

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


def cuttable(patch: Patch, solid: Any, at: Placement) -> Cuttable:
    """A solid whose surface is a patch, its own frame standing at `at` in the patch's."""
    positions, normals, triangles = patch
    faces = np.concatenate([positions[triangles], normals[triangles]], axis=2)
    return Cuttable(list(faces), [cell.placed(at) for cell in cells(solid)])


def bored(solid: Cuttable, holes: list[Cuttable]) -> Patch:
    """The patch of a solid less its holes."""
    faces = without(solid, holes)
    fans = np.array([face[[0, k, k + 1]] for face in faces for k in range(1, len(face) - 1)]).reshape(-1, 6)
    return fans[:, :3], _unit(fans[:, 3:]), np.arange(len(fans)).reshape(-1, 3)


def _unit(normals: Face) -> np.ndarray:
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)

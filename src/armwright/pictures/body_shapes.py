"""Shapes of an arm, body by body: its links' visuals with their holes taken out, or a figure of its joints."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import radians
from typing import Any

import numpy as np

from armwright.description.robot import Link
from armwright.errors import DescriptionError, Problem, RunError
from armwright.model import Model
from armwright.pictures.joint_figure import CYLINDER, GREY, Piece, joint_figure
from armwright.pictures.moving_cylinders import CylinderPart
from armwright.solids.manifold import manifold
from armwright.solids.surface import AROUND, surface
from armwright.solids.visual import Visual

CREASE = radians(30)  # faces that meet at a smaller angle are shaded as one smooth surface

# [m] by which a hole is larger when it is drawn. A bore as long as its plate ends in the plate's faces only up to the
# rounding of its pose, 1e-9 m after `parts build` and 1e-6 m where angles have six digits; subtracted as it is, it leaves a
# film across its mouth. 2 µm are not seen.
GROWN = 2e-6

Patch = tuple[np.ndarray, np.ndarray, np.ndarray]  # positions (v, 3), normals (v, 3), triangles (f, 3)
Colour = tuple[float, float, float]  # red, green, blue, 0 to 1, as on a screen (sRGB)


@dataclass(frozen=True, eq=False)
class Shape:
    """Triangles of one colour that move with one body, in the body's frame."""

    positions: np.ndarray  # (v, 3) [m]
    normals: np.ndarray  # (v, 3) unit vectors, outward
    triangles: np.ndarray  # (f, 3) indices, counter-clockwise from outside
    colour: Colour


def body_shapes(
    arm: Model, travel: Mapping[int, tuple[float, float]] | None = None, more: Iterable[Piece] = ()
) -> tuple[dict[int, list[Shape]], tuple[Problem, ...]]:
    """Shapes of each body, one for each colour; holes are cut out of the solids.

    Args:
        arm: the arm; its visuals are those of its description.
        travel: body → the least and the greatest position [m] of its joint, for the rail of a sliding joint in a figure.
        more: pieces that are drawn beside visuals or figure.
    Returns:
        shapes: body (BASE: what does not move) → shapes in the body's frame.
        notes: visuals that are drawn in another way than the record has them.
    Raises:
        RunError: a visual's mesh that is missing or cannot be read.
    """
    notes: list[Problem] = []
    patches = list(_visual_patches(arm, notes))
    if not patches:
        more = (*joint_figure(arm, travel or {}), *more)
    patches += [(body, colour, _smooth(mesh.apply_transform(at.matrix()))) for body, colour, mesh, at in more]
    merged: dict[int, dict[Colour, list[Patch]]] = defaultdict(lambda: defaultdict(list))
    for body, colour, patch in patches:
        merged[body][colour].append(patch)
    shapes = {
        body: [_merged(same, colour) for colour, same in colours.items()] for body, colours in sorted(merged.items())
    }
    return shapes, tuple(notes)


def rod_shape(part: CylinderPart) -> Shape:
    """A cylinder's piece, along z from its end."""
    from trimesh.creation import cylinder

    rod = cylinder(radius=part.radius, height=part.length, sections=AROUND)
    return _merged([_smooth(rod.apply_translation([0.0, 0.0, 0.5 * part.length]))], CYLINDER)


def _visual_patches(arm: Model, notes: list[Problem]) -> Iterator[tuple[int, Colour, Patch]]:
    """Body, colour and surface of every visual; a solid that cannot be cut is whole and noted."""
    for link in arm.description.links if arm.description is not None else ():
        for visual in link.visuals:
            if visual.hole:
                continue
            patch = _patch(arm, link, visual)
            if holes := holes_of(link, visual):
                try:
                    patch = _with_holes(patch, [_patch(arm, link, hole, GROWN) for hole in holes])
                except DescriptionError as error:
                    what = f"{error}; drawn without its holes"
                    notes.append(Problem(what, _place(link, visual), file=arm.name))
            colour = GREY if visual.colour is None else tuple(map(float, visual.colour))
            yield arm.frames[link.name].body, colour, patch  # type: ignore[misc]


def _patch(arm: Model, link: Link, visual: Visual, grown: float = 0.0) -> Patch:
    """Surface of a visual in the frame of the body that carries it, moved outward by `grown` [m]."""
    try:
        mesh = surface(visual.solid)
    except DescriptionError as error:
        raise RunError.of(*error.problems).within(_place(link, visual), arm.name) from None
    mesh.apply_transform((arm.frames[link.name].placement @ visual.placement()).matrix())
    mesh.vertices += grown * mesh.vertex_normals
    return _smooth(mesh)


def _place(link: Link, visual: Visual) -> str:
    name = repr(visual.name) if visual.name else f"number {link.visuals.index(visual) + 1}"
    return f"link {link.name!r} visual {name}"


def holes_of(link: Link, visual: Visual) -> list[Visual]:
    """Holes to cut out of a solid: those of its part, if there are parts, or all of the link.

    Visuals that come from parts are called "PART SECTION"; a bushing in the bore of another part is not bored.
    """
    holes = [other for other in link.visuals if other.hole]
    same_part = [hole for hole in holes if _part(hole) is not None and _part(hole) == _part(visual)]
    parts = {_part(other) for other in link.visuals if not other.hole}
    return same_part + [hole for hole in holes if _part(hole) is None or _part(hole) not in parts]


def _part(visual: Visual) -> str | None:
    """Name of the part that a visual is a section of."""
    part, _, section = (visual.name or "").partition(" ")
    return part if section else None


def _with_holes(solid: Patch, holes: list[Patch]) -> Patch:
    """Surface of a solid less its holes; smooth surfaces stay smooth, as normals are interpolated.

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


def _smooth(mesh: Any) -> Patch:
    """Triangles of a surface; a vertex on a crease is there once for each side of it.

    Triangles of no area stay: without them a closed surface may be open, and could not be cut.
    """
    from trimesh.graph import smooth_shade

    smooth = smooth_shade(mesh, angle=CREASE)
    normals = np.asarray(smooth.vertex_normals, dtype=float)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 0.5, normals / np.maximum(length, 1e-12), (0.0, 0.0, 1.0))
    return np.asarray(smooth.vertices, dtype=float), normals, np.asarray(smooth.faces)


def _merged(patches: list[Patch], colour: Colour) -> Shape:
    """Several surfaces as one."""
    starts = np.cumsum([0, *(len(positions) for positions, _, _ in patches)])
    triangles = np.vstack([faces + start for (_, _, faces), start in zip(patches, starts, strict=False)])
    positions, normals = (np.vstack([patch[k] for patch in patches]) for k in (0, 1))
    return Shape(positions, normals, triangles, colour)

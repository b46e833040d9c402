"""What an arm looks like, body by body: its links' visuals, or a figure of its joints where the record has none."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from math import radians
from typing import Any

import numpy as np

from armwright.description.robot import Link
from armwright.errors import DescriptionError, RunError
from armwright.model import BASE, Model
from armwright.pictures.holes import GROWN, Patch, bored, holes_of
from armwright.solids.surface import AROUND, surface
from armwright.solids.visual import Visual
from armwright.spatial import Placement, rotation_to_axis

CREASE = radians(30)  # faces that meet at less are shaded as one smooth surface
GREY, JOINT, TIP = (0.78, 0.79, 0.81), (0.0, 0.447, 0.698), (0.835, 0.369, 0.0)  # of what names no colour of its own
THICKNESS = 0.028  # of a drawn bone, in lengths of the whole arm


@dataclass(frozen=True, eq=False)
class Shape:
    """Triangles of one colour that move with one body, in the body's frame."""

    positions: np.ndarray  # (v, 3) [m]
    normals: np.ndarray  # (v, 3) unit vectors, outward
    triangles: np.ndarray  # (f, 3) indices, counter-clockwise from outside
    colour: tuple[float, float, float]  # red, green, blue, 0 to 1, as on a screen (sRGB)


def body_shapes(
    arm: Model, travel: Mapping[int, tuple[float, float]] | None = None
) -> tuple[dict[int, list[Shape]], tuple[str, ...]]:
    """What is drawn of each body, one shape a colour; holes are taken out of what they go through.

    Args:
        arm: the arm; its visuals are those of its description.
        travel: body → the least and the greatest position [m] that its joint has; a drawn sliding joint has a rail so long.
    Returns:
        shapes: body (BASE: what does not move) → shapes in the body's frame.
        notes: what could not be drawn as the record has it, a sentence each.
    Raises:
        RunError: a visual's mesh that is missing or cannot be read.
    """
    pieces, notes = _of_visuals(arm)
    pieces = pieces or _figure(arm, travel or {})
    shapes = {
        body: [_merged(own, colour) for colour, own in colours.items()] for body, colours in sorted(pieces.items())
    }
    return shapes, tuple(notes)


Pieces = dict[int, dict[tuple[float, float, float], list[Patch]]]


def _of_visuals(arm: Model) -> tuple[Pieces, list[str]]:
    pieces: Pieces = defaultdict(lambda: defaultdict(list))
    notes = []
    for link in arm.description.links if arm.description is not None else ():
        frame = arm.frames[link.name]
        for visual in link.visuals:
            if visual.hole:
                continue
            patch = _patch(arm, link, visual)
            if holes := holes_of(link, visual):
                try:
                    patch = bored(patch, [_patch(arm, link, hole, GROWN) for hole in holes])
                except DescriptionError as error:
                    notes.append(f"{_place(arm, link, visual)}: {error}; drawn without its holes")
            pieces[frame.body][_rgb(visual.colour)].append(patch)
    return pieces, notes


def _patch(arm: Model, link: Link, visual: Visual, grown: float = 0.0) -> Patch:
    """The surface of a visual, in the frame of the body that carries it; outward by so many metres."""
    try:
        mesh = surface(visual.solid)
    except DescriptionError as error:
        raise RunError(f"{_place(arm, link, visual)}: {error}") from None
    mesh.apply_transform((arm.frames[link.name].placement @ visual.placement()).matrix())
    mesh.vertices += grown * mesh.vertex_normals
    return _smooth(mesh)


def _place(arm: Model, link: Link, visual: Visual) -> str:
    called = repr(visual.name) if visual.name else f"number {link.visuals.index(visual) + 1}"
    return f"{arm.name}: link {link.name!r}, visual {called}"


def _rgb(colour: Any) -> tuple[float, float, float]:
    if colour is None:
        return GREY
    r, g, b = (float(v) for v in colour)
    return r, g, b


def _figure(arm: Model, travel: Mapping[int, tuple[float, float]]) -> Pieces:
    """A drum at every turning joint, a block at every sliding one, bones between them and a ball at the tip.

    A sliding joint has a rail from where it is at 0 to where it goes.
    """
    from trimesh.creation import box, cylinder, icosphere

    pieces: Pieces = defaultdict(lambda: defaultdict(list))
    bones = [(body.parent, *_end(body.placement)) for body in arm.bodies]
    if arm.tip is not None:
        tip = arm.frame()
        bones.append((tip.body, *_end(tip.placement)))
    size = THICKNESS * (sum(float(np.linalg.norm(end)) for _, end, _ in bones) or 1.0)
    for body, end, turn in bones:
        for start, leg in _legs(end, turn):
            length = float(np.linalg.norm(leg))
            if length > 0.05 * size:
                bone = cylinder(radius=0.55 * size, height=length, sections=AROUND)
                _put(pieces, body, GREY, bone, Placement(rotation_to_axis(leg), start + leg / 2))
                if start.any():
                    elbow = icosphere(subdivisions=3, radius=0.55 * size)
                    _put(pieces, body, GREY, elbow, Placement(np.eye(3), start))
    for k, body in enumerate(arm.bodies):
        turns = body.kind == "revolute"
        drum = cylinder(radius=size, height=2.4 * size, sections=AROUND) if turns else box(extents=3 * [2.2 * size])
        _put(pieces, k, JOINT, drum, Placement.identity())
        low, high = (0.0, 0.0) if turns else (min(travel.get(k, (0.0,))[0], 0.0), max(travel.get(k, (0.0,))[-1], 0.0))
        if high - low > 0.05 * size:
            rail = cylinder(radius=0.4 * size, height=high - low, sections=AROUND)
            middle = Placement(np.eye(3), np.array([0.0, 0.0, 0.5 * (low + high)]))
            _put(pieces, body.parent, GREY, rail, body.placement @ middle)
    foot = cylinder(radius=2.2 * size, height=0.5 * size, sections=AROUND)
    _put(pieces, BASE, GREY, foot, Placement(np.eye(3), np.array([0.0, 0.0, -0.25 * size])))
    if arm.tip is not None:
        body, end, _ = bones[-1]
        _put(pieces, body, TIP, icosphere(subdivisions=2, radius=0.8 * size), Placement(np.eye(3), end))
    return pieces


def _end(at: Placement) -> tuple[np.ndarray, np.ndarray]:
    """Where a bone ends (3,) [m], and the direction of the axis there (3,)."""
    return np.asarray(at.position, dtype=float), np.asarray(at.rotation, dtype=float)[:, 2]


def _legs(end: np.ndarray, axis: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """A bone's two legs, each a start and a vector (3,) [m]: along one joint's axis, then along the common normal.

    The axis is that at the near end (z, as classic Denavit-Hartenberg rows go) or that at the far end (as modified rows go),
    whichever leaves a leg that is normal to both.
    """
    near = np.array([0.0, 0.0, end[2]])
    far = (end @ axis) * axis
    if abs((end - near) @ axis) <= abs(end[2] - far[2]):
        return [(np.zeros(3), near), (near, end - near)]
    return [(np.zeros(3), end - far), (end - far, far)]


def _put(pieces: Pieces, body: int, colour: tuple[float, float, float], mesh: Any, at: Placement) -> None:
    mesh.apply_transform(at.matrix())
    pieces[body][colour].append(_smooth(mesh))


def _smooth(mesh: Any) -> Patch:
    """The triangles of a surface; vertices on a crease are there once for each side of it.

    Triangles of no area stay: without them a closed surface may be open, and could not be cut.
    """
    from trimesh.graph import smooth_shade

    smooth = smooth_shade(mesh, angle=CREASE)
    own = np.asarray(smooth.vertex_normals, dtype=float)
    length = np.linalg.norm(own, axis=1, keepdims=True)
    normals = np.where(length > 0.5, own / np.maximum(length, 1e-12), (0.0, 0.0, 1.0))
    return np.asarray(smooth.vertices, dtype=float), normals, np.asarray(smooth.faces)


def _merged(patches: list[Patch], colour: tuple[float, float, float]) -> Shape:
    """Several surfaces as one."""
    starts = np.cumsum([0, *(len(positions) for positions, _, _ in patches)])
    triangles = [own + start for (_, _, own), start in zip(patches, starts, strict=False)]
    positions, normals = (np.vstack([patch[k] for patch in patches]) for k in (0, 1))
    return Shape(positions, normals, np.vstack(triangles), colour)

"""A picture of a link from its sections, a colour a part: PNG bytes, drawn by matplotlib without a display."""

from __future__ import annotations

import io
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.parts.mass_properties import WeighedLink
from armwright.solids.surface import surface

if TYPE_CHECKING:
    import trimesh

COLOURS = ("#4878a8", "#d08740", "#5d9b63", "#b65c5c", "#8d76b0", "#8a6d5c", "#c985b5", "#7f7f7f", "#a8a444", "#4aa7b5")
AXES = (("x", "#c23b3b"), ("y", "#3b8f3b"), ("z", "#3b5bc2"))
HOLE = "#c0202080"
MOST_FACES = 4000  # of a mesh that is drawn


def colour_of_part(k: int) -> str:
    """Colour of the k-th part of a link, in its picture and its table."""
    return COLOURS[k % len(COLOURS)]


def link_picture(link: WeighedLink) -> bytes:
    """The sections in the link's frame, its axes, and its centre of mass as a black dot; holes as red lines.

    Args:
        link: weighed, with at least one section.
    Returns:
        png: a picture of at most 640 × 540 pixels.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    figure = Figure(figsize=(6.4, 5.4), dpi=100)
    FigureCanvasAgg(figure)
    axes: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False)
    corners = [np.zeros((1, 3))]
    for k, part in enumerate(link.parts):
        for section in part.sections:
            faces = _faces(surface(section.section.solid))
            for placement in section.placements:
                at = part.placement @ placement
                polygons = [face @ at.rotation.T + at.position for face in faces]
                if section.section.hole:
                    lines = Line3DCollection(polygons, colors=HOLE, linewidths=0.3, zorder=2)
                    axes.add_collection3d(lines, autolim=False)
                    continue
                corners += polygons
                shown = Poly3DCollection(
                    polygons,
                    facecolors=colour_of_part(k),
                    edgecolors="#00000018",
                    linewidths=0.3,
                    alpha=0.62,
                    shade=True,
                    zorder=1,
                )
                axes.add_collection3d(shown, autolim=False)
    box = np.vstack(corners)
    low, high = box.min(axis=0), box.max(axis=0)
    middle, half = (low + high) / 2, max(float((high - low).max()) / 2, 1e-6)
    for (name, colour), direction in zip(AXES, np.eye(3), strict=True):
        tip = 0.55 * half * direction
        axes.plot(*np.column_stack([np.zeros(3), tip]), color=colour, linewidth=2, zorder=3)
        axes.text(*(1.12 * tip), name, color=colour, fontsize=11, zorder=3)
    axes.scatter(*link.moments.centre.reshape(3, 1), color="black", s=36, zorder=4)
    for limits, centre in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle, strict=True):
        limits(centre - 0.8 * half, centre + 0.8 * half)
    axes.set_box_aspect((1, 1, 1))
    axes.view_init(elev=22, azim=-58)
    axes.set_axis_off()
    file = io.BytesIO()
    figure.savefig(file, format="png", bbox_inches="tight", pad_inches=0.1)
    return file.getvalue()


def _faces(boundary: trimesh.Trimesh) -> list[np.ndarray]:
    """Flat faces (k, 3) [m] of a surface, all with equally many corners, as matplotlib draws them.

    Triangles in one plane are one polygon, since matplotlib sorts by depth what it draws, and long triangles badly; around a
    hole they stay triangles.
    """
    if len(boundary.faces) > MOST_FACES:
        return list(boundary.triangles[:: 1 + len(boundary.faces) // MOST_FACES])
    alone, loops = np.ones(len(boundary.faces), dtype=bool), []
    for facet in boundary.facets:
        edges = {(int(a), int(b)) for k in facet for a, b in pairwise(boundary.faces[k][[0, 1, 2, 0]])}
        rim = [(a, b) for a, b in edges if (b, a) not in edges]
        after, loop = dict(rim), [rim[0][0]]
        for _ in rim[1:]:
            loop.append(after[loop[-1]])
        if len(set(loop)) == len(rim):
            loops.append(loop)
            alone[facet] = False
    loops += boundary.faces[alone].tolist()
    most = max(map(len, loops))  # corners twice: matplotlib would fill what is missing with anything
    return [boundary.vertices[np.array(loop)[np.arange(most) * len(loop) // most]] for loop in loops]

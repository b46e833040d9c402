"""A picture of a link from its sections, a colour a part: PNG bytes, drawn by matplotlib without a display."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from armwright.description.parts.section_faces import faces
from armwright.description.parts.weighing import WeighedLink

COLOURS = ("#4878a8", "#d08740", "#5d9b63", "#b65c5c", "#8d76b0", "#8a6d5c", "#c985b5", "#7f7f7f", "#a8a444", "#4aa7b5")
AXES = (("x", "#c23b3b"), ("y", "#3b8f3b"), ("z", "#3b5bc2"))
HOLE = "#c0202080"


def colour_of_part(k: int) -> str:
    """Of the k-th part of a link, in its picture and its table."""
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
            for placement in section.placements:
                at = part.placement @ placement
                polygons = _alike([face @ at.rotation.T + at.position for face in faces(section.section.solid)])
                if section.section.hole:
                    axes.add_collection3d(
                        Line3DCollection(polygons, colors=HOLE, linewidths=0.3, zorder=2), autolim=False
                    )
                    continue
                corners += polygons
                colour = colour_of_part(k)
                shown = Poly3DCollection(
                    polygons,
                    facecolors=colour,
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


def _alike(polygons: list[np.ndarray]) -> list[np.ndarray]:
    """The same polygons with equally many corners, some of them twice: matplotlib fills what is missing with anything."""
    most = max(map(len, polygons))
    return [polygon[np.arange(most) * len(polygon) // most] for polygon in polygons]

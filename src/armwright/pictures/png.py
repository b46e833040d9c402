"""PNG of an arm in one pose: the shaded picture, base axes, a scale."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from armwright.pictures.posed_arm import PosedArm, upright
from armwright.pictures.render import Camera, camera, render

AZIMUTH, ELEVATION = -0.95, 0.33  # [rad] where the camera stands
SHORTER = 560 / 900  # of the longer side, at least
MARGIN, FOOT = 0.05, 0.12  # of the picture on three sides, and below for axes and scale
AXES = (("x", "#cc4444"), ("y", "#3b8f3b"), ("z", "#4f74dd"))
INK = "#777777"  # readable on white and on black


def write_png(posed: PosedArm, path: Path, longer: int) -> None:
    """Writes a picture of the arm on transparent ground; `longer` is its longer side in pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    surfaces = posed.surfaces()
    points = surfaces.corners.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    floor = min(float(low[2]), 0.0)
    square = spacing(float(np.linalg.norm(high - low)))
    view = _view(points, longer)
    image = render(surfaces, view, floor, square)
    figure = Figure(figsize=(view.width / 100, view.height / 100), dpi=100, facecolor="none")
    FigureCanvasAgg(figure)
    axes: Any = figure.add_axes((0, 0, 1, 1))
    axes.imshow(image, interpolation="nearest", aspect="auto", extent=(0, view.width, view.height, 0))
    axes.set_axis_off()
    _triad(axes, view, upright(posed.arm))
    _scale(axes, view, points, square)
    figure.savefig(path, format="png", metadata={"Software": None})


def spacing(size: float) -> float:
    """Spacing of the grid [m]: 1, 2 or 5 times a power of ten, about an eighth of the size."""
    aim = max(size / 8, 1e-6)
    power = 10.0 ** np.floor(np.log10(aim))
    return float(power * max(step for step in (1, 2, 5) if step * power <= aim * 1.0000001))


def _view(points: np.ndarray, longer: int) -> Camera:
    """Camera whose picture is about as wide and as high as the arm."""
    shorter = round(longer * SHORTER)
    square = camera(points, AZIMUTH, ELEVATION, longer, longer)
    width, height = np.ptp(square.project(points)[:, :2], axis=0)
    aspect = float(width / max(height, 1e-9)) ** 0.6
    sides = (longer, round(longer / aspect)) if aspect > 1 else (round(longer * aspect), longer)
    width, height = (max(side, shorter) for side in sides)
    inner = camera(points, AZIMUTH, ELEVATION, round(width * (1 - 2 * MARGIN)), round(height * (1 - MARGIN - FOOT)))
    return Camera(inner.rotation, inner.eye, inner.focal, width, height, 0.5 * height * (FOOT - MARGIN))


def _triad(axes: Any, view: Camera, stand: np.ndarray) -> None:
    """Base axes in the lower left corner, as the camera sees their directions."""
    length = 0.05 * max(view.width, view.height)
    x, y = 1.4 * length, view.height - 0.9 * length
    for (name, colour), direction in sorted(
        zip(AXES, (view.rotation @ stand).T, strict=True), key=lambda each: -each[1][2]
    ):
        dx, dy = length * direction[:2]
        axes.plot([x, x + dx], [y, y + dy], color=colour, linewidth=2.2, solid_capstyle="round")
        axes.text(x + 1.32 * dx, y + 1.32 * dy, name, color=colour, fontsize=10, ha="center", va="center")


def _scale(axes: Any, view: Camera, points: np.ndarray, square: float) -> None:
    """A bar as long as a square of the grid, at the arm's distance."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    length = view.focal * square / float((middle - view.eye) @ view.rotation[2])
    x, y = view.width - 0.05 * view.height, view.height - 0.03 * view.height
    axes.plot([x - length, x], [y, y], color=INK, linewidth=2.2, solid_capstyle="butt")
    axes.text(x, y - 0.012 * view.height, f"grid {square:g} m", color=INK, fontsize=9, ha="right", va="bottom")

"""Pictures of a tuning: the Pareto front of two objectives, and the best score of each generation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armwright.results.svg import ink_axes
from armwright.tuning.objective import is_share

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from armwright.tuning.search import Tried

BLUE, ORANGE = "#2a7fc9", "#e07b1f"  # that are seen on white and on black
FAR = 3.0  # times the start or the front's far ends: gains beyond are not drawn
LEAST = 0.1  # of an axis, in parts of the start or as a share: smaller differences are not magnified


def draw_front(figure: Figure, tried: Tried, chosen: np.ndarray, ink: str, quiet: str) -> None:
    """Draws the first two objectives of all gains tried; less is better along both axes.

    Args:
        figure: to draw in.   tried: the gains.   chosen: (objectives,) of the result.
        ink, quiet: colours of words and of points.
    """
    axes = figure.subplots()
    places = tried.front()
    front = tried.values[places][:, :2]
    marks = np.vstack([tried.first[None, :2], chosen[None, :2], front])
    ends = np.array([marks.min(axis=0), marks.max(axis=0)])
    room = 0.06 * np.maximum(ends[1] - ends[0], LEAST)
    far = (
        np.minimum(tried.values[:, :2].max(axis=0), np.maximum(FAR * tried.first[:2], ends[1]))
        if len(front)
        else ends[1]
    )
    axes.plot(*tried.values[:, :2].T, ".", color=quiet, alpha=0.5, markersize=4, label="gains tried")
    axes.plot(*front.T, ".-", color=BLUE, drawstyle="steps-post", linewidth=1.6, markersize=8, label="Pareto front")
    axes.plot(*tried.first[:2], "s", color=ink, markersize=8, fillstyle="none", markeredgewidth=1.8, label="start")
    axes.plot(*chosen[:2], "*", color=ORANGE, markersize=14, label="chosen")
    low, high = ends[0] - room, np.maximum(far, ends[1]) + room
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    for name, label in zip(tried.names, (axes.set_xlabel, axes.set_ylabel), strict=False):
        label(f"{name.replace('_', ' ')}{'' if is_share(name) else ', relative to the start'}", color=ink)
    ink_axes(axes, ink)
    axes.legend(frameon=False, labelcolor=ink)


def draw_history(figure: Figure, history: np.ndarray, ink: str) -> None:
    """Draws the best score of each generation.

    Args:
        figure: to draw in.   history: (generations + 1,) scores, infinite before one keeps the margins.   ink: colour.
    """
    from matplotlib.ticker import MaxNLocator

    axes = figure.subplots()
    axes.plot(np.where(np.isfinite(history), history, np.nan), color=BLUE, drawstyle="steps-post", linewidth=1.6)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(0, 1.01 * max(len(history) - 1, 1))
    axes.set_xlabel("generation", color=ink)
    axes.set_ylabel("best score on the tuned lanes", color=ink)
    ink_axes(axes, ink)

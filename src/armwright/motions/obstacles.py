"""Distances of a planned motion from obstacles and between the arm's links."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from armwright.collision import BoxObstacle, PlaneObstacle, SphereObstacle, clearance
from armwright.errors import ModelError, ScenarioError
from armwright.model import Model
from armwright.motions.records import BoxTable, MotionTable, PlaneTable
from armwright.trajectory.keep_clear import nearest_along, too_near
from armwright.trajectory.limits_report import dense_times
from armwright.trajectory.motion import Motion


def check_clearance(arm: Model, motion: Motion, table: MotionTable, begins: list[float]) -> str:
    """A sentence on the least distance during a motion, the pair and the time; "" if the file sets no distance.

    Args:
        arm: the model.   motion: planned.   table: the file, with obstacles and `clearance_m`.   begins: [s] of its segments.
    Raises:
        ScenarioError: something comes nearer than that; names what, how near, when and in which segment.
    """
    if not table.obstacles and table.clearance_m is None:
        return ""
    obstacles = [obstacle(k, each) for k, each in enumerate(table.obstacles)]
    try:
        near = clearance(
            arm, obstacles, radius=table.link_radius_m, ignore=table.ignore, least=table.clearance_m or 0.0
        )
    except ModelError as error:  # whose file is the arm
        renamed = {"radius": "link_radius_m"}
        raise ScenarioError.of(
            *(replace(each, place=renamed.get(each.place, each.place), file="") for each in error.problems)
        ) from None
    found, when = nearest_along(near, lambda t: motion.at(t)[0], dense_times(motion))
    error = too_near(near, found, f" at {when:.4g} s")
    if error is not None:
        raise error.within(f"segments[{int(np.searchsorted(begins, when, side='right')) - 1}]")
    return f"{found} at {when:.4g} s"


def obstacle(k: int, table: Any) -> Any:
    """The obstacle of the k-th table.

    Raises:
        ScenarioError: a normal or a size that cannot be.
    """
    try:
        if isinstance(table, PlaneTable):
            return PlaneObstacle(table.point_m, table.normal, table.name)
        if isinstance(table, BoxTable):
            return BoxObstacle(table.size_m, table.position_m, table.rpy_rad, table.name)
        return SphereObstacle(table.radius_m, table.position_m, table.name)
    except ScenarioError as error:  # whose place begins with the obstacle's name
        own = f"{table.name}."
        raise error.renamed(lambda place: _key(place.removeprefix(own))).within(f"obstacles[{k}]") from None


def _key(field: str) -> str:
    """Key of an obstacle's table from the field of its type."""
    return {"normal": field, "rpy": "rpy_rad"}.get(field, f"{field}_m")

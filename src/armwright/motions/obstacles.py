"""Distances of a planned motion from obstacles and between the arm's links."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.collision import BoxObstacle, PlaneObstacle, SphereObstacle, clearance
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.motions.records import BoxTable, MotionTable, PlaneTable
from armwright.trajectory.limits import dense_times
from armwright.trajectory.motion import Motion


def check_clearance(arm: Model, motion: Motion, table: MotionTable, begins: list[float]) -> str:
    """What comes nearest to what during a motion, and when, in words; "" where the file asks for no distance.

    Args:
        arm: the model.   motion: planned.   table: the file, with obstacles and `clearance_m`.   begins: [s] of its segments.
    Raises:
        ScenarioError: something comes nearer than that; names what, how near, when and in which segment.
    """
    if not table.obstacles and table.clearance_m is None:
        return ""
    least, t = table.clearance_m or 0.0, dense_times(motion)
    near = clearance(arm, [_obstacle(each) for each in table.obstacles], radius=table.link_radius_m)
    found = near.nearest(motion.at(t)[0])
    when = float(t[found.index])
    if found.distance < least:
        segment = int(np.searchsorted(begins, when, side="right")) - 1
        one, two = found.pair
        how = (
            f"overlap by {-1e3 * found.distance:.4g} mm"
            if found.distance < 0.0
            else f"are {1e3 * found.distance:.4g} mm apart"
        )
        expected = f"{1e3 * least:.4g} mm or more"
        raise ScenarioError(f"{one} and {two} {how} at {when:.4g} s", place=f"segments[{segment}]", expected=expected)
    return f"{found} at {when:.4g} s"


def _obstacle(table: Any) -> Any:
    """The obstacle of a table."""
    if isinstance(table, PlaneTable):
        return PlaneObstacle(table.point_m, table.normal, table.name)
    if isinstance(table, BoxTable):
        return BoxObstacle(table.size_m, table.position_m, table.rpy_rad, table.name)
    return SphereObstacle(table.radius_m, table.position_m, table.name)

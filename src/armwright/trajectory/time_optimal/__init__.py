"""Time-optimal motions along paths, within the limits of joints and motors."""

from armwright.trajectory.time_optimal.motion import PathMotion
from armwright.trajectory.time_optimal.plan import time_optimal

__all__ = ["PathMotion", "time_optimal"]

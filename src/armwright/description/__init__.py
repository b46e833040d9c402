"""Robot descriptions as plain data with units and sources: no algorithms."""

from armwright.description.database import builtin_names, read_description
from armwright.description.robot import RobotDescription

__all__ = ["RobotDescription", "builtin_names", "read_description"]

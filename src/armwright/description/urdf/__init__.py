"""Robots in the Unified Robot Description Format, read strictly: what carries dynamics is used or refused. [URDF]"""

from armwright.description.urdf.reader import read_urdf

__all__ = ["read_urdf"]

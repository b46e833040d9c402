"""Robots in MuJoCo's XML, read through MuJoCo itself where it is installed. [MuJoCo]"""

from armwright.description.mjcf.reader import read_mjcf

__all__ = ["read_mjcf"]

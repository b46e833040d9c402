"""Motions of the tool in space: lines, arcs and poses, with joint positions along the path."""

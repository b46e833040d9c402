"""Motions of the tool in space: lines, arcs and poses, solved for the joints along the path."""

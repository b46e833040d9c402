"""Solids: shapes in closed form, meshes, and where they are drawn."""

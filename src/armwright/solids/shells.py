"""Closed shells of a surface, which must nest as those of a solid: outside, material, cavity, material in the cavity."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armwright.solids.manifold import manifold

if TYPE_CHECKING:
    import trimesh


def misplaced_shell(surface: trimesh.Trimesh) -> tuple[np.ndarray, int] | None:
    """A shell that cannot be a solid's: it counts its inside twice, or is a cavity outside of any material.

    Args:
        surface: closed, its faces do not cross; so of two shells one is in the other, or they are apart.
    Returns:
        place, number: the middle of the shell (3,) [m] and how often its inside counts, where the largest shell points outward;
            None where all nest as they should.
    """
    shells = surface.split(only_watertight=False, repair=False)
    if len(shells) == 1:
        return None
    bodies = [manifold(shell.vertices, shell.faces) for shell in shells]
    signs = np.sign([shell.volume for shell in shells])
    sizes = np.array([body.volume() for body in bodies])
    low, high = np.moveaxis(np.array([shell.bounds for shell in shells]), 1, 0)
    for k, body in enumerate(bodies):
        near = np.flatnonzero((low <= low[k]).all(axis=1) & (high[k] <= high).all(axis=1) & (sizes >= sizes[k]))
        # shells do not cross, so one contains all of another or nothing of it, but for rounding
        around = [j for j in near if 2 * (bodies[j] ^ body).volume() > sizes[k]]
        within = int(signs[np.argmax(sizes)] * signs[around].sum())
        if within not in (0, 1):
            return shells[k].triangles.mean(axis=(0, 1)), within
    return None

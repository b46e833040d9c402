"""The point that a tensor of inertia is about: moved to the centre of mass, and the signs by which a wrong one is known."""

from __future__ import annotations

import numpy as np

from armwright.spatial import parallel_axes, pseudo_inertia

IMPOSSIBLE = 1e-9  # an eigenvalue of the pseudo-inertia below minus this share of the largest is no rounding
SIGNIFICANT = 0.01  # a product m c c above this share of the tensor's largest entry would show in it
SAME = 1e-3  # relative: a product that was printed with three digits or more is no coincidence


def about_com(mass: float, com: np.ndarray, tensor: np.ndarray, about: str) -> np.ndarray:
    """The tensor about the centre of mass (3, 3) [kg m²]:  I_com = I - m ( |c|² 1 - c cᵀ )  where `about` is "frame".

    Args:
        mass: [kg].   com: (3,) [m] in the body's frame.   tensor: (3, 3) [kg m²].   about: "com" or "frame".
    """
    return tensor if about == "com" else tensor - parallel_axes(mass, com)


def impossible(mass: float, com: np.ndarray, tensor: np.ndarray, about: str) -> str | None:
    """Why no real body has this tensor about that point, or None: the triangle inequality of its principal moments.

    Args:
        mass: [kg].   com: (3,) [m] in the body's frame.   tensor: (3, 3) [kg m²].   about: "com" or "frame".
    """
    with np.errstate(over="ignore", invalid="ignore"):
        moved = about_com(mass, com, tensor, about)
        if not np.isfinite(pseudo_inertia(mass, com, moved).astype(float)).all():
            return "its numbers are too large to compute with"
    if _possible(mass, com, moved):
        return None
    a, b, c = np.linalg.eigvalsh(moved)
    fault = f"its principal moments about the centre of mass, {a:.4g}, {b:.4g} and {c:.4g} kg m², break the triangle inequality"
    if about == "frame" and _possible(mass, com, tensor):
        return f'{fault}; about the centre of mass it would be possible: did you mean inertia_about = "com"?'
    if about == "frame":
        return f"{fault}, and so they would about any other point"
    return fault


def frame_origin_sign(mass: float, com: np.ndarray, tensor: np.ndarray) -> str | None:
    """The sign that a tensor given about the centre of mass is about the frame's origin: its products are  -m c_i c_j.

    That is what the parallel axes alone give to a body which is symmetric about its own centre. It is told only where
    all products that m and c would make visible are there, to three digits, and the body without them is possible.

    Args:
        mass: [kg].   com: (3,) [m] in the body's frame.   tensor: (3, 3) [kg m²], said to be about the centre of mass.
    Returns:
        sign: a sentence, or None.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        gained = parallel_axes(mass, com)
    if not np.isfinite(gained).all():
        return None
    visible = [
        (i, j) for i, j in ((0, 1), (0, 2), (1, 2)) if abs(gained[i, j]) > SIGNIFICANT * float(np.abs(tensor).max())
    ]
    if not visible or any(abs(tensor[i, j] - gained[i, j]) > SAME * abs(gained[i, j]) for i, j in visible):
        return None
    if not _possible(mass, com, tensor - gained):
        return None
    i, j = visible[0]
    x, y = "xyz"[i], "xyz"[j]
    return f"{x}{y} = {tensor[i, j]:.4g} is -m c_{x} c_{y} = {gained[i, j]:.4g}: it looks like a tensor about the frame's origin"


def _possible(mass: float, com: np.ndarray, inertia_com: np.ndarray) -> bool:
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(mass, com, inertia_com).astype(float))
    return bool(eigenvalues[0] >= -IMPOSSIBLE * max(eigenvalues[-1], 0.0) and eigenvalues[-1] >= 0)

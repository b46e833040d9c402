"""A module's body as a link of an arm: its numbers in the link's frame, the tensor about the centre of mass."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.description.robot import Inertia, JointFrame, Link
from armwright.lint.feasibility import about_com
from armwright.modules.library import ModuleBody
from armwright.quantity import Quantity
from armwright.spatial import TENSOR, Placement, rpy_angles


def link_of(body: ModuleBody, name: str, source: str | None, placed: Placement) -> Link:
    """Link that is a module's body at `placed` in the link's frame.

    Numbers that stay as they are keep their sources and deviations; turned ones get deviations by linear
    propagation, as if independent, and the source of the number that most of it comes from.
    """
    fields: dict[str, Any] = {"name": name, "mass_kg": body.mass_kg, "source": source}
    if body.accept_impossible is not None:
        fields["accept_impossible"] = body.accept_impossible
    fields["visuals"] = tuple(visual.replace(**_pose(placed @ visual.placement())) for visual in body.visuals)
    unmoved = not placed.position.any() and np.array_equal(placed.rotation, np.eye(3))
    com, inertia = body.com_m, body.inertia_kg_m2
    if not (unmoved and body.inertia_about == "com"):
        tensor = about_com(float(body.mass_kg), np.array(com), inertia.matrix(), body.inertia_about)
        inertia = _turned(inertia, tensor, placed.rotation)
    return Link(**fields, com_m=com if unmoved else _moved(com, placed), inertia_kg_m2=inertia)


def frame_of(placed: Placement, source: str | None = None) -> JointFrame:
    """A placement as a frame of a robot file."""
    return JointFrame(source=source, **_pose(placed))


def _pose(placed: Placement) -> dict[str, Any]:
    return {"xyz_m": _floats(placed.position), "rpy_rad": _floats(rpy_angles(placed.rotation))}


def _floats(values: Any) -> list[float]:
    return [float(v) + 0.0 for v in values]  # + 0.0: no -0 in files


def _moved(com: Quantity, placed: Placement) -> Quantity:
    """A point in the frame that it is moved to; its variances are turned with it."""
    std = None
    if com.std is not None:
        std = tuple(_floats(np.sqrt(placed.rotation**2 @ np.broadcast_to(np.array(com.std, dtype=float), 3) ** 2)))
    return com.replace(value=tuple(_floats(placed.point(np.array(com)))), std=std)


def _turned(inertia: Inertia, tensor: np.ndarray, rotation: np.ndarray) -> Inertia:
    """R I Rᵀ; each entry is a weighted sum of the entries of I, which gives its deviation and its source."""
    turned = rotation @ tensor @ rotation.T
    old = [getattr(inertia, key) for key in TENSOR]
    deviations = np.array([0.0 if q.std is None else float(np.max(q.std)) for q in old])
    entries = {}
    for key, (i, j) in TENSOR.items():
        weights = np.array([_weight(rotation, i, j, k, l) for k, l in TENSOR.values()])
        main = old[int(np.argmax(np.abs(weights)))]
        std = float(np.sqrt(weights**2 @ deviations**2))
        value = float(turned[i, j]) + 0.0
        entries[key] = Quantity(value=value, std=std if std > 0 else None, source=main.source, date=main.date)
    return Inertia(source=inertia.source, **entries)


def _weight(rotation: np.ndarray, i: int, j: int, k: int, l: int) -> float:
    """Coefficient of the entry (k, l) of I in the entry (i, j) of R I Rᵀ."""
    weight = rotation[i, k] * rotation[j, l]
    return float(weight if k == l else weight + rotation[i, l] * rotation[j, k])

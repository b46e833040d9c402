"""A module's body as a link of an arm: its numbers told in the link's frame, tensor about the centre of mass."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.description.inertia_point import about_com
from armwright.description.robot import Inertia, JointFrame, Link
from armwright.modules.library import ModuleBody
from armwright.quantity import Quantity
from armwright.solids.visual import Visual
from armwright.spatial import Placement, rpy_angles

ENTRIES = (("xx", 0, 0), ("xy", 0, 1), ("xz", 0, 2), ("yy", 1, 1), ("yz", 1, 2), ("zz", 2, 2))


def link_of(body: ModuleBody, name: str, source: str | None, placed: Placement) -> Link:
    """A link: a body that stands at `placed` in the link's frame.

    Numbers that stay as they are keep their own sources and deviations; turned ones get deviations by linear
    propagation, as if independent, and the source of the number that most of it comes from.
    """
    fields: dict[str, Any] = {"name": name, "mass_kg": body.mass_kg, "source": source}
    if body.accept_impossible is not None:
        fields["accept_impossible"] = body.accept_impossible
    fields["visuals"] = tuple(_visual(visual, placed) for visual in body.visuals)
    still = not placed.position.any() and np.array_equal(placed.rotation, np.eye(3))
    fields["com_m"] = body.com_m if still else _moved(body.com_m, placed)
    if still and body.inertia_about == "com":
        return Link(**fields, inertia_kg_m2=body.inertia_kg_m2)
    tensor = about_com(float(body.mass_kg), np.array(body.com_m), body.inertia_kg_m2.matrix(), body.inertia_about)
    return Link(**fields, inertia_kg_m2=_turned(body.inertia_kg_m2, tensor, placed.rotation))


def frame_of(placed: Placement, source: str | None = None) -> JointFrame:
    """A placement as a file tells it."""
    return JointFrame(source=source, **_pose(placed))


def _pose(placed: Placement) -> dict[str, Any]:
    return {"xyz_m": [*_plain(placed.position)], "rpy_rad": [*_plain(rpy_angles(placed.rotation))]}


def _plain(values: Any) -> list[float]:
    return [float(v) + 0.0 for v in values]  # no -0


def _visual(visual: Visual, placed: Placement) -> Visual:
    return visual.replace(**_pose(placed @ visual.placement()))


def _moved(com: Quantity, placed: Placement) -> Quantity:
    """A point, moved; its variances turned along."""
    std = None if com.std is None else np.broadcast_to(np.array(com.std, dtype=float), 3)
    if std is not None:
        std = tuple(_plain(np.sqrt(placed.rotation**2 @ std**2)))
    return com.replace(value=tuple(_plain(placed.point(np.array(com)))), std=std)


def _turned(given: Inertia, tensor: np.ndarray, rotation: np.ndarray) -> Inertia:
    """R I Rᵀ, entry by entry as the sum of the given ones that it is."""
    turned = rotation @ tensor @ rotation.T
    old = [getattr(given, key) for key, _, _ in ENTRIES]
    entries = {}
    for key, i, j in ENTRIES:
        weights = np.array([_weight(rotation, i, j, k, l) for _, k, l in ENTRIES])
        most = old[int(np.argmax(np.abs(weights)))]
        deviations = np.array([0.0 if q.std is None else float(np.max(q.std)) for q in old])
        std = float(np.sqrt(weights**2 @ deviations**2))
        entries[key] = Quantity(
            value=float(turned[i, j]) + 0.0, std=std if std > 0 else None, source=most.source, date=most.date
        )
    return Inertia(source=given.source, **entries)


def _weight(rotation: np.ndarray, i: int, j: int, k: int, l: int) -> float:
    """How much of the entry (k, l) is in the entry (i, j) of R I Rᵀ."""
    weight = rotation[i, k] * rotation[j, l]
    return float(weight if k == l else weight + rotation[i, l] * rotation[j, k])

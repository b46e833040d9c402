"""One traced program for all arms of a structure: geometry and masses are inputs of it, so that no arm is traced by itself."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright import scalar
from armwright.model import Body, Drive, Frame, Model
from armwright.scalar import Array
from armwright.spatial import Placement

Structure = tuple[tuple[str, int], ...]  # (kind, parent) of every body; the last entry: ("tip", body that carries it)


def structure(model: Model) -> Structure:
    """What of an arm a traced program depends on."""
    return (*((body.kind, body.parent) for body in model.bodies), ("tip", model.frame().body))


def shapes(form: Structure) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the numbers of an arm of that structure, in the order of `numbers`."""
    n = len(form) - 1
    return {
        "rotation": (n, 3, 3),
        "position": (n, 3),
        "offset": (n,),
        "mass": (n,),
        "first_moment": (n, 3),
        "tip_rotation": (3, 3),
        "tip_position": (3,),
        "gravity": (3,),
    }


def numbers(model: Model) -> list[np.ndarray]:
    """The numbers of an arm: geometry, masses and first moments of its bodies, tip, gravity."""
    tip = model.frame().placement
    return [
        np.stack([body.placement.rotation for body in model.bodies]),
        np.stack([body.placement.position for body in model.bodies]),
        np.array([body.offset for body in model.bodies]),
        np.array([body.mass for body in model.bodies]),
        np.stack([body.first_moment for body in model.bodies]),
        tip.rotation,
        tip.position,
        model.gravity,
    ]


def skeleton(form: Structure, values: tuple[Array, ...]) -> Model:
    """An arm of numbers or symbols, with all that matters at rest and no tensors of inertia."""
    rotation, position, offset, mass, first_moment, tip_rotation, tip_position, gravity = values
    bodies = []
    for k, (kind, parent) in enumerate(form[:-1]):
        placed = Placement(rotation[k], position[k])
        fields: dict[str, Any] = {"kind": kind, "parent": parent, "placement": placed, "offset": offset[k]}
        fields |= {"mass": mass[k], "first_moment": first_moment[k], "inertia": scalar.zeros(3, 3)}
        bodies.append(Body(f"joint{k}", f"link{k}", link_frame=Placement.identity(), drive=Drive("torque"), **fields))
    tip = Frame(form[-1][1], Placement(tip_rotation, tip_position))
    return Model("skeleton", tuple(bodies), gravity, {"tip": tip}, "tip")

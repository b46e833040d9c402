"""Model with symbols for geometry and masses: one traced program serves all arms of a structure, with their numbers as inputs."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright import scalar
from armwright.model import Body, Drive, Frame, Model
from armwright.scalar import Array
from armwright.spatial import Placement

Structure = tuple[tuple[Any, int], ...]  # (kind, parent) of every body; the last entry: ("tip", body that carries it)


def structure(model: Model) -> Structure:
    """The properties of an arm that decide its traced program."""
    return (*((body.kind, body.parent) for body in model.bodies), ("tip", model.frame().body))


def parameter_shapes(form: Structure) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the parameters of an arm of that structure, in the order of `parameters_of`."""
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


def parameters_of(model: Model) -> list[np.ndarray]:
    """Parameters of an arm: geometry, masses and first moments of its bodies, tip, gravity."""
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


def parametric_model(form: Structure, values: tuple[Array, ...]) -> Model:
    """Arm of numbers or symbols, with all that matters at rest and without tensors of inertia."""
    rotation, position, offset, mass, first_moment, tip_rotation, tip_position, gravity = values
    bodies = []
    for k, (kind, parent) in enumerate(form[:-1]):
        placed = Placement(rotation[k], position[k])
        fields: dict[str, Any] = {"kind": kind, "parent": parent, "placement": placed, "offset": offset[k]}
        fields |= {"mass": mass[k], "first_moment": first_moment[k], "inertia": scalar.zeros(3, 3)}
        bodies.append(Body(f"joint{k}", f"link{k}", link_frame=Placement.identity(), drive=Drive("torque"), **fields))
    tip = Frame(form[-1][1], Placement(tip_rotation, tip_position))
    return Model("parametric", tuple(bodies), gravity, {"tip": tip}, "tip")

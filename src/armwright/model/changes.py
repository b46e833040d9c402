"""Changes that `Model.replace` offers: terms taken away, gravity, tip, name."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

import numpy as np

from armwright import scalar
from armwright.errors import ModelError
from armwright.model.tree import Tree
from armwright.scalar import Array

TERMS = {"friction": "friction", "rotors": "rotor_inertia", "efficiency": "efficiency"}  # that None takes away
CHANGES = (*TERMS, "gravity", "tip", "name")
AnyTree = TypeVar("AnyTree", bound=Tree)


def changed(model: AnyTree, name: str, value: Any) -> AnyTree:
    """The model with one change.

    Raises:
        ModelError: an unknown change, or a value that is none.
    """
    if name not in CHANGES:
        raise ModelError("replace has no such change", value=name, choices=CHANGES)
    if name in TERMS:
        if value is not None:
            raise ModelError(place=f"replace.{name}", value=value, expected="None, which takes it away")
        return dataclasses.replace(model, bodies=tuple(_without(body, name) for body in model.bodies))
    if name == "gravity":
        value = _gravity(value)
    elif name == "tip":
        model.frame(value)
    else:
        value = str(value)
    return dataclasses.replace(model, **{name: value})


def _without(body: Any, name: str) -> Any:
    if name == "friction":
        return dataclasses.replace(body, friction=None)
    absent = 0.0 if name == "rotors" else None
    return dataclasses.replace(body, drive=dataclasses.replace(body.drive, **{TERMS[name]: absent}))


def _gravity(value: Any) -> Array:
    try:
        gravity = scalar.array(value)
    except (TypeError, ValueError):  # rows of unequal length, or no numbers
        gravity = scalar.array([])
    if gravity.shape != (3,) or not (scalar.is_symbolic(gravity) or np.isfinite(gravity).all()):
        raise ModelError(place="replace.gravity", value=value, expected="three finite numbers [m/s²] in base axes")
    return gravity

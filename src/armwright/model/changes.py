"""Changes that `Model.replace` offers: terms taken away, gravity, tip, name."""

from __future__ import annotations

import dataclasses
import warnings
from typing import Any, TypeVar

import numpy as np

from armwright import scalar
from armwright.errors import ModelError, check_known
from armwright.model.tree import Tree
from armwright.printable import is_seen
from armwright.scalar import Array

TERMS = ("friction", "springs", "rotors", "efficiency", "firmware")  # that None takes away
# field, and its value without the term
OF_DRIVES = {"rotors": ("rotor_inertia", 0.0), "efficiency": ("efficiency", None)}
OF_JOINTS = {"friction": "friction", "springs": "spring"}
CHANGES = (*TERMS, "gravity", "tip", "name")
AnyTree = TypeVar("AnyTree", bound=Tree)


def changed(model: AnyTree, name: str, value: Any) -> AnyTree:
    """The model with one change.

    Raises:
        ModelError: an unknown change, or a value that is none.
    """
    check_known(ModelError, name, CHANGES, "no such change", place="replace")
    if name in TERMS:
        if value is not None:
            raise ModelError(place=f"replace.{name}", value=value, expected="None, which takes it away")
        bodies = tuple(_without(body, name) for body in model.bodies)
        return dataclasses.replace(model, bodies=bodies, cylinders=() if name == "springs" else model.cylinders)
    if name == "gravity":
        value = _gravity(value)
    elif name == "tip":
        model.frame(value)
    elif not isinstance(value, str) or not value or not is_seen(value):
        expected = "text without control or invisible characters"
        raise ModelError(place="replace.name", value=value, expected=expected)
    return dataclasses.replace(model, **{name: value})


def without_servos(model: Any) -> Any:
    """The model with what is behind servos' loops in their place; itself where it has none."""
    return model.replace(firmware=None) if any(body.drive.firmware is not None for body in model.bodies) else model


def _without(body: Any, name: str) -> Any:
    if name in OF_JOINTS:
        return dataclasses.replace(body, **{OF_JOINTS[name]: None})
    if name == "firmware":
        return dataclasses.replace(body, drive=body.drive.bridge)
    field, absent = OF_DRIVES[name]
    return dataclasses.replace(body, drive=dataclasses.replace(body.drive, **{field: absent}))


def _gravity(value: Any) -> Array:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", np.exceptions.ComplexWarning)
            gravity = scalar.array([]) if scalar.has_masked_entries(value) else scalar.array(value)
    except (TypeError, ValueError, OverflowError, RuntimeError, np.exceptions.ComplexWarning):
        # Rows of unequal length or without end, or no real numbers.
        gravity = scalar.array([])
    if gravity.shape != (3,) or not (scalar.is_symbolic(gravity) or np.isfinite(gravity).all()):
        raise ModelError(place="replace.gravity", value=value, expected="three finite numbers [m/s²] in base axes")
    return gravity

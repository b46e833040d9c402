"""What `replace` changes of a model: terms taken away, gravity, tip, name."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ModelError, nearest
from armwright.model.model import Model
from armwright.scalar import Array


def changed(model: Model, changes: Mapping[str, Any]) -> Model:
    """The model with changes made and noted; what may change is told at `Model.replace`.

    Raises:
        ModelError: an unknown change, or a value that is none.
    """
    told, result = dict(changes), model
    for what, value in told.items():
        result = _replaced(result, what, value)
    if "gravity" in told:
        told["gravity"] = result.gravity  # a copy of its own
    return dataclasses.replace(result, changes={**model.changes, **told})


def _gravity(value: Any) -> Array:
    try:
        gravity = scalar.array(value)
    except (TypeError, ValueError):  # rows of unequal length, or no numbers
        gravity = scalar.array([])
    if gravity.shape != (3,) or not (scalar.is_symbolic(gravity) or np.isfinite(gravity).all()):
        raise ModelError(f"replace(gravity={value!r}): expected three finite numbers [m/s²] in base axes")
    return gravity


def _replaced(model: Model, what: str, value: Any) -> Model:
    def bodies(change: Any) -> Model:
        return dataclasses.replace(model, bodies=tuple(change(body) for body in model.bodies))

    def drives(**parts: Any) -> Model:
        return bodies(lambda body: dataclasses.replace(body, drive=dataclasses.replace(body.drive, **parts)))

    if what in ("friction", "rotors", "efficiency"):
        if value is not None:
            raise ModelError(f"replace({what}={value!r}): only None, which takes it away, is offered")
        if what == "friction":
            return bodies(lambda body: dataclasses.replace(body, friction=None))
        return drives(rotor_inertia=0.0) if what == "rotors" else drives(efficiency=None)
    if what == "gravity":
        return dataclasses.replace(model, gravity=_gravity(value))
    if what == "tip":
        model.frame(value)
        return dataclasses.replace(model, tip=value)
    if what == "name":
        return dataclasses.replace(model, name=str(value))
    raise ModelError(
        f"replace({what}=...): {nearest(what, ['friction', 'rotors', 'efficiency', 'gravity', 'tip', 'name'])}"
    )

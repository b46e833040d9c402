"""Looks of a link: solids placed in its frame. Pictures use them; dynamics do not."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from armwright.quantity import Record, Vector3, optional
from armwright.solids.shapes import Solid
from armwright.spatial import Placement, rotation_rpy
from armwright.validation import Invalid


def _colour(value: Any) -> Any:
    numbers = isinstance(value, (list, tuple)) and len(value) == 3
    if not numbers or not all(isinstance(v, (int, float)) and not isinstance(v, bool) and 0 <= v <= 1 for v in value):
        raise Invalid(expected="3 numbers from 0 to 1: red, green, blue")
    return value


Colour = Annotated[tuple[float, ...], BeforeValidator(_colour)]


class Visual(Record):
    """A solid to be drawn, placed in its link's frame. A hole is taken out of the others."""

    source: str | None = None
    name: str | None = Field(default=None, min_length=1, description="Name.")
    solid: Solid = Field(description="The shape, with its dimensions.")
    xyz_m: Vector3 = Field(description="Origin of the solid in the link's frame.")
    rpy_rad: Vector3 = Field(description="Angles about the link's fixed x, then y, then z.")
    hole: bool = Field(default=False, description="true: a hole in the other solids of the link.")
    colour: Colour | None = optional("[red, green, blue], each from 0 to 1.")

    def placement(self) -> Placement:
        """The solid's frame in the link's."""
        return placement_of(self)


def placement_of(frame: Any) -> Placement:
    """Placement that a record with xyz_m [m] and rpy_rad [rad] (about fixed x, then y, then z) states; None: the identity."""
    if frame is None:
        return Placement.identity()
    return Placement(rotation_rpy(*np.array(frame.rpy_rad)), np.array(frame.xyz_m))

"""Solids of which parts consist, each in its own frame, with volume, centroid and second moments in closed form.

The axis of every round and every extruded solid is z, and the origin is in the middle of its length.
"""

from __future__ import annotations

from math import pi
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from armwright.quantity import NotNegative, Outline, Positive, Size3
from armwright.solids.mesh import Mesh
from armwright.solids.moments import Moments
from armwright.solids.outline import polygon_moments, why_not_simple
from armwright.solids.solid import SolidRecord
from armwright.validation import Invalid


class Cylinder(SolidRecord):
    """A full cylinder about z, centred at the origin."""

    shape: Literal["cylinder"] = Field(description="Kind of solid.")
    radius_m: Positive = Field(description="Of the circle.")
    length_m: Positive = Field(description="Along z, from -length/2 to length/2.")

    def moments(self) -> Moments:
        """V = π r² l;  ∫x² = ∫y² = V r²/4,  ∫z² = V l²/12."""
        r, length = float(self.radius_m), float(self.length_m)
        return _round(pi * r * r * length, r * r / 4, length)


class SemiCylinder(SolidRecord):
    """Half of a cylinder about z: the half with y ≥ 0. The origin is the middle of its flat face."""

    shape: Literal["semi-cylinder"] = Field(description="Kind of solid.")
    radius_m: Positive = Field(description="Of the half circle.")
    length_m: Positive = Field(description="Along z, from -length/2 to length/2.")

    def moments(self) -> Moments:
        """V = π r² l/2, centroid at y = 4r/(3π);  about it ∫x² = V r²/4, ∫y² = V r² (1/4 - 16/(9π²)), ∫z² = V l²/12."""
        r, length = float(self.radius_m), float(self.length_m)
        volume = pi * r * r * length / 2
        spread = volume * np.diag([r * r / 4, r * r * (0.25 - 16 / (9 * pi * pi)), length * length / 12])
        return Moments.of(volume, (0.0, 4 * r / (3 * pi), 0.0), spread)


class Box(SolidRecord):
    """A rectangular block, centred at the origin."""

    shape: Literal["box"] = Field(description="Kind of solid.")
    size_m: Size3 = Field(description="Along x, y, z.")

    def moments(self) -> Moments:
        """V = a b c;  ∫x² = V a²/12, and so on."""
        size = np.array(self.size_m)
        volume = float(size.prod())
        return Moments.of(volume, np.zeros(3), volume * np.diag(size * size / 12))


class Sphere(SolidRecord):
    """A full sphere about the origin."""

    shape: Literal["sphere"] = Field(description="Kind of solid.")
    radius_m: Positive = Field(description="Of the sphere.")

    def moments(self) -> Moments:
        """V = 4/3 π r³;  ∫x² = ∫y² = ∫z² = V r²/5."""
        r = float(self.radius_m)
        volume = 4 / 3 * pi * r**3
        return Moments.of(volume, np.zeros(3), volume * r * r / 5 * np.eye(3))


class Prism(SolidRecord):
    """Any simple polygon in the x-y plane, extruded along z on both sides of it."""

    shape: Literal["prism"] = Field(description="Kind of solid.")
    outline_m: Outline = Field(description="Corners [x, y] in order, either way round; the last joins the first.")
    length_m: Positive = Field(description="Along z, from -length/2 to length/2.")

    @model_validator(mode="after")
    def _simple(self) -> Prism:
        fault = why_not_simple(np.reshape(np.array(self.outline_m), (-1, 2)))
        if fault:
            raise Invalid(fault, place="outline_m")
        return self

    def moments(self) -> Moments:
        """The polygon's area moments times the length l;  ∫z² = V l²/12. [Steger1996]"""
        area, length = polygon_moments(np.array(self.outline_m)), float(self.length_m)
        matrix = np.zeros((4, 4))
        matrix[np.ix_((0, 1, 3), (0, 1, 3))] = area * length
        matrix[2, 2] = area[2, 2] * length**3 / 12
        return Moments(matrix)


class Tube(SolidRecord):
    """A hollow cylinder about z, centred at the origin."""

    shape: Literal["tube"] = Field(description="Kind of solid.")
    outer_radius_m: Positive = Field(description="Of the outside.")
    inner_radius_m: Positive = Field(description="Of the bore.")
    length_m: Positive = Field(description="Along z, from -length/2 to length/2.")

    @model_validator(mode="after")
    def _has_a_wall(self) -> Tube:
        inner, outer = float(self.inner_radius_m), float(self.outer_radius_m)
        if not inner < outer:
            raise Invalid(place="inner_radius_m", value=inner, expected=f"less than outer_radius_m = {outer:g}")
        return self

    def moments(self) -> Moments:
        """V = π (R² - r²) l;  ∫x² = ∫y² = V (R² + r²)/4,  ∫z² = V l²/12."""
        big, small, length = float(self.outer_radius_m), float(self.inner_radius_m), float(self.length_m)
        return _round(pi * (big - small) * (big + small) * length, (big * big + small * small) / 4, length)


class Cone(SolidRecord):
    """A cone or its frustum about z; the origin is half way up."""

    shape: Literal["cone"] = Field(description="Kind of solid.")
    bottom_radius_m: NotNegative = Field(description="At z = -length/2.")
    top_radius_m: NotNegative = Field(description="At z = +length/2; 0 for a pointed cone.")
    length_m: Positive = Field(description="Along z, from -length/2 to length/2.")

    @model_validator(mode="after")
    def _has_a_base(self) -> Cone:
        if not (float(self.bottom_radius_m) or float(self.top_radius_m)):
            raise Invalid("bottom_radius_m and top_radius_m are both 0", expected="a solid of some volume")
        return self

    def moments(self) -> Moments:
        """With r(u) = c + e u, z = l u, u = -½ … ½:  V = π l ∫r² du,  ∫z = π l² ∫u r² du,  ∫x² = π l/4 ∫r⁴ du."""
        bottom, top, length = float(self.bottom_radius_m), float(self.top_radius_m), float(self.length_m)
        c, e = (bottom + top) / 2, top - bottom
        volume = pi * length * (c * c + e * e / 12)
        xx = pi * length / 4 * (c**4 + c * c * e * e / 2 + e**4 / 80)
        zz = pi * length**3 * (c * c / 12 + e * e / 80)
        matrix = np.diag([xx, xx, zz, volume])
        matrix[2, 3] = matrix[3, 2] = pi * length**2 * c * e / 6
        return Moments(matrix)


class Ellipsoid(SolidRecord):
    """A full ellipsoid about the origin, its axes along x, y, z."""

    shape: Literal["ellipsoid"] = Field(description="Kind of solid.")
    semi_axes_m: Size3 = Field(description="Half of its size along x, y, z.")

    def moments(self) -> Moments:
        """V = 4/3 π a b c;  ∫x² = V a²/5, and so on."""
        axes = np.array(self.semi_axes_m)
        volume = 4 / 3 * pi * float(axes.prod())
        return Moments.of(volume, np.zeros(3), volume * np.diag(axes * axes / 5))


def _round(volume: float, radial: float, length: float) -> Moments:
    """A body of revolution of constant section: `radial` is ∫x²/V."""
    return Moments.of(volume, np.zeros(3), volume * np.diag([radial, radial, length * length / 12]))


Solid = Annotated[
    Cylinder | SemiCylinder | Box | Sphere | Prism | Tube | Cone | Ellipsoid | Mesh, Field(discriminator="shape")
]
SHAPES: dict[str, Any] = {
    solid.model_fields["shape"].annotation.__args__[0]: solid  # type: ignore[union-attr]
    for solid in (Cylinder, SemiCylinder, Box, Sphere, Prism, Tube, Cone, Ellipsoid, Mesh)
}

"""Densities of common materials, each with its source; a parts file's own [materials] override them."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib import resources

from pydantic import Field

from armwright.quantity import Positive, Record, Source, optional
from armwright.solids.visual import Colour


class Material(Record):
    """A material of sections."""

    source: str | None = None
    density_kg_per_m3: Positive = Field(description="Mass of a cubic metre.")
    colour: Colour | None = optional("[red, green, blue] of pictures, each from 0 to 1.")

    @property
    def density(self) -> float:
        """[kg/m³]."""
        return float(self.density_kg_per_m3)


class Materials(Record):
    """A table of materials with its sources."""

    sources: dict[str, Source]
    materials: dict[str, Material]


@cache
def common_materials() -> Materials:
    """The table that comes with Armwright, `materials.toml` beside this file."""
    text = (resources.files("armwright.parts") / "materials.toml").read_text(encoding="utf-8")
    return Materials.model_validate(tomllib.loads(text))

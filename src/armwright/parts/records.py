"""The Parts Database: links made of parts, parts made of sections, as in the mechanical drawings. [SwartzReport]

A section is a solid of one density; a part, known by its drawing number, is a set of sections, or carries what was weighed
and measured; a link is a set of parts, placed in a frame chosen for convenience.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from armwright.description.consistency import KINDS, check_sources, check_unique
from armwright.description.drive import Command
from armwright.description.robot import CylinderRecord, Inertia, Joint, JointFrame, Name, NamedFrame
from armwright.errors import ABSENT
from armwright.parts.materials import Material, common_materials
from armwright.quantity import Direction, NotZero, Positive, Record, Source, Vector3, optional
from armwright.solids.shapes import Solid
from armwright.solids.visual import placement_of
from armwright.spatial import Placement, rotation_to_axis, rotation_z
from armwright.validation import Invalid

MOST_COPIES = 1000  # of one section
Text = Annotated[str, Field(min_length=1)]


class LinearPattern(Record):
    """Copies in a row."""

    source: str | None = None
    type: Literal["linear"] = Field(description="Kind of pattern.")
    step_m: Direction = Field(description="From one copy to the next, in the part's frame.")

    def copies(self, count: int) -> list[Placement]:
        """Placement of each copy of the part's frame in it."""
        return [Placement(np.eye(3), k * np.array(self.step_m)) for k in range(count)]


class PolarPattern(Record):
    """Copies about an axis."""

    source: str | None = None
    type: Literal["polar"] = Field(description="Kind of pattern.")
    axis: Direction = Field(description="Direction of the axis in the part's frame.")
    through_m: Vector3 = Field(description="A point of the axis.")
    step_rad: NotZero | None = optional(
        "From one copy to the next; absent: the copies go evenly round the full circle."
    )

    def copies(self, count: int) -> list[Placement]:
        """Placement of each copy of the part's frame in it."""
        step = float(self.step_rad) if self.step_rad is not None else 2 * np.pi / count
        to_axis, through = rotation_to_axis(np.array(self.axis)), np.array(self.through_m)
        turns = [to_axis @ rotation_z(k * step) @ to_axis.T for k in range(count)]
        return [Placement(turn, through - turn @ through) for turn in turns]


class _WithSubstance(Record):
    """Base of sections and parts: either may name its material or its density, and not both."""

    @model_validator(mode="after")
    def _one_substance(self) -> Any:
        if getattr(self, "material", None) is not None and getattr(self, "density_kg_per_m3", None) is not None:
            raise Invalid("material and density_kg_per_m3", expected="one of them")
        return self

    @property
    def has_substance(self) -> bool:
        """True if it names a material or a density."""
        return getattr(self, "material", None) is not None or getattr(self, "density_kg_per_m3", None) is not None


class Section(_WithSubstance):
    """A solid of one density, or a hole of that shape, placed in its part."""

    source: str | None = None
    name: Text = Field(description="Name in the audit and in errors.")
    solid: Solid = Field(description="The shape, with its dimensions.")
    xyz_m: Vector3 = Field(description="Origin of the solid in the part's frame.")
    rpy_rad: Vector3 = Field(description="Angles about the part's fixed x, then y, then z.")
    material: Text | None = optional("A key of [materials]; absent: the part's.")
    density_kg_per_m3: Positive | None = optional("Instead of a material.")
    hole: bool = Field(default=False, description="true: it is taken out of the part, a section of negative mass.")
    count: Annotated[int, Field(ge=1, le=MOST_COPIES, strict=True)] = Field(
        default=1, description="Number of copies; more than one need a pattern."
    )
    pattern: Annotated[LinearPattern | PolarPattern, Field(discriminator="type")] | None = optional(
        "Places of the copies."
    )

    @model_validator(mode="after")
    def _repeats(self) -> Section:
        if self.count > 1 and self.pattern is None:
            raise Invalid(place=" count", value=self.count, expected="a pattern for the places of the copies")
        if self.count == 1 and self.pattern is not None:
            raise Invalid(place=" pattern", expected="count = 2 or more")
        return self

    def placements(self) -> list[Placement]:
        """Placement of each copy of the solid in the part's frame."""
        first = placement_of(self)
        copies = self.pattern.copies(self.count) if self.pattern is not None else [Placement.identity()]
        return [copy @ first for copy in copies]


class Pendulum(Record):
    """A part's moment of inertia about one axis, from how it swings or twists."""

    source: str | None = None
    axis: Direction = Field(description="Direction of the axis in the part's frame.")
    through_m: Vector3 = Field(description="A point of the axis.")
    inertia_kg_m2: Positive = Field(description="About the axis.")


class Part(_WithSubstance):
    """The object of one drawing. Measured values replace what the sections give."""

    source: str | None = None
    name: Text = Field(description="Drawing number, or another name.")
    title: Text | None = optional("Title of the drawing.")
    xyz_m: Vector3 = Field(description="Origin of the part's frame in the link's construction frame.")
    rpy_rad: Vector3 = Field(description="Angles about that frame's fixed x, then y, then z.")
    material: Text | None = optional("Of sections that name none.")
    density_kg_per_m3: Positive | None = optional("Instead of a material.")
    weighed_mass_kg: Positive | None = optional("From the scales.")
    measured_com_m: Vector3 | None = optional("Centre of mass in the part's frame.")
    measured_inertia_kg_m2: Inertia | None = optional("About the centre of mass, in the part's axes.")
    pendulums: tuple[Pendulum, ...] = Field(default=(), description="Moments of inertia about single axes.")
    overlaps: Literal["ok"] | None = optional('"ok": its sections overlap by design.')
    sections: tuple[Section, ...] = Field(default=(), description="One table a section.")

    @model_validator(mode="after")
    def _complete(self) -> Part:
        check_unique("sections", [section.name for section in self.sections])
        bare = [section.name for section in self.sections if not (section.has_substance or self.has_substance)]
        if bare:
            expected = "a material or density_kg_per_m3, here or in its part"
            raise Invalid(place=f" section {bare[0]!r}", expected=expected)
        if not self.sections:
            needed = ("weighed_mass_kg", "measured_com_m", "measured_inertia_kg_m2")
            missing = [key for key in needed if getattr(self, key) is None]
            if missing:
                raise Invalid("a part without sections", expected=" and ".join(missing))
        if self.measured_inertia_kg_m2 is not None and self.pendulums:
            raise Invalid("measured_inertia_kg_m2 and pendulums", expected="one of them")
        return self


class PartsLink(Record):
    """A link of parts. Its frame is as in the arm's file: that of the joint that moves it."""

    source: str | None = None
    name: Name = Field(description="Name in joints and errors.")
    frame: JointFrame | None = optional("The construction frame in the link's frame; absent: they are the same.")
    parts: tuple[Part, ...] = Field(description="One table a part; an empty list where the link has no mass.")

    @model_validator(mode="after")
    def _named_once(self) -> PartsLink:
        check_unique("parts", [part.name for part in self.parts])
        return self


class PartsDatabase(Record):
    """A robot arm in parts. All but [materials] and the links' parts is as in the arm's file that it is built into."""

    name: Name = Field(description="Name of the arm.")
    title: str | None = optional("One line for the catalogue.")
    notes: str | None = optional("Notes for users, in a few sentences.")
    source: str | None = optional("Source of every number below that names none of its own.")
    sources: dict[str, Source] = Field(default_factory=dict, description="[sources.KEY]: sources of numbers.")
    gravity_m_s2: Vector3 | None = optional("In base axes; absent: standard gravity along -z.")
    base: Name = Field(default="base", description="What the joints' parents call the base.")
    command: Command | None = optional("What drives the joints that do not say it themselves.")
    tip: Name | None = optional("The frame or link that kinematics and wrench are about.")
    materials: dict[str, Material] = Field(
        default_factory=dict, description="[materials.KEY]: densities, before those that come with Armwright."
    )
    joints: tuple[Joint, ...] = Field(description="One table a joint, in the order of q.")
    links: tuple[PartsLink, ...] = Field(description="One table a link.")
    frames: tuple[NamedFrame, ...] = Field(default=(), description="One table a named frame.")
    cylinders: tuple[CylinderRecord, ...] = Field(default=(), description="Gas springs and counterbalance cylinders.")

    @model_validator(mode="after")
    def _consistent(self) -> PartsDatabase:
        check_sources(self)
        for key, material in self.materials.items():
            source = material.density_kg_per_m3.source or material.source or self.source
            if source is None or (source not in self.sources and source not in KINDS):
                expected, known = "source = ... that is a key of [sources]", (*self.sources, *KINDS)
                raise Invalid(place=f"materials.{key}", value=source or ABSENT, expected=expected, choices=known)
        known = {**common_materials().materials, **self.materials}
        for place, record in self._records():
            if record.material is not None and record.material not in known:
                place = f"{place} material"
                raise Invalid("no key of [materials]", place=place, value=record.material, choices=known)
        return self

    def _records(self) -> Iterator[tuple[str, Part | Section]]:
        """Parts and sections with their places in the file."""
        for link in self.links:
            for part in link.parts:
                place = f"link {link.name!r} part {part.name!r}"
                yield place, part
                yield from ((f"{place} section {section.name!r}", section) for section in part.sections)

    def material(self, key: str) -> Material:
        """Material of that name: the file's own, or one that comes with Armwright."""
        return self.materials[key] if key in self.materials else common_materials().materials[key]

    def substance(self, part: Part, section: Section) -> tuple[str, float, Any]:
        """Substance of a section: name or density as text, density [kg/m³], and the material if there is one."""
        for record in (section, part):
            if record.density_kg_per_m3 is not None:
                density = float(record.density_kg_per_m3)
                return f"{density:g} kg/m³", density, None
            if record.material is not None:
                material = self.material(record.material)
                return record.material, material.density, material
        raise AssertionError(section.name)  # checked when the file was read

"""Links of a URDF: mass, centre of mass and tensor of inertia in the link's axes, and visuals. No mesh is opened."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from armwright.description.mesh_path import find_mesh, mesh_below
from armwright.description.robot import MASSLESS
from armwright.description.urdf.joints import bounded, pose
from armwright.description.urdf.reading import UrdfReading
from armwright.description.xml_tree import Element
from armwright.spatial import TENSOR, rotation_rpy

ROUNDING = 1e-15  # [kg m²]: a moment of inertia this far below 0 is an exporter's zero
Colours = dict[str, list[float]]
SHAPES = ("box", "cylinder", "sphere", "mesh", "capsule")
READ_MESHES = (".stl", ".obj", ".ply", ".dae")


def link_record(reading: UrdfReading, link: Element) -> dict[str, Any]:
    """A link as the record has it: `<inertia>` is about the centre of mass, in the axes of the inertial `<origin>`.

    Raises:
        DescriptionError: an incomplete inertial, a negative mass; with file and line.
    """
    name = link.word("name")
    what = f"link {name!r}"
    link.only_attributes("name", "type")
    reading.check_children(link)
    _check_oddities(reading, link, what)
    inertial = link.one("inertial")
    if inertial is None:
        reading.remark("link", name, "no inertia is stated: massless")
        return {"name": name, **MASSLESS}
    reading.check_children(inertial)
    mass, frame = reading.attempt(_mass, inertial, what), reading.attempt(pose, inertial.one("origin"))
    tensor_tag = inertial.needed("inertia", what)
    tensor_tag.only_attributes(*(f"i{entry}" for entry in TENSOR))
    entries = bounded(tensor_tag, [tensor_tag.number(f"i{entry}") for entry in TENSOR])
    frame = frame or pose(None)
    if any(frame["rpy_rad"]):
        entries = _turned(entries, rotation_rpy(*frame["rpy_rad"]))
    entries = [
        0.0 if entry in ("xx", "yy", "zz") and -ROUNDING < value < 0 else value
        for entry, value in zip(TENSOR, entries, strict=True)
    ]
    if min(entries[0], entries[3], entries[5]) < 0:
        moments = [entries[k] for k in (0, 3, 5)]
        expected = "moments of inertia of 0 or more [kg m²] in link axes"
        raise tensor_tag.error(place=f"{what} inertia", value=moments, expected=expected)
    tensor = dict(zip(TENSOR, entries, strict=True))
    return {"name": name, "mass_kg": mass, "com_m": frame["xyz_m"], "inertia_kg_m2": tensor}


def _mass(inertial: Element, what: str) -> float:
    """[kg]."""
    tag = inertial.needed("mass", what)
    tag.only_attributes("value")
    mass = bounded(tag, [tag.number("value")])[0]
    if mass < 0:
        raise tag.error(place=f"{what} mass", value=mass, expected="a number of 0 or more")
    return mass


def _turned(entries: list[float], rotation: np.ndarray) -> list[float]:
    """R I Rᵀ."""
    xx, xy, xz, yy, yz, zz = entries
    tensor = rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ rotation.T
    return [float(0.5 * (tensor[i, j] + tensor[j, i])) for i, j in TENSOR.values()]


def _check_oddities(reading: UrdfReading, link: Element, what: str) -> None:
    """Tags of other formats that some files carry along: harmless while they change nothing."""
    for tag, harmless in (("gravity", ("1", "true")), ("kinematic", ("0", "false"))):
        element = link.one(tag)
        if element is not None:
            if element.text.strip().lower() not in harmless:
                raise element.error(place=f"{what} <{tag}>", value=element.text.strip(), expected=harmless[0])
            reading.ignored[f"link/{tag}"] += 1
    origin = link.one("origin")
    if origin is not None:
        frame = pose(origin)
        if any(frame["xyz_m"]) or any(frame["rpy_rad"]):
            expected = "it in <inertial> or in the joint"
            raise origin.error("means nothing in a link", place=f"{what} <origin>", expected=expected)
        reading.ignored["link/origin"] += 1


def colours(robot: Element) -> Colours:
    """Colours [red, green, blue] of the materials that a robot names, wherever it defines them."""
    by_name: Colours = {}
    for material in (*robot.all("material"), *_materials(robot)):
        colour = material.one("color")
        if colour is not None and material.attributes.get("name"):
            by_name[material.attributes["name"]] = _rgb(colour)
    return by_name


def visuals(reading: UrdfReading, link: Element, named: Colours) -> list[dict[str, Any]]:
    """The visuals of a link as the record has them; a mesh that is not found is left out, and remarked.

    Raises:
        DescriptionError: an unknown shape, a size that is none, a path that leads out of its package.
    """
    records = []
    for visual in link.all("visual"):
        reading.check_children(visual)
        geometry = visual.needed("geometry")
        if len(geometry.children) != 1:
            raise geometry.error(f"{len(geometry.children)} shapes", expected=f"one of {', '.join(SHAPES)}")
        solid = _solid(reading, geometry.children[0], link.attributes.get("name", ""))
        if solid is not None:
            colour = _colour(visual.one("material"), named)
            records.append({"solid": solid, **pose(visual.one("origin")), **({"colour": colour} if colour else {})})
    return records


def _solid(reading: UrdfReading, shape: Element, link: str) -> dict[str, Any] | None:
    if shape.tag == "box":
        return {"shape": "box", "size_m": _sizes(shape, shape.numbers("size", 3))}
    if shape.tag == "sphere":
        return {"shape": "sphere", "radius_m": _sizes(shape, [shape.number("radius")])[0]}
    if shape.tag == "cylinder":
        radius, length = _sizes(shape, [shape.number("radius"), shape.number("length")])
        return {"shape": "cylinder", "radius_m": radius, "length_m": length}
    if shape.tag == "mesh":
        name = shape.word("filename")
        scale = bounded(shape, shape.numbers("scale", 3, (1.0, 1.0, 1.0)))
        if not all(scale):
            raise shape.wrong("scale", "numbers other than 0")
        if Path(name).suffix.lower() not in READ_MESHES:  # never looked for, wherever it lies
            reading.remark("link", link, f"a mesh is no {', '.join(READ_MESHES)}, and is not drawn")
            return None
        path = mesh_below(name, reading.meshes) or find_mesh(shape, name, reading.path, reading.packages)
        if path is None:
            reading.remark(
                "link", link, "a mesh is not on the search path, and is not drawn; meshes = FOLDER says where it lies"
            )
            return None
        return {"shape": "mesh", "file": str(path), "scale": scale}
    if shape.tag == "capsule":
        reading.remark("link", link, "a capsule is not drawn")
        return None
    raise shape.error("no shape", value=shape.tag, choices=SHAPES)


def _sizes(shape: Element, sizes: list[float]) -> list[float]:
    if not all(size > 0 for size in bounded(shape, sizes)):
        raise shape.error(value=min(sizes), expected="sizes above 0")
    return sizes


def _materials(robot: Element) -> list[Element]:
    """Materials that visuals define in place; others may use them by name."""
    return [m for link in robot.all("link") for visual in link.all("visual") for m in visual.all("material")]


def _colour(material: Element | None, named: Colours) -> list[float] | None:
    if material is None:
        return None
    inner = material.one("color")
    return _rgb(inner) if inner is not None else named.get(material.attributes.get("name", ""))


def _rgb(colour: Element) -> list[float]:
    """The first three of rgba, some files have but three or count to 255; clipped to a colour."""
    count = 3 if len(colour.attributes.get("rgba", "").split()) == 3 else 4
    return [min(max(part, 0.0), 1.0) for part in colour.numbers("rgba", count)[:3]]

"""What links of a URDF look like: boxes, cylinders, spheres and meshes. No mesh is opened until a picture asks for it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from armwright.description.mesh_path import find_mesh
from armwright.description.urdf.joints import bounded, pose
from armwright.description.urdf.reading import UrdfReading
from armwright.description.xml_tree import Element
from armwright.errors import nearest

Colours = dict[str, list[float]]
SHAPES = ("box", "cylinder", "sphere", "mesh", "capsule")
READ_MESHES = (".stl", ".obj", ".ply", ".dae")


def colours(robot: Element) -> Colours:
    """Colours [red, green, blue] of the materials that a robot names, wherever it defines them."""
    found: Colours = {}
    for material in (*robot.all("material"), *_materials(robot)):
        colour = material.one("color")
        if colour is not None and material.attributes.get("name"):
            found[material.attributes["name"]] = _rgb(colour)
    return found


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
            raise geometry.error(
                f"<geometry> holds {len(geometry.children)} shapes: expected one of {', '.join(SHAPES)}"
            )
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
            raise shape.error(f"<mesh scale={shape.attributes['scale']!r}>: expected numbers other than 0")
        if Path(name).suffix.lower() not in READ_MESHES:  # never looked for, wherever it lies
            reading.remark(f"a mesh is no {', '.join(READ_MESHES)}, and is not drawn", "link", link)
            return None
        path = find_mesh(shape, name, reading.path, reading.packages)
        if path is None:
            reading.remark("a mesh is not on the search path, and is not drawn", "link", link)
            return None
        return {"shape": "mesh", "file": str(path), "scale": scale}
    if shape.tag == "capsule":
        reading.remark("a capsule is not drawn", "link", link)
        return None
    raise shape.error(f"<{shape.tag}> is no shape; {nearest(shape.tag, SHAPES)}")


def _sizes(shape: Element, sizes: list[float]) -> list[float]:
    if not all(size > 0 for size in bounded(shape, sizes)):
        raise shape.error(f"<{shape.tag}>: a size of {min(sizes):g}: expected sizes above 0")
    return sizes


def _materials(robot: Element) -> list[Element]:
    """Materials that visuals define in place; others may use them by name."""
    return [m for link in robot.all("link") for visual in link.all("visual") for m in visual.all("material")]


def _colour(material: Element | None, named: Colours) -> list[float] | None:
    if material is None:
        return None
    own = material.one("color")
    return _rgb(own) if own is not None else named.get(material.attributes.get("name", ""))


def _rgb(colour: Element) -> list[float]:
    """The first three of rgba, some files have but three or count to 255; clipped to a colour."""
    count = 3 if len(colour.attributes.get("rgba", "").split()) == 3 else 4
    return [min(max(part, 0.0), 1.0) for part in colour.numbers("rgba", count)[:3]]

"""Links of a URDF: mass, centre of mass and tensor of inertia, turned from the inertial frame into the link's."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.description.urdf.joints import bounded, pose
from armwright.description.urdf.reading import UrdfReading
from armwright.description.xml_tree import Element
from armwright.spatial import rotation_rpy

ENTRIES = ("xx", "xy", "xz", "yy", "yz", "zz")
ROUNDING = 1e-15  # [kg m²]: a moment of inertia this far below 0 is an exporter's zero


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
        reading.remark("no inertia is stated: massless", "link", name)
        return {"name": name, "mass_kg": 0.0, "com_m": [0.0] * 3, "inertia_kg_m2": dict.fromkeys(ENTRIES, 0.0)}
    reading.check_children(inertial)
    mass_tag, tensor_tag = inertial.needed("mass", what), inertial.needed("inertia", what)
    mass_tag.only_attributes("value")
    tensor_tag.only_attributes(*(f"i{entry}" for entry in ENTRIES))
    mass = bounded(mass_tag, [mass_tag.number("value")])[0]
    if mass < 0:
        raise mass_tag.error(f"{what}: mass = {mass:g}: expected a number of 0 or more")
    entries = bounded(tensor_tag, [tensor_tag.number(f"i{entry}") for entry in ENTRIES])
    frame = pose(inertial.one("origin"))
    if any(frame["rpy_rad"]):
        entries = _turned(entries, rotation_rpy(*frame["rpy_rad"]))
    entries = [
        0.0 if entry in ("xx", "yy", "zz") and -ROUNDING < value < 0 else value
        for entry, value in zip(ENTRIES, entries, strict=True)
    ]
    if min(entries[0], entries[3], entries[5]) < 0:
        moments = ", ".join(f"{entries[k]:.4g}" for k in (0, 3, 5))
        raise tensor_tag.error(f"{what}: moments of inertia {moments} kg m² in link axes: no body has one below 0")
    tensor = dict(zip(ENTRIES, entries, strict=True))
    return {"name": name, "mass_kg": mass, "com_m": frame["xyz_m"], "inertia_kg_m2": tensor}


def _turned(entries: list[float], rotation: np.ndarray) -> list[float]:
    """R I Rᵀ."""
    xx, xy, xz, yy, yz, zz = entries
    tensor = rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ rotation.T
    return [float(0.5 * (tensor[i, j] + tensor[j, i])) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]


def _check_oddities(reading: UrdfReading, link: Element, what: str) -> None:
    """Tags of other formats that some files carry along: harmless while they change nothing."""
    for tag, harmless in (("gravity", ("1", "true")), ("kinematic", ("0", "false"))):
        found = link.one(tag)
        if found is not None:
            if found.text.strip().lower() not in harmless:
                raise found.error(f"{what}: <{tag}>{found.text.strip()[:60]}</{tag}>: expected {harmless[0]}")
            reading.ignored[f"link/{tag}"] += 1
    origin = link.one("origin")
    if origin is not None:
        frame = pose(origin)
        if any(frame["xyz_m"]) or any(frame["rpy_rad"]):
            raise origin.error(f"{what}: <origin> of a link means nothing: expected it in <inertial> or in the joint")
        reading.ignored["link/origin"] += 1

"""URDF → RobotDescription: the tree, its names, and how the parts come together."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from armwright.description.drive_file import PLACEHOLDER, add_drives, find_drive_file, read_drive_file
from armwright.description.friction import check_smoothing
from armwright.description.mesh_path import mesh_folders, package_folders
from armwright.description.paths import UNNAMEABLE
from armwright.description.robot import RobotDescription
from armwright.description.urdf.joints import check_masters, joint_record, with_mimic
from armwright.description.urdf.links import colours, link_record, visuals
from armwright.description.urdf.reading import GAZEBO_ELEMENTS, GAZEBO_PHYSICS, READ, UrdfReading
from armwright.description.urdf.transmissions import reductions
from armwright.description.xml_tree import Element, read_xml
from armwright.errors import DescriptionError, check_known
from armwright.joint_kinds import KINDS
from armwright.validation import validated

UNUSED = "of its transmission is not used"  # in the remark about a gear ratio of a joint without a motor
MIMIC = ("coupled", "independent", "fixed")
MOST_LINKS = 2000  # a tree of more is no robot, and would keep its checks busy for minutes


def read_urdf(
    path: str | os.PathLike[str],
    *,
    packages: Iterable[str | os.PathLike[str]] = (),
    meshes: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] = (),
    drive: str | os.PathLike[str] | None = None,
    smoothing: float | None = None,
    mimic: str = "coupled",
    ignore: Collection[str] = (),
) -> RobotDescription:
    """The description in a URDF, its base fixed; every number that carries dynamics is used or refused.

    Args:
        path: the file.
        packages: folders in which `package://` looks first; then ROS_PACKAGE_PATH and the parents of the file.
        meshes: folder or folders where meshes lie; looked through first, for the longest end of a mesh's path that is there.
        drive: the file of the drive train; by default NAME.drive.toml beside NAME.urdf, where there is one.
        smoothing: speed [rad/s | m/s] over which Coulomb friction changes its sign, an estimate of the caller's; by default
            it is not smoothed, and sticks in simulation.
        mimic: joints that follow others: "coupled" (default, as the file says), "independent" (joints of their own), or
            "fixed" (held).
        ignore: tags to leave out that are neither read nor known to be harmless.
    Returns:
        description: `remarks` tell what was left out or doubtful, `notes` what was ignored as harmless.
    Raises:
        DescriptionError: an invalid file; one line with file, line, element and reason.
    """
    check_known(DescriptionError, mimic, MIMIC, place="mimic")
    check_smoothing(smoothing)
    file = Path(path)
    robot = read_xml(file)
    beside = find_drive_file(file, drive)
    drives = None if beside is None else read_drive_file(beside)
    if isinstance(ignore, str):
        raise DescriptionError(place="ignore", value=ignore, expected=f"a list of tags, [{ignore!r}]")
    folders = package_folders(file, packages)
    reading = UrdfReading(file, folders, mesh_folders(meshes), smoothing, mimic, frozenset(ignore), drives)
    record = reading.attempt(_record, reading, robot)
    ratios = reductions(reading, robot)
    reading.attempt(reading.check_ignore)
    reading.check_wrong()
    assert record is not None
    if beside is not None and drives is not None:
        add_drives(beside, drives, record, ratios)
    unused = {}
    for k, joint in enumerate(record["joints"]):
        ratio = ratios.get(joint["name"], PLACEHOLDER)
        if abs(ratio) != PLACEHOLDER and KINDS[joint["type"]].moves and "motor" not in joint:
            unused[k] = ratio
            why = "as no motor is known: give one in the drive file"
            reading.remark("joint", joint["name"], f"gear ratio {ratio:g} {UNUSED}, {why}")
    found = _validated(reading, record)
    return found.with_gear_ratios({found.joints[k].name: ratio for k, ratio in unused.items()})


def _record(reading: UrdfReading, robot: Element) -> dict[str, Any]:
    """The robot as a table, as a robot file would have it."""
    if robot.tag != "robot":
        raise robot.error(expected="a URDF, whose first element is <robot>")
    reading.check_children(robot)
    _check_expanded(reading, robot)
    _check_gazebo(reading, robot)
    name = robot.word("name")
    if not robot.all("link"):
        raise robot.error("missing", place=f"robot {name!r} <link>", expected="at least one")
    if max(len(robot.all("link")), len(robot.all("joint"))) > MOST_LINKS:
        raise robot.error(f"more than {MOST_LINKS} links or joints", place=f"robot {name!r}", expected="one robot")
    root = reading.attempt(_root, robot) or ""
    named = reading.attempt(colours, robot) or {}
    read = [reading.attempt(joint_record, reading, joint) for joint in robot.all("joint")]
    pairs = [(joint, each) for joint, each in zip(robot.all("joint"), read, strict=True) if each is not None]
    read = [reading.attempt(with_mimic, reading, *pair) for pair in pairs]
    joints = [each for each in read if each is not None]
    if len(joints) == len(robot.all("joint")):
        reading.attempt(check_masters, robot.all("joint"), joints)
    links = []
    for link in robot.all("link"):
        seen = reading.attempt(visuals, reading, link, named)
        if link.attributes.get("name") == root and not link.all("inertial") and not seen:
            continue  # nothing but a name for the base
        read_link = reading.attempt(link_record, reading, link)
        links += [] if read_link is None else [read_link | ({"visuals": seen} if seen else {})]
    base = root
    if any(link["name"] == root for link in links):
        base = _base_for(joints, links)
        still = {"xyz_m": [0.0, 0.0, 0.0], "rpy_rad": [0.0, 0.0, 0.0]}
        joints.insert(0, {"name": f"{base}_to_{root}", "type": "fixed", "parent": base, "child": root, "frame": still})
    record: dict[str, Any] = {
        "name": name,
        "base": base,
        "command": "torque",
        "source": reading.source,
        "sources": {
            reading.source: {"kind": "import", "text": f"read from {reading.path.name}, a URDF, which names no sources"}
        },
        "joints": joints,
        "links": links,
    }
    if reading.smoothing is not None:
        text = "Chosen by whoever read the URDF: the speed over which Coulomb friction changes its sign"
        record["sources"][reading.smoothing_source] = {"kind": "estimate", "text": text}
    return record


def _base_for(joints: list[dict[str, Any]], links: list[dict[str, Any]]) -> str:
    """A name for what the first link stands on."""
    taken = {entry["name"] for entry in (*joints, *links)}
    return next(name for name in ("world", "ground", *(f"world{k}" for k in range(len(taken)))) if name not in taken)


def _root(robot: Element) -> str:
    """The one link that is no joint's child.

    Raises:
        DescriptionError: a name given twice, a parent or child that is no link, a closed chain, several roots, none.
    """
    links: dict[str, Element] = {}
    for link in robot.all("link"):
        _add(links, link, link.word("name"))
    joints: dict[str, Element] = {}
    movers: dict[str, str] = {}
    parents: dict[str, str] = {}
    for joint in robot.all("joint"):
        name = joint.word("name")
        _add(joints, joint, name)
        for side in ("parent", "child"):
            end = joint.needed(side, f"joint {name!r}")
            linked = end.word("link", f"joint {name!r} <{side}>")
            check_known(end.error, linked, links, "no link", place=f"joint {name!r} {side}")
        child = joint.needed("child").word("link")
        if child in movers:
            what = f"the child of two joints, {movers[child]!r} and {name!r}: closed chains are not offered"
            raise joint.error(what, place=f"link {child!r}")
        movers[child], parents[child] = name, joint.needed("parent").word("link")
    _check_plain(links)
    _check_plain(joints)
    roots = [name for name in links if name not in movers]
    if not roots:
        raise robot.error("every link is a joint's child", expected="a tree with one link that stands")
    if len(roots) > 1:
        names = ", ".join(roots[:4]) + "…" * (len(roots) > 4)
        raise links[roots[1]].error(f"{len(roots)} links are no joint's child, {names}", expected="one base")
    _check_reached(links, parents, roots[0])
    return roots[0]


def _check_reached(links: dict[str, Element], parents: dict[str, str], root: str) -> None:
    reached = {root}
    for name in links:
        path, at = [], name
        while at not in reached:
            if at in path:
                raise links[at].error(
                    "carries itself", place=f"link {at!r}", expected=f"a tree that starts at {root!r}"
                )
            path.append(at)
            at = parents[at]
        reached.update(path)


def _check_expanded(reading: UrdfReading, element: Element) -> None:
    """Refuses expressions that xacro was to replace, in all that is read."""
    for name, value in element.attributes.items():
        if "${" in value or "$(" in value:
            what = f"an expression of xacro, a program that writes URDF: run it first, xacro {reading.path.name} > robot.urdf"
            raise element.error(what, place=f"<{element.tag} {name}>", value=value)
    for child in element.children:
        if child.tag in READ.get(element.tag, (child.tag,)) and child.tag != "gazebo":
            _check_expanded(reading, child)


def _check_plain(elements: dict[str, Element]) -> None:
    """Refuses names that would be one, once they are without brackets and quotation marks."""
    first: dict[str, str] = {}
    for name, element in elements.items():
        plain = UNNAMEABLE.sub("_", name)
        if plain in first:
            twin = f"{first[plain]!r} (line {elements[first[plain]].line})"
            what = f"this and {twin} would both be called {plain!r}, as names hold no brackets and quotation marks"
            raise element.error(what, place=f"{element.tag} {name!r}", expected="names that stay different")
        first[plain] = name


def _add(known: dict[str, Element], element: Element, name: str) -> None:
    if name in known:
        what = f"a second one, the first is in line {known[name].line}"
        raise element.error(what, place=f"{element.tag} {name!r}", expected="one")
    known[name] = element


def _check_gazebo(reading: UrdfReading, robot: Element) -> None:
    """Gazebo's extensions belong to its simulation; those that would change the dynamics are remarked."""
    for gazebo in robot.all("gazebo"):
        reading.ignored["gazebo"] += 1
        for child in gazebo.children:
            value = child.text.strip().lower()
            if child.tag in GAZEBO_ELEMENTS or value not in GAZEBO_PHYSICS.get(child.tag, (value,)):
                about = gazebo.attributes.get("reference", "robot")
                reading.remark("element", about, f"<gazebo> <{child.tag}> is Gazebo's own and not used")


def _validated(reading: UrdfReading, record: dict[str, Any]) -> RobotDescription:
    """The record with names that paths of numbers can hold, checked as any robot is."""
    _rename(reading, record)
    record |= {"notes": reading.notes(), "remarks": tuple(map(str, reading.remarks.problems()))}
    file = reading.path if reading.drives is None else f"{reading.path} with its drive file"
    return validated(RobotDescription, record, file=file)


def _rename(reading: UrdfReading, record: dict[str, Any]) -> None:
    """Names without brackets and quotation marks, which paths of numbers need for themselves."""

    def plain(name: str) -> str:
        new = UNNAMEABLE.sub("_", name)
        if new != name:
            reading.renamed[name] = new
        return new

    for key in ("name", "base", "tip"):
        if key in record:
            record[key] = plain(record[key])
    for entry in (*record["joints"], *record["links"]):
        for key in ("name", "parent", "child"):
            if key in entry:
                entry[key] = plain(entry[key])
        if "mimic" in entry:
            entry["mimic"]["joint"] = plain(entry["mimic"]["joint"])
    for cylinder in record.get("cylinders", ()):
        cylinder |= {key: plain(cylinder[key]) for key in ("link_a", "link_b") if isinstance(cylinder.get(key), str)}

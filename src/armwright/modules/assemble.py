"""Arm from modules: connectors are checked, joint frames placed, and every number keeps its source and names its module."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pydantic

from armwright.description.paths import quantities
from armwright.description.robot import JOINTS, FixedJoint, NamedFrame, RobotDescription
from armwright.entry import as_path
from armwright.errors import DescriptionError, Problem, check_known
from armwright.lint.feasibility import frame_origin_sign
from armwright.modules.assembly import Assembly, origin, read_assembly
from armwright.modules.instances import Instance, ground_first, instances_of
from armwright.modules.library import Connector, Crossing, ModuleLibrary
from armwright.modules.mounting import Structure, mount
from armwright.modules.placing import frame_of, link_of
from armwright.quantity import Quantity, Source
from armwright.solids.visual import placement_of
from armwright.spatial import Placement
from armwright.validation import problems, validated

COMPOSED = "composed"  # the key of [sources] for frames that follow from the poses of connectors
REPLACED = {"child_frame", "name", "parent", "child", "frame", "axis", "source", "type", "command"}


@dataclass
class Draft:
    """Tables of the arm's description, as far as they are written."""

    joints: list[Any] = field(default_factory=list)
    links: list[Any] = field(default_factory=list)
    sources: dict[str, Source] = field(default_factory=dict)


def assemble(
    assembly: Assembly | str | os.PathLike[str],
    libraries: Iterable[ModuleLibrary] | None = None,
    folder: str | os.PathLike[str] | None = None,
) -> RobotDescription:
    """The arm that modules make: every body a link, connections as fixed joints, free connectors as named frames.

    Args:
        assembly: which modules stand on which connectors: the name of a built-in assembly, the path of an
            *.assembly.toml, or an `Assembly`.
        libraries: where the modules of an `Assembly` are looked up; a file names its own.
        folder: where the arm's file will stand; None: beside the assembly's. From there `built_from` names the files.
    Returns:
        robot: joints in the order of the modules, named MODULE_JOINT; links MODULE_BODY, or MODULE where it has one body.
            The tip is the assembly's, or the only connector that is left free. Sources name the modules.
    Raises:
        DescriptionError: an unknown module or connector, connectors that do not fit, an angle that is no step, a
            closed chain, two roots, an impossible body.
    Example:
        >>> aw.modules.assemble("examples/chain/arm.assembly.toml").name
        'six'
    """
    place = assembly.name if isinstance(assembly, Assembly) else as_path(assembly, "assembly", DescriptionError)
    built_from = None
    if not isinstance(assembly, Assembly):
        name = assembly
        assembly, named = read_assembly(name)
        built_from = origin(name, folder) if libraries is None else None
        libraries = named if libraries is None else libraries
    elif libraries is None:
        raise DescriptionError("missing", place="libraries", expected="those of the modules", file=place)
    try:
        robot = _assembled(assembly, list(libraries))
    except DescriptionError as error:
        raise error.within(file=place) from None
    except pydantic.ValidationError as error:  # places beyond the largest float
        raise DescriptionError.of(*problems(error, {}, RobotDescription)).within(file=place) from None
    return robot if built_from is None else robot.model_copy(update={"built_from": built_from})


def _assembled(assembly: Assembly, libraries: list[ModuleLibrary]) -> RobotDescription:
    instances = instances_of(assembly, libraries)
    draft, structure = Draft(sources=_sources(assembly, libraries)), Structure(assembly.base)
    for instance in ground_first(instances):
        fault = instance.module.impossible_body()
        if fault is not None:
            raise DescriptionError.of(fault)
        link, at, body = mount(instance, instances, structure)
        name, frame = f"{instance.name}_mount", frame_of(at, COMPOSED)
        draft.joints.append(FixedJoint(name=name, type="fixed", parent=link, child=instance.link(body), frame=frame))
        _add_module(instance, body, draft, structure)
    free = [(i, c) for i in instances.values() for c in i.module.connectors if (i.name, c.name) not in structure.taken]
    fields = {
        **{key: getattr(assembly, key) for key in ("name", "title", "notes", "base", "gravity_m_s2")},
        "source": assembly.source or COMPOSED,
        "sources": draft.sources,
        "command": assembly.command or next((library.command for library in libraries if library.command), None),
        "tip": _tip(assembly, free),
        "joints": _with_limits(assembly, draft.joints),
        "links": draft.links,
        "frames": [_frame(instance, connector, structure) for instance, connector in free],
        "remarks": tuple(str(problem) for instance in instances.values() for problem in _doubts(instance)),
    }
    robot = validated(RobotDescription, fields)
    used = {source for _, _, source in quantities(robot)}
    return robot.model_copy(update={"sources": {key: draft.sources[key] for key in draft.sources if key in used}})


def _doubts(instance: Instance) -> Iterator[Problem]:
    """Tensors that are stated to be about the centre of mass and look as if they were not."""
    for body in instance.module.bodies:
        sign = frame_origin_sign(float(body.mass_kg), np.array(body.com_m), body.inertia_kg_m2.matrix())
        if sign is not None and body.inertia_about == "com":
            place = f"module {instance.module.name!r} body {body.name!r}"
            yield Problem(f'{sign}; did you mean inertia_about = "frame"?', place)


def _add_module(instance: Instance, start: str, draft: Draft, structure: Structure) -> None:
    """Adds links and joints of a module, from the body that is carried outward; joints passed backwards are turned round."""
    bodies = {body.name: body for body in instance.module.bodies}

    def add_link(name: str, placed: Placement) -> None:
        structure.placements[instance.name, name] = placed
        source = _source(instance, bodies[name].source, draft)
        draft.links.append(link_of(bodies[name], instance.link(name), source, placed))

    add_link(start, Placement.identity())
    for crossing in instance.module.crossings(start):
        before, after = crossing.before, crossing.after
        if not crossing.joint.kind.moves:
            before, after = before @ after, Placement.identity()
        at = structure.placements[instance.name, crossing.near] @ before
        draft.joints.append(_joint(instance, crossing, at, draft))
        add_link(crossing.far, after)


def _joint(instance: Instance, crossing: Crossing, at: Placement, draft: Draft) -> Any:
    joint, forward, as_written = crossing.joint, crossing.forward, placement_of(crossing.joint.frame)
    same = np.array_equal(at.position, as_written.position) and np.array_equal(at.rotation, as_written.rotation)
    fields = {name: getattr(joint, name) for name in joint.model_fields_set if name not in REPLACED}
    fields |= {
        "name": f"{instance.name}_{joint.name}",
        "type": joint.type,
        "parent": instance.link(crossing.near),
        "child": instance.link(crossing.far),
        "frame": joint.frame if same and forward else frame_of(at),
        "source": _source(instance, joint.source, draft),
    }
    if not joint.kind.moves:
        return FixedJoint(**fields)
    axis = joint.axis
    assert axis is not None
    fields["axis"] = axis if forward else axis.replace(value=tuple(0.0 - v for v in axis.value))
    command = joint.command or instance.library.command
    if command is not None:
        fields["command"] = command
    return JOINTS[joint.type](**fields)


def _with_limits(assembly: Assembly, joints: Sequence[Any]) -> list[Any]:
    """Joints with the assembly's own limits, which may be narrower than the module's and not wider."""
    joints = list(joints)
    known = {joint.name: k for k, joint in enumerate(joints) if joint.kind.moves}
    for name, table in assembly.limits.items():
        check_known(DescriptionError, name, known, "no such joint", place="limits")
        old = joints[known[name]].limits
        data = {key: value for key, value in table.items() if key != "source"}
        limits = validated(type(old), data, place=f"limits.{name}")
        changes = {}
        for key in limits.model_fields_set:
            value, widest = getattr(limits, key), getattr(old, key)
            if widest is not None and not _within(value, widest):
                place, expected = f"limits.{name}.{key}", f"it within the module's {_plain(widest)}"
                raise DescriptionError(place=place, value=_plain(value), expected=expected)
            changes[key] = value if value.source else value.replace(source=table.get("source") or assembly.source)
        joints[known[name]] = joints[known[name]].replace(limits=old.replace(**changes))
    return joints


def _within(new: Quantity, old: Quantity) -> bool:
    a, b = np.atleast_1d(np.array(new)), np.atleast_1d(np.array(old))
    return bool(a[0] >= b[0] and a[1] <= b[1]) if len(a) == 2 else bool(a[0] <= b[0])


def _plain(quantity: Quantity) -> Any:
    return list(quantity.value) if isinstance(quantity.value, tuple) else quantity.value


def _frame(instance: Instance, connector: Connector, structure: Structure) -> NamedFrame:
    placed = frame_of(structure.placements[instance.name, connector.body] @ connector.placement())
    name, link = f"{instance.name}_{connector.name}", instance.link(connector.body)
    return NamedFrame(name=name, link=link, source=COMPOSED, xyz_m=placed.xyz_m, rpy_rad=placed.rpy_rad)


def _tip(assembly: Assembly, free: list[tuple[Instance, Connector]]) -> str | None:
    ends = [f"{instance.name}.{c.name}" for instance, c in free if c.name != instance.module.ground]
    if assembly.tip is not None and assembly.tip not in ends:
        raise DescriptionError("no connector that is left free", place="tip", value=assembly.tip, choices=ends)
    tip = assembly.tip or (ends[0] if len(ends) == 1 else None)
    return None if tip is None else tip.replace(".", "_")


def _sources(assembly: Assembly, libraries: list[ModuleLibrary]) -> dict[str, Source]:
    text = f"Composed from the modules of {assembly.name}: where their connectors and joints are"
    sources = {COMPOSED: Source(kind="definition", text=text)}
    for home in (assembly, *libraries):
        for key, source in home.sources.items():
            if sources.setdefault(key, source) != source:
                what = f"means different things in {home.name} and elsewhere"
                raise DescriptionError(what, place=f"sources.{key}", expected="another key")
    return sources


def _source(instance: Instance, source: str | None, draft: Draft) -> str | None:
    """Key of a source that names the module as well."""
    key = source or instance.module.source or instance.library.source
    if key is None:
        return None
    known = instance.library.sources.get(key)
    name, place = f"{key}-{instance.module.name}", f"module {instance.module.name} of {instance.library.name}"
    fields = {} if known is None else {k: getattr(known, k) for k in ("date", "licence", "url")}
    text = place if known is None else f"{place}: {known.text}"
    draft.sources[name] = Source(kind=key if known is None else known.kind, text=text, **fields)  # type: ignore[arg-type]
    return name

"""Modules → arm: connectors are checked, joint frames placed, and every number keeps its source and says its module.

Two faces meet with opposite z axes:  T = T_carrier Rz(angle) Rx(π) T_own⁻¹  places the module that is put on.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pydantic

from armwright.description.inertia_point import frame_origin_sign, impossible
from armwright.description.paths import quantities
from armwright.description.robot import FixedJoint, Link, NamedFrame, PrismaticJoint, RevoluteJoint, RobotDescription
from armwright.errors import DescriptionError, nearest
from armwright.modules.assembly import Assembly, origin, read_assembly
from armwright.modules.library import Connector, ModuleBody, ModuleLibrary, placement
from armwright.modules.limit_overrides import narrowed
from armwright.modules.mount import Ground, mount
from armwright.modules.order import Instance, ground_first, instances_of
from armwright.modules.placed_body import frame_of, link_of
from armwright.quantity import Source
from armwright.spatial import Placement
from armwright.validation import problems, validated

COMPOSED = "composed"  # the key of [sources] for frames that follow from where connectors are
OWN = ("child_frame", "name", "parent", "child", "frame", "axis", "source", "type", "command")


@dataclass
class Draft:
    """The tables of a description in the making."""

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
            closed chain, two roots, a body that cannot be.
    """
    place = assembly.name if isinstance(assembly, Assembly) else os.fspath(assembly)
    built_from = None
    if not isinstance(assembly, Assembly):
        built_from = origin(assembly, folder) if libraries is None else None
        assembly, named = read_assembly(assembly)
        libraries = named if libraries is None else libraries
    elif libraries is None:
        raise DescriptionError(f"{assembly.name}: expected the libraries that its modules are from")
    try:
        robot = _assembled(assembly, list(libraries))
    except DescriptionError as error:
        raise error.within(file=place) from None
    except pydantic.ValidationError as error:  # places beyond the largest float
        raise DescriptionError.of(*problems(error, {}, RobotDescription)).within(file=place) from None
    return robot if built_from is None else robot.model_copy(update={"built_from": built_from})


def _assembled(assembly: Assembly, libraries: list[ModuleLibrary]) -> RobotDescription:
    instances = instances_of(assembly, libraries)
    draft, ground = Draft(sources=_sources(assembly, libraries)), Ground(assembly.base)
    for instance in ground_first(instances):
        _check_bodies(instance)
        link, at, body = mount(instance, instances, ground)
        name, frame = f"{instance.name}_mount", frame_of(at, COMPOSED)
        draft.joints.append(FixedJoint(name=name, type="fixed", parent=link, child=instance.link(body), frame=frame))
        ground.stands[instance.name, body] = Placement.identity()
        _grow(instance, body, draft, ground)
    free = [(i, c) for i in instances.values() for c in i.module.connectors if (i.name, c.name) not in ground.taken]
    fields = {
        **{key: getattr(assembly, key) for key in ("name", "title", "notes", "base", "gravity_m_s2")},
        "source": assembly.source or COMPOSED,
        "sources": draft.sources,
        "command": assembly.command or next((library.command for library in libraries if library.command), None),
        "tip": _tip(assembly, free),
        "joints": narrowed(assembly, draft.joints),
        "links": draft.links,
        "frames": [_frame(instance, connector, ground) for instance, connector in free],
        "remarks": tuple(sentence for instance in instances.values() for sentence in _doubts(instance)),
    }
    robot = validated(RobotDescription, fields)
    used = {source for _, _, source in quantities(robot)}
    return robot.model_copy(update={"sources": {key: draft.sources[key] for key in draft.sources if key in used}})


def _check_bodies(instance: Instance) -> None:
    for body in instance.module.bodies:
        fault = impossible(float(body.mass_kg), np.array(body.com_m), body.inertia_kg_m2.matrix(), body.inertia_about)
        if fault is not None and body.accept_impossible is None:
            raise DescriptionError(
                f"module {instance.module.name!r} of {instance.library.name}, body {body.name!r}, is impossible: {fault}; "
                'expected a real body, or accept_impossible = "reason" in it'
            )


def _doubts(instance: Instance) -> Iterator[str]:
    """Tensors that are said to be about the centre of mass and look as if they were not."""
    for body in instance.module.bodies:
        sign = frame_origin_sign(float(body.mass_kg), np.array(body.com_m), body.inertia_kg_m2.matrix())
        if sign is not None and body.inertia_about == "com":
            yield f'module {instance.module.name!r}, body {body.name!r}: {sign}; did you mean inertia_about = "frame"?'


def _grow(instance: Instance, start: str, draft: Draft, ground: Ground) -> None:
    """Links and joints of a module from the body that it is carried by outward; joints passed backwards are turned round."""
    module, bodies = instance.module, {body.name: body for body in instance.module.bodies}
    draft.links.append(_link(instance, bodies[start], ground, draft))
    seen, waiting = {start}, [start]
    while waiting:
        here = waiting.pop(0)
        stands = ground.stands[instance.name, here]
        for joint in module.joints:
            if here not in (joint.parent, joint.child):
                continue
            there = joint.child if joint.parent == here else joint.parent
            if there in seen:
                continue
            forward = joint.parent == here
            before, behind = placement(joint.frame), placement(joint.child_frame)
            if not forward:  # T⁻¹ = behind⁻¹ R(axis, -q) before⁻¹
                before, behind = behind.inverse(), before.inverse()
            if isinstance(joint, FixedJoint):
                before, behind = before @ behind, Placement.identity()
            ground.stands[instance.name, there] = behind
            names = {
                "name": f"{instance.name}_{joint.name}",
                "parent": instance.link(here),
                "child": instance.link(there),
            }
            draft.joints.append(_joint(instance, joint, names, stands @ before, 1.0 if forward else -1.0, draft))
            draft.links.append(_link(instance, bodies[there], ground, draft))
            seen.add(there)
            waiting.append(there)


def _joint(instance: Instance, joint: Any, names: dict[str, str], at: Placement, sense: float, draft: Draft) -> Any:
    source = _told(instance, joint.source, draft)
    same = np.array_equal(at.position, np.array(joint.frame.xyz_m)) and sense > 0
    same = same and np.array_equal(at.rotation, placement(joint.frame).rotation)
    frame = joint.frame if same else frame_of(at)
    fields = {name: getattr(joint, name) for name in joint.model_fields_set if name not in OWN}
    fields |= {**names, "type": joint.type, "frame": frame, "source": source}
    if isinstance(joint, FixedJoint):
        return FixedJoint(**fields)
    axis = joint.axis
    assert axis is not None
    fields["axis"] = axis if sense > 0 else axis.replace(value=tuple(0.0 - v for v in axis.value))
    command = joint.command or instance.library.command
    if command is not None:
        fields["command"] = command
    return (RevoluteJoint if joint.type == "revolute" else PrismaticJoint)(**fields)


def _link(instance: Instance, body: ModuleBody, ground: Ground, draft: Draft) -> Link:
    source = _told(instance, body.source, draft)
    return link_of(body, instance.link(body.name), source, ground.stands[instance.name, body.name])


def _frame(instance: Instance, connector: Connector, ground: Ground) -> NamedFrame:
    placed = frame_of(ground.stands[instance.name, connector.body] @ connector.placement())
    name, link = f"{instance.name}_{connector.name}", instance.link(connector.body)
    return NamedFrame(name=name, link=link, source=COMPOSED, xyz_m=placed.xyz_m, rpy_rad=placed.rpy_rad)


def _tip(assembly: Assembly, free: list[tuple[Instance, Connector]]) -> str | None:
    ends = [(instance.name, connector.name) for instance, connector in free if connector.name != instance.module.ground]
    if assembly.tip is None:
        return "_".join(ends[0]) if len(ends) == 1 else None
    name, _, connector = assembly.tip.partition(".")
    if (name, connector) not in ends:
        known = [".".join(end) for end in ends]
        raise DescriptionError(
            f"tip = {assembly.tip!r} is no connector that is left free; {nearest(assembly.tip, known)}"
        )
    return f"{name}_{connector}"


def _sources(assembly: Assembly, libraries: list[ModuleLibrary]) -> dict[str, Source]:
    text = f"Composed from the modules of {assembly.name}: where their connectors and joints are"
    found = {COMPOSED: Source(kind="definition", text=text)}
    for home in (assembly, *libraries):
        for key, source in home.sources.items():
            if found.setdefault(key, source) != source:
                raise DescriptionError(
                    f"sources.{key} means different things in {home.name} and elsewhere: expected another key"
                )
    return found


def _told(instance: Instance, source: str | None, draft: Draft) -> str | None:
    """The key of a source that names the module as well."""
    key = source or instance.module.source or instance.library.source
    if key is None:
        return None
    known = instance.library.sources.get(key)
    name, place = f"{key}-{instance.module.name}", f"module {instance.module.name} of {instance.library.name}"
    fields = {} if known is None else {k: getattr(known, k) for k in ("date", "licence", "url")}
    text = place if known is None else f"{place}: {known.text}"
    draft.sources[name] = Source(kind=key if known is None else known.kind, text=text, **fields)  # type: ignore[arg-type]
    return name

"""Numbers that a real arm could have, and that yet look like a mistake: each is named with the mistake. Few false alarms.

A tensor of inertia I of a mass m has the radius of gyration k = √(λ_max(I)/m); no body has one beyond its own size.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np

from armwright.description.robot import Link, MovingJoint, RobotDescription
from armwright.errors import Findings, Problem
from armwright.lint.feasibility import is_possible
from armwright.lint.placeholders import known_placeholders
from armwright.spatial import parallel_axes, pseudo_inertia

HEAVIEST = 1000.0  # [kg] of one link
WIDE = 1.0  # [m] of gyration: what is heavier than that and wider is too large, as a mesh in mm is, not in grams
LIGHTEST = 1e-3  # [kg]; below are markers and sensors, whose tensors nobody has measured
SIZES, BEYOND = 3.0, 0.1  # a radius of gyration of 3 lengths of the link and 0.1 m [m] is beyond it
PARALLEL_AXES = 1e-3  # how well a product of inertia must equal -m c_j c_k to be just that
OF_THE_TENSOR = 0.02  # a product below this share of the largest moment proves nothing
PAIRS = ((0, 1), (0, 2), (1, 2))
LONGEST = 10.0  # [m] from one joint to the next, or of a mesh
SMALLEST = 1e-3  # [m] of a mesh: less than any screw's
WIDEST = 4 * pi  # [rad]: an angle between two axes says no more beyond a turn, and few joints have four turns
DEGREES = 720.0  # a limit beyond it is how files write that there is none
DENSITIES = 23.0, 23_000.0  # [kg/m³]: osmium has 22.6 g/cm³, and the lightest foams less than 23 kg/m³
MILLIMETRES, GRAMS = "millimetres for metres?", "grams for kilograms?"
ABOUT_ORIGIN = "a tensor about the frame's origin, not about the centre of mass?"


@dataclass(frozen=True)
class _Body:
    """A link as the checks see it."""

    mass: float
    com: np.ndarray
    tensor: np.ndarray
    size: float  # [m], the largest distance of its joints and its centre of mass


def implausible_values(robot: RobotDescription, places: dict[str, list[np.ndarray]]) -> list[Problem]:
    """Masses, tensors, limits and units that look like a mistake, with the mistake.

    Args:
        robot: the description.
        places: for every link that moves, where it bears joints, (3,) [m] each in the link's frame.
    """
    findings = Findings()
    long = []
    for link in robot.links:
        mass, com, tensor = float(link.mass_kg), np.array(link.com_m), link.inertia_kg_m2.matrix()
        if mass <= 0:
            possible = is_possible(pseudo_inertia(0.0, np.zeros(3), tensor))  # feasibility reports what is not
            if tensor.any() and possible and not is_fit(robot, link):
                what = "a tensor of inertia and no mass: a mass that was forgotten?"
                findings.add("link", link.name, Problem(what, "mass_kg", mass))
            continue
        if link.name not in places:
            continue
        points = [*places[link.name], com]
        size = max(float(np.linalg.norm(a - b)) for a in points for b in points)
        if size > LONGEST:
            long.append(link.name)
        if mass > LIGHTEST and not tensor.any() and is_import(robot, link):
            what = "a tensor of inertia of 0, that of a point: one that was forgotten?"
            findings.add("link", link.name, Problem(what, "inertia_kg_m2"))
        for problem in _of_body(_Body(mass, com, tensor, size), is_fit=is_fit(robot, link)):
            findings.add("link", link.name, problem)
    return [*findings.problems(), *implausible_units(robot, long), *_of_efforts(robot)]


def moved_without_mass(robot: RobotDescription) -> list[Problem]:
    """Question about links of another program's file that a joint moves and that have no mass, nor does what is fixed to them.

    Args:
        robot: the description.
    """
    joints, heavy = {joint.child: joint for joint in robot.joints}, set()
    for link in robot.links:
        name = link.name
        if float(link.mass_kg) > 0 or link.inertia_kg_m2.matrix().any():
            while name in joints and not joints[name].kind.moves:
                name = joints[name].parent
            heavy.add(name)
    moved = {joint.child for joint in robot.moving_joints} - heavy - set(robot.without_masses)
    bare = [link.name for link in robot.links if link.name in moved and is_import(robot, link)]
    if not bare:
        return []
    what = "mass unknown? Moved by a joint without mass_kg, com_m and inertia_kg_m2, which gravity and inertia need"
    return [Problem(what, f"{'link' if len(bare) == 1 else 'links'} {', '.join(map(repr, bare))}")]


def _of_body(body: _Body, *, is_fit: bool) -> list[Problem]:
    fillers, _ = known_placeholders()
    findings = [Problem(f"these are {f.name}: {f.why}") for f in fillers if f.matches(body.mass, body.tensor)]
    if body.mass > HEAVIEST:
        is_wide = _gyration(body.mass, body.tensor) > WIDE
        findings.append(Problem(MILLIMETRES if is_wide else GRAMS, "mass_kg", body.mass))
    if body.size > LONGEST:
        findings.append(Problem(f"{body.size:.4g} m across its joints and centre of mass: {MILLIMETRES}"))
    if not is_fit and body.mass > LIGHTEST and not findings:
        findings += [problem for problem in (_of_size(body), _of_origin(body)) if problem][:1]
    return findings


def _of_size(body: _Body) -> Problem | None:
    """A radius of gyration beyond the link's own lengths, and what would bring it back."""
    gyration = _gyration(body.mass, body.tensor)
    limit = SIZES * body.size + BEYOND
    if gyration <= limit:
        return None
    if gyration / 1000 > 0.02 * limit:
        why = "a tensor in kg mm²?"
    elif gyration / np.sqrt(1000) > 0.1 * limit:
        why = "a tensor in g m², or a mass in another unit than the tensor?"
    elif 0.0 < _gyration(body.mass, about_origin(body.mass, body.com, body.tensor)) <= body.size:
        why = ABOUT_ORIGIN
    else:
        why = "a placeholder?"
    lengths = f"the link's joints and centre of mass are {body.size:.3g} m apart"
    return Problem(f"radius of gyration {gyration:.3g} m, {lengths}: {why}", "inertia_kg_m2")


def _of_origin(body: _Body) -> Problem | None:
    """A product of inertia that is the parallel-axis term and nothing else: the tensor is about the frame's origin."""
    shift = parallel_axes(body.mass, body.com)
    largest = np.abs(body.tensor).max()
    for j, k in PAIRS:
        term = shift[j, k]
        is_term = abs(term) > OF_THE_TENSOR * largest and abs(body.tensor[j, k] - term) <= PARALLEL_AXES * abs(term)
        if is_term and about_origin(body.mass, body.com, body.tensor) is not None:
            x, y = "xyz"[j], "xyz"[k]
            what = f"is just the parallel-axis term -m c{x} c{y}: {ABOUT_ORIGIN}"
            return Problem(what, f"inertia_kg_m2.{x}{y}", float(body.tensor[j, k]))
    return None


def about_origin(mass: float, com: np.ndarray, tensor: np.ndarray) -> np.ndarray | None:
    """The tensor about the centre of mass, were the given one about the origin; None where no body has that.

    Args:
        mass: () [kg].   com: (3,) [m].   tensor: (3, 3) [kg m²], of the link.
    """
    moved = tensor - parallel_axes(mass, com)
    return moved if is_possible(pseudo_inertia(mass, np.zeros(3), moved)) else None


def _gyration(mass: float, tensor: np.ndarray | None) -> float:
    return 0.0 if tensor is None else float(np.sqrt(max(np.linalg.eigvalsh(tensor)[-1], 0.0) / mass))


def is_fit(robot: RobotDescription, link: Link) -> bool:
    """True if the tensor was identified: such numbers need only move the arm right, not be a body's own."""
    return "fit" in _kinds(robot, link)


def is_import(robot: RobotDescription, link: Link) -> bool:
    """True if the tensor came out of another program's file; a point mass in a file of ours is meant."""
    return "import" in _kinds(robot, link)


def _kinds(robot: RobotDescription, link: Link) -> set[str]:
    """The kinds of evidence of a link's moments of inertia."""
    entries = (getattr(link.inertia_kg_m2, entry).source for entry in ("xx", "yy", "zz"))
    keys = {entry or link.inertia_kg_m2.source or link.source or robot.source for entry in entries}
    return {robot.source_of(key).kind for key in keys if key}


def _of_efforts(robot: RobotDescription) -> Iterator[Problem]:
    moving = robot.moving_joints
    limits = [joint.limit("torque") for joint in moving]
    efforts = [np.nan if limit is None else float(limit) for limit in limits]
    for filler in known_placeholders()[1]:
        first = filler.found_in(efforts)
        if first is not None:
            names = ", ".join(repr(joint.name) for joint in moving[first : first + len(filler.efforts)])
            what = f"the effort limits of {filler.name}: {filler.why}"
            yield Problem(what, f"joints {names} limits", filler.efforts)


def implausible_units(robot: RobotDescription, long_links: Collection[str] = ()) -> list[Problem]:
    """Lengths and angles of joints and frames that are too large for their unit: millimetres for metres, degrees for radians.

    Args:
        robot: the description.   long_links: links that are already reported as too long.
    """
    findings = Findings()
    for joint in robot.joints:
        way = next(key for key in ("frame", "dh", "modified_dh") if getattr(joint, key) is not None)
        known = bool({joint.parent, joint.child} & set(long_links))
        for problem in _of_place(getattr(joint, way), is_known=known):
            findings.add("joint", joint.name, problem.within(way))
        if isinstance(joint, MovingJoint):
            for problem in (*_of_limits(joint), *_of_spring(joint)):
                findings.add("joint", joint.name, problem)
    for frame in robot.frames:
        for problem in _of_place(frame, is_known=frame.link in long_links):
            findings.add("frame", frame.name, problem)
    for cylinder in robot.cylinders:
        for key in ("anchor_a_m", "anchor_b_m", "length_m"):
            value = getattr(cylinder, key).value
            if np.linalg.norm(np.atleast_1d(value)) > LONGEST:
                findings.add("cylinder", cylinder.name, Problem(MILLIMETRES, key, value))
    return findings.problems()


def _of_place(place: Any, *, is_known: bool) -> Iterator[Problem]:
    """A frame or a Denavit-Hartenberg row; `is_known` where its length is already reported."""
    for key in type(place).model_fields:
        if not key.endswith(("_m", "_rad")):
            continue
        value = getattr(place, key).value
        length, largest = np.linalg.norm(np.atleast_1d(value)), np.abs(value).max()
        if key.endswith("_m") and not is_known and length > LONGEST:
            yield Problem(f"{length:.4g} m away: {MILLIMETRES}", key, value)
        if key.endswith("_rad") and largest > WIDEST:
            yield Problem("more than two turns: degrees for radians?", key, value)


def _of_limits(joint: Any) -> Iterator[Problem]:
    """Limits of position. Those in degrees are whole or half ones; a joint of many turns has others."""
    slides, limits = joint.kind.units.linear, joint.limit("position")
    if limits is None:
        return
    values = np.array(limits)
    far = values[np.abs(values) > (LONGEST if slides else WIDEST)]
    if slides and len(far) and np.abs(far).max() <= 1000 * LONGEST:
        yield Problem(MILLIMETRES, "limits.position_m", limits.value)
    if not slides and len(far) and np.all(np.abs(far) <= DEGREES) and not np.any(np.mod(2 * far, 1)):
        yield Problem("degrees for radians?", "limits.position_rad", limits.value)


def _of_spring(joint: Any) -> Iterator[Problem]:
    """A table that does not reach as far as the joint moves, and rest positions in degrees."""
    unit, limits = joint.kind.units.position, joint.limit("position")
    if joint.spring is None:
        return
    rest, positions = getattr(joint.spring, f"rest_{unit}"), getattr(joint.spring, f"positions_{unit}")
    if unit == "rad" and rest is not None and abs(float(rest)) > WIDEST:
        yield Problem("more than two turns: degrees for radians?", "spring.rest_rad", rest.value)
    if positions is not None and limits is not None:
        (low, high), (first, *_, last) = limits.value, positions.value
        if low < first or high > last:
            what = f"its table ends before the limits, {low:g} to {high:g} {unit}; beyond it, outside = {joint.spring.outside!r}"
            yield Problem(what, f"spring.positions_{unit}", (first, last))


def implausible_sections(link: Any) -> Iterator[Problem]:
    """Densities that would be a material's in g/cm³ or g/m³, and meshes of a robot's size in another unit.

    Args:
        link: a `parts.mass_properties.WeighedLink`.
    """
    lightest, heaviest = DENSITIES
    for part in link.parts:
        for section in part.sections:
            place = f"link {link.link.name!r} part {part.part.name!r} section {section.section.name!r}"
            density, solid = section.density, section.section.solid
            if density < lightest:
                yield Problem("g/cm³ for kg/m³?", f"{place} density_kg_per_m3", density, f"{1000 * density:g}")
            elif density > heaviest:
                yield Problem(
                    "more than any material's [kg/m³]: g/m³ for kg/m³?", f"{place} density_kg_per_m3", density
                )
            if solid.shape == "mesh":
                size = float(np.ptp(solid.surface().bounds, axis=0).max())
                if size > LONGEST:
                    yield Problem(f"a mesh of {size:.4g} m: {MILLIMETRES}", place, expected="scale = 0.001")
                elif size < SMALLEST:
                    yield Problem(f"a mesh of {size:.4g} m: metres for millimetres?", place, expected="scale = 1")

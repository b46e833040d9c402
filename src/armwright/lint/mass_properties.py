"""Numbers that a real arm could have, and that yet look like a mistake: which, and what mistake. Few false alarms.

A tensor of inertia I of a mass m has the radius of gyration k = √(λ_max(I)/m); no body has one beyond its own size.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from armwright.description.placeholders import known_placeholders
from armwright.description.robot import FixedJoint, Link, PrismaticJoint, RobotDescription
from armwright.lint.feasibility import is_possible
from armwright.lint.units import LONGEST, unit_doubts
from armwright.spatial import parallel_axes, pseudo_inertia

HEAVIEST = 1000.0  # [kg] of one link
WIDE = 1.0  # [m] of gyration: what is heavier than that and wider is too large, as a mesh in mm is, not in grams
LIGHTEST = 1e-3  # [kg]; below are markers and sensors, whose tensors nobody has measured
SIZES, BEYOND = 3.0, 0.1  # a radius of gyration of 3 lengths of the link and 0.1 m [m] is beyond it
PARALLEL_AXES = 1e-3  # how well a product of inertia must equal -m c_j c_k to be just that
OF_THE_TENSOR = 0.02  # a product below this share of the largest moment proves nothing
PAIRS = ((0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class _Body:
    """A link as the checks see it."""

    link: Link
    mass: float
    com: np.ndarray
    tensor: np.ndarray
    size: float  # [m], the largest distance of its joints and its centre of mass


def doubts(robot: RobotDescription, places: dict[str, list[np.ndarray]]) -> list[str]:
    """Sentences about masses, tensors, limits and units that look like a mistake, and name it.

    Args:
        robot: the description.
        places: for every link that moves, where it bears joints, (3,) [m] each in the link's frame.
    """
    found: dict[str, list[str]] = defaultdict(list)
    long = []
    for link in robot.links:
        if not float(link.mass_kg) > 0:
            tensor = link.inertia_kg_m2.matrix()
            possible = is_possible(pseudo_inertia(0.0, np.zeros(3), tensor))  # what is not is told elsewhere
            if tensor.any() and possible and not is_fit(robot, link):
                found["a tensor of inertia and no mass: a mass that was forgotten?"].append(link.name)
            continue
        if link.name not in places:
            continue
        mass, com = float(link.mass_kg), np.array(link.com_m)
        points = [*places[link.name], com]
        size = max(float(np.linalg.norm(a - b)) for a in points for b in points)
        body = _Body(link, mass, com, link.inertia_kg_m2.matrix(), size)
        if size > LONGEST:
            long.append(link.name)
        if mass > LIGHTEST and not body.tensor.any() and is_import(robot, link):
            found["a tensor of inertia of 0, that of a point: one that was forgotten?"].append(link.name)
        for told in _of_body(body, is_fit=is_fit(robot, link)):
            found[told].append(link.name)
    sentences = [f"{'links' if len(names) > 1 else 'link'} {', '.join(names)}: {told}" for told, names in found.items()]
    return [*sentences, *unit_doubts(robot, long), *_of_efforts(robot)]


def _of_body(body: _Body, *, is_fit: bool) -> list[str]:
    fillers, _ = known_placeholders()
    told = [f"these are {f.name}: {f.told}" for f in fillers if f.matches(body.mass, body.tensor)]
    if body.mass > HEAVIEST:
        wide = _gyration(body.mass, body.tensor) > WIDE
        told.append(f"a mass of {body.mass:.4g} kg: {'millimetres for metres' if wide else 'grams for kilograms'}?")
    if body.size > LONGEST:
        told.append(f"{body.size:.4g} m across its joints and centre of mass: millimetres for metres?")
    if not is_fit and body.mass > LIGHTEST and not told:
        told += [sentence for sentence in (_of_size(body), _of_origin(body)) if sentence][:1]
    return told


def _of_size(body: _Body) -> str | None:
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
        why = "a tensor about the frame's origin, not about the centre of mass?"
    else:
        why = "a placeholder?"
    return (
        f"radius of gyration {gyration:.3g} m, the link's joints and centre of mass are {body.size:.3g} m apart: {why}"
    )


def _of_origin(body: _Body) -> str | None:
    """A product of inertia that is the parallel-axis term and nothing else: the tensor is about the frame's origin."""
    shift = parallel_axes(body.mass, body.com)
    largest = np.abs(body.tensor).max()
    for j, k in PAIRS:
        term = shift[j, k]
        if abs(term) > OF_THE_TENSOR * largest and abs(body.tensor[j, k] - term) <= PARALLEL_AXES * abs(term):
            if about_origin(body.mass, body.com, body.tensor) is None:
                continue
            return (
                f"I{'xyz'[j]}{'xyz'[k]} = {body.tensor[j, k]:.6g} is just the parallel-axis term -m c{'xyz'[j]} c{'xyz'[k]}: "
                "a tensor about the frame's origin, not about the centre of mass?"
            )
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
    """Whether the tensor was identified: such numbers need only move the arm right, not be a body's own."""
    return "fit" in _kinds(robot, link)


def is_import(robot: RobotDescription, link: Link) -> bool:
    """Whether the tensor came out of another program's file; a point mass in a file of ours is meant."""
    return "import" in _kinds(robot, link)


def _kinds(robot: RobotDescription, link: Link) -> set[str]:
    """The kinds of evidence of a link's moments of inertia."""
    entries = (getattr(link.inertia_kg_m2, entry).source for entry in ("xx", "yy", "zz"))
    keys = {entry or link.inertia_kg_m2.source or link.source or robot.source for entry in entries}
    return {robot.source_of(key).kind for key in keys if key}


def _of_efforts(robot: RobotDescription) -> list[str]:
    moving = [joint for joint in robot.joints if not isinstance(joint, FixedJoint)]
    limits = [j.limits.force_n if isinstance(j, PrismaticJoint) else j.limits.torque_n_m for j in moving]
    efforts = [np.nan if limit is None else float(limit) for limit in limits]
    told = []
    for filler in known_placeholders()[1]:
        first = filler.found_in(efforts)
        if first is not None:
            names = ", ".join(joint.name for joint in moving[first : first + len(filler.efforts)])
            listed = " ".join(f"{effort:g}" for effort in filler.efforts)
            told.append(f"joints {names}: their effort limits {listed} are those of {filler.name}: {filler.told}")
    return told

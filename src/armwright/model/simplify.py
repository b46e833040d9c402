"""Steps that rewrite an arm into one with the same dynamics and fewer operations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armwright import scalar
from armwright.model.model import Model
from armwright.model.springs import SpringCylinder
from armwright.model.tree import BASE, Body, Frame
from armwright.scalar import Array
from armwright.spatial import Placement, displaced_inertia, rotated, rotation_to_axis, rotation_x, rotation_z, snap

PARALLEL = 1e-9  # sine of an angle between axes below which they are parallel
RIGHT_ANGLE = 1e-12  # [rad], as `spatial.rotation.SNAP`
DUST = 1e-13  # of a body's own size (lengths: of a metre): what turning frames there and back leaves of a zero


def simplified(model: Model) -> Model:
    """The arm after all `STEPS`: same inverse and forward dynamics, mass matrix, bias and gravity torques."""
    for step in STEPS:
        model = step(model)
    return model


def aligned_frames(model: Model) -> Model:
    """Each body's frame turned about and slid along its own axis, until its x axis is the common normal to the next axis.

    So any URDF becomes Denavit-Hartenberg inside [KhalilKleinfinger1986]: a placement is Tx(a) Rx(α) Tz(r), the angle about
    z that is left over goes into the joint's offset, and most constants are 0 or ±1. Pose and dynamics are unchanged.
    A placement that holds symbols stays as it is.
    """
    slide = _slides(model)
    displacements = [
        Placement(rotation_z(angle), scalar.array([0.0, 0.0, way]))
        for angle, way in zip(_turns(model, slide), slide, strict=True)
    ]
    bodies = []
    for i, body in model.outward():
        reframed = _reframed(body, displacements[i])
        placement = (
            reframed.placement if body.parent == BASE else displacements[body.parent].inverse() @ reframed.placement
        )
        aligned = body.kind.turns and not _varies(body)
        placement, offset = _split(placement) if aligned else (placement, 0.0)
        bodies.append(_snapped(replace(reframed, placement=placement, offset=body.offset + offset)))
    frames = {
        name: frame
        if frame.body == BASE
        else Frame(frame.body, _clean(displacements[frame.body].inverse() @ frame.placement))
        for name, frame in model.frames.items()
    }
    return replace(model, bodies=tuple(bodies), frames=frames, cylinders=_reframed_cylinders(model, displacements))


def base_parameters(model: Model) -> Model:
    """Inertial parameters regrouped: what only the sum of two bodies decides is moved inward. [GautierKhalil1990]

    A mass on the axis of a revolute joint does not know which of the two bodies it belongs to, and so on: `regrouped` of the
    joint's kind. Kinetic energy is unchanged and potential energy by a constant; a body alone is no longer one that could exist.
    """
    bodies = list(model.bodies)
    for i, body in model.inward():
        link = bodies[i]
        moved, left = body.kind.regrouped(link.mass, link.first_moment, link.inertia)
        bodies[i] = replace(link, **left)
        if body.parent != BASE:
            m, h, tensor = moved
            rotation, p = body.placement.rotation, body.placement.position
            h, tensor = rotation @ h, rotation @ tensor @ rotation.T + displaced_inertia(m, rotation @ h, p)
            parent = bodies[body.parent]
            bodies[body.parent] = replace(
                parent,
                mass=parent.mass + m,
                first_moment=parent.first_moment + h + m * p,
                inertia=parent.inertia + tensor,
            )
    return replace(model, bodies=tuple(bodies))


STEPS = (aligned_frames, base_parameters)


def _slides(model: Model) -> list[float]:
    """Distance [m] that each body's origin slides along its axis: to the common normal with its parent's axis.

    Distal bodies have the smallest moments, so the offset along an axis is best left to the next joint's placement.
    """
    slide = [0.0] * len(model.bodies)
    for i, body in model.outward():
        if _varies(body):
            continue
        axis, p = body.placement.rotation[:, 2], body.placement.position
        if body.parent == BASE:
            slide[i] = -float((p * axis).sum())  # nearest to the base's origin
            continue
        p = p - scalar.array([0.0, 0.0, slide[body.parent]])
        across = axis[0] * axis[0] + axis[1] * axis[1]
        parallel = across < PARALLEL * PARALLEL  # then the normal may stand anywhere: level with the parent's origin
        slide[i] = float(-p[2] * axis[2] if parallel else -(p[0] * axis[0] + p[1] * axis[1]) / across)
    return slide


def _turns(model: Model, slide: list[float]) -> list[float]:
    """Angle [rad] by which each body's x axis turns about z: to the common normal with its heaviest child's axis."""
    size = [1] * len(model.bodies)
    for i, body in model.inward():
        if body.parent != BASE:
            size[body.parent] += size[i]
    turn = [0.0] * len(model.bodies)
    for i, body in model.outward():
        children = [j for j, other in model.outward() if other.parent == i]
        if not children:
            turn[i] = _principal(body)
            continue
        j = max(children, key=lambda j: size[j])
        if _varies(model.bodies[j]):
            continue
        axis = model.bodies[j].placement.rotation[:, 2]
        p = model.bodies[j].placement.position + slide[j] * axis
        if scalar.hypot(axis[0], axis[1]) > PARALLEL:
            turn[i] = _least(float(scalar.atan2(axis[0], -axis[1])))
        elif scalar.hypot(p[0], p[1]) > PARALLEL:
            turn[i] = _least(float(scalar.atan2(p[1], p[0])))
    return turn


def _varies(body: Body) -> bool:
    """True if the body's placement in its parent holds symbols."""
    return scalar.is_symbolic(body.placement.rotation, body.placement.position)


def _least(angle: float) -> float:
    """The smaller turn that brings x onto a line, either way round: fewer signs change."""
    if angle > 0.5 * np.pi:
        return angle - np.pi
    return angle + np.pi if angle <= -0.5 * np.pi else angle


def _principal(body: Body) -> float:
    """The turn about z [rad] that makes Ixy vanish; 0 where it has."""
    if scalar.is_symbolic(body.inertia):
        return 0.0
    xx, xy, yy = body.inertia[0, 0], body.inertia[0, 1], body.inertia[1, 1]
    return 0.5 * float(scalar.atan2(2.0 * xy, xx - yy)) if abs(xy) > DUST * abs(body.inertia).max() else 0.0


def _reframed(body: Body, frame: Placement) -> Body:
    """The body in another frame, at `frame` in the old one, with the same axis."""
    back, p = frame.rotation.T, frame.position
    inertia = body.inertia + displaced_inertia(body.mass, body.first_moment, -p)
    return replace(
        body,
        placement=body.placement @ frame,
        link_frame=frame.inverse() @ body.link_frame,
        first_moment=rotated(back, body.first_moment - body.mass * p),
        inertia=back @ inertia @ back.T,
    )


def _reframed_cylinders(model: Model, displacements: list[Placement]) -> tuple[SpringCylinder, ...]:
    """The cylinders with their ends in their bodies' new frames."""

    def moved(body: int, end: Array) -> Array:
        if body == BASE:
            return end
        point = displacements[body].inverse().point(end)
        return point if scalar.is_symbolic(point) else _without_rounding(point, 1.0)

    ends = [scalar.stack([moved(*end) for end in zip(c.bodies, c.ends, strict=True)]) for c in model.cylinders]
    return tuple(replace(cylinder, ends=pair) for cylinder, pair in zip(model.cylinders, ends, strict=True))


def _snapped(body: Body) -> Body:
    """The body with what is rounding beside its own size set to 0."""
    body = replace(body, placement=_clean(body.placement), link_frame=_clean(body.link_frame))
    if scalar.is_symbolic(body.mass, body.first_moment, body.inertia):
        return body
    largest = float(np.abs(body.inertia).max())
    moment = float(np.sqrt(largest * body.mass)) if body.mass > 0 else 1.0  # no first moment of a real body is larger
    first, tensor = _without_rounding(body.first_moment, moment), _without_rounding(body.inertia, largest)
    return replace(body, first_moment=first, inertia=tensor)


def _clean(placement: Placement) -> Placement:
    if scalar.is_symbolic(placement.rotation, placement.position):
        return placement
    return Placement(snap(placement.rotation), _without_rounding(placement.position, 1.0))


def _without_rounding(values: Array, size: float) -> Array:
    """Numbers below `DUST` of a size set to 0."""
    return np.asarray([0.0 if abs(v) <= DUST * size else float(v) for v in values.flat]).reshape(values.shape)


def _split(placement: Placement) -> tuple[Placement, float]:
    """A placement without its turn about its own z axis, and that turn [rad]; right angles stay, they cost nothing."""
    axis = placement.rotation[:, 2]
    plain = rotation_x(scalar.atan2(-axis[1], axis[2])) if abs(axis[0]) < RIGHT_ANGLE else rotation_to_axis(axis)
    left = plain.T @ placement.rotation
    angle = float(scalar.atan2(left[1, 0], left[0, 0]))
    quarters = scalar.round(angle / (0.5 * np.pi))
    if abs(angle - quarters * 0.5 * np.pi) < RIGHT_ANGLE:
        return Placement(plain @ rotation_z(quarters * 0.5 * np.pi), placement.position), 0.0
    return Placement(plain, placement.position), angle

"""A body at the end effector whose numbers may be symbols: `with_payload` for a model in place of a record."""

from __future__ import annotations

from dataclasses import replace

from armwright.model.model import Model
from armwright.scalar import Array


def add_load(model: Model, frame: str, load: Array) -> Model:
    """The arm with one more body fixed to a frame: about one origin, mass properties add up.

    Args:
        model: the arm.   frame: one that moves.
        load: (10,) `[m, m c_x, m c_y, m c_z, Ixx, Ixy, Ixz, Iyy, Iyz, Izz]`, about the frame's origin in its axes; zeros where
            nothing is carried.
    Returns:
        model: the arm, the body that carries the frame heavier by the load.
    """
    at = model.frame(frame)
    bodies = list(model.bodies)
    carrier = bodies[at.body]
    body = replace(carrier, link_frame=at.placement).with_inertial_parameters(load)
    bodies[at.body] = replace(
        carrier,
        mass=carrier.mass + body.mass,
        first_moment=carrier.first_moment + body.first_moment,
        inertia=carrier.inertia + body.inertia,
    )
    return replace(model, bodies=tuple(bodies))

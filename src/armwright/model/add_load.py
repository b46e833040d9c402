"""An arm with a body in its hand whose numbers may be symbols: what `with_payload` does to a record, done to a model."""

from __future__ import annotations

from dataclasses import replace

from armwright.model.model import Model
from armwright.scalar import Array


def carrying(model: Model, frame: str, load: Array) -> Model:
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
    held = replace(carrier, link_frame=at.placement).with_inertial_parameters(load)
    bodies[at.body] = replace(
        carrier,
        mass=carrier.mass + held.mass,
        first_moment=carrier.first_moment + held.first_moment,
        inertia=carrier.inertia + held.inertia,
    )
    return replace(model, bodies=tuple(bodies))

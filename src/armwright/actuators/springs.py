"""Springs at joints: a line or a table of torque over position."""

from __future__ import annotations

from armwright.interpolation import piecewise_linear, piecewise_linear_integral
from armwright.model import LinearSpring, Spring
from armwright.scalar import Scalar


def spring_torque(spring: Spring, q: Scalar) -> Scalar:
    """Torque of a spring on its joint [N m | N]:  preload - stiffness (q - rest),  or by table (`piecewise_linear`)."""
    if isinstance(spring, LinearSpring):
        return spring.preload - spring.stiffness * (q - spring.rest)
    return piecewise_linear(q, spring.positions, spring.torques, spring.outside)


def spring_energy(spring: Spring, q: Scalar) -> Scalar:
    """Energy [J] whose slope is the torque's negative, 0 at `rest` or at the table's first point."""
    if isinstance(spring, LinearSpring):
        way = q - spring.rest
        return 0.5 * spring.stiffness * way * way - spring.preload * way
    return -piecewise_linear_integral(q, spring.positions, spring.torques, spring.outside)

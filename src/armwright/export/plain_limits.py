"""Limits of a joint, whether it turns or slides."""

from __future__ import annotations

from armwright.description.robot import MovingJoint, PrismaticJoint
from armwright.quantity import Quantity

Limit = Quantity | None


def plain_limits(joint: MovingJoint) -> tuple[Limit, Limit, Limit]:
    """(position [rad | m], velocity [rad/s | m/s], effort [N m | N]); None where no limit is known."""
    if isinstance(joint, PrismaticJoint):
        return joint.limits.position_m, joint.limits.velocity_m_per_s, joint.limits.force_n
    return joint.limits.position_rad, joint.limits.velocity_rad_per_s, joint.limits.torque_n_m

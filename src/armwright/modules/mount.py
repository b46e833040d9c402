"""One module on another: the connectors that meet, whether they fit, and where that puts the module."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from armwright.errors import DescriptionError
from armwright.modules.fit import angle_steps, fitting, is_step, why_not_fit
from armwright.modules.library import HALF_TURN, Connector, Module
from armwright.modules.order import Instance
from armwright.spatial import Placement, rotation_x, rotation_z

MEETING = Placement(rotation_x(HALF_TURN), np.zeros(3))  # one face in the other, at the angle 0


@dataclass
class Ground:
    """What modules can stand on so far: where each body stands in its link, and which connectors are taken by whom."""

    base: str
    stands: dict[tuple[str, str], Placement] = field(default_factory=dict)
    taken: dict[tuple[str, str], str] = field(default_factory=dict)


def mount(instance: Instance, instances: Mapping[str, Instance], ground: Ground) -> tuple[str, Placement, str]:
    """Where a module is put: the link that carries it, its body there, and where that body stands in the link.

    Both connectors are taken from then on.

    Returns:
        link, placement, body.
    Raises:
        DescriptionError: connectors that do not fit, are taken, or do not exist; an angle that is no step.
    """
    placed, module = instance.placed, instance.module
    if placed.on is None:
        name = placed.by or module.ground
        own, angle = None if name is None else module.connector(name), 0.0
        link, at = ground.base, Placement.identity()
        if placed.angle_rad is not None:
            angle = float(placed.angle_rad)
    else:
        below, _, name = placed.on.partition(".")
        carrier = instances[below].module.connector(name)
        if (below, name) in ground.taken:
            raise DescriptionError(
                f"connector {placed.on!r} carries {ground.taken[below, name]!r} and {instance.name!r}"
            )
        own = _own_connector(instance, placed.on, carrier)
        angle = _angle(instance, carrier, own)
        ground.taken[below, name] = instance.name
        link, at = instances[below].link(carrier.body), ground.stands[below, carrier.body] @ carrier.placement()
    at = at @ Placement(rotation_z(angle), np.zeros(3))
    if own is None:
        return link, at, root_body(module)
    ground.taken[instance.name, own.name] = placed.on or ground.base
    return link, at @ MEETING @ own.placement().inverse(), own.body


def _own_connector(instance: Instance, on: str, carrier: Connector) -> Connector:
    if instance.placed.by is not None:
        own = instance.module.connector(instance.placed.by)
        reason = why_not_fit(carrier, own)
        if reason:
            raise DescriptionError(f"connectors {on!r} and '{instance.name}.{own.name}' do not fit: {reason}")
        return own
    fits = fitting(carrier, instance.module)
    if len(fits) == 1:
        return fits[0]
    if fits:
        names = " or ".join(repr(own.name) for own in fits)
        raise DescriptionError(f"module {instance.name!r}: several connectors fit {on!r}; expected by = {names}")
    reasons = "; ".join(
        f"'{instance.name}.{own.name}': {why_not_fit(carrier, own) or 'it is for the ground'}"
        for own in instance.module.connectors
    )
    raise DescriptionError(f"module {instance.name!r} has no connector that fits {on!r} ({reasons})")


def _angle(instance: Instance, carrier: Connector, own: Connector) -> float:
    """How far a module is turned on its carrier [rad]: a step of both connectors."""
    given = instance.placed.angle_rad
    steps = angle_steps(carrier, own)
    if given is None:
        if steps == 1:
            return 0.0
        raise DescriptionError(f"module {instance.name!r}: angle_rad is missing; expected a multiple of 2π/{steps} rad")
    if not is_step(float(given), steps):
        raise DescriptionError(
            f"module {instance.name!r}: angle_rad = {float(given):g} is no step of {instance.placed.on!r} and "
            f"'{instance.name}.{own.name}'; expected a multiple of 2π/{steps} = {2 * np.pi / steps:.7g} rad"
        )
    return round(float(given) * steps / (2 * np.pi)) * 2 * np.pi / steps


def root_body(module: Module) -> str:
    """The body of a module that no joint of it moves."""
    children = {joint.child for joint in module.joints}
    return next(body.name for body in module.bodies if body.name not in children)

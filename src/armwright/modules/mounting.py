"""One module on another: fit of two connectors, possible angles, and the pose of the second module."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import gcd, pi

import numpy as np

from armwright.errors import DescriptionError
from armwright.modules.instances import Instance
from armwright.modules.library import HALF_TURN, Connector, Module
from armwright.spatial import Placement, rotation_x, rotation_z

PARTNER = {"m": "f", "f": "m", "n": "n"}
STEP = 1e-6  # [rad] within which an angle is taken for a step: π/2 in a file has 7 digits or more
MOST_STEPS = 1e9  # of an angle; beyond, floats tell no steps apart
MEETING = Placement(rotation_x(HALF_TURN), np.zeros(3))  # one face in the other, at the angle 0


def misfit(carrier: Connector, other: Connector) -> str | None:
    """First difference that prevents a connection of two connectors; None if they fit."""
    if carrier.kind != other.kind:
        return f"kind is {carrier.kind!r} and {other.kind!r}"
    if carrier.size != other.size:
        return f"size is {carrier.size!r} and {other.size!r}"
    if PARTNER[carrier.gender] != other.gender:
        return f"gender is {carrier.gender!r} and {other.gender!r}; expected m and f, or n and n"
    return None


def angle_steps(carrier: Connector, other: Connector) -> int:
    """Number of equal steps in a turn at which two connectors fit: those of both."""
    return gcd(carrier.angle_steps, other.angle_steps)


def fitting(carrier: Connector, module: Module) -> list[Connector]:
    """Connectors of a module that fit a carrying one; without the one that stands on the ground."""
    return [other for other in module.connectors if other.name != module.ground and misfit(carrier, other) is None]


@dataclass
class Structure:
    """The part of an arm assembled so far: each body's placement in its link, and the occupied connectors."""

    base: str
    placements: dict[tuple[str, str], Placement] = field(default_factory=dict)
    taken: dict[tuple[str, str], str] = field(default_factory=dict)


def mount(instance: Instance, instances: Mapping[str, Instance], structure: Structure) -> tuple[str, Placement, str]:
    """Puts a module on its carrier:  T = T_carrier Rz(angle) Rx(π) T_own⁻¹. Both connectors are taken from then on.

    Returns:
        link, placement, body: the link that carries the module, the placement in it of the module's body, that body.
    Raises:
        DescriptionError: connectors that do not fit, are taken, or do not exist; an angle that is no step.
    """
    placed, module = instance.placed, instance.module
    if placed.on is None:
        name = placed.by or module.ground
        connector = None if name is None else module.connector(name)
        angle = 0.0 if placed.angle_rad is None else float(placed.angle_rad)
        link, at = structure.base, Placement.identity()
    else:
        below, _, name = placed.on.partition(".")
        carrier = instances[below].module.connector(name)
        if (below, name) in structure.taken:
            user = structure.taken[below, name]
            raise DescriptionError(
                f"carries {user!r} already",
                place=f"module {instance.name!r} on",
                value=placed.on,
                expected="a free one",
            )
        connector = _connector(instance, carrier)
        angle = _angle(instance, carrier, connector)
        structure.taken[below, name] = instance.name
        link, at = instances[below].link(carrier.body), structure.placements[below, carrier.body] @ carrier.placement()
    at = at @ Placement(rotation_z(angle), np.zeros(3))
    if connector is None:
        return link, at, module.root
    structure.taken[instance.name, connector.name] = placed.on or structure.base
    return link, at @ MEETING @ connector.placement().inverse(), connector.body


def _connector(instance: Instance, carrier: Connector) -> Connector:
    """The module's own connector that meets the carrier: the one that the file names, or the only one that fits."""
    on, by, fits = instance.placed.on, instance.placed.by, fitting(carrier, instance.module)
    if by is not None:
        connector = instance.module.connector(by)
        reason = misfit(carrier, connector)
        if reason:
            raise DescriptionError(f"does not fit {on!r}: {reason}", place=f"module {instance.name!r} by", value=by)
        return connector
    if len(fits) == 1:
        return fits[0]
    if fits:
        names = " or ".join(repr(connector.name) for connector in fits)
        raise DescriptionError(f"several connectors fit {on!r}", place=f"module {instance.name!r} by", expected=names)
    reasons = "; ".join(
        f"{connector.name!r}: {misfit(carrier, connector) or 'it is for the ground'}"
        for connector in instance.module.connectors
    )
    raise DescriptionError(
        f"the module has no connector that fits: {reasons}", place=f"module {instance.name!r} on", value=on
    )


def _angle(instance: Instance, carrier: Connector, connector: Connector) -> float:
    """Angle of a module on its carrier [rad]: a step of both connectors."""
    steps, place = angle_steps(carrier, connector), f"module {instance.name!r} angle_rad"
    if instance.placed.angle_rad is None:
        if steps == 1:
            return 0.0
        raise DescriptionError("missing", place=place, expected=f"a multiple of 2π/{steps} rad")
    angle = float(instance.placed.angle_rad)
    turned = angle * steps / (2 * pi)
    count = round(turned) if abs(turned) < MOST_STEPS else 0
    if abs(turned - count) * 2 * pi / steps > STEP:
        expected = f"a multiple of 2π/{steps} = {2 * pi / steps:.7g} rad"
        what = f"no step of {instance.placed.on!r} and '{instance.name}.{connector.name}'"
        raise DescriptionError(what, place=place, value=angle, expected=expected)
    return count * 2 * pi / steps

"""Whether two connectors fit, and at which angles."""

from __future__ import annotations

from math import gcd, pi

from armwright.modules.library import Connector, Module

PARTNER = {"m": "f", "f": "m", "n": "n"}
STEP = 1e-6  # [rad] within which an angle is meant to be a step: a file's π/2 has 7 digits or more


def why_not_fit(carrier: Connector, own: Connector) -> str | None:
    """What differs between two connectors that should meet, or None where they fit."""
    if carrier.kind != own.kind:
        return f"kind is {carrier.kind!r} and {own.kind!r}"
    if carrier.size != own.size:
        return f"size is {carrier.size!r} and {own.size!r}"
    if PARTNER[carrier.gender] != own.gender:
        return f"gender is {carrier.gender!r} and {own.gender!r}; expected m and f, or n and n"
    return None


def angle_steps(carrier: Connector, own: Connector) -> int:
    """In how many equal steps a turn the two can be put together: those that both have."""
    return gcd(carrier.angle_steps, own.angle_steps)


def is_step(angle: float, steps: int) -> bool:
    """Whether an angle [rad] is a whole number of steps."""
    count = angle * steps / (2 * pi)
    return abs(count - round(count)) * 2 * pi / steps <= STEP


def fitting(carrier: Connector, module: Module) -> list[Connector]:
    """The connectors of a module that fit a carrying one; not the one that stands on the ground."""
    return [own for own in module.connectors if own.name != module.ground and why_not_fit(carrier, own) is None]

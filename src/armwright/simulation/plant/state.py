"""What the state of a plant consists of: positions and speeds, then only what the record's drives ask for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from armwright.model import Body, Model


@dataclass(frozen=True)
class StatePart:
    """Entries of the plant's state that belong together.

    Attributes:
        name: such as "q" or "current".   joints: which joints have it, by index; none for the bus.
        units: of each entry.   start: where they begin in x.
    """

    name: str
    joints: tuple[int, ...]
    units: tuple[str, ...]
    start: int

    @property
    def place(self) -> slice:
        """Where they stand in x."""
        return slice(self.start, self.start + len(self.units))


def parts_of(model: Model, brakes: bool) -> tuple[StatePart, ...]:
    """The parts of an arm's state, in order; with or without its brakes."""
    slides = [body.kind == "prismatic" for body in model.coordinates]

    def which(has: Callable[[Body], bool]) -> tuple[int, ...]:
        return tuple(i for i, body in enumerate(model.coordinates) if has(body))

    def lengths(joints: tuple[int, ...], ending: str = "") -> tuple[str, ...]:
        return tuple(("m" if slides[i] else "rad") + ending for i in joints)

    every, elastic = which(lambda body: True), which(lambda body: body.elasticity is not None)
    wound = which(lambda body: body.drive.inductance is not None)
    bristle = which(lambda body: body.friction is not None and body.friction.bristle is not None)
    held = which(lambda body: brakes and body.brake is not None)
    warm = which(lambda body: body.drive.thermal is not None)
    housed = which(lambda body: body.drive.thermal is not None and body.drive.thermal.housing is not None)
    told = [
        ("q", every, lengths(every)),
        ("qd", every, lengths(every, "/s")),
        ("motor_q", elastic, ("rad",) * len(elastic)),  # θ_motor itself, in the motor's own radians
        ("motor_qd", elastic, ("rad/s",) * len(elastic)),
        ("current", wound, ("A",) * len(wound)),
        ("bristle", bristle, lengths(bristle)),
        ("brake", held, lengths(held)),
        ("winding_temperature", warm, ("°C",) * len(warm)),
        ("housing_temperature", housed, ("°C",) * len(housed)),
        ("bus_voltage", (), ("V",) if model.supply is not None else ()),
    ]
    parts, start = [], 0
    for name, joints, units in told:
        if units:
            parts.append(StatePart(name, joints, units, start))
            start += len(units)
    return tuple(parts)


def contacts_of(body: Body) -> int:
    """How many contacts a joint can make: with its two stops, and between the flanks of a gear with play."""
    plays = body.elasticity is not None and body.elasticity.backlash is not None
    return 2 * (body.stops is not None) + 2 * plays


def has_extra(body: Body) -> bool:
    """Whether a joint has what `forward_dynamics` does not know, be it with a state or without."""
    friction, drive = body.friction, body.drive
    rising = friction is not None and friction.load_share is not None
    told = (body.elasticity, body.stops, drive.cogging, drive.thermal)
    return rising or drive.coasts or bool(drive.coupling) or any(part is not None for part in told)

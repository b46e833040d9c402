"""Inputs of the plant: commands, wrench, brakes and payload, all held over a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from armwright.scalar import Array

# those that the plant's derivative takes beside commands; a payload changes the arm itself
HELD = ("wrench", "brake", "contacts", "directions", "supply", "enabled")
OF_DRIVES = ("supply", "enabled")  # those that the currents of motors depend on beside their commands


@dataclass(frozen=True, eq=False)
class PlantInputs:
    """Inputs of a plant at one time.

    Attributes:
        command: (n,) [V | A | N m | N].   wrench: (6,) [N, N m] of the environment on the tip, in base axes; None: none.
        supply: (1,) [V] of the supply of all drives, in place of what the record says; None: that.
        enabled: (servos,) 1 where a servo is on, 0 where it is off and its bridge open; None: all are on.
        brake: (brakes,) 1 where a brake is applied, 0 where it is released; None: all released.
        contacts: (contacts,) 1 where a contact counts as made; None: as follows from the state.
        directions: (sticking,) in which joints and motors with dry friction move, 1 or -1, 0: it sticks; None: as follows from
            the state.
        payload: (10 frames,) inertial parameters of bodies about the origins of the frames that carry them; None: none.
            They change the arm itself: `LoopConfig.plant` adds them to it.
    """

    command: Array
    wrench: Array | None = None
    brake: Array | None = None
    contacts: Array | None = None
    directions: Array | None = None
    payload: Array | None = None
    supply: Array | None = None
    enabled: Array | None = None

    @classmethod
    def of(cls, command: PlantInputs | Any) -> PlantInputs:
        """The inputs of a command (n,) alone; PlantInputs stay as they are."""
        return command if isinstance(command, PlantInputs) else cls(command)

    @classmethod
    def named(cls, command: Array, values: Mapping[str, Array]) -> PlantInputs:
        """Commands, and those of the values whose names are inputs."""
        return cls(command, **{name: values.get(name) for name in (*HELD, "payload")})

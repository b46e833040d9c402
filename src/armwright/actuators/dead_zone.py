"""Dead zone of a drive's stage: commands of voltage within ±width give nothing, and all others that much less."""

from __future__ import annotations

from armwright import scalar
from armwright.scalar import Scalar


def beyond(command: Scalar, width: Scalar | None) -> Scalar:
    """Voltage of the stage,  V = u - clip(u, -width, width)  [V]; the command itself without a width."""
    return command if width is None else command - scalar.clip(command, -width, width)


def command_for(voltage: Scalar, width: Scalar | None) -> Scalar:
    """Command that gives a voltage,  u = V + width sgn V  [V]; of all that give none, 0."""
    return voltage if width is None else voltage + width * scalar.sign(voltage)

"""Brushless motors as the DC motor they amount to: power in equals torque times speed plus heat. [Krishnan2010]

The equivalent's current is the peak of the phase current, so that  v i = 3/2 v̂ î  asks for a voltage of 3/2 the
phase peak: impedances and back-EMF constants of one phase count 3/2, line to line values are taken to one phase first.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt


@dataclass(frozen=True)
class DcEquivalent:
    """Factors from constants as measured to the DC-equivalent ones."""

    torque_constant: float
    back_emf_constant: float
    impedance: float  # resistance and inductance
    voltage: float
    current: float


DC_EQUIVALENT = {
    "dc": DcEquivalent(1.0, 1.0, 1.0, 1.0, 1.0),
    "phase_peak": DcEquivalent(1.0, 1.5, 1.5, 1.5, 1.0),
    "phase_rms": DcEquivalent(1 / sqrt(2), 1.5 * sqrt(2), 1.5, 1.5 * sqrt(2), sqrt(2)),
    "line_peak": DcEquivalent(1.0, 1.5 / sqrt(3), 0.75, 1.5 / sqrt(3), 1.0),
    "line_rms": DcEquivalent(1 / sqrt(2), 1.5 * sqrt(2) / sqrt(3), 0.75, 1.5 * sqrt(2) / sqrt(3), sqrt(2)),
}

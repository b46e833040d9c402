"""The supply that all drives share: a rectifier behind a resistance, the bus capacitor, the brake chopper.

An empty bus stays at 0 V: the free-wheeling diodes of the drives' bridges carry what the motors draw beyond the source's
current. Their ideal diodes take no power, and a motor between two rails at 0 V is shorted: its current dies away in its winding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.model import Supply
from armwright.scalar import Scalar

LEAST = 1e-9  # of the source's voltage: the lowest bus voltage in quotients; there a duty V / V_bus still has its limit


@dataclass(frozen=True, eq=False)
class Bus:
    """State of the supply's bus."""

    speed: Scalar  # V̇ [V/s]
    rate: Scalar  # its part that is linear in V [1/s], never above 0
    source: Scalar  # power out of the source [W]
    loss: Scalar  # power in the source's resistance and in the braking resistor [W]


def drive_voltage(supply: Supply, voltage: Scalar) -> Scalar:
    """Voltage [V] that bridges switch: that of the bus, and 1e-9 of the source's where it is empty.

    Args:
        supply: V_source.   voltage: V of the bus [V].
    """
    return scalar.maximum(voltage, LEAST * supply.voltage)


def bus(supply: Supply, voltage: Scalar, drawn: Scalar, unlimited: Scalar = 0.0) -> Bus:
    """C V̇ = max(0, V_source - V) / R - P / V - share · V / R_chopper + I_diodes,  share = clip((V - from) / over, 0, 1).

    I_diodes ≥ 0 flows only where V = 0, and is what keeps V̇ ≥ 0 there. A V below 0, as between the stages of a rule, counts as 0.

    Args:
        supply: V_source, R, C and the chopper.   voltage: V of the bus [V].
        drawn: P, power of all drives [W]; of bridges that switch `drive_voltage`, so that P / V is a current.
        unlimited: power [W] of drives without electrical constants, part of P: they take it at any voltage. An empty bus
            cannot give it: V̇ is then NaN.
    """
    empty, voltage = scalar.less_equal(voltage, 0.0), scalar.maximum(voltage, 0.0)
    drop = scalar.maximum(supply.voltage - voltage, 0.0)
    current, conducts = drop / supply.resistance, scalar.less(voltage, supply.voltage) / supply.resistance
    braked, slope = 0.0, 0.0
    if supply.chopper is not None:
        begin, band, resistance = supply.chopper
        share = scalar.clip((voltage - begin) / band, 0.0, 1.0)
        rising = scalar.less(0.0, share) * scalar.less(share, 1.0)
        braked, slope = share * voltage / resistance, (share + rising * voltage / band) / resistance
    speed = (current - drawn / drive_voltage(supply, voltage) - braked) / supply.capacitance
    at_least = scalar.where(scalar.equal(unlimited, 0.0), 0.0, np.nan)
    speed = scalar.where(empty, scalar.maximum(speed, 0.0) + at_least, speed)
    rate = -(conducts + slope) / supply.capacitance
    return Bus(speed, rate, supply.voltage * current, drop * current + braked * voltage)

"""The supply that all drives share: a rectifier behind a resistance, the bus capacitor, the brake chopper."""

from __future__ import annotations

from dataclasses import dataclass

from armwright import scalar
from armwright.model import Supply
from armwright.scalar import Scalar


@dataclass(frozen=True, eq=False)
class Bus:
    """State of the supply's bus."""

    speed: Scalar  # V̇ [V/s]
    rate: Scalar  # its part that is linear in V [1/s], never above 0
    source: Scalar  # power out of the source [W]
    loss: Scalar  # power in the source's resistance and in the braking resistor [W]


def bus(supply: Supply, voltage: Scalar, drawn: Scalar) -> Bus:
    """C V̇ = max(0, V_source - V) / R - P / V - share · V / R_chopper,  share = clip((V - from) / over, 0, 1).

    Args:
        supply: V_source, R, C and the chopper.   voltage: V of the bus [V].   drawn: P, power of all drives [W].
    """
    drop = scalar.maximum(supply.voltage - voltage, 0.0)
    current, conducts = drop / supply.resistance, scalar.less(voltage, supply.voltage) / supply.resistance
    braked, slope = 0.0, 0.0
    if supply.chopper is not None:
        begin, band, resistance = supply.chopper
        share = scalar.clip((voltage - begin) / band, 0.0, 1.0)
        rising = scalar.less(0.0, share) * scalar.less(share, 1.0)
        braked, slope = share * voltage / resistance, (share + rising * voltage / band) / resistance
    speed = (current - drawn / voltage - braked) / supply.capacitance
    rate = -(conducts + slope) / supply.capacitance
    return Bus(speed, rate, supply.voltage * current, drop * current + braked * voltage)

"""Temperatures of a motor: lumped heat capacities behind thermal resistances. [HendershotMiller2010]"""

from __future__ import annotations

from dataclasses import replace

from armwright.model import Drive, Thermal
from armwright.scalar import Scalar


def warmed(drive: Drive, winding: Scalar, housing: Scalar | None) -> Drive:
    """The drive with the constants it has at its temperatures.

    R = R_ref (1 + α_R (T_w - T_ref)),  Kt and Ke = theirs at T_ref · (1 + α_B (T - T_ref)),
    T of the magnets: the housing's, or the winding's where the motor is one body.

    Args:
        drive: as measured at T_ref.   winding: T_w [°C].   housing: T_h [°C], None where there is none.
    """
    thermal = drive.thermal
    assert thermal is not None
    changed = {}
    if thermal.resistance_temperature_coefficient is not None:
        change = thermal.resistance_temperature_coefficient * (winding - thermal.reference)
        changed["resistance"] = drive.resistance * (1.0 + change)
    if thermal.magnet_temperature_coefficient is not None:
        magnets = winding if housing is None else housing
        change = thermal.magnet_temperature_coefficient * (magnets - thermal.reference)
        changed["torque_constant"] = drive.torque_constant * (1.0 + change)
        changed["back_emf_constant"] = drive.back_emf_constant * (1.0 + change)
    return replace(drive, **changed)


def warming_rates(
    thermal: Thermal, heat: Scalar, winding: Scalar, housing: Scalar | None
) -> tuple[Scalar, Scalar | None]:
    """Ṫ_w and Ṫ_h [K/s]; Ṫ_h is None where the motor is one body.

    C_w Ṫ_w = heat - (T_w - T_h) / R_w,   C_h Ṫ_h = (T_w - T_h) / R_w - (T_h - T_ambient) / R_h;
    of one body   C_w Ṫ_w = heat - (T_w - T_ambient) / R_w.

    Args:
        thermal: capacities [J/K] and resistances [K/W].   heat: of the winding [W].   winding, housing: [°C].
    """
    capacity, resistance = thermal.winding
    if housing is None or thermal.housing is None:
        return (heat - (winding - thermal.ambient) / resistance) / capacity, None
    passed = (winding - housing) / resistance  # [W] to the housing
    return (heat - passed) / capacity, (passed - (housing - thermal.ambient) / thermal.housing[1]) / thermal.housing[0]

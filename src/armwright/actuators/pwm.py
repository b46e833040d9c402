"""A bridge whose switches are open while off: averaged over a period, the back-EMF acts only while on.

With duty D = |V| / V_s of a supply V_s, σ = sgn V and a current that dies away in every period (discontinuous conduction):

    while on   i_on = (σ V_s - E) / R,   while off  i = 0,   averaged  i = D i_on = (V - D E) / R.

A bridge that shorts the motor while off ("brake") has the whole back-EMF, averaged i = (V - E) / R.
A back-EMF above the supply would drive current through the diodes while off: that is left out.
"""

from __future__ import annotations

from armwright import scalar
from armwright.scalar import Scalar

NEAREST = 1e-9  # of the supply: how near it the back-EMF comes in a quotient, where no voltage makes a current


def coasting(voltage: Scalar, supply: Scalar, emf: Scalar, resistance: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Averaged current, heat and power from the supply.

    Args:
        voltage: V, averaged, within ±supply [V].   supply: V_s [V].   emf: E [V].   resistance: R [Ω].
    Returns:
        i: [A].   heat: R i_on² D [W].   power: σ V_s i [W].
    """
    current = (voltage - scalar.abs(voltage) / supply * emf) / resistance
    switched = scalar.sign(voltage) * supply
    return current, current * (switched - emf), current * switched


def coasting_limits(most: Scalar, supply: Scalar, emf: Scalar, resistance: Scalar) -> tuple[Scalar, Scalar]:
    """Voltages [V] between which the averaged current stays within ±most [A]:  |V| ≤ R most / |1 ∓ E / V_s|."""
    reach = resistance * most * supply
    return (
        -reach / scalar.maximum(scalar.abs(supply + emf), NEAREST * supply),
        reach / scalar.maximum(scalar.abs(supply - emf), NEAREST * supply),
    )

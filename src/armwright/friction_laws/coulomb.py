"""Coulomb's law with a Stribeck level, smoothed or not. [BittencourtGunnarsson2012]"""

from __future__ import annotations

from typing import Any

from armwright.friction_laws.law import FrictionLaw, Loads
from armwright.friction_laws.levels import smooth_sign
from armwright.scalar import Scalar


class Coulomb(FrictionLaw):
    """Coulomb's law, with a level that falls over speed."""

    name = "coulomb"
    equation = """
    `law = "coulomb"`:  f = offset + viscous q̇ + s · [ coulomb + (stribeck_torque - coulomb) exp(-(q̇/stribeck_speed)²) ],
    coulomb_positive where q̇ > 0, coulomb_negative where q̇ < 0 (both magnitudes)."""
    sticks = True

    def add(
        self, torque: Scalar, friction: Any, speed: Scalar, load: Loads | Scalar | None, warming: Scalar | None
    ) -> Scalar:
        """torque + s · [ Fc + (Fs - Fc) exp(-(q̇/vs)²) ],  Fc by the sign of q̇, s = `smooth_sign`."""
        if friction.smoothing is None and not friction.is_dry:
            return torque
        return torque + self.level(friction, speed, load, warming) * smooth_sign(speed, friction.smoothing)

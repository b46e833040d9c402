"""Dry friction whose level rises with the torques on both sides of it, as measured of bus servos. [DuclusaudEtAl2025]"""

from __future__ import annotations

from typing import Any

from armwright import scalar
from armwright.friction_laws.coulomb import Coulomb
from armwright.friction_laws.law import Loads, OwnKey
from armwright.friction_laws.levels import warmed
from armwright.scalar import Scalar


class LoadDependent(Coulomb):
    """Coulomb's law with a level by speed, motor torque and external torque: the models M1 to M6 of servos."""

    name = "load-dependent"
    equation = """
    `law = "load-dependent"`:  f = offset + viscous q̇ + s · (Fc + L + σ (Fs - Fc + L_s + Q)),
    Fc = coulomb, Fs = stribeck_torque, σ = exp(-|q̇/stribeck_speed|^stribeck_exponent),
    L = |load_external τ_e - load_motor τ_m|, L_s with load_external_stribeck and load_motor_stribeck,
    Q, where τ_m τ_e < 0:  load_external_quadratic τ_e² if |τ_m| > |τ_e|, load_motor_quadratic τ_m² if |τ_m| < |τ_e|.
    τ_m is the motor's torque, τ_e that of all else that depends on the state alone: -(C q̇ + g), springs, stops, a wrench;
    positive, they push forward. In the kernels τ_m = τ_e = 0. [DuclusaudEtAl2025]"""
    own = (
        OwnKey("stribeck_exponent", "number", "Exponent of the level's fall over speed.", "Positive"),
        *(
            OwnKey(f"load_{of}", "number", f"The level rises by this share of the {what} torque.", "NotNegative")
            for of, what in (("motor", "motor's"), ("external", "external"))
        ),
        *(
            OwnKey(f"load_{of}_stribeck", "number", f"The same of the {what} torque, at standstill.", "NotNegative")
            for of, what in (("motor", "motor's"), ("external", "external"))
        ),
        *(
            OwnKey(f"load_{of}_quadratic", "per torque", f"The same of the {what} torque squared.", "NotNegative")
            for of, what in (("motor", "motor's"), ("external", "external"))
        ),
    )
    dry = "needed"
    by_loads = True
    feature = "load-dependent friction"
    lost = "the loads of the friction law 'load-dependent'"

    def level(
        self,
        friction: Any,
        speed: Scalar,
        load: Loads | Scalar | None = None,
        warming: Scalar | None = None,
        direction: Scalar | None = None,
    ) -> Scalar:
        """g at a speed, by the torques (τ_m, τ_e) [N m | N]; without them those are 0."""
        exponent, motor, external, motor_still, external_still, of_motor, of_external = friction.parameters
        backward = scalar.less(speed if direction is None else direction, 0.0)
        coulomb, most = (
            None if part is None else warmed(part, friction.coulomb_temperature_coefficient, warming)
            for part in (
                scalar.where(backward, friction.coulomb_negative, friction.coulomb_positive),
                friction.stribeck,
            )
        )
        fallen = _falling(scalar.abs(speed) / friction.stribeck_speed, exponent)
        level = coulomb if most is None else coulomb + fallen * (most - coulomb)
        if not isinstance(load, tuple):
            return level
        tau_m, tau_e = load
        still = scalar.abs(external_still * tau_e - motor_still * tau_m)
        drives, driven = scalar.abs(tau_m), scalar.abs(tau_e)
        squares = scalar.where(
            scalar.less(driven, drives),
            of_external * tau_e * tau_e,
            scalar.where(scalar.less(drives, driven), of_motor * tau_m * tau_m, 0.0),
        )
        squares = scalar.where(scalar.less(tau_m * tau_e, 0.0), squares, 0.0)
        return level + scalar.abs(external * tau_e - motor * tau_m) + fallen * (still + squares)


def _falling(ratio: Scalar, exponent: Scalar) -> Scalar:
    """exp(-ratio^exponent), 1 at standstill."""
    still = scalar.equal(ratio, 0.0)
    power = scalar.exp(exponent * scalar.log(scalar.where(still, 1.0, ratio)))
    return scalar.where(still, 1.0, scalar.exp(-power))

"""Dry friction whose level rises with the torques on both sides of it, as measured of bus servos. [DuclusaudEtAl2025]"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from armwright import scalar
from armwright.friction_laws.coulomb import Coulomb
from armwright.friction_laws.law import Loads, OwnKey
from armwright.friction_laws.levels import smooth_sign, warmed_levels
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
    positive, they push forward. Kernels know no stops. [DuclusaudEtAl2025]"""
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
        _, motor, external, *_ = friction.parameters
        backward = scalar.less(speed if direction is None else direction, 0.0)
        coulomb = scalar.where(backward, friction.coulomb_negative, friction.coulomb_positive)
        coulomb, most = warmed_levels(friction, coulomb, warming)
        stribeck = _stribeck_share(friction, speed)
        level = coulomb if most is None else coulomb + stribeck * (most - coulomb)
        if not isinstance(load, tuple):
            return level
        tau_m, tau_e = load
        added = scalar.abs(external * tau_e - motor * tau_m)
        return level + added + stribeck * self._level_at_standstill(friction, load)

    def falling(self, friction: Any, load: Loads | Scalar | None = None) -> Scalar:
        """Fs - Fc + L_s + Q, which fall over speed."""
        falling = super().falling(friction)
        return falling + self._level_at_standstill(friction, load) if isinstance(load, tuple) else falling

    @staticmethod
    def _level_at_standstill(friction: Any, load: Loads) -> Scalar:
        """L_s + Q."""
        *_, motor_still, external_still, of_motor, of_external = friction.parameters
        tau_m, tau_e = load
        still = scalar.abs(external_still * tau_e - motor_still * tau_m)
        drives, driven = scalar.abs(tau_m), scalar.abs(tau_e)
        squares = scalar.where(
            scalar.less(driven, drives),
            of_external * tau_e * tau_e,
            scalar.where(scalar.less(drives, driven), of_motor * tau_m * tau_m, 0.0),
        )
        squares = scalar.where(scalar.less(tau_m * tau_e, 0.0), squares, 0.0)
        return still + squares

    def motor_torque(self, friction: Any, speed: Scalar, needed: Scalar, external: Scalar) -> Scalar:
        """τ_m of  τ_m = needed + s g(q̇, τ_m, τ_e),  s = `smooth_sign`: the level depends on the torque that is asked for.

        In the direction of motion (T = ± τ_m, s ≥ 0) it is the least torque T at which T - s g reaches `needed`. There is only
        one where T - s g rises with T throughout. It does not in three cases:

        - load_motor + load_motor_stribeck is 1 or more: from some T on friction takes all that the motor adds, or more. What
          needs more than the largest T - s g has no torque: NaN.
        - load_motor_quadratic |τ_e| is near ½: so it is where the motor drives with less than τ_e. It is the lesser torque.
        - Q jumps at τ_m = -τ_e, where the quadratic shares differ. Of two torques it is the lesser. Where there is none, it is
          -τ_e: the joint then accelerates otherwise than asked for, by no more than the jump makes.

        Args:
            friction: numbers referred to the joint.   speed: [rad/s | m/s].
            needed: torque beside this friction [N m | N].   external: τ_e [N m | N].
        """
        _, *shares, of_motor, of_external = friction.parameters
        way = scalar.where(scalar.less(speed, 0.0), -1.0, 1.0)
        s, stribeck = way * smooth_sign(speed, friction.smoothing), _stribeck_share(friction, speed)
        least, load = way * needed + s * self.level(friction, speed), way * external
        motor, pushed, motor_still, pushed_still = shares
        loads = (motor, pushed * load), (stribeck * motor_still, stribeck * pushed_still * load)
        # Without Q, T - s g is the least of lines, one for each pair of signs of |τ_e part - τ_m part|: T is the largest of the
        # torques at which they are `needed`.
        ways = [(1.0, -1.0) if _counts(m) or _counts(e) else (1.0,) for m, e in ((motor, pushed), shares[2:])]
        lines = [_line(signs, loads, s, least) for signs in product(*ways)]
        locks = scalar.is_symbolic(motor, motor_still) or motor + motor_still >= 1.0
        torque, found = lines[0][1] / lines[0][0], 1.0
        for slope, right in lines[1:]:
            rises = scalar.less(0.0, slope) if locks else 1.0
            root = right / (scalar.where(rises, slope, 1.0) if locks else slope)
            torque = scalar.where(rises * scalar.less(torque, root), root, torque)
        for slope, right in lines[1:] if locks else ():
            reached = scalar.less_equal(right, slope * torque)
            found = found * scalar.where(scalar.less(0.0, slope), 1.0, reached)
        # The line at that torque again by its signs: derivatives need the right one at rest, where all lines are equal.
        signs = [scalar.where(scalar.less(e, m * torque), -1.0, 1.0) for m, e in loads]
        slope, right = _line(signs, loads, s, least)
        slope = scalar.where(scalar.less(0.0, slope), slope, 1.0) if locks else slope
        torque = right / slope
        if _counts(of_motor) or _counts(of_external):
            torque = _beyond_squares(torque, slope, load, s * stribeck * of_motor, s * stribeck * of_external)
        return way * (scalar.where(found, torque, np.nan) if locks else torque)


def _line(
    signs: Sequence[Scalar], loads: Sequence[tuple[Scalar, Scalar]], s: Scalar, least: Scalar
) -> tuple[Scalar, ...]:
    """Slope and right side of  slope T = right  where each load |e - m T| has the sign of a pair."""
    slope, right = 1.0, least
    for sign, (m, e) in zip(signs, loads, strict=True):
        slope, right = slope + s * (sign * m), right + s * (sign * e)
    return slope, right


def _beyond_squares(torque: Scalar, slope: Scalar, load: Scalar, of_motor: Scalar, of_external: Scalar) -> Scalar:
    """The least T with  slope (T - torque) = Q(T),  Q = of_motor T² where |T| < |load|, of_external load² beyond it; both against
    each other, else `torque` itself. At the jump between them the torque -load stands for what no T gives."""
    constant = torque + of_external * load * load / slope
    under = slope * (slope - 4.0 * of_motor * torque)
    real = scalar.less(0.0, under)
    root = scalar.sqrt(scalar.where(real, under, 1.0))
    square = scalar.where(real, 2.0 * slope * torque / (slope + root), -load)
    backward = scalar.less(load, 0.0)  # then T > 0, where the square comes before the constant
    first, second = scalar.where(backward, square, constant), scalar.where(backward, constant, square)
    found = scalar.where(scalar.less(first, -load), first, scalar.where(scalar.less(second, -load), -load, second))
    return scalar.where(scalar.less(torque * load, 0.0), found, torque)


def _counts(share: Scalar) -> bool:
    """True if a share is a symbol or not 0."""
    return scalar.is_symbolic(share) or share != 0.0


def _stribeck_share(friction: Any, speed: Scalar) -> Scalar:
    """σ, the part of the level at standstill that is left at a speed."""
    return _stribeck_decay(scalar.abs(speed) / friction.stribeck_speed, friction.parameters[0])


def _stribeck_decay(ratio: Scalar, exponent: Scalar) -> Scalar:
    """exp(-ratio^exponent), 1 at standstill."""
    still = scalar.equal(ratio, 0.0)
    power = scalar.exp(exponent * scalar.log(scalar.where(still, 1.0, ratio)))
    return scalar.where(still, 1.0, scalar.exp(-power))

"""Levels of dry friction over speed, warming and load, which several laws share."""

from __future__ import annotations

from typing import Any

from armwright import scalar
from armwright.scalar import Scalar


def smooth_sign(speed: Scalar, smoothing: Scalar | None) -> Scalar:
    """s = q̇ / √(q̇² + smoothing²): a sign that passes through 0 with the slope 1/smoothing.

    Without smoothing, None, s = sgn q̇ with sgn 0 = 0; its slope is 0 everywhere.
    """
    if smoothing is None:
        return scalar.sign(speed)
    return speed / scalar.sqrt(speed * speed + smoothing * smoothing)


def static_levels(friction: Any) -> tuple[Scalar, Scalar]:
    """-Fs and Fs; without Stribeck's level, or above it, Coulomb's of either direction."""
    plus, minus = friction.coulomb_positive, friction.coulomb_negative
    if friction.stribeck is None:
        return -minus, plus
    return -scalar.maximum(friction.stribeck, minus), scalar.maximum(friction.stribeck, plus)


def dry_level(
    friction: Any,
    speed: Scalar,
    load: Scalar | None = None,
    warming: Scalar | None = None,
    direction: Scalar | None = None,
) -> Scalar:
    """g(q̇) = Fc + (Fs - Fc) exp(-(q̇/vs)²) [N m | N].  [BittencourtGunnarsson2012]

    Both levels count max(0, 1 + coefficient · warming) times, and then rise by share · |load|. Fc is that of the direction of
    motion, by default the sign of the speed.
    """
    plus, minus = friction.coulomb_positive, friction.coulomb_negative
    backward = scalar.less(speed if direction is None else direction, 0.0)
    level = plus if same(plus, minus) else scalar.where(backward, minus, plus)
    level, most = warmed_levels(friction, level, warming)
    if load is not None and friction.load_coefficient is not None:
        added = friction.load_coefficient * scalar.abs(load)
        level, most = level + added, None if most is None else most + added
    if most is not None:
        ratio = speed / friction.stribeck_speed
        level = level + (most - level) * scalar.exp(-(ratio * ratio))
    return level


def warmed(value: Scalar, coefficient: Scalar | None, warming: Scalar | None) -> Scalar:
    """value · max(0, 1 + coefficient · warming)."""
    if coefficient is None or warming is None:
        return value
    return value * scalar.maximum(1.0 + coefficient * warming, 0.0)


def warmed_levels(friction: Any, coulomb: Scalar, warming: Scalar | None) -> tuple[Scalar, Scalar | None]:
    """A level of Coulomb's and Stribeck's, None without it, when they are warm."""
    coulomb = warmed(coulomb, friction.coulomb_temperature_coefficient, warming)
    if friction.stribeck is None:
        return coulomb, None
    return coulomb, warmed(friction.stribeck, friction.coulomb_temperature_coefficient, warming)


def same(a: Scalar, b: Scalar) -> bool:
    """True if two numbers are one symbol, or equal without symbols."""
    return a is b or (not scalar.is_symbolic(a, b) and a == b)

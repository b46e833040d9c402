"""Friction laws as a robot file names them: the keys that only one law has, and which keys go together.

The equations are in `armwright.actuators.friction`, under the same names.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

LawName = Literal["coulomb", "sigmoid", "lugre"]
Dimension = Literal["torque", "speed", "slope", "stiffness", "damping"]
ENDINGS: dict[Dimension, tuple[str, str]] = {  # of keys, in a record in N m and rad and in one in N and m
    "torque": ("n_m", "n"),
    "speed": ("rad_per_s", "m_per_s"),
    "slope": ("s_per_rad", "s_per_m"),
    "stiffness": ("n_m_per_rad", "n_per_m"),
    "damping": ("n_m_s_per_rad", "n_s_per_m"),
}


@dataclass(frozen=True)
class FrictionKeys:
    """What a law reads of a record beside viscous friction and offset.

    Attributes:
        own: keys that only this law has, without their unit, and the dimension of each; it needs all of them.
        dry: Coulomb's and Stribeck's levels: "allowed", "needed" (Coulomb's, above 0), or "none".
        linear: those of `own` in which friction is linear: columns of `regressor_drive`.
    """

    own: tuple[tuple[str, Dimension], ...] = ()
    dry: Literal["allowed", "needed", "none"] = "allowed"
    linear: tuple[str, ...] = ()


LAWS: dict[LawName, FrictionKeys] = {
    "coulomb": FrictionKeys(),
    "sigmoid": FrictionKeys(
        (("sigmoid_amplitude", "torque"), ("sigmoid_slope", "slope"), ("sigmoid_shift", "speed")),
        dry="none",
        linear=("sigmoid_amplitude",),
    ),
    "lugre": FrictionKeys((("bristle_stiffness", "stiffness"), ("bristle_damping", "damping")), dry="needed"),
}
LINEAR = tuple(  # law and place of every parameter of its own in which friction is linear
    (name, place) for name, law in LAWS.items() for place, (stem, _) in enumerate(law.own) if stem in law.linear
)


def key_of(stem: str, dimension: Dimension, linear: bool) -> str:
    """A key with its unit: `key_of("bristle_stiffness", "stiffness", False)` → "bristle_stiffness_n_m_per_rad"."""
    stem = "stribeck_force" if linear and stem == "stribeck_torque" else stem
    return f"{stem}_{ENDINGS[dimension][linear]}"


def check_friction(friction: Any, linear: bool) -> None:
    """Refuses a record of friction whose keys do not go together; `linear`: it is in N and metres.

    Raises:
        ValueError: names the key and what it needs.
    """
    given = {key for key in type(friction).model_fields if getattr(friction, key) is not None}
    coulomb = [key_of(f"coulomb_{side}", "torque", linear) for side in ("positive", "negative")]
    stribeck = [key_of("stribeck_torque", "torque", linear), key_of("stribeck_speed", "speed", linear)]
    for pair in (coulomb, stribeck):
        missing = [key for key in pair if key not in given]
        if len(missing) == 1:
            raise ValueError(f"{next(key for key in pair if key in given)} needs {missing[0]} beside it")
    law = LAWS[friction.law]
    needed = [*(key_of(*key, linear) for key in law.own), *(coulomb if law.dry == "needed" else [])]
    missing = [key for key in needed if key not in given]
    if missing:
        raise ValueError(f'law = "{friction.law}" needs {" and ".join(missing)}')
    for key in coulomb:
        if law.dry == "needed" and getattr(friction, key).value == 0:
            raise ValueError(f'{key}: law = "{friction.law}" expects a level above 0, at which the bristles slip')
    for name, other in LAWS.items():
        foreign = [key for key in (key_of(*key, linear) for key in other.own) if key in given and key not in needed]
        if foreign:
            raise ValueError(f'{foreign[0]} needs law = "{name}"')
    if "load_coefficient" in given and coulomb[0] not in given:
        raise ValueError(f"load_coefficient needs {coulomb[0]} and {coulomb[1]} beside it, which rise with the load")
    if "viscous_fall_k" in given and key_of("viscous", "damping", linear) not in given:
        raise ValueError("viscous_fall_k needs viscous friction, which falls")
    dry = [key for key in (*coulomb, *stribeck) if key in given]
    if dry and law.dry == "none":
        raise ValueError(f'law = "{friction.law}" knows no {dry[0]}')
    smoothing = key_of("smoothing", "speed", linear)
    if dry and smoothing not in given:
        raise ValueError(f"Coulomb friction needs {smoothing}, the speed over which it is smoothed")
    if stribeck[0] in given and coulomb[0] not in given:
        raise ValueError(f"{stribeck[0]} needs {coulomb[0]} and {coulomb[1]} beside it")

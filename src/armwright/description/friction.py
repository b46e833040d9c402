"""Friction laws in robot files: keys of each law, and valid combinations.

The equations are in `armwright.actuators.friction`, under the same names.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Annotated, Any, Literal

from armwright.errors import DescriptionError
from armwright.joint_kinds import Dimension
from armwright.quantity import Quantity, Reading, check_together, one_number
from armwright.validation import Invalid

LawName = Literal["coulomb", "sigmoid", "lugre"]


@dataclass(frozen=True)
class FrictionKeys:
    """Fields of a record that a law reads, beside viscous friction and offset.

    Attributes:
        own: keys that only this law has, without their unit, and the dimension of each; it needs all of them.
        dry: Coulomb's and Stribeck's levels: "allowed", "needed" (Coulomb's, above 0), or "none".
        linear: those of `own` in which friction is linear: columns of `regressor_drive`.
        smoothed: whether it needs a smoothing speed; others take sgn q̇ without one.
    """

    own: tuple[tuple[str, Dimension], ...] = ()
    dry: Literal["allowed", "needed", "none"] = "allowed"
    linear: tuple[str, ...] = ()
    smoothed: bool = False


LAWS: dict[LawName, FrictionKeys] = {
    "coulomb": FrictionKeys(),
    "sigmoid": FrictionKeys(
        (("sigmoid_amplitude", "torque"), ("sigmoid_slope", "slope"), ("sigmoid_shift", "speed")),
        dry="none",
        linear=("sigmoid_amplitude",),
    ),
    "lugre": FrictionKeys((("bristle_stiffness", "stiffness"), ("bristle_damping", "damping")), dry="needed"),
}
VISCOUS_FALL = "viscous_fall_k"
VISCOUS_SLOPE, COULOMB_SLOPE = "viscous_temperature_coefficient_per_k", "coulomb_temperature_coefficient_per_k"
BY_TEMPERATURE = (VISCOUS_FALL, VISCOUS_SLOPE, COULOMB_SLOPE)  # keys that count where the motor's temperature is known
SmoothingSpeed = Annotated[
    Quantity,
    Reading(
        "a number above 0, or no such key: friction then sticks in simulation", one_number, lambda v: v > 0, (0.0, inf)
    ),
]
SMOOTHING = (
    "Speed over which dry friction and gear loss change their sign; it limits the step. Absent: in simulation they hold a joint "
    "at rest, and kernels take the sign of the speed."
)
LINEAR = tuple(  # law and place of every parameter of its own in which friction is linear
    (name, place) for name, law in LAWS.items() for place, (stem, _) in enumerate(law.own) if stem in law.linear
)


def check_smoothing(smoothing: Any) -> None:
    """Refuses a reader's argument that is no smoothing speed, and not None.

    Raises:
        DescriptionError: names the argument and its value.
    """
    if smoothing is not None and not (isinstance(smoothing, (int, float)) and 0 < smoothing < inf):
        expected = "a speed above 0 [rad/s | m/s], or none: friction then sticks in simulation"
        raise DescriptionError(place="smoothing", value=smoothing, expected=expected)


def check_friction(friction: Any) -> None:
    """Refuses a record of friction whose keys do not go together, by the keys of its `units`.

    Raises:
        Invalid: names the key and what it needs.
    """
    key_of = friction.units.key
    present = {key for key in type(friction).model_fields if getattr(friction, key) is not None}
    coulomb = [key_of(f"coulomb_{side}", "torque") for side in ("positive", "negative")]
    stribeck = [key_of("stribeck_torque", "torque"), key_of("stribeck_speed", "speed")]
    check_together(friction, *coulomb)
    check_together(friction, *stribeck)
    law = LAWS[friction.law]
    smoothing = [key_of("smoothing", "speed")] if law.smoothed else []
    needed = [*(key_of(*key) for key in law.own), *(coulomb if law.dry == "needed" else []), *smoothing]
    missing = [key for key in needed if key not in present]
    if missing:
        raise Invalid(f"needs {' and '.join(missing)}", place="law", value=friction.law)
    for key in coulomb:
        if law.dry == "needed" and getattr(friction, key).value == 0:
            raise Invalid(
                place=key, value=0.0, expected=f'a level above 0 with law = "{friction.law}", at which it slips'
            )
    for name, other in LAWS.items():
        foreign = [key for key in (key_of(*key) for key in other.own) if key in present and key not in needed]
        if foreign:
            raise Invalid(f'needs law = "{name}"', place=foreign[0])
    if "load_coefficient" in present and coulomb[0] not in present:
        raise Invalid(f"needs {coulomb[0]} and {coulomb[1]}, which rise with the load", place="load_coefficient")
    for key, needs in ((VISCOUS_FALL, "falls"), (VISCOUS_SLOPE, "changes")):
        if key in present and key_of("viscous", "damping") not in present:
            raise Invalid(f"needs viscous friction, which {needs}", place=key)
    if VISCOUS_FALL in present and VISCOUS_SLOPE in present:
        raise Invalid(f"goes without {VISCOUS_FALL}", place=VISCOUS_SLOPE)
    if COULOMB_SLOPE in present and coulomb[0] not in present:
        raise Invalid(f"needs {coulomb[0]} and {coulomb[1]}, which change", place=COULOMB_SLOPE)
    dry = [key for key in (*coulomb, *stribeck) if key in present]
    if dry and law.dry == "none":
        raise Invalid(f'does not go with law = "{friction.law}"', place=dry[0])
    if stribeck[0] in present and coulomb[0] not in present:
        raise Invalid(f"needs {coulomb[0]} and {coulomb[1]} beside it", place=stribeck[0])

"""Drive of a joint: motor and gear, friction, limits. Plain records; the equations are in `actuators`."""

from __future__ import annotations

from dataclasses import dataclass
from inspect import cleandoc
from math import sqrt
from textwrap import dedent
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field, create_model, model_validator

from armwright.description.friction import SMOOTHING, SmoothingSpeed, check_friction
from armwright.description.twins import twin_of
from armwright.friction_laws import LAWS
from armwright.joint_kinds import LINEAR, ROTARY, JointUnits
from armwright.lazy_schema import imported_later
from armwright.quantity import BelowOne, NotNegative, NotZero, Number, Positive, Range, Record, Share, optional
from armwright.validation import Invalid

if TYPE_CHECKING:
    from armwright.description.drive_effects import CoggingRecord, Coupling, GearEfficiencyTable, ThermalRecord
else:
    CoggingRecord, Coupling, GearEfficiencyTable, ThermalRecord = imported_later(
        "armwright.description.drive_effects", "CoggingRecord", "Coupling", "GearEfficiencyTable", "ThermalRecord"
    )

Command = Literal["voltage", "current", "torque", "position"]
COMMAND_NEEDS = {  # keys of [motor] without which a drive cannot follow its command
    "voltage": ("resistance_ohm", "torque_constant_n_m_per_a"),
    "current": ("torque_constant_n_m_per_a",),
    "torque": (),
    "position": ("torque_constant_n_m_per_a",),  # and, for an output that is a duty, the resistance
}
if TYPE_CHECKING:
    LawName = str
else:
    LawName = Literal[tuple(LAWS)]
Basis = Literal["dc", "phase_peak", "phase_rms", "line_peak", "line_rms"]


@dataclass(frozen=True)
class DcEquivalent:
    """Factors from the constants of a brushless motor to those of the DC motor that takes the same power. [Krishnan2010]

    Power in equals torque times speed plus heat. The equivalent's current is the peak of the phase current, so that
    v i = 3/2 v̂ î  asks for a voltage of 3/2 the phase peak: impedances and back-EMF constants of one phase count 3/2, line to
    line values are taken to one phase first.
    """

    torque_constant: float
    back_emf_constant: float
    impedance: float  # resistance and inductance
    voltage: float
    current: float


DC_EQUIVALENT = {
    "dc": DcEquivalent(1.0, 1.0, 1.0, 1.0, 1.0),
    "phase_peak": DcEquivalent(1.0, 1.5, 1.5, 1.5, 1.0),
    "phase_rms": DcEquivalent(1 / sqrt(2), 1.5 * sqrt(2), 1.5, 1.5 * sqrt(2), sqrt(2)),
    "line_peak": DcEquivalent(1.0, 1.5 / sqrt(3), 0.75, 1.5 / sqrt(3), 1.0),
    "line_rms": DcEquivalent(1 / sqrt(2), 1.5 * sqrt(2) / sqrt(3), 0.75, 1.5 * sqrt(2) / sqrt(3), sqrt(2)),
}


class Motor(Record):
    """A motor and its gear: θ_motor = gear_ratio · q. Electrical constants are DC-equivalent unless `basis` says otherwise."""

    source: str | None = None
    gear_ratio: NotZero = Field(description="Motor radians per joint radian (or metre); the sign counts.")
    rotor_inertia_kg_m2: NotNegative = Field(
        description="Motor side. 0 for a direct drive: the rotor is part of its link."
    )
    gear_efficiency: Share | None = optional(
        "η, the share of the power that passes; absent: 1. Below 0.5 a warning: a real gear holds its load by "
        "itself there, this one is driven back at η."
    )
    gear_efficiency_table: GearEfficiencyTable | None = optional("η by load and speed, instead of gear_efficiency.")
    torque_constant_n_m_per_a: Positive | None = optional("Kt: motor torque per ampere.")
    back_emf_constant_v_s_per_rad: Positive | None = optional("Absent: equal to the torque constant.")
    resistance_ohm: Positive | None = optional("R of the armature.")
    inductance_h: Positive | None = optional(
        "L of the armature. In the simulator the current is then a state; eq. (11) neglects it."
    )
    current_loop_hz: Positive | None = optional(
        "Bandwidth of the drive's current controller. Absent: it applies the voltage that gives the current "
        "in the end. Goes with inductance_h and a command of current or torque."
    )
    pwm: Literal["brake", "coast"] | None = optional(
        'What the bridge does while it is off: "brake" shorts the motor, "coast" opens it, and the back-EMF '
        "acts only while on. Absent: brake."
    )
    dead_zone_v: NotNegative | None = optional(
        "Commands of voltage within it, either way, give nothing, and all others that much less; absent: none."
    )
    thermal: ThermalRecord | None = optional("Absent: the motor stays as it was measured.")
    cogging: CoggingRecord | None = optional("Absent: none.")
    coupling: tuple[Coupling, ...] = Field(default=(), description="Other joints that turn this motor.")
    basis: Basis = Field(default="dc", description="How the electrical constants of a brushless motor were measured.")

    @model_validator(mode="after")
    def _torque_constant(self) -> Motor:
        electrical = ("resistance_ohm", "inductance_h", "back_emf_constant_v_s_per_rad")
        present = [key for key in electrical if getattr(self, key) is not None]
        if present and self.torque_constant_n_m_per_a is None:
            raise Invalid("needs torque_constant_n_m_per_a beside it", place=present[0])
        if self.gear_efficiency is not None and self.gear_efficiency_table is not None:
            raise Invalid("goes without gear_efficiency", place="gear_efficiency_table")
        if self.thermal is not None and self.resistance_ohm is None:
            raise Invalid("needs resistance_ohm, whose heat warms the winding", place="thermal")
        if self.inductance_h is not None and self.resistance_ohm is None:
            raise Invalid("needs resistance_ohm beside it", place="inductance_h")
        if self.current_loop_hz is not None and self.inductance_h is None:
            raise Invalid("needs inductance_h: without, the current follows at once", place="current_loop_hz")
        if self.pwm == "coast" and self.inductance_h is not None:
            what = "goes without inductance_h: its law is of a current that dies away in every period"
            raise Invalid(what, place="pwm", value="coast")
        return self


class _Friction(Record):
    units: ClassVar[JointUnits]

    @model_validator(mode="after")
    def _complete(self) -> Any:
        check_friction(self)
        return self


class _OfAllLaws(_Friction):
    units = ROTARY
    source: str | None = None
    side: Literal["joint", "motor"] = Field(
        default="joint",
        description="Whose friction it is: the joint's, or the motor's in motor radians, which is referred by n² and |n|.",
    )
    law: LawName = Field(default="coulomb", description="The equation above that holds.")
    viscous_n_m_s_per_rad: NotNegative | None = optional("Slope of the friction over the speed.")
    coulomb_positive_n_m: NotNegative | None = optional("Magnitude of the dry friction where q̇ > 0.")
    coulomb_negative_n_m: NotNegative | None = optional("Magnitude of the dry friction where q̇ < 0.")
    offset_n_m: Number | None = optional("A constant torque against positive motion, whichever way the joint moves.")
    stribeck_torque_n_m: NotNegative | None = optional("Magnitude at the beginning of motion, above Coulomb's.")
    stribeck_speed_rad_per_s: Positive | None = optional("Speed over which it falls to Coulomb's.")
    smoothing_rad_per_s: SmoothingSpeed | None = optional(SMOOTHING)


READINGS: dict[str, Any] = {"Number": Number, "NotNegative": NotNegative, "Positive": Positive}
_own: dict[str, Any] = {
    ROTARY.key(key.stem, key.dimension): (READINGS[key.takes] | None, optional(key.about))
    for law in LAWS.values()
    for key in law.own
}
_OfLaws = create_model("_OfLaws", __base__=_OfAllLaws, __module__=__name__, **_own)


class RotaryFriction(_OfLaws):
    """Friction torque against the speed of a revolute joint, or of any joint's motor (`side = "motor"`).

    With s = q̇ / √(q̇² + smoothing²), or s = sgn q̇ without a smoothing speed (at rest any s from -1 to 1 in the simulator, 0 in
    the kernels):
    {laws}
    With `side = "motor"` the motor's torques are referred by |n|, its viscous friction by n². Signs stay the joint's, also for
    n < 0: coulomb_positive is felt where q̇ > 0, though the motor then turns backwards; so with offset and sigmoid_shift.
    `load_coefficient` c adds c |torque| s: of the torque that leaves the gear, or of that which enters it with side = "motor".
    Temperature counts in the simulator only, by the warming ΔT = T - T_reference of the motor's housing, or winding:
    viscous · exp(-ΔT / viscous_fall_k), or viscous · max(0, 1 + viscous_temperature_coefficient ΔT), and coulomb and
    stribeck_torque · max(0, 1 + coulomb_temperature_coefficient ΔT). [BittencourtGunnarsson2012]
    """

    load_coefficient: BelowOne | None = optional(
        "What the dry friction gains of the torque through the gear; absent: nothing."
    )
    viscous_fall_k: Positive | None = optional(
        "Warming over which viscous falls to 1/e, from the motor's thermal.reference_c on; absent: constant."
    )
    viscous_temperature_coefficient_per_k: Number | None = optional(
        "Relative change of viscous per kelvin; instead of viscous_fall_k."
    )
    coulomb_temperature_coefficient_per_k: Number | None = optional(
        "Relative change of Coulomb's and Stribeck's levels per kelvin; absent: none."
    )


_equations = dedent("".join(law.equation for law in LAWS.values())).strip("\n")
RotaryFriction.__doc__ = cleandoc(RotaryFriction.__doc__ or "").replace("{laws}", _equations)


@twin_of(RotaryFriction)
class LinearFriction(_Friction):
    """Friction force against the speed of a prismatic joint: `RotaryFriction` in N and metres."""

    units = LINEAR
    source: str | None = None
    side: Literal["joint"] = Field(
        default="joint", description="A slide's own friction; its motor's is given in N m with side = 'motor'."
    )


class _Limits(Record):
    units: ClassVar[JointUnits]

    @model_validator(mode="after")
    def _ordered(self) -> Any:
        key = self.units.key("position", "position")
        position = getattr(self, key)
        if position is not None and not position.value[0] < position.value[1]:
            raise Invalid(place=key, value=position.value, expected="the lowest before the highest")
        return self


class RotaryLimits(_Limits):
    """Limits of a revolute joint and its drive. Absent: no limit is known."""

    units = ROTARY
    source: str | None = None
    position_rad: Range | None = optional("Range of the joint: [lowest, highest].")
    velocity_rad_per_s: Positive | None = optional("Largest speed of the joint, in either direction.")
    acceleration_rad_per_s2: Positive | None = optional("Largest acceleration of planned motions, in either direction.")
    torque_n_m: Positive | None = optional("Largest torque of the motor, referred to the joint, in either direction.")
    voltage_v: Positive | None = optional("Largest voltage of the drive, of either sign.")
    current_a: Positive | None = optional("Largest current of the drive, of either sign.")


@twin_of(RotaryLimits)
class LinearLimits(_Limits):
    """Limits of a prismatic joint and its drive. Absent: no limit is known."""

    units = LINEAR
    source: str | None = None

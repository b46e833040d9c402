"""Effects of a drive beyond equation (11): heat, cogging, coupled joints, elastic gears, stops, brakes, and the supply.

Rotary and linear, by their units. Few robots have them: `description.robot` imports this file when it meets one.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from armwright.description.twins import twin_of
from armwright.joint_kinds import LINEAR, ROTARY, JointKind, JointUnits
from armwright.quantity import (
    LEAST_RISE,
    NotNegative,
    NotPositive,
    NotZero,
    Number,
    Positive,
    Record,
    Rising,
    Shares,
    check_together,
    optional,
)
from armwright.validation import Invalid

STIFFENING = "κ of a harmonic drive that stiffens under load; absent: the spring is linear. Goes without play."
PLAY = "Width of the gap between the flanks in which nothing is transmitted; absent: none."
ERROR = "A, kinematic error of a harmonic drive, twice in a turn of the motor; absent: none. [TuttleSeering1996]"
SIDE = "Whose numbers these are: the joint's, or the motor's in motor radians, referred by n², |n| and 1/|n|."


class Coupling(Record):
    """A share of another joint in the motor's angle, as in wrists:  θ_motor = gear_ratio · q + Σ ratio · q_joint."""

    source: str | None = None
    joint: str = Field(min_length=1, description="The other joint.")
    ratio: NotZero = Field(description="Motor radians per radian (or metre) of that joint; the sign counts.")


class ThermalRecord(Record):
    """Temperatures of a motor of one body (its winding) or of two (winding and housing). [HendershotMiller2010]

    One body:    C_w Ṫ_w = heat - (T_w - ambient) / winding_resistance
    Two bodies:  C_w Ṫ_w = heat - (T_w - T_h) / winding_resistance,
                 C_h Ṫ_h = (T_w - T_h) / winding_resistance - (T_h - ambient) / housing_resistance
    heat = R i²,  R = resistance_ohm · (1 + resistance_temperature_coefficient (T_w - reference)),
    Kt and Ke = their constants · (1 + magnet_temperature_coefficient (T - reference)),
    T of the housing where there is one, else T_w.
    """

    source: str | None = None
    ambient_c: Number = Field(description="Temperature of the surroundings, and of the motor at the beginning.")
    reference_c: Number = Field(description="Temperature at which resistance and torque constant were measured.")
    winding_capacity_j_per_k: Positive = Field(description="Heat that warms the winding by one kelvin.")
    winding_resistance_k_per_w: Positive = Field(description="From the winding to the housing, or to the ambient.")
    housing_capacity_j_per_k: Positive | None = optional("Absent: one body.")
    housing_resistance_k_per_w: Positive | None = optional("From the housing to the ambient.")
    resistance_temperature_coefficient_per_k: NotNegative | None = optional(
        "Relative change of R per kelvin, 0.0039 for copper; absent: R is constant."
    )
    magnet_temperature_coefficient_per_k: NotPositive | None = optional(
        "Relative change of Kt and Ke per kelvin of the magnets, -0.0011 for NdFeB; absent: none."
    )

    @model_validator(mode="after")
    def _bodies(self) -> ThermalRecord:
        check_together(self, "housing_capacity_j_per_k", "housing_resistance_k_per_w")
        return self


class EfficiencyRow(Record):
    """Efficiencies of a gear at one speed, one for each torque of the table."""

    source: str | None = None
    speed_rad_per_s: NotNegative | None = optional(
        "Of a revolute joint, either way; absent: the table has one row, for all speeds."
    )
    speed_m_per_s: NotNegative | None = optional("Of a prismatic joint, likewise.")
    driving: Shares = Field(description="η where the motor drives.")
    driven_back: Shares | None = optional("η where the load drives; absent: as driving.")


class GearEfficiencyTable(Record):
    """Efficiency of a gear by the torque T that leaves it and by the joint's speed.

    At each T the gear is entered by t = T / η where the motor drives, by t = T η where it is driven back; between, T is
    linear in t. Beyond the ends of the table η is that of the end; by speed it is interpolated linearly. t must rise with T.
    """

    source: str | None = None
    torque_n_m: Rising | None = optional("T of a revolute joint, magnitudes.")
    force_n: Rising | None = optional("T of a prismatic joint, magnitudes.")
    rows: tuple[EfficiencyRow, ...] = Field(min_length=1, description="One a speed, in rising order.")

    @property
    def torque_key(self) -> Literal["torque_n_m", "force_n"]:
        """Key of the torques or forces."""
        return "force_n" if self.torque_n_m is None else "torque_n_m"

    @property
    def speed_key(self) -> Literal["speed_rad_per_s", "speed_m_per_s"]:
        """Key of the speeds in each row."""
        return "speed_m_per_s" if self.torque_n_m is None else "speed_rad_per_s"

    def check_units(self, place: str, kind: JointKind) -> None:
        """Refuses a table in N m on a joint that slides, or in N on one that turns.

        Raises:
            Invalid: names the key that is expected at that place.
        """
        wanted = "force_n" if kind.units.linear else "torque_n_m"
        if self.torque_key != wanted:
            raise Invalid(f"on a {kind.name} joint", place=f"{place}.{self.torque_key}", expected=wanted)

    @model_validator(mode="after")
    def _complete(self) -> GearEfficiencyTable:
        if (self.torque_n_m is None) == (self.force_n is None):
            raise Invalid(expected="either torque_n_m or force_n")
        torques = np.array(getattr(self, self.torque_key).value)
        for k, row in enumerate(self.rows):
            back = "driving" if row.driven_back is None else "driven_back"
            for key, driving in (("driving", True), (back, False)):
                self._check_row(torques, np.array(getattr(row, key).value), f"rows[{k}].{key}", driving)
        self._check_speeds()
        return self

    def _check_speeds(self) -> None:
        """Every one of several rows has a speed, above that of the row before."""
        (foreign,) = {"speed_rad_per_s", "speed_m_per_s"} - {self.speed_key}
        speeds = [getattr(row, self.speed_key) for row in self.rows]
        before, gap = -1.0, LEAST_RISE * max((speed.number for speed in speeds if speed is not None), default=0.0)
        for k, (row, speed) in enumerate(zip(self.rows, speeds, strict=True)):
            place = f"rows[{k}].{self.speed_key}"
            if getattr(row, foreign) is not None:
                raise Invalid(
                    f"does not go with {self.torque_key}", place=f"rows[{k}].{foreign}", expected=self.speed_key
                )
            if speed is None:
                if len(self.rows) > 1:
                    raise Invalid("missing", place=place, expected="a speed in each of several rows")
            elif speed.number <= before + gap:
                raise Invalid(place=place, value=speed.number, expected=f"more than {before:g}, that of the row before")
            else:
                before = speed.number

    @staticmethod
    def rises(torques: np.ndarray, shares: np.ndarray, driving: bool) -> np.ndarray:
        """True where what enters the gear rises from one torque to the next (k-1, …).

        Args:
            torques, shares: (k, …) out of the gear, and its efficiencies.   driving: whether the motor drives.
        """
        with np.errstate(over="ignore"):
            entering = torques / shares if driving else torques * shares
        return entering[1:] > entering[:-1] * (1.0 + LEAST_RISE)

    def _check_row(self, torques: np.ndarray, shares: np.ndarray, place: str, driving: bool) -> None:
        if len(shares) != len(torques):
            expected = f"{len(torques)} numbers, one for each of {self.torque_key}"
            raise Invalid(place=place, value=tuple(shares.tolist()), expected=expected)
        rises = self.rises(torques, shares, driving)
        if not rises.all():
            k = int(np.argmin(rises))
            a, b = (f"{torque:g}" for torque in torques[k : k + 2])
            what = f"the torque into the gear, {'T / η' if driving else 'T η'}, does not rise from {self.torque_key} {a} to {b}"
            expected = f"an efficiency that {'rises' if driving else 'falls'} by less than the torque grows"
            raise Invalid(what, place=place, value=tuple(shares[k : k + 2].tolist()), expected=expected)


class CoggingRecord(Record):
    """Torque of the magnets on the slots:  amplitude · sin(periods θ_motor + phase), added to Kt i. [HendershotMiller2010]"""

    source: str | None = None
    amplitude_n_m: Positive = Field(description="At the motor.")
    periods: Positive = Field(
        description="Of one turn of the motor: the least common multiple of slots and poles, or a multiple."
    )
    phase_rad: Number = Field(description="Of the sine at θ_motor = 0.")


class _Elasticity(Record):
    units: ClassVar[JointUnits]

    @model_validator(mode="after")
    def _complete(self) -> Any:
        cubic, gap = self.units.key("cubic", "cubic"), self.units.key("backlash", "position")
        if getattr(self, cubic) is not None and getattr(self, gap) is not None:
            raise Invalid(expected=f"{cubic} or {gap}, not both: a stiffening gear has no play")
        check_together(self, self.units.key("error", "position"), "error_phase_rad")
        return self


class RotaryElasticity(_Elasticity):
    """A gear that gives way between motor and joint: both positions are states of the simulator. [Spong1987]

    δ = θ_motor / n + A sin(2 θ_motor + phase) - q,  torque = k δ' + κ δ'³ + d δ̇,
    δ' = δ less the play: 0 within ± backlash/2, where nothing is transmitted; flanks never pull. [NordinGutman2002]
    """

    units = ROTARY
    source: str | None = None
    stiffness_n_m_per_rad: Positive = Field(description="k, at the joint.")
    damping_n_m_s_per_rad: NotNegative = Field(description="d, at the joint.")
    cubic_n_m_per_rad3: Positive | None = optional(STIFFENING)
    backlash_rad: Positive | None = optional(PLAY)
    error_rad: Positive | None = optional(ERROR)
    error_phase_rad: Number | None = optional("Phase of that error at θ_motor = 0.")


@twin_of(RotaryElasticity, "error_phase_rad")
class LinearElasticity(_Elasticity):
    """`RotaryElasticity` of a prismatic joint, in N and metres."""

    units = LINEAR
    source: str | None = None


class RotaryStops(Record):
    """End stops at limits.position_rad, springs with dampers that only push:  torque = max(0, k p + d ṗ), p > 0 how far in."""

    source: str | None = None
    stiffness_n_m_per_rad: Positive = Field(description="k.")
    damping_n_m_s_per_rad: NotNegative = Field(description="d.")


@twin_of(RotaryStops)
class LinearStops(Record):
    """End stops at limits.position_m, springs with dampers that only push:  force = max(0, k p + d ṗ), p > 0 how far in."""

    source: str | None = None


class _Brake(Record):
    units: ClassVar[JointUnits]

    @model_validator(mode="after")
    def _check(self) -> Any:
        stiffness, damping = self.units.key("stiffness", "stiffness"), self.units.key("damping", "damping")
        check_together(self, stiffness, damping, "release_time_s")
        return self


class RotaryBrake(_Brake):
    """A holding brake, which the simulator applies and releases. [Dahl1968]

    With a stiffness it gives way like a spring until it slips: torque = k z + d ż,  ż = q̇ - k |q̇| / holding_torque z while
    applied; torque = k z,  ż = -z / release_time while released.
    Without one it is rigid: any torque up to holding_torque at rest, at once.
    """

    units = ROTARY
    source: str | None = None
    side: Literal["joint", "motor"] = Field(default="joint", description=SIDE)
    holding_torque_n_m: Positive = Field(description="Beyond which it slips.")
    stiffness_n_m_per_rad: Positive | None = optional("k, of its hub and lining; absent: rigid.")
    damping_n_m_s_per_rad: NotNegative | None = optional("d.")
    release_time_s: Positive | None = optional("Over which its torque dies away when it is released.")


@twin_of(RotaryBrake)
class LinearBrake(_Brake):
    """`RotaryBrake` on a slide itself, in N and metres; one on its motor has N m and side = "motor"."""

    units = LINEAR
    source: str | None = None
    side: Literal["joint"] = Field(default="joint", description="The slide itself.")


SlideBrake = LinearBrake | RotaryBrake  # of a prismatic joint: on the slide, or on its motor


class SupplyRecord(Record):
    """A rectifier behind a source resistance, the capacitor of the bus, and a brake chopper. The bus voltage V is a state.

    C V̇ = max(0, voltage - V) / source_resistance - Σ P / V - chopper_share · V / chopper_resistance + I_diodes,
    P the electrical power of each drive; the rectifier takes nothing back, and diodes of the drives keep V ≥ 0.
    chopper_share = 0 below chopper_voltage, 1 above chopper_voltage + chopper_band, linear between.
    """

    source: str | None = None
    voltage_v: Positive = Field(description="Without load; the bus begins with it.")
    source_resistance_ohm: Positive = Field(description="Of mains, transformer and rectifier together.")
    capacitance_f: Positive = Field(description="C of the bus.")
    chopper_voltage_v: Positive | None = optional("At which braking begins; absent: no chopper.")
    chopper_band_v: Positive | None = optional("Over which the chopper goes from 0 to all.")
    chopper_resistance_ohm: Positive | None = optional("Of the braking resistor.")

    @model_validator(mode="after")
    def _complete(self) -> SupplyRecord:
        check_together(self, "chopper_voltage_v", "chopper_band_v", "chopper_resistance_ohm")
        if self.chopper_voltage_v is not None and float(self.chopper_voltage_v) <= float(self.voltage_v):
            expected = "more than voltage_v, or the source feeds the braking resistor"
            raise Invalid(place="chopper_voltage_v", value=self.chopper_voltage_v.value, expected=expected)
        return self

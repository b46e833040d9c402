"""What gives way or holds at a joint: an elastic gear with play, end stops, a brake. Rotary and linear, by their units."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, model_validator

from armwright.quantity import NotNegative, Number, Positive, Record

STIFFENING = "κ of a harmonic drive that stiffens under load; absent: the spring is linear. Goes without play."
PLAY = "Width of the gap between the flanks in which nothing is transmitted; absent: none."
ERROR = "A, kinematic error of a harmonic drive, twice in a turn of the motor; absent: none. [TuttleSeering1996]"
SIDE = "Whose numbers these are: the joint's, or the motor's in motor radians, referred by n², |n| and 1/|n|."


class RotaryElasticity(Record):
    """A gear that gives way between motor and joint: both positions are states of the simulator. [Spong1987]

    δ = θ_motor / n + A sin(2 θ_motor + phase) - q,  torque = k δ' + κ δ'³ + d δ̇,
    δ' = δ less the play: 0 within ± backlash/2, where nothing is transmitted; flanks never pull. [NordinGutman2002]
    """

    source: str | None = None
    stiffness_n_m_per_rad: Positive = Field(description="k, at the joint.")
    damping_n_m_s_per_rad: NotNegative = Field(description="d, at the joint.")
    cubic_n_m_per_rad3: Positive | None = Field(default=None, description=STIFFENING)
    backlash_rad: Positive | None = Field(default=None, description=PLAY)
    error_rad: Positive | None = Field(default=None, description=ERROR)
    error_phase_rad: Number | None = Field(default=None, description="Phase of that error at θ_motor = 0.")

    @model_validator(mode="after")
    def _complete(self) -> RotaryElasticity:
        return _checked_elasticity(self, "rad", "n_m")


class LinearElasticity(Record):
    """`RotaryElasticity` of a prismatic joint, in N and metres."""

    source: str | None = None
    stiffness_n_per_m: Positive = Field(description="k, at the joint.")
    damping_n_s_per_m: NotNegative = Field(description="d, at the joint.")
    cubic_n_per_m3: Positive | None = Field(default=None, description=STIFFENING)
    backlash_m: Positive | None = Field(default=None, description=PLAY)
    error_m: Positive | None = Field(default=None, description=ERROR)
    error_phase_rad: Number | None = Field(default=None, description="Phase of that error at θ_motor = 0.")

    @model_validator(mode="after")
    def _complete(self) -> LinearElasticity:
        return _checked_elasticity(self, "m", "n")


def _checked_elasticity(given: Any, length: str, force: str) -> Any:
    cubic, gap = getattr(given, f"cubic_{force}_per_{length}3"), getattr(given, f"backlash_{length}")
    if cubic is not None and gap is not None:
        raise ValueError(
            f"expected cubic_{force}_per_{length}3 or backlash_{length}, not both: a stiffening gear has no play"
        )
    if (getattr(given, f"error_{length}") is None) != (given.error_phase_rad is None):
        raise ValueError(f"expected error_{length} and error_phase_rad together")
    return given


class RotaryStops(Record):
    """End stops at limits.position_rad, springs with dampers that only push:  torque = max(0, k p + d ṗ), p > 0 how far in."""

    source: str | None = None
    stiffness_n_m_per_rad: Positive = Field(description="k.")
    damping_n_m_s_per_rad: NotNegative = Field(description="d.")


class LinearStops(Record):
    """End stops at limits.position_m, springs with dampers that only push:  force = max(0, k p + d ṗ), p > 0 how far in."""

    source: str | None = None
    stiffness_n_per_m: Positive = Field(description="k.")
    damping_n_s_per_m: NotNegative = Field(description="d.")


class RotaryBrake(Record):
    """A holding brake, told by the simulator when it is applied: it gives way like a spring until it slips. [Dahl1968]

    torque = k z + d ż,  ż = q̇ - k |q̇| / holding_torque z while applied, ż = -z / release_time while released.
    """

    source: str | None = None
    side: Literal["joint", "motor"] = Field(default="joint", description=SIDE)
    holding_torque_n_m: Positive = Field(description="Beyond which it slips.")
    stiffness_n_m_per_rad: Positive = Field(description="k, of its hub and lining.")
    damping_n_m_s_per_rad: NotNegative = Field(description="d.")
    release_time_s: Positive = Field(description="Over which its torque dies away when it is released.")


class LinearBrake(Record):
    """`RotaryBrake` on a slide itself, in N and metres; one on its motor is told in N m with side = "motor"."""

    source: str | None = None
    side: Literal["joint"] = Field(default="joint", description="The slide itself.")
    holding_force_n: Positive = Field(description="Beyond which it slips.")
    stiffness_n_per_m: Positive = Field(description="k, of its lining.")
    damping_n_s_per_m: NotNegative = Field(description="d.")
    release_time_s: Positive = Field(description="Over which its force dies away when it is released.")


SlideBrake = LinearBrake | RotaryBrake  # of a prismatic joint: on the slide, or on its motor

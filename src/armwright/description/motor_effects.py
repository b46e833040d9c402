"""What a motor does beside equation (11): it warms, it cogs, and its shaft may turn more joints than its own."""

from __future__ import annotations

from pydantic import Field, model_validator

from armwright.quantity import NotNegative, NotPositive, NotZero, Number, Positive, Record


class Coupling(Record):
    """A share of another joint in the motor's angle, as in wrists:  θ_motor = gear_ratio · q + Σ ratio · q_joint."""

    source: str | None = None
    joint: str = Field(min_length=1, description="The other joint.")
    ratio: NotZero = Field(description="Motor radians per radian (or metre) of that joint; the sign counts.")


class Thermal(Record):
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
    housing_capacity_j_per_k: Positive | None = Field(default=None, description="Absent: one body.")
    housing_resistance_k_per_w: Positive | None = Field(default=None, description="From the housing to the ambient.")
    resistance_temperature_coefficient_per_k: NotNegative | None = Field(
        default=None, description="Relative change of R per kelvin, 0.0039 for copper; absent: R is constant."
    )
    magnet_temperature_coefficient_per_k: NotPositive | None = Field(
        default=None,
        description="Relative change of Kt and Ke per kelvin of the magnets, -0.0011 for NdFeB; absent: none.",
    )

    @model_validator(mode="after")
    def _bodies(self) -> Thermal:
        given = [self.housing_capacity_j_per_k is not None, self.housing_resistance_k_per_w is not None]
        if any(given) and not all(given):
            has, needs = ("capacity_j_per_k", "resistance_k_per_w")[:: 1 if given[0] else -1]
            raise ValueError(f"housing_{has} needs housing_{needs} beside it")
        return self


class Cogging(Record):
    """Torque of the magnets on the slots:  amplitude · sin(periods θ_motor + phase), added to Kt i. [HendershotMiller2010]"""

    source: str | None = None
    amplitude_n_m: Positive = Field(description="At the motor.")
    periods: Positive = Field(
        description="Of one turn of the motor: the least common multiple of slots and poles, or a multiple."
    )
    phase_rad: Number = Field(description="Of the sine at θ_motor = 0.")

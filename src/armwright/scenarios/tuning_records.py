"""Table [tuning] of a scenario file: the gains to search, the uncertain arms, and the objective."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from armwright.quantity import Record, optional
from armwright.scenarios.value_records import LaneValues, Number, Whole, counted
from armwright.validation import Invalid

Ends = tuple[Number | tuple[Number, ...], Number | tuple[Number, ...]]


def _factor_or_ends(value: Any) -> Any:
    """Refuses what is neither a factor nor two ends, in words."""
    if isinstance(value, bool) or not (
        isinstance(value, (int, float)) or (isinstance(value, list) and len(value) == 2)
    ):
        raise ValueError("expected a factor above 1, or [lowest, highest], each one number or one per joint")
    return value


Gain = Annotated[Number | Ends, BeforeValidator(_factor_or_ends)]
Weight = Annotated[Whole | Number, Field(ge=0)]
START = Literal["scenario", "analytic", "pole-placement", "symmetric-optimum", "loop-shaping", "lqr"]


class DrawsTable(Record):
    """Differences between the lanes of a tuning, beside [lanes]; absent fields do not vary."""

    mass: Number | None = optional("Share by which each link's mass differs, evenly.", gt=0, lt=1)
    friction: Number | None = optional("Factor either way of each joint's friction, evenly in its logarithm.", gt=1)
    record: bool = Field(
        default=False, description="Numbers whose standard deviation the robot file gives are drawn by it, motors' too."
    )
    poses: Number | None = optional(
        "How far start and reference are moved together either way [rad | m], within limits.", gt=0
    )
    payload_kg: Annotated[tuple[Number, Number], counted(2, "the least and the most")] | None = optional(
        "Point mass at the tip, from the least to the most."
    )
    jitter_s: Number | None = optional("The most that any command is late, in place of loop's.", gt=0)
    delay_s: Number | None = optional("The most that commands of a lane are late beyond the loop's.", gt=0)
    vary: dict[str, LaneValues] = Field(
        default_factory=dict,
        description="Numbers of the robot file by name, drawn: 'link6.mass_kg' = { uniform = [1, 2] }.",
    )

    @model_validator(mode="after")
    def _complete(self) -> DrawsTable:
        if self.payload_kg is not None and not 0.0 <= self.payload_kg[0] < self.payload_kg[1]:
            raise ValueError(f"payload_kg = {list(self.payload_kg)}: expected 0 or more, and then a larger mass")
        for name, values in self.vary.items():
            if not values.drawn:
                raise ValueError(f"vary.{name}: expected normal, uniform or lognormal")
        return self


class TuningTable(Record):
    """Search for gains by `armwright tune`; see `aw.tuning.tune`. Options of the command line come first."""

    start: START = Field(
        default="scenario",
        description="Gains to start from: the scenario's own; 'analytic' designs them, a cascade's by the symmetric optimum, "
        "others by pole placement; or the method by its name.",
    )
    gains: dict[str, Gain] | None = optional(
        "Factor to either side of the start, or [lowest, highest], each one number or one per joint; absent: all "
        "whose names end in kp, ki or kd, within a factor of 10."
    )
    objectives: dict[str, Weight] = Field(
        default={"rms_error": 1.0, "saturation": 1.0},
        description="Weights of reducers, of noise_gain and of sensitivity.",
    )
    limits: dict[str, Number | tuple[Number, ...]] = Field(
        default_factory=dict,
        description="What these should not go beyond, such as peak_torque = 40; one number or one per joint.",
    )
    improve_each: bool = Field(default=False, description="No objective may get worse than at the start.")
    over: Literal["mean", "worst"] = Field(default="mean", description="Of the lanes.")
    gain_margin: Number = Field(default=2.0, description="Factor either way that any one command bears.")
    phase_margin_rad: Number = Field(default=math.radians(30.0), description="Phase lag that any one command bears.")
    poses: Whole = Field(
        default=2000, ge=1, description="Drawn within the position limits; the margins hold where they are extreme."
    )
    draws: DrawsTable | None = optional(
        "What differs between the lanes; absent: the scenario's lanes, and of a single run mass = 0.3, friction = 2 "
        "and record = true."
    )
    lanes: Whole = Field(
        default=64, ge=1, description="Of a scenario that has one; every second lane judges the result."
    )
    method: Literal["cma", "differential-evolution"] = Field(default="cma", description="Of the search.")
    generations: Whole = Field(default=30, ge=1, description="Of the search.")
    candidates: Whole | None = optional("In a generation; absent: 4 + 3 ln of the gains, 8 at least.", ge=4)
    front: Whole = Field(
        default=0,
        ge=0,
        description="Further searches with other weights of the first two objectives, for the Pareto front.",
    )
    seed: Whole = Field(default=0, ge=0, description="Of the search, the poses and the draws.")

    @field_validator("gain_margin")
    @classmethod
    def _is_factor(cls, value: float) -> float:
        if not 1.0 <= value < math.inf:
            raise Invalid(value=value, expected="a factor of 1 or more")
        return value

    @field_validator("phase_margin_rad")
    @classmethod
    def _is_angle(cls, value: float) -> float:
        if not 0.0 <= value < math.pi:
            in_degrees = f"; {value:g}° is {math.radians(value):.4g}" if math.pi <= value < 180.0 else ""
            raise Invalid(value=value, expected=f"an angle from 0 to below π [rad]{in_degrees}")
        return value

    def asked(self) -> dict[str, object]:
        """Values of the file by name as `aw.tuning.tune` calls them; only those that it states."""
        return {name.removesuffix("_rad"): getattr(self, name) for name in self.model_fields_set}

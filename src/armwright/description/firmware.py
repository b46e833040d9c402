"""The position loop inside a servo, which its drive runs by itself: `command = "position"`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from armwright.quantity import NotNegative, Positive, Range, Record, check_together, optional
from armwright.validation import Invalid

PERIODS = (1e-5, 1.0)  # [s] of servos' loops: a shorter one would take minutes to simulate
MOST_LATENCY = 8  # periods: each holds an output of its own
WHOLE = 1e-9


def _is_whole(value: float) -> bool:
    return abs(value - round(value)) <= WHOLE


class FirmwareRecord(Record):
    """The loop by which a servo follows its goal, every `period_s`. P, I and D are those of its registers.

    The goal g moves towards the commanded one within `goal_range_rad`, at most at `goal_speed_rad_per_s` and with
    `goal_acceleration_rad_per_s2`; goal and position are read in counts, c = 2π / counts_per_turn:
    e = c (round(g / c) - round(q / c)), and 0 within the dead band,
    output = p p_scale e + i i_scale ∫ e dt + d d_scale ė, within ± output_limit; ∫ e dt stays where i i_scale ∫ e dt alone would
    pass it. The output is a duty, of the voltage of the supply, or a current, within the limits of the drive. It is in force
    `latency_periods` later, until the next one.
    """

    source: str | None = None
    period_s: Positive = Field(
        description="From one turn of the loop to the next. Joints' are multiples of the shortest."
    )
    counts_per_turn: Positive | None = optional("Of the encoder behind the gear, and of goals; absent: both are exact.")
    output: Literal["duty", "current"] = Field(
        default="duty", description="What the loop gives: a share of the supply's voltage, or a current."
    )
    output_limit: Positive = Field(description="The most that it gives, either way: a duty of at most 1, or [A].")
    p: NotNegative = Field(description="P of the register.")
    p_scale_per_rad: Positive = Field(description="Output per radian and unit of P.")
    i: NotNegative | None = optional("I of the register; absent: 0.")
    i_scale_per_rad_s: Positive | None = optional("Output per radian, second and unit of I.")
    d: NotNegative | None = optional("D of the register; absent: 0.")
    d_scale_s_per_rad: Positive | None = optional("Output per radian per second and unit of D.")
    dead_band_counts: NotNegative | None = optional("Errors within it, either way, count as 0; absent: none.")
    goal_speed_rad_per_s: Positive | None = optional("At which the goal moves; absent: it jumps.")
    goal_acceleration_rad_per_s2: Positive | None = optional("With which it does; absent: at once at its speed.")
    goal_range_rad: Range | None = optional("Goals beyond it are those of its ends; absent: all are followed.")
    latency_periods: NotNegative | None = optional("From reading the encoder to the output; absent: none.")

    @model_validator(mode="after")
    def _fits(self) -> FirmwareRecord:
        period = float(self.period_s)
        if not PERIODS[0] <= period <= PERIODS[1]:
            raise Invalid(place="period_s", value=period, expected="from {:g} to {:g} s".format(*PERIODS))
        if self.dead_band_counts is not None and self.counts_per_turn is None:
            raise Invalid("needs counts_per_turn beside it", place="dead_band_counts")
        check_together(self, "i", "i_scale_per_rad_s")
        check_together(self, "d", "d_scale_s_per_rad")
        if self.goal_acceleration_rad_per_s2 is not None and self.goal_speed_rad_per_s is None:
            raise Invalid("needs goal_speed_rad_per_s beside it", place="goal_acceleration_rad_per_s2")
        if self.output == "duty" and float(self.output_limit) > 1.0:
            raise Invalid(place="output_limit", value=float(self.output_limit), expected="a duty of at most 1")
        latency = 0.0 if self.latency_periods is None else float(self.latency_periods)
        if not _is_whole(latency) or latency > MOST_LATENCY:
            raise Invalid(
                place="latency_periods", value=latency, expected=f"a whole number of periods, at most {MOST_LATENCY}"
            )
        if self.goal_range_rad is not None:
            low, high = self.goal_range_rad.numbers
            if not low < high:
                raise Invalid(place="goal_range_rad", value=(low, high), expected="the lowest before the highest")
        return self

"""Springs of an arm: at a joint, and between two links as a gas spring or a counterbalance cylinder.

Few robots have them: `description.robot` imports this file when it meets one. The equations are in `actuators.springs`.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import Field, model_validator

from armwright.description.robot import FileName
from armwright.description.twins import twin_of
from armwright.joint_kinds import LINEAR, ROTARY, JointUnits
from armwright.quantity import (
    Increasing,
    NotNegative,
    Number,
    Numbers,
    Positive,
    Record,
    Vector3,
    check_together,
    optional,
)
from armwright.validation import Invalid

OUTSIDE = 'Beyond the table\'s ends: "constant", the value there; "linear", the slope there. Goes with the table.'


class _Spring(Record):
    units: ClassVar[JointUnits]

    @model_validator(mode="after")
    def _complete(self) -> Any:
        stiffness, rest = self.units.key("stiffness", "stiffness"), self.units.key("rest", "position")
        positions, values = self.units.key("positions", "position"), self.units.key("torques", "torque")
        table, line = (positions, values, "outside"), (stiffness, rest, self.units.key("preload", "torque"))
        present = [key for key in (*line, *table) if getattr(self, key) is not None]
        if not present or (set(present) & set(line) and set(present) & set(table)):
            raise Invalid(expected=f"{stiffness} and {rest}, or a table: {', '.join(table)}")
        if present[0] in line:
            if missing := [key for key in (stiffness, rest) if key not in present]:
                raise Invalid(f"needs {' and '.join(missing)} beside it", place=present[0])
            return self
        check_together(self, *table)
        count, given = len(getattr(self, positions).value), getattr(self, values).value
        if len(given) != count:
            raise Invalid(place=values, value=given, expected=f"{count} numbers, as in {positions}")
        return self


class RotarySpringRecord(_Spring):
    """A spring at a revolute joint, on the link's side of the gear. A torque above 0 drives the joint forward, as a motor's does.

    Linear:  torque = preload - stiffness (q - rest).
    By table: straight lines between the points (positions, torques); the slope jumps at the points. [DeBoor1978]
    """

    units = ROTARY
    source: str | None = None
    stiffness_n_m_per_rad: NotNegative | None = optional("k of a linear spring.")
    rest_rad: Number | None = optional("Where a linear spring has its preload.")
    preload_n_m: Number | None = optional("Torque at rest_rad; absent: 0. With a stiffness of 0 a constant torque.")
    positions_rad: Increasing | None = optional("Points of a table, in place of a stiffness.")
    torques_n_m: Numbers | None = optional("As many.")
    outside: Literal["constant", "linear"] | None = optional(OUTSIDE)


@twin_of(RotarySpringRecord)
class LinearSpringRecord(_Spring):
    """`RotarySpringRecord` of a prismatic joint, in N and metres."""

    units = LINEAR
    source: str | None = None


class CylinderRecord(Record):
    """A gas spring, or a counterbalance cylinder with springs: a force along the line between two anchor points.

    force = force_n - stiffness (distance - length_m), distance that of the anchors; above 0 it pushes them apart.
    Its mass and its damping are not in it.
    """

    source: str | None = None
    name: FileName = Field(description="What errors and parameters call it.")
    link_a: FileName = Field(description="The link (or the base) that carries one end.")
    anchor_a_m: Vector3 = Field(description="That end, in the link's frame.")
    link_b: FileName = Field(
        description="The link (or the base) that carries the other end; it moves with respect to link_a."
    )
    anchor_b_m: Vector3 = Field(description="That end, in the link's frame.")
    force_n: Number = Field(description="At length_m; above 0 it pushes, as a gas spring does, below 0 it pulls.")
    length_m: Positive = Field(description="Distance of the anchors at which it has that force.")
    stiffness_n_per_m: NotNegative = Field(description="What a push loses, and a pull gains, by a metre of distance.")

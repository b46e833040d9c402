"""Joints that follow others, as fingers do: q = multiplier · q_master + offset. What they may have, and whom they may follow."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from armwright.errors import nearest
from armwright.quantity import NotZero, Number, Record

MASTER = "The joint that it follows; that may follow another in turn."
MULTIPLIER = "How far it moves by the master's 1 rad or m, in its own unit."
OF_A_DRIVE = (
    "command",
    "bus_period_s",
    "elasticity",
    "stops",
    "brake",
)  # what follows has no drive, and no ends of its own
OF_A_MOTOR = (
    "gear_ratio",
    "rotor_inertia_kg_m2",
    "source",
    "basis",
)  # all that a motor which is only carried along shows
SIMULATED = ("load_coefficient", "viscous_fall_k")  # friction that needs a drive's states


class RotaryMimic(Record):
    """A revolute joint without a drive of its own:  q = multiplier · q_master + offset; torques go to the master, by power."""

    source: str | None = None
    joint: str = Field(min_length=1, description=MASTER)
    multiplier: NotZero = Field(description=MULTIPLIER)
    offset_rad: Number = Field(description="Where it stands while its master is at 0.")

    @property
    def offset(self) -> Any:
        """[rad]."""
        return self.offset_rad.number


class LinearMimic(Record):
    """`RotaryMimic` of a prismatic joint."""

    source: str | None = None
    joint: str = Field(min_length=1, description=MASTER)
    multiplier: NotZero = Field(description=MULTIPLIER)
    offset_m: Number = Field(description="Where it stands while its master is at 0.")

    @property
    def offset(self) -> Any:
        """[m]."""
        return self.offset_m.number


def check_mimics(robot: Any) -> None:
    """Refuses joints that follow nothing which moves, or themselves, or that have a drive of their own beside it.

    Args:
        robot: a RobotDescription.
    Raises:
        ValueError: names the joint and what is wrong.
    """
    moving = {joint.name: joint for joint in robot.joints if joint.type != "fixed"}
    following = {name: joint for name, joint in moving.items() if joint.mimic is not None}
    for name, joint in following.items():
        if joint.mimic.joint not in moving:
            told = nearest(joint.mimic.joint, [other for other in moving if other != name])
            raise ValueError(
                f"joint {name!r}: mimic.joint = {joint.mimic.joint!r} does not move or is not there; {told}"
            )
        seen, at = {name}, joint.mimic.joint
        while at in following:
            if at in seen:
                raise ValueError(
                    f"joint {name!r} follows itself by mimic: expected a chain that ends at a driven joint"
                )
            seen.add(at)
            at = following[at].mimic.joint
        _check_drive(joint)


def _check_drive(joint: Any) -> None:
    """A joint that follows may have friction and a rotor that is carried along, no more."""
    wrong = [key for key in OF_A_DRIVE if getattr(joint, key) is not None]
    motor, friction = joint.motor, joint.friction
    if motor is not None:
        fields = type(motor).model_fields
        wrong += [
            f"motor.{key}"
            for key in fields
            if key not in OF_A_MOTOR and getattr(motor, key) != fields[key].get_default(call_default_factory=True)
        ]
    if friction is not None:
        wrong += [f"friction.{key}" for key in SIMULATED if getattr(friction, key) is not None]
        wrong += ['friction.law = "lugre"'] if friction.law == "lugre" else []
    if wrong:
        raise ValueError(
            f"joint {joint.name!r} mimics {joint.mimic.joint!r} and has {wrong[0]}: expected no drive of its own, "
            "only friction and a motor's gear_ratio and rotor_inertia_kg_m2"
        )

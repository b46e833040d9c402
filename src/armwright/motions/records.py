"""Tables of a motion file, `*.motion.toml`. Limits are the record's where the file has none."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from armwright.quantity import Record
from armwright.scenarios.records import Number, PerJoint, Tensor, Three, counted

Seconds = Annotated[Number, Field(gt=0)]
Speed = Annotated[Number, Field(gt=0, le=1)]
Points = Annotated[tuple[tuple[Number, ...], ...], Field(min_length=1)]
SPEED = "1: as fast as the limits allow; 0.5: the same in twice the time."


class LimitsTable(Record):
    """Limits in place of the record's: one number for all joints, one each, or a table by joint."""

    position: Any = Field(
        default=None, description="One number to either side, or lower and upper of every joint [rad | m]."
    )
    velocity: PerJoint | None = Field(default=None, description="[rad/s | m/s].")
    acceleration: PerJoint | None = Field(default=None, description="[rad/s² | m/s²].")
    jerk: PerJoint | None = Field(default=None, description="[rad/s³ | m/s³].")
    torque: PerJoint | None = Field(default=None, description="Of the motors, referred to the joints [N m | N].")
    voltage: PerJoint | None = Field(default=None, description="Of the motors [V].")


class MoveSegment(Record):
    """A move to a pose, joints synchronised."""

    kind: Literal["move"] = Field(description="Which kind of segment.")
    goal: PerJoint = Field(description="Positions [rad | m], or a table by joint whose others stay.")
    curve: Literal["s_curve", "trapezoid", "quintic", "cubic", "minimum_jerk", "ruckig"] = Field(
        default="s_curve", description="Law of the move, as the classes of the same names."
    )
    goal_velocity: PerJoint | None = Field(
        default=None,
        description="Of minimum_jerk and ruckig, which may end moving; the next segment goes on from there.",
    )
    duration_s: Seconds | None = Field(default=None, description="Absent: as short as the limits allow.")
    speed: Speed = Field(default=1.0, description=SPEED)


class WaypointsSegment(Record):
    """A curve from where the arm is through waypoints; see `armwright.Waypoints`."""

    kind: Literal["waypoints"] = Field(description="Which kind of segment.")
    points: Points = Field(description="Waypoints [rad | m], the arm's own pose before them left away.")
    curve: Literal["cubic", "quintic", "parabolic"] = Field(default="cubic", description="Between the waypoints.")
    times_s: tuple[Number, ...] | None = Field(
        default=None, description="Of the waypoints, from the segment's beginning on; absent: by the limits."
    )
    duration_s: Seconds | None = Field(default=None, description="Absent: as short as the limits allow.")
    speed: Speed = Field(default=1.0, description=SPEED)


class DwellSegment(Record):
    """A pause."""

    kind: Literal["dwell"] = Field(description="Which kind of segment.")
    duration_s: Seconds = Field(description="How long the arm stands.")


class GripSegment(Record):
    """A body taken up at once, in place of what the hand held; it counts in torques from here on."""

    kind: Literal["grip"] = Field(description="Which kind of segment.")
    mass_kg: Annotated[Number, Field(gt=0)] = Field(description="Mass of the body.")
    com_m: Three = Field(description="Its centre of mass, in the frame.")
    inertia_kg_m2: Annotated[Tensor | tuple[Number, Number, Number], counted(3, "moments about x, y and z")] = Field(
        description="About its centre of mass, in the frame's axes: a table, or three principal moments."
    )
    frame: str | None = Field(default=None, description="Which carries it; absent: the tip.")


class ReleaseSegment(Record):
    """The hand is empty from here on."""

    kind: Literal["release"] = Field(description="Which kind of segment.")


Segment = Annotated[
    MoveSegment | WaypointsSegment | DwellSegment | GripSegment | ReleaseSegment, Field(discriminator="kind")
]


class MotionTable(Record):
    """A motion: segments one after the other, from a pose on."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    title: str | None = Field(default=None, description="One line for whoever reads the file.")
    robot: str = Field(description="A built-in arm, or a robot file beside this one.")
    start: PerJoint = Field(description="Positions at the beginning [rad | m], or a table by joint whose others are 0.")
    limits: LimitsTable = Field(default_factory=LimitsTable, description="In place of the record's.")
    segments: tuple[Segment, ...] = Field(min_length=1, description="One after the other.")

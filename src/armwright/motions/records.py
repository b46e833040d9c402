"""Records of a motion file, `*.motion.toml`. Limits are those of the robot file unless the motion file states its own."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from armwright.quantity import Record, optional
from armwright.scenarios.records import BodyTable, PerJoint, Three
from armwright.scenarios.value_records import NotNegative, Number, Positive
from armwright.validation import SEEN

Speed = Annotated[Number, Field(ge=1e-6, le=1)]
Points = Annotated[tuple[tuple[Number, ...], ...], Field(min_length=1)]
RIGHT_ANGLE = 1.5707963267948966  # [rad]
Pitch = Annotated[Number, Field(ge=-RIGHT_ANGLE, le=RIGHT_ANGLE)]
SPEED = "1: as fast as the limits allow; 0.5: the same in twice the time."


class LimitsTable(Record):
    """Limits in place of the record's: one number for all joints, one each, or a table by joint."""

    position: Any = optional("One number to either side, or lower and upper of every joint [rad | m].")
    velocity: PerJoint | None = optional("[rad/s | m/s].")
    acceleration: PerJoint | None = optional("[rad/s² | m/s²].")
    jerk: PerJoint | None = optional("[rad/s³ | m/s³]; not kept by parabolic blends and trapezoids.")
    torque: PerJoint | None = optional("Of the motors, referred to the joints [N m | N].")
    voltage: PerJoint | None = optional("Of the motors [V].")


class MoveSegment(Record):
    """A move to a pose, joints synchronised."""

    kind: Literal["move"] = Field(description="Which kind of segment.")
    goal: PerJoint = Field(description="Positions [rad | m], or a table by joint whose others stay.")
    curve: Literal["s_curve", "trapezoid", "quintic", "cubic", "minimum_jerk", "ruckig"] = Field(
        default="s_curve", description="Law of the move, as the classes of the same names."
    )
    goal_velocity: PerJoint | None = optional(
        "Of minimum_jerk and ruckig, which may end moving; the next segment goes on from there."
    )
    duration_s: Positive | None = optional("Absent: as short as the limits allow.")
    speed: Speed = Field(default=1.0, description=SPEED)


class WaypointsSegment(Record):
    """A curve from the present pose through waypoints; see `armwright.Waypoints`."""

    kind: Literal["waypoints"] = Field(description="Which kind of segment.")
    points: Points = Field(description="Waypoints [rad | m], the arm's own pose before them left away.")
    curve: Literal["fastest", "cubic", "quintic", "parabolic"] = Field(
        default="cubic",
        description="Between the waypoints. Of `fastest` accelerations may jump there as well, without a limit of jerk.",
    )
    times_s: tuple[Number, ...] | None = optional(
        "Of the waypoints, from the segment's beginning on; absent: by the limits."
    )
    duration_s: Positive | None = optional("Absent: as short as the limits allow.")
    speed: Speed = Field(default=1.0, description=SPEED)


class DwellSegment(Record):
    """A pause."""

    kind: Literal["dwell"] = Field(description="Which kind of segment.")
    duration_s: Positive = Field(description="How long the arm stands.")


class GripSegment(BodyTable):
    """A body picked up at once, in place of the present payload; torques include it from then on."""

    kind: Literal["grip"] = Field(description="Which kind of segment.")
    mass_kg: Positive = Field(description="Mass of the body.")


class ReleaseSegment(Record):
    """The payload put down."""

    kind: Literal["release"] = Field(description="Which kind of segment.")


class TimeOptimalSegment(Record):
    """A smooth path from the present pose through waypoints, as fast as the motors allow; see `aw.trajectories.time_optimal`."""

    kind: Literal["time_optimal"] = Field(description="Which kind of segment.")
    points: Points = Field(description="Waypoints [rad | m], the arm's own pose before them left away.")
    grid: Annotated[int, Field(ge=10, le=5_000)] = Field(default=500, description="Number of grid points, about.")


class EndPiece(Record):
    """A piece of the tool's path with an end."""

    to_m: Three = Field(description="x, y, z where it ends.")
    rpy_rad: Three | None = optional("Angles about fixed x, y, z there; absent: it does not turn.")
    direction: Three | None = optional("Of the axis that `aim` names there, in base axes.")
    pitch_rad: Pitch | None = optional("Of that axis there: its angle below the base's xy plane.")
    yaw_rad: Number | None = optional("Of that axis there: its angle about base z, 0 along base x.")


class LinePiece(EndPiece):
    """A straight line of the tool."""

    kind: Literal["line"] = Field(description="Which kind of piece.")


class ArcPiece(EndPiece):
    """An arc of a circle through a point."""

    kind: Literal["arc"] = Field(description="Which kind of piece.")
    through_m: Three = Field(description="x, y, z that it passes.")


class CirclePiece(Record):
    """An arc about a centre, perhaps of several turns."""

    kind: Literal["circle"] = Field(description="Which kind of piece.")
    centre_m: Three = Field(description="x, y, z of the centre.")
    normal: Three = Field(description="Axis; the angle counts by the right hand about it.")
    angle_rad: Number = Field(default=6.283185307179586, description="How far; absent: one turn.")
    turns: bool = Field(default=False, description="True: the tool turns with the path.")


class ToolSegment(Record):
    """The tool moved along lines and arcs at a constant speed; see `aw.trajectories.follow_path`."""

    kind: Literal["tool"] = Field(description="Which kind of segment.")
    path: Annotated[
        tuple[Annotated[LinePiece | ArcPiece | CirclePiece, Field(discriminator="kind")], ...], Field(min_length=1)
    ] = Field(description="Pieces, each from where the last one ends.")
    speed_m_per_s: Positive = Field(description="Of the tool.")
    acceleration_m_per_s2: Positive = Field(description="Of the tool.")
    slow: Literal["everywhere", "where needed"] = Field(
        default="everywhere", description="What is slower where the joints cannot follow at the tool's speed."
    )
    constant: bool = Field(
        default=False, description="true: refused rather than slower where the joints cannot follow."
    )
    blend_m: NotNegative = Field(default=0.0, description="Largest distance of rounded corners; 0: sharp.")
    angular_speed_rad_per_s: Positive | None = optional("Absent: no limit.")
    angular_acceleration_rad_per_s2: Positive | None = optional("Both are needed for turns in place.")
    origin: Literal["base", "start"] = Field(
        default="base",
        description="Where positions count from, in base axes: the base, or the tool where the segment begins.",
    )
    aim: str = Field(
        default="pose",
        description="What of the tool's pose must be met: pose, position, axis, pitch, yaw, …, as in `inverse_kinematics`.",
    )
    frame: str | None = optional("The frame that is led; absent: the tip.")


Segment = Annotated[
    MoveSegment | WaypointsSegment | TimeOptimalSegment | ToolSegment | DwellSegment | GripSegment | ReleaseSegment,
    Field(discriminator="kind"),
]


class PlaneTable(Record):
    """A floor or a wall, solid behind its plane."""

    kind: Literal["plane"] = Field(description="Which kind of obstacle.")
    point_m: Three = Field(description="Any point of the plane, in base axes.")
    normal: Three = Field(description="Out of the solid side.")
    name: Annotated[str, Field(pattern=SEEN)] = Field(default="plane", description="For messages.")


class BoxTable(Record):
    """A rectangular block."""

    kind: Literal["box"] = Field(description="Which kind of obstacle.")
    size_m: Three = Field(description="Along its x, y, z.")
    position_m: Three = Field(description="Of its middle, in base axes.")
    rpy_rad: Three = Field(default=(0.0, 0.0, 0.0), description="Its angles about fixed x, then y, then z.")
    name: Annotated[str, Field(pattern=SEEN)] = Field(default="box", description="For messages.")


class SphereTable(Record):
    """A ball."""

    kind: Literal["sphere"] = Field(description="Which kind of obstacle.")
    radius_m: Positive = Field(description="Its radius.")
    position_m: Three = Field(description="Of its middle, in base axes.")
    name: Annotated[str, Field(pattern=SEEN)] = Field(default="sphere", description="For messages.")


ObstacleTable = Annotated[PlaneTable | BoxTable | SphereTable, Field(discriminator="kind")]


class MotionTable(Record):
    """A motion: segments one after the other, from a start pose."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    title: str | None = optional("One line for whoever reads the file.")
    robot: str = Field(description="A built-in arm, or a robot file beside this one.")
    start: PerJoint = Field(description="Positions at the beginning [rad | m], or a table by joint whose others are 0.")
    limits: LimitsTable = Field(default_factory=LimitsTable, description="In place of the record's.")
    obstacles: tuple[ObstacleTable, ...] = Field(default=(), description="What stands around the arm.")
    clearance_m: NotNegative | None = optional(
        "Least distance of links from each other and from obstacles; absent: 0 with obstacles, else not checked."
    )
    link_radius_m: Positive | None = optional("Radius of links whose record has no shapes, for distances.")
    ignore: tuple[tuple[str, str], ...] = Field(
        default=(), description="Pairs of links whose distance does not count, as those of a wrist."
    )
    segments: tuple[Segment, ...] = Field(min_length=1, description="One after the other.")

"""The tables of a scenario file, `*.scenario.toml`. Everything that decides a run is in it; nothing physical is defaulted."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator

from armwright.quantity import Record
from armwright.scenarios.lanes import Lanes, Number, Whole, counted

PerJoint = Number | tuple[Number, ...] | dict[str, Number]
Wrench = Annotated[
    tuple[Number, Number, Number, Number, Number, Number] | str,
    counted(6, "fx, fy, fz in N, mx, my, mz in N m"),
]
Three = Annotated[tuple[Number, Number, Number], counted(3, "along x, y and z")]


class Initial(Record):
    """Where the arm begins: numbers in the order of the joints, or a table by their names (others are 0)."""

    q: PerJoint | None = Field(default=None, description="Positions [rad | m]; absent: 0.")
    qd: PerJoint | None = Field(default=None, description="Speeds [rad/s | m/s]; absent: 0.")
    command: PerJoint | None = Field(
        default=None,
        description="In force before the first tick, each in its joint's own unit; absent: what holds the arm.",
    )


class Drive(Record):
    """Commands over time, without a controller: one of these."""

    command: PerJoint | None = Field(default=None, description="Constant, each in its joint's own unit.")
    schedule: str | None = Field(
        default=None, description="CSV file: t in s and one column a joint, held from row to row."
    )

    @model_validator(mode="after")
    def _one(self) -> Drive:
        if (self.command is None) == (self.schedule is None):
            raise ValueError("expected either command or schedule")
        return self


class Kind(Record):
    """A table that names what it is, and gives its fields."""

    model_config = ConfigDict(frozen=True, extra="allow")

    kind: str = Field(description="Which one.")

    def fields(self) -> dict[str, Any]:
        """Everything but the kind."""
        return dict(self.model_extra or {})


class SensorsTable(Record):
    """What is measured, and how well; see `armwright.Sensors`. Absent: everything exactly."""

    counts: Number | tuple[Number, ...] | None = Field(
        default=None, description="Encoder counts in one turn; absent: not quantised."
    )
    side: Literal["motor", "link"] = Field(default="motor", description="Where the encoder sits.")
    velocity: str = Field(default="exact", description="exact, difference, filtered or observer.")
    cutoff_hz: Number | None = Field(default=None, description="Of the filter or observer.")
    position_noise: Number = Field(default=0.0, ge=0, description="Standard deviation [rad | m].")
    velocity_noise: Number = Field(default=0.0, ge=0, description="[rad/s | m/s].")
    current_noise: Number = Field(default=0.0, ge=0, description="[A].")


class ShapingTable(Record):
    """The command's way out of the controller; see `armwright.Shaping`. Absent: as it is."""

    limit: PerJoint | None = Field(default=None, description="The most that is commanded, either way.")
    rate: PerJoint | None = Field(default=None, description="How fast a command may change, per second.")
    resolution: PerJoint | None = Field(default=None, description="Its steps, of a DAC or a PWM.")


class TimingTable(Record):
    """When measurements are taken and commands act; see `armwright.Timing`. Absent: at once."""

    preset: str = Field(default="ideal", description="ideal, one-tick or sync.")
    measurement_delay_s: Number = Field(
        default=0.0, description="How old a measurement is when the controller sees it."
    )
    command_delay_s: Number = Field(default=0.0, description="From the controller to the drive, beyond the preset's.")
    jitter_s: Number = Field(default=0.0, description="The most that a command is late beyond that, uniform.")
    measurement_loss: Number = Field(
        default=0.0, description="Probability that a measurement is lost; the last is repeated."
    )
    command_loss: Number = Field(default=0.0, description="The same of commands.")
    clock_drift: Number = Field(default=0.0, description="(Drive's period - master's) / master's.")


class Tensor(Record):
    """Tensor of inertia about the centre of mass, in the frame's axes, as in robot files."""

    xx: Number = Field(description="∫ (y² + z²) dm, and yy, zz likewise.")
    xy: Number = Field(description="−∫ x y dm, and xz, yz likewise.")
    xz: Number = Field(description="As xy.")
    yy: Number = Field(description="As xx.")
    yz: Number = Field(description="As xy.")
    zz: Number = Field(description="As xx.")


class PayloadTable(Record):
    """A body in the hand from a time on, in place of what that hand held before; see `armwright.Payload`."""

    time_s: Number = Field(description="When it is taken up; 0 or later.")
    mass_kg: Number = Field(description="0 puts down what the hand held, and needs no more.")
    com_m: Three | None = Field(default=None, description="Centre of mass, in the frame.")
    inertia_kg_m2: Annotated[Tensor | tuple[Number, Number, Number], counted(3, "moments about x, y and z")] | None = (
        Field(
            default=None,
            description="About the centre of mass, in the frame's axes: a table, or three principal moments.",
        )
    )
    frame: str | None = Field(default=None, description="Which carries it; absent: the tip.")


class RecordTable(Record):
    """What is kept of the run."""

    every: Whole = Field(default=1, ge=0, description="Ticks from one row to the next; 0: the first and the last only.")
    what: Literal["all", "state", "none"] = Field(default="all", description="All, q and qd alone, or no rows at all.")
    reduce: tuple[str, ...] = Field(default=(), description="Numbers computed along the way, such as rms_error.")


class ScenarioTable(Record):
    """A whole scenario."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    title: str | None = Field(default=None, description="One line for whoever reads the file.")
    robot: str = Field(description="A built-in arm, or a robot file beside this one.")
    without: tuple[Literal["friction", "rotors", "efficiency"], ...] = Field(
        default=(), description="Parts of the record that this run leaves away."
    )
    values: dict[str, Number | tuple[Number, ...]] = Field(
        default_factory=dict, description="Other numbers than the record's: 'link6.mass_kg' = 1.2."
    )
    duration_s: Number | None = Field(default=None, description="How long; absent: until a schedule's last row.")
    sample_period_s: Number | None = Field(
        default=None, description="Of the controller; without one, of the integrator."
    )
    substeps: Whole = Field(default=1, description="Integration steps in a period.")
    integrator: str = Field(default="rk3", description="rk3, rk4, semi_implicit_euler, rk45 or cvodes.")
    rtol: Number | None = Field(default=None, description="Relative tolerance of rk45 and cvodes.")
    atol: Number | None = Field(
        default=None, description="Absolute tolerance of rk45 and cvodes, in each state's unit."
    )
    max_steps: Whole | None = Field(default=None, description="Of rk45 in one tick; a lane that wants more is frozen.")
    seed: Whole = Field(default=0, ge=0, description="Of noise, jitter and losses.")
    initial: Initial = Field(default_factory=Initial, description="Where the arm begins.")
    drive: Drive | None = Field(default=None, description="Commands over time; or a controller.")
    controller: Kind | None = Field(
        default=None, description="kind = 'joint_pid', 'cascade', 'computed_torque' and its gains."
    )
    reference: Kind | None = Field(
        default=None,
        description="kind = 'pose', 'schedule', 'expression' or a named trajectory; absent: the initial pose.",
    )
    sensors: SensorsTable = Field(default_factory=SensorsTable, description="What is measured.")
    shaping: ShapingTable = Field(default_factory=ShapingTable, description="What becomes of commands.")
    timing: TimingTable = Field(default_factory=TimingTable, description="When they act.")
    wrench: Wrench | None = Field(
        default=None,
        description="On the tip, in base axes: fx, fy, fz in N, mx, my, mz in N m; or a CSV file of them over t.",
    )
    brake: bool | PerJoint | str | None = Field(
        default=None,
        description="Holding brakes of the record, 1 applied, 0 released: for all, one for each, a table by joint, or a CSV file "
        "over t; absent: released.",
    )
    payload: tuple[PayloadTable, ...] = Field(
        default=(), description="What hands take up and put down, as [[payload]]."
    )
    lanes: Lanes | None = Field(default=None, description="Many runs at once; absent: one.")
    record: RecordTable = Field(default_factory=RecordTable, description="What is kept.")

    @model_validator(mode="after")
    def _driven(self) -> ScenarioTable:
        if (self.drive is None) == (self.controller is None):
            raise ValueError("expected either [drive] or [controller]")
        if self.reference is not None and self.controller is None and not self.record.reduce:
            raise ValueError("[reference] goes with a [controller], or with reduce; commands over time are a [drive]")
        return self

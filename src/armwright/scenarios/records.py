"""Tables of a scenario file, `*.scenario.toml`, named like the parts of `Scenario`. Physical values have no hidden defaults."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, StrictBool, model_validator

from armwright.errors import ScenarioError
from armwright.quantity import Record, optional
from armwright.scenarios.tuning_records import TuningTable
from armwright.scenarios.value_records import MOST_LANES, LaneValues, Number, Whole, counted

PerJoint = Number | tuple[Number, ...] | dict[str, Number]
Wrench = Annotated[
    tuple[Number, Number, Number, Number, Number, Number] | str,
    counted(6, "fx, fy, fz in N, mx, my, mz in N m"),
]
Three = Annotated[tuple[Number, Number, Number], counted(3, "along x, y and z")]


class StartTable(Record):
    """Initial positions and speeds: numbers in the order of the joints, or a table by their names (others are 0)."""

    q: PerJoint | None = optional("Positions [rad | m]; absent: 0.")
    qd: PerJoint | None = optional("Speeds [rad/s | m/s]; absent: 0.")


class CommandsTable(Record):
    """Commands over time, without a loop: one of these."""

    constant: PerJoint | None = optional("One command a joint, each in its joint's own unit.")
    schedule: str | None = optional("CSV file: t in s and one column a joint, held from row to row.")

    @model_validator(mode="after")
    def _one(self) -> CommandsTable:
        if (self.constant is None) == (self.schedule is None):
            raise ValueError("expected either constant or schedule")
        return self


class KindTable(Record):
    """A table that names what it is, and gives its fields."""

    model_config = ConfigDict(frozen=True, extra="allow")

    kind: str = Field(description="Which one.")

    def fields(self) -> dict[str, Any]:
        """Everything but the kind."""
        return dict(self.model_extra or {})


class SensorsTable(Record):
    """Sensors of the joints and their errors; see `armwright.Sensors`. Absent: everything exactly."""

    counts: Number | tuple[Number, ...] | None = optional("Encoder counts in one turn; absent: not quantised.")
    counts_per_m: Number | tuple[Number, ...] | None = optional(
        "Of linear encoders on prismatic joints, with side = 'link'."
    )
    side: Literal["motor", "link"] = Field(default="motor", description="Where the encoder sits.")
    velocity: str = Field(default="exact", description="exact, difference, filtered or observer.")
    cutoff_hz: Number | None = optional("Of the filter or observer.")
    position_noise: Number = Field(default=0.0, ge=0, description="Standard deviation [rad | m].")
    velocity_noise: Number = Field(default=0.0, ge=0, description="[rad/s | m/s].")
    current_noise: Number = Field(default=0.0, ge=0, description="[A].")


class CommandFilterTable(Record):
    """Filter of the controller's output; see `armwright.CommandFilter`. Absent: none."""

    limit: PerJoint | None = optional("The most that is commanded, either way.")
    rate: PerJoint | None = optional("How fast a command may change, per second.")
    resolution: PerJoint | None = optional("Its steps, of a DAC or a PWM.")


class TimingTable(Record):
    """Times of measurements and commands; see `armwright.Timing`. Absent: no delays."""

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


def inertia_tensor(inertia: Tensor | tuple[float, float, float]) -> np.ndarray:
    """Tensor of inertia (3, 3) [kg m²] from its entries, or from principal moments."""
    if isinstance(inertia, tuple):
        return np.diag(inertia)
    xx, xy, xz, yy, yz, zz = (getattr(inertia, name) for name in ("xx", "xy", "xz", "yy", "yz", "zz"))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class BodyTable(Record):
    """Mass properties of a body in the hand."""

    com_m: Three | None = optional(
        "Centre of mass, in the frame; of a point mass its place, absent: the frame's origin."
    )
    inertia_kg_m2: Annotated[Tensor | tuple[Number, Number, Number], counted(3, "moments about x, y and z")] | None = (
        optional(
            "About the centre of mass, in the frame's axes: a table, or three principal moments; absent: 0, a point mass."
        )
    )
    frame: str | None = optional("Which carries it; absent: the tip.")


class PayloadTable(BodyTable):
    """A body in the hand from a time on, in place of the payload before; see `armwright.Payload`."""

    time_s: Number = Field(description="When it is taken up; 0 or later.")
    mass_kg: Number = Field(description="0 puts down what the hand held, and needs no more.")


class LoopTable(Record):
    """A sampled loop; see `armwright.Loop`."""

    controller: KindTable = Field(
        description="kind = 'joint_pid', 'cascade', 'computed_torque' and its gains, or one around an inner table."
    )
    reference: KindTable | None = optional(
        "kind = 'pose', 'schedule', 'motion', 'expression' or a named trajectory; absent: the initial pose."
    )
    period_s: Number | None = optional("From sample to sample; absent: step times substeps.")
    sensors: SensorsTable = Field(default_factory=SensorsTable, description="What is measured.")
    command_filter: CommandFilterTable = Field(
        default_factory=CommandFilterTable, description="Limits and steps of commands."
    )
    timing: TimingTable = Field(default_factory=TimingTable, description="Delays of measurements and commands.")
    initial_command: PerJoint | None = optional(
        "In force before the first tick, each in its joint's own unit; absent: what holds the arm."
    )


class InputsTable(Record):
    """Inputs of the arm beside its commands; see `armwright.Inputs`."""

    wrench: Wrench | None = optional(
        "On the tip, in base axes: fx, fy, fz in N, mx, my, mz in N m; or a CSV file of them over t."
    )
    brake: bool | PerJoint | str | None = optional(
        "Holding brakes of the record, 1 applied, 0 released: for all, one for each, a table by joint, or a CSV file "
        "over t; absent: released."
    )
    supply_v: Number | str | None = optional(
        "Voltage of the supply of all drives in place of the record's, or a CSV file of the column supply over t."
    )
    enabled: bool | PerJoint | str | None = optional(
        "Servos that follow their goals, 1, or are off, 0: for all, one for each, a table by joint, or a CSV file over t; "
        "absent: all do."
    )
    payload: tuple[PayloadTable, ...] = Field(
        default=(), description="What the end effector takes up and puts down, as [[inputs.payload]]."
    )


class SolverTable(Record):
    """Integrator and its steps; see `armwright.Solver`."""

    integrator: str = Field(
        default="auto",
        description="auto, or with a fixed step rk3, rk4, semi_implicit_euler; rk45; rodas3 for stiff arms; cvodes.",
    )
    accuracy: Number | None = optional(
        "Of auto: how wrong a run may be, in parts of each quantity's range; absent: 1e-3."
    )
    horizon_s: Number | None = optional(
        "Of auto where nothing is sampled: how long a run is to keep its accuracy; absent: duration_s."
    )
    step_s: Number | None = optional(
        "Of a fixed step; absent: period_s / substeps in a loop, else 1e-3. With auto: by rk3."
    )
    substeps: Whole | None = optional("Fixed steps in a period of the loop. With auto: by rk3.")
    rtol: Number | None = optional("Relative tolerance of rk45, rodas3 and cvodes.")
    atol: Number | None = optional("Absolute tolerance of rk45, rodas3 and cvodes, in each state's unit.")
    global_error: StrictBool = Field(
        default=True,
        description="Of auto: whether some lanes are simulated again, to say how wrong the run is as a whole.",
    )
    max_substeps: Whole | None = optional(
        "Of auto, rk45 and rodas3 in each millisecond of a tick, or in a shorter tick, absent: 1000; a lane that "
        "needs more is frozen."
    )


class RecordingTable(Record):
    """Rows and numbers that a run keeps; see `armwright.Recording`."""

    period_s: Number | None = optional(
        "From row to row; absent: 1e-3 with auto steps and nothing sampled, else `every`."
    )
    every: Whole | None = optional("Ticks from one row to the next, absent: 1; 0: the first and the last only.", ge=0)
    what: Literal["all", "state", "none"] = Field(default="all", description="All, q and qd alone, or no rows at all.")
    reduce: tuple[str, ...] = Field(default=(), description="Numbers computed while the loop runs, such as rms_error.")
    reference: KindTable | None = optional(
        "What reduce measures errors from, beside [commands]; kinds as in [loop.reference]."
    )


class LanesTable(Record):
    """Numbers of the file that vary from lane to lane."""

    kind: Literal["list", "grid", "draws"] = Field(
        description="'list': all lists are as long as there are lanes; 'grid': every combination; 'draws': at random."
    )
    count: Whole | None = optional("Lanes to draw; goes with 'draws'.", ge=1, le=MOST_LANES)
    seed: Whole | None = optional("Of the draws; goes with 'draws'.", ge=0)
    vary: dict[str, LaneValues] = Field(
        min_length=1,
        description="By name: 'link6.mass_kg', 'loop.controller.kp[2]', 'loop.timing.command_delay_s', 'start.q[1]'.",
    )

    @model_validator(mode="after")
    def _complete(self) -> LanesTable:
        if (self.kind == "draws") != (self.count is not None) or (self.kind == "draws") != (self.seed is not None):
            raise ValueError("count and seed go with kind = 'draws', which needs both")
        if self.seed is not None and self.seed >= 2**63:
            raise ValueError(f"seed = {self.seed}: expected a whole number, 0 or more, of 63 bits")
        for name, values in self.vary.items():
            if values.drawn and self.kind != "draws":
                raise ValueError(f"{name} is drawn: expected kind = 'draws'")
        lengths = {name: v.size for name, v in self.vary.items() if not v.drawn}
        wanted = {self.count} if self.kind == "draws" else set(lengths.values())
        if self.kind != "grid" and (len(wanted) > 1 or any(length not in wanted for length in lengths.values())):
            listed = ", ".join(f"{length} of {name}" for name, length in lengths.items())
            raise ValueError(f"lists of unequal length: {listed}")
        if self.kind == "grid" and math.prod(lengths.values()) > MOST_LANES:
            raise ValueError(f"a grid of {math.prod(lengths.values()):.3g} lanes; expected at most {MOST_LANES:.0e}")
        return self

    def columns(self, lanes: range | None = None) -> Mapping[str, np.ndarray]:
        """(lanes,) values of every name, in the order of the file. A name's draws depend on the seed, the name and the lane.

        Args:
            lanes: only these, which of draws may be beyond `count`; by default all.
        Raises:
            ScenarioError: a lane that lists or a grid do not have, or a value that is not finite.
        """
        listed = [values.size for values in self.vary.values() if not values.drawn]
        most = math.prod(listed) if self.kind == "grid" else min(listed, default=math.inf)
        lanes = range(self.count or int(most)) if lanes is None else lanes
        if lanes.stop > most:
            raise ScenarioError(place="lanes", value=lanes.stop, expected=f"{most:.0f} at most, as the file lists")
        if self.kind == "grid":
            shape = tuple(listed)
            at = np.unravel_index(np.arange(lanes.start, lanes.stop), shape)
            return {name: each.listed()[k] for (name, each), k in zip(self.vary.items(), at, strict=True)}
        columns: dict[str, np.ndarray] = {}
        for name, values in self.vary.items():
            with np.errstate(over="ignore"):
                drawn = values.draw().batch(self.seed or 0, name, lanes) if values.drawn else None
                columns[name] = values.listed()[lanes.start : lanes.stop] if drawn is None else drawn.values
            beyond = ~np.isfinite(columns[name])
            if beyond.any():
                lane = int(np.argmax(beyond))
                value, lane = float(columns[name][lane]), lanes.start + lane
                place = f"lanes.vary[{name!r}] of lane {lane}"
                raise ScenarioError(place=place, value=value, expected="a narrower distribution")
        return columns


class ScenarioTable(Record):
    """A whole scenario; its tables are the parts of `armwright.Scenario`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    title: str | None = optional("One line for whoever reads the file.")
    robot: str = Field(description="A built-in arm, or a robot file beside this one.")
    without: tuple[Literal["friction", "springs", "rotors", "efficiency", "firmware"], ...] = Field(
        default=(), description="Parts of the record that this run leaves away."
    )
    values: dict[str, Number | tuple[Number, ...]] = Field(
        default_factory=dict, description="Other numbers than the record's: 'link6.mass_kg' = 1.2."
    )
    duration_s: Number | None = optional("How long; absent: until a schedule's last row.")
    seed: Whole = Field(default=0, ge=0, description="Of noise, jitter and losses.")
    start: StartTable = Field(default_factory=StartTable, description="Initial positions and speeds.")
    commands: CommandsTable | None = optional("Commands over time; or a loop.")
    loop: LoopTable | None = optional("Controller, reference, sensors and timing.")
    inputs: InputsTable = Field(default_factory=InputsTable, description="What acts beside commands.")
    solver: SolverTable = Field(default_factory=SolverTable, description="Integrator and step.")
    recording: RecordingTable = Field(default_factory=RecordingTable, description="What is kept.")
    lanes: LanesTable | None = optional("Many runs at once; absent: one.")
    tuning: TuningTable | None = optional("What `armwright tune` searches for; no run reads it.")

    @model_validator(mode="after")
    def _driven(self) -> ScenarioTable:
        if (self.commands is None) == (self.loop is None):
            raise ValueError("expected either [commands] or [loop]")
        return self

"""A simulated arm as servos on a serial bus: their model, ids and registers at power-up, and what serves them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from armwright.description.paths import path_name
from armwright.entry import AnyArm, as_arm
from armwright.errors import BusError
from armwright.features import Support
from armwright.model import Model
from armwright.twin.serial.arm_plant import WITHOUT_INDUCTANCE, ArmPlant, Mounting, require_servos
from armwright.twin.serial.bus import ServoBus, make_servo
from armwright.twin.serial.frames import BROADCAST
from armwright.twin.serial.registers import ServoModel, servo_model
from armwright.twin.serial.replay import write_goals
from armwright.twin.serial.servo import Servo
from armwright.twin.serial.terminal import Counts, Terminal, serve
from armwright.twin.serial.timing import PATIENCE, CycleEnd, LockStep, RealTime

SUPPORT = Support(
    "twin --serial",
    without_effect={"brakes": "they are released"},
    refused={
        **dict.fromkeys(
            ("screw joints", "coupled motors", "current loop", "coasting", "dead zone"),
            'joints with command = "position"',
        ),
        "inductance": WITHOUT_INDUCTANCE,
    },
)
BAUD = 1_000_000  # [bit/s]
# Number of the record's firmware → the registers that hold it.
HELD_IN = {
    "p": ("position_p_gain",),
    "i": ("position_i_gain",),
    "d": ("position_d_gain",),
    "dead_band_counts": ("cw_dead_band", "ccw_dead_band"),
    "goal_speed_rad_per_s": ("profile_velocity",),
    "goal_acceleration_rad_per_s2": ("profile_acceleration",),
}


@dataclass(frozen=True)
class Line:
    """Ids of servos on their bus, and mountings on their joints.

    Attributes:
        model: of all servos, such as "sts3215".   ids: one for each joint; default 1, 2, ….   baud: [bit/s].
        zeros: [counts] of each encoder at q = 0; default the middle of a turn.
        reversed: joints that turn the other way than their encoder counts.
    """

    model: str = "sts3215"
    ids: Sequence[int] | None = None
    baud: int = BAUD
    zeros: Sequence[float] | None = None
    reversed: Sequence[str] = ()


class ServoArm:
    """An arm as servos on a bus.

    Args:
        arm: all of whose joints follow goals by their firmware.   line: of its servos.
        start: (n,) [rad] at time 0; default 0.   note: called with each request that the model cannot carry out.

    Attributes:
        plant: the arm.   bus: of the servos, at time 0.
    Raises:
        BusError: an arm without servos, another number of ids or zeros than joints, ids twice, no such model or baud rate.
    """

    def __init__(
        self,
        arm: AnyArm,
        line: Line | None = None,
        *,
        start: Sequence[float] | None = None,
        note: Callable[[str], None] = lambda text: None,
    ):
        self.arm, self.line = as_arm(arm), line or Line()
        require_servos(self.arm)
        model = servo_model(self.line.model)
        self.ids = ids_of(self.arm, self.line.ids)
        self.plant = ArmPlant(self.arm, mountings_of(self.arm, self.line, model), start, note)
        servos = [_servo(self.arm, i, model, number, self.line.baud) for i, number in enumerate(self.ids)]
        self.bus = ServoBus(servos, self.plant)

    def __str__(self) -> str:
        numbers = ", ".join(f"{name} {number}" for name, number in zip(self.arm.names, self.ids, strict=True))
        return f"{self.arm.name} as {self.line.model} at {self.line.baud} bit/s: {numbers}"

    def serve(
        self,
        path: Path | str | None,
        ended: Callable[[], bool],
        *,
        cycle: tuple[float, str] | None = None,
        schedule: Path | None = None,
        ready: Callable[[str], None] = lambda device: None,
        patience: float = PATIENCE,
    ) -> Counts:
        """Answers on a pseudo-terminal until `ended` says so.

        Args:
            path: of the link that clients open; None: they open the device that `ready` receives.
            cycle: period [s], and the instruction that closes a cycle, such as "sync-write:42": lock-step; None: real time.
            schedule: NAME.scenario.toml for the goals that came, written at the beginning and the end; None: goals are not kept.
            ready: called with the device that clients open.   patience: [s] after which a reply is dropped.
        Returns:
            counts: of instructions and replies.
        Raises:
            BusError: no terminal there, a cycle that the protocol does not have; in lock-step, a reply that was late.
            OutputError: the schedule cannot be written.   DivergenceError: the motion diverged to infinite numbers or NaN.
        """
        end = None if cycle is None else CycleEnd.parse(cycle[1], self.bus.framing)
        timing = None if cycle is None or end is None else LockStep(self.bus, cycle[0], end)
        self.plant.keeps_rows = schedule is not None
        if schedule is not None:
            write_goals(self.plant, schedule)
        with Terminal(path) as terminal:
            said = partial(ready, str(terminal.path or terminal.device))
            try:
                return serve(terminal, self.bus, timing or RealTime(self.bus), ended, patience, said)
            finally:
                if schedule is not None:
                    write_goals(self.plant, schedule)


def ids_of(arm: Model, ids: Sequence[int] | None) -> list[int]:
    """Ids of an arm's servos, 1, 2, … by default.

    Raises:
        BusError: another number of them than joints, one twice, or one that no servo has.
    """
    found = list(range(1, arm.n + 1)) if ids is None else list(ids)
    if len(found) != arm.n or len(set(found)) != len(found) or not all(0 <= number < BROADCAST for number in found):
        raise BusError(
            place="ids", value=found, expected=f"{arm.n} different ones: {', '.join(arm.names)}; ids are 0 to 253"
        )
    return found


def mountings_of(arm: Model, line: Line, model: ServoModel) -> list[Mounting]:
    """Mountings of the encoders of an arm's servos on its joints.

    Raises:
        BusError: another number of zeros than joints, or a joint that the arm does not have.
    """
    zeros = [model.counts / 2.0] * arm.n if line.zeros is None else list(line.zeros)
    if len(zeros) != arm.n:
        raise BusError(place="zeros", value=zeros, expected=f"{arm.n} numbers: {', '.join(arm.names)}")
    strange = [name for name in line.reversed if name not in arm.names]
    if strange:
        raise BusError("no such joint", place="reversed", value=strange[0], choices=arm.names)
    return [
        Mounting(model.counts, zero, -1 if name in line.reversed else 1)
        for name, zero in zip(arm.names, zeros, strict=True)
    ]


def check_baud(model: ServoModel, baud: int) -> None:
    """Refuses a baud rate [bit/s] that servos do not have.

    Raises:
        BusError: says which there are.
    """
    if baud not in model.bauds:
        choices = [str(each) for each in model.bauds]
        raise BusError(f"{model.name} has no such rate", place="baud", value=baud, choices=choices)


def _servo(arm: Model, joint: int, model: ServoModel, number: int, baud: int) -> Servo:
    """A servo whose registers hold, as nearly as they can, the numbers of the record."""
    check_baud(model, baud)
    values = {"baud_rate": model.bauds.index(baud)}
    known, per_count = arm.parameters, Mounting(model.counts).radians
    for key, names in HELD_IN.items():
        path = f"{path_name(arm.names[joint])}.firmware.{key}"
        if path not in known.names:
            continue
        unit = {
            "goal_speed_rad_per_s": per_count * model.units["speed"],
            "goal_acceleration_rad_per_s2": per_count * model.units["acceleration"],
        }.get(key, 1.0)
        for register in [model.by_name[name] for name in names if name in model.by_name]:
            low, high = register.low or 0, register.largest if register.high is None else register.high
            values[register.name] = min(max(round(known[path].value / unit), low), high)
    eeprom = {name: value for name, value in values.items() if model.by_name[name].address < model.eeprom}
    servo = make_servo(model, number, **eeprom)
    for name in values.keys() - eeprom.keys():
        servo[name] = values[name]
    return servo

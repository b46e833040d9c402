"""A simulated arm of servos as the mechanics behind a bus, in whole turns of the servos' firmware.

A goal that comes at a time t is in force from the first turn at or after t. What is measured at t is the state at the last turn
at or before t, as the firmware read it. So the motion depends on the goals and the turns at which they come into force alone, not
on when the bus looks, and a scenario of these goals has the same bits: `replay.py`.

Registers that the record's `firmware` has a number for are parameters of the simulation, whose values change between turns. While
a servo is off they have no effect, so their values count from the turn that finds it on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor, tau

import numpy as np

from armwright.description.paths import path_name
from armwright.errors import BusError, DivergenceError
from armwright.kernels.loop import ENDLESS, Schedules
from armwright.model import Model
from armwright.simulation.inputs.schedule import Schedule
from armwright.simulation.loop_runner import LoopRunner
from armwright.simulation.plant.plant import Plant
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Inputs, Recording, Start
from armwright.twin.serial.plant import Goal, Measurement

ROUNDING = 1e-6  # of a turn: a time that near to one is the turn's
AMBIENT = 30.0  # [°C] of a servo whose record has no heat
LEAST, MOST = 1e-9, {"goal_speed_rad_per_s": 1e3, "goal_acceleration_rad_per_s2": 1e6}  # numbers that no servo notices
WITHOUT_INDUCTANCE = "a motor without inductance_h, whose current is 0 as soon as a servo is off"
CHUNK = 1000  # turns at once


@dataclass(frozen=True)
class Mounting:
    """Mounting of a servo's encoder on its joint:  q = direction (counts - zero) 2π / turn.

    Attributes:
        turn: [counts] of one turn.   zero: [counts] at q = 0.   direction: 1 or -1.
    """

    turn: int = 4096
    zero: float = 2048.0
    direction: int = 1

    @property
    def radians(self) -> float:
        """[rad] of one count, with its sign."""
        return self.direction * tau / self.turn

    def position(self, counts: float) -> float:
        """Position [rad] of a joint."""
        return (counts - self.zero) * self.radians

    def counts(self, q: float) -> float:
        """Position [counts] of an encoder, as a real number."""
        return self.zero + q / self.radians


# Number of the record's firmware → what a goal says of it, in the record's unit; the mounting tells radians from counts.
REGISTERS: Mapping[str, Callable[[Goal, Mounting], float]] = {
    "p": lambda goal, at: goal.gains[0],
    "i": lambda goal, at: goal.gains[1],
    "d": lambda goal, at: goal.gains[2],
    "dead_band_counts": lambda goal, at: max(goal.dead_band),
    "goal_speed_rad_per_s": lambda goal, at: goal.speed * abs(at.radians),
    "goal_acceleration_rad_per_s2": lambda goal, at: goal.acceleration * abs(at.radians),
}
LIMIT = "output_limit"  # the record's or the registers', whichever is less


@dataclass(frozen=True, eq=False)
class PlantRow:
    """Inputs that came into force at a turn: goals (n,) [rad] and 1 or 0 for servos (n,) that are on or off."""

    turn: int
    goals: np.ndarray
    enabled: np.ndarray


def require_servos(arm: Model) -> None:
    """Refuses an arm that no servo bus can carry.

    Raises:
        BusError: names the arm, and the joint that follows no goal.
    """
    for body in arm.coordinates:
        if body.drive.firmware is None:
            what = f"joint {body.joint!r} of {arm.name} is driven by {body.drive.command}"
            expected = 'joints with command = "position" and a [joints.firmware] in the record'
            raise BusError(what, place="arm", expected=expected)


class ArmPlant:
    """The arm behind a servo bus, a `Plant`; servo k is the arm's k-th joint.

    Args:
        arm: all of whose joints have a servo's firmware.   mountings: (n,) of the servos.
        start: (n,) [rad] at time 0, where everything rests; default 0.
        note: called once with each request to a servo that the model cannot carry out.

    Attributes:
        period: [s] of a turn.   turn: number of the turn that comes next.   rows: what came into force, and when.
        values: of the parameters by `names` (k,), each from its turn until the next.
        states: x just before every turn, where it is a list; None by default: they are not kept.
        keeps_rows: False: only the rows in force are kept, so that memory does not grow with time; there is no scenario then.
    Raises:
        BusError: an arm without servos, or with an inductance.   ScenarioError: a start that does not fit.
    """

    def __init__(
        self,
        arm: Model,
        mountings: Sequence[Mounting],
        start: Sequence[float] | None = None,
        note: Callable[[str], None] = lambda text: None,
    ):
        require_servos(arm)
        for body in arm.coordinates:
            if body.drive.inductance is not None:
                raise BusError(f"joint {body.joint!r} has an inductance", place="arm", expected=WITHOUT_INDUCTANCE)
        self.arm, self.mountings, self._note = arm, list(mountings), note
        period = Plant.of(arm).turn
        assert period is not None
        self.period, self.turn, self._until = period, 0, 0.0
        known = dict(zip(arm.parameters.names, arm.parameters.values.tolist(), strict=True))
        every = {
            (i, key): f"{path_name(joint)}.firmware.{key}"
            for i, joint in enumerate(arm.names)
            for key in (*REGISTERS, LIMIT)
        }
        self._places = {place: name for place, name in every.items() if name in known}
        self.names = list(self._places.values())
        self._record = np.array([known[name] for name in self.names])
        q = np.zeros(arm.n) if start is None else np.asarray(start, dtype=float)
        self.start, self.keeps_rows = q, True
        self.rows = [PlantRow(0, q.copy(), np.zeros(arm.n))]
        self.values: list[tuple[int, np.ndarray]] = [(0, self._record.copy())]
        self._runner = LoopRunner(self.scenario(1))
        self._lanes = self._runner.lanes(1)
        self._runner.begin(self._lanes, None)
        self._first: list[Goal | None] = [None] * arm.n
        self._goals = [Goal()] * arm.n
        self._was_on, self._noted = np.zeros(arm.n, dtype=bool), set[str]()
        self._pending: list[tuple[int, list[Goal]]] = []
        self._measured: tuple[int, list[Measurement]] | None = None
        self.states: list[np.ndarray] | None = None

    def scenario(self, turns: int) -> Scenario:
        """The scenario of all goals so far, with the first values of the parameters, over so many turns.

        Raises:
            BusError: goals were not kept.
        """
        if not self.keeps_rows:
            raise BusError("goals were not kept", place="schedule", expected="a schedule from the beginning")
        return Scenario(
            self.arm,
            turns * self.period,
            command=self._schedule("goals"),
            inputs=Inputs(enabled=self._schedule("enabled")),
            start=Start(self.start),
            recording=Recording(period=self.period),
            vary=dict(zip(self.names, self.values[0][1].tolist(), strict=True)),
        )

    def _schedule(self, name: str) -> Schedule:
        """Goals, or which servos are on, of all rows with other ones than the row before."""
        values = [getattr(row, name) for row in self.rows]
        kept = [k for k, value in enumerate(values) if k == 0 or not np.array_equal(value, values[k - 1])]
        times = np.array([self.rows[k].turn * self.period for k in kept])
        return Schedule(times, np.array([values[k] for k in kept]), tuple(self.arm.names))

    @property
    def state(self) -> np.ndarray:
        """State x (size,) just before the turn that comes next, as a run's loop has it."""
        return self._lanes.get("x")[0].copy()

    # The border to the bus.

    def command(self, servo: int, goal: Goal) -> None:
        """Puts a goal into force at the first turn that is not before the present time."""
        turn = max(ceil(self._until / self.period - ROUNDING), self.turn)
        self._goals[servo] = goal
        self._first[servo] = self._first[servo] or goal
        if self._pending and self._pending[-1][0] == turn:
            self._pending.pop()
        self._pending.append((turn, list(self._goals)))

    def advance(self, until: float) -> None:
        """Simulates all turns that end at or before a time [s].

        Raises:
            DivergenceError: the motion diverged to infinite numbers or NaN.
        """
        self._until = until
        end = floor(until / self.period + ROUNDING)
        while self.turn < end:
            if self._pending and self._pending[0][0] <= self.turn:
                self._put(*self._pending.pop(0))
            upto = min([end, self.turn + CHUNK, *(turn for turn, _ in self._pending[:1])])
            self._run(upto)

    def measure(self, servo: int) -> Measurement:
        """Measurement that the servo's firmware read at its last turn."""
        if self._measured is None or self._measured[0] != self.turn:
            self._measured = self.turn, self._measurements()
        return self._measured[1][servo]

    # Turns.

    def _run(self, end: int) -> None:
        """Turns up to, not including, one."""
        runner, count = self._runner, end - self.turn
        room = np.empty((count, runner.width, sum(layout.size for layout in runner.config.recorded.values())))
        runner.tick = runner.origin = self.turn
        runner.advance(self._lanes, self.turn, end, ENDLESS, room, 1)
        self.turn = end
        if self.states is not None:
            self.states += [row.copy() for row in room[:, 0]]
        stopped = self._lanes.get("frozen")[0, 0]
        if stopped >= 0.0:
            raise DivergenceError(
                f"the motion diverged to infinite numbers or NaN at t = {stopped * self.period:g} s",
                place=self.arm.name,
            )

    def _put(self, turn: int, goals: Sequence[Goal]) -> None:
        """Puts goals into force at the turn that comes next."""
        last = self.rows[-1]
        enabled = np.array([float(self._is_on(i, goal)) for i, goal in enumerate(goals)])
        pairs = zip(goals, self.mountings, last.goals, strict=True)
        wanted = np.array([at.position(goal.value) if goal.mode == "position" else q for goal, at, q in pairs])
        row = PlantRow(self.turn, wanted, enabled)
        for block, new, old in (("u", wanted, last.goals), ("enabled", enabled, last.enabled)):
            if not np.array_equal(new, old):
                self._set_rows(block, new)
        if not (np.array_equal(wanted, last.goals) and np.array_equal(enabled, last.enabled)):
            if last.turn == self.turn or not self.keeps_rows:
                self.rows.pop()
            self.rows.append(row)
        self._put_values(goals, enabled > 0.0)

    def _set_rows(self, block: str, values: np.ndarray) -> None:
        """A row that comes into force at the turn that comes next, as one of a schedule would."""
        row = Schedules(
            np.array([float(self.turn)]),
            np.zeros(1),
            np.ascontiguousarray(values[None]),
            np.zeros(1, int),
            np.ones(1, int),
        )
        self._runner.rows[block] = row
        self._runner.loop.loops[0].begin_rows(self._lanes, block, row, self.turn)

    def _is_on(self, servo: int, goal: Goal) -> bool:
        """True if the model's servo is on: for goals of position, and for a duty of 0, which shorts the motor."""
        if goal.torque and goal.mode != "position" and (goal.mode, goal.value) != ("duty", 0.0):
            self._note_once(servo, f"goals of {goal.mode} are not simulated: the servo is off")
            return False
        return goal.torque

    def _put_values(self, goals: Sequence[Goal], on: np.ndarray) -> None:
        """Puts what registers say into force, of servos that are on."""
        now = self.values[-1][1].copy()
        for k, (servo, key) in enumerate(self._places):
            if on[servo]:
                now[k] = self._value(servo, key, goals[servo], self._record[k])
        for servo, goal in enumerate(goals):
            if on[servo]:
                self._check_absent(servo, goal)
        first = [k for k, (servo, _) in enumerate(self._places) if on[servo] and not self._was_on[servo]]
        for _, values in self.values:  # of servos that were off until here
            values[first] = now[first]
        self._was_on |= on
        if np.array_equal(now, self.values[-1][1]) and not first:
            return
        if not np.array_equal(now, self.values[-1][1]):
            if self.values[-1][0] == self.turn or not self.keeps_rows:
                self.values.pop()
            self.values.append((self.turn, now))
        if "p" in self._lanes.blocks:
            self._lanes.set("p", now)

    def _value(self, servo: int, key: str, goal: Goal, record: float) -> float:
        """A parameter's value: the record's, until a register that says it is written."""
        start, at = self._first[servo], self.mountings[servo]
        assert start is not None
        if key == LIMIT:
            if goal.mode == "duty":
                return LEAST
            firmware = self.arm.coordinates[servo].drive.firmware
            assert firmware is not None
            return max(min(record, goal.limit if firmware.output == "duty" else goal.current), LEAST)
        value = REGISTERS[key](goal, at)
        if value == REGISTERS[key](start, at):
            return record
        return min(max(value, LEAST), MOST[key]) if key in MOST else float(value)

    def _check_absent(self, servo: int, goal: Goal) -> None:
        """Notes registers that were written and that the record has no number for."""
        start, at = self._first[servo], self.mountings[servo]
        assert start is not None
        for key, says in REGISTERS.items():
            if (servo, key) not in self._places and says(goal, at) not in (says(start, at), 0.0):
                self._note_once(servo, f"the register has no effect, since the record has no firmware.{key}")

    def _note_once(self, servo: int, what: str) -> None:
        text = f"joint {self.arm.names[servo]!r}: {what}"
        if text not in self._noted:
            self._noted.add(text)
            self._note(text)

    # Measuring.

    def _measurements(self) -> list[Measurement]:
        """Measurements of all servos at the turn that comes next, before it."""
        runner, layout, last = self._runner, self._runner.plant.layout, self.rows[-1]
        x, p = self.state, [self.values[-1][1]] if self.names else []
        kernel = runner.loop.outputs
        assert kernel is not None
        inputs = {"enabled": last.enabled}
        outputs = kernel(x, last.goals, *(inputs[name] for name in runner.config.inputs), *p)
        by_name = dict(zip(runner.loop.names, outputs, strict=True))
        parts, found = layout.parts(x), []
        for i, (body, at) in enumerate(zip(self.arm.coordinates, self.mountings, strict=True)):
            volts = body.limits.voltage if self.arm.supply is None else parts["bus_voltage"][0]
            warm = layout["winding_temperature"].joints or () if "winding_temperature" in layout else ()
            current = float(by_name["current"][i]) * at.direction
            found.append(
                Measurement(
                    at.counts(float(parts["q"][i])),
                    float(parts["qd"][i]) / at.radians,
                    float(by_name["voltage"][i]) / float(volts) * at.direction,
                    current if current == current else 0.0,
                    float(volts),
                    float(parts["winding_temperature"][warm.index(i)]) if i in warm else AMBIENT,
                )
            )
        return found

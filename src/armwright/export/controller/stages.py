"""Stages of a simulated loop that run on the controller's processor, with the layouts of its inputs and outputs.

    measured, reference ─→ controller ─→ rate limit, limit, resolution ─→ command

The programs are those that the simulation's loop is compiled from. Sensors, queues of measurements and commands, jitter and
losses belong to the bus and to the arm; of them the controller has the rule that a lost sample repeats the last one.
"""

from __future__ import annotations

import traceback
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armwright.errors import ScenarioError, SymbolError
from armwright.interfaces import UNTRACEABLE, why
from armwright.kernels.c import REALS
from armwright.kernels.c_syntax import identifier
from armwright.kernels.stages import NEXT, Call
from armwright.model import Model
from armwright.parameters import Batch, LaneFields
from armwright.program import Program, trace
from armwright.program.passes import optimised
from armwright.scalar import Array
from armwright.signals import Layout, Signal
from armwright.simulation.loop.config import LoopConfig, Sampling
from armwright.simulation.loop.controller import counters_of, place_of, traced_controller
from armwright.simulation.loop.initialisation import Initialisation
from armwright.simulation.loop_runner import LoopRunner
from armwright.simulation.scenario import Scenario

DRAWN = "w_timing"  # the block of random numbers that decide which samples are lost
LOSS = 2  # its entry for a measurement
PACKAGE = Path(__file__).parents[2]
TIME_ERROR = 1e-6  # [s] by which the controller's time may be wrong before the status word says so


class RecordedLoop(LoopRunner):
    """A scenario's loop that records its controller's inputs and commands, and nothing of the plant."""

    def _configured(self) -> tuple[LoopConfig, Initialisation]:
        config, initialisation = super()._configured()
        sampling = config.sampling
        assert sampling is not None
        assert self.reference is not None
        recorded = {"r": self.reference.layout, "y": sampling.sensors.y, "u_issued": self.command}
        if np.any(sampling.delays.measurement_loss):
            recorded[DRAWN] = Layout((Signal(DRAWN, "-", (3,)),))
        return replace(config, recorded=recorded), initialisation


@dataclass(frozen=True, eq=False)
class ControllerStages:
    """The controller's part of a loop.

    Attributes:
        name: a C identifier, which all of its names in C begin with.   loop: of the simulation.
        measured: layout of what arrives with a sample, which may be lost.   applied: of what the drives did, which is known.
        reference, command: layouts of what it follows and of what leaves.
        begin: (y, c) → s, the controller's state before the first tick.   law: (tick, r, y, s, c) → u_asked, s_next.
        shape: (u_asked, u_kept or u_issued) → u_issued_next, and u_kept_next where the rate is limited.
        initial_command: (n,) in force before the first tick.   gains: the controller's fields that are no constants of its code.
        limits: (n,) of commands: the smaller of the filter's and the drive's.
        count: (n,) [rad | m] one count of each encoder, where positions come in counts; else empty.
    """

    name: str
    loop: RecordedLoop
    measured: Layout
    applied: Layout
    reference: Layout
    command: Layout
    begin: Program
    law: Program
    shape: Program
    initial_command: np.ndarray
    gains: LaneFields
    limits: np.ndarray
    count: np.ndarray

    @classmethod
    def of(
        cls, scenario: Scenario, name: str | None = None, gains: tuple[str, ...] = (), *, counts: bool = False
    ) -> ControllerStages:
        """The controller's part of a scenario's loop.

        Args:
            scenario: with a controller that can be traced, and no lanes.   name: in C; default: the arm's, and "controller".
            gains: fields of the controller that become parameters.   counts: true: positions come as the encoders' counts.
        Raises:
            ScenarioError: no controller, several lanes, a state to go on from, a controller that cannot be traced, no such field,
                counts of encoders that have none.
        """
        check_one_arm(scenario)
        if scenario.controller is None:
            raise ScenarioError("no controller", place="loop.controller", expected="one to export")
        scenario = _with_gains(scenario, gains) if gains else scenario
        loop = RecordedLoop(scenario)
        sampling, arm = loop.config.sampling, loop.arm
        assert sampling is not None
        assert loop.reference is not None
        begin = traced_beginning(loop, sampling)
        stages = (*loop.loop.tick.before, *loop.loop.tick.after)
        programs = {each.program.name: each.program for each in stages if isinstance(each, Call)}
        y, measured = sampling.sensors.y, sampling.sensors.layout
        return cls(
            identifier(name or f"{arm.name} controller"),
            loop,
            measured,
            Layout(tuple(signal for signal in y if signal.name not in measured)),
            loop.reference.layout,
            scenario.command_layout,
            begin,
            programs["control"],
            programs["shape"],
            loop.initial["u"],
            sampling.controller.lanes,
            np.minimum(_filter_limits(sampling, arm.n), _drive_limits(arm)),
            _counts(scenario, arm) if counts else np.zeros(0),
        )

    @property
    def arm(self) -> Model:
        """The controlled arm."""
        return self.loop.arm

    @property
    def period(self) -> float:
        """Sample period [s]."""
        return self.loop.period

    @property
    def delay_ticks(self) -> int:
        """Whole ticks of delay from command to drive, as the controller has it."""
        return int(getattr(self.loop.scenario.controller_fields.owner, "delay_ticks", 0))

    @property
    def remembers(self) -> bool:
        """True if the command before rounding is stored, for the rate limit."""
        return any(port.name == f"u_kept{NEXT}" for port in self.shape.outputs)

    @property
    def counters(self) -> list[int]:
        """Entries of the controller's state that count ticks, for its slower loops."""
        return counters_of(self.law)

    def ticks_of_time(self, real: str) -> int | None:
        """The last tick whose time is right to within 1 µs in "double" or "float"; None if the controller reads no time."""
        if not inputs_read(self.law, "tick"):
            return None
        dtype, period = REALS[real].format.dtype, self.period

        def error(tick: int) -> float:
            rounded = 0.5 * float(np.spacing(dtype.type(tick))) * (tick > 2 ** np.finfo(dtype).nmant)
            of_period = abs(float(dtype.type(period)) - period)
            return rounded * period + tick * of_period + 0.5 * float(np.spacing(dtype.type(tick * period)))

        return bisect_right(range(2**62), TIME_ERROR, key=error) - 1

    @property
    def loss(self) -> float:
        """Probability that a measurement is lost in the simulation."""
        assert self.loop.config.sampling is not None
        return float(self.loop.config.sampling.delays.measurement_loss[0])

    @property
    def ranges(self) -> Mapping[str, np.ndarray]:
        """(n,) largest valid measurement or reference of each joint; infinite without a limit in the record."""
        limits = [body.limits for body in self.arm.coordinates]
        return {
            "position_low": np.array([each.position[0] for each in limits]),
            "position_high": np.array([each.position[1] for each in limits]),
            "velocity": np.array([each.velocity for each in limits]),
        }


def check_one_arm(scenario: Scenario) -> None:
    """Refuses scenarios of several arms, and those that go on from another run, for what is made of one arm from its beginning.

    Raises:
        ScenarioError: no scenario, several lanes, a state to go on from.
    """
    if (scenario.lane_count or 1) > 1:
        what = f"{scenario.lane_count} lanes"
        raise ScenarioError(what, place="lanes", expected="one arm: a scenario without batches and draws")
    if scenario.started is not None:
        raise ScenarioError("continues from a saved state", place="start", expected="initial positions and speeds")


def _with_gains(scenario: Scenario, gains: tuple[str, ...]) -> Scenario:
    """The scenario with fields of its controller as values of one lane, so that they are traced as inputs."""
    assert scenario.loop is not None
    control, own = scenario.controller, dict(_gains_of(scenario.controller))
    for gain in gains:
        path = gain if gain in own else next((each for each in own if each.endswith(f".{gain}")), None)
        if path is None:
            raise ScenarioError(place="gains", value=gain, choices=tuple(own))
        value = own[path]
        one = value if isinstance(value, Batch) else Batch(np.asarray(value, dtype=float)[None])
        control = _with_field(control, path, one)
    return replace(scenario, loop=replace(scenario.loop, controller=control))


def _gains_of(control: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Fields of a controller that may become parameters, and those of the controller inside it as `inner.kp`."""
    for name, field in getattr(control, "__dataclass_fields__", {}).items():
        value = getattr(control, name)
        counted = "int" in str(field.type)  # ticks, which select what is compiled
        if isinstance(value, Batch) or (_is_gain(value) and not counted):
            yield f"{path}{name}", value
        elif hasattr(value, "step"):
            yield from _gains_of(value, f"{path}{name}.")


def _with_field(control: Any, path: str, value: Any) -> Any:
    """The controller with another value of a field, its own or that of one inside it."""
    name, _, inner = path.partition(".")
    return replace(control, **{name: _with_field(getattr(control, name), inner, value) if inner else value})


def _is_gain(value: Any) -> bool:
    """True for what may become a parameter: a real number, or real numbers."""
    if isinstance(value, (bool, str)) or value is None:
        return False
    try:
        return bool(np.asarray(value, dtype=float).size)
    except (TypeError, ValueError):
        return False


def traced_beginning(loop: LoopRunner, sampling: Sampling) -> Program:
    """The controller's initial state as a program (y, c) → s.

    Raises:
        ScenarioError: the controller, or its beginning, cannot be traced; names the line that stops it, and why.
    """
    adapter, arm = sampling.controller, loop.arm

    def begin(y: Array, c: Array) -> Array:
        return adapter.initial(arm, y, c)

    try:
        if adapter.vectorised:
            raise ScenarioError(
                "asks for all lanes at once", place=place_of(adapter.name), expected="a controller of one lane"
            )
        program = trace("begin", begin, {"y": (adapter.y.size,), "c": adapter.values.shape[1:]}, ("s",))
        if loop.untraced is not None:
            traced_controller(adapter, arm, loop.period, sampling.states)
    except UNTRACEABLE as error:
        if isinstance(error, ScenarioError):
            raise
        cause, expected = why(error), "a controller written with armwright.scalar"
        if isinstance(error, SymbolError):  # which knows what to write in its place
            cause, expected = error.problems[0].what, error.problems[0].expected
        what = f"cannot be traced{_line(error)}: {cause}"
        raise ScenarioError(what, place=place_of(adapter.name), expected=expected) from None
    return program


def inputs_read(program: Program, block: str) -> list[int]:
    """Entries of an input that a program reads."""
    number = [port.name for port in program.inputs].index(block)
    places = (i.place for i in optimised(program.instructions) if i.operation == "INPUT" and i.place is not None)
    return sorted({entry for port, entry in places if port == number})


def _line(error: Exception) -> str:
    """The last line of the user's that an error passed through: " (law.py, line 12)"."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not Path(f.filename).is_relative_to(PACKAGE)]
    return f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""


def _counts(scenario: Scenario, arm: Model) -> np.ndarray:
    """(n,) one count of each encoder [rad | m].

    Raises:
        ScenarioError: a joint whose position is not measured in counts.
    """
    assert scenario.loop is not None
    count = scenario.loop.joint_sensors.counts_of(arm)
    without = [joint for joint, one in zip(arm.names, count, strict=True) if one == 0.0]
    if without:
        what = f"{', '.join(without)}: measured exactly, not in counts"
        raise ScenarioError(what, place="loop.sensors.counts", expected="counts of every joint's encoder")
    return count


def _filter_limits(sampling: Sampling, n: int) -> np.ndarray:
    limit = sampling.command_filter.limit
    return np.full(n, np.inf) if limit is None else np.broadcast_to(np.asarray(limit, dtype=float), n)


def _drive_limits(arm: Model) -> np.ndarray:
    """(n,) the most that each drive takes, in its command's unit; infinite where the record is silent."""
    return np.array(
        [
            np.inf if body.drive.firmware is not None else float(getattr(body.limits, body.drive.command))
            for body in arm.coordinates
        ]
    )

"""Parts of a scenario: the sampled loop, what acts beside commands, the start, the solver, and what is kept of the run.

Each part checks what it can know alone when it is made; `Scenario` checks what needs the arm or several parts.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from armwright.entry import expect
from armwright.errors import ScenarioError
from armwright.interfaces import Sensor
from armwright.kernels.compiled import CPU
from armwright.notebook import stated
from armwright.parameters import UNSET, NumbersOrNone
from armwright.results.reducers import reducer
from armwright.simulation.checks import check_choice, check_time, check_whole
from armwright.simulation.integrate.events import EventFunction
from armwright.simulation.integrate.integrators import RULES, TOLERANCES
from armwright.simulation.integrate.stepping import Adaptivity
from armwright.simulation.loop.command_filter import CommandFilter
from armwright.simulation.loop.controller import check_controller
from armwright.simulation.loop.sensors import Sensors
from armwright.simulation.loop.timing import Timing

MOST_FIXED = 10**6  # substeps of a period, in which nothing can be interrupted
KEPT = ("all", "state", "none")


@dataclass(frozen=True, eq=False)
class Loop:
    """A sampled loop: what is measured, who commands, and what becomes of commands on their way to the drives.

    Args:
        controller: a plain function (t, r, y) → u, or a `Controller` with memory; None: `Simulation.step` takes the commands.
        reference: where the controller is to bring the arm: a pose, rows, a Schedule of poses or a `Trajectory`, a function of
            time; default: the initial position.
        period: [s] from sample to sample; default: the solver's step times its substeps.
        sensors: an `aw.Sensors`, or several sensors; default: joint positions, velocities and currents, exactly.
        command_filter: rate limit, limit and resolution of the controller's output; default: none.
        timing: delays, jitter and losses; default: none.
        initial_command: (n,) in force before the first tick; default: what holds the arm, within its drives' limits.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> control = aw.JointPID(kp=[900.0, 250.0], kd=[180.0, 50.0], gravity=True)
        >>> move = aw.trajectories.Quintic([0.0, 0.0], [0.5, -0.5], duration=0.5)
        >>> loop = aw.Loop(control, move, period=0.002)
        >>> run = aw.simulate(aw.Scenario("two-link", 0.8, loop=loop))
        >>> run.q.values[-1].round(2)
        array([ 0.51, -0.49])
    """

    controller: Any = None
    reference: Any = None
    period: float | None = None
    sensors: Sensors | Sequence[Sensor] = field(default_factory=Sensors)
    command_filter: CommandFilter = field(default_factory=CommandFilter)
    timing: Timing = field(default_factory=Timing)
    initial_command: Any = None

    def __repr__(self) -> str:
        return stated(self)

    def __post_init__(self) -> None:
        if self.controller is not None:
            check_controller(self.controller)
        if self.period is not None:
            check_time("loop.period", self.period)
        for name, kind in (("command_filter", CommandFilter), ("timing", Timing)):
            expect(getattr(self, name), kind, f"loop.{name}", f"an aw.{kind.__name__}(…)", ScenarioError)
        self._check_sensors()

    def _check_sensors(self) -> None:
        several = isinstance(self.sensors, (list, tuple))
        if not (several or isinstance(self.sensors, Sensors)) or not all(
            isinstance(each, Sensors) or (hasattr(each, "signals") and hasattr(each, "measure"))
            for each in self.sensor_list
        ):
            expected = "an aw.Sensors(…), or a list of sensors with the methods signals and measure"
            raise ScenarioError(place="loop.sensors", value=self.sensors, expected=expected)
        if sum(isinstance(each, Sensors) for each in self.sensor_list) > 1:
            raise ScenarioError("two aw.Sensors", place="loop.sensors", expected="one, and other sensors beside it")

    @property
    def sensor_list(self) -> tuple[Sensor, ...]:
        """All sensors, those of the joints first."""
        sensors = tuple(self.sensors) if isinstance(self.sensors, (list, tuple)) else (self.sensors,)
        joints = [each for each in sensors if isinstance(each, Sensors)] or [Sensors()]
        return (joints[0], *(each for each in sensors if each is not joints[0]))  # type: ignore[return-value]

    @property
    def joint_sensors(self) -> Sensors:
        """Sensors of the joints."""
        return next(each for each in self.sensor_list if isinstance(each, Sensors))


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of the arm beside its commands.

    Args:
        wrench: of the environment on the tip, in base axes: (6,) [N, N m], or a Schedule of the columns fx, fy, fz, mx, my,
            mz, held from row to row.
        brake: 1 where the holding brakes of the record are applied, 0 where they are released: one for all, (brakes,),
            or a Schedule with a column for every joint that has one; absent: released.
        supply: [V] of the supply of all drives, such as a log has it, in place of what the record says: one number, or a
            Schedule of the column `supply`.
        enabled: 1 where servos are on, 0 where they are off: one for all, (servos,), or a Schedule with a column for every
            joint whose command is a position; absent: on.
        payload: what the end effector takes up and puts down: a `Payload` or several, in the order of their times.
    Example:
        >>> push = aw.Inputs(wrench=[0.0, 50.0, 0.0, 0.0, 0.0, 0.0])  # 50 N on the tip
        >>> scenario = aw.Scenario("two-link", 0.2, command=[84.366, 15.696], inputs=push)
        >>> aw.simulate(scenario).q.values[-1].round(3)
        array([-0.058,  1.098])
    """

    wrench: Any = None
    brake: Any = None
    payload: Any = None
    supply: Any = None
    enabled: Any = None


@dataclass(frozen=True, eq=False)
class Start:
    """Initial positions and speeds.

    Args:
        q: (n,) [rad | m], default 0.   qd: (n,) [rad/s | m/s], default 0.
    Example:
        >>> start = aw.Start(q=[0.5, -0.2], qd=[1.0, 0.0])
        >>> scenario = aw.Scenario("two-link", 0.2, command=[0.0, 0.0], start=start)
        >>> aw.simulate(scenario).qd.values[0]
        array([1., 0.])
    """

    q: NumbersOrNone = UNSET
    qd: NumbersOrNone = UNSET


@dataclass(frozen=True, eq=False)
class Solver:
    """Integrator and its steps.

    By default ("auto") every lane takes as many substeps of each tick as its own error asks for, by a rule that suits the arm.

    Args:
        integrator: a name of `integrators.RULES`: "auto"; with a fixed step "rk3", "rk4", "semi_implicit_euler"; "rk45", and
            "rodas3" for stiff arms, which choose their steps within each tick; or "cvodes", slow and accurate, for some lanes.
        accuracy: of "auto": how wrong a run may be at its end, in parts of each quantity's range; default 1e-3.
        horizon: [s] of "auto" where nothing is sampled: how long a run is to keep its accuracy; default the scenario's duration,
            and `OPEN_ENDED` of one that has none.
        step: [s] of a rule of fixed step, default 1 ms; in a loop with a period it is that over `substeps`. With "auto", a step
            or a number of substeps is taken as it is, by "rk3".
        substeps: steps in each period of a loop.
        rtol, atol: of "rk45", "rodas3" and "cvodes": what each entry of the state may be wrong by in a step, in its own unit;
            default `TOLERANCES`.
        max_substeps: of "auto", "rk45" and "rodas3" in each millisecond of a tick, or in a tick that is shorter; a lane that
            needs more is frozen and marked; default 1000.
        events: of "rk45" and "rodas3", by name: functions (t, x) of time and state; their changes of sign are found and reported,
            as `events.joint_stops` makes them.
        target: processor level to compile for, as in `compile`.
        device: "cpu", or "cuda" for a GPU, "cuda:1" for the second one, on which each lane is a thread; as in `compile`.
        global_error: of "auto": whether a few lanes are simulated again at a tenth of the accuracy, by which a run says how wrong
            it is as a whole, in `global_error`; not where counts or command steps decide.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> solver = aw.Solver(step=1e-3, integrator="rk4")
        >>> scenario = aw.Scenario("two-link", 0.2, command=[0.0, 0.0], solver=solver)
        >>> aw.simulate(scenario).q.values[-1].round(3)
        array([-0.256,  0.36 ])
    """

    integrator: Literal["auto", "rk3", "rk4", "semi_implicit_euler", "rk45", "rodas3", "cvodes"] = "auto"
    step: float | None = None
    substeps: int | None = None
    accuracy: float | None = None
    horizon: float | None = None
    rtol: float | None = None
    atol: float | None = None
    max_substeps: int | None = None
    events: Mapping[str, EventFunction] = field(default_factory=dict)
    target: str | None = None
    global_error: bool = True
    device: str = CPU

    def __post_init__(self) -> None:
        if not isinstance(self.global_error, bool):
            raise ScenarioError(place="solver.global_error", value=self.global_error, expected="true or false")
        if self.device != CPU and not re.fullmatch(r"cuda(:\d+)?", str(self.device)):
            raise ScenarioError(
                place="solver.device", value=self.device, expected='"cpu", "cuda", or "cuda:1" for the second GPU'
            )
        if self.step is not None:
            check_time("solver.step", self.step)
        check_choice("solver.integrator", self.integrator, tuple(RULES))
        if self.horizon is not None:
            check_time("solver.horizon", self.horizon)
            if self.rule != "auto":
                what = f"goes with integrator = 'auto' without a step, not {self.rule!r}"
                raise ScenarioError(what, place="solver.horizon", value=self.horizon)
        if self.substeps is not None:
            self._check_substeps(self.substeps)
        self._check_by_hand()
        _ = self.adaptivity  # which checks the others

    def _check_by_hand(self) -> None:
        """Refuses, with "auto", settings of steps that lanes choose beside a step or a number of them given by hand."""
        given = next((name for name in ("step", "substeps") if getattr(self, name) is not None), None)
        for name in ("accuracy", "max_substeps"):
            value = getattr(self, name)
            if self.integrator == "auto" and given is not None and value is not None:
                what = f"beside solver.{given}, which is taken as it is"
                raise ScenarioError(what, place=f"solver.{name}", value=value, expected="one of them")

    def _check_substeps(self, substeps: int) -> None:
        check_whole("solver.substeps", substeps, 1)
        if substeps > MOST_FIXED:
            expected = f"at most {MOST_FIXED}, or a shorter loop.period"
            raise ScenarioError(place="solver.substeps", value=substeps, expected=expected)
        if self.rule in TOLERANCES and substeps != 1:
            raise ScenarioError(f"{self.rule} chooses its own", place="solver.substeps", value=substeps, expected="1")

    @property
    def rule(self) -> str:
        """The rule: "rk3" where "auto" has a step or a number of substeps given by hand."""
        by_hand = self.step is not None or self.substeps is not None
        return "rk3" if self.integrator == "auto" and by_hand else self.integrator

    @property
    def adaptivity(self) -> Adaptivity | None:
        """Step control of the rule; None for rules of fixed step."""
        return Adaptivity.of(
            self.rule,
            accuracy=self.accuracy,
            rtol=self.rtol,
            atol=self.atol,
            max_substeps=self.max_substeps,
            events=self.events,
        )


@dataclass(frozen=True, eq=False)
class Recording:
    """Rows and numbers that a run keeps.

    Args:
        period: [s] from row to row, a whole number of steps or periods of a loop; default: 1 ms where steps are "auto" and
            nothing is sampled, else `every`.
        every: rows are kept every so many steps, or periods of a loop, default 1; 0 keeps the first and the last state only.
        what: "all", or "state" for q and qd alone, which many lanes over many rows may want, or "none" beside `reduce`.
        reduce: names of `reducers.REDUCERS`, computed for each joint while the loop runs: ("rms_error", "peak_voltage", …).
        reference: what `reduce` measures errors from where commands are given over time; a loop has its own.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> recording = aw.Recording(period=0.05)
        >>> scenario = aw.Scenario("two-link", 0.2, command=[0.0, 0.0], recording=recording)
        >>> aw.simulate(scenario).time.values.round(2)
        array([0.  , 0.05, 0.1 , 0.15, 0.2 ])
    """

    every: int | None = None
    what: Literal["all", "state", "none"] = "all"
    reduce: Sequence[str] = ()
    reference: Any = None
    period: float | None = None

    def __post_init__(self) -> None:
        if self.period is not None:
            check_time("recording.period", self.period)
            if self.every is not None:
                raise ScenarioError(
                    "beside recording.every", place="recording.period", value=self.period, expected="one of them"
                )
        if self.every is not None:
            check_whole("recording.every", self.every, 0)
        check_choice("recording.what", self.what, KEPT)
        if not isinstance(self.reduce, (list, tuple)):
            expected = "a list of names, such as ['rms_error']"
            raise ScenarioError(place="recording.reduce", value=self.reduce, expected=expected)
        for name in self.reduce:
            reducer(name)
        if self.what == "none" and not self.reduce:
            raise ScenarioError(
                "stores nothing", place="recording.what", value="none", expected="reduce = ['rms_error', …] beside it"
            )
        if self.reference is not None and not self.reduce:
            raise ScenarioError(
                "goes with recording.reduce; where an arm is to go is the reference of a loop, and commands over time a schedule",
                place="recording.reference",
            )

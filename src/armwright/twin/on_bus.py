"""A scenario as run over a bus: measurements, commands and delays limited to those that frames can carry.

    positions in counts, torques in thousandths ─→ speeds from positions ─→ the controller ─→ commands in thousandths

The controller of such a scenario rounds what it sees to what the bus carries before anything else. So it computes the same
bits in the simulation, from the plant's exact state, and at the master, from frames.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.control.wrapper import Wrapper
from armwright.entry import AnyScenario, as_scenario
from armwright.errors import BusError, Problem, ScenarioError
from armwright.export.controller.stages import check_one_arm
from armwright.features import Support
from armwright.interfaces import JointReference, Measurement
from armwright.kernels.compiled import CPU
from armwright.model import Model
from armwright.scalar import Array, Scalar
from armwright.simulation.loop.command_filter import WHOLE, CommandFilter
from armwright.simulation.loop.references import reference_layout
from armwright.simulation.loop.sensors import Sensors
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Loop, Recording
from armwright.twin.bus import BITRATE, BusLoad, node_numbers
from armwright.twin.units import COUNTS_PER_METRE, COUNTS_PER_TURN, BusUnits

SUPPORT = Support(
    "twin",
    scenario=True,
    without_effect={"brakes": "they are released while drives are enabled, unless inputs.brake applies them"},
    refused={
        "coupled motors": "one drive for each joint",
        "stops": "its limits",
        "coasting": "command = 'voltage'",
        "dead zone": "command = 'voltage'",
        "servos": "command = 'current' or 'torque'",
        "commands over time": "no sampled loop",
        "moving start": "brakes hold it until it is enabled",
        "lanes": "one arm",
    },
)


@dataclass(frozen=True, eq=False)
class OnBus(Wrapper):
    """A controller whose measurements and commands are rounded as in frames.

    Attributes:
        units: of the bus.   sensors: that make speeds of positions.
    """

    units: Any = field(kw_only=True)
    sensors: Sensors = field(kw_only=True)

    def init(self, arm: Model, y: Measurement) -> Array:
        """Initial memory: that of the speed filter, then the inner controller's."""
        seen = self._carried(y)
        memory = self.sensors.init(self._view(seen, scalar.zeros(arm.n)))
        inner = super().init(arm, replace(seen, qd=scalar.zeros(arm.n)))
        return scalar.array(np.concatenate([memory, inner]))

    def step(self, t: Scalar, r: JointReference, y: Measurement, s: Array) -> tuple[Array, Array]:
        """One tick: commands (n,), rounded to thousandths, and the next state."""
        assert self.arm is not None
        seen = self._carried(y)
        zero = scalar.zeros(self.arm.n)
        size = len(self.sensors.init(self._view(seen, zero)))
        values, memory = self.sensors.measure(self._view(seen, zero), s[:size], np.zeros(0))
        u, state = super().step(t, r, replace(seen, qd=values["qd"]), s[size:])
        return u, scalar.array(np.concatenate([memory, state]))

    def memory(self, arm: Model, y: Measurement) -> Array:
        """Initial memory: empty."""
        return np.zeros(0)

    def changed(self, r: JointReference, y: Measurement, u: Array, s: Array) -> tuple[Array, Array]:
        """The command, rounded to thousandths of the rated torque."""
        return self.units.command(self.units.thousandths(u)), s

    def _carried(self, y: Measurement) -> Measurement:
        """A measurement as frames carry it; speeds are made of it later."""
        applied = self.units.command(self.units.thousandths(y.applied))
        assert self.arm is not None
        current = scalar.array(
            [
                u if body.drive.command == "current" else np.nan * u
                for body, u in zip(self.arm.coordinates, applied, strict=True)
            ]
        )
        return Measurement(self.units.position(self.units.counts(y.q)), y.qd, current, applied)

    def _view(self, y: Measurement, qd: Array) -> Any:
        """The plant as sensors see it, known by its frames alone."""
        return SimpleNamespace(arm=self.arm, period=self.period, q=y.q, qd=qd, current=y.current)


def scenario_on_bus(scenario: AnyScenario, *, bitrate: int = BITRATE, nodes: Sequence[int] | None = None) -> Scenario:
    """The scenario as run over a bus: commands and measurements in bus units, with the delays of frames.

    Args:
        scenario: with a sampled loop, a controller, and an arm whose drives take currents or torques.
        bitrate: [bit/s].   nodes: numbers of the joints' nodes, to be checked; default: from 3.
    Returns:
        scenario: with positions in counts, speeds made of them, commands in thousandths of the rated torque, which act at the
            first SYNC behind their arrival.
    Raises:
        BusError: all that is wrong: no loop, controller or duration; an arm that moves at the start; a reference without
            positions of the joints; a resolution of commands; a measurement that frames do not carry; an arm without limits,
            or with drives that take voltages; a period that the bus or object 60C2 does not hold; nodes that are none.
    Example:
        >>> speed = aw.Cascade(10.0, speed_kp=[15, 21, 16, 15, 1.4, 1.3], speed_ki=100.0)
        >>> move = aw.trajectories.Quintic(np.zeros(6), np.full(6, 0.1), duration=1.0)
        >>> scenario = aw.Scenario("lwa4p", 1.0, loop=aw.Loop(speed, move, period=0.004))
        >>> aw.bus.scenario_on_bus(scenario).loop.timing.preset
        'sync'
    """
    scenario, problems = checked_run(scenario, "thousandths of the rated torque")
    assert scenario.loop is not None
    units, sensors, loop = _carried(scenario, bitrate, nodes, problems)
    limit = units.limit if loop.command_filter.limit is None else loop.command_filter.limit
    limit = np.minimum(np.broadcast_to(np.asarray(limit, dtype=float), scenario.arm.n), units.limit)
    limit = np.floor(limit / units.thousandth + WHOLE) * units.thousandth
    command_filter = replace(loop.command_filter, limit=limit, resolution=units.thousandth)
    law = OnBus(loop.controller, units=units, sensors=sensors.exact())
    return replaced(scenario, loop=replace(loop, controller=law, command_filter=command_filter))


def checked_run(scenario: AnyScenario, commands: str) -> tuple[Scenario, list[Problem]]:
    """A scenario that a controller may run over any bus, with what is wrong with it.

    Args:
        scenario: with a controller.   commands: over the bus, in words.
    Raises:
        BusError: several arms, or no controller.
    """
    scenario = as_scenario(scenario)
    with as_bus_error():
        check_one_arm(scenario)
    if scenario.loop is None or scenario.controller is None:
        raise BusError("no controller", place="loop.controller", expected="one that drives the arm over the bus")
    n, problems = scenario.arm.n, []
    if scenario.solver.device != CPU:
        expected = f'"{CPU}", where a controller waits for its bus'
        problems.append(Problem(place="solver.device", value=scenario.solver.device, expected=expected))
    if scenario.duration is None:
        expected = "a time above 0 [s] that the controller runs for"
        problems.append(Problem(place="duration", value=None, expected=expected))
    resolution = scenario.loop.command_filter.resolution
    if resolution is not None:
        expected = f"none: commands over the bus are {commands}"
        problems.append(Problem("", "loop.command_filter.resolution", resolution, expected))
    followed = reference_layout(scenario.arm, scenario.reference).signals
    if not followed or (followed[0].name, followed[0].size) != ("q", n):
        expected = "q as its first signal, by which the master watches the arm"
        problems.append(Problem("has no positions of the joints", "loop.reference", expected=expected))
    return scenario, problems


def plant_on_bus(scenario: Scenario, *, bitrate: int = BITRATE) -> Scenario:
    """The plant's part of `scenario_on_bus`, with commands from outside; the scenario needs no controller.

    Args:
        scenario: with a sampled loop.   bitrate: [bit/s].
    Raises:
        BusError: as `scenario_on_bus`.
    """
    scenario = as_scenario(scenario)
    with as_bus_error():
        check_one_arm(scenario)
    _, _, loop = _carried(scenario, bitrate)
    loop = replace(loop, controller=None, reference=None, command_filter=CommandFilter())
    inputs = replace(scenario.inputs, payload=scenario.carried)  # also what the reference takes up, which stays behind
    return replaced(scenario, loop=loop, inputs=inputs, duration=None, recording=Recording(what="state"))


def _carried(
    scenario: Scenario, bitrate: int, nodes: Sequence[int] | None = None, problems: Sequence[Problem] = ()
) -> tuple[BusUnits, Sensors, Loop]:
    """The units of the bus, the sensors that make speeds of positions, and the loop with what the bus does to both ends of it.

    Raises:
        BusError: all that is wrong, these problems first.
    """
    loop, arm = scenario.loop, scenario.arm
    if loop is None:
        raise BusError("no sampled loop", place="loop", expected="one with a period, that drives the arm over the bus")
    load, found = BusLoad(arm.n, scenario.tick, bitrate), list(problems)
    if np.any(scenario.initial_state[0, arm.n : 2 * arm.n]):
        expected = "0: brakes hold it until it is enabled"
        found.append(Problem("the arm moves at the start", "start.qd", expected=expected))
    for check in (
        load.check,
        lambda: BusUnits.of(scenario),
        lambda: speeds_on_bus(scenario),
        lambda: node_numbers(nodes, arm.n),
    ):
        try:
            check()
        except BusError as error:
            found += error.problems
    if found:
        raise BusError.of(*found)
    sensors = speeds_on_bus(scenario)
    delay = loop.timing.command_delay + load.cycle(stuffed=True)
    timing = replace(loop.timing, preset="sync", command_delay=delay)
    measured = replace(sensors, velocity="exact", cutoff_hz=None)  # speeds are made of positions at the other end
    return BusUnits.of(scenario), sensors, replace(loop, period=scenario.tick, sensors=measured, timing=timing)


def replaced(scenario: Scenario, **changes: Any) -> Scenario:
    """The scenario with other fields.

    Raises:
        BusError: fields that contradict each other.
    """
    with as_bus_error():
        return replace(scenario, **changes)


@contextlib.contextmanager
def as_bus_error() -> Iterator[None]:
    """Refuses a scenario as one that a bus cannot carry."""
    try:
        yield
    except ScenarioError as error:
        raise BusError.of(*error.problems) from None


def speeds_on_bus(scenario: Scenario) -> Sensors:
    """The sensors of a scenario with a loop, as they measure the positions that frames carry, and make speeds of them.

    Raises:
        BusError: further sensors, noise or a side that frames do not carry.
    """
    loop, arm = scenario.loop, scenario.arm
    assert loop is not None
    sensors = loop.joint_sensors
    problems = []
    if len(loop.sensor_list) > 1:
        expected = "those of the joints, which frames carry"
        problems.append(Problem("further sensors", "loop.sensors", expected=expected))
    elastic = [body.joint for body in arm.coordinates if body.elasticity is not None]
    if sensors.side == "motor" and (sensors.counts is not None or elastic):
        what = f"joint {elastic[0]!r} is elastic: motor and link are at two places" if elastic else ""
        expected = "side = 'link' in [loop.sensors]: the drives send positions of the joints"
        problems.append(Problem(what, "loop.sensors.side", "motor", expected))
    for name in ("velocity_noise", "current_noise"):
        if np.any(np.asarray(getattr(sensors, name)) != 0.0):
            expected = "0: speeds are made of positions, and torques are what the drives command"
            problems.append(Problem("", f"loop.sensors.{name}", getattr(sensors, name), expected))
    if problems:
        raise BusError.of(*problems)
    linear = any(body.kind.units.linear for body in arm.coordinates)
    metre = (COUNTS_PER_METRE if sensors.counts_per_m is None else sensors.counts_per_m) if linear else None
    counts = COUNTS_PER_TURN if sensors.counts is None else sensors.counts
    velocity = "difference" if sensors.velocity == "exact" else sensors.velocity
    return replace(sensors, side="link", counts=counts, counts_per_m=metre, velocity=velocity)

"""A scenario as run over a bus: measurements, commands and delays limited to those that frames can carry.

    positions in counts, torques in thousandths ─→ speeds from positions ─→ the law ─→ commands in thousandths

The controller of such a scenario rounds what it sees to what the bus carries before anything else. So it computes the same
bits in the simulation, from the plant's exact state, and at the master, from frames.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.control.wrapper import Wrapper
from armwright.errors import BusError, ScenarioError
from armwright.export.controller.stages import check_one_arm
from armwright.interfaces import JointReference, Measurement
from armwright.model import Model
from armwright.scalar import Array, Scalar
from armwright.simulation.loop.command_filter import WHOLE, CommandFilter
from armwright.simulation.loop.sensors import Sensors
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Loop, Recording
from armwright.twin.bus import BITRATE, BusLoad
from armwright.twin.units import COUNTS_PER_METRE, COUNTS_PER_TURN, Units


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


def scenario_on_bus(scenario: Scenario, *, bitrate: int = BITRATE) -> Scenario:
    """The scenario as run over a bus: commands and measurements in bus units, with the delays of frames.

    Args:
        scenario: with a sampled loop, a controller, and an arm whose drives take currents or torques.
        bitrate: [bit/s].
    Returns:
        scenario: with positions in counts, speeds made of them, commands in thousandths of the rated torque, which act at the
            first SYNC behind their arrival.
    Raises:
        BusError: no loop; a measurement that frames do not carry; an arm without limits, or with drives that take voltages; a
            period that the bus or object 60C2 does not hold.
    """
    with _as_bus_error():
        check_one_arm(scenario)
    if scenario.controller is None:
        raise BusError("no controller", place="loop.controller", expected="one that drives the arm over the bus")
    units, sensors, loop = _carried(scenario, bitrate)
    limit = units.limit if loop.command_filter.limit is None else loop.command_filter.limit
    limit = np.minimum(np.broadcast_to(np.asarray(limit, dtype=float), scenario.arm.n), units.limit)
    limit = np.floor(limit / units.thousandth + WHOLE) * units.thousandth
    command_filter = replace(loop.command_filter, limit=limit, resolution=units.thousandth)
    law = OnBus(loop.controller, units=units, sensors=sensors.exact())
    return _replaced(scenario, loop=replace(loop, controller=law, command_filter=command_filter))


def plant_on_bus(scenario: Scenario, *, bitrate: int = BITRATE) -> Scenario:
    """The plant's part of `scenario_on_bus`, with commands from outside; the scenario needs no controller.

    Args:
        scenario: with a sampled loop.   bitrate: [bit/s].
    Raises:
        BusError: as `scenario_on_bus`.
    """
    with _as_bus_error():
        check_one_arm(scenario)
    _, _, loop = _carried(scenario, bitrate)
    loop = replace(loop, controller=None, reference=None, command_filter=CommandFilter())
    return _replaced(scenario, loop=loop, duration=None, recording=Recording(what="state"))


def _carried(scenario: Scenario, bitrate: int) -> tuple[Units, Sensors, Loop]:
    """The units of the bus, the sensors that make speeds of positions, and the loop with what the bus does to both ends of it."""
    loop, arm = scenario.loop, scenario.arm
    if loop is None:
        raise BusError("no sampled loop", place="loop", expected="one with a period, that drives the arm over the bus")
    units, load = Units.of(scenario), BusLoad(arm.n, scenario.tick, bitrate)
    load.check()
    sensors = _speeds(scenario)
    delay = loop.timing.command_delay + load.cycle(stuffed=True)
    timing = replace(loop.timing, preset="sync", command_delay=delay)
    measured = replace(sensors, velocity="exact", cutoff_hz=None)  # speeds are made of positions at the other end
    return units, sensors, replace(loop, period=scenario.tick, sensors=measured, timing=timing)


def _replaced(scenario: Scenario, **changes: Any) -> Scenario:
    with _as_bus_error():
        return replace(scenario, **changes)


@contextlib.contextmanager
def _as_bus_error() -> Iterator[None]:
    """Refuses a scenario as one that a bus cannot carry."""
    try:
        yield
    except ScenarioError as error:
        raise BusError.of(*error.problems) from None


def _speeds(scenario: Scenario) -> Sensors:
    """The sensors, as they measure what frames carry."""
    loop, arm = scenario.loop, scenario.arm
    assert loop is not None
    sensors = loop.joint_sensors
    if len(loop.sensor_list) > 1:
        raise BusError("further sensors", place="loop.sensors", expected="those of the joints, which frames carry")
    if sensors.side == "motor" and sensors.counts is not None:
        expected = "side = 'link': the drives send positions of the joints"
        raise BusError(place="loop.sensors.side", value="motor", expected=expected)
    elastic = [body.joint for body in arm.coordinates if body.elasticity is not None]
    if elastic and sensors.side == "motor":
        what = f"joint {elastic[0]!r} is elastic: motor and link are at two places"
        raise BusError(what, place="loop.sensors.side", value="motor", expected="'link'")
    for name in ("velocity_noise", "current_noise"):
        if np.any(np.asarray(getattr(sensors, name)) != 0.0):
            expected = "0: speeds are made of positions, and torques are what the drives command"
            raise BusError(place=f"loop.sensors.{name}", value=getattr(sensors, name), expected=expected)
    linear = any(body.kind == "prismatic" for body in arm.coordinates)
    metre = (COUNTS_PER_METRE if sensors.counts_per_m is None else sensors.counts_per_m) if linear else None
    counts = COUNTS_PER_TURN if sensors.counts is None else sensors.counts
    velocity = "difference" if sensors.velocity == "exact" else sensors.velocity
    return replace(sensors, side="link", counts=counts, counts_per_m=metre, velocity=velocity)

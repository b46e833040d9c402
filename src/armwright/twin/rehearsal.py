"""Rehearsal: a run over a bus, simulated beforehand, with its commands, ranges and speeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright.errors import BusError, ScenarioError
from armwright.export.controller.recording import Recording, record
from armwright.export.controller.stages import ControllerStages
from armwright.simulation.scenario import Scenario
from armwright.twin.bus import BITRATE, BusLoad
from armwright.twin.drive import SPEEDING
from armwright.twin.on_bus import scenario_on_bus
from armwright.twin.units import Units


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """A simulated run over a bus.

    Attributes:
        scenario: as it runs over the bus.   stages: the controller's programs.   recording: references, measurements, commands.
        load: of the bus.   units: of the bus.
    """

    scenario: Scenario
    stages: ControllerStages
    recording: Recording
    load: BusLoad
    units: Units

    @property
    def q(self) -> np.ndarray:
        """(ticks, n) measured positions [rad | m]."""
        return self.recording.y[:, : self.scenario.arm.n]

    @property
    def reference(self) -> np.ndarray:
        """(ticks, n) reference positions [rad | m]."""
        return self.recording.r[:, : self.scenario.arm.n]

    @property
    def largest_error(self) -> np.ndarray:
        """(n,) the largest difference of reference and measured position [rad | m]."""
        return np.abs(self.reference - self.q).max(axis=0)

    @property
    def largest_speed(self) -> np.ndarray:
        """(n,) [rad/s | m/s] between successive samples that arrived."""
        came = np.flatnonzero(~self.recording.lost)
        steps = np.diff(self.q[came], axis=0) / np.diff(came)[:, None]
        return np.abs(steps).max(axis=0, initial=0.0) / self.stages.period

    @property
    def largest_command(self) -> np.ndarray:
        """(n,) the largest command, as a share of the rated one."""
        return np.abs(self.recording.u).max(axis=0) / self.units.limit

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """By joint: its name, range, largest speed, torque and error, as text."""
        arm = self.scenario.arm
        return [
            (
                name,
                f"{self.q[:, i].min():.4g} … {self.q[:, i].max():.4g}",
                f"{self.largest_speed[i]:.3g} of {arm.coordinates[i].limits.velocity:.3g}",
                f"{self.largest_command[i]:.0%}",
                f"{self.largest_error[i]:.3g}",
            )
            for i, name in enumerate(arm.names)
        ]


def rehearse(scenario: Scenario, *, bitrate: int = BITRATE) -> Rehearsal:
    """The simulated run of a scenario's controller over a bus.

    Args:
        scenario: as it was written, without a bus.   bitrate: [bit/s].
    Returns:
        rehearsal: of all ticks, whose limits were checked.
    Raises:
        BusError: a scenario that a bus cannot carry, or a motion beyond the limits of the record; names the joint.
        ScenarioError: a controller that cannot be traced, or a motion that diverges.
    """
    on_bus = scenario_on_bus(scenario, bitrate=bitrate)
    if on_bus.duration is None:
        raise ScenarioError(place="duration", value=None, expected="a time above 0 [s] that the controller runs for")
    n = scenario.arm.n
    if np.any(on_bus.initial_state[0, n : 2 * n]):
        raise BusError("the arm moves at the start", place="start.qd", expected="0: brakes hold it until it is enabled")
    stages = ControllerStages.of(on_bus)
    rehearsal = Rehearsal(
        on_bus,
        stages,
        record(stages, on_bus.ticks),
        BusLoad(n, on_bus.tick, bitrate),
        Units.of(on_bus),
    )
    _check_limits(rehearsal)
    return rehearsal


def _check_limits(rehearsal: Rehearsal) -> None:
    """Refuses motions beyond the limits of joints."""
    period, units = rehearsal.stages.period, rehearsal.units
    for i, body in enumerate(rehearsal.scenario.arm.coordinates):
        low, high = body.limits.position
        for name, path in (("reference", rehearsal.reference[:, i]), ("position", rehearsal.q[:, i])):
            beyond = (path < low - units.count[i]) | (path > high + units.count[i])
            if np.any(beyond):
                tick = int(np.argmax(beyond))
                what = f"the {name} is {path[tick]:.4g} at {tick * period:g} s"
                raise BusError(what, place=f"joint {body.joint!r}", expected=f"{low:.4g} to {high:.4g}, its limits")
        fastest = rehearsal.largest_speed[i]
        if fastest > SPEEDING * body.limits.velocity:
            expected = f"at most {body.limits.velocity:g}, its limit, and {SPEEDING - 1.0:.0%} of it more in passing"
            raise BusError(f"its speed is {fastest:.4g}", place=f"joint {body.joint!r}", expected=expected)

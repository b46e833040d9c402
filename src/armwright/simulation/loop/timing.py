"""Timing of measurements and commands: delays, jitter, lost samples, the drive's own clock. Design section 4.

Time is counted in base ticks of Ts. A delay is (m + φ) Ts with whole m and 0 ≤ φ < 1. The whole part is a queue of the loop; the
fraction of a measurement is true earlier sampling of the plant, that of a command a change between ticks.

    arrival of command k:   a = k + delay + jitter,   jitter uniform in [0, J)
    at its drive:           a, or the drive's next own tick (c + ψ)(1 + ε) where it has a clock of its own
    in force at time τ:     the newest command with a ≤ τ: a late one that is overtaken is dropped
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Any, Literal

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.kernels.stages import NEVER
from armwright.parameters import ZERO, Numbers, lane_values
from armwright.scalar import Array, Scalar
from armwright.simulation.checks import check_choice, check_numbers

PRESETS = (
    "ideal",  # a command acts when it is computed, at once
    "one-tick",  # computed during the period, applied at its end: most firmware
    "sync",  # CiA 402: latched at SYNC k, applied at SYNC k + 1, or the first SYNC behind its arrival
)
TIMES = ("measurement_delay", "command_delay", "jitter")
WHOLE = 1e-9  # of a tick: a delay this near a whole number is meant to be it
MOST_TICKS, QUEUED = 1_000_000, "all commands and measurements of that time are held"
MOST_JITTER, UNDER_WAY = 64, "so many commands may be under way at once, and each is compiled"


@dataclass(frozen=True)
class Timing:
    """Delays of the control loop; each number may be a `Batch`, one for each lane.

    Args:
        preset: "ideal", "one-tick" or "sync": when a command acts if nothing delays it further.
        measurement_delay: [s] how old a measurement is when the controller sees it.
        command_delay: [s] from the controller to the drive, beyond the preset's.
        jitter: [s] the most that a command is late beyond its delay, uniform.
        measurement_loss, command_loss: probability that a sample is lost; the last one is then repeated.
        clock_drift: (drive's period - master's) / master's, such as 50e-6; 0: both have one clock.
    Example:
        >>> control = aw.JointPID(kp=[900.0, 250.0], kd=[180.0, 50.0], gravity=True)
        >>> late = aw.Timing("one-tick", command_delay=0.001)
        >>> goal = aw.trajectories.Step([0.0, 0.0], [0.5, -0.5])
        >>> loop = aw.Loop(control, goal, 0.002, timing=late)
        >>> aw.simulate(aw.Scenario("two-link", 1.0, loop=loop)).q.values[-1].round(2)
        array([ 0.5, -0.5])
    """

    preset: Literal["ideal", "one-tick", "sync"] = "ideal"
    measurement_delay: Numbers = ZERO
    command_delay: Numbers = ZERO
    jitter: Numbers = ZERO
    measurement_loss: Numbers = ZERO
    command_loss: Numbers = ZERO
    clock_drift: Numbers = ZERO

    def __post_init__(self) -> None:
        check_choice("timing.preset", self.preset, PRESETS)
        for name in TIMES:
            self._check(name, 0.0, np.inf, "a time of 0 s or more")
        for name in ("measurement_loss", "command_loss"):
            self._check(name, 0.0, 1.0, "a probability")
        self._check("clock_drift", -0.1, 0.1, "a number within ±0.1")

    def _check(self, name: str, low: float, high: float, expected: str) -> None:
        def fits(values: np.ndarray) -> np.ndarray:
            return (values >= low) & (values <= high) & np.isfinite(values)

        check_numbers(f"timing.{name}", getattr(self, name), fits, expected, batch=True)


@dataclass(frozen=True, eq=False)
class Delays:
    """A timing in ticks of one period, for the lanes of a run: whole ticks and fractions.

    Attributes:
        measured, commanded: (lanes or 1,) whole ticks.   earlier, later: (lanes or 1,) fractions φ; where jitter may carry a
            command past the next SYNC, `later` is below 2.
        jitter, drift, measurement_loss, command_loss: (lanes or 1,).
    """

    preset: str
    measured: np.ndarray
    earlier: np.ndarray
    commanded: np.ndarray
    later: np.ndarray
    jitter: np.ndarray
    drift: np.ndarray
    measurement_loss: np.ndarray
    command_loss: np.ndarray

    @classmethod
    def of(cls, timing: Timing, period: float) -> Delays:
        """A timing at a period [s].

        Raises:
            ScenarioError: a delay or jitter of more periods than can be held; names it and how many can.
        """

        def each(value: Any) -> np.ndarray:
            return lane_values(value).astype(float)

        def ticks(name: str, most: int, why: str) -> np.ndarray:
            seconds = each(getattr(timing, name))
            with np.errstate(over="ignore"):  # endless is refused as too many
                periods = seconds / period
            if periods.max() > most:
                what = f"{periods.max():.6g} periods of {period:g} s, and {why}"
                expected = f"at most {most} periods, {most * period:g} s"
                raise ScenarioError(what, place=f"loop.timing.{name}", value=float(seconds.max()), expected=expected)
            return periods

        measured, earlier = _split(ticks("measurement_delay", MOST_TICKS, QUEUED))
        delay, jitter = ticks("command_delay", MOST_TICKS, QUEUED), ticks("jitter", MOST_JITTER, UNDER_WAY)
        if timing.preset == "sync":
            commanded, later = _synchronous(delay, jitter)
        else:
            commanded, later = _split(delay + (timing.preset == "one-tick"))
        return cls(
            timing.preset,
            measured,
            earlier,
            commanded,
            later,
            jitter,
            each(timing.clock_drift),
            each(timing.measurement_loss),
            each(timing.command_loss),
        )

    @property
    def pending(self) -> int:
        """Commands that may wait at once behind the queue, beside the newest."""
        late = self.later + self.jitter
        if self.preset == "sync":
            late = np.maximum(np.ceil(late) - 1.0, 0.0) + (late > 1.0)
        return max(ceil((late + (self.drift != 0) * (1.0 + self.drift)).max()) - 1, 0)

    @property
    def fractional(self) -> bool:
        """True where a command acts between ticks, or is lost; else a queue is enough."""
        return any(np.any(part) for part in (self.later, self.jitter, self.drift, self.command_loss))


def lateness(delays: Delays, tick: Scalar, later: Scalar, jitter: Scalar, drift: Scalar, w: Scalar) -> Scalar:
    """Ticks after k at which a command that leaves the queue in tick k acts; w uniform in (0, 1)."""
    late = later + jitter * w
    if delays.preset == "sync":
        late = scalar.maximum(scalar.ceil(late) - 1.0, 0.0)
    if np.any(delays.drift):
        late = scalar.ceil((tick + late) / (1.0 + drift)) * (1.0 + drift) - tick
    return late


def _split(ticks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whole ticks and the fraction behind them."""
    near = np.rint(ticks)
    whole = np.where(np.abs(ticks - near) <= WHOLE, near, np.floor(ticks))
    return whole, np.clip(ticks - whole, 0.0, None) * (np.abs(ticks - near) > WHOLE)


def _synchronous(delay: np.ndarray, jitter: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whole ticks for the queue, and what is left of a delay [ticks], where commands act at the first SYNC behind their arrival.

    ⌈m + φ + j⌉ = m + ⌈φ + j⌉: whole ticks may wait in the queue, and all of the delay where there is no jitter j.
    """
    whole, part = _split(delay)
    certain = np.maximum(whole + np.ceil(part), 1.0)
    before = np.maximum(whole, 1.0)
    commanded = np.where(jitter > 0.0, before, certain)
    return commanded, np.where(jitter > 0.0, whole + part - (before - 1.0), 0.0)


def planned(
    tick: Scalar, issued: Array, late: Scalar, waiting: Array, arrivals: Array, base: Array
) -> tuple[np.ndarray, ...]:
    """Commands of a tick with their times, and the queue of those that wait.

    Args:
        tick: () k.   issued: (n,) the command that leaves the queue in this tick.
        late: () ticks after k at which it arrives; NEVER: lost.
        waiting: (P, n) commands under way, oldest first.   arrivals: (P,) ticks after k at which they arrive.
        base: (n,) the command in force when the tick begins.
    Returns:
        u_plan: (P + 2, n) base, what waits, the newest.
        u_from: (P + 1,) ticks into this one at which each but the first begins.
        waiting, arrivals, base: as they are when the next tick begins.
    """
    count = len(waiting)
    commands = [base, *waiting, issued]
    begins = [*arrivals, late]
    following = [NEVER] * (count + 1)  # an item that arrived, or that a newer one overtook, waits no longer
    newer_arrived = 0.0
    for k in reversed(range(count + 1)):
        arrived = scalar.less(begins[k], 1.0)
        gone = scalar.maximum(arrived, newer_arrived)
        following[k] = scalar.where(gone, NEVER, begins[k] - 1.0)
        newer_arrived = gone
    now = base
    for k in range(count + 1):
        now = scalar.where(scalar.less(begins[k], 1.0), commands[k + 1], now)
    return (
        scalar.stack(commands),
        scalar.array(begins),
        scalar.stack(commands[2:]) if count else np.zeros((0, len(base))),
        scalar.array(following[1:]),
        scalar.array(now),
    )

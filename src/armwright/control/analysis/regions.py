"""Regions of gains, and sample periods, for which a loop keeps its margins at all given poses."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.control.analysis.linear_loop import LinearLoop
from armwright.control.analysis.workspace import checked_poses
from armwright.control.gains import gain_units
from armwright.entry import AnyScenario, as_scenario
from armwright.errors import ScenarioError, check_known
from armwright.parameters import Batch, numbers_by_lane
from armwright.results.result import Result
from armwright.simulation.checks import check_choice
from armwright.simulation.scenario import Scenario

LONGER = 1.5  # from one period to the next that is tried
LONGEST = 400.0  # of the loop's own period
CLOSE = 1.02  # the same where a period of most poses is known
PERIOD_TOLERANCE = 1e-3  # of a period, between one that keeps the margins and one that does not
DELAYED = 40.0  # periods of a delay in seconds: beside it a shorter period decides nothing any more
WATCHED = 12  # poses that periods are tried with; each that the last one fails at joins them
OTHERS = ("closed", "held", "free")  # loops of the joints beside the one that is looked at
GAIN, PHASE = 2.0, math.radians(30.0)  # the margins that are usually asked for


@dataclass(frozen=True, eq=False)
class GainRegion(Result):
    """Pairs of gains of one joint that keep the margins at every pose, the other joints fixed.

    Attributes:
        joint: its name.   names: of the two gains.   values: of each, (rows,) and (columns,).
        keeps: (rows, columns) true where all poses keep the margins.   poses: how many.
        gain_margin, phase_margin: [-] and [rad] that are kept.   own: the controller's own two gains.
        units: of the two gains; "" where they are not known.
    """

    joint: str
    names: tuple[str, str]
    values: tuple[np.ndarray, np.ndarray]
    keeps: np.ndarray
    poses: int
    gain_margin: float
    phase_margin: float
    own: tuple[float, float]
    units: tuple[str, str]


def gain_region(
    scenario: AnyScenario,
    joint: str,
    gains: Mapping[str, Any],
    q: Any,
    *,
    gain_margin: float = GAIN,
    phase_margin: float = PHASE,
) -> GainRegion:
    """Region of two gains of one joint that keeps the margins at all poses, on a grid; all other gains are fixed.

    Args:
        scenario: with a controller.   joint: its name.   gains: two of the controller's fields, name → values.
        q: (poses, n) [rad | m].   gain_margin: factor either way.   phase_margin: [rad].
    Returns:
        region: which pairs keep them.
    Raises:
        ScenarioError: names that are none, or gains that are no numbers.
    Example:
        >>> scenario = aw.read_scenario("examples/bus-4ms.scenario.toml")
        >>> gains = {"position_kp": [2.0, 8.0, 32.0], "speed_kp": [5.0, 20.0]}
        >>> region = aw.loops.gain_region(scenario, "joint2", gains, np.zeros((1, 6)))
        >>> region.keeps
        array([[False,  True],
               [False,  True],
               [False, False]])
    """
    scenario = as_scenario(scenario)
    arm, control = LinearLoop(scenario).scenario.arm, scenario.controller  # which refuses what has no loop
    check_margins(gain_margin, phase_margin)
    check_known(ScenarioError, joint, arm.names, place="joint", expected="a joint")
    if not isinstance(gains, Mapping) or len(gains) != 2:
        raise ScenarioError(place="gains", value=gains, expected="two gains of the controller, {name: values}")
    known = [each.name for each in fields(control) if _is_gain(control, each.name)] if is_dataclass(control) else []
    for name in gains:
        if name not in known:
            expected = "a gain of the controller itself, the same in all lanes"
            raise ScenarioError(place="gains", value=name, expected=expected, choices=tuple(known))
    (first, second), values = gains, [_values(name, each) for name, each in gains.items()]
    place, batches, own = arm.names.index(joint), {}, []
    for name, grid in zip(gains, np.meshgrid(*values, indexing="ij"), strict=True):
        base = np.broadcast_to(np.asarray(scalar.real_numbers(getattr(control, name))), (arm.n,))
        rows = np.tile(base, (grid.size, 1))
        rows[:, place] = grid.ravel()
        batches[name] = Batch(rows)
        own.append(float(base[place]))
    assert scenario.loop is not None
    varied: Any = replace(control, **batches)  # type: ignore[type-var]
    loop = LinearLoop(Scenario(arm, scenario.tick, loop=replace(scenario.loop, controller=varied)))
    q = _some_poses(q, arm.n)
    keeps = np.ones(values[0].size * values[1].size, dtype=bool)
    for pose in q:
        rows = np.flatnonzero(keeps)
        if not rows.size:
            break
        slopes = loop.slopes(pose, loop.gains[rows], place)
        keeps[rows] = loop.keeps(slopes, gain_margin, phase_margin)
    shape = (values[0].size, values[1].size)
    return GainRegion(
        joint,
        (first, second),
        (values[0], values[1]),
        keeps.reshape(shape),
        len(q),
        gain_margin,
        phase_margin,
        (own[0], own[1]),
        (gain_units(arm, control, first)[place], gain_units(arm, control, second)[place]),
    )


def _is_gain(control: Any, name: str) -> bool:
    """True for a field that holds a number, or one for each joint, and no count of ticks."""
    value = getattr(control, name)
    if (
        isinstance(value, (bool, str))
        or value is None
        or isinstance(value, Batch)
        or name.endswith(("_every", "_phase"))
    ):
        return False
    try:
        return scalar.real_numbers(value).ndim <= 1
    except ValueError:
        return False


def _values(name: str, given: Any) -> np.ndarray:
    """Values (k,) of a gain of a grid."""
    try:
        values = np.atleast_1d(scalar.real_numbers(given))
    except ValueError:
        values = np.zeros((0, 0))
    if values.ndim != 1 or not values.size:
        raise ScenarioError(place=f"gains[{name!r}]", value=given, expected="numbers, one at least")
    return values


def _some_poses(q: Any, n: int) -> np.ndarray:
    """Poses (k, n), one at least."""
    poses = np.atleast_2d(checked_poses(q, n))
    if poses.ndim != 2 or not len(poses):
        raise ScenarioError(f"shape {poses.shape}", place="q", expected=f"poses (k, {n}), one at least")
    return poses


def usual_gains(control: Any) -> tuple[str, str] | None:
    """The two gains that a region is drawn over: position and speed gain; None if the controller has none."""
    for names in (("position_kp", "speed_kp"), ("kp", "kd"), ("kp", "ki")):
        values = [getattr(control, name, None) for name in names]
        if all(value is not None and np.ndim(value) <= 1 and np.all(np.asarray(value) > 0) for value in values):
            return names
    return None


def longest_period(
    scenario: AnyScenario, q: Any, *, gain_margin: float = 1.0, phase_margin: float = 0.0, others: str = "closed"
) -> tuple[float, float | None]:
    """Longest sample period at which a loop keeps its margins at all poses, with unchanged gains.

    Delays that the scenario states in seconds stay; those in periods (a preset) grow with the period.

    Args:
        scenario: with a controller.   q: (poses, n) [rad | m].
        gain_margin: factor either way; 1: stability alone.   phase_margin: [rad].
        others: "closed": the coupled loop of all joints; "held" or "free": every joint by itself, the others held still, or
            without torque. Of a joint with others whose loops are closed these two see the largest inertia and the least.
    Returns:
        period: [s]; 0 where not even a 400th of the loop's own keeps them, nor one far below a stated delay.
            One that is 0.1 % longer fails.
        failing: [s] the shortest that was seen to fail; None where even 400 times the loop's own keeps them.
    Example:
        >>> scenario = aw.read_scenario("examples/bus-4ms.scenario.toml")
        >>> period, failing = aw.loops.longest_period(scenario, np.zeros(6))
        >>> round(1e3 * period, 1)  # ms
        8.3
    """
    scenario = as_scenario(scenario)
    check_margins(gain_margin, phase_margin)
    check_choice("others", others, OTHERS)
    first = LinearLoop(scenario)
    if len(first.gains) > 1:
        what, expected = f"gains of {len(first.gains)} lanes", "one value of every gain"
        raise ScenarioError(what, place="loop.controller", expected=expected)
    q = _some_poses(q, scenario.arm.n)
    loops: list[int | None] = [None] if others == "closed" else list(range(scenario.arm.n))
    watched = list(range(0, len(q), -(-len(q) // WATCHED)))  # the others are looked at where these pass

    def failing(period: float, poses: np.ndarray) -> np.ndarray:
        try:
            loop = LinearLoop(scenario, period, first.plant)
        except ScenarioError:  # of a filter whose frequency such a period does not sample
            return np.arange(len(poses))
        each = (loop.slopes(poses, joint=joint, free=others == "free") for joint in loops)
        kept = [loop.keeps(slopes, gain_margin, phase_margin) for slopes in each]
        return np.flatnonzero(~np.all(kept, axis=0))

    assert scenario.loop is not None
    timing = scenario.loop.timing
    stated = sum(float(numbers_by_lane(each)[0]) for each in (timing.measurement_delay, timing.command_delay))
    low, high, least = first.period, np.inf, max(first.period / LONGEST, stated / DELAYED)
    while True:
        poses = q[watched]
        ends = (low, high, first.period, least)
        low, high = _bracket(lambda period, poses=poses: not failing(period, poses).size, *ends)
        lost = failing(low, q) if low > 0.0 else np.zeros(0, dtype=int)
        if not lost.size:
            return low, None if np.isinf(high) else high
        watched += lost[:: -(-len(lost) // WATCHED)].tolist()
        low, high = low / CLOSE, low


def _bracket(keeps: Callable[[float], bool], low: float, high: float, own: float, least: float) -> tuple[float, float]:
    """Longest feasible and shortest infeasible period, 0.1 % apart; 0 if no period is feasible, infinite if all are.

    Args:
        keeps: of a period [s].   low: where the search begins.   high: known to fail, or infinite.   own: of the loop.
        least: the shortest that is tried.
    """
    longer = LONGER if np.isinf(high) else CLOSE
    while not keeps(low):
        low, high = low / longer, low
        longer = LONGER
        if low < least:
            return 0.0, high
    while np.isinf(high):
        if LONGER * low > LONGEST * own:
            return low, high
        low, high = (low, LONGER * low) if not keeps(LONGER * low) else (LONGER * low, high)
    while high - low > PERIOD_TOLERANCE * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if keeps(middle) else (low, middle)
    return low, high


def longest_delay(scenario: Scenario, q: Any, *, gain_margin: float = 1.0, phase_margin: float = 0.0) -> float | None:
    """Longest delay, at most the loop's own, with which the coupled loop keeps its margins at all poses.

    Args:
        scenario: with a controller.   q: (poses, n) [rad | m].
        gain_margin: factor either way; 1: stability alone.   phase_margin: [rad].
    Returns:
        delay: [s] of measurements and commands together, to 1 % of the loop's own; None: not even without one.
    """
    check_margins(gain_margin, phase_margin)
    loop, q = LinearLoop(scenario), np.atleast_2d(np.asarray(q, dtype=float))
    own = loop.delay

    def keeps(delay: float) -> bool:
        late = loop.with_delay(delay)
        return bool(late.keeps(late.slopes(q), gain_margin, phase_margin).all())

    if keeps(own):
        return own
    low, high = 0.0, own
    if not keeps(low):
        return None
    while high - low > 0.01 * own:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if keeps(middle) else (low, middle)
    return low


def decibels(gain: float) -> float:
    """20 log₁₀ of a gain [dB]."""
    return 20.0 * float(np.log10(gain))


def margins_text(gain: float, phase: float) -> str:
    """A gain margin, a factor, and a phase margin [rad] in words."""
    return f"a gain margin of {gain:g} ({decibels(gain):.3g} dB) and a phase margin of {np.degrees(phase):.3g}°"


def check_margins(gain: Any, phase: Any) -> None:
    """Refuses values that are not valid margins.

    Raises:
        ScenarioError: names it.
    """
    number = scalar.real_number(gain)
    if number is None or not 1.0 <= number < np.inf:
        raise ScenarioError(place="gain_margin", value=gain, expected="a factor of 1 or more")
    number = scalar.real_number(phase)
    if number is None or not 0.0 <= number < np.pi:
        what = "" if number is None else f"{np.degrees(number):.6g}°"
        raise ScenarioError(what, place="phase_margin", value=phase, expected="an angle from 0 to below π rad, 180°")

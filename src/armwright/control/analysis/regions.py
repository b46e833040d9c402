"""Gains and sample periods with which a loop keeps its margins at all given poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.control.analysis.linear_loop import LinearLoop
from armwright.errors import ScenarioError
from armwright.parameters import Batch
from armwright.simulation.scenario import Scenario

LONGER = 1.5  # from one period to the next that is tried
LONGEST = 400.0  # of the loop's own period
HALVINGS = 9
GAIN, PHASE = 2.0, np.radians(30.0)  # the margins that are usually asked for


@dataclass(frozen=True, eq=False)
class GainRegion:
    """Pairs of gains of one joint that keep the margins at every pose, the other joints held still.

    Attributes:
        joint: its name.   names: of the two gains.   values: of each, (rows,) and (columns,).
        keeps: (rows, columns) true where all poses keep the margins.   poses: how many.
        gain_margin, phase_margin: [-] and [rad] that are kept.   own: the controller's own two gains.
    """

    joint: str
    names: tuple[str, str]
    values: tuple[np.ndarray, np.ndarray]
    keeps: np.ndarray
    poses: int
    gain_margin: float
    phase_margin: float
    own: tuple[float, float]


def gain_region(
    scenario: Scenario,
    joint: str,
    gains: Mapping[str, Any],
    q: Any,
    *,
    gain_margin: float = GAIN,
    phase_margin: float = PHASE,
) -> GainRegion:
    """The gains of one joint that keep the margins at all poses: those of a grid of two gains, all others as they are.

    Args:
        scenario: with a controller.   joint: its name.   gains: two of the controller's fields, name → values.
        q: (poses, n) [rad | m].   gain_margin: factor either way.   phase_margin: [rad].
    Returns:
        region: which pairs keep them.
    Raises:
        ScenarioError: names that are none, or gains that are no numbers.
    """
    arm, control = scenario.arm, scenario.loop.controller if scenario.loop is not None else None
    check_margins(gain_margin, phase_margin)
    if joint not in arm.names:
        raise ScenarioError(place="joint", value=joint, expected="a joint", choices=tuple(arm.names))
    known = [each.name for each in fields(control)] if is_dataclass(control) else []
    for name in gains:
        if name not in known or np.ndim(getattr(control, name)) > 1 or getattr(control, name) is None:
            raise ScenarioError(place="gains", value=name, expected="a gain of the controller", choices=tuple(known))
    if len(gains) != 2:
        raise ScenarioError(place="gains", value=tuple(gains), expected="two gains of the controller")
    (first, second), values = gains, [np.atleast_1d(np.asarray(each, dtype=float)) for each in gains.values()]
    place, batches, own = arm.names.index(joint), {}, []
    for name, grid in zip(gains, np.meshgrid(*values, indexing="ij"), strict=True):
        base = np.broadcast_to(np.asarray(scalar.real_numbers(getattr(control, name))), (arm.n,))
        rows = np.tile(base, (grid.size, 1))
        rows[:, place] = grid.ravel()
        batches[name] = Batch(rows)
        own.append(float(base[place]))
    assert scenario.loop is not None
    loop = LinearLoop(replace(scenario, loop=replace(scenario.loop, controller=replace(control, **batches))))  # type: ignore[type-var]
    q = np.atleast_2d(np.asarray(q, dtype=float))
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
    )


def usual_gains(control: Any) -> tuple[str, str] | None:
    """The two gains of a controller that a region is drawn over: those of position and of speed; None where it has none."""
    for names in (("position_kp", "speed_kp"), ("kp", "kd"), ("kp", "ki")):
        values = [getattr(control, name, None) for name in names]
        if all(value is not None and np.ndim(value) <= 1 and np.all(np.asarray(value) > 0) for value in values):
            return names
    return None


def longest_period(
    scenario: Scenario, q: Any, *, gain_margin: float = 1.0, phase_margin: float = 0.0
) -> tuple[float, float | None]:
    """The longest sample period at which the coupled loop keeps its margins at all poses, its gains staying as they are.

    Delays that the scenario states in seconds stay; those in periods (a preset) grow with the period.

    Args:
        scenario: with a controller.   q: (poses, n) [rad | m].
        gain_margin: factor either way; 1: stability alone.   phase_margin: [rad].
    Returns:
        period: [s]; 0 where not even a 400th of the loop's own keeps them. One that is 0.1 % longer fails.
        failing: [s] the shortest that was seen to fail; None where even 400 times the loop's own keeps them.
    """
    check_margins(gain_margin, phase_margin)
    first = LinearLoop(scenario)
    q = np.atleast_2d(np.asarray(q, dtype=float))

    def keeps(period: float) -> bool:
        loop = LinearLoop(scenario, period, first.plant)
        return bool(loop.keeps(loop.slopes(q), gain_margin, phase_margin).all())

    low = high = first.period
    if keeps(low):
        while keeps(high):
            low, high = high, LONGER * high
            if high > LONGEST * first.period:
                return low, None
    else:
        while not keeps(low):
            low, high = low / LONGER, low
            if low < first.period / LONGEST:
                return 0.0, high
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if keeps(middle) else (low, middle)
    return low, high


def check_margins(gain: Any, phase: Any) -> None:
    """Refuses margins that are none.

    Raises:
        ScenarioError: names it.
    """
    number = scalar.real_number(gain)
    if number is None or not 1.0 <= number < np.inf:
        raise ScenarioError(place="gain_margin", value=gain, expected="a factor of 1 or more")
    number = scalar.real_number(phase)
    if number is None or not 0.0 <= number < np.pi:
        raise ScenarioError(place="phase_margin", value=phase, expected="an angle from 0 to below π [rad]")

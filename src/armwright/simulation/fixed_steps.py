"""Steps of a fixed length: in place of those that lanes choose, and what those given by hand are wrong by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import ceil

import numpy as np

from armwright.scalar import Array
from armwright.signals import Layout
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.integrate.step_control import floors
from armwright.simulation.integrate.stepping import ACCURACY
from armwright.simulation.plant.recommended_step import written_step
from armwright.simulation.plant.step_limits import StepLimit, full_voltage
from armwright.simulation.scenario import Scenario

COARSE = "is coarse"
OR_NONE = ", or no step given, which lets every lane choose its own"
# Of the largest step that follows the arm's fastest modes: for an accuracy of 1e-3, and at most.
PART, MOST_PART = 0.25, 0.5


def with_fixed_steps(scenario: Scenario, finer: int = 1) -> Scenario:
    """The scenario by rk3 with a part of the largest step for its arm, where its steps are "auto"; else itself.

    The part is a quarter for an accuracy a of 1e-3, and otherwise changes as the error of a rule of order 3, with a^(1/3). Rows
    stay as they are.   `finer`: how many steps there are in place of one.
    """
    if scenario.solver.rule != "auto":
        return scenario
    largest = StepLimit(scenario.arm).largest_step(INTEGRATORS["rk3"], full_voltage(scenario.arm))
    part = min(PART * (accuracy_of(scenario) / ACCURACY) ** (1.0 / INTEGRATORS["rk3"].order), MOST_PART)
    substeps = finer * max(1, ceil(scenario.tick / (part * largest)))
    solver = replace(scenario.solver, integrator="rk3", accuracy=None, max_substeps=None)
    if scenario.loop is not None:
        loop = replace(scenario.loop, period=scenario.tick)
        return replace(scenario, loop=loop, solver=replace(solver, substeps=substeps))
    recording = replace(scenario.recording, every=substeps * scenario.every, period=None)
    return replace(scenario, solver=replace(solver, step=scenario.tick / substeps), recording=recording)


def accuracy_of(scenario: Scenario) -> float:
    """Accuracy that a scenario asks for, in parts of each quantity's range; the default one where it does not say."""
    return ACCURACY if scenario.solver.accuracy is None else float(scenario.solver.accuracy)


def coarse_step_note(
    scenario: Scenario,
    layout: Layout,
    entries: Sequence[str],
    rows: Array,
    finer: Array,
    accuracy: float = ACCURACY,
) -> str | None:
    """The note of a run about a step that is too coarse; None for a fine one.

    A step's error is the difference to half of it, times 2^p / (2^p - 1) of a rule of order p. [HairerNorsettWanner1993], II.4

    Args:
        scenario: with a fixed step.   layout, entries: of the plant's state, and their names.
        rows, finer: (rows, nx) of one lane with the step and with half of it.   accuracy: in parts of each quantity's range.
    """
    order = INTEGRATORS[scenario.solver.rule].order
    error = np.abs(rows - finer).max(axis=0) * 2.0**order / (2.0**order - 1.0)
    shares = error / np.maximum(np.ptp(finer, axis=0), floors(layout))
    worst = int(np.argmax(shares))
    if not shares[worst] > accuracy:  # NaN: the lane has stopped, and says so
        return None
    step = scenario.integration_step
    finest = step * (accuracy / shares[worst]) ** (1.0 / order)
    enough = "" if scenario.sampled else f"{written_step(finest, scenario.whole_times):.12g} s"
    if scenario.sampled:
        enough = f"substeps = {ceil(scenario.substeps * step / finest)}"
    return (
        f"a step of {step:g} s {COARSE}: {entries[worst]} is off by some {shares[worst]:.2g} of its range, as half the step "
        f"shows in one lane; {enough} would do{OR_NONE}"
    )

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
from armwright.simulation.plant.step_limits import StepLimit, full_voltage, round_down
from armwright.simulation.scenario import Scenario

COARSE = "is coarse"
PART = 0.25  # of the largest step that follows the arm's fastest modes


def with_fixed_steps(scenario: Scenario) -> Scenario:
    """The scenario by rk3 with a quarter of the largest step for its arm, where its steps are "auto"; else itself.

    Its rows stay as they are.
    """
    if scenario.solver.rule != "auto":
        return scenario
    largest = StepLimit(scenario.arm).largest_step(INTEGRATORS["rk3"], full_voltage(scenario.arm))
    substeps = max(1, ceil(scenario.tick / (PART * largest)))
    solver = replace(scenario.solver, integrator="rk3", accuracy=None, max_substeps=None)
    if scenario.loop is not None:
        loop = replace(scenario.loop, period=scenario.tick)
        return replace(scenario, loop=loop, solver=replace(solver, substeps=substeps))
    recording = replace(scenario.recording, every=substeps * scenario.every, period=None)
    return replace(scenario, solver=replace(solver, step=scenario.tick / substeps), recording=recording)


def coarse_step_note(
    scenario: Scenario, layout: Layout, entries: Sequence[str], rows: Array, finer: Array
) -> str | None:
    """What a run says of a step that is too coarse; None of one that is not.

    A step's error is the difference to half of it, times 2^p / (2^p - 1) of a rule of order p. [HairerNorsettWanner1993], II.4

    Args:
        scenario: with a fixed step.   layout, entries: of the plant's state, and their names.
        rows, finer: (rows, nx) of one lane with the step and with half of it.
    """
    order = INTEGRATORS[scenario.solver.rule].order
    error = np.abs(rows - finer).max(axis=0) * 2.0**order / (2.0**order - 1.0)
    shares = error / np.maximum(np.ptp(finer, axis=0), floors(layout))
    worst = int(np.argmax(shares))
    if not shares[worst] > ACCURACY:  # NaN: the lane has stopped, and says so
        return None
    step = scenario.integration_step
    finest = step * (ACCURACY / shares[worst]) ** (1.0 / order)
    enough = f"{round_down(finest):g} s"
    if scenario.sampled:
        enough = f"substeps = {ceil(scenario.substeps * step / finest)}"
    return (
        f"a step of {step:g} s {COARSE}: {entries[worst]} is off by some {shares[worst]:.2g} of its range, as half the step "
        f"shows in one lane; {enough} would do, or no step given, which lets every lane choose its own"
    )

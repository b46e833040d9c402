"""What of a scenario cannot be run, or does not fit together, before anything is worked out."""

from __future__ import annotations

import numbers
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import ScenarioError, nearest
from armwright.model import Model
from armwright.simulation.continued import check_run
from armwright.simulation.integration.integrators import RULES
from armwright.simulation.results.reducers import reducer
from armwright.simulation.sampling.sensors import Sensors
from armwright.simulation.sampling.shaping import Shaping
from armwright.simulation.sampling.timing import Timing

if TYPE_CHECKING:
    from armwright.simulation.scenario import Scenario

MOST_SUBSTEPS = 10**6  # of a period, in which nothing can be interrupted
SAMPLED = ("sensors", "shaping", "timing", "initial_command")  # what only a controller's loop has


def check_scenario(scenario: Scenario) -> None:
    """Refuses what cannot be run.

    Raises:
        ScenarioError: names the field, its value and what was expected.
    """
    if not isinstance(scenario.arm, Model):
        raise ScenarioError(f"arm = {scenario.arm!r}: expected an arm, as aw.load(name) gives")
    if not isinstance(scenario.integrator, str) or scenario.integrator not in RULES:
        raise ScenarioError(
            f"integrator = {scenario.integrator!r}: unknown; {nearest(str(scenario.integrator), RULES)}"
        )
    if not isinstance(scenario.vary, Mapping):
        raise ScenarioError(f"vary = {scenario.vary!r}: expected numbers by name, such as {{'link6.mass_kg': 0.1}}")
    for name, kind in (("sensors", Sensors), ("shaping", Shaping), ("timing", Timing)):
        if not isinstance(getattr(scenario, name), kind):
            raise ScenarioError(f"{name} = {getattr(scenario, name)!r}: expected an aw.{kind.__name__}(…)")
    scenario.sensors.check(scenario.arm)
    scenario.shaping.check(scenario.arm)
    if not _is_whole(scenario.seed, 0) or scenario.seed >= 2**63:
        raise ScenarioError(f"seed = {scenario.seed!r}: expected a whole number, 0 or more, of 63 bits")
    _check_loop(scenario)
    _check_record(scenario)
    drivers = [name for name in ("schedule", "command", "controller") if getattr(scenario, name) is not None]
    if len(drivers) != 1:
        raise ScenarioError(
            f"expected one of schedule, command and controller, not {' and '.join(drivers)}"
            if drivers
            else "nothing drives the arm: expected a schedule, constant commands or a controller"
        )
    if scenario.controller is None:
        _check_driven(scenario)
    if scenario.initial is not None:
        for name in ("q0", "qd0"):
            if getattr(scenario, name) is not None:
                raise ScenarioError(f"{name} and initial: expected one of them; a run tells where the arm begins")
        check_run(scenario.arm, scenario.initial)


def check_threads(threads: Any) -> None:
    """Refuses what is no number of threads.

    Raises:
        ScenarioError: shows it.
    """
    if threads is not None and not _is_whole(threads, 1):
        raise ScenarioError(f"threads = {threads!r}: expected a whole number, 1 or more")


def is_time(value: Any) -> bool:
    """Whether a value is a finite time above 0."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool) and 0.0 < float(value) < np.inf


def _is_whole(value: Any, least: int) -> bool:
    return isinstance(value, numbers.Integral) and not isinstance(value, bool) and int(value) >= least


def _check_loop(scenario: Scenario) -> None:
    """Times of the loop that do not fit together."""
    step, substeps, period = scenario.step, scenario.substeps, scenario.sample_period
    if step is not None and not is_time(step):
        raise ScenarioError(f"step = {step!r}: expected a time above 0 s")
    if not _is_whole(substeps, 1):
        raise ScenarioError(f"substeps = {substeps!r}: expected a whole number, 1 or more")
    if substeps > MOST_SUBSTEPS:
        raise ScenarioError(f"substeps = {substeps}: expected at most {MOST_SUBSTEPS}, or a shorter sample_period")
    if period is None:
        if substeps != 1 and scenario.controller is None:
            raise ScenarioError("substeps divide a sample_period: expected one beside them, or a smaller step")
        return
    if not is_time(period):
        raise ScenarioError(f"sample_period = {period!r}: expected a time above 0 s")
    part = float(period) / substeps
    if step is not None and abs(step - part) > 1e-9 * part:
        raise ScenarioError(
            f"step = {step:g} s is not sample_period / substeps = {part:g} s; expected one of them, not both"
        )


def _check_record(scenario: Scenario) -> None:
    """Recording what is not there, or nothing at all."""
    if not _is_whole(scenario.record_every, 0):
        raise ScenarioError(f"record_every = {scenario.record_every!r}: expected a whole number, 0 or more")
    if scenario.record not in ("all", "state", "none"):
        raise ScenarioError(f'record = {scenario.record!r}: expected "all", "state" or "none"')
    if isinstance(scenario.reduce, str) or not isinstance(scenario.reduce, Sequence):
        raise ScenarioError(f"reduce = {scenario.reduce!r}: expected a list of names, such as ['rms_error']")
    for name in scenario.reduce:
        reducer(name)
    if scenario.record == "none" and not scenario.reduce:
        raise ScenarioError("record = 'none' leaves nothing; expected reduce = ['rms_error', …] beside it")


def _check_driven(scenario: Scenario) -> None:
    """What only a controller's loop has, without a controller."""
    if scenario.reference is not None and not scenario.reduce:
        raise ScenarioError("a reference goes with a controller or with reduce; commands over time are a schedule")
    for name in SAMPLED:
        value = getattr(scenario, name)
        if value is not None and (name == "initial_command" or repr(value) != repr(type(value)())):
            raise ScenarioError(f"{name} goes with a controller; commands of a schedule act at their own times")

"""What of a scenario cannot be run, or does not fit together, before anything is worked out."""

from __future__ import annotations

import numbers
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import ScenarioError, nearest
from armwright.model import Model
from armwright.results.reducers import reducer
from armwright.simulation.integrate.integrators import RULES
from armwright.simulation.loop.sensors import Sensors
from armwright.simulation.loop.shaping import Shaping
from armwright.simulation.loop.state import LoopState
from armwright.simulation.loop.timing import Timing
from armwright.simulation.plant.plant import Plant

if TYPE_CHECKING:
    from armwright.simulation.scenario import Scenario

BRAKE = "brake "  # how the names of a brake's states begin
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
    for name, kind in (("shaping", Shaping), ("timing", Timing)):
        if not isinstance(getattr(scenario, name), kind):
            raise ScenarioError(f"{name} = {getattr(scenario, name)!r}: expected an aw.{kind.__name__}(…)")
    _check_sensors(scenario)
    scenario.shaping.check(scenario.arm)
    if not _is_whole(scenario.seed, 0) or scenario.seed >= 2**63:
        raise ScenarioError(f"seed = {scenario.seed!r}: expected a whole number, 0 or more, of 63 bits")
    _check_lanes(scenario.lanes)
    _check_loop(scenario)
    _check_record(scenario)
    drivers = [name for name in ("schedule", "command", "controller") if getattr(scenario, name) is not None]
    if len(drivers) > 1:
        raise ScenarioError(f"expected one of schedule, command and controller, not {' and '.join(drivers)}")
    if scenario.controller is None and drivers:
        _check_driven(scenario)
    for name in ("q0", "qd0"):
        if scenario.start is not None and getattr(scenario, name) is not None:
            raise ScenarioError(f"{name} and start: expected one of them; a run or state says where the arm begins")


def _check_sensors(scenario: Scenario) -> None:
    """Refuses what is no sensor, or several that measure the joints."""
    given = scenario.sensors
    each = [given] if isinstance(given, Sensors) else list(given) if isinstance(given, (list, tuple)) else None
    if each is None or not all(
        isinstance(s, Sensors) or (hasattr(s, "signals") and hasattr(s, "measure")) for s in each
    ):
        raise ScenarioError(
            f"sensors = {given!r}: expected an aw.Sensors(…), or a list of sensors with the methods signals and measure"
        )
    joints = [sensor for sensor in each if isinstance(sensor, Sensors)]
    if len(joints) > 1:
        raise ScenarioError("sensors: two aw.Sensors; expected one, and other sensors beside it")
    for sensor in joints:
        sensor.check(scenario.arm)


def start_state(scenario: Scenario) -> LoopState:
    """The state that a scenario starts from, given as it is or as the run that ended in it.

    Raises:
        ScenarioError: no state, one of another arm or period, or one of a lane that did not come to its end.
    """
    import xarray

    state, arm = scenario.start, scenario.arm
    if isinstance(state, xarray.Dataset):
        joints = [str(name) for name in state["joint"].values] if "joint" in state.coords else None
        if joints is not None and joints != arm.names:
            raise ScenarioError(f"start: a run of the joints {', '.join(joints)}; expected {', '.join(arm.names)}")
        state = LoopState.of_run(state)
        if state is None:
            raise ScenarioError(
                "start: a dataset without loop_state; expected a run, as simulate returns with record = 'all'"
            )
    return checked_state(scenario, state)


def checked_state(scenario: Scenario, state: Any) -> LoopState:
    """The state, if the scenario can go on from it; brakes that take part on one side alone begin unbent, or are left out.

    Raises:
        ScenarioError: no state, one of another plant or another period, or one of a lane that did not come to its end.
    """
    if not isinstance(state, LoopState):
        raise ScenarioError(f"start: of type {type(state).__name__}; expected a run or the state of a Simulation")
    arm = scenario.arm
    expected = Plant.of(arm, brakes=scenario.brake is not None).layout.entry_names(arm.names)
    strange = [name for name in set(state.entries) ^ set(expected) if not name.startswith(BRAKE)]
    if strange:
        name = min(strange)
        told = "without" if name in expected else "with"
        raise ScenarioError(
            f"start: a state {told} {name!r}; expected the {len(expected)} numbers of {arm.name} with its drives"
        )
    if state.entries != expected:
        columns = dict(zip(state.entries, state.blocks["x"].T, strict=True))
        x = np.array([columns.get(name, np.zeros(state.lanes)) for name in expected]).T
        state = replace(state, entries=expected, blocks={**state.blocks, "x": x})
    if abs(state.period - scenario.tick) > 1e-9 * scenario.tick:
        raise ScenarioError(f"start: ticks of {state.period:g} s; expected those of the scenario, {scenario.tick:g} s")
    frozen = state.blocks["frozen"][:, 0] >= 0.0
    if frozen.any():
        lane = int(np.argmax(frozen))
        at = state.blocks["frozen"][lane, 0] * state.period
        raise ScenarioError(f"start: lane {lane} stopped at t = {at:g} s; expected lanes that came to their end")
    return state


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


def _check_lanes(lanes: Any) -> None:
    """Refuses what is no number of lanes, nor a range of them."""
    some = isinstance(lanes, range) and lanes.step == 1 and 0 <= lanes.start < lanes.stop
    if lanes is not None and not some and not _is_whole(lanes, 1):
        raise ScenarioError(f"lanes = {lanes!r}: expected a number of lanes, or a range such as range(77, 78)")


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

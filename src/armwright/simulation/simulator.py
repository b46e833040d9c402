"""Simulation of an arm with its motors: a scenario is compiled, run, and told as a Dataset that knows how it was made."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from armwright.errors import Interrupted, ScenarioError
from armwright.simulation.compiled import Simulator, compile_simulator
from armwright.simulation.groups import Progress
from armwright.simulation.results.provenance import provenance
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_checks import check_threads
from armwright.simulation.scenario_run import compile_run, simulate_run

if TYPE_CHECKING:
    import xarray

__all__ = ["Simulator", "compile_simulator", "simulate"]


def simulate(
    scenario: Scenario,
    *,
    progress: Progress | None = None,
    threads: int | None = None,
    simulator: Simulator | None = None,
) -> xarray.Dataset:
    """The motion of the arm under the scenario's commands.

    Drive limits clip and are reported in the result's attributes. A lane whose state leaves the finite numbers is
    frozen and marked with the time it happened; the others go on. A single run that does so raises.

    Args:
        scenario: what to run.
        progress: called now and then with the steps done and the steps there are, over all lanes.
        threads: how many share the lanes, by default all cores; the result does not depend on it.
        simulator: a compiled arm to use again, for commands over time alone; by default one is compiled.
    Returns:
        run: time, q, qd, qdd, tau, u and, where the record has the constants, voltage and current; units in attributes.
    Raises:
        ScenarioError: a step too large for the arm's fastest time constant; names the step that would do.
        DivergenceError: a single run left the finite numbers.
        Interrupted: Ctrl-C, a KeyboardInterrupt whose `run` holds the lanes that were finished.
    """
    check_threads(threads)
    if simulator is not None:
        _check_simulator(simulator, scenario)
    try:
        run = simulate_run(compile_run(scenario, simulator), progress, threads)
    except Interrupted as stop:
        _remember(stop.run, scenario)
        raise
    _remember(run, scenario)
    return run


def _remember(run: xarray.Dataset, scenario: Scenario) -> None:
    """Lets a run know how it was made."""
    run.attrs |= {"seed": scenario.seed, "made_with": json.dumps(provenance(scenario.target))}
    if scenario.document is not None:
        run.attrs["scenario"] = scenario.document


def _check_simulator(simulator: Simulator, scenario: Scenario) -> None:
    """Refuses a simulator that was compiled for something else.

    Raises:
        ScenarioError: names what differs.
    """
    parts = simulator.parts
    compiled = {
        "arm": parts.arm,
        "integrator": parts.integrator,
        "target": simulator.target,
        "adaptivity": parts.adaptivity,
    }
    for what, known in compiled.items():
        asked = getattr(scenario, what)
        if known is not asked and known != asked and asked is not None:
            raise ScenarioError(
                f"the simulator was compiled for {what} = {known}, not for the scenario's {asked}; "
                "expected compile_simulator of the scenario's own"
            )
    varying, asked = (each.names if each is not None else () for each in (parts.varied, scenario.varied))
    if varying != asked:
        raise ScenarioError(
            f"the simulator was compiled for varying {list(varying)}, not for the scenario's {list(asked)}; "
            "expected compile_simulator of the scenario's own"
        )
    more = [name for name in ("controller", "reduce") if getattr(scenario, name)] + list(scenario.inputs)
    if more:
        raise ScenarioError(
            f"the simulator was compiled for commands over time alone, not for the scenario's {more[0]}"
        )

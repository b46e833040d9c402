"""Which step is small enough: one scenario run with ever smaller steps, each against CVODES at tolerances near rounding.

With error e(h) ~ h^p, the order that is seen between two steps is  p = log(e₁/e₂) / log(h₁/h₂).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log
from typing import TYPE_CHECKING

import numpy as np

from armwright.errors import DivergenceError, ScenarioError
from armwright.simulation.integrators import INTEGRATORS
from armwright.simulation.scenario import Scenario
from armwright.simulation.simulator import simulate

if TYPE_CHECKING:
    import xarray

ACCURACIES = (1e-3, 1e-6, 1e-9)  # that are recommended for, if nothing else is said
STEPS = 8  # halvings that are tried, if nothing else is said
LARGEST = 4  # times an open-loop scenario's own step, where that divides the duration
SMALLEST_ERROR = 1e-12  # what CVODES itself may be wrong by: no order is seen below


@dataclass(frozen=True)
class Trial:
    """One step that was tried.

    Attributes:
        step: [s] of the integrator.   substeps: steps in a sample period; 1 where nothing is sampled.
        error_q: [rad | m], error_qd: [rad/s | m/s]: the largest over all rows, joints and lanes; NaN: it could not run.
        order: that is seen from the step before; NaN: none.   evaluations: of the plant, for each lane and simulated second.
        refused: why it could not run; None where it did.
    """

    step: float
    substeps: int
    error_q: float
    error_qd: float
    order: float
    evaluations: float
    refused: str | None = None

    @property
    def error(self) -> float:
        """The larger of both errors; ∞ where it could not run."""
        return np.inf if self.refused else max(self.error_q, self.error_qd)


@dataclass(frozen=True)
class Convergence:
    """How the error of a scenario shrinks with the step.

    Attributes:
        name: of the arm.   integrator: the rule.   order: the rule's own.   trials: largest step first.
        recommended: for each accuracy [rad, rad/s | m, m/s] the largest step which keeps it, as all smaller ones do; None: none.
    """

    name: str
    integrator: str
    order: int
    trials: tuple[Trial, ...]
    recommended: dict[float, Trial | None]


def converge(
    scenario: Scenario,
    *,
    steps: int = STEPS,
    accuracies: Sequence[float] = ACCURACIES,
    threads: int | None = None,
) -> Convergence:
    """Runs a scenario with steps that halve, and says which are small enough.

    A sampled controller keeps its period and its substeps are doubled; in open loop the step itself is halved. Errors are
    those at times that all runs share. Draws of noise and jitter are the same in all of them.

    Args:
        scenario: with an integrator of fixed step.   steps: how many are tried.
        accuracies: to recommend for, [rad, rad/s | m, m/s].   threads: as in `simulate`.
    Returns:
        convergence: the steps with their errors, the order seen and what they cost; and what is recommended.
    Raises:
        ScenarioError: an integrator that chooses its own steps, no steps, no such accuracy, too many lanes for CVODES.
        DivergenceError: CVODES cannot solve it.
    """
    if scenario.integrator not in INTEGRATORS:
        raise ScenarioError(
            f"integrator = {scenario.integrator!r} chooses its own steps; expected one of {', '.join(INTEGRATORS)}"
        )
    if isinstance(steps, bool) or not isinstance(steps, int) or steps < 1:
        raise ScenarioError(f"steps = {steps!r}: expected a whole number, 1 or more")
    wrong = [accuracy for accuracy in accuracies if not 0.0 < accuracy < np.inf]
    if wrong:
        raise ScenarioError(f"accuracies: {wrong[0]!r}: expected numbers above 0")
    variants = _variants(scenario, steps)
    rule, exact = INTEGRATORS[scenario.integrator], _positions(_solved(variants[0]), scenario)
    trials: list[Trial] = []
    for variant in variants:
        step, substeps = variant.integration_step, variant.substeps
        cost = rule.stages / step
        try:
            found = _positions(simulate(variant, threads=threads), scenario)
        except (ScenarioError, DivergenceError) as error:
            trials.append(Trial(step, substeps, np.nan, np.nan, np.nan, cost, str(error)))
            continue
        q, qd = (float(np.nan_to_num(np.abs(a - b), nan=np.inf).max()) for a, b in zip(found, exact, strict=True))
        last = trials[-1] if trials and not trials[-1].refused else None
        order = np.nan
        if last is not None and max(q, qd) > SMALLEST_ERROR and np.isfinite(last.error):
            order = log(last.error / max(q, qd)) / log(last.step / step)
        trials.append(Trial(step, substeps, q, qd, order, cost))
    chosen = {accuracy: _largest(trials, accuracy) for accuracy in accuracies}
    return Convergence(scenario.arm.name, scenario.integrator, rule.order, tuple(trials), chosen)


def _largest(trials: Sequence[Trial], accuracy: float) -> Trial | None:
    """The largest step that keeps an accuracy, as do all smaller ones that were tried."""
    found = None
    for trial in reversed(trials):
        if not trial.error <= accuracy:
            break
        found = trial
    return found


def _variants(scenario: Scenario, steps: int) -> list[Scenario]:
    """The scenario with steps that halve, each recorded at the times of the first."""
    if scenario.controller is not None:
        sampled = replace(scenario, substeps=1, step=None, sample_period=scenario.tick, record="state")
        return [replace(sampled, substeps=2**k) for k in range(steps)]
    duration, largest = scenario.ticks * scenario.tick, LARGEST
    while largest > 1 and scenario.ticks % largest:
        largest //= 2
    return [
        replace(
            scenario,
            step=largest / 2**k * scenario.tick,
            sample_period=None,
            substeps=1,
            duration=duration,
            record="state",
            record_every=scenario.record_every and 2**k,
        )
        for k in range(steps)
    ]


def _solved(scenario: Scenario) -> xarray.Dataset:
    """By CVODES, with its own tolerances."""
    return simulate(replace(scenario, integrator="cvodes", substeps=1))


def _positions(run: xarray.Dataset, scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """q and q̇ of a run; NaN in lanes that stopped."""
    q, qd = run["q"].to_numpy().copy(), run["qd"].to_numpy().copy()
    if scenario.lanes is not None:
        stopped = np.isfinite(run["diverged_at"].to_numpy())
        q[stopped], qd[stopped] = np.nan, np.nan
    return q, qd

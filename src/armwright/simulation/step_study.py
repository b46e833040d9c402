"""Study of the step size: one scenario run with ever smaller steps, each against a reference at tolerances near rounding.

The reference is CVODES; where friction sticks, which it does not follow, rk45 in steps that end where sticking changes.

With error e(h) ~ h^p, the order that is seen between two steps is  p = log(e₁/e₂) / log(h₁/h₂). It says nothing where the
error is the reference's own. Where sensors count and converters have steps, a state that is wrong by next to nothing may still be
read as another count; what follows from that is no error of the integration, and the rows behind it are not compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import log
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.entry import AnyScenario, as_scenario
from armwright.errors import DivergenceError, Interrupted, ScenarioError
from armwright.progress import Shown, automatic
from armwright.results.result import Result
from armwright.results.table import Table, number
from armwright.simulation.checks import check_whole
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.integrate.stepping import ACCURACY, LEAST_ACCURACY
from armwright.simulation.plant.sticking import sticking_places
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Recording, Solver
from armwright.simulation.simulation import simulate

if TYPE_CHECKING:
    import xarray

ACCURACIES = (1e-3, 1e-6, 1e-9)  # that are recommended for, if nothing else is said
STEPS = 8  # halvings that are tried, if nothing else is said
LARGEST = 4  # times an open-loop scenario's own step, where that divides the duration
SMALLEST_ERROR = 1e-12  # no order is seen below, however good the reference is
TIGHT = 1e-11  # tolerance of rk45 in the place of CVODES
LOOSER = 10.0  # times that tolerance: the change that it makes is taken for what the reference is wrong by
SURE = 4.0  # times what the reference is wrong by: an error that says something
AIM = 0.3  # of an error that "auto" is to keep, in the one run that tries to


@dataclass(frozen=True)
class Trial:
    """One step that was tried.

    Attributes:
        step: [s] of the integrator.   substeps: steps in a sample period; 1 where nothing is sampled.
        error_q: [rad | m], error_qd: [rad/s | m/s]: the largest over all rows, joints and lanes; NaN: it could not run.
        order: that is seen from the step before; NaN: none.   evaluations: of the plant, for each lane and simulated second.
        counts_differ_at: [s] first time at which a count or a command's step differs from the reference's, in the first lane
            where one does; that lane's later rows are not compared. NaN: never.
        refused: why it could not run; None where it did.   rule: that took the steps.
        accuracy: of "auto", whose mean step this is; None of a fixed step.
    """

    step: float
    substeps: int
    error_q: float
    error_qd: float
    order: float
    evaluations: float
    counts_differ_at: float = np.nan
    refused: str | None = None
    rule: str = ""
    accuracy: float | None = None

    @property
    def error(self) -> float:
        """The larger of both errors; ∞ where it could not run."""
        return np.inf if self.refused else max(self.error_q, self.error_qd)


@dataclass(frozen=True)
class StepStudy(Result):
    """Error of a scenario against the step.

    Attributes:
        name: of the arm.   integrator: the rule.   order: the rule's own.   trials: largest step first.
        recommended: for each accuracy [rad, rad/s | m, m/s] the largest step which keeps it, as all smaller ones do; None: none.
        auto: what a run is wrong by in which every lane chooses its steps; its step is their mean.
        floor: [rad, rad/s | m, m/s] what the reference itself is wrong by, as the smallest steps show, or of rk45 another
            tolerance; 0 where they do not.
        reference: its name and tolerance.
        by_auto: "auto" with an accuracy, for each accuracy that neither a step nor `auto` keeps, as near to it as one run came.
        stopped: where Ctrl-C ended the study, in words; "" if nothing did.
    """

    name: str
    integrator: str
    order: int
    trials: tuple[Trial, ...]
    auto: Trial
    floor: float
    recommended: dict[float, Trial | None]
    reference: str
    by_auto: dict[float, Trial]
    stopped: str = ""

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.name}: {self.integrator} (order {self.order}) against {self.reference}"

    @property
    def _refused(self) -> list[Trial]:
        return [trial for trial in self.trials if trial.refused]

    def tables(self) -> list[Table]:
        """A row for each step that was tried, those that are too large in one."""
        taken = [trial for trial in (*self.trials, self.auto, *self.by_auto.values()) if not trial.refused]
        span = dict.fromkeys(f"{1e3 * trial.step:.4g}" for trial in (*self._refused[:1], *self._refused[-1:]))
        refused = [[" to ".join(span), "too large", "", "", "", ""]] if span else []
        heads = ("step [ms]", "error in q [rad | m]", "error in qd [rad/s | m/s]", "order seen", "evaluations a second")
        return [Table(self.heading, (*heads, "other counts from [s]"), [*refused, *map(_row, taken)])]

    def sentences(self) -> list[str]:
        """Reasons of refused steps, the error of the reference, and the setting for each accuracy."""
        lines = [str(trial.refused) for trial in self._refused[-1:]]
        if self.stopped:
            lines.append(f"stopped by Ctrl-C {self.stopped}: what is not shown was not tried")
        if any(np.isfinite(trial.counts_differ_at) for trial in self.trials):
            smallest = f"Where a count is another one than by {self.reference}, as the smallest error makes it"
            lines.append(f"{smallest}, rows behind are not compared.")
        if self.floor > 0.0 and self.floor > 0.25 * min(trial.error for trial in self.trials):
            lines.append(f"The reference, {self.reference}, is itself wrong by some {self.floor:.0e}.")
        return lines + [f"for an accuracy of {each:g}: {_advice(self, each)}" for each in self.recommended]


def _row(trial: Trial) -> list[Any]:
    """Cells of a step that was tried."""
    step = f"{1e3 * trial.step:.4g}"
    if trial.accuracy is not None:
        accuracy = "" if trial.accuracy == ACCURACY else f" for {trial.accuracy:g}"
        step = f"auto{accuracy}, {trial.rule}, {1e3 * trial.step:.3g} on average"
    errors = (number(trial.error_q, ".1e"), number(trial.error_qd, ".1e"))
    return [
        step,
        *errors,
        number(round(trial.order, 2)),
        number(trial.evaluations, ",.0f"),
        number(trial.counts_differ_at),
    ]


def _advice(study: StepStudy, accuracy: float) -> str:
    """The setting that keeps an accuracy."""
    trial = study.recommended[accuracy]
    if trial is not None:
        substeps = f" ({trial.substeps} substeps)" if trial.substeps > 1 else ""
        return f"a step of {1e3 * trial.step:.4g} ms{substeps}"
    none = "no step that was tried"
    if study.auto.error <= accuracy:
        return f"{none}; auto keeps it, with no step given"
    auto = study.by_auto.get(accuracy)
    if auto is None or auto.refused:
        return none
    return f"{none}; auto with an accuracy of {auto.accuracy:g} is wrong by {auto.error:.0e}"


def step_study(
    scenario: AnyScenario,
    *,
    steps: int = STEPS,
    accuracies: Sequence[float] = ACCURACIES,
    threads: int | None = None,
    progress: Shown = None,
) -> StepStudy:
    """Runs a scenario with steps that halve, and says which are small enough.

    Steps that are "auto" are compared with those of rk3. A sampled controller keeps its period and its substeps are doubled;
    in open loop the step itself is halved. Errors are those at times that all runs share, up to where a quantiser decides
    otherwise. Draws of noise and jitter are the same in all.

    Args:
        scenario: with an integrator of fixed step.   steps: how many are tried.
        accuracies: to recommend for, [rad, rad/s | m, m/s].   threads: as in `simulate`.
        progress: True or None: a bar where it is seen; False: none; a function is called with steps taken and of all.
    Returns:
        study: the steps with their errors, the order seen and what they cost; and what is recommended.
    Raises:
        ScenarioError: an integrator that chooses its own steps, no steps, no such accuracy, too many lanes for CVODES.
        DivergenceError: CVODES cannot solve it.
        Interrupted: Ctrl-C; `found` holds the study of the steps until then, without "auto".
    Example:
        >>> scenario = aw.Scenario("two-link", 0.2, command=[20.0, 5.0])
        >>> study = aw.simulation.step_study(scenario, steps=3, accuracies=(1e-3, 1e-6))
        >>> len(study.trials)
        3
    """
    scenario = as_scenario(scenario)
    if scenario.solver.rule == "auto":
        fixed = replace(scenario.solver, integrator="rk3", accuracy=None, max_substeps=None)
        scenario = replace(scenario, solver=fixed)
    name = scenario.solver.rule
    if name not in INTEGRATORS:
        expected = f"'auto' or one of {', '.join(INTEGRATORS)}"
        raise ScenarioError("chooses its own steps", place="solver.integrator", value=name, expected=expected)
    check_whole("steps", steps, 1)
    wrong = [accuracy for accuracy in accuracies if not 0.0 < accuracy < np.inf]
    if wrong:
        raise ScenarioError(place="accuracies", value=wrong[0], expected="a number above 0")
    variants = _variants(scenario, steps)
    rule = INTEGRATORS[name]
    trials: list[Trial] = []
    runs: list[xarray.Dataset] = []
    floor, stopped, tighter = 0.0, "", {}
    auto = Trial(np.nan, 1, np.nan, np.nan, np.nan, np.nan, refused="not tried", rule="auto")
    with automatic(progress, f"trying steps for {scenario.arm.name}") as tell:
        tell(0, 2**steps)  # a step takes twice as long as the one before
        exact = _solved(variants[0])
        try:
            for k, variant in enumerate(variants):
                tell(2**k, 2**steps)
                step, substeps = variant.integration_step, variant.substeps
                cost = rule.stages / step
                try:
                    runs.append(simulate(variant, threads=threads))
                except (ScenarioError, DivergenceError) as error:
                    trials.append(Trial(step, substeps, np.nan, np.nan, np.nan, cost, refused=str(error), rule=name))
                    continue
                q, qd, differ_at = _compared(runs[-1], exact, scenario)
                trials.append(Trial(step, substeps, q, qd, np.nan, cost, differ_at, rule=name))
            floor = _reference_error(scenario, variants[0], exact, runs, trials)
            auto = _auto(variants[0], exact, threads)
            for accuracy in accuracies:
                missed = _largest(trials, accuracy) is None and accuracy < auto.error < np.inf
                if missed and accuracy > SURE * max(floor, SMALLEST_ERROR):
                    tighter[accuracy] = _auto(variants[0], exact, threads, ACCURACY * AIM * accuracy / auto.error)
        except KeyboardInterrupt:
            if not trials:
                raise
            stopped = f"after {len(trials)} of {steps} steps"
    ordered = [trials[0], *(replace(trial, order=_order(last, trial, floor)) for last, trial in pairwise(trials))]
    chosen = {accuracy: _largest(ordered, accuracy) for accuracy in accuracies}
    reference = "rk45 at 1e-11" if _sticks(scenario) else "CVODES"
    study = StepStudy(
        scenario.arm.name, name, rule.order, tuple(ordered), auto, floor, chosen, reference, tighter, stopped
    )
    if stopped:
        raise Interrupted(stopped, found=study)
    return study


def _reference_error(
    scenario: Scenario,
    largest: Scenario,
    exact: xarray.Dataset,
    runs: Sequence[xarray.Dataset],
    trials: Sequence[Trial],
) -> float:
    """Error of the reference run itself [rad, rad/s | m, m/s]; 0 if it is too small to be estimated."""
    if _sticks(scenario):  # an error at a turn depends on where the steps lie about it, and need not shrink with them
        return max(_compared(_solved(largest, LOOSER * TIGHT), exact, scenario)[:2])
    if len(runs) < 2 or any(trial.refused or np.isfinite(trial.counts_differ_at) for trial in trials[-2:]):
        return 0.0
    # What the last one lacks is at most its change, that of order 1.
    return max(trials[-1].error - max(_compared(runs[-1], runs[-2], scenario)[:2]), 0.0)


def _auto(scenario: Scenario, exact: xarray.Dataset, threads: int | None, accuracy: float = ACCURACY) -> Trial:
    """The error where every lane chooses its steps for an accuracy, and what these are on average."""
    accuracy = float(f"{max(accuracy, LEAST_ACCURACY):.0e}")  # as people write one
    recording = scenario.recording
    if not scenario.sampled:
        recording = replace(recording, every=None, period=scenario.tick)
    auto = replace(
        scenario,
        solver=Solver(accuracy=accuracy, target=scenario.solver.target, global_error=False),
        recording=recording,
    )
    try:
        run = simulate(auto, threads=threads)
    except (ScenarioError, DivergenceError) as error:
        return Trial(np.nan, 1, np.nan, np.nan, np.nan, np.nan, refused=str(error), rule="auto", accuracy=accuracy)
    q, qd, differ_at = _compared(run, exact, scenario)
    steps = float(np.mean(run["steps_tried"])) / (scenario.ticks * scenario.tick)
    cost = INTEGRATORS["rk3"].stages * steps  # rodas3 asks for as many, and for slopes
    return Trial(1.0 / steps, 1, q, qd, np.nan, cost, differ_at, rule=run.attrs["rule"], accuracy=accuracy)


def _order(last: Trial, trial: Trial, floor: float) -> float:
    """The order seen from one trial to the next; NaN where they tell none."""
    same_rows = np.array_equal(last.counts_differ_at, trial.counts_differ_at, equal_nan=True)
    if not same_rows or not trial.error > max(SURE * floor, SMALLEST_ERROR) or not np.isfinite(last.error):
        return np.nan
    return log(last.error / trial.error) / log(last.step / trial.step)


def _largest(trials: Sequence[Trial], accuracy: float) -> Trial | None:
    """The largest step that keeps an accuracy, as do all smaller ones that were tried."""
    found = None
    for trial in reversed(trials):
        if not trial.error <= accuracy:
            break
        found = trial
    return found


def _quantised(scenario: Scenario) -> list[str]:
    """Names of results that have steps, and are the same to the last bit where the same step is read."""
    loop = scenario.loop
    if loop is None:
        return []
    resolution = loop.command_filter.resolution
    return ["q_measured"] * loop.joint_sensors.quantised + ["u_issued"] * (resolution is not None)


def _variants(scenario: Scenario, steps: int) -> list[Scenario]:
    """The scenario with steps that halve, each recorded at the times of the first; all of them where quantisers decide."""
    solver, recording = scenario.solver, scenario.recording
    if scenario.loop is not None:
        kept = Recording() if _quantised(scenario) else replace(recording, what="state", reduce=())
        sampled = replace(scenario, loop=replace(scenario.loop, period=scenario.tick), recording=kept)
        return [replace(sampled, solver=replace(solver, step=None, substeps=2**k)) for k in range(steps)]
    duration, largest = scenario.ticks * scenario.tick, LARGEST
    while largest > 1 and scenario.ticks % largest:
        largest //= 2
    return [
        replace(
            scenario,
            duration=duration,
            solver=replace(solver, step=largest / 2**k * scenario.tick, substeps=1),
            recording=replace(recording, what="state", every=scenario.every and 2**k, period=None),
        )
        for k in range(steps)
    ]


def _sticks(scenario: Scenario) -> bool:
    return bool(sticking_places(scenario.arm, brakes=True))


def _solved(scenario: Scenario, tight: float = TIGHT) -> xarray.Dataset:
    """The reference, by CVODES with its own tolerances or by rk45 with tight ones."""
    solver = replace(scenario.solver, integrator="cvodes", substeps=1)
    if _sticks(scenario):
        solver = replace(solver, integrator="rk45", rtol=tight, atol=0.1 * tight)
    try:
        return simulate(replace(scenario, solver=solver))
    except DivergenceError as error:
        what = f"the reference that steps are compared with cannot be computed: {error.what}"
        raise DivergenceError(what, expected="a shorter duration", file=error.file) from None


def _compared(run: xarray.Dataset, exact: xarray.Dataset, scenario: Scenario) -> tuple[float, float, float]:
    """The largest differences of q and of q̇ over the rows that can be compared, and from when on [s] the others cannot."""
    single = scenario.lane_count is None

    def lanes(of: xarray.Dataset, name: str) -> np.ndarray:
        return of[name].to_numpy()[None] if single else of[name].to_numpy()

    rows = run.sizes["time"]
    alike = np.ones((1 if single else run.sizes["lane"], rows), dtype=bool)
    for name in _quantised(scenario):
        same = (lanes(run, name) == lanes(exact, name)).all(axis=2)
        before = np.logical_and.accumulate(same, axis=1)[:, :-1]  # a row stands before what is decided in it
        alike &= np.hstack([alike[:, :1], before])
    errors = []
    for name in ("q", "qd"):
        difference = np.abs(lanes(run, name) - lanes(exact, name))
        if not single:
            for of in (run, exact):
                for stopped in {"diverged_at", "stalled_at"} & set(of.data_vars):
                    difference[np.isfinite(of[stopped].to_numpy())] = np.nan
        errors.append(float(np.nan_to_num(difference[alike], nan=np.inf).max()))
    last = alike.sum(axis=1).min()
    return errors[0], errors[1], float(run["time"].to_numpy()[last - 1]) if last < rows else np.nan

"""Robust search for a controller's gains by the covariance matrix adaptation evolution strategy. [Hansen2016]"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from armwright.control.analysis.regions import GAIN, PHASE, check_margins
from armwright.errors import ScenarioError
from armwright.simulation.checks import check_choice, check_whole
from armwright.simulation.scenario import Scenario
from armwright.tuning.lanes import scenario_lanes, taken
from armwright.tuning.margins import MarginConstraint
from armwright.tuning.objective import OBJECTIVES, Objective, checked_limits, checked_weights
from armwright.tuning.result import TuningResult
from armwright.tuning.space import GainSpace

SPREAD = 0.15  # standard deviation of the first generation, as a share of the bounds' logarithm
REFUSED = 1e9  # score of gains without the margins, and beyond: worse than any run that ends
STILL = 1e-6  # [rad | m] of a tracking error: an arm that only holds its pose
FAILED = 1e6  # of a run that diverges


def tune(
    scenario: Scenario,
    gains: Mapping[str, Any] | None = None,
    *,
    draws: Mapping[str, Any] | None = None,
    objectives: Mapping[str, float] | None = None,
    limits: Mapping[str, Any] | None = None,
    over: str = "mean",
    lanes: int = 64,
    generations: int = 30,
    candidates: int | None = None,
    gain_margin: float = GAIN,
    phase_margin: float = PHASE,
    poses: int = 2000,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> TuningResult:
    """Gains that track better than the scenario's own over uncertain arms, and keep the margins.

    CMA-ES in the logarithm of the gains, one for each joint. A generation's candidates run in all lanes of uncertainty together,
    in one compiled simulation; those that do not keep the margins are not simulated. Every second lane is held out: the result is
    judged there, and where it does not beat the start, the start is returned.

    Args:
        scenario: with a controller, whose gains are the start. Its lanes, if it has some, are the uncertainty.
        gains: by name, a factor to either side of the start, or (low, high), numbers or (n,) each; default: all gains whose
            names end in kp, ki or kd, within a factor of 10. Gains of 0 stay 0.
        draws: values for `vary` that differ by lane, a `Draw` or `Batch` each; default, where the scenario has one lane: each
            mass within ±30 %, each joint's friction within a factor of two.
        objectives: weights by reducer; default: rms_error 1, relative to the start's, and saturation 1.
        limits: by peak reducer, such as {"peak_torque": 40.0}, what no run should go beyond [the reducer's unit].
        over: "mean" or "worst" of the lanes.   lanes: how many of a scenario that has one; half of them judge the result.
        generations: of the search.   candidates: in each; default: 4 + 3 ln k for k gains, and 8 at least.
        gain_margin: factor either way that any one command bears.   phase_margin: [rad].
        poses: drawn within the position limits; the margins are kept where an inertia or slope is extreme among them, with the
            record's own numbers.   seed: of the search, the poses and default draws.   progress: called with (done, total).
    Returns:
        result: gains, scenario, and scores on held-out lanes.
    Raises:
        ScenarioError: unstable start gains, margins that no gains were found to keep, a reference that does not
            move, or bad arguments. `cma` is not installed.
    """
    check_margins(gain_margin, phase_margin)
    check_choice("over", over, ("mean", "worst"))
    check_whole("generations", generations, 1)
    check_whole("poses", poses, 1)
    check_whole("seed", seed, 0)
    if candidates is not None:
        check_whole("candidates", candidates, 4)
    space = GainSpace.of(scenario, gains)
    weights = checked_weights(OBJECTIVES if objectives is None else objectives)
    bounds = checked_limits({} if limits is None else limits, scenario.arm.n)
    every = scenario_lanes(scenario, draws, lanes, seed)
    count = every.lane_count or 0
    tuned_in, judged_in = np.arange(0, count, 2), np.arange(1, count, 2)
    objective = Objective(every, space, weights, bounds, over == "worst")
    margins = MarginConstraint(taken(every, tuned_in[:1]), space, poses, seed, (gain_margin, phase_margin))
    margins.check_start()
    start = objective.values(space.start[None], tuned_in)
    scales = objective.scales(start)
    first = float(objective.score(start, scales)[0])
    if not np.isfinite(first):
        what = "the start gains fail in some lanes, which diverge or stall"
        raise ScenarioError(what, place="loop.controller", expected="gains that end their runs in every lane")
    errors = [start[name].max() for name in ("rms_error", "peak_error") if weights.get(name, 0.0) > 0.0]
    if errors and max(errors) < STILL:
        what = f"nothing to track: the start's tracking errors stay below {STILL:g}"
        raise ScenarioError(what, place="loop.reference", expected="a reference that moves, or starts away from it")
    search = _Search(objective, margins, scales, tuned_in, first if margins.keeps(space.start) else np.inf)
    runs = search.run(generations, candidates, seed, progress)
    if search.best is None:
        raise margins.refusal()
    return _judged(scenario, search, judged_in, len(tuned_in), runs)


class _Search:
    """The search: best gains so far, which keep the margins at all poses, their score, and the best score of each generation."""

    def __init__(
        self, objective: Objective, margins: MarginConstraint, scales: Any, lanes: np.ndarray, first: float
    ) -> None:
        self.objective, self.margins, self.scales, self.lanes = objective, margins, scales, lanes
        self.start_keeps = np.isfinite(first)
        self.best: np.ndarray | None = objective.space.start if self.start_keeps else None
        self.score, self.history = first, [first]

    def run(
        self, generations: int, candidates: int | None, seed: int, progress: Callable[[int, int], None] | None
    ) -> int:
        """Goes through the generations; the number of simulations."""
        cma, space = _cma(), self.objective.space
        count = candidates or max(8, 4 + int(3 * np.log(space.free.sum())))
        numbers = np.random.default_rng(seed)
        options = {
            "bounds": [0.0, 1.0], "popsize": count, "verbose": -9, "verb_log": 0, "maxiter": generations,
            "seed": np.nan, "randn": lambda *shape: numbers.standard_normal(shape),  # NumPy's global numbers stay as they are
        }  # fmt: skip
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about a single gain, and of options
            strategy = cma.CMAEvolutionStrategy(space.x_start, SPREAD, options)
            simulated = len(self.lanes)
            for generation in range(generations):
                if strategy.stop():
                    break
                points = strategy.ask()
                scores, ran = self._scores(space.gains(np.array(points)))
                strategy.tell(points, scores.tolist())
                simulated += ran * len(self.lanes)
                self.history.append(self.score)
                if progress is not None:
                    progress(generation + 1, generations)
        return simulated

    def _scores(self, gains: np.ndarray) -> tuple[np.ndarray, int]:
        """(candidates,) scores of a generation, and how many were simulated; the best is kept if its margins hold everywhere."""
        failing = self.margins.failing(gains)
        scores, kept = REFUSED * (1.0 + failing), np.flatnonzero(failing == 0.0)
        if kept.size:
            found = self.objective.score(self.objective.values(gains[kept], self.lanes), self.scales)
            scores[kept] = np.where(np.isfinite(found), np.minimum(found, FAILED), FAILED)
        for k in np.argsort(scores, kind="stable"):
            if scores[k] >= min(self.score, FAILED):
                break
            if self.margins.keeps(gains[k]):
                self.best, self.score = gains[k], float(scores[k])
                break
            scores[k] = REFUSED
        return scores, int(kept.size)


def _judged(scenario: Scenario, search: _Search, lanes: np.ndarray, tuned: int, runs: int) -> TuningResult:
    """The better of start and best on held-out lanes; the best where the start does not keep the margins."""
    objective, space = search.objective, search.objective.space
    assert search.best is not None
    values = objective.values(np.array([space.start, search.best]), lanes)
    scores = objective.score(values, search.scales)
    improved = bool(scores[1] < scores[0])
    row = search.best if improved or not search.start_keeps else space.start
    chosen = 1 if row is search.best else 0
    assert scenario.loop is not None
    if not np.isfinite(scores[chosen]):
        what = "the gains that were found fail in held-out lanes, and the start does not keep the margins"
        raise ScenarioError(what, place="gains", expected="more lanes, or less uncertainty")
    means = {name: np.stack([each[0].mean(axis=0), each[chosen].mean(axis=0)]) for name, each in values.items()}
    return TuningResult(
        replace(scenario, loop=replace(scenario.loop, controller=space.controller(row))),
        space.by_name(row),
        space.by_name(space.start),
        improved,
        search.start_keeps,
        (float(scores[0]), float(scores[chosen])),
        means,
        np.array(search.history),
        (tuned, len(lanes)),
        runs + 2 * len(lanes),
        search.margins.asked,
        len(search.margins.poses),
    )


def _cma() -> Any:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about plots it cannot make
            import cma  # type: ignore[import-untyped]
    except ImportError:
        expected = "pip install armwright[control]"
        raise ScenarioError("needs cma, which is not installed", place="tune", expected=expected) from None
    return cma

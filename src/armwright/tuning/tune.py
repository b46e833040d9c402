"""Robust search for a controller's gains over uncertain arms, under a margin constraint."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from armwright.control.analysis.regions import check_margins
from armwright.control.analysis.small_signal import SERVOS
from armwright.control.design import design_gains
from armwright.entry import AnyScenario, as_scenario
from armwright.errors import Interrupted, ScenarioError
from armwright.parameters import numbers_by_lane
from armwright.progress import Progress, Shown, automatic
from armwright.scenarios.files import Document
from armwright.scenarios.tuning_records import TuningTable
from armwright.simulation.checks import check_choice, check_whole
from armwright.simulation.scenario import Scenario
from armwright.simulation.simulation import SUPPORT as SIMULATED
from armwright.tuning.lanes import scenario_lanes, taken
from armwright.tuning.margins import MarginTest
from armwright.tuning.objective import Objective, checked_limits, checked_weights
from armwright.tuning.options import MarginConstraint, Search, stated
from armwright.tuning.result import TuningResult
from armwright.tuning.search import GainSearch, Tried
from armwright.tuning.space import GainSpace, rounded
from armwright.tuning.uncertainty import USUAL, Uncertainty
from armwright.validation import validated

SUPPORT = replace(SIMULATED, consumer="tune", refused={"commands over time": "has no controller", "servos": SERVOS})

STILL = 1e-6  # [rad | m] of a tracking error: an arm that only holds its pose
METHODS = ("cma", "differential-evolution")
STARTS = ("scenario", "analytic", "pole-placement", "symmetric-optimum", "loop-shaping", "lqr")


def tune(
    scenario: AnyScenario,
    gains: Mapping[str, Any] | None = None,
    *,
    start: str | None = None,
    draws: Mapping[str, Any] | None = None,
    objectives: Mapping[str, float] | None = None,
    limits: Mapping[str, Any] | None = None,
    lanes: int | None = None,
    margins: MarginConstraint | None = None,
    search: Search | None = None,
    progress: Shown = None,
) -> TuningResult:
    """Gains that track better than the start over uncertain arms and keep the margins.

    A search in the logarithm of the gains, one for each joint. A generation's candidates run in all lanes of uncertainty
    together, in one compiled simulation; those that do not keep the margins are not simulated. Every second lane is held out:
    the result is judged there, and where it does not beat the start, the start is returned.

    Args:
        scenario: with a controller, or the path of a scenario file. What is not stated here is taken from the file's [tuning];
            a scenario made or changed in Python has none.
        gains: by name, a factor to either side of the start, or (low, high), numbers or (n,) each; default: all gains whose
            names end in kp, ki or kd, within a factor of 10. Gains of 0 stay 0.
        start: "scenario": its own gains, the default; "analytic", or a method of `design_gains`: designed ones.
        draws: what differs between the lanes: mass, friction, record, poses, payload, jitter, delay (`[tuning.draws]` has them),
            and numbers of the record by name, a `Draw` or `Batch` each. Default: nothing beside the scenario's lanes; of a
            scenario that is one run masses within ±30 %, friction within a factor of two, and the record's standard deviations.
        objectives: weights of reducers, of "noise_gain" and of "sensitivity" (their peak over poses, of the linear loop);
            default: rms_error 1, relative to the start's, and saturation 1.
        limits: of these, such as {"peak_torque": 40.0}, what no run should go beyond [the reducer's unit].
        lanes: how many of a scenario that has one, default 64; half of them judge.
        margins: to keep, by default a gain margin of 2 and a phase margin of 30°.   search: its method, budget and seed.
        progress: True or None: a bar where it is seen; False: none; a function is called with (done, total) generations.
    Returns:
        result: gains, scenario, and scores on held-out lanes.
    Raises:
        ScenarioError: unstable start gains, margins that no gains were found to keep, a reference that does not
            move, or bad arguments. `cma` is not installed.
        Interrupted: Ctrl-C; `found` holds the result of the generations until then.
    Example:
        >>> pid = aw.JointPID(kp=[900.0, 250.0], kd=[180.0, 50.0])
        >>> move = aw.trajectories.Quintic([0.0, 0.0], [0.5, -0.5], duration=0.5)
        >>> scenario = aw.Scenario("two-link", 0.5, loop=aw.Loop(pid, move, period=0.002))
        >>> search = aw.tuning.Search(generations=3, candidates=4)
        >>> found = aw.tuning.tune(scenario, {"kp": 4.0}, lanes=8, search=search)
        >>> found.improved
        True
    """
    scenario = as_scenario(scenario)
    SUPPORT.refuse(scenario.arm, "servo")
    arguments = {
        "start": start, "gains": gains, "draws": draws, "objectives": objectives, "limits": limits, "lanes": lanes,
    }  # fmt: skip
    arguments |= stated("margins", margins, MarginConstraint) | stated("search", search, Search)
    with automatic(progress, f"tuning {scenario.arm.name}") as tell:
        return _tuned(scenario, arguments, tell)


def _tuned(scenario: Scenario, arguments: Mapping[str, Any], progress: Progress) -> TuningResult:
    """Result of `tune`, whose arguments are None where nothing was asked."""
    asked = {name.removesuffix("_rad"): value for name, value in TuningTable().model_dump().items()}
    asked |= in_file(scenario) | {name: value for name, value in arguments.items() if value is not None}
    _check(asked)
    margins, number = (asked["gain_margin"], asked["phase_margin"]), asked["seed"]
    if scenario.controller is None:
        raise ScenarioError("has no controller", place="loop", expected="a scenario with a loop and its controller")
    weights, bounds = checked_weights(asked["objectives"]), checked_limits(asked["limits"], scenario.arm.n)
    every, own, designed = scenario_lanes(scenario, asked["draws"], asked["lanes"], number), scenario, {}
    if asked["start"] != "scenario":
        designed = _designed(_slowest(every), asked["start"], margins, asked["poses"], number)
        scenario, every = (_with_gains(each, designed) for each in (scenario, every))
    space = GainSpace.of(scenario, asked["gains"])
    count = every.lane_count or 0
    tuned_in, judged_in = np.arange(0, count, 2), np.arange(1, count, 2)
    constraint = MarginTest(_slowest(every), space, asked["poses"], number, margins)
    constraint.check_start()
    worst = asked["over"] == "worst"
    objective = Objective(every, space, weights, bounds, worst, constraint.measured, client=asked.get("client"))
    values = objective.values(space.start[None], tuned_in)
    scales = objective.scales(values)
    first, means = float(objective.score(values, scales)[0]), objective.means(values, scales)
    _check_first(first, values, weights)
    if asked["improve_each"]:
        objective = replace(objective, levels={name: float(each[0]) for name, each in means.items()})
    budget = (asked["method"], asked["generations"], asked["candidates"], number)
    search = GainSearch(objective, constraint, scales, tuned_in, first if constraint.keeps(space.start) else np.inf)
    slower = None if search.start_keeps else constraint.slower()
    if slower is not None:
        search.begin_at(slower)
    total = asked["generations"] * (1 + asked["front"])
    stopped = False
    try:
        search.run(*budget, _further(progress, 0, total))
        if search.best is None:
            raise constraint.refusal()
        _along_the_front(search, asked["front"], budget, progress)
    except KeyboardInterrupt:
        if search.best is None or len(search.history) < 2:  # no generation is complete
            raise
        stopped = True
    fixed = {name: each for name, each in designed.items() if name not in space.names}
    uncertainty = Uncertainty.of(asked["draws"] or ({} if own.resolved.lane_count is not None else USUAL))
    tried = _tried(search, means)
    result = _judged(own, scenario, search, judged_in, fixed, tried, asked["start"], uncertainty.words(own.arm))
    if stopped:
        raise Interrupted(f"after {len(search.history) - 1} of {asked['generations']} generations", found=result)
    return result


def _tried(search: GainSearch, first: Mapping[str, np.ndarray]) -> Tried:
    """The gains that were tried, less those on the front that lack the margins at a pose that was not watched."""
    start, begun = search.objective.space.start, np.array([float(each[0]) for each in first.values()])
    own = [(start, begun)] if search.margins.keeps(start) else []  # the start is one of those that were tried
    values = np.array([each for _, each in (*own, *search.tried)]).reshape(-1, len(first))
    gains = np.array([row for row, _ in (*own, *search.tried)]).reshape(-1, len(start))
    tried = Tried(tuple(first), values, gains, begun)
    passed: set[bytes] = set()
    while len(tried.names) > 1:
        new = [k for k in tried.front() if tried.gains[k].tobytes() not in passed]
        failing = [k for k in new if not search.margins.keeps(tried.gains[k])]
        passed |= {tried.gains[k].tobytes() for k in new}
        if not failing:
            break
        tried = replace(tried, values=np.delete(tried.values, failing, 0), gains=np.delete(tried.gains, failing, 0))
    return tried


def in_file(scenario: Scenario) -> dict[str, Any]:
    """Contents of [tuning] of the scenario's file, by argument names of `tune`; empty for a scenario made in Python."""
    if scenario.document is None:
        return {}
    content = Document.model_validate_json(scenario.document).scenario
    table = tomllib.loads(content.text or "").get("tuning")
    if table is None:
        return {}
    found = validated(TuningTable, table, place="tuning", error=ScenarioError).asked()
    if found.get("draws") is not None:
        draws: Any = found["draws"]
        stated = {name: getattr(draws, name) for name in draws.model_fields_set}
        if "vary" in stated:
            stated["vary"] = {name: each.draw() for name, each in draws.vary.items()}
        found["draws"] = stated
    return found


def _check(asked: Mapping[str, Any]) -> None:
    """Refuses settings that are none.

    Raises:
        ScenarioError: names the first.
    """
    check_margins(asked["gain_margin"], asked["phase_margin"])
    check_choice("over", asked["over"], ("mean", "worst"))
    check_choice("method", asked["method"], METHODS)
    check_choice("start", asked["start"], STARTS)
    for name, least in (("generations", 1), ("poses", 1), ("seed", 0), ("front", 0)):
        check_whole(name, asked[name], least)
    if asked["candidates"] is not None:
        check_whole("candidates", asked["candidates"], 4)
    if not isinstance(asked["improve_each"], (bool, np.bool_)):
        raise ScenarioError(place="improve_each", value=asked["improve_each"], expected="true or false")


def _designed(
    scenario: Scenario, method: str, margins: tuple[float, float], poses: int, seed: int
) -> dict[str, np.ndarray]:
    """Designed gains of a scenario's controller by name, rounded as tuned ones are.

    Raises:
        ScenarioError: a controller around another one, whose gains are not searched for.
    """
    if hasattr(scenario.controller, "inner"):
        expected = "start = 'scenario', or aw.loops.design_gains, which designs the inner one"
        raise ScenarioError("wraps another controller", place="loop.controller", expected=expected)
    gain, phase = margins
    name = None if method == "analytic" else method
    design = design_gains(scenario, name, gain_margin=gain, phase_margin=phase, poses=poses, seed=seed)
    return {name: rounded(each) for name, each in design.gains.items()}


def _with_gains(scenario: Scenario, gains: dict[str, np.ndarray]) -> Scenario:
    """The scenario with other gains."""
    assert scenario.loop is not None
    return replace(scenario, loop=replace(scenario.loop, controller=replace(scenario.controller, **gains)))


def _slowest(every: Scenario) -> Scenario:
    """The scenario of the first lane, with the longest delay of any."""
    one = taken(every, np.arange(1))
    assert one.loop is not None
    assert every.loop is not None
    longest = {
        name: float(numbers_by_lane(getattr(every.loop.timing, name)).max())
        for name in ("measurement_delay", "command_delay")
    }
    return replace(one, loop=replace(one.loop, timing=replace(one.loop.timing, **longest)))


def _check_first(first: float, start: Mapping[str, np.ndarray], weights: Mapping[str, float]) -> None:
    """Refuses a start whose runs do not end, or that has nothing to track.

    Raises:
        ScenarioError: says which.
    """
    if not np.isfinite(first):
        failing = [name for name, each in start.items() if not np.isfinite(each).all()]
        lanes = int((~np.isfinite(start[failing[0]][0]).all(axis=-1)).sum()) if failing else 0
        count = next(iter(start.values())).shape[1]
        what = f"the start gains have no finite {failing[0] if failing else 'score'} in {lanes} of {count} lanes"
        expected = "gains that end their runs in every lane, neither diverging nor stalling"
        raise ScenarioError(what, place="loop.controller", expected=expected)
    errors = [start[name].max() for name in ("rms_error", "peak_error") if weights.get(name, 0.0) > 0.0]
    if errors and max(errors) < STILL:
        what = f"nothing to track: the start's tracking errors stay below {STILL:g}"
        raise ScenarioError(what, place="loop.reference", expected="a reference that moves, or starts away from it")


def _along_the_front(
    search: GainSearch, count: int, budget: tuple[str, int, int | None, int], progress: Progress
) -> None:
    """Searches with other weights of the first two objectives, whose candidates join those that were tried."""
    objective, (method, generations, candidates, seed) = search.objective, budget
    names = [name for name, weight in objective.weights.items() if weight > 0.0][:2]
    if count and len(names) < 2:
        raise ScenarioError("a single objective", place="front", value=count, expected="two objectives, or front = 0")
    for k, share in enumerate(np.linspace(0.0, 1.0, count + 2)[1:-1] if count else ()):
        weights = {**objective.weights, names[0]: 2.0 * share, names[1]: 2.0 * (1.0 - share)}
        other = GainSearch(replace(objective, weights=weights), search.margins, search.scales, search.lanes, np.inf)
        other.begun = search.best
        further = _further(progress, generations * (k + 1), generations * (1 + count))
        other.run(method, generations, candidates, seed + k + 1, further)
        search.tried += other.tried
        search.simulated += other.simulated - len(search.lanes)


def _further(progress: Progress, before: int, total: int) -> Progress:
    """Progress of a search behind `before` generations of others, `total` in all."""
    return lambda done, _: progress(before + done, total)


def _judged(
    own: Scenario,
    started: Scenario,
    search: GainSearch,
    lanes: np.ndarray,
    fixed: dict[str, np.ndarray],
    tried: Tried,
    start: str,
    drawn: list[str],
) -> TuningResult:
    """The better of start and best on held-out lanes; the best where the start does not keep the margins."""
    objective, space = search.objective, search.objective.space
    assert search.best is not None
    values = objective.values(np.array([space.start, search.best]), lanes)
    plain = replace(objective, levels=None)
    scores, means = plain.score(values, search.scales), plain.means(values, search.scales)
    improved = bool(scores[1] < scores[0])
    if objective.levels is not None:
        improved &= all(each[1] <= each[0] for each in means.values())
    row = search.best if improved or not search.start_keeps else space.start
    chosen = 1 if row is search.best else 0
    assert started.loop is not None
    if not np.isfinite(scores[chosen]):
        what = "the gains that were found fail in held-out lanes, and the start does not keep the margins"
        raise ScenarioError(what, place="gains", expected="more lanes, or less uncertainty")
    joint_means = {name: np.stack([each[0].mean(axis=0), each[chosen].mean(axis=0)]) for name, each in values.items()}
    return TuningResult(
        replace(own, loop=replace(started.loop, controller=space.controller(row))),
        space.by_name(row) | fixed,
        space.by_name(space.start) | fixed,
        improved,
        search.start_keeps,
        (float(scores[0]), float(scores[chosen])),
        joint_means,
        np.array(search.history),
        (len(search.lanes), len(lanes)),
        search.simulated + 2 * len(lanes),
        search.margins.asked,
        len(search.margins.poses),
        {name: (float(each[0]), float(each[chosen])) for name, each in means.items()},
        tried,
        start,
        tuple(drawn),
        space.names,
    )

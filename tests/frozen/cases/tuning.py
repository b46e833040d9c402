"""Tuning: spaces of gains, uncertainty in lanes, scores, margins, searches, and results in words."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import armwright as aw
from armwright.control.analysis.linear_loop import LinearLoop
from armwright.model import build_model
from armwright.parameters import Batch, lane_values
from armwright.tuning.lanes import scenario_lanes, taken
from armwright.tuning.linear_measures import measure
from armwright.tuning.margins import MarginTest
from armwright.tuning.objective import Objective, checked_limits, checked_weights, is_share, measure_units
from armwright.tuning.search import GainSearch, Tried, _differential_evolution, _evolve
from armwright.tuning.space import GainSpace, rounded
from armwright.tuning.tune import in_file, tune
from armwright.tuning.uncertainty import Moved, Uncertainty
from frozen.numbers import Case
from physics.arms import arm
from simulation.plants import COULOMB, MOTOR, chain

EXAMPLES = Path(__file__).parents[3] / "examples"
PD = aw.JointPID(kp=[600.0, 120.0], kd=[60.0, 10.0], gravity=True)
CASCADE = aw.Cascade(position_kp=8.0, speed_kp=[100.0, 20.0], speed_ki=[150.0, 0.0], position_every=2)
GOAL = np.array([0.3, 0.2])
MOVE = aw.trajectories.Quintic([0.0, 0.1], [0.3, -0.2], 0.1)
RUBBING = chain([{"command": "voltage", "motor": MOTOR, "friction": COULOMB} for _ in range(2)])


def scenario(law: Any = PD, model: Any = "two-link", **loop: Any) -> aw.Scenario:
    """A loop that goes to a pose."""
    given = {"reference": GOAL, "timing": aw.Timing("one-tick"), **loop}
    return aw.Scenario(model, 0.2, loop=aw.Loop(law, period=2e-3, **given))


def space_of(law: Any, gains: Any = None) -> GainSpace:
    """The space of a controller's gains."""
    return GainSpace.of(scenario(law), gains)


def spaces(_: Path) -> dict[str, Any]:
    """Bounds, points and gains of controllers, by factors and by ends, with gains that are 0."""
    asked: dict[str, tuple[Any, Any]] = {
        "usual": (PD, None),
        "factor": (PD, {"kp": 4.0, "kd": 3}),
        "ends": (PD, {"kd": ([10.0, 2.0], 300.0), "kp": (50.0, [900.0, 500.0])}),
        "cascade": (CASCADE, None),
        "cascade, further": (replace(CASCADE, speed_feedforward=0.5), {"speed_feedforward": 2.0, "speed_ki": 5.0}),
        "torque": (aw.ComputedTorque(kp=100.0, kd=20.0), None),
        "law of ours": (aw.FrictionCompensation(PD, 1e-3, 0.01, share=0.8), {"share": 1.2, "rest_speed": 3.0}),
    }
    found: dict[str, Any] = {}
    for name, (law, gains) in asked.items():
        space = space_of(law, gains)
        x = np.random.default_rng(1).uniform(size=(3, int(space.free.sum())))
        rows = space.gains(x)
        one, many = space.controller(rows[0]), space.controller(rows)
        first = space.names[0]
        found[name] = {
            "names": " ".join(space.names), "start": space.start, "low": space.low, "high": space.high, "free": space.free,
            "rows": rows, "point": space.point(rows[1]), "by name": space.by_name(rows[2]),
            "one": getattr(one, first), "many": getattr(many, first).values,
        }  # fmt: skip
    return found | {"rounded": rounded(np.array([[1.23456, 0.000123456], [98765.4, 2.0]]))}


def lanes_of(drawn: aw.Scenario) -> dict[str, Any]:
    """What differs between the lanes of a scenario."""
    assert drawn.loop is not None
    reference, payload, start = drawn.loop.reference, drawn.inputs.payload, drawn.start
    found: dict[str, Any] = {f"vary {name}": lane_values(each) for name, each in sorted(drawn.vary.items())}
    found["lanes"], found["delay"] = drawn.lane_count, drawn.loop.timing.command_delay
    found["jitter"] = drawn.loop.timing.jitter
    if isinstance(found["delay"], Batch):
        found["delay"] = lane_values(found["delay"])
    if payload is not None:
        found["payload"] = (
            [lane_values(each.mass) for each in payload] if isinstance(payload, (list, tuple)) else vars(payload)
        )
    if isinstance(reference, Batch):
        found["reference"] = lane_values(reference)
    elif isinstance(reference, Moved):
        found["offset"] = lane_values(reference.offset)
        found["moved"] = [reference.n, reference.time, reference.duration, *replace(reference, offset=GOAL)(0.03)]
    start_q = getattr(start, "q", None)
    return found | {"start": lane_values(start_q) if isinstance(start_q, Batch) else start_q}


DRAWS: dict[str, dict[str, Any]] = {
    "mass": {"mass": 0.3},
    "mass and friction": {"mass": 0.2, "friction": 2.0},
    "friction": {"friction": 1.5},
    "poses": {"poses": 0.2},
    "payload": {"payload_kg": (0.5, 2.0)},
    "times": {"jitter_s": 1e-3, "delay_s": 3e-3},
    "times by other names": {"jitter": 5e-4, "delay": 1e-3, "payload": (0.0, 1.0)},
    "all": {"mass": 0.1, "friction": 3.0, "poses": 0.1, "payload": (0.1, 0.2), "jitter": 1e-3, "delay": 2e-3},
}


def drawn(draws: dict[str, Any], lanes: int = 7) -> dict[str, Any]:
    """Lanes of an arm with friction, and the draws in words."""
    one = scenario(aw.JointPID(kp=100.0), RUBBING, timing=aw.Timing(command_delay=1e-3))
    return lanes_of(scenario_lanes(one, draws, lanes, 3)) | {"words": Uncertainty.of(draws).words(one.arm)}


def further_draws(_: Path) -> dict[str, Any]:
    """Lanes by default, with lanes of their own, by a record's deviations, of friction on the motor, of a moving reference."""
    record = arm("two-link").record
    heavy = record.links[0].replace(mass_kg=record.links[0].mass_kg.replace(std=0.05))
    known = build_model(record.replace(links=(heavy, *record.links[1:])))
    limited = chain([{"command": "torque", "limits": {"position_rad": [-0.1, 0.35]}} for _ in range(2)])
    laned = replace(scenario(), start=aw.Batch(np.linspace(0.0, 0.1, 10).reshape(5, 2)))
    batched = replace(scenario(), loop=aw.Loop(PD, Batch(np.linspace(0.0, 0.2, 12).reshape(6, 2)), 2e-3))
    mixed = {
        "poses": 0.1,
        "upper_arm.mass_kg": aw.Draw.uniform(5.0, 7.0),
        "vary": {"forearm.mass_kg": aw.Draw.normal(4.0, 0.1)},
    }
    found = {
        "usual": scenario_lanes(scenario(), None, 6, 1),
        "own lanes": scenario_lanes(laned, None, 9, 1),
        "own lanes and masses": scenario_lanes(laned, {"mass": 0.5}, 9, 1),
        "of the record": scenario_lanes(scenario(model=known), {"record": True, "mass": 0.2}, 6, 1),
        "on the motor": scenario_lanes(
            scenario(aw.JointPID(kp=9.0), "puma560", reference=np.zeros(6)), {"friction": 2.0}, 5, 1
        ),
        "within limits": scenario_lanes(scenario(model=limited), {"poses": 0.2}, 6, 1),
        "moving": scenario_lanes(replace(scenario(reference=MOVE), start=[0.0, 0.1]), {"poses": 0.3}, 6, 1),
        "no reference": scenario_lanes(replace(scenario(reference=None), start=[0.1, 0.1]), {"poses": 0.3}, 6, 1),
        "batched reference": scenario_lanes(batched, {"poses": 0.3}, 6, 1),
        "by name": scenario_lanes(scenario(), mixed, 6, 1),
    }
    some = taken(found["own lanes and masses"], np.array([3, 0, 0]))
    words = [Uncertainty.of({**each, "link.mass_kg": aw.Draw()}).words(arm("two-link")) for each in DRAWS.values()]
    return {name: lanes_of(each) for name, each in found.items()} | {"taken": lanes_of(some), "words": words}


RATIOS = np.random.default_rng(3).uniform(0.2, 2.0, (4, 3, 2))
VALUES = {
    "rms_error": RATIOS,
    "saturation": 0.3 * RATIOS[::-1],
    "peak_torque": 40.0 * RATIOS**2,
    "noise_gain": 9.0 * RATIOS[:, ::-1],
}
START = {name: each[:1] * np.array([0.01, 1.0]) for name, each in VALUES.items()}  # the first joint hardly moves


def objective(worst: bool = False, levels: Any = None, **weights: float) -> Objective:
    """Scores of the two-link arm, with a limit of its torque."""
    chosen = weights or {"rms_error": 1.0, "saturation": 0.5, "noise_gain": 0.2, "peak_torque": 0.0}
    one = scenario_lanes(scenario(), {"mass": 0.2}, 4, 0)
    return Objective(
        one, space_of(PD), chosen, {"peak_torque": np.array([30.0, 20.0])}, worst, lambda name, gains: gains, levels
    )


def scores(_: Path) -> dict[str, Any]:
    """Scales, scores and means of candidates, in the mean and the worst lane, with levels that none should exceed."""
    every = objective()
    scales = every.scales(START)
    failed = {name: np.where(np.arange(4)[:, None, None] == 2, np.inf, each) for name, each in VALUES.items()}
    levels = {"rms_error": 2.0, "saturation": 0.2, "noise_gain": 1.0}
    made = {
        "mean": every,
        "worst": objective(True),
        "levels": objective(levels=levels),
        "one": objective(rms_error=2.0),
    }
    found = {name: [each.score(VALUES, scales), each.means(VALUES, scales)] for name, each in made.items()}
    return found | {"scales": scales, "failed": every.score(failed, scales)} | {
        "still": every.scales({name: 0.0 * each for name, each in START.items()}),
        "refused": every.scales({name: np.inf * np.ones_like(each) for name, each in START.items()}),
    }  # fmt: skip


def simulated(_: Path) -> dict[str, Any]:
    """Reducers of candidates in some lanes, of which one runs away; overshoot and settling of some that do not settle."""
    weights = {"rms_error": 1.0, "overshoot": 1.0, "settling_time": 0.1, "noise_gain": 1.0}
    one = scenario_lanes(scenario(), {"mass": 0.3}, 4, 0)
    names = {"peak_torque": np.array([90.0, 50.0])}
    space = space_of(PD)
    every = Objective(one, space, weights, names, False, lambda name, gains: gains[:, :2])
    candidates = np.array([space.start, 0.5 * space.start, 60.0 * space.start])
    return every.values(candidates, np.array([0, 3]))


def marginal(law: Any = PD, asked: tuple[float, float] = (2.0, 0.5), **loop: Any) -> MarginTest:
    """The test of margins around a controller."""
    one = scenario(law, **loop)
    return MarginTest(one, GainSpace.of(one, None), 20, 1, asked)


def margins(_: Path) -> dict[str, Any]:
    """Shares of poses that fail, by how much, what is watched then, slower gains, and refusals."""
    test = marginal()
    start = space_of(PD).start
    rows = start * np.array([1.0, 3.0, 8.0, 9.0, 12.0, 20.0])[:, None]
    found: dict[str, Any] = {"poses": test.poses, "failing": test.failing(rows), "excess": test.excess(rows)}
    found["measured"] = [test.measured(name, rows[:2]) for name in ("noise_gain", "sensitivity")]
    found["keeps"] = [test.keeps(row) for row in rows]
    found["failing then"] = test.failing(rows)
    fast = replace(PD, kp=[9e3, 3e3], kd=[900.0, 300.0])
    found["slower"] = marginal(fast).slower()
    found["not slower"] = marginal(aw.JointPID(kp=1.0, kd=0.1), timing=aw.Timing(command_delay=0.02)).slower()
    late = {"timing": aw.Timing(command_delay=6e-3)}
    found["refusals"] = [str(marginal(fast, **each).refusal()) for each in (late, {"timing": aw.Timing()})]
    for name, law in (("unstable", replace(PD, kd=[60.0, 2e3])), ("drifts", aw.JointPID(kp=1.0))):
        try:
            marginal(law).check_start()
        except aw.ArmwrightError as error:
            found[name] = str(error)
    return found


def linear(_: Path) -> list[Any]:
    """Measures of the linear loop, infinite where it is unstable, also of several rates."""
    loops = [LinearLoop(replace_gains(PD)), LinearLoop(replace_gains(CASCADE))]
    q = np.array([[0.2, 0.4], [1.0, -1.0]])
    rows = [np.array([[600.0, 120.0], [200.0, 50.0], [1e6, 1e3]]), np.array([[8.0, 8.0], [3.0, 20.0]])]
    found = [measure("noise_gain", loop, q, each) for loop, each in zip(loops, rows, strict=True)]
    return [*found, measure("sensitivity", loops[0], q, rows[0])]


def replace_gains(law: Any) -> aw.Scenario:
    """A scenario whose position gains are a batch."""
    name = "position_kp" if isinstance(law, aw.Cascade) else "kp"
    return scenario(replace(law, **{name: Batch(np.ones((1, 2)))}))


def hill(points: np.ndarray) -> np.ndarray:
    """A curved valley whose lowest point is at 0.3, 0.7."""
    return 3.0 * (points[:, 0] - 0.3) ** 2 + (points[:, 1] - 0.7 + points[:, 0] - 0.3) ** 2


def searched(method: Any, count: int, generations: int) -> list[Any]:
    """All points of a search, by a method."""
    seen: list[np.ndarray] = []

    def score(points: np.ndarray) -> np.ndarray:
        seen.append(points.copy())
        return hill(points)

    method(score, np.array([0.5, 0.9]), count, generations, np.random.default_rng(5))
    return [len(seen), np.concatenate(seen)]


def searches(_: Path) -> dict[str, Any]:
    """Gains of a search that are lowered where they lack margins, their scores, and the best of each generation."""
    test, each = marginal(), objective(rms_error=1.0)
    scales = {"rms_error": np.ones(2)}

    def values(gains: np.ndarray, lanes: np.ndarray) -> dict[str, np.ndarray]:
        near = np.abs(np.log(gains / (1.7 * each.space.start)))[:, None, :2] * np.ones((1, len(lanes), 1))
        far = np.where(gains[:, :1, None] < 300.0, np.inf, near)
        return {"rms_error": far, "peak_torque": 25.0 * near}

    object.__setattr__(each, "values", values)
    search = GainSearch(each, test, scales, np.arange(2), 1.5)
    start = each.space.start
    rows = start * np.array([1.0, 1.4, 3.0, 9.0, 30.0, 0.3])[:, None]
    lowered, failing, often = search._lowered(rows)
    found: dict[str, Any] = {"lowered": lowered, "failing": failing, "often": often, "scores": search._scores(rows)}
    found |= {"best": search.best, "score": search.score, "simulated": search.simulated, "tried": list(search.tried)}
    found["none kept"] = search._scores(rows[3:5] * 40.0)
    search.begin_at(0.9 * start)
    found["begun"] = [search.begun, search.best, search.score, search.simulated]
    seen: list[Any] = []
    search.run("cma", 2, None, 3, lambda done, total: seen.append([done, total]))
    search.run("differential-evolution", 2, 5, 3, lambda done, total: None)
    return found | {"progress": seen, "simulated after": search.simulated}  # where it ends is up to the processor


def fronts(_: Path) -> list[Any]:
    """Pareto fronts of two of three objectives, with equal values."""
    values = np.array(
        [[1.0, 5.0, 2.0], [2.0, 3.0, 3.0], [2.0, 3.0, 1.0], [3.0, 3.0, 0.5], [4.0, 1.0, 9.0], [1.0, 6.0, 0.1]]
    )
    tried = Tried(("a", "b", "c"), values, np.arange(12.0).reshape(6, 2), values[0])
    return [tried.front(), tried.front(("b", "c")), tried.front(("c", "a"))]


MARGINS = aw.tuning.MarginConstraint(poses=20)
TUNED: dict[str, dict[str, Any]] = {
    "cma": {},
    "differential evolution": {"method": "differential-evolution", "candidates": 5},
    "worst lane": {"over": "worst", "seed": 1},
    "no objective worse": {"improve_each": True, "objectives": {"rms_error": 1.0, "noise_gain": 0.1}},
    "front": {"front": 1, "objectives": {"saturation": 0.0, "rms_error": 1.0, "noise_gain": 0.05}},
    "limits": {"limits": {"peak_torque": [60.0, 20.0]}, "gains": {"kp": 3.0}, "draws": {"mass": 0.5, "delay": 1e-3}},
    "designed": {"start": "analytic", "gains": {"kd": 3.0}},
    "nothing found": {"objectives": {"saturation": 1.0}},
    "start without margins": {"law": replace(PD, kp=[4320.0, 864.0], kd=[360.0, 60.0])},
}


def tuned(law: Any = PD, gains: Any = None, **more: Any) -> dict[str, Any]:
    """A short tuning, in numbers and words."""
    search = {
        name: more.pop(name)
        for name in ("method", "candidates", "over", "seed", "improve_each", "front")
        if name in more
    }
    asked, seen = aw.tuning.Search(**{"generations": 2, "candidates": 4, **search}), []
    more["progress"] = lambda done, total: seen.append([done, total])
    return told(tune(scenario(law), gains, lanes=4, margins=MARGINS, search=asked, **more)) | {"progress": seen}


def told(found: Any) -> dict[str, Any]:
    """A result without its scenario, with its tables and sentences."""
    own = {name: each for name, each in vars(found).items() if name != "scenario"}
    tables = [table.rows() for table in found.tables()]
    return own | {
        "tables": tables,
        "words": found.sentences(),
        "flags": [found.good, found.changed],
        "chosen": found.chosen,
    }


def words(_: Path) -> list[Any]:
    """Sentences and tables of results of all kinds."""
    found = tune(
        scenario(), lanes=4, margins=MARGINS, search=aw.tuning.Search(generations=1, candidates=4), progress=False
    )
    tuned_in = {
        "held_out": {"rms_error": np.array([[1.0, 2.0], [1.06, 2.05]])},
        "objectives": {"rms_error": (1.0, 1.2)},
    }
    changes: list[dict[str, Any]] = [
        {"improved": True, **tuned_in},
        {"improved": False, **tuned_in},
        {"improved": False, "start_keeps": False},
        {"improved": True, "begun": "analytic", "drawn": (), "objectives": {"saturation": (0.0, 0.1)}},
        {"start": {name: 0.0 * each for name, each in found.start.items()}},
    ]
    made = [replace(found, **each) for each in changes]
    lost = replace(found, tried=replace(found.tried, gains=0.0 * found.tried.gains))
    return [*map(told, made), lost.chosen, [title for title, _ in found.sections()], repr(found)]


def of_files(folder: Path) -> dict[str, Any]:
    """What a file asks for, and the file with other gains."""
    read = aw.read_scenario(EXAMPLES / "robust.scenario.toml")
    asked = in_file(read)
    found = tune(
        scenario(), lanes=4, margins=MARGINS, search=aw.tuning.Search(generations=1, candidates=4), progress=False
    )
    path = found.save(folder / "tuned.scenario.toml")
    again = aw.read_scenario(path)
    swing = in_file(aw.read_scenario(EXAMPLES / "swing.scenario.toml"))
    return {"asked": asked, "none": len(swing), "gains": [again.controller.kp, again.controller.kd]}


def checks(_: Path) -> dict[str, Any]:
    """Units, shares, weights and limits that are understood."""
    names = (
        "rms_error",
        "peak_torque",
        "saturation",
        "overshoot",
        "noise_gain",
        "sensitivity",
        "peak_voltage",
        "settling_time",
    )
    units = {name: [measure_units(model, name) for model in (arm("two-link"), arm("workshop"))] for name in names}
    return units | {
        "shares": [is_share(name) for name in names],
        "weights": checked_weights({"rms_error": 1, "sensitivity": 0.0}),
        "limits": checked_limits({"peak_torque": 4.0, "sensitivity": [2.0, 3.0]}, 2),
    }


CASES = {
    "spaces": spaces,
    **{f"lanes of {name}": lambda _, draws=draws: drawn(draws) for name, draws in DRAWS.items()},
    "lanes": further_draws,
    "scores": scores,
    "simulated scores": Case(simulated, close=1e-5),
    "margins": Case(margins, close=1e-5),
    "measures of linear loops": Case(linear, close=1e-5),
    "search by CMA-ES": lambda _: searched(_evolve, 5, 3),
    "search by differential evolution": lambda _: searched(_differential_evolution, 4, 3),
    "search": Case(searches, close=1e-5),
    "fronts": fronts,
    **{f"tuned, {name}": Case(lambda _, more=more: tuned(**more), close=1e-4) for name, more in TUNED.items()},
    "results in words": Case(words, close=1e-4),
    "files": of_files,
    "checks": checks,
}

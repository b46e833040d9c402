"""The stage that moves a plant in steps of each lane's own length, and what its blocks begin with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.kernels.loop import LaneGroup
from armwright.kernels.stages import HELD, NEXT, Adapt
from armwright.program import Program, call, interpret, trace
from armwright.scalar import Array, Scalar
from armwright.signals import Layout
from armwright.simulation.integrate.dormand_prince import ORDER, along, dormand_prince_step
from armwright.simulation.integrate.events import EventFunction, event_programs, event_values
from armwright.simulation.integrate.exponential import Pairs
from armwright.simulation.integrate.integrators import STEPPING, TOLERANCES
from armwright.simulation.integrate.step_control import ROUNDING, Allowed, floors, growth, quick_growth, share_of_range
from armwright.simulation.plant.switching import Watched, switching_programs

# Trials in each so many seconds of a tick (or in a shorter tick), if nothing else is said.
MOST_SUBSTEPS, EACH = 1000, 1e-3
ACCURACY = 1e-3  # of each quantity's range, at the end of a run
LEAST_TOLERANCE = 1e-14  # below it an estimate is rounding
LEAST_ACCURACY = 1e-12  # of a run, of which one step has a small part
LOOKS = (0.25, 0.5, 0.75)  # parts of a step at which it is asked whether something has switched within
REFUSED = 2.0  # error of a trial that goes beyond
CLOSEST = 0.98  # of a refused step, for the next trial
NO_EVENTS: Mapping[str, EventFunction] = {}


@dataclass(frozen=True)
class Adaptivity:
    """Settings by which a rule chooses its steps.

    Attributes:
        allowed: what a step may be wrong by.   most: trials in each `EACH` of a tick, or in a shorter tick; a lane that needs
            more is frozen; 0: of CVODES, which takes what it needs.
        events: by name, what to land on.
    """

    allowed: Allowed
    most: int
    events: tuple[tuple[str, EventFunction], ...] = ()

    @classmethod
    def of(
        cls,
        rule: str,
        *,
        accuracy: Any = None,
        rtol: Any = None,
        atol: Any = None,
        max_substeps: Any = None,
        events: Mapping[str, EventFunction] = NO_EVENTS,
    ) -> Adaptivity | None:
        """The settings of a scenario's solver for a rule; None if its step is fixed.

        Raises:
            ScenarioError: names the field, its value and what was expected.
        """
        auto, chooses, steps = rule == "auto", rule in TOLERANCES, rule in STEPPING
        whole = isinstance(max_substeps, Integral) and _is_number(max_substeps) and int(max_substeps) > 0
        tolerance, least = (f"a number of at least {v:g} and below 1" for v in (LEAST_TOLERANCE, LEAST_ACCURACY))
        checks = (  # name, value, whether it fits the rule, the rules that it fits, whether it may stand there, expected
            ("accuracy", accuracy, auto, "'auto' without a step", _is_tolerance(accuracy, LEAST_ACCURACY), least),
            ("rtol", rtol, chooses, "'rk45', 'rodas3' or 'cvodes'", _is_tolerance(rtol), tolerance),
            ("atol", atol, chooses, "'rk45', 'rodas3' or 'cvodes'", _is_positive(atol), "a number above 0 and below 1"),
            (
                "max_substeps",
                max_substeps,
                auto or steps,
                "'auto', 'rk45' or 'rodas3'",
                whole,
                "a whole number, 1 or more",
            ),
        )
        for name, value, fits, rules, allowed, expected in checks:
            if value is not None and not fits:
                what = f"goes with integrator = {rules}, not {rule!r}"
                raise ScenarioError(what, place=f"solver.{name}", value=value)
            if value is not None and not allowed:
                raise ScenarioError(place=f"solver.{name}", value=value, expected=expected)
        if not isinstance(events, Mapping) or not all(callable(each) for each in events.values()):
            raise ScenarioError(place="solver.events", value=events, expected="functions (t, x) by name")
        if events and not steps:
            raise ScenarioError(f"go with integrator = 'rk45' or 'rodas3', not {rule!r}", place="solver.events")
        if not chooses and not auto:
            return None
        relative, absolute = TOLERANCES.get(rule, (0.0, 0.0))
        relative, absolute = relative if rtol is None else float(rtol), absolute if atol is None else float(atol)
        wanted = (ACCURACY if accuracy is None else float(accuracy)) if auto else None
        most = MOST_SUBSTEPS if max_substeps is None else int(max_substeps)
        return cls(Allowed(relative, absolute, wanted), most if auto or steps else 0, tuple(events.items()))


def _is_number(value: Any) -> bool:
    return scalar.real_number(value) is not None


def _is_positive(value: Any) -> bool:
    return _is_number(value) and 0.0 < value < 1.0


def _is_tolerance(value: Any, least: float = LEAST_TOLERANCE) -> bool:
    return _is_number(value) and least <= value < 1.0


def speed_pairs(layout: Layout) -> Pairs:
    """Places of positions and their speeds in a state: of signals whose names differ by a d, as "q" and "qd"."""
    pairs = [(layout.place(name), layout.place(f"{name}d")) for name in layout.names if f"{name}d" in layout]
    return [
        (position, speed)
        for q, qd in pairs
        for position, speed in zip(range(q.start, q.stop), range(qd.start, qd.stop), strict=True)
    ]


def places_watched(layout: Layout, ahead: bool) -> list[int]:
    """Places in a state of what is compared with its range: of one step all but positions, whose speeds are as wrong.

    With a budget for all steps together (`ahead`), positions too: those of a swing gather errors.
    """
    positions = set() if ahead else {position for position, _ in speed_pairs(layout)}
    return [k for k in range(layout.size) if k not in positions]


def dormand_prince_trial(
    derivative: Callable[..., Array], shapes: Mapping[str, tuple[int, ...]]
) -> Callable[..., tuple[Array, ...]]:
    """(x, u, …, h) → x⁺, error, path of `dormand_prince_step`, for a derivative (x, u, …) with arguments of those shapes."""
    whole = trace("plant", derivative, shapes, ("xd",), noinline=True)

    def step(x: Array, u: Array, *rest: Array) -> tuple[Array, ...]:
        *inputs, h = rest
        return dormand_prince_step(lambda at, u: call(whole, at, u, *inputs), x, u, h)

    return step


def adaptive_stage(
    step: Callable[..., tuple[Array, ...]],
    shapes: Mapping[str, tuple[int, ...]],
    adaptivity: Adaptivity,
    layout: Layout,
    planned: int = 0,
    seen: tuple[str, ...] = (),
    watched: Watched | None = None,
    order: int = ORDER,
    *,
    lands: bool = False,
    ahead: bool = False,
) -> Adapt:
    """One tick of a plant by a rule that estimates its error, in steps that each lane chooses.

    Args:
        step: (x, u, …, h) → x⁺, error, and for events the path between x and x⁺.   shapes: of its arguments by name but h, "x"
            and "u" first.
        adaptivity: tolerances and events.   layout: of x.   planned, seen: as in `Integrate`.
        watched: what may switch; `step` then takes which contacts count as made, as its last argument before h.
        order: of the error in h.
        lands: whether `step` also tells, last, the error of the rule alone, and at which part of the step something changes; a
            trial behind one that is refused then ends there, where this part is below 1.
        ahead: whether a step of h seconds may be wrong by its part h / T of what a run of T seconds may, so that the errors of
            all steps together stay below `BUDGET` of the accuracy. Steps then go on beyond their tick, whose rows are read from
            the path; they end where something switches.
    """
    held, events, allowed = (
        {**shapes, **({} if watched is None else watched.block)},
        dict(adaptivity.events),
        adaptivity.allowed,
    )
    places = places_watched(layout, ahead) if allowed.accuracy is not None else []
    by_range: dict[str, tuple[int, ...]] = dict.fromkeys(("x_first", "reach") if places else (), (len(places),))
    by_range |= {"allowed": (1,)} if places else {}

    def trial(x: Array, *rest: Array) -> tuple[Array, ...]:
        inputs, h = rest[: len(held) - 1], rest[-1]
        new, error, *path = step(x, *inputs, h)
        smooth, place = (path.pop(-2), path.pop()) if lands else (None, None)
        if not by_range:
            share = allowed.share(x, new, error)
            grow = growth(share, order)
            if smooth is not None:
                grow = _landing(grow, share, place, growth(allowed.share(x, new, smooth), order))
            return (new, share, grow, *(path if events else ()))
        first, reach, (part,) = rest[len(held) - 1 : -1]
        reach = scalar.maximum(reach, scalar.abs(new[places] - first))
        part = scalar.maximum(part * h, ROUNDING) if ahead else part
        share, worst = share_of_range(error[places], reach, places, part)
        grow = growing(share)
        if smooth is not None:
            grow = _landing(grow, share, place, growing(share_of_range(smooth[places], reach, places, part)[0]))
        if ahead and watched is not None:
            share, grow = _seen_within(watched, len(shapes), x, path[0], inputs, share, grow)
        return new, share, grow, worst, reach, *(path if ahead else ())

    def growing(share: Scalar) -> Scalar:
        return growth(share, order - 1) if ahead else quick_growth(share)

    names = ("worst", f"reach{NEXT}") if by_range else ("path",) * bool(events)
    names += (f"path{NEXT}",) * ahead
    program = trace("trial", trial, {**held, **by_range, "h": ()}, (f"x{NEXT}", "error", "grow", *names))
    programs: dict[str, Any] = {
        **switching_programs(watched, shapes),
        **(event_programs(events, layout) if events else {}),
    }
    programs |= _ahead(shapes, searched=watched is not None) if ahead else {}
    return Adapt(program, adaptivity.most, planned, seen, **programs, each=EACH)


def _ahead(shapes: Mapping[str, tuple[int, ...]], *, searched: bool) -> dict[str, Program]:
    """The programs by which steps go on beyond their tick, for a plant with arguments of those shapes.

    `searched`: whether places within a step are sought, too.
    """

    def same(*values: Array) -> Array:
        now, before = (np.concatenate(each) for each in (values[: len(shapes)], values[len(shapes) :]))
        equal = scalar.equal(now[0], before[0])
        for a, b in zip(now[1:], before[1:], strict=True):
            equal = equal * scalar.equal(a, b)
        return scalar.array([equal])

    size = shapes["x"]
    blocks = {"x_from": size, "path": (4, *size), "part": (1,)}
    tried = {"x": size, f"path{NEXT}": (4, *size), "part": (1,)}
    programs = {
        "held": trace(
            "held", same, {**shapes, **{f"{name}{HELD}": shape for name, shape in shapes.items()}}, ("same",)
        ),
        "along": trace("along", lambda x, path, part: along(x, path, part[0]), blocks, ("x_at",)),
    }
    if searched:
        programs["within"] = trace("within", lambda x, path, part: along(x, path, part[0]), tried, (f"x{NEXT}",))
    return programs


def _seen_within(
    watched: Watched, count: int, x: Array, path: Array, inputs: Sequence[Array], share: Scalar, grow: Scalar
) -> tuple[Scalar, Scalar]:
    """Error and factor of a trial; refused, up to the first of `LOOKS`, where something has switched that is back at its end.

    So that the next trial ends within a contact of less than a step.

    Args:
        watched: what may switch.   count: of inputs, "x" among them, before contacts and directions.
        x, path: of the step.   inputs: that are held.   share, grow: of the trial.
    """

    def gone(part: float) -> list[Scalar]:
        at, switched = along(x, path, part), []
        if watched.contacts:
            depths = watched.depths(at, *inputs[: count - 1])
            switched += [
                scalar.less((it - 0.5) * depth, 0.0) for it, depth in zip(inputs[count - 1], depths, strict=True)
            ]
        if watched.sliding is not None:
            switched += [scalar.less(s, 0.0) for s in watched.sliding(at, *inputs)]
        return switched

    at_end = gone(1.0)
    for part in reversed(LOOKS):
        back = sum(there * (1.0 - end) for there, end in zip(gone(part), at_end, strict=True))
        share = scalar.where(scalar.less(0.0, back), scalar.maximum(share, REFUSED), share)
        grow = scalar.where(scalar.less(0.0, back), scalar.minimum(grow, part), grow)
    return share, grow


def _landing(grow: Scalar, share: Scalar, part: Scalar, smooth: Scalar) -> Scalar:
    """The factor for the next trial: in a step that is refused, to where something changes, if the rule's own error lets it.

    At most `CLOSEST`: a trial that ended all but where the refused one did would be lengthened to the same edge, for ever.
    """
    lands = scalar.less(1.0, share) * scalar.less(part, 1.0)
    return scalar.where(lands, scalar.minimum(scalar.minimum(part, CLOSEST), smooth), grow)


def begin_adaptive(
    lanes: LaneGroup, adaptivity: Adaptivity, layout: Layout, x0: np.ndarray, horizon: float | None
) -> None:
    """Fills the blocks that `adaptive_stage` adds, for lanes that begin in x0 (lanes, nx) at t = 0.

    `horizon`: [s] that one budget is for; None: every step has its own.
    """
    if adaptivity.allowed.accuracy is not None:
        places = places_watched(layout, horizon is not None)
        lanes.set("allowed", np.array([adaptivity.allowed.of_step(horizon)]))
        lanes.set("x_first", x0[:, places])
        lanes.set("reach", floors(layout)[places])
    if adaptivity.events:
        watched = dict(adaptivity.events)
        g = trace("sides", lambda x: event_values(watched, layout, 0.0, x), {"x": x0.shape[1:]}, ("g",))
        lanes.set("side", np.sign(np.asarray(interpret(g, x0)).reshape(len(x0), -1)))
        lanes.set("event_first", np.full(len(watched), np.nan))

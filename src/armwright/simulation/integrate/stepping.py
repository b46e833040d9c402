"""The stage that moves a plant in steps of each lane's own length; initial blocks and final status of its lanes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import DivergenceError, ScenarioError
from armwright.kernels.loop import Lanes
from armwright.kernels.stages import NEXT, Adapt
from armwright.program import call, interpret, trace
from armwright.scalar import Array
from armwright.signals import Layout
from armwright.simulation.integrate.dormand_prince import trial_step
from armwright.simulation.integrate.events import EventFunction, event_programs, event_values
from armwright.simulation.integrate.exponential import Pairs
from armwright.simulation.integrate.integrators import TOLERANCES
from armwright.simulation.plant.switching import Watched, switching_programs

if TYPE_CHECKING:
    import xarray

MOST_STEPS = 1000  # trials in one tick, if nothing else is said


@dataclass(frozen=True)
class Adaptivity:
    """Settings by which a rule chooses its steps.

    Attributes:
        rtol, atol: each entry of the state may be wrong by atol + rtol |x| in a step, in its own unit.
        most: trials in one tick, a lane that needs more is frozen; 0: of CVODES, which takes what it needs.
        events: by name, what to land on.
    """

    rtol: float
    atol: float
    most: int
    events: tuple[tuple[str, EventFunction], ...] = ()

    @classmethod
    def of(
        cls, integrator: str, substeps: int, rtol: Any, atol: Any, max_steps: Any, events: Mapping[str, EventFunction]
    ) -> Adaptivity | None:
        """The settings of a scenario's solver; None if the integrator's step is fixed.

        Raises:
            ScenarioError: names the field, its value and what was expected.
        """
        chooses, lands = integrator in TOLERANCES, integrator == "rk45"
        whole = isinstance(max_steps, Integral) and _is_number(max_steps) and int(max_steps) > 0
        checks = (  # name, value, needed integrator, whether it may stand there, expected
            ("rtol", rtol, chooses, _is_tolerance(rtol), "a tolerance above 0 and below 1"),
            ("atol", atol, chooses, _is_tolerance(atol), "a tolerance above 0 and below 1"),
            ("max_steps", max_steps, lands, whole, "a whole number, 1 or more"),
        )
        for name, value, fits, allowed, expected in checks:
            if value is not None and not fits:
                needed = "'rk45'" if name == "max_steps" else "'rk45' or 'cvodes'"
                what = f"goes with integrator = {needed}, not {integrator!r}"
                raise ScenarioError(what, place=f"solver.{name}", value=value)
            if value is not None and not allowed:
                raise ScenarioError(place=f"solver.{name}", value=value, expected=expected)
        if not isinstance(events, Mapping) or not all(callable(each) for each in events.values()):
            raise ScenarioError(place="solver.events", value=events, expected="functions (t, x) by name")
        if events and not lands:
            raise ScenarioError(f"go with integrator = 'rk45', not {integrator!r}", place="solver.events")
        if chooses and substeps != 1:
            raise ScenarioError(f"{integrator} chooses its own", place="solver.substeps", value=substeps, expected="1")
        if not chooses:
            return None
        relative, absolute = TOLERANCES[integrator]
        return cls(
            relative if rtol is None else float(rtol),
            absolute if atol is None else float(atol),
            0 if not lands else MOST_STEPS if max_steps is None else int(max_steps),
            tuple(events.items()),
        )


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _is_tolerance(value: Any) -> bool:
    return _is_number(value) and 0.0 < value < 1.0


def speed_pairs(layout: Layout) -> Pairs:
    """Places of positions and their speeds in a state: of signals whose names differ by a d, as "q" and "qd"."""
    pairs = [(layout.place(name), layout.place(f"{name}d")) for name in layout.names if f"{name}d" in layout]
    return [
        (position, speed)
        for q, qd in pairs
        for position, speed in zip(range(q.start, q.stop), range(qd.start, qd.stop), strict=True)
    ]


def adaptive_stage(
    derivative: Callable[..., Array],
    shapes: Mapping[str, tuple[int, ...]],
    adaptivity: Adaptivity,
    layout: Layout,
    planned: int = 0,
    seen: tuple[str, ...] = (),
    watched: Watched | None = None,
) -> Adapt:
    """One tick of a plant by Dormand and Prince's rule.

    Args:
        derivative: (x, u, …) → dx/dt.   shapes: of its arguments by name, "x" and "u" first.
        adaptivity: tolerances and events.   layout: of x, for events.   planned, seen: as in `Integrate`.
        watched: what may switch; `derivative` then takes which contacts count as made, as its last argument.
    """
    shapes_held = {**shapes, **({} if watched is None else watched.block)}
    whole = trace("plant", derivative, shapes_held, ("xd",), noinline=True)
    events = dict(adaptivity.events)

    def trial(x: Array, u: Array, *rest: Array) -> tuple[Array, ...]:
        *constant, h = rest
        new, error, grow, path = trial_step(
            lambda x, u: call(whole, x, u, *constant), x, u, h, adaptivity.rtol, adaptivity.atol
        )
        return (new, error, grow, path) if events else (new, error, grow)

    names = (f"x{NEXT}", "error", "grow", *(("path",) if events else ()))
    program = trace("trial", trial, {**shapes_held, "h": ()}, names)
    watching = event_programs(events, layout) if events else {}
    return Adapt(program, adaptivity.most, planned, seen, **watching, **switching_programs(watched, shapes))


def begin_adaptive(lanes: Lanes, adaptivity: Adaptivity, layout: Layout, x0: np.ndarray) -> None:
    """Fills the blocks that `adaptive_stage` adds, for lanes that begin in x0 (lanes, nx) at t = 0."""
    if adaptivity.events:
        watched = dict(adaptivity.events)
        g = trace("sides", lambda x: event_values(watched, layout, 0.0, x), {"x": x0.shape[1:]}, ("g",))
        lanes.set("side", np.sign(np.asarray(interpret(g, x0)).reshape(len(x0), -1)))
        lanes.set("event_first", np.full(len(watched), np.nan))


@dataclass(frozen=True, eq=False)
class LaneStatus:
    """Status of the lanes at the end of a run: (lanes, …) each.

    Attributes:
        frozen: tick in which a lane stopped, -1: none.   stalled: whether for want of steps.   trials: steps tried.
        first, count: (lanes, E) of events: the first time [s], NaN: none, and how often.
    """

    frozen: np.ndarray
    stalled: np.ndarray
    trials: np.ndarray
    first: np.ndarray
    count: np.ndarray

    @classmethod
    def of(cls, lanes: int, events: int) -> LaneStatus:
        """Status of lanes to which nothing has happened yet."""
        return cls(
            np.full(lanes, -1.0),
            np.zeros(lanes, dtype=bool),
            np.zeros(lanes),
            np.full((lanes, events), np.nan),
            np.zeros((lanes, events), dtype=int),
        )

    def read(self, lanes: Lanes) -> None:
        """Takes over the status of a group of lanes from their blocks."""
        group = slice(lanes.first, lanes.first + lanes.count)
        for name, values in (("frozen", self.frozen), ("stalled", self.stalled), ("trials", self.trials)):
            if name in lanes.blocks:
                values[group] = lanes.get(name)[:, 0]
        if "event_first" in lanes.blocks:
            self.first[group] = lanes.get("event_first")
            self.count[group] = lanes.get("event_count")

    def of_lanes(self, lanes: np.ndarray) -> LaneStatus:
        """Status of some of the lanes."""
        every = (self.frozen, self.stalled, self.trials, self.first, self.count)
        return self if len(lanes) == len(self.frozen) else LaneStatus(*(values[lanes] for values in every))

    def check(self, name: str, tick: float, last_row: str = "") -> None:
        """Refuses a single run that stopped.

        Raises:
            DivergenceError: with the time, the reason and the last row.
        """
        if self.frozen[0] < 0:
            return
        stalled = bool(self.stalled[0])
        what = "the integrator ran out of steps in the tick" if stalled else "the simulation left the finite numbers"
        what += f" at t = {self.frozen[0] * tick:g} s{'; ' * bool(last_row)}{last_row}"
        expected = "looser tolerances, a larger max_steps, or integrator = 'cvodes'" if stalled else ""
        raise DivergenceError(what, expected=expected, file=name)

    def add_to(self, run: xarray.Dataset, tick: float, adaptivity: Adaptivity | None, single: bool) -> None:
        """Adds variables to a run: times at which lanes diverged or stalled, steps tried, events."""

        def put(name: str, dims: tuple[str, ...], values: np.ndarray, unit: str, about: str) -> None:
            attrs: dict[str, Any] = {"units": unit, "long_name": about}
            run[name] = (dims, values[0], attrs) if single else (("lane", *dims), values, attrs)

        stopped = np.where(self.frozen < 0, np.nan, self.frozen * tick)
        if not single:
            diverged = np.where(self.stalled, np.nan, stopped)
            put("diverged_at", (), diverged, "s", "time at which the lane left the finite numbers")
        if adaptivity is None:
            return
        run.attrs |= {"rtol": adaptivity.rtol, "atol": adaptivity.atol}
        if not adaptivity.most:
            return
        if not single:
            put(
                "stalled_at",
                (),
                np.where(self.stalled, stopped, np.nan),
                "s",
                "time at which the lane ran out of steps",
            )
        put("steps_tried", (), self.trials, "1", "steps that the integrator tried")
        if adaptivity.events:
            run.coords["event"] = ("event", [name for name, _ in adaptivity.events])
            put("event_time", ("event",), self.first, "s", "first time of the event")
            put("event_count", ("event",), self.count, "1", "how often the event happened")

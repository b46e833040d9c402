"""Events: when a function of time and state changes its sign, found within a step and landed on.

Before anything happens, side_e = sign g_e(t, x) says on which side each of E functions is. A step ends beyond event e where
side_e g_e < 0. Along the step's path the place is halved down; the step is then taken again to just behind the first of
them, which is noted, and side_e turns round. Two changes of one function within one step are not seen.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from armwright import scalar
from armwright.entry import AnyArm, as_arm
from armwright.errors import ScenarioError
from armwright.interfaces import UNTRACEABLE, why
from armwright.kernels.stages import NEXT
from armwright.program import Program, trace
from armwright.scalar import Array, Scalar
from armwright.signals import Layout, SignalValues
from armwright.simulation.integrate.dormand_prince import along

EventFunction = Callable[[Any, Any], Any]  # (t, x) → g, with x.q, x.qd and what else the plant's state has


def joint_stops(arm: AnyArm) -> dict[str, EventFunction]:
    """Events of the joints that reach, or leave, an end of their range.

    Args:
        arm: the model; joints without limits have no such events.
    Returns:
        events: by name, "JOINT low" and "JOINT high": q_j - limit [rad | m].
    Example:
        >>> list(aw.simulation.joint_stops(aw.load("ur5e")))[:2]
        ['shoulder_pan_joint low', 'shoulder_pan_joint high']
    """
    arm = as_arm(arm)

    def passing(j: int, limit: float) -> EventFunction:
        return lambda t, x: x.q[j] - limit

    ends = (("low", 0), ("high", 1))
    return {
        f"{body.joint} {end}": passing(j, float(body.limits.position[k]))
        for j, body in enumerate(arm.coordinates)
        for end, k in ends
        if np.isfinite(body.limits.position[k])
    }


def event_values(events: Mapping[str, EventFunction], layout: Layout, t: Scalar, x: Array) -> np.ndarray:
    """g (E,) of a state at a time.

    Raises:
        ScenarioError: names an event whose function gives no number, or cannot be traced.
    """
    state, values = SignalValues(layout.parts(x)), []
    for name, function in events.items():
        try:
            value = scalar.array(function(t, state))
        except UNTRACEABLE as error:
            expected = "a function (t, x) written with armwright.scalar"
            what = f"cannot be compiled: {why(error)}"
            raise ScenarioError(what, place=f"solver.events {name!r}", expected=expected) from None
        if value.size != 1 or value.ndim > 1:
            raise ScenarioError(f"gave shape {value.shape}", place=f"solver.events {name!r}", expected="one number")
        values.append(value.ravel()[0])
    return scalar.array(values)


def event_programs(events: Mapping[str, EventFunction], layout: Layout) -> dict[str, Program]:
    """The programs that `kernels.stages.Adapt` watches with, for states of that layout."""
    size = layout.size
    count = len(events)
    one, all_, state = (1,), (count,), (size,)

    def cross(x: Array, after: Array, side: Array) -> tuple[Array, Array]:
        g = event_values(events, layout, after[0], x)
        settled = [scalar.where(scalar.equal(s, 0.0), scalar.sign(v), s) for s, v in zip(side, g, strict=True)]
        return scalar.array([scalar.less(s * v, 0.0) for s, v in zip(side, g, strict=True)]), scalar.array(settled)

    def halve(
        x: Array, path: Array, now: Array, h: Scalar, side: Array, lower: Array, upper: Array
    ) -> tuple[Array, Array]:
        ends = []
        for e, (name, function) in enumerate(events.items()):
            middle = 0.5 * (lower[e] + upper[e])
            g = event_values({name: function}, layout, now[0] + middle * h, along(x, path, middle))[0]
            beyond = scalar.less(side[e] * g, 0.0)
            ends.append((scalar.where(beyond, lower[e], middle), scalar.where(beyond, middle, upper[e])))
        return scalar.array([low for low, _ in ends]), scalar.array([high for _, high in ends])

    def choose(upper: Array, crossed: Array) -> tuple[Array, Array]:
        places = [scalar.where(c, place, 2.0) for c, place in zip(crossed, upper, strict=True)]
        first = places[0]
        for place in places[1:]:
            first = scalar.minimum(first, place)
        return scalar.array([first]), scalar.array([scalar.less_equal(place, first) for place in places])

    def note(
        hit: Array, settled: Array, landed: Array, moved: Array, after: Array, side: Array, first: Array, count: Array
    ) -> tuple[Array, Array, Array]:
        happened = [h * landed[0] * moved[0] for h in hit]
        sides = [
            scalar.where(it, -s, scalar.where(moved[0], new, s))
            for it, s, new in zip(happened, side, settled, strict=True)
        ]
        times = [
            scalar.where(it * scalar.equal(c, 0.0), after[0], f)
            for it, f, c in zip(happened, first, count, strict=True)
        ]
        return scalar.array(sides), scalar.array(times), scalar.array(count + scalar.array(happened))

    return {
        "cross": trace(
            "cross", cross, {f"x{NEXT}": state, "after": one, "side": all_}, ("crossed", "settled"), noinline=True
        ),
        "halve": trace(
            "halve",
            halve,
            {"x": state, "path": (4, size), "now": one, "h": (), "side": all_, "lower": all_, "upper": all_},
            (f"lower{NEXT}", f"upper{NEXT}"),
        ),
        "choose": trace("choose", choose, {"upper": all_, "crossed": all_}, ("part", "hit_new")),
        "note": trace(
            "note",
            note,
            {"hit": all_, "settled": all_, "landed": one, "moved": one, "after": one}
            | {"side": all_, "event_first": all_, "event_count": all_},
            (f"side{NEXT}", f"event_first{NEXT}", f"event_count{NEXT}"),
        ),
    }

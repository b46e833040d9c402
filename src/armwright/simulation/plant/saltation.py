"""The end of a step at which something switches, such that its derivative is the saltation matrix; and where there is none.

Where a function g of the state passes 0 and the motion ẋ = f₋ becomes ẋ = f₊, the state x just beyond is taken back along f₋
to that place, and from there along f₊ for as long:

    x⁺ = x + (f₋ - f₊) δ,   δ = -g / ġ,   ġ = ∇g · f₋

With g = 0 that is x itself, and its derivative  S⁺ = S + (f₋ - f₊) ∂δ,  ∂δ = -(∇g S + ∂g/∂p) / ġ,  is that of a motion whose
switching time moves with what is differentiated by. [DiBernardoEtAl2008]

Where g all but touches 0, a small change decides whether there is an event at all. With the rates ġ₀ and ġ₁ at both ends of a
step of length h, g rises to  g₀ + h ġ₀² / 2 (ġ₀ - ġ₁)  within it, and behind a passage at its end by  h ġ₁² / 2 (ġ₀ - ġ₁)  more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from armwright import scalar
from armwright.kernels.stages import NEXT
from armwright.program import Program, call, trace
from armwright.program.derivative import with_tangents
from armwright.scalar import Array
from armwright.simulation.plant.switching import Switching, furthest

TOUCHED = 1e-6  # [rad | m, rad/s | m/s, rad/s² | m/s²]: what rises to so little below or above 0 grazes
LAST = (
    0.01  # part of its first rate with which g may still rise at the end of a step in which it counts as come to rest
)
ROUNDING = 1e-14  # in the same units: what rises by less within a step does not rise


def landing_programs(
    switching: Switching, derivative: Callable[..., Array], at_rest: Callable[[Array, Sequence[Array], Array], Array]
) -> dict[str, Program]:
    """The programs `landing` and `grazing` of `Integrate`.

    Args:
        switching: what may switch.   derivative: (x, u, …, touching, directions) → dx/dt.
        at_rest: (x, inputs, directions) → x with speeds of 0 for what sticks.
    """
    watched, size = switching.watched, switching.shapes["x"]
    moving, held = {"x": size, **switching.constant}, len(watched.block)
    # Not "plant", the name in the steps: programs of one native module need different names.
    rate = trace("rate", derivative, moving, ("xd",), noinline=True)

    def passing(x: Array, *rest: Array) -> Array:
        *inputs, weights = rest
        depths, others, _ = switching.values(x, *inputs)
        return scalar.array([furthest(weights, [*depths, *others])])

    def margins(x: Array, *inputs: Array) -> Array:
        depths, others, _ = switching.values(x, *inputs)
        contacts = inputs[-held] if watched.contacts else ()
        return scalar.array(
            [
                *((1.0 - 2.0 * it) * depth for it, depth in zip(contacts, depths, strict=True)),
                *(-s for s in others[: watched.elements]),
            ]
        )

    weights = {"weights": (switching.count,)}
    passing_along = with_tangents(trace("passing", passing, {**moving, **weights}), ("x",), {}, 1)
    margins_along = with_tangents(trace("margins", margins, moving), ("x",), {}, 1, noinline=True)

    def landing(x: Array, *rest: Array) -> Array:
        *inputs, weights = rest
        constant = inputs[:-held]
        before = call(rate, x, *inputs)
        g, slope = call(passing_along, np.concatenate([x, before]), *inputs, weights)
        settled = x if watched.settled is None else watched.settled(x, *inputs)
        begun = switching.begun(settled, *constant)
        landed = x - (before - call(rate, settled, *constant, *begun)) * (g / slope)
        return at_rest(landed, constant, begun[-1]) if watched.elements else scalar.array(landed)

    def grazing(x: Array, after: Array, *rest: Array) -> Array:
        *inputs, h = rest
        ends = [call(margins_along, np.concatenate([at, call(rate, at, *inputs)]), *inputs) for at in (x, after)]
        count, which = len(ends[0]) // 2, 0.0
        for k in range(count):
            (begin, rising), (end, still) = ((values[k], values[count + k]) for values in ends)
            bend = rising - still
            bends = scalar.less(0.0, bend)
            per = 0.5 * h / scalar.where(bends, bend, 1.0)
            rise, more = per * rising * rising, per * still * still
            within = scalar.less(0.0, rising) * scalar.less(still, LAST * rising) * scalar.less(ROUNDING, rise)
            peaks = within * scalar.less(end, 0.0) * scalar.less(scalar.abs(begin + rise), TOUCHED)
            passes = scalar.less_equal(0.0, end) * bends * scalar.less(more, TOUCHED)
            which = scalar.where(scalar.maximum(peaks, passes), k + 1.0, which)
        return scalar.array([which])

    after = {f"x{NEXT}": size}
    return {
        "landing": trace("landing", landing, {**after, **switching.constant, **weights}, (f"x{NEXT}{NEXT}",)),
        "grazing": trace("grazing", grazing, {"x": size, **after, **switching.constant, "h": ()}, (f"grazed{NEXT}",)),
    }

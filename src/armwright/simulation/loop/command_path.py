"""Stages from what a controller commands to what is in force at the drives: shaped, delayed, late or lost. Design section 4."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.kernels.stages import NEVER, NEXT, Call, Delay, Stage
from armwright.program import trace
from armwright.scalar import Array
from armwright.simulation.loop.command_filter import CommandFilter
from armwright.simulation.loop.timing import Delays, lateness, planned


def command_stages(n: int, period: float, command_filter: CommandFilter, delays: Delays) -> list[Stage]:
    """From block "u_asked" (n,) to "u_issued", which is recorded, and "u", in force; between ticks by "u_plan" and "u_from".

    Args:
        n: joints.   period: [s] of the loop.   command_filter, delays: what becomes of commands, and when.
    """
    late, fractional, waits = bool(np.any(delays.commanded)), delays.fractional, delays.pending
    issued = "u_issued" if late or fractional else "u"

    def shape(asked: Array, last: Array) -> tuple[Array, ...]:
        u, kept = command_filter.filtered(period, asked, last)
        return (*([u] if issued == "u" else []), u, *([kept] if command_filter.remembers else []))

    outputs = (
        *(["u"] if issued == "u" else []),
        f"u_issued{NEXT}",
        *([f"u_kept{NEXT}"] if command_filter.remembers else []),
    )
    last = "u_kept" if command_filter.remembers else "u_issued"
    stages: list[Stage] = [Call(trace("shape", shape, {"u_asked": (n,), last: (n,)}, outputs))]
    if late:
        stages.append(
            Delay("u_issued", "u_queued" if fractional else "u", "d_commanded", n, int(delays.commanded.max()) + 1)
        )
        issued = "u_queued"
    if not fractional:
        return stages

    def plan(tick: Array, u: Array, waiting: Array, arrivals: Array, base: Array, d: Array, w: Array):
        late = lateness(delays, tick[0], d[0], d[1], d[2], w[0])
        if np.any(delays.command_loss):
            late = scalar.where(scalar.less(w[1], d[3]), NEVER, late)
        plans, begins, waiting, arrivals, base = planned(tick[0], u, late, waiting.reshape(waits, n), arrivals, base)
        now = plans[0]
        for begin, command in zip(begins, plans[1:], strict=True):
            now = scalar.where(scalar.less_equal(begin, 0.0), command, now)
        return plans.ravel(), begins * period, waiting.ravel(), arrivals, base, scalar.array(now)

    shapes = {
        "tick": (1,),
        issued: (n,),
        "waiting": (waits * n,),
        "arrivals": (waits,),
        "u_base": (n,),
        "d": (5,),
        "w_timing": (3,),
    }
    outputs = ("u_plan", "u_from", f"waiting{NEXT}", f"arrivals{NEXT}", f"u_base{NEXT}", "u")
    stages.append(Call(trace("plan", plan, shapes, outputs)))
    return stages

"""Stages from what a controller commands to what is in force at the drives: rate limit, limit, resolution, delay, loss.

Design section 4, steps 4 and 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.kernels.stages import NEVER, NEXT, Call, DelayStage, Stage
from armwright.model import Model
from armwright.parameters import UNSET, NumbersOrNone
from armwright.program import trace
from armwright.scalar import Array
from armwright.simulation.checks import check_numbers, one_each
from armwright.simulation.loop.timing import Delays, lateness, planned

WHOLE = 1e-9  # of a step: a limit this near a whole number of them is meant to be it


@dataclass(frozen=True)
class CommandFilter:
    """The command's way through the controller's output stage; each number may be one for each joint.

    The rate is limited first, then the command. The state keeps the unrounded command; the output is rounded to the nearest step
    of the converter within the limit.

    Args:
        limit: [V | A | N m | N] the most that is commanded, either way; absent or inf: no limit of the controller's own.
        rate: [1/s of the same] how fast a command may change; absent or inf: at once.
        resolution: [of the same] its steps, of a DAC or of a PWM's timer; absent: none.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> converter = aw.CommandFilter(limit=10.0, resolution=20.0 / 4096)  # a 12-bit DAC
        >>> converter.limit
        10.0
    """

    limit: NumbersOrNone = UNSET
    rate: NumbersOrNone = UNSET
    resolution: NumbersOrNone = UNSET

    def __post_init__(self) -> None:
        for name in ("limit", "rate"):
            if getattr(self, name) is not None:
                place = f"command_filter.{name}"
                check_numbers(place, getattr(self, name), lambda v: v > 0.0, "a number above 0", per_joint=True)
        if self.resolution is not None:
            place, expected = "command_filter.resolution", "a finite number above 0"
            check_numbers(place, self.resolution, _finite, expected, per_joint=True)

    @property
    def remembers(self) -> bool:
        """True where the next command depends on this one."""
        return self.rate is not None

    def check(self, arm: Model) -> None:
        """Refuses numbers that are not one for each joint of the arm, and limits below the first step.

        Raises:
            ScenarioError: names the field, its value and what was expected.
        """
        values = {name: getattr(self, name) for name in ("limit", "rate", "resolution")}
        each = {name: one_each(f"command_filter.{name}", v, arm) for name, v in values.items() if v is not None}
        if "limit" in each and "resolution" in each:
            for joint, limit, step in zip(arm.names, each["limit"], each["resolution"], strict=True):
                if not _steps(limit, step) >= 1.0:
                    what, expected = f"leaves no command but 0 to {joint}", f"at most limit = {limit:g}"
                    raise ScenarioError(what, place="command_filter.resolution", value=float(step), expected=expected)

    def filtered(self, period: float, u: Array, last: Array) -> tuple[np.ndarray, np.ndarray]:
        """The command that leaves, and what is remembered.

        Args:
            period: [s] since the last one.   u: (n,) asked for.   last: (n,) what was remembered then.
        Returns:
            issued: (n,), within the limit and on a step.   kept: (n,), before it was rounded.
        """
        n = len(u)
        most = np.full(n, np.inf) if self.limit is None else np.broadcast_to(self.limit, n).astype(float)
        if self.rate is not None:
            change = np.broadcast_to(self.rate, n) * period
            u = scalar.clip(u, last - change, last + change)
        if self.limit is not None:
            u = scalar.clip(u, -most, most)
        kept = issued = u
        if self.resolution is not None:
            step = np.broadcast_to(self.resolution, n).astype(float)
            issued = scalar.floor(u / step + 0.5) * step
            if self.limit is not None:  # nearest may be beyond
                most = np.minimum(_steps(most, step) * step, most)
                issued = scalar.clip(issued, -most, most)
        return scalar.array(issued), scalar.array(kept)


def _finite(values: np.ndarray) -> np.ndarray:
    return (values > 0.0) & np.isfinite(values)


def _steps(limit: Any, step: Any) -> Any:
    """Number of steps within a limit; infinite for steps that are next to nothing."""
    with np.errstate(over="ignore"):
        return np.floor(limit / step + WHOLE)


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
            DelayStage("u_issued", "u_queued" if fractional else "u", "d_commanded", n, int(delays.commanded.max()) + 1)
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

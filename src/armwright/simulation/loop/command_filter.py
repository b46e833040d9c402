"""Command filter: rate limit, limit and resolution of what a controller commands. Design section 4, step 4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.scalar import Array
from armwright.simulation.checks import check_numbers, one_each

WHOLE = 1e-9  # of a step: a limit this near a whole number of them is meant to be it


@dataclass(frozen=True)
class CommandFilter:
    """The command's way through the controller's output stage; each number may be one for each joint.

    The rate is limited first, then the command; what comes of it is remembered for the next time as it is, unrounded, and
    leaves rounded to the nearest of the steps that lie within the limit.

    Args:
        limit: [V | A | N m | N] the most that is commanded, either way; absent or inf: no limit of the controller's own.
        rate: [1/s of the same] how fast a command may change; absent or inf: at once.
        resolution: [of the same] its steps, of a DAC or of a PWM's timer; absent: none.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    """

    limit: Any = None
    rate: Any = None
    resolution: Any = None

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
        """Whether the next command depends on this one."""
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
    """How many steps lie within a limit."""
    return np.floor(limit / step + WHOLE)

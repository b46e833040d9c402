"""Controllers around an inner one: they change its command and correct the drives' feedback that it sees."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.interfaces import JointReference, Measurement, called
from armwright.model import Model
from armwright.scalar import Array, Scalar
from armwright.simulation.loop.controller import check_controller


@dataclass(frozen=True, eq=False)
class Wrapper(ABC):
    """A controller that changes the command of an inner one.

    The inner controller sees `y.applied` less what was added to its own command, so that its anti-windup compares like with
    like. A subclass gives its memory by `memory`, and the changed command by `changed`.

    Attributes:
        inner: a function (t, r, y) → u, or an object with `init` and `step`.   arm, period: set by `configure`.
    """

    inner: Any
    arm: Model | None = field(default=None, kw_only=True)
    period: float | None = field(default=None, kw_only=True)  # [s] of the loop

    def __post_init__(self) -> None:
        check_controller(self.inner)
        if getattr(self.inner, "vectorised", False):
            place, expected = f"{type(self).__name__}.inner", "one that sees the arrays of one lane"
            raise ScenarioError(place=place, value=called(self.inner), expected=expected)

    @abstractmethod
    def memory(self, arm: Model, y: Measurement) -> Array:
        """Initial memory (k,), k the same in every tick."""

    @abstractmethod
    def changed(self, r: JointReference, y: Measurement, u: Array, s: Array) -> tuple[Array, Array]:
        """The command (n,) in place of the inner one's u (n,), and the memory (k,) for the next tick."""

    def configure(self, arm: Model, period: float) -> Self:
        """The controller for an arm and a sample period [s], its inner one too.

        Args:
            arm: the model.   period: [s].
        Raises:
            ScenarioError: a number of the wrong length or size; names it and the joints.
        """
        inner = self.inner.configure(arm, period) if hasattr(self.inner, "configure") else self.inner
        return replace(self, inner=inner, arm=arm, period=period)

    @property
    def delay_ticks(self) -> int:
        """Whole ticks of delay from command to drive, as in the inner controller."""
        return int(getattr(self.inner, "delay_ticks", 0) or 0)

    def init(self, arm: Model, y: Measurement) -> Array:
        """Initial state: nothing added, this controller's memory, then the inner controller's."""
        nothing = scalar.zeros((1 + self.delay_ticks) * arm.n)
        inner = [np.atleast_1d(self.inner.init(arm, y))] if hasattr(self.inner, "init") else []
        return scalar.array(np.concatenate([nothing, self.memory(arm, y), *inner]))

    def step(self, t: Scalar, r: JointReference, y: Measurement, s: Array) -> tuple[Array, Array]:
        """One tick: commands (n,) and the next state."""
        assert self.arm is not None
        n = self.arm.n
        own = (1 + self.delay_ticks) * n
        added, rest = s[:own], s[own:]
        size = len(self.memory(self.arm, y))
        seen = replace(y, applied=scalar.array(y.applied - added[:n]))
        memory, state = rest[:size], rest[size:]
        if hasattr(self.inner, "step"):
            asked, state = self.inner.step(t, r, seen, state)
        else:
            asked = self.inner(t, r, seen)
        asked = scalar.array(asked)
        u, memory = self.changed(r, y, asked, memory)
        u = scalar.array(u)
        following = [added[n:], u - asked, memory, np.atleast_1d(state)]
        return u, scalar.array(np.concatenate(following))

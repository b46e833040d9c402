"""What happens to a command before it leaves: rate limit and resolution. Design section 4, step 4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.scalar import Array


@dataclass(frozen=True)
class Shaping:
    """The command's way through the controller's output stage; each number may be one for each joint.

    Args:
        limit: [V | A | N m | N] the most that is commanded, either way; absent: no limit of the controller's own.
        rate: [1/s of the same] how fast a command may change; absent: at once.
        resolution: [of the same] its steps, of a DAC or of a PWM's timer; absent: none.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    """

    limit: Any = None
    rate: Any = None
    resolution: Any = None

    def __post_init__(self) -> None:
        for name in ("limit", "rate", "resolution"):
            value = getattr(self, name)
            if value is not None and not np.all(np.asarray(value, dtype=float) > 0):
                raise ScenarioError(f"shaping: {name} = {value!r}: expected numbers above 0")

    def shaped(self, period: float, u: Array, last: Array) -> np.ndarray:
        """The command (n,) that leaves, from the one asked for and the one that left a period [s] before."""
        n = len(u)
        if self.limit is not None:
            most = np.broadcast_to(self.limit, n)
            u = scalar.clip(u, -most, most)
        if self.rate is not None:
            change = np.broadcast_to(self.rate, n) * period
            u = last + scalar.clip(u - last, -change, change)
        if self.resolution is not None:
            step = np.broadcast_to(self.resolution, n)
            u = scalar.floor(u / step + 0.5) * step
        return scalar.array(u)

"""A body that the hand takes up and puts down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Payload:
    """A body in the hand from a time on, in place of the payload before; as for `arm.with_payload`.

    Args:
        time: () [s] when it is taken up; 0 or later.
        mass: () [kg]; 0 puts down what the hand held, and needs no more.
        com: (3,) [m] centre of mass, in the frame; of a point mass its place, absent: the frame's origin.
        inertia: (3, 3) [kg m²] about the centre of mass, in the frame's axes, or three principal moments; absent: a point mass.
        frame: name of the frame that carries it; by default the tip.

    Time, mass, com and inertia may each be a `Batch`, one value a lane.
    Example:
        >>> lift = aw.Inputs(payload=aw.Payload(time=0.1, mass=2.0))  # a point mass at the tip
        >>> scenario = aw.Scenario("two-link", 0.3, command=[84.366, 15.696], inputs=lift)
        >>> aw.simulate(scenario).q.values[-1].round(3)  # level until 0.1 s
        array([ 0.023, -0.204])
    """

    time: Any
    mass: Any
    com: Any = None
    inertia: Any = None
    frame: str | None = None

    def __post_init__(self) -> None:
        if self.inertia is None:  # a point mass; of a body with an inertia nobody knows the centre of mass but the user
            object.__setattr__(self, "inertia", np.zeros(3))
            if self.com is None:
                object.__setattr__(self, "com", np.zeros(3))

"""The mode of a sampled loop that grows fastest, in words: which joint, at which frequency, how fast."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.control.analysis.linear_loop import LinearLoop
from armwright.simulation.scenario import Scenario

GROWS = 1e-6  # of a mode, a tick: less is rounding of one that neither grows nor dies away
REMEDY = "`armwright loops FILE` (aw.loops.analyse_loops) shows margins and the longest period"


@dataclass(frozen=True)
class GrowingMode:
    """The eigenvalue of a loop farthest outside the unit circle; `str` gives a sentence.

    Attributes:
        joint: the name of the one that moves most.   hz: frequency, 0 of a mode that does not oscillate.
        growth: factor a period, or a tenth of a second where it does not oscillate.
    """

    joint: str
    hz: float
    growth: float

    def __str__(self) -> str:
        factor = f"{self.growth:.3g}" if self.growth < 1e6 else "more than 1e6"
        if self.hz == 0.0:
            return f"the loop is unstable: {self.joint} drifts away, by a factor of {factor} in 0.1 s"
        return f"the loop is unstable: {self.joint} oscillates at {self.hz:.3g} Hz, growing by a factor of {factor} a period"


def growing_mode(loop: LinearLoop, q: Any, gains: Any = None) -> GrowingMode | None:
    """The mode that grows fastest at one of some poses; None if the loop is stable at all of them.

    Args:
        loop: of a scenario.   q: (k, n) poses [rad | m].   gains: in place of the controller's batches.
    Raises:
        ScenarioError: a controller that cannot be traced, or poses that are none of this arm.
    """
    slopes = loop.slopes(q, gains)
    maps = loop.maps(slopes, loop.held(slopes))
    product = maps[0]
    for each in maps[1:]:
        product = each @ product
    values, vectors = np.linalg.eig(product)
    pose, mode = np.unravel_index(int(np.abs(values).argmax()), values.shape)
    value, ticks = values[pose, mode], loop.cycle
    if np.abs(value) ** (1.0 / ticks) <= 1.0 + GROWS:
        return None
    moves = np.abs(vectors[pose, : len(loop.names), mode])
    for joint, place, ratio in loop.elastic_motors:
        moves[joint] = max(moves[joint], np.abs(vectors[pose, place, mode] / ratio))
    angle, time = float(np.abs(np.angle(value))), ticks * loop.period
    if angle * 20.0 < 2.0 * np.pi * time:  # a period of more than 20 s
        return GrowingMode(loop.names[int(np.argmax(moves))], 0.0, _power(np.abs(value), 0.1 / time))
    growth = _power(np.abs(value), 2.0 * np.pi / angle)
    return GrowingMode(loop.names[int(np.argmax(moves))], angle / (2.0 * np.pi * time), growth)


def unstable_sentence(scenario: Scenario, poses: np.ndarray, lane: int = 0, clipped: str = "") -> str | None:
    """A sentence on the loop of a scenario with what to do, if it is unstable at one of some poses; else None.

    Args:
        scenario: with a controller.   poses: (k, n) [rad | m].   lane: whose gains count.   clipped: quantity whose limit clips.
    Raises:
        ScenarioError: a loop that cannot be analysed.
    """
    loop = LinearLoop(scenario)
    gains = loop.gains[lane] if lane < len(loop.gains) else loop.gains[0]
    mode = growing_mode(loop, poses, gains)
    if mode is None:
        return None
    end = f", until a limit of its {clipped} clips it" if clipped else ""
    return f"{mode}{end}; {REMEDY}"


def _power(base: float, exponent: float) -> float:
    return float(np.exp(min(exponent * np.log(base), 700.0)))

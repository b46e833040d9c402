"""Measures of gains without simulation: noise gain and peak sensitivity of the linear sampled loop, worst over poses."""

from __future__ import annotations

import numpy as np

from armwright.control.analysis.linear_loop import LinearLoop
from armwright.control.analysis.noise import noise_gain
from armwright.errors import ScenarioError

MEASURES = ("noise_gain", "sensitivity")


def measure(name: str, loop: LinearLoop, poses: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """(candidates, n) of a measure, the largest over the poses; infinite for an unstable loop.

    The noise gain of a command is its standard deviation for white noise of deviation 1 in all measured positions.

    Args:
        name: of `MEASURES`.   loop: whose controller has batches.   poses: (k, n) [rad | m].
        gains: (candidates, …) of the batches.
    Raises:
        ScenarioError: the sensitivity of a loop of several rates.
    """
    if name == "sensitivity" and loop.cycle != 1:
        what, expected = "the loop has several rates", "noise_gain, or a margin as the constraint"
        raise ScenarioError(what, place="objectives", value=name, expected=expected)
    worst = np.zeros((len(gains), len(loop.names)))
    for q in poses:
        slopes = loop.slopes(q, gains)
        stable = loop.keeps(slopes, 1.0, 0.0)
        if name == "sensitivity":
            found = loop.sensitivity(q, gains=gains)[0]
        else:
            command = noise_gain(loop, q, gains=gains).command  # of joint i for noise in joint j
            found = np.sqrt((command**2).sum(axis=-1))
        worst = np.maximum(worst, np.where(stable[:, None], found, np.inf))
    return worst

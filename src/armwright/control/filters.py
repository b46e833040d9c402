"""Second-order filters for commands, discretised by Tustin's rule.  [AstromWittenmark1997]

The rule is prewarped at the filter's own frequency f, where the sampled filter has the gain and phase of the continuous one:

    s = 2π f / tan(π f T) · (z - 1) / (z + 1)

Filters are computed in powers of 1/δ, δ = z - 1: poles of a slow filter lie near z = 1, where coefficients in powers of 1/z are
small differences of large numbers, which single precision rounds away.  [MiddletonGoodwin1986]
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from armwright import scalar
from armwright.control.gains import check_time
from armwright.control.wrapper import Wrapper
from armwright.errors import ScenarioError
from armwright.interfaces import JointReference, Measurement
from armwright.model import Model
from armwright.scalar import Array


@dataclass(frozen=True)
class LowPass:
    """H(s) = ω² / (s² + 2 ζ ω s + ω²),  ω = 2π hz.

    Args:
        hz: the natural frequency, below half of the sampling rate.   damping: ζ; by default Butterworth's, 1/√2.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> aw.LowPass(50.0, damping=1.0)  # of `aw.Filtered`
        LowPass(hz=50.0, damping=1.0)
    """

    hz: float
    damping: float = math.sqrt(0.5)

    def __post_init__(self) -> None:
        check_time("LowPass", "hz", self.hz)
        check_time("LowPass", "damping", self.damping)

    @property
    def polynomials(self) -> tuple[list[float], list[float]]:
        """Numerator and denominator in s/ω, highest power first."""
        return [0.0, 0.0, 1.0], [1.0, 2.0 * self.damping, 1.0]


@dataclass(frozen=True)
class Notch:
    """H(s) = (s² + depth Δ s + ω²) / (s² + Δ s + ω²),  ω = 2π hz,  Δ = 2π width_hz.

    Args:
        hz: the frequency that is taken out, below half of the sampling rate.
        width_hz: of the band in which, with depth 0, the gain is below 1/√2.   depth: the gain at hz, from 0 to below 1.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> aw.Notch(30.0, width_hz=10.0)  # of `aw.Filtered`: takes 30 Hz out
        Notch(hz=30.0, width_hz=10.0, depth=0.0)
    """

    hz: float
    width_hz: float
    depth: float = 0.0

    def __post_init__(self) -> None:
        check_time("Notch", "hz", self.hz)
        check_time("Notch", "width_hz", self.width_hz)
        depth = scalar.real_number(self.depth)
        if depth is None or not 0.0 <= depth < 1.0:
            raise ScenarioError(place="Notch.depth", value=self.depth, expected="a gain from 0 to below 1")

    @property
    def polynomials(self) -> tuple[list[float], list[float]]:
        """Numerator and denominator in s/ω, highest power first."""
        width = self.width_hz / self.hz
        return [1.0, self.depth * width, 1.0], [1.0, width, 1.0]


KINDS = (LowPass, Notch)


def sampled(filter_: LowPass | Notch, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator (3,) in falling powers of δ = z - 1, by Tustin's rule; the denominator begins with 1.

    Args:
        filter_: the continuous one.   period: [s].
    Raises:
        ScenarioError: a frequency of half of the sampling rate or more.
    """
    if not filter_.hz * period < 0.5:
        place, expected = f"{type(filter_).__name__}.hz", f"below half of the sampling rate, {0.5 / period:g}"
        raise ScenarioError(place=place, value=filter_.hz, expected=expected)
    k = math.tan(math.pi * filter_.hz * period)
    # s/ω = δ / (k (2 + δ)), both sides times k² (2 + δ)²
    powers = np.array([[1.0, 0.0, 0.0], [k, 2.0 * k, 0.0], [k * k, 4.0 * k * k, 4.0 * k * k]])
    b, a = (np.array(each) @ powers for each in filter_.polynomials)
    return b / a[0], a / a[0]


@dataclass(frozen=True, eq=False)
class Filtered(Wrapper):
    """u = the inner command of every joint, passed through filters in series.

    They begin in steady state at the commands that were in force.

    Args:
        inner: any controller.   filters: `LowPass` and `Notch`, in order.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> control = aw.JointPID(kp=[900.0, 250.0], kd=[180.0, 50.0], gravity=True)
        >>> smooth = aw.Filtered(control, [aw.Notch(40.0, width_hz=10.0), aw.LowPass(100.0)])
        >>> loop = aw.Loop(smooth, aw.trajectories.Step([0.0, 0.0], [0.5, -0.5]), period=0.002)
        >>> aw.simulate(aw.Scenario("two-link", 1.0, loop=loop)).q.values[-1].round(2)
        array([ 0.5, -0.5])
    """

    filters: Sequence[LowPass | Notch]
    sections: tuple[tuple[np.ndarray, np.ndarray], ...] = ()  # numerator and denominator of each, set by `configure`

    def __post_init__(self) -> None:
        super().__post_init__()
        several = isinstance(self.filters, (list, tuple)) and len(self.filters) > 0
        if not several or not all(isinstance(each, KINDS) for each in self.filters):
            expected = "a list of aw.LowPass(hz) and aw.Notch(hz, width_hz, depth)"
            raise ScenarioError(place="Filtered.filters", value=self.filters, expected=expected)

    def configure(self, arm: Model, period: float) -> Self:
        """The controller for an arm and a sample period [s].

        Args:
            arm: the model.   period: [s].
        Raises:
            ScenarioError: a filter that is too fast for the period.
        """
        sections = tuple(sampled(each, period) for each in self.filters)
        return replace(super().configure(arm, period), sections=sections)

    def memory(self, arm: Model, y: Measurement) -> Array:
        """Initial memory: two numbers for each filter and joint, in steady state."""
        rows: list[Any] = []
        for b, a in self.sections:
            rows += [(1.0 - b[0]) * y.applied, (a[1] - b[1]) * y.applied]
        return scalar.array(np.concatenate(rows))

    def changed(self, r: JointReference, y: Measurement, u: Array, s: Array) -> tuple[Array, Array]:
        """The command through all filters, each in transposed direct form II of δ; their gain at rest is 1, so b[2] = a[2]."""
        rows: list[Any] = []
        states = s.reshape(-1, 2, len(u))
        for (b, a), (first, second) in zip(self.sections, states, strict=True):
            out = b[0] * u + first
            rows += [first + (b[1] * u - a[1] * out + second), second + a[2] * (u - out)]
            u = out
        return u, np.concatenate(rows)

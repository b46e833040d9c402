"""Sampled form of a continuous system: zero-order hold with any delay, exactly.  [AstromWittenmark1997]

A command u_k is held for a period T and acts d = (m + φ) T late, m whole and 0 ≤ φ < 1. With  Φ(t) = e^{A t}  and
Γ(t) = ∫₀ᵗ e^{A s} ds B, the state at the next sample is

    x_{k+1} = Φ(T) x_k + Γ((1 - φ) T) u_{k-m} + Φ((1 - φ) T) Γ(φ T) u_{k-m-1}
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.matrix_exponential import matrix_exponential
from armwright.results.result import Result
from armwright.simulation.checks import check_time
from armwright.simulation.loop.timing import WHOLE

MOST_STATES = 4000  # of a sampled system with its commands under way: 122 MiB for its matrix
MOST_PERIODS = 2**53  # of a delay: a float counts no further


@dataclass(frozen=True, eq=False)
class Held(Result):
    """Sampled system  x_{k+1} = a x_k + new u_{k-ticks} + old u_{k-ticks-1},  or a batch of them.

    Attributes:
        a: (…, N, N).   new, old: (…, N, m).   ticks: whole periods of the delay.
    """

    a: np.ndarray
    new: np.ndarray
    old: np.ndarray
    ticks: int


def zero_order_hold(a: Any, b: Any, period: float, delay: float = 0.0) -> Held:
    """The sampled system of  dx/dt = A x + B u(t - delay)  with u held over each period.

    Args:
        a: (…, N, N) [1/s].   b: (…, N, m).   period: [s].   delay: [s], 0 to 2⁵³ periods.
    Returns:
        held: matrices from sample to sample.
    Raises:
        ScenarioError: a period or delay that is none, matrices that are not finite or do not fit together, or a system that
            grows beyond the largest number within a period.
    Example:
        >>> a, b = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
        >>> held = aw.loops.zero_order_hold(a, b, period=0.1)
        >>> held.new.round(3)  # of a force on a mass of 1 kg
        array([[0.005],
               [0.1  ]])
    """
    check_time("period", period)
    late_by = scalar.real_number(delay)
    if late_by is None or not 0.0 <= late_by <= MOST_PERIODS * period:
        raise ScenarioError(place="delay", value=delay, expected="a time of 0 s or more, at most 2^53 periods")
    a, b = _finite("a", a), _finite("b", b)
    if a.ndim < 2 or b.ndim < 2 or a.shape[-1] != a.shape[-2] or a.shape[-1] != b.shape[-2]:
        raise ScenarioError(f"shapes {a.shape} and {b.shape}", place="a, b", expected="(…, N, N) and (…, N, m)")
    ticks, part = split_delay(late_by / period)
    now, gain = _transition(a, b, (1.0 - part) * period)
    if part == 0.0:
        return Held(now, gain, np.zeros_like(gain), ticks)
    before, late = _transition(a, b, part * period)
    return Held(now @ before, gain, now @ late, ticks)


def _finite(place: str, value: Any) -> np.ndarray:
    """A matrix of finite numbers.

    Raises:
        ScenarioError: what is none.
    """
    try:
        matrix = scalar.real_numbers(value)
    except ValueError as error:
        raise ScenarioError(str(error), place=place, expected="a matrix of numbers") from None
    if not np.all(np.isfinite(matrix)):
        raise ScenarioError("is not finite", place=place, expected="a matrix of finite numbers")
    return matrix


def split_delay(periods: float) -> tuple[int, float]:
    """Whole periods of a delay and the remaining fraction, 0 ≤ φ < 1; within rounding of a whole number the fraction is 0."""
    whole = int(np.floor(periods + WHOLE))
    return whole, max(periods - whole, 0.0) if abs(periods - whole) > WHOLE else 0.0


def _transition(a: np.ndarray, b: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Φ(t) and Γ(t), from one matrix exponential of [[A, B], [0, 0]] t.  [VanLoan1978]

    Raises:
        ScenarioError: batches that do not fit together, or Φ(t) beyond the largest number.
    """
    size, inputs = b.shape[-2:]
    try:
        lead = np.broadcast_shapes(a.shape[:-2], b.shape[:-2])
    except ValueError:
        expected = "batches of one shape, or that broadcast"
        raise ScenarioError(f"shapes {a.shape} and {b.shape}", place="a, b", expected=expected) from None
    block = np.zeros((*lead, size + inputs, size + inputs))
    block[..., :size, :size], block[..., :size, size:] = a, b
    with np.errstate(all="ignore"):  # what overflows is refused below
        power = matrix_exponential(t * block)
    if not np.all(np.isfinite(power)):
        what = f"the system grows beyond the largest number in {t:.3g} s"
        raise ScenarioError(what, place="a, b", expected="a shorter period, or smaller entries")
    return power[..., :size, :size], power[..., :size, size:]


def sampled_system(a: Any, b: Any, c: Any, period: float, delay: float = 0.0) -> Any:
    """The sampled system with its delay as a `control.StateSpace`; commands under way are states.

    Args:
        a: (N, N) [1/s].   b: (N, m).   c: (p, N) what is measured, y_k = C x_k.   period: [s].
        delay: [s], of so few periods that N + m periods are 4000 states or fewer.
    Returns:
        system: its state is x, and behind it the commands that wait.
    Raises:
        ScenarioError: as `zero_order_hold`; a batch of systems; a delay of more states.
    Example:
        >>> a, b, c = np.array([[-1.0]]), np.array([[1.0]]), np.array([[1.0]])
        >>> aw.loops.sampled_system(a, b, c, period=0.1).poles().round(3)
        array([0.905+0.j])
    """
    import control

    held = zero_order_hold(a, b, period, delay)
    c = _finite("c", c)
    if held.new.ndim != 2 or c.ndim != 2 or c.shape[1] != len(held.a):
        what = f"shapes {held.a.shape}, {held.new.shape} and {c.shape}"
        raise ScenarioError(what, place="a, b, c", expected="(N, N), (N, m) and (p, N)")
    size, inputs = held.new.shape
    waiting = held.ticks + bool(held.old.any())
    z = size + inputs * waiting
    if z > MOST_STATES:
        longest = max(0, (MOST_STATES - size) // max(inputs, 1) - 1) * period
        expected = f"{longest:.6g} s or less, which are {MOST_STATES} states at this period, or a longer period"
        raise ScenarioError(f"would be {z} states", place="delay", value=delay, expected=expected)
    whole, entry = np.zeros((z, z)), np.zeros((z, inputs))
    whole[:size, :size] = held.a
    for gain, age in ((held.new, held.ticks), (held.old, held.ticks + 1)):
        if age == 0:
            entry[:size] = gain
        elif age <= waiting:
            whole[:size, size + (age - 1) * inputs : size + age * inputs] += gain
    if waiting:
        entry[size : size + inputs] = np.eye(inputs)
        whole[size + inputs :, size : z - inputs] = np.eye(z - size - inputs)
    output = np.hstack([c, np.zeros((len(c), z - size))])
    return control.ss(whole, entry, output, np.zeros((len(c), inputs)), period)

"""Limit cycles of encoder counts with Coulomb friction, by describing functions.  [GelbVanderVelde1968]

An oscillation of amplitude A and frequency ω in a joint's position sees the rounding to counts of size Δ as a factor

    N(A) = 4 Δ/(π A) Σ_k sqrt(1 − ((2k − 1) Δ/(2A))²)   for k = 1, 2, … with (2k − 1) Δ/2 < A;  0 for A < Δ/2

in the measured position, and Coulomb's friction F as a damping  b(A, ω) = 4 F/(π ω A).  Where the sampled loop with both has an
eigenvalue e^{jωT} on the unit circle, an oscillation of that amplitude goes on; it is stable where a larger one dies away.
Higher harmonics are left out: the amplitude is right to some ten per cent, and near the end of a range an oscillation may be
missed or foreseen in vain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright.actuators.coupling import motor_shares
from armwright.control.analysis.linear_loop import LinearLoop
from armwright.control.analysis.noise import measured_entries
from armwright.control.analysis.small_signal import LoopSlopes
from armwright.entry import expect
from armwright.errors import ScenarioError
from armwright.results.result import Result

COUNTS = np.geomspace(0.505, 20.0, 80)  # amplitudes that are looked at; beyond, a rounded sine is nearly the sine
ROUNDS = 10  # of the search for the frequency at an amplitude
AT_ONE = 1e-3  # of a growth
HALVINGS = 12  # of the interval in which the amplitude lies


@dataclass(frozen=True)
class LimitCycle(Result):
    """A stable oscillation of one joint's position, with the loops of the others closed.

    Attributes:
        amplitude: [rad | m].   frequency: [rad/s].
    """

    amplitude: float
    frequency: float


def limit_cycle(loop: LinearLoop, q: Any, joint: int) -> LimitCycle | None:
    """The largest limit cycle of a joint caused by its encoder counts and Coulomb friction, about a pose.

    Args:
        loop: of a scenario whose encoders have counts.   q: (n,) pose, on a count [rad | m].   joint: its number.
    Returns:
        cycle: None where none is foreseen: oscillations die away, or grow beyond 20 counts.
    Raises:
        ScenarioError: encoders without counts, several poses, or no such joint.
    Example:
        >>> scenario = aw.read_scenario("examples/bus-4ms.scenario.toml")
        >>> loop = aw.loops.LinearLoop(scenario)
        >>> aw.loops.limit_cycle(loop, np.zeros(6), 0) is None
        True
    """
    expect(loop, LinearLoop, "loop", "an aw.loops.LinearLoop", ScenarioError)
    slopes, scenario = loop.slopes(q), loop.scenario
    _ = loop.slopes(q, joint=joint)  # which checks the joint
    assert scenario.loop is not None
    count = float(scenario.loop.joint_sensors.counts_of(scenario.arm)[joint])
    if slopes.a.ndim != 2:
        raise ScenarioError(f"shape {np.shape(q)}", place="q", expected=f"one pose ({len(loop.names)},)")
    if count == 0.0:
        raise ScenarioError(
            "its encoder has no counts", place="joint", value=loop.names[joint], expected="sensors.counts"
        )
    force, slope = _coulomb(loop, joint)
    amplitudes = count * COUNTS
    growth, frequency = _growth(loop, slopes, joint, amplitudes, count, force, slope)
    ends = np.flatnonzero((growth[:-1] >= 1.0) & (growth[1:] < 1.0))
    if not ends.size:
        return None
    low, high, grows = amplitudes[ends[-1]], amplitudes[ends[-1] + 1], growth
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        grows, frequency = _growth(loop, slopes, joint, np.array([middle]), count, force, slope)
        low, high = (middle, high) if grows[0] >= 1.0 else (low, middle)
    if abs(grows[0] - 1.0) > AT_ONE:  # another oscillation takes over there, and none goes on
        return None
    return LimitCycle(float(0.5 * (low + high)), float(frequency[0]))


def rounding_factor(amplitude: Any, count: float) -> np.ndarray:
    """N(A) of rounding to counts, for a sine about a count.

    Args:
        amplitude: (…,) [rad | m], above 0.   count: [rad | m].
    """
    amplitude = np.asarray(amplitude, dtype=float)
    steps = count * (np.arange(1.0, np.floor(amplitude.max() / count + 0.5) + 1.0) - 0.5)
    inside = np.maximum(1.0 - (steps / amplitude[..., None]) ** 2, 0.0)
    return 4.0 * count / (np.pi * amplitude) * np.sqrt(inside).sum(axis=-1)


def _coulomb(loop: LinearLoop, joint: int) -> tuple[float, np.ndarray]:
    """Coulomb friction of a joint, the mean of both directions [N m | N], and (N, N) what a damping of 1 adds to the slopes A."""
    body, size, plant = loop.scenario.arm.coordinates[joint], loop.plant.plant.size, loop.plant
    friction, slope = body.friction, np.zeros((size, size))
    on_motor = friction is not None and friction.on_motor
    if on_motor and body.elasticity is not None:  # a row of its own, of the motor's acceleration
        (place,) = plant.states_of(joint, ["motor_qd"])
        slope[place, place] = -1.0 / body.drive.reflected
    else:
        speeds = plant.plant.layout.place("qd")
        share = motor_shares(loop.scenario.arm)[joint] if on_motor else np.eye(len(loop.names))[joint]
        slope[speeds, speeds] = -np.outer(share, share)
    if friction is None:
        return 0.0, slope
    return 0.5 * (float(friction.coulomb_positive) + float(friction.coulomb_negative)), slope


def _growth(
    loop: LinearLoop,
    slopes: LoopSlopes,
    joint: int,
    amplitudes: np.ndarray,
    count: float,
    force: float,
    slope: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """(k,) growth a tick and frequency [rad/s] of the oscillation at each amplitude."""
    factor = rounding_factor(amplitudes, count)
    part, size = loop.encoders()[1][joint], slopes.a.shape[-1]
    frequency, growth = np.full(len(amplitudes), 0.1 * np.pi / loop.period), np.zeros(len(amplitudes))
    turned = frequency
    for _ in range(ROUNDS if force > 0.0 else 1):
        damping = 4.0 * force / (np.pi * frequency * amplitudes)
        damped = replace(slopes, a=slopes.a + damping[:, None, None] * slope)
        maps, product = loop.maps(damped, loop.held(damped)), np.eye(1)
        for each, entry in zip(maps, measured_entries(loop, damped, maps), strict=True):
            each[..., :size] += (factor[:, None, None] - 1.0) * (entry @ part)
            product = each @ product if product.ndim > 2 else each
        values = np.linalg.eigvals(product)
        swings = np.where(np.abs(values.imag) > 1e-9, np.abs(values), 0.0)
        best = values[np.arange(len(values)), swings.argmax(axis=1)]
        growth = swings.max(axis=1) ** (1.0 / loop.cycle)
        turned = np.abs(np.angle(best)) / (loop.cycle * loop.period)
        frequency = np.sqrt(frequency * np.where(turned > 0.0, turned, frequency))  # half way, in the logarithm
    return growth, turned

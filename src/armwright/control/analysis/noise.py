"""Effects of measurement noise on a sampled loop: H2 norms, ripple by encoder quantisation, and limit cycles.

White noise v of standard deviation 1 in a joint's measured position drives the closed loop  z_{k+1} = F z_k + g v_k;  its
covariance P = F P Fᵀ + g gᵀ gives the standard deviation of everything that depends on z, the H2 norm of that way. A loop of
several rates has a covariance for each tick of its cycle; the mean over the cycle counts.

An encoder with counts of size Δ adds an error that is nearly white with variance Δ²/12 while the arm moves over many counts
[WidrowKollar2008]. At rest it may make a limit cycle instead: a rounded sample is between 0 and 2 times the sample, 2 just
beyond half a count. Where a factor from 0 to 2 in the measured position makes the loop unstable, an oscillation of about a
count may go on for ever. This is the describing function's condition [GelbVanderVelde1968] for any sampled oscillation, about a
reference on a count; it is no proof.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.control.analysis.linear_loop import GAINS, LinearLoop, first_lost
from armwright.control.analysis.small_signal import LoopSlopes
from armwright.errors import ScenarioError
from armwright.results.result import Result

DOUBLINGS = 60  # of the ticks that a covariance is summed over
ROUNDED = 2.0  # largest ratio of a rounded number to itself


@dataclass(frozen=True, eq=False)
class NoiseGain(Result):
    """Standard deviations caused by white position noise of standard deviation 1 rad or m; NaN for an unstable loop.

    Attributes:
        position: (…, n, n) of joint i's position for noise of joint j's encoder, referred to that joint [-].
        command: (…, n, n) of joint i's command [U/rad | U/m], U its unit V, A, N m or N.
    """

    position: np.ndarray
    command: np.ndarray


@dataclass(frozen=True, eq=False)
class Quantisation(Result):
    """Effects of encoder quantisation on a loop about poses (…): noise while moving, limit cycles at rest.

    Attributes:
        count: (n,) one count of each joint's encoder [rad | m]; 0 of one that is not quantised.
        position, command: (…, n) standard deviations while the arm moves over many counts [rad | m], [U].
        gain_up, gain_down: (…, n) factors of a joint's measured position, above and below 1, at which stability ends; inf and 0
            if never. NaN of an unstable loop, as all of these.
    """

    count: np.ndarray
    position: np.ndarray
    command: np.ndarray
    gain_up: np.ndarray
    gain_down: np.ndarray

    @property
    def may_swing(self) -> np.ndarray:
        """(…, n) True if quantisation may cause a limit cycle at rest."""
        ends = (self.gain_up < ROUNDED) | (self.gain_down > 0.0) | np.isnan(self.gain_up)
        return ends & (self.count > 0.0)


def noise_gain(loop: LinearLoop, q: Any, *, gains: Any = None, joint: int | None = None) -> NoiseGain:
    """H2 norms from white noise in the measured positions to positions and commands.

    Args:
        loop: of a scenario.   q: (…, n) poses [rad | m].   gains: in place of the controller's batches.
        joint: alone, the others held still: arrays (…, 1, 1); None: the coupled loop.
    Returns:
        gain: standard deviations for noise of standard deviation 1.
    Raises:
        ScenarioError: poses that are none of the arm.
    Example:
        >>> scenario = aw.read_scenario("examples/bus-4ms.scenario.toml")
        >>> loop = aw.loops.LinearLoop(scenario)
        >>> aw.loops.noise_gain(loop, np.zeros(6)).command.shape
        (6, 6)
    """
    slopes, maps = _measured(loop, q, gains, joint)
    errors, _ = loop.encoders(joint)
    n = slopes.b.shape[-1]
    first = slopes.b.shape[-2] + slopes.ticks[0].shape[-2] - n  # of the commands that were given last
    rows = np.r_[0:n, first : first + n]
    entries = [entry @ errors.T for entry in measured_entries(loop, slopes, maps)]  # (…, Z, n)
    lead, size = maps[0].shape[:-2], maps[0].shape[-1]
    product, total = np.eye(size), np.zeros((*lead, n, size, size))
    for each, entry in zip(maps, entries, strict=True):
        product = each @ product
        total = each[..., None, :, :] @ total @ _turned(each)[..., None, :, :] + _squares(entry)
    covariance, mean = _summed(product, total), 0.0
    with np.errstate(over="ignore", invalid="ignore"):  # of an unstable loop, which has no covariance
        for each, entry in zip(maps, entries, strict=True):
            covariance = each[..., None, :, :] @ covariance @ _turned(each)[..., None, :, :] + _squares(entry)
            mean = mean + np.diagonal(covariance, axis1=-2, axis2=-1)[..., rows] / loop.cycle  # (…, from joint, row)
    stable = np.abs(np.linalg.eigvals(product)).max(axis=-1) < 1.0
    found = np.where(stable[..., None, None], np.sqrt(np.maximum(mean, 0.0)), np.nan).swapaxes(-1, -2)
    return NoiseGain(found[..., :n, :], found[..., n:, :])


def quantisation(loop: LinearLoop, q: Any, *, gains: Any = None) -> Quantisation:
    """Effects of encoder quantisation on a scenario's loop: ripple while moving, limit cycles at rest.

    Dry friction, which stops small limit cycles and makes others with an integrator, is left out: simulate for it.

    Args:
        loop: of a scenario.   q: (…, n) poses [rad | m].   gains: in place of the controller's batches.
    Returns:
        quantisation: counts, ripple, and the room up to a limit cycle.
    Raises:
        ScenarioError: poses that are none of the arm.
    Example:
        >>> scenario = aw.read_scenario("examples/bus-4ms.scenario.toml")
        >>> loop = aw.loops.LinearLoop(scenario)
        >>> aw.loops.quantisation(loop, np.zeros(6)).may_swing
        array([False,  True,  True, False,  True, False])
    """
    gain, scenario = noise_gain(loop, q, gains=gains), loop.scenario
    assert scenario.loop is not None
    count = scenario.loop.joint_sensors.counts_of(scenario.arm)
    spread = count / np.sqrt(12.0)
    slopes, maps = _measured(loop, q, gains)
    entries = measured_entries(loop, slopes, maps)
    ends = [_ends(maps, [entry @ part for entry in entries]) for part in loop.encoders()[1]]
    up, down = (np.stack([end[k] for end in ends], axis=-1) for k in (0, 1))
    position, command = (np.sqrt((each**2) @ spread**2) for each in (gain.position, gain.command))
    stable = ~np.isnan(position)
    return Quantisation(count, position, command, np.where(stable, up, np.nan), np.where(stable, down, np.nan))


def _measured(loop: LinearLoop, q: Any, gains: Any, joint: int | None = None) -> tuple[LoopSlopes, list[np.ndarray]]:
    """Slopes and maps of a loop."""
    if not isinstance(loop, LinearLoop):
        raise ScenarioError(place="loop", value=loop, expected="an aw.loops.LinearLoop of a scenario")
    slopes = loop.slopes(q, gains, joint)
    return slopes, loop.maps(slopes, loop.held(slopes))


def measured_entries(loop: LinearLoop, slopes: LoopSlopes, maps: list[np.ndarray]) -> list[np.ndarray]:
    """(…, Z, N) of each tick: the map of the plant's state through what is measured only, without that through the plant.

    Args:
        loop: linearised.   slopes: of its plant.   maps: of its ticks.
    """
    size, plant = slopes.b.shape[-2], loop.held(slopes).a
    entries = [each[..., :size].copy() for each in maps]
    for entry in entries:
        entry[..., :size, :] -= plant
    return entries


def _ends(maps: list[np.ndarray], entries: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(…,) factors of a measured position, which acts by entries (…, Z, N), above and below 1 at which stability ends."""
    shape, size = maps[0].shape[:-2], entries[0].shape[-1]

    def unstable(factor: np.ndarray) -> np.ndarray:
        product = np.eye(maps[0].shape[-1])
        for each, entry in zip(maps, entries, strict=True):
            changed = np.array(np.broadcast_to(each, (*factor.shape, *each.shape[-2:])))
            changed[..., :size] += (factor[..., None, None] - 1.0) * entry
            product = changed @ product
        return np.abs(np.linalg.eigvals(product)).max(axis=-1) >= 1.0

    return first_lost(unstable, GAINS, shape, np.inf), 1.0 / first_lost(
        lambda g: unstable(1.0 / g), GAINS, shape, np.inf
    )


def _squares(entry: np.ndarray) -> np.ndarray:
    """(…, n, Z, Z) g gᵀ of each column g of (…, Z, n)."""
    columns = np.moveaxis(entry, -1, -2)
    return columns[..., :, None] * columns[..., None, :]


def _turned(matrix: np.ndarray) -> np.ndarray:
    return np.swapaxes(matrix, -1, -2)


def _summed(product: np.ndarray, once: np.ndarray) -> np.ndarray:
    """Σ_k A^k Q A^kᵀ for (…, Z, Z) and (…, n, Z, Z), by doubling the number of terms; of an unstable A any number."""
    power, total = product[..., None, :, :], once
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(DOUBLINGS):
            total = total + power @ total @ _turned(power)
            power = power @ power
            if not np.abs(power).max() > 1e-18:
                break
    return total

"""Spectra of logged signals, and the frequency band of the motion."""

from __future__ import annotations

import numpy as np
from scipy import signal as sp

from armwright.fitting.measures import runs_of_true
from armwright.identification.logs.quantisation import quantisation_step

ABOVE = 4.0  # times the noise floor: below it noise is a quarter of the power and more
HIGHEST, LOWEST = 0.4, 1e-3  # cut-off as a share of the rate
FASTEST = 0.1  # as a share of the rate: where motion has its largest accelerations, at most
RISE = 3.0  # times the lowest power: behind such a rise it was a valley
VALLEY = 1.5  # times the lowest power: still the valley
OCTAVE = 2**0.5
LINE, LOBE = 30.0, 3  # times its surroundings: a line; bins to either side over which the window spreads it
PART = 0.01  # of the power of the line with the largest acceleration: of less a fit knows nothing
BEYOND_LINES = 1.5  # cut-off by the highest line, of whose amplitude 96 % are left
SEGMENT = 4096  # rows of a spectrum's segment


def spectrum(values: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Power density of a signal by Welch's method: f (k,) in Hz and power (k,) [unit²/Hz], without zero frequency.

    Args:
        values: (rows,).   rate: in Hz.

    The spectrum of the differences is divided by their gain: the slow motion, which is far larger, would leak over the rest.
    """
    steps = np.diff(values)
    f, power = sp.welch(steps, rate, nperseg=min(SEGMENT, len(steps)), detrend="constant")
    return f[1:], power[1:] / (2 * np.sin(np.pi * f[1:] / rate)) ** 2


def motion_band(values: np.ndarray, rate: float, derivatives: int, step: float | None = None) -> tuple[float, bool]:
    """Highest frequency in Hz of the motion in a signal's accelerations, and True if it is a valley of their spectrum.

    Motion fades with frequency, while noise of positions grows with its fourth power in accelerations: the spectrum has a valley
    between the two. Where it has none, the band ends where the signal comes down to its noise floor. Gaps between the lines of a
    multisine are no valleys: the band reaches beyond every line that stands out. 0 Hz for a signal at rest.

    Args:
        values: (rows,).   rate: in Hz.   derivatives: from the signal to accelerations: 2 of positions, 1 of speeds.
        step: of its quantisation, 0 where it has none; None: looked for.
    """
    f, power = spectrum(values, rate)
    smooth = _smooth(f, power)
    floor = float(np.median(power[f > 0.25 * rate]))
    above = smooth > ABOVE * floor
    # the window leaks into the lowest bins of noise, and of few segments one bin stands out by chance; motion has a lobe
    above[:LOBE] &= above[1 : LOBE + 1]
    acceleration = smooth * f ** (2 * derivatives)
    peak = int(np.argmax(acceleration * above * (f < FASTEST * rate)))
    if not above[peak]:
        return 0.0, False
    top = int(np.searchsorted(f, HIGHEST * rate))
    acceleration = acceleration[peak:top]
    risen = np.flatnonzero(acceleration > RISE * np.minimum.accumulate(acceleration))
    faded = np.flatnonzero(~above[peak:top])
    end = f[peak + faded[0]] if len(faded) else HIGHEST * rate
    valley = np.inf
    # else it rises from the peak on: motion
    if len(risen) and acceleration[: risen[0]].min() * RISE <= acceleration[0]:
        before = acceleration[: risen[0]]
        # of the valley: rather some noise than less motion
        far_end = np.flatnonzero(before <= VALLEY * before.min())[-1]
        valley = f[peak + int(far_end)]
    # quantisation of a periodic motion has lines too: of less power than a step's variance, and up to the highest frequencies
    step = quantisation_step(values) if step is None else step
    noise = (step or 0.0) ** 2 / 12.0 / (f[1] - f[0])
    least = max(noise, ABOVE * float(power[f > 0.25 * rate].max()))
    last = BEYOND_LINES * highest_line(f, power, derivatives, least)
    if last > min(valley, end):
        valley, end = np.inf, last
    return float(np.clip(min(valley, end), LOWEST * rate, HIGHEST * rate)), bool(valley <= end)


def highest_line(f: np.ndarray, power: np.ndarray, derivatives: int, least: float) -> float:
    """Highest frequency in Hz of a significant spectral line, as of a multisine; 0 without lines.

    A line is LINE times as high as the mean of the octave around it without its neighbours, and at least as high as noise.

    Args:
        f, power: (k,) of `spectrum`.   derivatives: from the signal to accelerations.   least: power of a line of noise.
    """
    total = np.concatenate([[0.0], np.cumsum(power)])
    k = np.arange(len(f))

    def inside(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return total[high] - total[low], high - low

    octave = inside(np.searchsorted(f, f / OCTAVE), np.searchsorted(f, f * OCTAVE, side="right"))
    near = inside(np.maximum(k - LOBE, np.searchsorted(f, f / OCTAVE)), np.minimum(k + LOBE + 1, len(f)))
    others, count = np.maximum(octave[0] - near[0], 0.0), octave[1] - near[1]
    lines = (count >= LOBE) & (power * count > LINE * others) & (power > least)
    acceleration = power * f ** (2 * derivatives) * lines
    heard = np.flatnonzero(acceleration > PART * acceleration.max(initial=0.0))
    return float(f[heard[-1]]) if len(heard) else 0.0


def _smooth(f: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Mean of a spectrum over the octave around each frequency: lobes of single moves have valleys of their own."""
    total = np.concatenate([[0.0], np.cumsum(power)])
    low, high = np.searchsorted(f, f / OCTAVE), np.searchsorted(f, f * OCTAVE, side="right")
    return (total[high] - total[low]) / (high - low)


def longest_finite(column: np.ndarray) -> np.ndarray:
    """The longest part of a column without NaN."""
    runs = runs_of_true(np.isfinite(column))
    begin, end = runs[np.diff(runs).argmax()] if len(runs) else (0, 0)
    return column[begin:end]

"""Speeds from logged positions and logged speeds together, each where its noise is smaller.

White noise of positions, of density N_q, has ω² N_q in their derivative; that of speeds has N_v. The mean with the least variance
takes the derivative with the weight

    w(ω) = N_v / (N_v + ω² N_q) = 1 / (1 + (ω/ω_c)²),   ω_c² = N_v / N_q,

which is a Butterworth low-pass of first order, run forward and backward: the derivative below its corner, the logged speed above.
N_v is the mean of what the two differ by within the motion's band, so that a speed which lags, or is another joint's, counts as
noisy; N_q is the floor of the positions' spectrum.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import signal as sp

from armwright.identification.logs.log import Log, LogRun
from armwright.identification.logs.spectrum import HIGHEST, motion_band, spectrum

FEWEST = 256  # rows that noise is estimated from
LOWEST = 0.25  # of the cut-off: a lower corner would settle too late

Derivative = Callable[[np.ndarray], np.ndarray]


def corners(log: Log, run: LogRun) -> tuple[float, ...]:
    """Corner in Hz of each joint of the log; infinite where the logged speed tells nothing, or one of them is missing."""
    found, rows = np.full(len(log.joints), np.inf), run.census.longest
    if not {"q", "qd"} <= set(log.layout.names) or rows is None or len(rows.t) < FEWEST:
        return tuple(found)
    rate = 1.0 / rows.period
    for joint, q, v in _both(log, rows.values["q"], rows.values["qd"]):
        slope = np.gradient(q, rows.period)[1:-1]
        f, own = spectrum(q, rate)
        noise = float(np.median(own[f > 0.25 * rate]))  # N_q
        band, _ = motion_band(q, rate, 2)
        f, differing = sp.welch(v[1:-1] - slope, rate, nperseg=min(1024, len(slope)))
        within = f <= max(band, f[1])
        gain = np.sin(2 * np.pi * f / rate) * rate  # of the difference over two rows
        other = float(np.mean(np.maximum(differing - gain**2 * noise, 0.0)[within]))
        # at Nyquist's frequency a difference has gain 2
        other = max(other, float(np.median(sp.welch(np.diff(v), rate)[1][-32:])) / 4)
        if noise > 0.0 and np.ptp(v) > 0.0:
            corner = np.sqrt(other / noise) / (2 * np.pi)
            found[joint] = corner if corner < HIGHEST * rate else np.inf
    return tuple(found)


def merged(
    log: Log, q: np.ndarray, qd: np.ndarray, rate: float, limits: np.ndarray, slope: Derivative, curvature: Derivative
) -> tuple[np.ndarray, np.ndarray]:
    """Speeds and accelerations (rows, joints of the log) of filtered positions and speeds (rows, their joints).

    Args:
        rate: in Hz.   limits: corners (joints of the log,) in Hz.   slope, curvature: first and second derivative.
    """
    speeds, accelerations = np.full((2, len(q), len(log.joints)), np.nan)
    for name, values, first, second in (("qd", qd, lambda x: x, slope), ("q", q, slope, curvature)):
        own = list(log.layout[name].joints or ())
        speeds[:, own], accelerations[:, own] = first(values), second(values)
    for joint, _, v in _both(log, q, qd):
        if np.isfinite(limits[joint]) and len(v) > 3:
            below = sp.butter(1, limits[joint], fs=rate, output="sos")
            speeds[:, joint] = v + sp.sosfiltfilt(below, speeds[:, joint] - v)
            accelerations[:, joint] = slope(speeds[:, joint : joint + 1])[:, 0]
    return speeds, accelerations


def _both(log: Log, q: np.ndarray, qd: np.ndarray):
    """(joint, position, speed) of the joints that have both."""
    of_q, of_qd = (list(log.layout[name].joints or ()) for name in ("q", "qd"))
    for joint in of_q:
        if joint in of_qd:
            yield joint, q[:, of_q.index(joint)], qd[:, of_qd.index(joint)]

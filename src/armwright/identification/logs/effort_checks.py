"""Checks of torques, currents and voltages of a log against its motion: their power, and their delay."""

from __future__ import annotations

import numpy as np
from scipy import signal as sp

from armwright.identification.logs.delay import SignalDelay
from armwright.identification.logs.findings import Found, error, note, warning
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import settling
from armwright.identification.logs.smoothed import Smoothed

EXPLAINED = 0.9  # share of the variance that a joint's model explains, at least
BETTER = 0.7  # residual at the best delay by that at none, at most
SLOWEST = 1e-50  # [rad/s, or N m]: squares of less underflow
LEVEL = 1e-6  # of its size: an effort that changes less is constant
SOFT = 0.02  # of the largest speed: where Coulomb friction changes its sign
AGAINST, CERTAINLY = 0.5, 0.9  # share of the power that goes against the motion: noted, and an error of voltages
LOSS = 0.1  # work below which it is negative, by the power's flow
RETURNED = 0.1  # distance by the motion that is a return


def power(log: Log, smooth: Smoothed) -> Found:
    """Findings about the sign of torques, by their work over the run, and of voltages or currents against the motion."""
    if smooth.speeds and "tau" in smooth.values:
        yield from _work(smooth)
    for name in ("voltage", "current"):
        for j, column in smooth.columns(name):
            if j not in smooth.speeds:
                continue
            direction = 1.0 if log.gears is None else float(np.sign(log.gears[j, j]))
            watts = column * direction * smooth.speeds[j]
            share = float(watts.sum() / max(np.abs(watts).sum(), 1e-300))
            if share < -AGAINST:
                what = f"pushes against the motion in {(watts < 0).mean():.0%} of the rows"
                certain = name == "voltage" and share < -CERTAINLY
                sign = f"another sign of {name}, position or gear"
                yield (error if certain else warning)(what, f"{name} {log.joints[j]}", sign)


def _work(smooth: Smoothed) -> Found:
    """The work that all motors do; over a motion that ends where it began it is what friction takes, and not negative."""
    end, returned = len(smooth.values["tau"]), False
    if "q" in smooth.values:
        q = smooth.values["q"]
        distance = (np.abs(q - q[0]) / np.maximum(np.ptp(q, axis=0), 1e-12)).max(axis=1)
        back = end // 2 + int(np.argmin(distance[end // 2 :]))
        if distance[back] <= RETURNED:
            end, returned = back + 1, True
    powers = [(tau * smooth.speeds[j])[:end] for j, tau in smooth.columns("tau") if j in smooth.speeds]
    work = sum(float(each.sum()) for each in powers) * smooth.period
    flow = sum(float(np.abs(each).sum()) for each in powers) * smooth.period
    if not flow or work > -LOSS * flow:
        return
    what = f"all motors together do {work:.4g} J of work in {(end - 1) * smooth.period:.3g} s"
    if returned:
        what = f"{what}, after which the arm is back where it was: friction would give energy"
        yield error(what, "tau", "another sign of torque or position")
    else:
        yield warning(f"{what}: the arm is lowered, or the sign of torques or positions is wrong", "tau")


def torque_delays(log: Log, smooth: Smoothed) -> Found:
    """Findings about delays of torques and currents, by a model of each joint alone: inertia, friction, gravity, offset."""
    positions = dict(smooth.columns("q"))
    for name in ("tau", "current"):
        for j, effort in smooth.columns(name):
            found = motion_delay(positions[j], effort, smooth.period, smooth.sections) if j in positions else None
            if found is None or abs(found.samples) < max(0.5, 3 * found.std):
                continue
            late = "behind" if found.samples > 0 else "ahead of"
            what = (
                f"about {abs(found.samples):.1f} ± {found.std:.1g} samples ({1e3 * abs(found.samples) * smooth.period:.3g} ms) "
                f"{late} the motion, by a model of this joint alone"
            )
            yield note(what, f"{name} {log.joints[j]}")


def motion_delay(q: np.ndarray, effort: np.ndarray, period: float, sections: np.ndarray) -> SignalDelay | None:
    """Delay of a torque or current behind the motion with the best fit of a one-joint model.

    effort(k) ≈ a q̈ + b q̇ + c q̇/√(q̇² + v²) + d sin q + e cos q + f, all at k − d, least squares for each of 13 delays and a
    parabola through the smallest residuals. The right side passes the filter that the effort has passed: friction has jumps.

    Args:
        q: (k,) [rad].   effort: (k,), filtered.   period: [s].   sections: the effort's zero-phase filter.
    Returns:
        delay: None where the model explains too little, or no delay is clearly better than none.
    """
    qd = np.gradient(q, period)
    soft = SOFT * np.abs(qd).max()
    most, edge = 6, settling(sections, 1e-2)
    if soft < SLOWEST or len(q) < 2 * edge + 30 * most:
        return None
    lags = np.arange(-most, most + 1)
    model = [np.gradient(qd, period), qd, qd / np.sqrt(qd**2 + soft**2), np.sin(q), np.cos(q), np.ones_like(q)]
    matrix = np.asarray(sp.sosfiltfilt(sections, np.stack(model, axis=1), axis=0, padlen=min(len(q) - 1, edge)))
    matrix /= np.maximum(np.abs(matrix).max(axis=0), 1e-300)
    inside = np.arange(edge + most, len(q) - edge - most)
    target = effort[inside]
    size = float(np.abs(target).max())
    if np.ptp(target) <= LEVEL * size or size < SLOWEST:
        return None
    target = target / size
    rest = []
    for lag in lags:
        rows = matrix[inside - lag]
        solution, *_ = np.linalg.lstsq(rows, target, rcond=None)
        rest.append(float(((target - rows @ solution) ** 2).mean()))
    residual = np.array(rest)
    k = int(np.argmin(residual))
    explained = 1 - residual[k] / target.var()
    if k in (0, len(lags) - 1) or explained < EXPLAINED or residual[k] > BETTER * residual[most]:
        return None
    left, middle, right = residual[k - 1 : k + 2]
    curvature = left - 2 * middle + right
    samples = lags[k] + 0.5 * (left - right) / curvature
    # independent rows are far fewer than rows: motion is smooth
    std = float(np.sqrt(2 * middle / curvature / max(len(target) / 50, 1)))
    return SignalDelay(float(samples), std, 1.0, float(explained))

"""Heat of motors over a whole motion: root mean square torques within limits, by slower motions and lower torques.

A winding's heat is R i² with i = tau / (n Kt), so that what a motor bears for ever is a limit of the root mean square of its
torque:  √(∫ tau² dt / T) ≤ tau_rms. Played slower, with x and s̈ times σ, tau tends to what holds the arm; planned within less
torque, a motion has no peaks that heat more than they hasten. Of plans within torques between their peaks and the limit of
their mean, each played as slowly as its heat asks for, the fastest is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from armwright.errors import ScenarioError
from armwright.kernels.compiled import CompiledArm
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.time_optimal.constraints import PathLimits
from armwright.trajectory.time_optimal.motion import PathMotion
from armwright.trajectory.time_optimal.path_use import PathUse
from armwright.trajectory.time_optimal.planner import KEPT, Planner, largest

POINTS = np.linspace(0.0, 1.0, 9)  # of a piece's time, and their weights by Simpson's rule
WEIGHTS = np.array([1.0, 4.0, 2.0, 4.0, 2.0, 4.0, 2.0, 4.0, 1.0]) / 24.0
SCALES = np.geomspace(1.0, 1e-4, 41)  # σ, down to a hundredth of the speed
HALVINGS = 30  # of σ between two of them
PLANS = 10  # with other limits of torque
SLOWEST = 1e12  # [s] in place of a plan that does not exist


def cooled(
    dyn: CompiledArm,
    motion: PathMotion,
    limits: MotionLimits,
    rms: np.ndarray,
    plan: Callable[[MotionLimits], PathMotion],
) -> PathMotion:
    """The fastest of some motions whose root mean square torques are within limits.

    Args:
        dyn: the compiled arm.   motion: the fastest within `limits`, from rest to rest.
        rms: (n,) [N m | N] limits, of the motors, referred to the joints.   plan: the fastest motion within other limits.
    Returns:
        motion: the given one if it is within them.
    Raises:
        ScenarioError: the motors get too hot at any speed: names the joint, its torque and its limit.
    """
    found, peak = _torques(dyn, motion, 1.0)
    if (found <= rms).all():
        return replace(motion, rms_torque=found)
    best = _slowed(dyn, motion, limits, rms)
    hot = np.where(peak > rms, rms, np.inf)
    tried: list[PathMotion] = [] if best is None else [best]

    def duration(part: float) -> float:
        lower = np.where(np.isfinite(hot), peak + part * (hot - peak), limits.torque)
        try:
            slower = _slowed(dyn, plan(limits.replace(torque=np.minimum(lower, limits.torque))), limits, rms)
        except ScenarioError:  # so little torque does not hold the arm
            slower = None
        tried.extend([] if slower is None else [slower])
        return SLOWEST if slower is None else slower.duration

    minimize_scalar(duration, bounds=(0.0, 1.0), method="bounded", options={"maxiter": PLANS, "xatol": 1e-2})
    if not tried:
        raise _too_hot(dyn, motion, rms)
    return min(tried, key=lambda each: each.duration)


def _slowed(dyn: CompiledArm, motion: PathMotion, limits: MotionLimits, rms: np.ndarray) -> PathMotion | None:
    """The motion, played slower until its root mean square torques are within limits; None if it then exceeds others."""

    def fits(scale: float) -> bool:
        return bool((_torques(dyn, motion, scale)[0] <= rms).all())

    first = next((k for k, scale in enumerate(SCALES) if fits(scale)), None)
    if first is None:
        return None
    scale = float(SCALES[first])
    if first > 0:
        above = float(SCALES[first - 1])
        for _ in range(HALVINGS):
            middle = 0.5 * (scale + above)
            scale, above = (middle, above) if fits(middle) else (scale, middle)
    slower = motion.timing.slowed(scale**-0.5)
    if motion.spans is None:
        planner = Planner(dyn, limits, motion.path, motion.s, (0.0, 0.0))
        planner.levelled[~np.broadcast_to(motion.ramps, planner.levelled.shape)] = 1
        used = planner.judged(slower.x)
    else:
        use = PathUse(motion.path, limits, dyn, 1.0)
        used = use.by_name(use.peaks(slower))
    excess = largest(used) - 1.0
    if excess > KEPT:  # of friction that is larger at lower speeds
        return None
    return replace(
        motion, x=slower.x, spans=slower.spans, used=used, excess=excess, rms_torque=_torques(dyn, motion, scale)[0]
    )


def _torques(dyn: CompiledArm, motion: PathMotion, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Root mean square and largest magnitude of the torques (n,) [N m | N], with x and s̈ times a scale."""
    timing = motion.timing.slowed(scale**-0.5)
    pieces = np.arange(len(motion.s) - 1)[:, None]
    s, speed, sdd = timing.at(pieces, POINTS * timing.durations[:, None])
    points = PathLimits.at(dyn, MotionLimits.of(dyn.arm), motion.path, s.ravel())
    torque = points.torque(speed.reshape(-1, 1) ** 2, sdd.reshape(-1, 1)).reshape(*s.shape, -1)
    mean = np.einsum("kpn,p,k->n", torque**2, WEIGHTS, timing.durations) / timing.durations.sum()
    return np.sqrt(mean), np.abs(torque).max(axis=(0, 1))


def _too_hot(dyn: CompiledArm, motion: PathMotion, rms: np.ndarray) -> ScenarioError:
    """The error for motors that get too hot, however slowly the arm moves."""
    least = np.min([_torques(dyn, motion, float(scale))[0] for scale in SCALES], axis=0)
    joint = int(np.argmax(least / rms))
    if least[joint] <= rms[joint]:
        expected = "other limits, or another path"
        return ScenarioError("no slower motion keeps all limits", place="rms_torque", value=rms, expected=expected)
    name, unit = dyn.arm.names[joint], MotionLimits.of(dyn.arm).unit("torque", joint)
    return ScenarioError(
        f"holding the arm along the path takes {least[joint]:.5g} {unit} of {name} on average (rms), however slowly",
        place="rms_torque", value=float(rms[joint]), expected="a lighter payload, a stronger motor or another path",
    )  # fmt: skip

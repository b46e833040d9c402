"""Design rules: a joint's gains at a bandwidth, as a cascade of position P around speed PI.

    ω_r = k_p (q_r - q),   u = k_s (ω_r - q̇) + k_i ∫ (ω_r - q̇) dt,   plant  m q̈ + b q̇ = u  behind a small lag T

A PID controller with kp = k_s k_p + k_i, ki = k_i k_p, kd = k_s has the same loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armwright.control.analysis.hold import sampled_system
from armwright.control.analysis.small_signal import SmallPlant
from armwright.control.design.joint_plants import JointPlants
from armwright.control.design.state_space import import_control
from armwright.model import Model

SLOW = 0.1  # the integral's pole or corner, as a share of the bandwidth
LEAST = 0.1  # of the damping that the poles ask for: what is left of it beside a joint's own
SYMMETRIC = 2.0  # √ of the ratio of the corners in Kessler's symmetric optimum: a phase margin of 37°


@dataclass(frozen=True, eq=False)
class JointGains:
    """Gains of a cascade, (…, n) each: position [1/s], speed [U s/rad | U s/m] and its integral [U/rad | U/m]."""

    position: np.ndarray
    speed: np.ndarray
    integral: np.ndarray


@dataclass(frozen=True, eq=False)
class DesignTask:
    """Arm, joint models and loop timing of a design.

    Attributes:
        arm: the model.   joints: its low-frequency models.   damping: ζ of the closed loop.   integral: whether k_i is wanted.
        period, delay: [s] of the loop.
    """

    arm: Model
    joints: JointPlants
    damping: float
    integral: bool
    period: float
    delay: float

    @cached_property
    def weightless(self) -> tuple[np.ndarray, np.ndarray]:
        """A (n, N, N) and B (n, N, n) of the coupled arm without gravity, at each joint's pose of largest inertia."""
        e, a, b = SmallPlant(self.arm.replace(gravity=np.zeros(3))).slopes(self.joints.poses[self.joints.worst])
        return np.linalg.solve(e, a), np.linalg.solve(e, b)


Rule = Callable[[DesignTask, np.ndarray], JointGains]


def pole_placement(task: DesignTask, bandwidth: np.ndarray) -> JointGains:
    """Poles at  s² + 2ζω s + ω²,  with an integral a third one at -ω/10, for the joint at its largest inertia.

    Without integral  k_s = 2ζωm - b,  k_p k_s = m ω².  With it, of the two k_p of
    k_s k_p² - m(1 + 2ζα)ω² k_p + m α ω³ = 0,  k_s = m(2ζ + α)ω - b,  the larger one. A joint whose own damping b exceeds what the
    poles ask for keeps a tenth of it for k_s, and its slower pole lies at -ω.  [AstromHagglund2006]

    Args:
        task: the conditions.   bandwidth: (…, n) ω [rad/s].
    """
    (m, b), w, zeta = task.joints.largest, bandwidth, task.damping
    alpha = SLOW if task.integral else 0.0
    wanted = (2.0 * zeta + alpha) * m * w
    speed = np.maximum(wanted - b, LEAST * wanted)
    stiffness = m * (1.0 + 2.0 * zeta * alpha) * w * w
    stiffness = np.where(speed > wanted - b, np.maximum(stiffness, (b + speed) * w - m * w * w), stiffness)
    third = m * alpha * w**3
    root = np.maximum(stiffness * stiffness - 4.0 * speed * third, 0.0)
    position = (stiffness + np.sqrt(root)) / (2.0 * speed)
    return JointGains(position, speed, third / position)


def symmetric_optimum(task: DesignTask, bandwidth: np.ndarray) -> JointGains:
    """Speed PI by the symmetric optimum, position P by the speed loop's equivalent time constant.  [Kessler1958], [Leonhard2001]

        a = 1 / (ω T),   c = max(ω / a, b / m),   k_s = m ω,   k_i = k_s c,   k_p = c / (4 ζ² (1 + b / (m ω) - b / (m c)))

    ω is the crossover of the speed loop, T all small delays together. Of a joint without damping b, a = 2 is Kessler's rule, with
    k_p = ω / (4 ζ² a); a larger a has more phase margin: a = (1 + cos φ) / sin φ. Where m / b is shorter than Kessler's integral
    time a / ω, the integral cancels it, as in the magnitude optimum, and k_p = ω / (4 ζ²). Without an integral the speed loop
    reaches only k_s / (k_s + b) of its reference, which k_p makes up for:  k_p = ω (1 + b / k_s) / (4 ζ²).

    Args:
        task: the conditions.   bandwidth: (…, n) ω [rad/s], below 1/T.
    """
    (m, b), w = task.joints.largest, bandwidth
    speed = m * w
    if not task.integral:
        return JointGains(w * (1.0 + b / speed) / (4.0 * task.damping**2), speed, np.zeros_like(speed))
    corner = np.maximum(w * w * task.joints.lag, b / m)
    position = corner / (4.0 * task.damping**2 * (1.0 + b / speed - b / (m * corner)))
    return JointGains(position, speed, speed * corner)


def loop_shaping(task: DesignTask, bandwidth: np.ndarray) -> JointGains:
    """Crossover of the sampled loop at ω with the phase margin φ of damping ζ: two gains from magnitude and phase.

        (k_s k_p + j ω k_s e^{-jωT_q}) P(e^{jωh}) = -e^{jφ},   tan φ = 2ζ / √(√(1 + 4ζ⁴) - 2ζ²)

    P is the sampled joint with its hold and delay, as a system of python-control at the pose of largest inertia; T_q the lag of
    the measured speed. The integral's corner lies at ω/10.  [AstromHagglund2006]

    Args:
        task: the conditions.   bandwidth: (…, n) ω [rad/s]. Where a gain would be negative it is not a number.
    """
    joints, zeta = task.joints, task.damping
    w = np.atleast_2d(bandwidth)
    phase = np.arctan2(2.0 * zeta, np.sqrt(np.sqrt(1.0 + 4.0 * zeta**4) - 2.0 * zeta**2))
    response = np.stack([_sampled_joint(task, joint, w[:, joint]) for joint in range(w.shape[1])], axis=1)
    wanted = -np.exp(1j * phase) / response
    late = w * np.maximum(joints.lag - task.period / 2.0 - task.delay, 0.0)
    # wanted = k_s k_p + ω k_s (sin(late) + j cos(late))
    speed = np.where(np.cos(late) > 0.0, wanted.imag / (w * np.cos(late)), -1.0)
    stiffness = wanted.real - w * speed * np.sin(late)
    good = (speed > 0.0) & (stiffness > 0.0) & (w * task.period < np.pi)
    speed, stiffness = np.where(good, speed, np.nan), np.where(good, stiffness, np.nan)
    shape = np.shape(bandwidth)
    integral = SLOW * w * speed * task.integral
    return JointGains((stiffness / speed).reshape(shape), speed.reshape(shape), integral.reshape(shape))


def _sampled_joint(task: DesignTask, joint: int, w: np.ndarray) -> np.ndarray:
    """(k,) response of a joint, the others held, at its pose of largest inertia, at frequencies w (k,) [rad/s]."""
    m, b = (each[joint] for each in task.joints.largest)
    a = np.array([[0.0, 1.0], [0.0, -b / m]])  # weight is compensated, or held by the integral
    system = sampled_system(a, [[0.0], [1.0 / m]], [[1.0, 0.0]], task.period, task.delay)
    return np.asarray(system(np.exp(1j * w * task.period))).reshape(w.shape)


def lqr(task: DesignTask, bandwidth: np.ndarray) -> JointGains:
    """Linear-quadratic regulator of the coupled arm, reduced to each joint's own position and speed.

        min ∫ Σ_j (q_j² + u_j² / (m_j ω_j²)²) dt

    so that a joint without damping and coupling gets  k_s k_p = m ω²,  k_s = √2 m ω.  One regulator by `control.lqr` for each
    joint, at its pose of largest inertia, without weight, which is compensated or held by the integral. ζ is not used; the
    integral's corner lies at ω/10.  [AndersonMoore1990]

    Args:
        task: the conditions.   bandwidth: (…, n) ω [rad/s].
    """
    control, n = import_control(), task.arm.n
    m, _ = task.joints.largest
    w = np.atleast_2d(bandwidth)
    gains = np.full((2, *w.shape), np.nan)
    for joint in range(n):
        a, b = (each[joint] for each in task.weightless)
        weights = np.zeros(len(a))
        weights[:n] = 1.0
        for k, row in enumerate(w):
            unit = m * row * row  # of each command, so that the equation is well conditioned
            try:
                found = unit[:, None] * control.lqr(a, b * unit, np.diag(weights), np.eye(n))[0]
            except (ValueError, np.linalg.LinAlgError):
                continue
            gains[:, k, joint] = np.abs(found[joint, [joint, n + joint]])  # a negative gear turns both
    stiffness, speed = gains
    shape = np.shape(bandwidth)
    integral = SLOW * w * speed * task.integral
    return JointGains((stiffness / speed).reshape(shape), speed.reshape(shape), integral.reshape(shape))


RULES: dict[str, Rule] = {
    "pole-placement": pole_placement,
    "symmetric-optimum": symmetric_optimum,
    "loop-shaping": loop_shaping,
    "lqr": lqr,
}

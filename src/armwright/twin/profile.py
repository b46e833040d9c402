"""Trapezoidal speed profiles, tick by tick, and the position and speed loops of the drives."""

from __future__ import annotations

import numpy as np

from armwright.control.anti_windup import LimitedStage
from armwright.dynamics import mass_matrix
from armwright.model import Model
from armwright.twin.units import Units

SPEED_LOOP = 0.3  # ω T of the speed loop; of it 1/4 for the position, 1/6 for the integrator, as in docs/bus-study.md
FASTEST = 50.0  # [rad/s] of the speed loop, also at shorter periods


def approach(
    position: float, speed: float, target: float, most: float, acceleration: float, deceleration: float, period: float
) -> tuple[float, float]:
    """Position and speed one tick later on a trapezoidal speed profile that reaches the target exactly.

    Args:
        position, speed: now.   target: to come to rest at.   most: speed.   acceleration, deceleration: above 0.   period: [s].
    """
    way = target - position
    braking = deceleration * period
    # v T + v²/(2 d) = way: the speed from which the rest of the way is enough to brake, after a tick at it
    allowed = (-braking + np.sqrt(braking * braking + 8.0 * deceleration * abs(way))) / 2.0
    wanted = np.sign(way) * min(most, allowed)
    speed = float(np.clip(wanted, speed - max(acceleration, deceleration) * period, speed + acceleration * period))
    if abs(way) <= abs(speed) * period or (abs(way) < 1.0 and abs(speed) <= braking):
        return target, 0.0
    return position + speed * period, speed


def slowed(position: float, speed: float, deceleration: float, period: float) -> tuple[float, float]:
    """Position and speed one tick later on the ramp to rest."""
    following = float(np.sign(speed) * max(abs(speed) - deceleration * period, 0.0))
    return position + 0.5 * (speed + following) * period, following


class Servo:
    """Position and speed loops of all drives, for the joints that follow positions.

        ω = kp (q_r - q) + q̇_r      u = clip(kv (ω - q̇) + I + feedforward, ±limit)

    Attributes:
        integral: (n,) I [A | N m | N], forward.
    """

    def __init__(self, arm: Model, units: Units, q: np.ndarray, period: float):
        """The loops at a pose.

        Args:
            arm: the model.   units: of its commands.   q: (n,) where it stands.   period: [s].
        """
        bandwidth = min(SPEED_LOOP / period, FASTEST)  # [1/s]
        free = 1.0 / np.diag(np.linalg.inv(mass_matrix(arm, q)))  # [kg m² | kg] of a joint while the others are free
        inertia = free / units.torque
        self._signs, self._period = units.signs, period
        self._kp, self._kv = bandwidth / 4.0, bandwidth * inertia
        self._ki = bandwidth / 6.0 * self._kv
        self.integral = np.zeros(arm.n)

    def command(
        self,
        wanted: np.ndarray,
        wanted_speed: np.ndarray,
        q: np.ndarray,
        qd: np.ndarray,
        limit: np.ndarray,
        feedforward: np.ndarray | float = 0.0,
    ) -> np.ndarray:
        """Commands (n,) [A | N m | N] that follow positions (n,) and speeds (n,) within limits (n,), with commands (n,) added."""
        speed, more = self._kp * (wanted - q) + wanted_speed, self._signs * feedforward
        stage = LimitedStage(self._kv, self._ki, limit, self._period, "clamping")
        done = stage.step(speed - qd, self.integral, feedforward=more)
        self.integral = np.asarray(done.integral, dtype=float)
        return self._signs * np.asarray(done.output, dtype=float)

    def begin(self, joint: int, command: float) -> None:
        """Starts a joint's loop at the present command, without a jump at the motor."""
        self.integral[joint] = self._signs[joint] * command

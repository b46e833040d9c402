"""The position loop inside a servo: from its commanded goal to a duty or a current, once a period.

With T the period, c = 2π / counts the encoder's count, u the commanded goal and q the position:

    g' = g + within(u - g, v' T),       v' as fast as speed, acceleration and the way left allow
    e' = c (round(g' / c) - round(q / c)),  0 within the dead band
    w = K_p e' + K_i I' + K_d (e' - e) / T,  I' = I + e' T, held within limit / K_i,     within ± limit

A duty w is a voltage w V of a supply of V volts; a current w is one that the drive makes as its limits allow. What the loop
gives is in force until it turns again. P, I and D of Feetech's and Dynamixel's servos are such gains in units of their own;
P of the former was measured with an oscilloscope. [DuclusaudEtAl2025] A servo that is off forgets its goal: switched on again
it moves from where it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from armwright import scalar
from armwright.model import Body, Firmware, Model
from armwright.scalar import Array, Scalar


@dataclass(frozen=True, eq=False)
class FirmwareState:
    """Memory of a servo's loop; None for parts that it lacks."""

    goal: Scalar  # that it follows [rad]
    output: Scalar  # in force [1 | A]
    goal_speed: Scalar | None = None  # [rad/s]
    goal_error: Scalar | None = None  # when it last turned [rad]
    goal_integral: Scalar | None = None  # of the errors [rad s]
    waiting: tuple[Scalar, ...] = ()  # outputs that come into force, the next one first [1 | A]


def turned(firmware: Firmware, state: FirmwareState, q: Scalar, u: Scalar, on: Scalar = 1.0) -> FirmwareState:
    """The state after a turn of the loop.

    Args:
        firmware: the loop.   state: before.   q: position [rad].   u: commanded goal [rad].   on: 1; 0 of a servo that is off.
    """
    count, period = firmware.count, firmware.period
    wanted = u if firmware.goals is None else scalar.clip(u, *firmware.goals)
    goal, speed = _moved(firmware, scalar.where(on, state.goal, q), state.goal_speed, scalar.where(on, wanted, q))
    error = goal - q if count is None else count * (_rounded(goal / count) - _rounded(q / count))
    if firmware.dead_band is not None and count is not None:  # half a count more: errors are whole counts
        error = scalar.where(scalar.less(scalar.abs(error), firmware.dead_band + 0.5 * count), 0.0, error)
    output, integral = firmware.proportional * error, state.goal_integral
    if firmware.integral is not None and integral is not None:
        most = firmware.limit / firmware.integral
        integral = on * scalar.clip(integral + error * period, -most, most)
        output = output + firmware.integral * integral
    if firmware.derivative is not None and state.goal_error is not None:
        output = output + firmware.derivative / period * (error - scalar.where(on, state.goal_error, error))
    output = on * scalar.clip(output, -firmware.limit, firmware.limit)
    coming = (*state.waiting, output)
    return FirmwareState(
        goal,
        coming[0],
        None if speed is None else on * speed,
        None if state.goal_error is None else error,
        integral,
        coming[1:],
    )


def _moved(firmware: Firmware, goal: Scalar, speed: Scalar | None, wanted: Scalar) -> tuple[Scalar, Scalar | None]:
    """Goal and its speed a period later.

    With an acceleration a, v (v + a T) / 2a is the way in which steps of T that are slower by a T each bring it to rest.
    """
    way, period = wanted - goal, firmware.period
    if firmware.speed is None:
        return wanted, None
    if firmware.acceleration is None or speed is None:
        most = firmware.speed * period
        return goal + scalar.clip(way, -most, most), None
    a, half = firmware.acceleration, 0.5 * period
    left = scalar.abs(way)
    fastest = a * (scalar.sqrt(half * half + 2.0 * left / a) - half)
    fastest = scalar.minimum(scalar.minimum(fastest, left / period), firmware.speed)
    toward = scalar.where(scalar.less(way, 0.0), -fastest, fastest)
    reached = scalar.clip(toward, speed - a * period, speed + a * period)
    return goal + reached * period, reached


def _rounded(value: Scalar) -> Scalar:
    """The nearest whole number; the upper one of two."""
    return scalar.floor(value + 0.5)


def within_drive(firmware: Firmware, output: Scalar, supply: Scalar) -> Scalar:
    """Command for the drive behind the loop: a voltage [V] of a supply of so many volts, or a current [A]."""
    return output * supply if firmware.output == "duty" else output


def bridged(body: Body) -> Body:
    """The joint with the drive behind its servo's loop, which takes a voltage or a current; others as they are."""
    return body if body.drive.firmware is None else replace(body, drive=body.drive.bridge)


def error_for(firmware: Firmware, output: Scalar) -> Scalar:
    """Error [rad] for which P alone gives an output [1 | A], as far as its limit lets it; 0 where P is 0."""
    if not scalar.is_symbolic(firmware.proportional) and firmware.proportional == 0:
        return 0.0 * output
    return scalar.clip(output, -firmware.limit, firmware.limit) / firmware.proportional


def with_goals(arm: Model, u: Array, q: Array) -> Array:
    """Commands (n,) in which a servo's error [rad], as `in_command_units` gives it, has become its goal from q (n,) [rad | m]."""
    servos = [body.drive.firmware is not None for body in arm.coordinates]
    if not any(servos):
        return u
    return scalar.array([q[i] + u[i] if servo else u[i] for i, servo in enumerate(servos)])

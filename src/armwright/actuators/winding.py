"""The drive and the winding of one motor, from its command to its torque, with limits, inductance, PWM and a real supply.

With everything referred to the joint, E = n Ke q̇:   L di/dt = V - R i - E,   tau = n Kt i.  Without L:  i = (V - E) / R.

The drive turns its command into a voltage V; a dead zone of its stage takes that much away (`dead_zone`). A limit of current
limits that voltage, V within E ± R i_max: the current that follows stays within it, and power balances. Then the supply clips
V, even where the current then passes its own limit: a motor that is driven back faster than the supply can answer. A drive
with a command of current or torque applies the voltage that gives it in the end, V = R i* + E; or, with a current controller
of bandwidth f, V = R i + E + 2π f L (i* - i): the current follows as di/dt = 2π f (i* - i), which a PI controller with its
zero on the winding's pole comes to.
The drive turns torques into currents by the constant of the record, whatever the motor's temperature.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armwright import scalar
from armwright.actuators.dead_zone import beyond
from armwright.actuators.motor import joint_constant, joint_current, joint_torque, joint_voltage
from armwright.actuators.pwm import coasting, coasting_limits
from armwright.model import Body, Drive
from armwright.scalar import Scalar


@dataclass(frozen=True, eq=False)
class Winding:
    """Electrical state of one motor; voltage and current are NaN where the record lacks the constants to know them."""

    torque: Scalar  # n Kt i [N m | N]
    voltage: Scalar  # V, averaged over the PWM [V]
    current: Scalar  # i [A]
    power: Scalar  # from the supply [W]
    heat: Scalar | None = None  # in the resistance [W]; None where it is not known
    change: Scalar | None = None  # di/dt [A/s], where the current is a state
    rate: Scalar | None = None  # its part that is linear in i [1/s], below 0


def driven_winding(
    body: Body,
    drive: Drive,
    speed: Scalar,
    u: Scalar,
    supply: Scalar,
    current: Scalar | None = None,
    bus: Scalar | None = None,
) -> Winding:
    """Torque, voltage and current that a drive gives for its command.

    Args:
        body: the joint with its limits and the drive of the record.
        drive: the same at its present temperature (`thermal.warmed`).
        speed: of the motor, referred to the joint [rad/s | m/s].   u: [V | A | N m | N], by the drive's command.
        supply: the highest voltage there is [V].   current: i [A], where it is a state.
        bus: the voltage that a bridge switches [V], which a limit of voltage may be below; by default `supply`.
    """
    if drive.torque_constant is None:
        torque = clipped(u, body.limits.torque)
        return Winding(torque, np.nan, np.nan, torque * speed)
    constant, most = joint_constant(drive), current_limit(body)
    if drive.dead_zone is not None:  # the record has it with a command of voltage only
        u = beyond(clipped(u, supply), drive.dead_zone)
    if drive.resistance is None:  # commanded by current or torque
        torque = _commanded_torque(body, drive, u, most)
        return Winding(torque, np.nan, joint_current(drive, torque), torque * speed)
    if drive.coasts:  # the record has it with a command of voltage and without inductance only
        emf = drive.gear_ratio * drive.back_emf_constant * speed
        switched = supply if bus is None else bus
        voltage = scalar.clip(u, *coasting_limits(most, switched, emf, drive.resistance)) if is_limit(most) else u
        voltage = clipped(voltage, supply)
        current, heat, power = coasting(voltage, switched, emf, drive.resistance)
        return Winding(constant * current, voltage, current, power, heat)
    if drive.command == "voltage":
        voltage = u
        if is_limit(most):
            voltage = scalar.clip(u, *(joint_voltage(drive, speed, constant * i) for i in (-most, most)))
        torque = joint_torque(drive, speed, voltage)
    else:
        torque = _commanded_torque(body, drive, u, most)
        voltage = joint_voltage(drive, speed, torque)
    if current is not None:
        return _inductive(drive, speed, voltage, torque, supply, current)
    if is_limit(supply):
        voltage = clipped(voltage, supply)
        torque = joint_torque(drive, speed, voltage)
    current = joint_current(drive, torque)
    return Winding(torque, voltage, current, voltage * current, drive.resistance * current * current)


def switched(drive: Drive, winding: Winding, on: Scalar, speed: Scalar) -> Winding:
    """The winding where the drive is on; where it is off its bridge is open, no current flows, and V = E.

    Args:
        drive: of the record, without inductance.   winding: of the drive that is on.   on: 1 or 0.
        speed: of the motor, referred to the joint [rad/s | m/s].
    """
    emf = 0.0 if drive.back_emf_constant is None else drive.gear_ratio * drive.back_emf_constant * speed
    values = {name: scalar.where(on, getattr(winding, name), 0.0) for name in ("torque", "current", "power")}
    heat = None if winding.heat is None else scalar.where(on, winding.heat, 0.0)
    return replace(winding, voltage=scalar.where(on, winding.voltage, emf), heat=heat, **values)


def _commanded_torque(body: Body, drive: Drive, u: Scalar, most: Scalar) -> Scalar:
    """Torque [N m | N] for a command of current or torque, within the limit of current."""
    if drive.command == "current":
        return joint_constant(drive) * clipped(u, most)
    torque = clipped(u, scalar.abs(joint_constant(body.drive)) * most) if is_limit(most) else u
    return torque if drive is body.drive else torque * (joint_constant(drive) / joint_constant(body.drive))


def _inductive(
    drive: Drive, speed: Scalar, voltage: Scalar, torque: Scalar, supply: Scalar, current: Scalar
) -> Winding:
    """The winding whose current is a state; `voltage`, `torque`: what the drive would apply and reach in the end."""
    assert drive.resistance is not None
    assert drive.inductance is not None
    emf, rate = drive.gear_ratio * drive.back_emf_constant * speed, -drive.resistance / drive.inductance
    if drive.current_loop is not None and drive.command != "voltage":
        bandwidth = 2.0 * np.pi * drive.current_loop  # [1/s]
        missing = joint_current(drive, torque) - current
        voltage = drive.resistance * current + emf + bandwidth * drive.inductance * missing
        within = scalar.less(scalar.abs(voltage), supply) if is_limit(supply) else None
        rate = -bandwidth if within is None else scalar.where(within, -bandwidth, rate)
    voltage = clipped(voltage, supply)
    change = (voltage - emf - drive.resistance * current) / drive.inductance
    heat, power = drive.resistance * current * current, voltage * current
    return Winding(joint_constant(drive) * current, voltage, current, power, heat, change, rate)


def is_ideal(drive: Drive) -> bool:
    """True for a drive without a resistance: it gives its torque, and takes its power, at any voltage."""
    return drive.torque_constant is None or drive.resistance is None


def current_limit(body: Body) -> Scalar:
    """Highest current [A] within the limits of current and of torque; infinite without either."""
    current, torque = body.limits.current, body.limits.torque
    if not is_limit(torque):
        return current
    of_torque = joint_current(body.drive, torque)
    return scalar.minimum(current, scalar.abs(of_torque)) if is_limit(current) else scalar.abs(of_torque)


def clipped(value: Scalar, most: Scalar) -> Scalar:
    """The value within ±most, where that is a limit."""
    return scalar.clip(value, -most, most) if is_limit(most) else value


def is_limit(most: Scalar) -> bool:
    """True for a symbol or a finite number."""
    return scalar.is_symbolic(most) or most < np.inf

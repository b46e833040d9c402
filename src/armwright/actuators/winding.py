"""The winding between command and torque, with what eq. (11) leaves out: inductance, heat, the supply as it is.

With everything referred to the joint, E = n Ke q̇:   L di/dt = V - R i - E,   tau = n Kt i.  Without L:  i = (V - E) / R.

The drive makes V of its command. A limit of current is a limit of that voltage, V within E ± R i_most: the current that it
comes to stays within, and power balances. Then the supply clips. A drive told a current or a torque applies the voltage
that gives it in the end, V = R i* + E; or, with a current controller of bandwidth f,  V = R i + E + 2π f L (i* - i):
the current follows as di/dt = 2π f (i* - i), which a PI controller with its zero on the winding's pole comes to.
The drive turns torques into currents by the constant of the record, whatever the motor's temperature has made of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.actuators.drive import clipped, is_limit, most_current
from armwright.actuators.motor import joint_constant, joint_current
from armwright.actuators.pwm import coasting, coasting_limits
from armwright.model import Body, Drive
from armwright.scalar import Scalar


@dataclass(frozen=True, eq=False)
class Winding:
    """What a motor does electrically."""

    torque: Scalar  # n Kt i [N m | N]
    voltage: Scalar  # V, averaged over the PWM [V]
    current: Scalar  # i [A]
    heat: Scalar  # in the resistance [W]
    power: Scalar  # from the supply [W]
    change: Scalar | None = None  # di/dt [A/s], where the current is a state
    rate: Scalar | None = None  # its part that is linear in i [1/s], below 0


def driven_winding(
    body: Body, drive: Drive, speed: Scalar, u: Scalar, supply: Scalar, current: Scalar | None = None
) -> Winding:
    """What the drive's command makes of the winding.

    Args:
        body: the joint with its limits and the drive of the record.
        drive: the same as it is now (`thermal.warmed`).
        speed: of the motor, referred to the joint [rad/s | m/s].   u: [V | A | N m | N], by the drive's command.
        supply: the most voltage there is [V].   current: i [A], where it is a state.
    """
    assert drive.resistance is not None
    assert drive.back_emf_constant is not None
    resistance, emf, most = drive.resistance, drive.gear_ratio * drive.back_emf_constant * speed, most_current(body)
    if drive.coasts:
        voltage = scalar.clip(u, *coasting_limits(most, supply, emf, resistance)) if is_limit(most) else u
        voltage = clipped(voltage, supply)
        current, heat, power = coasting(voltage, supply, emf, resistance)
        return Winding(joint_constant(drive) * current, voltage, current, heat, power)
    wanted = None
    if drive.command == "voltage":
        voltage = scalar.clip(u, emf - resistance * most, emf + resistance * most) if is_limit(most) else u
    else:
        wanted = clipped(u if drive.command == "current" else joint_current(body.drive, u), most)
        voltage = resistance * wanted + emf
    if current is None:
        voltage = clipped(voltage, supply)
        current = (voltage - emf) / resistance
        heat, power = resistance * current * current, voltage * current
        return Winding(joint_constant(drive) * current, voltage, current, heat, power)
    rate = -resistance / drive.inductance
    if drive.current_loop is not None and wanted is not None:
        bandwidth = 2.0 * np.pi * drive.current_loop  # [1/s]
        voltage = resistance * current + emf + bandwidth * drive.inductance * (wanted - current)
        within = scalar.less(scalar.abs(voltage), supply) if is_limit(supply) else None
        rate = -bandwidth if within is None else scalar.where(within, -bandwidth, rate)
    voltage = clipped(voltage, supply)
    change = (voltage - emf - resistance * current) / drive.inductance
    heat, power = resistance * current * current, voltage * current
    return Winding(joint_constant(drive) * current, voltage, current, heat, power, change, rate)

"""The state of a plant: positions and speeds, then the states of the record's drives."""

from __future__ import annotations

from collections.abc import Callable

from armwright.model import Body, Firmware, Model
from armwright.model.joint_signals import joint_signal
from armwright.signals import Layout, Signal

# Parts of the state behind q and q̇, with the quantity whose unit each has and what it is; outputs of the plant, too.
SHOWN = {
    "motor_q": ("rad", "position of the motor behind its elastic gear"),  # θ_motor, in the motor's own radians
    "motor_qd": ("rad/s", "velocity of the motor behind its elastic gear"),
    "bristle": ("q", "deflection of the bristles"),
    "brake": ("q", "how far the brake gave way"),
    "winding_temperature": ("°C", "temperature of the motor's winding"),
    "housing_temperature": ("°C", "temperature of the motor's housing"),
    "goal": ("q", "goal that the servo follows"),
    "duty": ("1", "duty of the servo's bridge"),
    "goal_current": ("A", "current that the servo asks for"),
}
ABOUT = {
    **SHOWN,
    "goal_speed": ("qd", "speed of that goal"),
    "goal_error": ("q", "error when its loop last turned"),
    "goal_integral": ("rad s", "integral of the errors"),
}
BUS_VOLTAGE = ("V", "voltage of the supply's bus")
OUTPUTS = ("duty", "goal_current")  # of a servo's loop, in force
WAITING = "output_in_"  # how the names of its outputs begin that come into force so many periods later
KEPT = ("goal", "goal_speed", "goal_error", "goal_integral", *OUTPUTS)  # what changes when it turns, and not between


def is_kept(name: str) -> bool:
    """True for a part of the state that changes only when a servo's loop turns."""
    return name in KEPT or name.startswith(WAITING)


def state_layout(model: Model, brakes: bool) -> Layout:
    """The layout of an arm's state, with or without its brakes."""

    def which(has: Callable[[Body], bool]) -> tuple[int, ...]:
        return tuple(i for i, body in enumerate(model.coordinates) if has(body))

    served = [(i, body.drive.firmware) for i, body in enumerate(model.coordinates) if body.drive.firmware is not None]

    def servos(has: Callable[[Firmware], bool]) -> tuple[int, ...]:
        return tuple(i for i, firmware in served if has(firmware))

    latency = max((firmware.latency for _, firmware in served), default=0)
    elastic = which(lambda body: body.elasticity is not None)
    joints = {
        "q": which(lambda body: True),
        "qd": which(lambda body: True),
        "motor_q": elastic,
        "motor_qd": elastic,
        "current": which(lambda body: body.drive.inductance is not None),
        "bristle": which(lambda body: body.friction is not None and body.friction.has_bristles),
        "brake": which(lambda body: brakes and body.brake is not None and not body.brake.is_rigid),
        "winding_temperature": which(lambda body: body.drive.thermal is not None),
        "housing_temperature": which(
            lambda body: body.drive.thermal is not None and body.drive.thermal.housing is not None
        ),
        "goal": servos(lambda firmware: True),
        "goal_speed": servos(lambda firmware: firmware.acceleration is not None),
        "goal_error": servos(lambda firmware: firmware.derivative is not None),
        "goal_integral": servos(lambda firmware: firmware.integral is not None),
        "duty": servos(lambda firmware: firmware.output == "duty"),
        "goal_current": servos(lambda firmware: firmware.output == "current"),
    }
    about = ABOUT | {f"{WAITING}{k}": ("1", "output of the loop to come") for k in range(1, latency + 1)}
    joints |= {f"{WAITING}{k}": servos(lambda firmware, k=k: firmware.latency >= k) for k in range(1, latency + 1)}
    signals = [
        joint_signal(model, name, *about.get(name, (name, "")), which) for name, which in joints.items() if which
    ]
    if model.supply is not None:
        unit, what = BUS_VOLTAGE
        signals.append(Signal("bus_voltage", unit, (1,), about=what))
    return Layout.of(signals)


def contacts_of(body: Body) -> int:
    """Number of contacts that a joint can make: with its two stops, and between the flanks of a gear with play."""
    plays = body.elasticity is not None and body.elasticity.backlash is not None
    return 2 * (body.stops is not None) + 2 * plays


def has_effect(body: Body) -> bool:
    """True if a joint's drive has an effect that `forward_dynamics` does not know, be it with a state or without."""
    drive = body.drive
    effects = (body.elasticity, body.stops, drive.cogging, drive.thermal, drive.dead_zone)
    return drive.coasts or bool(drive.coupling) or any(part is not None for part in effects)

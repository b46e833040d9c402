"""Signals of an arm's joints: what they are called, and the unit that each joint has for them."""

from __future__ import annotations

from armwright.joint_kinds import LINEAR, ROTARY, JointUnits
from armwright.model.model import Model
from armwright.signals import Layout, Signal

UNITS = {  # of a joint whose coordinate is an angle, and of one where it is a length; a command's unit is its drive's
    "q": (ROTARY.position, LINEAR.position),
    "qd": (ROTARY.speed, LINEAR.speed),
    "qdd": (ROTARY.acceleration, LINEAR.acceleration),
    "tau": (ROTARY.torque, LINEAR.torque),
    "voltage": ("V", "V"),
    "current": ("A", "A"),
}
LONG_NAMES = {
    "q": "joint position",
    "qd": "joint velocity",
    "qdd": "joint acceleration",
    "u": "drive command",
    "tau": "motor torque referred to the joint",
    "voltage": "motor voltage",
    "current": "motor current",
}


def command_unit(command: str, units: JointUnits) -> str:
    """Unit of a drive command of a joint with those units: `command_unit("voltage", ROTARY)` → "V"."""
    return {"voltage": "V", "current": "A", "position": units.position}.get(command) or units.torque


def joint_units(arm: Model, quantity: str) -> list[str]:
    """The unit of a quantity for each joint: `joint_units(arm, "q")` → ["rad", "m", …]; another unit stands for itself."""
    if quantity == "u":
        return [command_unit(body.drive.command, body.kind.units) for body in arm.coordinates]
    if quantity not in UNITS:
        return [quantity] * arm.n
    return [UNITS[quantity][body.kind.units.linear] for body in arm.coordinates]


def joint_signal(
    arm: Model, name: str, quantity: str | None = None, about: str = "", joints: tuple[int, ...] | None = None
) -> Signal:
    """A signal with one entry a joint.

    Args:
        arm: the model.   name: of the signal.   quantity: whose unit it has, a key of `UNITS`, "u", or a unit; default: `name`.
        about: what it is.   joints: those that have it, by number; default: all.
    """
    quantity = quantity or name
    units, places = joint_units(arm, quantity), tuple(range(arm.n)) if joints is None else joints
    return Signal(
        name, tuple(units[i] for i in places), (len(places),), places, about=about or LONG_NAMES.get(quantity, "")
    )


def motion_layout(arm: Model) -> Layout:
    """Positions, speeds and accelerations of all joints: the layout of a joint reference."""
    return Layout.of(joint_signal(arm, name) for name in ("q", "qd", "qdd"))

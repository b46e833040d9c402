"""Signals of an arm's joints: what they are called, and the unit that each joint has for them."""

from __future__ import annotations

from armwright.model.model import Model
from armwright.signals import Layout, Signal

UNITS = {  # of a revolute and of a prismatic joint; a command's unit is its drive's
    "q": ("rad", "m"),
    "qd": ("rad/s", "m/s"),
    "qdd": ("rad/s²", "m/s²"),
    "tau": ("N m", "N"),
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


def command_unit(command: str, linear: bool) -> str:
    """Unit of a drive command of a revolute or prismatic joint: `command_unit("voltage", False)` → "V"."""
    return {"voltage": "V", "current": "A"}.get(command) or UNITS["tau"][linear]


def joint_units(arm: Model, quantity: str) -> list[str]:
    """The unit of a quantity for each joint: `joint_units(arm, "q")` → ["rad", "m", …]; another unit stands for itself."""
    if quantity == "u":
        return [command_unit(body.drive.command, body.kind == "prismatic") for body in arm.coordinates]
    if quantity not in UNITS:
        return [quantity] * arm.n
    return [UNITS[quantity][body.kind == "prismatic"] for body in arm.coordinates]


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

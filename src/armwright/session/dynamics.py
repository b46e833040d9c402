"""What is computed of one moment: the Inverse Arm, the Forward Arm, energy, pose and Jacobian."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import armwright as aw
from armwright.actuators import demanded_drive
from armwright.errors import SessionError
from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.results.tables import joint_columns, read_table
from armwright.session import motor_quantities
from armwright.session.listing import Line, Listing, Sheet, Shown, aligned, by_joint, significant
from armwright.spatial import roll_pitch_yaw

if TYPE_CHECKING:
    from armwright.session.session import Session


def inverse_arm(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`inverse-arm`, `inverse-arm FILE`: theta, omega, alpha → torque and voltage; of a table of sets where a file is named."""
    if given["file"] is not None:
        return session.emit(_inverse_of_sets(session, given["file"]))
    state = session.state
    torque = np.asarray(state.loaded.dyn.inverse_dynamics(state.q, state.qd, state.qdd))
    state = motor_quantities.with_torque(state, torque)
    _check_finite("inverse-arm", "theta, omega and alpha", torque, state.u)
    session.state = state
    arm = state.arm
    columns = [(name, joint_units(arm, q), v) for name, q, v in (
        ("theta", "q", state.q), ("omega", "qd", state.qd), ("alpha", "qdd", state.qdd),
        ("torque", "tau", motor_quantities.torque(state)),
    )]  # fmt: skip
    drives = {"voltage": motor_quantities.voltage(state), "current": motor_quantities.current(state)}
    columns += [(name, joint_units(arm, name), values) for name, values in drives.items() if not np.isnan(values).all()]
    return [by_joint("Inverse Arm", arm.names, columns), *_beyond(arm, columns)]


def _check_finite(command: str, what: str, *found: np.ndarray) -> None:
    """Refuses what would be kept as a variable and is no number.

    Raises:
        SessionError: names the command and what it was worked out from.
    """
    if not all(np.isfinite(values).all() for values in found):
        raise SessionError(f"{command}: the result is not finite; expected smaller {what}")


def _beyond(arm: Model, columns: list[tuple[str, list[str], np.ndarray]]) -> list[Shown]:
    """A note for every joint that would need more than its drive can give."""
    notes: list[Shown] = []
    for name, units, values in columns:
        if name not in ("torque", "voltage", "current"):
            continue
        for body, unit, value in zip(arm.coordinates, units, values, strict=True):
            most = getattr(body.limits, name)
            if abs(value) > most:
                told = f"{body.joint}: {name} {significant(value)} {unit} is beyond its limit of {significant(most)} {unit}"
                notes.append(Line(told, "note"))
    return notes


def _inverse_of_sets(session: Session, file: str) -> Listing:
    """Every row of a table with q_JOINT, qd_JOINT and qdd_JOINT; the columns are those of `armwright inverse-dynamics`."""
    state, arm = session.state, session.state.arm
    quantities = ("q", "qd", "qdd")
    data = read_table(file, dict.fromkeys(quantities, arm.names), {q: joint_units(arm, q) for q in quantities})
    tau = state.loaded.dyn.inverse_dynamics(data["q"], data["qd"], data["qdd"])
    drive = demanded_drive(arm, data["qd"].T, tau.T)
    parts = {"tau": tau, "voltage": drive.voltage.T, "current": drive.current.T}
    sheets, columns = [], {}
    for quantity, values in parts.items():
        if np.isnan(values).all():
            continue
        units = joint_units(arm, quantity)
        columns |= joint_columns(quantity, arm.names, units, values)
        name = {"tau": "torque"}.get(quantity, quantity)
        told = f"{name} of {len(values)} sets"
        sheets.append(by_row(told, "set", [str(k + 1) for k in range(len(values))], arm.names, units, values))
    return Listing(tuple(sheets), columns)


def by_row(title: str, key: str, keys: list[str], names: list[str], units: list[str], values: np.ndarray) -> Sheet:
    """A row a time or set, a column a joint; the unit stands in the title where all joints share it."""
    kinds = list(dict.fromkeys(units))
    heads = names if len(kinds) == 1 else [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
    told = f"{title} [{kinds[0]}]" if len(kinds) == 1 else title
    cells = [keys, *(aligned(column) for column in values.T)]
    return Sheet(told, (key, *heads), tuple(zip(*cells, strict=True)), words=0)


def forward_arm(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`forward-arm`: theta, omega, voltage → alpha."""
    state = session.state
    alpha = np.asarray(state.loaded.dyn.forward_arm(state.q, state.qd, state.u))
    _check_finite("forward-arm", "theta, omega and voltage", alpha)
    session.state = state = state.replace(qdd=alpha)
    arm = state.arm
    told = "voltage" if not np.isnan(motor_quantities.voltage(state)).any() else "torque"
    values = motor_quantities.voltage(state) if told == "voltage" else motor_quantities.torque(state)
    columns = [
        ("theta", joint_units(arm, "q"), state.q),
        ("omega", joint_units(arm, "qd"), state.qd),
        (told, joint_units(arm, "voltage" if told == "voltage" else "tau"), values),
        ("alpha", joint_units(arm, "qdd"), state.qdd),
    ]
    return [by_joint("Forward Arm", arm.names, columns)]


def energy(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`energy`: kinetic, potential, and their sum."""
    state = session.state
    kinetic, potential = (float(part) for part in aw.energy(state.arm, state.q, state.qd))
    rows = (("kinetic", kinetic), ("potential", potential), ("sum", kinetic + potential))
    return [Sheet("", ("energy", "[J]"), tuple((name, significant(value)) for name, value in rows))]


def pose(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`pose`, `pose FRAME`: where the hand, or another frame, is in the base."""
    state, frame = session.state, given["frame"]
    state.arm.frame(frame)
    placed = np.asarray(state.loaded.dyn.forward_kinematics(state.q, frame=frame))
    rotation = placed[:3, :3]
    angles = [significant(a) for a in np.degrees(roll_pitch_yaw(rotation))]
    rows = tuple(
        (axis, significant(placed[k, 3]), *(significant(r) for r in rotation[k]), angle)
        for k, (axis, angle) in enumerate(zip("xyz", angles, strict=True))
    )
    name = frame or state.arm.tip
    heads = ("axis", "position [m]", "x of frame", "y of frame", "z of frame", "roll pitch yaw [deg]")
    return [Sheet(f"{name} in the base", heads, rows)]


def jacobian(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`jacobian`, `jacobian FRAME`: speed and turning of the hand for a unit of each joint's speed."""
    state, frame = session.state, given["frame"]
    state.arm.frame(frame)
    matrix = np.asarray(state.loaded.dyn.jacobian(state.q, frame=frame))
    rows = ("v x [m/s]", "v y [m/s]", "v z [m/s]", "ω x [rad/s]", "ω y [rad/s]", "ω z [rad/s]")
    cells = tuple((row, *(significant(x) for x in values)) for row, values in zip(rows, matrix, strict=True))
    units = [f"{name} [{unit}]" for name, unit in zip(state.arm.names, joint_units(state.arm, "qd"), strict=True)]
    return [Sheet(f"Jacobian of {frame or state.arm.tip}, base axes, for each unit of", ("", *units), cells)]

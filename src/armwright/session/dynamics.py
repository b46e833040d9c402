"""Commands that compute one state: the Inverse Arm, the Forward Arm, energy, pose and Jacobian."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import armwright as aw
from armwright.actuators import demanded_drive
from armwright.errors import SessionError
from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.results.csv_tables import joint_columns, read_table
from armwright.session import motor_quantities
from armwright.session.listing import Listing, Output, Sheet, TextLine, by_joint, by_row, significant
from armwright.session.workspace import Workspace
from armwright.spatial import roll_pitch_yaw

if TYPE_CHECKING:
    from armwright.trajectory.rest import Torques


def inverse_arm(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`inverse-arm`, `inverse-arm FILE`: theta, omega, alpha → torque and voltage; with a file for every set of a table."""
    if arguments["file"] is not None:
        listing, notes = _inverse_of_sets(session, arguments["file"])
        return [*session.emit(listing), *notes]
    from armwright.trajectory.rest import torques  # with the kernels, which a prompt does not wait for

    state = session.state
    found = torques(state.arm, state.loaded.dyn, *(each[None] for each in (state.q, state.qd, state.qdd)))
    torque = found.tau[0]
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
    stands = [TextLine(text, "note") for text in found.notes(arm.names, joint_units(arm, "tau"), "")]
    return [by_joint("Inverse Arm", arm.names, columns), *_beyond(arm, columns, found), *stands]


def _check_finite(command: str, inputs: str, *results: np.ndarray) -> None:
    """Refuses results that would be stored as variables and are not finite."""
    if not all(np.isfinite(values).all() for values in results):
        raise SessionError("the result is not finite", place=command, expected=f"smaller {inputs}")


def _beyond(arm: Model, columns: list[tuple[str, list[str], np.ndarray]], found: Torques) -> list[Output]:
    """A note for every joint that needs more than the limits of its drive; one that stands needs the least of its band."""
    notes: list[Output] = []
    for name, units, values in columns:
        if name in ("torque", "voltage", "current"):
            part = np.divide(
                found.least[0], found.tau[0], out=np.ones(arm.n), where=found.held[0] & (found.tau[0] != 0.0)
            )
            values = values * part  # at rest voltage and current are proportional to the torque
            for body, unit, value in zip(arm.coordinates, units, values, strict=True):
                limit = getattr(body.limits, name)
                if abs(value) > limit:
                    text = f"{name} {significant(value)} {unit} is beyond its limit of {significant(limit)} {unit}"
                    notes.append(TextLine(f"{body.joint}: {text}", "note"))
    return notes


def _inverse_of_sets(session: Workspace, file: str) -> tuple[Listing, list[Output]]:
    """Every row of a table with q_JOINT, qd_JOINT and qdd_JOINT, and notes; columns are those of `armwright inverse-dynamics`."""
    from armwright.trajectory.rest import torques

    state, arm = session.state, session.state.arm
    quantities = ("q", "qd", "qdd")
    data = read_table(file, dict.fromkeys(quantities, arm.names), {q: joint_units(arm, q) for q in quantities})
    found = torques(arm, state.loaded.dyn, data["q"], data["qd"], data["qdd"])
    drive = demanded_drive(arm, found.qd.T, found.tau.T)
    parts = {"tau": found.tau, "voltage": drive.voltage.T, "current": drive.current.T}
    sheets, columns = [], {}
    for quantity, values in parts.items():
        if np.isnan(values).all():
            continue
        units = joint_units(arm, quantity)
        columns |= joint_columns(quantity, arm.names, units, values)
        name = {"tau": "torque"}.get(quantity, quantity)
        title = f"{name} of {len(values)} sets"
        sheets.append(by_row(title, "set", [str(k + 1) for k in range(len(values))], arm.names, units, values))
    notes: list[Output] = [TextLine(text, "note") for text in found.notes(arm.names, joint_units(arm, "tau"), "set {}")]
    return Listing(tuple(sheets), columns), notes


def forward_arm(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`forward-arm`: theta, omega, voltage → alpha."""
    state = session.state
    alpha = np.asarray(state.loaded.dyn.forward_arm(state.q, state.qd, state.u))
    _check_finite("forward-arm", "theta, omega and voltage", alpha)
    session.state = state = state.replace(qdd=alpha)
    arm = state.arm
    name, quantity, values = "voltage", "voltage", motor_quantities.voltage(state)
    if np.isnan(values).any():
        name, quantity, values = "torque", "tau", motor_quantities.torque(state)
    columns = [
        ("theta", joint_units(arm, "q"), state.q),
        ("omega", joint_units(arm, "qd"), state.qd),
        (name, joint_units(arm, quantity), values),
        ("alpha", joint_units(arm, "qdd"), state.qdd),
    ]
    return [by_joint("Forward Arm", arm.names, columns)]


def energy(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`energy`: kinetic, potential, and their sum."""
    state = session.state
    kinetic, potential = (float(part) for part in aw.energy(state.arm, state.q, state.qd))
    rows = (("kinetic", kinetic), ("potential", potential), ("sum", kinetic + potential))
    return [Sheet("", ("energy", "[J]"), tuple((name, significant(value)) for name, value in rows))]


def pose(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`pose`, `pose FRAME`: position and orientation of the hand, or of another frame, in the base."""
    state, frame = session.state, arguments["frame"]
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


def jacobian(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`jacobian`, `jacobian FRAME`: velocity and turning of the hand for a unit of each joint's velocity."""
    state, frame = session.state, arguments["frame"]
    state.arm.frame(frame)
    matrix = np.asarray(state.loaded.dyn.jacobian(state.q, frame=frame))
    rows = ("v x [m/s]", "v y [m/s]", "v z [m/s]", "ω x [rad/s]", "ω y [rad/s]", "ω z [rad/s]")
    cells = tuple((row, *(significant(x) for x in values)) for row, values in zip(rows, matrix, strict=True))
    units = [f"{name} [{unit}]" for name, unit in zip(state.arm.names, joint_units(state.arm, "qd"), strict=True)]
    return [Sheet(f"Jacobian of {frame or state.arm.tip}, base axes, for each unit of", ("", *units), cells)]

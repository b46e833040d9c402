"""`armwright inverse-dynamics` and `forward-dynamics`: torques and voltages, or accelerations, for tables of states."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import armwright as aw
from armwright.cli.arguments import Out, Robot, Table
from armwright.cli.outcome import check_file, say_each
from armwright.cli.tables import show_columns
from armwright.progress import progress

if TYPE_CHECKING:
    import numpy as np

    from armwright.model import Model


def inverse_dynamics(robot: Robot, table: Table, output: Out = None) -> None:
    """Inverse dynamics of a table: torques and voltages for the motion in each row.

    The table has the columns q_JOINT, qd_JOINT and qdd_JOINT in rad, rad/s and rad/s² (m for sliding joints), in any order;
    or no header row and the columns in just that order. The result has tau_JOINT, the motor's torque referred to the
    joint, and voltage_JOINT where the robot's file gives the motors' constants; where it does not do so for every joint,
    current_JOINT too, or instead. What is not known of a joint is nan. A joint that stands (its speed is 0, or less than 1e-9 of
    the largest) has the torque without dry friction; a note says which band of torques holds it.

    \b
    Examples:
      armwright inverse-dynamics puma560 motions.csv -o torques.csv
      armwright inverse-dynamics my-arm.toml motions.csv | head
    """
    import numpy as np

    from armwright.actuators import demanded_drive
    from armwright.model.joint_signals import joint_units
    from armwright.results.csv_tables import joint_columns
    from armwright.trajectory.rest import torques

    arm = _arm(robot, table, output)
    with progress("inverse dynamics"):
        q, qd, qdd = _sets(arm, table, ("q", "qd", "qdd"))
        units = joint_units(arm, "tau")
        found = torques(arm, aw.compile(arm), q, qd, qdd)
        columns = joint_columns("tau", arm.names, units, found.tau)
        drive = demanded_drive(arm, found.qd.T, found.tau.T)
        for quantity, values in (("voltage", drive.voltage.T), ("current", drive.current.T)):
            if not np.isnan(values).all():
                columns |= joint_columns(quantity, arm.names, joint_units(arm, quantity), values)
            if not np.isnan(values).any():
                break  # with the voltages of all motors, currents add nothing
        show_columns(output, columns)
        say_each("note: ", found.notes(arm.names, units), err=True)


def forward_dynamics(robot: Robot, table: Table, output: Out = None) -> None:
    """Forward dynamics of a table: accelerations for the state and drive commands in each row.

    The table has the columns q_JOINT, qd_JOINT in rad and rad/s (m for sliding joints) and u_JOINT, the command in the
    drive's own unit (V, A, or N m), in any order; or no header row and the columns in just that order. The result has
    qdd_JOINT. No limit of a drive is applied.

    \b
    Examples:
      armwright forward-dynamics cmu-dd states.csv -o accelerations.csv
      armwright forward-dynamics my-arm.toml states.csv | head
    """
    from armwright.model.joint_signals import joint_units
    from armwright.results.csv_tables import joint_columns

    arm = _arm(robot, table, output)
    with progress("forward dynamics"):
        q, qd, u = _sets(arm, table, ("q", "qd", "u"))
        qdd = aw.compile(arm).forward_arm(q, qd, u)
        show_columns(output, joint_columns("qdd", arm.names, joint_units(arm, "qdd"), qdd))


def _arm(robot: str, table: Path, output: Path | None) -> Model:
    """The arm, once its results can be written."""
    arm = aw.load(robot)
    check_file(output, read=(table, robot))
    return arm


def _sets(arm: Model, table: Path, quantities: tuple[str, ...]) -> list[np.ndarray]:
    """The quantities of a table, (sets, n) each."""
    from armwright.model.joint_signals import joint_units
    from armwright.results.csv_tables import read_table

    names = dict.fromkeys(quantities, arm.names)
    return list(read_table(table, names, {quantity: joint_units(arm, quantity) for quantity in quantities}).values())

"""`armwright inverse-dynamics`: motions in, torques and voltages out."""

from __future__ import annotations

import sys

from armwright.cli.arguments import Out, Robot, Table


def inverse_dynamics(robot: Robot, table: Table, output: Out = None) -> None:
    """Torques and voltages that give the motions of a table: the inverse arm, one set of data a row.

    The table has the columns q_JOINT, qd_JOINT and qdd_JOINT in rad, rad/s and rad/s² (m for sliding joints), in any order;
    or no header row and the columns in just that order. The result has tau_JOINT, the motor's torque referred to the
    joint, and voltage_JOINT where the robot's file gives the motors' constants; where it does not do so for every joint,
    current_JOINT too, or instead. What is not known of a joint is nan.

    \b
    Examples:
      armwright inverse-dynamics puma560 motions.csv -o torques.csv
      armwright inverse-dynamics my-arm.toml motions.csv | head
    """
    import numpy as np

    import armwright as aw
    from armwright.actuators import demanded_drive
    from armwright.cli.progress import progress
    from armwright.model.joint_signals import joint_units
    from armwright.output import check_destination
    from armwright.results.tables import joint_columns, read_table, write_table

    arm = aw.load(robot)
    if output is not None:
        check_destination(output)
    quantities = ("q", "qd", "qdd")
    with progress("inverse dynamics"):
        data = read_table(table, dict.fromkeys(quantities, arm.names), {q: joint_units(arm, q) for q in quantities})
        dyn = aw.compile(arm)
        tau = dyn.inverse_dynamics(data["q"], data["qd"], data["qdd"])
        columns = joint_columns("tau", arm.names, joint_units(arm, "tau"), tau)
        drive = demanded_drive(arm, data["qd"].T, tau.T)
        for quantity, values in (("voltage", drive.voltage.T), ("current", drive.current.T)):
            if not np.isnan(values).all():
                columns |= joint_columns(quantity, arm.names, joint_units(arm, quantity), values)
            if not np.isnan(values).any():
                break  # voltages of every motor say it all
        write_table(output, columns, sys.stdout)

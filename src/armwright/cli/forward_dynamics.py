"""`armwright forward-dynamics`: states and drive commands in, accelerations out."""

from __future__ import annotations

import sys

from armwright.cli.arguments import Out, Robot, Table


def forward_dynamics(robot: Robot, table: Table, output: Out = None) -> None:
    """Accelerations that drive commands give in the states of a table: the forward arm, one set of data a row.

    The table has the columns q_JOINT, qd_JOINT in rad and rad/s (m for sliding joints) and u_JOINT, the command in the
    drive's own unit (V, A, or N m), in any order; or no header row and the columns in just that order. The result has
    qdd_JOINT. No limit of a drive is applied.

    \b
    Examples:
      armwright forward-dynamics cmu-dd states.csv -o accelerations.csv
      armwright forward-dynamics my-arm.toml states.csv | head
    """
    import armwright as aw
    from armwright.cli.progress import progress
    from armwright.model.joint_signals import joint_units
    from armwright.output import check_destination
    from armwright.results.tables import joint_columns, read_table, write_table

    arm = aw.load(robot)
    if output is not None:
        check_destination(output)
    quantities = ("q", "qd", "u")
    with progress("forward dynamics"):
        data = read_table(table, dict.fromkeys(quantities, arm.names), {q: joint_units(arm, q) for q in quantities})
        qdd = aw.compile(arm).forward_arm(data["q"], data["qd"], data["u"])
        write_table(output, joint_columns("qdd", arm.names, joint_units(arm, "qdd"), qdd), sys.stdout)

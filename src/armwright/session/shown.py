"""Variables as they are shown: one, or all of them side by side."""

from __future__ import annotations

import numpy as np

from armwright.session.listing import Line, Sheet, Shown, by_joint, significant
from armwright.session.state import State
from armwright.session.variables import TABLE, Variable, known

REVOLUTE = {"rad": "deg", "rad/s": "deg/s", "rad/s²": "deg/s²"}


def shown_variable(state: State, variable: Variable, joint: int | None = None) -> list[Shown]:
    """A variable with its units; angles in degrees beside them.

    Args:
        state: the session's.   variable: of the table.   joint: the one joint to show; None: all.
    Raises:
        ArmwrightError: it is not available on this arm.
    """
    value = variable.get(state)
    if variable.quantity is None:
        shown: list[Shown] = [Line(f"{variable.name} = {significant(value)} {variable.unit}")]
        if variable.name == "gravity" and np.any(state.arm.gravity[:2]):
            told = ", ".join(significant(float(g)) for g in state.arm.gravity)
            shown.append(Line(f"this arm's gravity has other components too: ({told}) m/s² in base axes", "note"))
        return shown
    units, names = variable.units(state.arm), state.arm.names
    if joint is not None:
        own, degrees = units[joint], REVOLUTE.get(units[joint])
        more = f" = {significant(np.degrees(value[joint]))} {degrees}" if degrees else ""
        return [Line(f"{variable.name}[{names[joint]}] = {significant(value[joint])} {own}{more}")]
    columns = [(variable.name, units, value)]
    if all(unit in REVOLUTE for unit in units):
        columns.append(("", [REVOLUTE[unit] for unit in units], np.degrees(value)))
    shown = [by_joint("", names, columns)]
    if np.isnan(value).any():
        lacking = ", ".join(name for name, v in zip(names, value, strict=True) if np.isnan(v))
        shown.append(Line(f"— : the record gives no motor constants for {lacking}", "note"))
    return shown


def shown_state(state: State) -> list[Shown]:
    """All variables: arm vectors as columns, single numbers below them."""
    vectors = [variable for variable in TABLE if variable.quantity is not None]
    columns = [(variable.name, variable.units(state.arm), known(state, variable)) for variable in vectors]
    columns = [column for column in columns if not np.isnan(column[2]).all()]
    sheet = by_joint(f"{state.arm.name}", state.arm.names, columns)
    single = [variable for variable in TABLE if variable.quantity is None]
    rows = tuple((v.name, significant(v.get(state)), v.unit) for v in single)
    return [sheet, Sheet("", ("variable", "value", "unit"), rows)]

"""Variables as they are shown: one, or all of them side by side."""

from __future__ import annotations

import numpy as np

from armwright.session.listing import Line, Sheet, Shown, by_joint, significant
from armwright.session.state import Payload, State
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
        return [*shown, *_sideways(state)] if variable.name == "gravity" else shown
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
    """All variables: arm vectors as columns, single numbers below them, and what the hand holds."""
    vectors = [variable for variable in TABLE if variable.quantity is not None]
    columns = [(variable.name, variable.units(state.arm), known(state, variable)) for variable in vectors]
    columns = [column for column in columns if not np.isnan(column[2]).all()]
    sheet = by_joint(f"{state.arm.name}", state.arm.names, columns)
    single = [variable for variable in TABLE if variable.quantity is None]
    rows = tuple((v.name, significant(v.get(state)), v.unit) for v in single)
    shown: list[Shown] = [sheet, Sheet("", ("variable", "value", "unit"), rows), *_sideways(state)]
    if state.loaded.payload is not None:
        shown.append(Line(f"payload: {shown_payload(state, state.loaded.payload)}"))
    return shown


def shown_payload(state: State, payload: Payload) -> str:
    """What the hand holds, in words."""
    where = f"({', '.join(significant(x) for x in payload.com)}) m in the axes of {payload.frame or state.arm.tip}"
    moments = ", ".join(significant(x) for x in payload.inertia)
    what = f"principal moments ({moments}) kg m²" if any(payload.inertia) else "a point mass"
    return f"{significant(payload.mass)} kg at {where}, {what}"


def _sideways(state: State) -> list[Shown]:
    """A note where gravity is more than its z component, which is all that the variable shows."""
    if not np.any(state.arm.gravity[:2]):
        return []
    told = ", ".join(significant(float(g)) for g in state.arm.gravity)
    return [Line(f"this arm's gravity has other components too: ({told}) m/s² in base axes", "note")]

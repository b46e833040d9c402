"""Variables of the session: one table for parsing, output, help, completion, tests and docs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright.errors import ArmwrightError, SessionError
from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.session import motor_quantities
from armwright.session.arguments import same, unknown
from armwright.session.listing import Output, Sheet, TextLine, by_joint, significant
from armwright.session.state import HandLoad, SessionState
from armwright.session.values import number, vector
from armwright.session.workspace import Workspace

DEGREES = {"rad": "deg", "rad/s": "deg/s", "rad/s²": "deg/s²"}  # unit of a turning joint → in degrees


@dataclass(frozen=True)
class SessionVariable:
    """A variable of the session.

    Attributes:
        name, meaning: as `help` has them.   quantity: its name for `joint_units` if it has a value for every joint; else None.
        unit: of a single number.   equation, source: of its relation to others.
        get: its value, (n,) or a number.   set: the state with another one.
        report: True if the report's `sim` has it.
    """

    name: str
    meaning: str
    quantity: str | None
    unit: str
    get: Callable[[SessionState], Any]
    set: Callable[[SessionState, Any], SessionState]
    equation: str = ""
    source: str = ""
    report: bool = True

    def units(self, arm: Model) -> list[str]:
        """The unit; for a vector one for each joint."""
        return [self.unit] if self.quantity is None else joint_units(arm, self.quantity)

    def check_index(self, index: str) -> None:
        """Refuses an index of a single number.

        Raises:
            SessionError: it is one.
        """
        if self.quantity is None:
            raise SessionError("one number", place=f"{self.name}[{index}]", expected=f"{self.name} without [{index}]")


def _field(field: str) -> tuple[Callable[[SessionState], Any], Callable[[SessionState, Any], SessionState]]:
    return lambda state: getattr(state, field), lambda state, value: state.replace(**{field: value})


def _gravity(state: SessionState) -> float:
    """The report's g: v̇₀ = [0 0 g] is the opposite of free fall."""
    return 0.0 - float(state.arm.gravity[2])  # never -0.0


def _with_gravity(state: SessionState, value: float) -> SessionState:
    return state.replace(loaded=replace(state.loaded, gravity=0.0 - value))


def _time(name: str, field: str) -> Callable[[SessionState, float], SessionState]:
    def change(state: SessionState, value: float) -> SessionState:
        if value <= 0.0:
            raise SessionError(place=name, value=value, expected="a time above 0 s")
        return state.replace(**{field: value})

    return change


def _dac(state: SessionState) -> np.ndarray:
    return motor_quantities.voltage(state) if state.controller is None else state.dac


def _with_dac(state: SessionState, values: np.ndarray) -> SessionState:
    return motor_quantities.with_voltage(state, values) if state.controller is None else state.replace(dac=values)


DRIVE = "V = R τ / (n Kt) + n Ke θ̇,  τ = n Kt (V − n Ke θ̇) / R"
SAMPLED = "V(t) = DACOut(k T),  k T ≤ t < (k + 1) T,  T = DACSampTimePeriod; with a controller θ_ref = scale · DACOut"
DAC_SOURCE = "CMU report, the sim program; sampled loops [AstromHagglund2006]"
TABLE = (
    SessionVariable(
        "gravity",
        "gravitational acceleration g: above 0 where z of the base points up, below 0 where it points down",
        None, "m/s²", _gravity, _with_gravity,
        "v̇₀ = [0 0 g]: it enters as the base's acceleration", "CMU report, Inverse Arm [LuhWalkerPaul1980]",
    ),
    SessionVariable(
        "DACSampTimePeriod",
        "time between changes of DACOut, and the sampling time of the controller",
        None, "s", lambda state: state.dac_period, _time("DACSampTimePeriod", "dac_period"), SAMPLED, DAC_SOURCE,
    ),
    SessionVariable(
        "TimeStep", "step of the integration; the report's is 1 ms",
        None, "s", lambda state: state.step, _time("TimeStep", "step"),
        "Kutta's third-order rule", "[Kutta1901]", False,
    ),
    SessionVariable(
        "theta", "joint angles, or positions of sliding joints", "q", "", *_field("q"),
        "dθ/dt = θ̇", "CMU report, Integration",
    ),
    SessionVariable("omega", "joint velocities", "qd", "", *_field("qd"), "θ̇ = dθ/dt,  dθ̇/dt = θ̈", "CMU report, Integration"),
    SessionVariable(
        "alpha", "joint accelerations: what the Inverse Arm takes, what the Forward Arm gives", "qdd", "", *_field("qdd"),
        "M(θ) θ̈ = τ − C(θ, θ̇) θ̇ − g(θ) − friction", "CMU report, eqs (13)-(15)",
    ),
    SessionVariable(
        "torque", "motor torques referred to the joints; tied to voltage at the present omega",
        "tau", "", motor_quantities.torque, motor_quantities.with_torque, DRIVE, "CMU report, eqs (11) and (12)",
    ),
    SessionVariable(
        "voltage", "motor voltages; stored, so that the torque changes with omega",
        "voltage", "", motor_quantities.voltage, motor_quantities.with_voltage, DRIVE, "CMU report, eqs (11) and (12)",
    ),
    SessionVariable(
        "current", "motor currents; tied to torque", "current", "", motor_quantities.current, motor_quantities.with_current,
        "τ = n Kt i", "CMU report, eq. (12)", False,
    ),
    SessionVariable(
        "DACOut",
        "DAC output voltage, held for DACSampTimePeriod: the reference input of the controller, without one the motor voltage",
        "voltage", "", _dac, _with_dac, SAMPLED, DAC_SOURCE,
    ),
)  # fmt: skip


VARIABLES = {same(variable.name): variable for variable in TABLE}


def joint_number(arm: Model, place: str, index: str) -> int:
    """Index of a joint given by its number, from 1, or by its name.

    Raises:
        SessionError: no such joint.
    """
    by_name = {**{same(name): k for k, name in enumerate(arm.names)}, **{name: k for k, name in enumerate(arm.names)}}
    k = by_name.get(index, by_name.get(same(index)))
    if k is not None:
        return k
    try:
        k = int(index) - 1
    except ValueError:
        raise SessionError("no such joint", place=f"{place} joint", value=index, choices=arm.names) from None
    if not 0 <= k < arm.n:
        raise SessionError(place=f"{place} joint", value=k + 1, expected=f"1 to {arm.n}: {', '.join(arm.names)}")
    return k


def assigned(state: SessionState, name: str, index: str | None, text: str) -> SessionState:
    """The state after `name = text`, or `name[index] = text`.

    Raises:
        SessionError: what is wrong with the value.   ModelError: a motor without the constants that are needed.
    """
    variable = VARIABLES[same(name)]
    look = lookup(state)
    if index is not None:
        variable.check_index(index)
    if variable.quantity is None:
        after = variable.set(state, number(variable.name, text, variable.unit, look))
        _ = after.arm  # refuses now a gravity that no arm can have, not when something is next computed
        return after
    units = variable.units(state.arm)
    if index is None:
        return _finite(variable, text, variable.set(state, vector(variable.name, text, state.arm.names, units, look)))
    k = joint_number(state.arm, variable.name, index)
    values = np.array(variable.get(state), dtype=float)
    values[k] = number(f"{variable.name}[{index}]", text, units[k], look)
    return _finite(variable, text, variable.set(state, values))


def _finite(variable: SessionVariable, text: str, state: SessionState) -> SessionState:
    """The state, if its commands and the torques, voltages and currents that follow from them are finite."""
    commands = np.where(np.isfinite(state.u), 0.0, np.inf)
    quantities = {name: value_or_nan(state, VARIABLES[name]) for name in ("torque", "voltage", "current")}
    for k, body in enumerate(state.arm.coordinates):
        for name, values in ((body.drive.command, commands), *quantities.items()):
            if np.isinf(values[k]):
                what = f"the {name} of joint {body.joint!r} is not finite"
                raise SessionError(what, place=variable.name, value=text.strip(), expected="smaller numbers")
    return state


def remarks(after: SessionState, variable: SessionVariable, text: str) -> list[Output]:
    """Notes about a value that was set: DACOut that sets voltage, angles of turns, gravity against the file's.

    Args:
        after: the state with it.   variable: what was set.   text: the value as it was typed.
    """
    if variable.name == "DACOut" and after.controller is None:
        volts = " ".join(significant(value) for value in motor_quantities.voltage(after))
        return [TextLine(f"no controller reads DACOut: it is the motor voltage, now voltage = {volts} V", "note")]
    if variable.name == "theta" and "deg" not in text:
        far = [(name, q) for name, unit, q in zip(after.arm.names, variable.units(after.arm), after.q, strict=True)
               if unit == "rad" and abs(q) > 2.0 * np.pi]  # fmt: skip
        turns = (f"{name} = {significant(q)} rad, {abs(q) / (2.0 * np.pi):.1f} turns" for name, q in far[:1])
        return [
            TextLine(f"radians? {each}; degrees are written {significant(far[0][1])} deg", "note") for each in turns
        ]
    given, own = _gravity(after), 0.0 - float(after.loaded.base.gravity[2])
    if variable.name == "gravity" and given * own < 0.0:
        points = "down" if own < 0.0 else "up"
        what = f"in this arm's file gravity is {significant(own)} m/s², as z of its base points {points}"
        return [TextLine(f"{what}: with {significant(given)} m/s² the arm falls upward", "note")]
    return []


def lookup(state: SessionState) -> Callable[[str, str | None], Any]:
    """The session's variables, as formulas look them up: (name, index or None) → value."""

    def value(name: str, index: str | None) -> Any:
        variable = VARIABLES.get(same(name))
        if variable is None:
            return None
        if index is None:
            return variable.get(state)
        variable.check_index(index)
        return variable.get(state)[joint_number(state.arm, variable.name, index)]

    return value


def value_or_nan(state: SessionState, variable: SessionVariable) -> Any:
    """A variable's value; NaN where the robot file lacks the constants that it follows from."""
    try:
        return variable.get(state)
    except ArmwrightError:
        return np.full(state.arm.n, np.nan)


def show(session: Workspace, values: dict[str, Any]) -> list[Output]:
    """`show`, `show NAME`: all variables, or one."""
    name = values["name"]
    if name is None:
        return state_output(session.state)
    if same(name) not in VARIABLES:
        raise unknown("no such variable", name, [variable.name for variable in TABLE], "show name")
    return variable_output(session.state, VARIABLES[same(name)])


def variable_output(state: SessionState, variable: SessionVariable, joint: int | None = None) -> list[Output]:
    """A variable with its units; angles also in degrees.

    Args:
        state: the session's.   variable: of the table.   joint: the one joint to show; None: all.
    Raises:
        ArmwrightError: it is not available on this arm.
    """
    value = variable.get(state)
    if variable.quantity is None:
        line = TextLine(f"{variable.name} = {significant(value)} {variable.unit}")
        return [line, *_gravity_note(state)] if variable.name == "gravity" else [line]
    units, names = variable.units(state.arm), state.arm.names
    if joint is not None:
        unit, degrees = units[joint], DEGREES.get(units[joint])
        in_degrees = f" = {significant(np.degrees(value[joint]))} {degrees}" if degrees else ""
        return [TextLine(f"{variable.name}[{names[joint]}] = {significant(value[joint])} {unit}{in_degrees}")]
    columns = [(variable.name, units, value)]
    if all(unit in DEGREES for unit in units):
        columns.append(("", [DEGREES[unit] for unit in units], np.degrees(value)))
    output: list[Output] = [by_joint("", names, columns)]
    if np.isnan(value).any():
        lacking = ", ".join(name for name, v in zip(names, value, strict=True) if np.isnan(v))
        output.append(TextLine(f"— : the robot file has no motor constants for {lacking}", "note"))
    return output


def state_output(state: SessionState) -> list[Output]:
    """All variables: vectors as columns, single numbers below them, and the payload."""
    vectors = [variable for variable in TABLE if variable.quantity is not None]
    columns = [(variable.name, variable.units(state.arm), value_or_nan(state, variable)) for variable in vectors]
    columns = [column for column in columns if not np.isnan(column[2]).all()]
    single = [variable for variable in TABLE if variable.quantity is None]
    rows = tuple((v.name, significant(v.get(state)), v.unit) for v in single)
    sheet = by_joint(f"{state.arm.name}", state.arm.names, columns)
    output: list[Output] = [sheet, Sheet("", ("variable", "value", "unit"), rows), *_gravity_note(state)]
    if state.loaded.payload is not None:
        output.append(TextLine(payload_text(state, state.loaded.payload)))
    return output


def payload_text(state: SessionState, payload: HandLoad) -> str:
    """Mass, place and moments of a payload as a line."""
    where = f"({', '.join(significant(x) for x in payload.com)}) m in the axes of {payload.frame or state.arm.tip}"
    moments = ", ".join(significant(x) for x in payload.inertia)
    what = f"principal moments ({moments}) kg m²" if any(payload.inertia) else "a point mass"
    return f"payload: {significant(payload.mass)} kg at {where}, {what}"


def _gravity_note(state: SessionState) -> list[Output]:
    """A note where gravity has components besides z, the only one that the variable shows."""
    if not np.any(state.arm.gravity[:2]):
        return []
    vector = ", ".join(significant(float(g)) for g in state.arm.gravity)
    return [TextLine(f"this arm's gravity has other components too: ({vector}) m/s² in base axes", "note")]

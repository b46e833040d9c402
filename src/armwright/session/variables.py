"""The table of variables, from which parsing, showing, help, completion, tests and docs are made."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any

import numpy as np

from armwright.errors import ArmwrightError, SessionError, nearest
from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.session import motor_quantities
from armwright.session.state import State
from armwright.session.values import number, vector


@dataclass(frozen=True)
class Variable:
    """A variable of the session.

    Attributes:
        name, meaning: as `help` has them.   quantity: what joint_units knows it as, where it is an arm vector; else None.
        unit: of a single number.   equation, source: what ties it to others, and where that stands.
        get: its value, (n,) or a number.   set: the state with another one.
        report: whether the report's `sim` has it.
    """

    name: str
    meaning: str
    quantity: str | None
    unit: str
    get: Callable[[State], Any]
    set: Callable[[State, Any], State]
    equation: str = ""
    source: str = ""
    report: bool = True

    def units(self, arm: Model) -> list[str]:
        """Its unit, one a joint where it is an arm vector."""
        return [self.unit] if self.quantity is None else joint_units(arm, self.quantity)


def _plain(field: str) -> tuple[Callable[[State], Any], Callable[[State, Any], State]]:
    return lambda state: getattr(state, field), lambda state, value: state.replace(**{field: value})


def _gravity(state: State, value: float) -> State:
    return state.replace(loaded=replace(state.loaded, gravity=value))


def _time(name: str, field: str) -> Callable[[State, float], State]:
    def change(state: State, value: float) -> State:
        if value <= 0.0:
            raise SessionError(f"{name} = {value:g}: expected a time above 0 s")
        return state.replace(**{field: value})

    return change


def _dac(state: State) -> np.ndarray:
    return motor_quantities.voltage(state) if state.wiring is None else state.dac


def _with_dac(state: State, values: np.ndarray) -> State:
    return motor_quantities.with_voltage(state, values) if state.wiring is None else state.replace(dac=values)


TIED = "V = R τ / (n Kt) + n Ke θ̇,  τ = n Kt (V − n Ke θ̇) / R"
HELD = "V(t) = DACOut(k T),  k T ≤ t < (k + 1) T,  T = DACSampTimePeriod; with a controller θ_ref = scale · DACOut"
DAC_SOURCE = "CMU report, the sim program; sampled loops [AstromHagglund2006]"
TABLE = (
    Variable(
        "gravity",
        "gravitational acceleration along z of the base, the z component of arm.gravity",
        None, "m/s²", lambda state: float(state.arm.gravity[2]), _gravity,
        "v̇₀ = −gravity: it enters as the base's acceleration", "CMU report, Inverse Arm [LuhWalkerPaul1980]",
    ),
    Variable(
        "DACSampTimePeriod",
        "time between changes of DACOut, and the sampling time of the controller",
        None, "s", lambda state: state.dac_period, _time("DACSampTimePeriod", "dac_period"), HELD, DAC_SOURCE,
    ),
    Variable(
        "TimeStep", "step of the integration; the report's is 1 ms",
        None, "s", lambda state: state.step, _time("TimeStep", "step"),
        "Kutta's third-order rule", "[Kutta1901]", False,
    ),
    Variable(
        "theta", "joint angles, or positions of sliding joints", "q", "", *_plain("q"),
        "dθ/dt = θ̇", "CMU report, Integration",
    ),
    Variable("omega", "joint velocities", "qd", "", *_plain("qd"), "θ̇ = dθ/dt,  dθ̇/dt = θ̈", "CMU report, Integration"),
    Variable(
        "alpha", "joint accelerations: what the Inverse Arm takes, what the Forward Arm gives", "qdd", "", *_plain("qdd"),
        "M(θ) θ̈ = τ − C(θ, θ̇) θ̇ − g(θ) − friction", "CMU report, eqs (13)-(15)",
    ),
    Variable(
        "torque", "motor torques referred to the joints; tied to voltage at the present omega",
        "tau", "", motor_quantities.torque, motor_quantities.with_torque, TIED, "CMU report, eqs (11) and (12)",
    ),
    Variable(
        "voltage", "motor voltages; stored, so that the torque changes with omega",
        "voltage", "", motor_quantities.voltage, motor_quantities.with_voltage, TIED, "CMU report, eqs (11) and (12)",
    ),
    Variable(
        "current", "motor currents; tied to torque", "current", "", motor_quantities.current, motor_quantities.with_current,
        "τ = n Kt i", "CMU report, eq. (12)", False,
    ),
    Variable(
        "DACOut",
        "DAC output voltage, held for DACSampTimePeriod: the reference input of the controller, without one the motor voltage",
        "voltage", "", _dac, _with_dac, HELD, DAC_SOURCE,
    ),
)  # fmt: skip


def same(name: str) -> str:
    """A name as it is compared: `DAC-Out`, `dac_out` and `DACOut` are one."""
    return name.replace("-", "").replace("_", "").lower()


VARIABLES = {same(variable.name): variable for variable in TABLE}


def near(name: str, known: Iterable[str]) -> str:
    """The end of an error sentence: names that begin so, else the nearest ones, however they are spelt."""
    by_same = {same(own): own for own in known}
    close = [own for own in by_same if own.startswith(same(name))] or get_close_matches(same(name), by_same, 3, 0.5)
    if not close or not same(name):
        return "help lists all there are"
    return f"did you mean {' or '.join(by_same[own] for own in close)}?"


def joint_number(arm: Model, what: str, index: str) -> int:
    """The place of a joint given by its number, from 1, or by its name.

    Raises:
        SessionError: no such joint.
    """
    if index in arm.names:
        return arm.names.index(index)
    try:
        k = int(index)
    except ValueError:
        by_same = {same(name): j for j, name in enumerate(arm.names)}
        if same(index) in by_same:
            return by_same[same(index)]
        raise SessionError(f"{what}[{index}]: no joint {index!r}; {nearest(index, arm.names)}") from None
    if not 1 <= k <= arm.n:
        raise SessionError(f"{what}[{index}]: joints count from 1 to {arm.n}: {', '.join(arm.names)}")
    return k - 1


def assigned(state: State, name: str, index: str | None, text: str) -> State:
    """The state after `name = text`, or `name[index] = text`.

    Raises:
        SessionError: what is wrong with the value.   ModelError: a motor without the constants that are needed.
    """
    variable = VARIABLES[same(name)]
    look = lookup(state)
    if variable.quantity is None:
        if index is not None:
            raise SessionError(f"{variable.name} is one number; expected {variable.name} = …, without [{index}]")
        return _checked(variable.set(state, number(variable.name, text, variable.unit, look)))
    units = variable.units(state.arm)
    if index is None:
        return _finite(variable, text, variable.set(state, vector(variable.name, text, state.arm.names, units, look)))
    k = joint_number(state.arm, variable.name, index)
    values = np.array(variable.get(state), dtype=float)
    values[k] = number(f"{variable.name}[{index}]", text, units[k], look)
    return _finite(variable, text, variable.set(state, values))


def _finite(variable: Variable, text: str, state: State) -> State:
    """The state, if its drives can be told what it says, and if the torque, voltage and current that go with it are finite."""
    drives = np.where(np.isfinite(state.u), 0.0, np.inf)
    tied_ones = {name: known(state, VARIABLES[name]) for name in ("torque", "voltage", "current")}  # NaN: not known
    for k, body in enumerate(state.arm.coordinates):
        for name, values in ((body.drive.command, drives), *tied_ones.items()):
            if np.isinf(values[k]):
                raise SessionError(
                    f"{variable.name} = {text.strip()}: the {name} of joint {body.joint!r} is not finite; "
                    "expected smaller numbers"
                )
    return state


def _checked(state: State) -> State:
    """The state, if an arm can be made of it: found now, and not when something is next computed."""
    _ = state.arm
    return state


def lookup(state: State) -> Callable[[str, str | None], Any]:
    """What formulas see of the session's variables."""

    def value(name: str, index: str | None) -> Any:
        variable = VARIABLES.get(same(name))
        if variable is None:
            return None
        found = variable.get(state)
        if index is None:
            return found
        if variable.quantity is None:
            raise SessionError(f"{variable.name} is one number; expected {variable.name}, without [{index}]")
        return found[joint_number(state.arm, variable.name, index)]

    return value


def known(state: State, variable: Variable) -> Any:
    """A variable's value; NaN where the record of the arm has not the constants to know it."""
    try:
        return variable.get(state)
    except ArmwrightError:
        return np.full(state.arm.n, np.nan)

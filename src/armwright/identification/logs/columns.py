"""Columns of files as signals of joints: their layout, joints and units, and their values in SI units on the joint side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import LogError, Problem, check_known
from armwright.identification.logs.clocks import Clock
from armwright.identification.logs.log_file import LogTable, SignalTable
from armwright.identification.logs.measured_table import MeasuredTable
from armwright.identification.logs.units import COUNTS, OF_SIGNAL, QUANTITIES, SHARES, ZERO, plain_unit
from armwright.model import Model
from armwright.signals import Layout, Signal

if TYPE_CHECKING:
    from armwright.identification.logs.log import Log
    from armwright.model.tree import Body

SAME_GEAR = 0.01  # of a ratio, by which a catalogue rounds it


def layout_of(
    table: LogTable, joints: tuple[str, ...], arm: Model | None, tables: Mapping[str, MeasuredTable]
) -> Layout:
    """The signals of a log with their units.

    Raises:
        LogError: a joint twice or none of the log's, a unit that is missing, contradicts the header, or is not the joint's; all
            such mistakes together.
    """
    kinds = {} if arm is None else {body.joint: body.kind for body in arm.coordinates}
    sliding: dict[int, bool] = {joints.index(name): kind.units.linear for name, kind in kinds.items() if name in joints}
    found: dict[str, list[int]] = {}
    problems: list[Problem] = []
    clocks = {"": (table.time, None if table.time.column is None else table.only(table.time.file))}
    clocks |= {f"files.{key}": (each.time, key) for key, each in table.files.items() if each.time is not None}
    for place, (time, key) in clocks.items():
        try:
            Clock(time, None if key is None else tables[key])
        except LogError as error:
            problems += error.within(place).problems
    for k, signal in enumerate(table.signals):
        try:
            _place_columns(f"signals[{k}]", signal, joints, tables[table.only(signal.file)], found, sliding)
        except LogError as error:
            problems += error.problems
    if problems:
        raise LogError.of(*problems)
    signals = []
    for name, places in found.items():
        kind = OF_SIGNAL[name]
        order = tuple(sorted(places))
        units = tuple(kind.sliding_unit if sliding.get(j, False) else kind.unit for j in order)
        signals.append(Signal(name, units, (len(order),), order, about=kind.about))
    return Layout.of(signals)


def _place_columns(
    place: str,
    signal: SignalTable,
    joints: tuple[str, ...],
    measured: MeasuredTable,
    found: dict[str, list[int]],
    sliding: dict[int, bool],
) -> None:
    """Notes the joints of a table's columns in `found`, by signal, and in `sliding` whether they slide, where its unit says it.

    Raises:
        LogError: as `layout_of`.
    """
    kind, numbers = QUANTITIES[signal.quantity], joint_numbers(signal, joints, place)
    unit = unit_of(signal, measured, place)
    places = found.setdefault(kind.signal, [])
    twice = [joints[j] for j in numbers if j in places]
    if twice:
        raise LogError(f"a second {signal.quantity}", place=f"{place}.joints", value=twice[0], expected="one")
    places += numbers
    slides = kind.sided and unit in kind.sliding and unit not in kind.turning
    for j in numbers if kind.sided and signal.side == "joint" and unit not in SHARES else ():
        if sliding.setdefault(j, slides) != slides:
            expected = f"a unit of a joint that has {'lengths' if sliding[j] else 'angles'}"
            raise LogError(f"joint {joints[j]!r}", place=f"{place}.unit", value=unit, expected=expected)


def joint_numbers(signal: SignalTable, joints: tuple[str, ...], place: str) -> list[int]:
    """Indices of the joints of a table's columns.

    Raises:
        LogError: an unknown joint, or one column too many or too few.
    """
    names = joints if signal.joints is None else signal.joints
    if len(names) != len(signal.columns):
        expected = f"{len(names)}, for {', '.join(names)}; or joints = [...]"
        raise LogError(f"{len(signal.columns)} columns", place=f"{place}.columns", expected=expected)
    for name in names:
        check_known(LogError, name, joints, "no joint of the log", place=f"{place}.joints")
    return [joints.index(name) for name in names]


def unit_of(signal: SignalTable, table: MeasuredTable, place: str) -> str:
    """The unit of a table's columns, from the file or from the header; the two must agree.

    Raises:
        LogError: none, two that differ, or one that the quantity does not have.
    """
    kind, units = QUANTITIES[signal.quantity], set()
    for column in signal.columns:
        stated = plain_unit(table.unit(column) or "")
        if stated and signal.unit and stated != signal.unit:
            what = f"the header of column {column!r} says {stated!r}"
            raise LogError(what, place=f"{place}.unit", value=signal.unit, expected="one of the two", file=table.path)
        units.add(stated or signal.unit or "")
    if len(units) > 1 or "" in units:
        what = "missing" if "" in units else f"columns in {' and '.join(sorted(units))}: a table for each unit"
        raise LogError(what, place=f"{place}.unit", expected=f"one of {', '.join(kind.units)}")
    unit = units.pop()
    check_known(LogError, unit, kind.units, f"no unit of a {signal.quantity}", place=f"{place}.unit")
    for name, those in (("counts_per_turn", COUNTS), ("rated", tuple(SHARES))):
        if unit in those and getattr(signal, name) is None:
            raise LogError("missing", place=f"{place}.{name}", expected=f"numbers, as the unit is {unit}")
    return unit


def converted(log: Log, signal: SignalTable, number: int, values: np.ndarray, unit: str) -> np.ndarray:
    """Columns of a table as the joints' signal in SI units: q = N⁻¹ θ_motor, tau = Nᵀ tau_motor.

    Args:
        log: whose gears these are.   signal: the table, the `number`-th.   values: (rows, columns).   unit: of the columns.
    Returns:
        values: (rows, columns), columns still in the table's order.
    Raises:
        LogError: columns of the motor side and no gears, or not all motors that turn a joint.
    """
    kind = QUANTITIES[signal.quantity]
    factor: Any = kind.turning[unit] if unit in kind.turning else kind.sliding[unit]
    if unit in COUNTS:
        factor = factor / signal.per_column("counts_per_turn", 1.0)
    if unit in SHARES:
        factor = factor * signal.per_column("rated", 1.0)
    with np.errstate(over="ignore", invalid="ignore"):  # cells may hold inf; the census refuses what is too large
        values = values * (factor * signal.per_column("signs", 1.0)) + ZERO.get(unit, 0.0)
        if signal.side == "motor":
            values = values @ to_joints(log, signal, number)
        return values + signal.per_column("offsets", 0.0)


def to_joints(log: Log, signal: SignalTable, number: int) -> np.ndarray:
    """(columns, columns) matrix that turns rows of motor values into rows of joint values."""
    place = f"signals[{number}]"
    if log.gears is None:
        expected = "[gears] with ratios or matrix, or a robot with motors"
        raise LogError("gears are not known", place=f"{place}.side", value="motor", expected=expected, file=log.path)
    chosen = joint_numbers(signal, log.joints, place)
    others = [j for j in range(len(log.joints)) if j not in chosen]
    torque = QUANTITIES[signal.quantity].signal in ("tau", "tau_link")
    matrix = log.gears.T if torque else np.linalg.inv(log.gears)  # joint values from motor values
    open_ends = np.argwhere(np.abs(matrix[np.ix_(chosen, others)]) > 1e-12 * np.abs(matrix).max())
    if len(open_ends):
        joint, motor = log.joints[chosen[open_ends[0][0]]], log.joints[others[open_ends[0][1]]]
        what = f"joint {joint!r} is coupled with the motor of {motor!r}, whose column is not among them"
        raise LogError(what, place=f"{place}.columns", file=log.path)
    return matrix[np.ix_(chosen, chosen)].T


def gears_of(arm: Model, joints: tuple[str, ...]) -> np.ndarray | None:
    """(n, n) N of an arm's motors, θ_motor = N q, in the order of a log's joints; None for a record without motors."""
    bodies = [body for body in arm.coordinates if body.joint in joints and _has_motor(body)]
    if not bodies:
        return None
    numbers = np.eye(len(joints))
    for body in bodies:
        row = joints.index(body.joint)
        numbers[row, row] = body.drive.gear_ratio
        for other, ratio in body.drive.coupling:
            if other in joints:
                numbers[row, joints.index(other)] = ratio
    return numbers


def check_gears(log: Log, arm: Model) -> None:
    """Refuses a log's gears that contradict the arm's record.

    Raises:
        LogError: with the joint and both rows of N.
    """
    own = gears_of(arm, log.joints)
    if own is None or log.table.gears is None or log.gears is None:
        return
    for body in filter(_has_motor, arm.coordinates):
        if body.joint not in log.joints:
            continue
        row = log.joints.index(body.joint)
        if not np.allclose(log.gears[row], own[row], rtol=0.0, atol=SAME_GEAR * abs(own[row, row])):
            theirs, ours = (", ".join(f"{x:g}" for x in each[row]) for each in (log.gears, own))
            what = (
                f"the motor of {body.joint!r} turns by [{theirs}] in the log's file, by [{ours}] in the robot's record"
            )
            expected = "the same gears and couplings in both, or in one of them"
            raise LogError(what, place="gears", expected=expected, file=log.path)


def _has_motor(body: Body) -> bool:
    return body.drive.torque_constant is not None or body.drive.gear_ratio != 1.0

"""`print-simulation`: the rows of a run from start to finish, every step, with units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import SessionError, nearest
from armwright.session.dynamics import by_row
from armwright.session.listing import Listing, Shown, shortest
from armwright.session.simulation import PARTIAL, the_run
from armwright.session.variables import same
from armwright.simulation.recording import in_order, run_units
from armwright.simulation.tables import joint_columns

if TYPE_CHECKING:
    import xarray as xr

    from armwright.session.session import Session

ROWS_ON_SCREEN = 25  # about as many, where no step is given
NEAR = 1e-6  # of a row's time step: so near to a row is the row
QUANTITIES = {
    "theta": "q", "omega": "qd", "alpha": "qdd", "torque": "tau", "voltage": "voltage", "current": "current",
    "command": "u", "reference": "q_reference", "measured": "q_measured",
}  # fmt: skip
USUAL = ("theta", "omega", "torque", "voltage")


def print_simulation(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`print-simulation`: on the screen, or into the open output file."""
    run = in_order(the_run(session, "print-simulation"))
    most = ROWS_ON_SCREEN if session.state.output is None else None
    rows = chosen_rows(run["time"].values, given["start"], given["finish"], given["step"], most=most)
    return session.emit(listing(run.isel(time=rows), _quantities(run, given["what"])))


def chosen_rows(
    times: np.ndarray, start: float | None, finish: float | None, step: float | None, *, most: int | None
) -> np.ndarray:
    """The rows from start to finish, every step.

    Args:
        times: (k,) [s] of the rows.   start, finish, step: [s]; by default the first, the last, and every row.
        most: about how many rows there may be without a step; None: as many as there are.
    Raises:
        SessionError: times outside the run, or between its rows.
    """
    first, last = float(times[0]), float(times[-1])
    start, finish = first if start is None else start, last if finish is None else finish
    spacing = float(np.diff(times).min()) if len(times) > 1 else 1.0
    slack = NEAR * spacing
    for name, value in (("start", start), ("finish", finish)):
        if not first - slack <= value <= last + slack:
            raise SessionError(
                f"print-simulation: {name} = {value:g} s is outside the simulation, {first:g} to {last:g} s"
            )
    if finish < start:
        raise SessionError(f"print-simulation: finish = {finish:g} s is before start = {start:g} s")
    if step is None:
        inside = np.flatnonzero((times >= start - slack) & (times <= finish + slack))
        return inside[:: _stride(len(inside), most)]
    if step < spacing - slack:
        raise SessionError(
            f"print-simulation: step = {step:g} s: expected at least {spacing:g} s, the step of the rows"
        )
    wanted = start + step * np.arange(int(np.floor((finish - start) / step + NEAR)) + 1)
    rows = np.abs(times[:, None] - wanted).argmin(axis=0) if len(wanted) < 64 else _nearest(times, wanted)
    missed = np.abs(times[rows] - wanted) > slack
    if missed.any():
        raise SessionError(
            f"print-simulation: there is no row at t = {wanted[missed][0]:.9g} s; expected start and step on rows, "
            f"which are {spacing:g} s apart"
        )
    return rows


def _nearest(times: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    behind = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1)
    return np.where(wanted - times[behind - 1] < times[behind] - wanted, behind - 1, behind)


def _stride(count: int, most: int | None) -> int:
    """Every so many rows, 1, 2, 5, 10, …, so that about `most` are left."""
    stride = 1
    while most is not None and count / stride > most:
        head = int(str(stride)[0])
        stride = stride * 5 // 2 if head == 2 else stride * 2
    return stride


def _quantities(run: xr.Dataset, text: str | None) -> list[str]:
    """Names of the run's variables that are asked for."""
    if text is None:
        return [QUANTITIES[name] for name in USUAL if QUANTITIES[name] in run]
    by_same = {same(name): name for name in QUANTITIES}
    found = []
    for word in text.replace(",", " ").split():
        if same(word) not in by_same:
            raise SessionError(f"print-simulation: no quantity {word!r}; {nearest(word, QUANTITIES)}")
        name = QUANTITIES[by_same[same(word)]]
        if name not in run:
            there = ", ".join(known for known, variable in QUANTITIES.items() if variable in run)
            raise SessionError(f"print-simulation: this simulation has no {word}; it has {there}")
        found.append(name)
    return found


def listing(run: xr.Dataset, quantities: list[str]) -> Listing:
    """Rows of a run: a sheet for each quantity, and all of them as columns."""
    joints = [str(joint) for joint in run["joint"].values]
    times = shortest(run["time"].values)
    names = {quantity: name for name, quantity in QUANTITIES.items()}
    columns: dict[str, np.ndarray] = {"t [s]": run["time"].values}
    sheets = []
    word = f"{PARTIAL} run, " if PARTIAL in run.attrs else ""
    for quantity in quantities:
        units, values = run_units(run, quantity), run[quantity].values
        sheets.append(by_row(f"{word}{names[quantity]}", "t [s]", times, joints, units, values))
        columns |= joint_columns(quantity, joints, units, values)
    return Listing(tuple(sheets), columns)

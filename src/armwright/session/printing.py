"""`print-simulation` and `plot-simulation`: a run's rows from start to finish with units, and its curves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import armwright as aw
from armwright.errors import SessionError, nearest
from armwright.results.aliases import QUANTITIES
from armwright.results.recording import in_order, run_units
from armwright.results.tables import joint_columns
from armwright.session.continued import PARTIAL
from armwright.session.dynamics import by_row
from armwright.session.listing import Drawing, Line, Listing, Shown, shortest
from armwright.session.simulation import the_run
from armwright.session.variables import joint_number, same

if TYPE_CHECKING:
    import xarray as xr

    from armwright.session.session import Session

ROWS_ON_SCREEN = 25  # about as many, where no step is given
NEAR = 1e-6  # of a row's time step: so near to a row is the row
USUAL = ("theta", "omega", "torque", "voltage")


def print_simulation(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`print-simulation`: on the screen, or into the open output file."""
    run = in_order(the_run(session, "print-simulation"))
    most = ROWS_ON_SCREEN if session.state.output is None else None
    rows = chosen_rows(run["time"].values, given["start"], given["finish"], given["step"], most=most)
    return session.emit(listing(run.isel(time=rows), _quantities("print-simulation", run, given["what"])))


def plot_simulation(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`plot-simulation`, `plot-simulation FILE`: the run as a picture, or a part of it; without a file on the screen."""
    run = the_run(session, "plot-simulation")
    quantities = None if given["what"] is None else _quantities("plot-simulation", run, given["what"])
    joints = None if given["joints"] is None else _joints(session, run, given["joints"])
    if given["file"] is None:
        return [Drawing(run, joints, quantities)]
    aw.plot(run, given["file"], joints=joints, quantities=quantities)
    return [Line(f"wrote {given['file']}", "good")]


def _joints(session: Session, run: xr.Dataset, text: str) -> list[str]:
    """Joints by number or name."""
    arm = session.state.arm
    return [arm.names[joint_number(arm, "plot-simulation: joints", word)] for word in text.replace(",", " ").split()]


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


def _quantities(command: str, run: xr.Dataset, text: str | None) -> list[str]:
    """Names of the run's variables that are asked for."""
    if text is None:
        return [QUANTITIES[name] for name in USUAL if QUANTITIES[name] in run]
    by_same = {same(name): name for name in QUANTITIES}
    found = []
    for word in text.replace(",", " ").split():
        if same(word) not in by_same:
            raise SessionError(f"{command}: no quantity {word!r}; {nearest(word, QUANTITIES)}")
        name = QUANTITIES[by_same[same(word)]]
        if name not in run:
            there = ", ".join(known for known, variable in QUANTITIES.items() if variable in run)
            raise SessionError(f"{command}: this simulation has no {word}; it has {there}")
        found.append(name)
    return found


def listing(run: xr.Dataset, quantities: list[str]) -> Listing:
    """Rows of a run: a sheet for each quantity, and all of them as columns."""
    joints = [str(joint) for joint in run["joint"].values]
    times = shortest(run["time"].values)
    names = {quantity: name for name, quantity in QUANTITIES.items()}
    columns: dict[str, np.ndarray] = {f"t{f' of a {PARTIAL} run' * (PARTIAL in run.attrs)} [s]": run["time"].values}
    sheets = []
    word = f"{PARTIAL} run, " if PARTIAL in run.attrs else ""
    for quantity in quantities:
        units, values = run_units(run, quantity), run[quantity].values
        sheets.append(by_row(f"{word}{names[quantity]}", "t [s]", times, joints, units, values))
        columns |= joint_columns(quantity, joints, units, values)
    return Listing(tuple(sheets), columns)

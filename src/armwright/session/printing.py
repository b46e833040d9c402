"""Commands that print and plot a simulation, and open and close the output file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import armwright as aw
from armwright.errors import SessionError
from armwright.output import check_destination
from armwright.results.aliases import PARTIAL, QUANTITIES
from armwright.results.csv_tables import joint_columns
from armwright.results.recording import in_order, run_units
from armwright.session.arguments import same
from armwright.session.listing import Drawing, Listing, Output, OutputFile, TextLine, by_row, shortest
from armwright.session.simulation import last_run
from armwright.session.variables import joint_number
from armwright.session.workspace import Workspace

if TYPE_CHECKING:
    import xarray as xr

ROWS_ON_SCREEN = 25  # about; without a step
NEAR = 1e-6  # of the time between rows: a time this near to a row means the row
USUAL = ("theta", "omega", "torque", "voltage")


def print_simulation(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`print-simulation`: on the screen, or into the open output file."""
    run = in_order(last_run(session, "print-simulation"))
    most = ROWS_ON_SCREEN if session.state.output_file is None else None
    rows = chosen_rows(run["time"].values, arguments["start"], arguments["finish"], arguments["step"], most=most)
    return session.emit(listing(run.isel(time=rows), _quantities("print-simulation", run, arguments["what"])))


def plot_simulation(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`plot-simulation`, `plot-simulation FILE`: the run as a picture, or a part of it; without a file on the screen."""
    run = last_run(session, "plot-simulation")
    quantities = None if arguments["what"] is None else _quantities("plot-simulation", run, arguments["what"])
    joints = None if arguments["joints"] is None else _joints(session, arguments["joints"])
    if arguments["file"] is None:
        return [Drawing(run, joints, quantities)]
    aw.plot(run, arguments["file"], joints=joints, quantities=quantities)
    return [TextLine(f"wrote {arguments['file']}", "good")]


def _joints(session: Workspace, text: str) -> list[str]:
    """Joints by number or name."""
    arm = session.state.arm
    return [arm.names[joint_number(arm, "plot-simulation", word)] for word in text.replace(",", " ").split()]


def chosen_rows(
    times: np.ndarray, start: float | None, finish: float | None, step: float | None, *, most: int | None
) -> np.ndarray:
    """The rows from start to finish, every step.

    Args:
        times: (k,) [s] of the rows.   start, finish, step: [s]; by default the first, the last, and every row.
        most: about how many rows there may be without a step; None: any number.
    Raises:
        SessionError: times outside the run, or between its rows.
    """
    first, last = float(times[0]), float(times[-1])
    start, finish = first if start is None else start, last if finish is None else finish
    spacing = float(np.diff(times).min()) if len(times) > 1 else 1.0
    slack = NEAR * spacing
    for name, value, least in (("start", start, first), ("finish", finish, start)):
        if not least - slack <= value <= last + slack:
            expected = f"a time of the simulation, {least:g} to {last:g} s"
            raise SessionError(place=f"print-simulation {name}", value=value, expected=expected)
    if step is None:
        inside = np.flatnonzero((times >= start - slack) & (times <= finish + slack))
        return inside[:: _stride(len(inside), most)]
    place = "print-simulation step"
    if step < spacing - slack:
        raise SessionError(place=place, value=step, expected=f"at least {spacing:g} s, the time between rows")
    import pandas

    wanted = start + step * np.arange(int(np.floor((finish - start) / step + NEAR)) + 1)
    rows = pandas.Index(times).get_indexer(wanted, method="nearest")
    missed = np.abs(times[rows] - wanted) > slack
    if missed.any():
        what = f"there is no row at t = {wanted[missed][0]:.9g} s"
        raise SessionError(
            what, place=place, value=step, expected=f"start and step on rows, which are {spacing:g} s apart"
        )
    return rows


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
    names = []
    for word in text.replace(",", " ").split():
        if same(word) not in by_same:
            raise SessionError("no such quantity", place=f"{command} what", value=word, choices=QUANTITIES)
        name = QUANTITIES[by_same[same(word)]]
        if name not in run:
            there = [known for known, variable in QUANTITIES.items() if variable in run]
            raise SessionError("not in this simulation", place=f"{command} what", value=word, choices=there)
        names.append(name)
    return names


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


def open_output_file(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`open-output-file FILE`: sends the results of print-simulation and inverse-arm FILE there."""
    state = session.state
    if state.output_file is not None:
        raise SessionError(
            "is open", place="open-output-file", value=state.output_file.path, expected="close-output-file first"
        )
    file = OutputFile(check_destination(arguments["file"]))
    session.state = state.replace(output_file=file)
    kind = "CSV" if file.is_csv else "text"
    return [TextLine(f"results go to {file.path} as {kind}, written whole with each of them", "good")]


def close_output_file(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`close-output-file`: shows results on the screen again."""
    file = session.state.output_file
    if file is None:
        raise SessionError("no output file is open", place="close-output-file")
    session.state = session.state.replace(output_file=None)
    return [
        TextLine(f"closed {file.path}{'' if file.text else '; nothing was printed, so there is no such file'}", "good")
    ]

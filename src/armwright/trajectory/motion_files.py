"""Motions read from CSV and NetCDF files."""

from __future__ import annotations

import csv
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armwright.errors import RunError, ScenarioError, ScheduleError
from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.results.csv_tables import CsvColumn, parse_numbers, table_text
from armwright.results.run_file import load_run
from armwright.trajectory.motion_rows import QUANTITIES
from armwright.trajectory.piecewise import PiecewisePolynomial

if TYPE_CHECKING:
    import xarray as xr


def load_motion(path: str | os.PathLike[str], arm: Model | None = None) -> PiecewisePolynomial:
    """The motion in a file: polynomials of fifth degree between rows (quintic Hermite).

    A .nc file that `Motion.save` wrote keeps the pieces themselves, and gives them to the bit; that of a run gives the
    motion of the run.

    Args:
        path: .csv with the columns t, q_JOINT, qd_JOINT and qdd_JOINT of every joint, or .nc.
        arm: whose joints move, to compare names and units and to put columns in its order; None: as in the file.
    Returns:
        motion: from the first row's time to the last one's.
    Raises:
        ScheduleError: no such file, no such columns, times that do not increase; with file and line.   RunError: no
            NetCDF file of a motion.   ScenarioError: other joints than the arm's.
    Example:
        >>> arm = aw.load("two-link")
        >>> move = aw.trajectories.Quintic([0.0, 0.0], [0.5, -0.5], duration=1.0)
        >>> move.save(arm, "move.csv")
        >>> aw.trajectories.load_motion("move.csv", arm).at(1.0)[0].round(6)
        array([ 0.5, -0.5])
    """
    if not isinstance(path, (str, os.PathLike)):
        raise ScheduleError(value=path, expected="the path of a motion, .csv or .nc")
    if Path(path).suffix.lower() == ".nc":
        return _from_netcdf(Path(path), arm)
    return parse_motion(table_text(path), os.fspath(path), arm).from_file(path)


def parse_motion(text: str, place: str, arm: Model | None = None) -> PiecewisePolynomial:
    """The motion in the text of a CSV file; `place` is its name in errors. See `load_motion`."""
    if arm is None:
        names = _names(text, place)
        units = {name: [()] * len(names) for name in QUANTITIES}
    else:
        names = list(arm.names)
        units = {name: [(unit,) for unit in joint_units(arm, name)] for name in QUANTITIES}
    columns = [CsvColumn("t", ("s",))]
    for quantity in QUANTITIES:
        columns += [CsvColumn(f"{quantity}_{name}", unit) for name, unit in zip(names, units[quantity], strict=True)]
    table = parse_numbers(text, place, columns)
    t = table.values[:, 0]
    late = np.flatnonzero(np.diff(t) <= 0.0)
    if len(late):
        k = int(late[0]) + 1
        what, file = f"not after {t[k - 1]:.10g} before it", f"{place}:{table.lines[k]}"
        raise ScheduleError(what, place="column 't'", value=float(t[k]), expected="times that increase", file=file)
    if len(t) < 2:
        raise ScheduleError("one row", file=place, expected="two or more, as a motion has a beginning and an end")
    return PiecewisePolynomial.hermite(t, *np.split(table.values[:, 1:], 3, axis=1))


def _names(text: str, place: str) -> list[str]:
    """Names of the joints in a header: what follows `q_`."""
    first = next((line for line in text.splitlines() if line.strip()), "")
    cells = [re.sub(r"\s*\[.*\]$", "", cell.strip()) for cell in next(csv.reader([first]), [])]
    names = [cell.removeprefix("q_") for cell in cells if cell.startswith("q_")]
    if not names:
        expected = "a header: t, and q_JOINT, qd_JOINT, qdd_JOINT of every joint"
        raise ScheduleError("no column q_JOINT", file=place, expected=expected)
    return names


def _from_netcdf(path: Path, arm: Model | None) -> PiecewisePolynomial:
    """The pieces that a file keeps, or polynomials between its rows."""
    run = load_run(path)
    missing = [name for name in QUANTITIES if name not in run]
    if missing or "time" not in run.dims or "lane" in run.dims:
        what = f"no {', '.join(missing)}" if missing else "lanes, or no times"
        raise RunError(what, file=path, expected="q, qd and qdd along time and joint")
    _check_finite(run, path)
    names = [str(name) for name in run["joint"].values]
    order = list(range(len(names)))
    if arm is not None:
        if sorted(names) != sorted(arm.names):
            expected = f"those of {arm.name}: {', '.join(arm.names)}"
            raise ScenarioError(place="joints", value=names, expected=expected, file=path)
        order = [names.index(name) for name in arm.names]
    if "coefficients" in run and "knots" in run:
        pieces = run["coefficients"].transpose("piece", "joint", "power").values[:, order]
        return PiecewisePolynomial(run["knots"].values, pieces)
    states = [run[name].transpose("time", "joint").values[:, order] for name in QUANTITIES]
    return PiecewisePolynomial.hermite(run["time"].values, *states)


def _check_finite(run: xr.Dataset, path: Path) -> None:
    """Refuses a file with a cell that is not finite.

    Raises:
        RunError: names variable, joint and row.
    """
    for name in ("q", "qd", "qdd", "knots", "coefficients"):
        if name not in run:
            continue
        wrong = np.argwhere(~np.isfinite(run[name].values))
        if len(wrong):
            at = dict(zip(run[name].dims, map(int, wrong[0]), strict=True))
            joint = f" of joint {str(run['joint'].values[at.pop('joint')])!r}" if "joint" in at else ""
            row = ", ".join(f"{'row' if dimension == 'time' else dimension} {k + 1}" for dimension, k in at.items())
            value = float(run[name].values[tuple(wrong[0])])
            raise RunError(place=f"{name}{joint}, {row}", value=value, expected="a finite number", file=path)

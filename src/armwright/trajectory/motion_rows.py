"""Rows of motions: as a dataset like that of a run, as CSV or NetCDF files, and as a figure."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import RunError, ScenarioError, ScheduleError
from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.output import check_destination, whole_file
from armwright.printable import printable
from armwright.results.csv_tables import CsvColumn, joint_columns, parse_numbers, table_text, write_table
from armwright.results.plot import check_plot, draw, write_plot
from armwright.results.plot_curves import describe
from armwright.results.recording import make_dataset
from armwright.results.run_file import load_run, write_netcdf
from armwright.simulation.inputs.payload import Payload
from armwright.trajectory.limits_report import efforts
from armwright.trajectory.motion import Motion
from armwright.trajectory.piecewise import PiecewisePolynomial

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

ENDINGS = (".csv", ".nc")
QUANTITIES = ("q", "qd", "qdd")
MOST_ROWS = 20_000_000
NEAR = 1e-3  # of a row's time: rows nearer to a break are left away for it


def motion_times(motion: Motion, rate: float) -> np.ndarray:
    """(k,) [s] times of rows: `rate` a second from the beginning, the breaks of the motion, and its end.

    Raises:
        ScenarioError: a motion that does not end, or too many rows.
    """
    number = rate if isinstance(rate, (int, float)) and not isinstance(rate, bool) else 0.0
    if not 0.0 < number < np.inf:
        raise ScenarioError(place="rate", value=rate, expected="rows in a second, above 0")
    if not np.isfinite(motion.duration):
        raise ScenarioError("does not end", place=type(motion).__name__, expected="a motion with a duration")
    breaks = np.asarray(motion.breaks, dtype=float)
    if motion.duration * rate + len(breaks) > MOST_ROWS:
        raise ScenarioError(f"more than {MOST_ROWS} rows", place="rate", value=rate, expected="fewer rows in a second")
    even = breaks[0] + np.arange(int(motion.duration * rate) + 1) / rate
    place = np.clip(np.searchsorted(breaks, even), 1, len(breaks) - 1)
    apart = np.minimum(np.abs(even - breaks[place - 1]), np.abs(breaks[place] - even))
    return np.unique(np.concatenate([even[apart > NEAR / rate], breaks]))


def motion_dataset(
    arm: Model, motion: Motion, rate: float = 500.0, payload: Payload | Sequence[Payload] | None = None
) -> xr.Dataset:
    """Rows of a motion like those of a run; of a piecewise polynomial its pieces too. See `Motion.dataset`."""
    if motion.n != arm.n:
        raise ScenarioError(f"a motion of {motion.n} joints", place=arm.name, expected=f"{arm.n}")
    t = motion_times(motion, rate)
    q, qd, qdd = motion.at(t)
    known = {("tau" if name == "torque" else name): each for name, each in efforts(arm, t, q, qd, qdd, payload).items()}
    dataset = make_dataset(arm, t, q, qd, np.zeros_like(q), qdd=qdd, **known, attrs={"title": "planned motion"})
    dataset = dataset.drop_vars("u")  # nothing is commanded yet
    polynomial = motion if isinstance(motion, PiecewisePolynomial) else getattr(motion, "polynomial", None)
    if polynomial is None:
        return dataset
    about = {"units": "rad | m, by powers of s", "long_name": "coefficients of the pieces, the constant term first"}
    return dataset.assign(
        knots=("knot", polynomial.knots, {"units": "s", "long_name": "times between the pieces"}),
        coefficients=(("piece", "joint", "power"), polynomial.coefficients, about),
    )


def save_motion(arm: Model, motion: Motion, path: str | os.PathLike[str], rate: float = 500.0) -> None:
    """Writes a motion as .csv or .nc. See `Motion.save`."""
    check_destination(path, ENDINGS)
    if Path(path).suffix.lower() == ".nc":
        dataset = motion_dataset(arm, motion, rate)
        with whole_file(path, ENDINGS) as temporary:
            write_netcdf(dataset, temporary)
        return
    if motion.n != arm.n:
        raise ScenarioError(f"a motion of {motion.n} joints", place=arm.name, expected=f"{arm.n}")
    t = motion_times(motion, rate)
    columns: dict[str, Any] = {"t [s]": t}
    for name, values in zip(QUANTITIES, motion.at(t), strict=True):
        columns |= joint_columns(name, arm.names, joint_units(arm, name), values)
    write_table(path, columns)


def plot_motion(
    arm: Model,
    motion: Motion,
    path: str | os.PathLike[str] | None = None,
    payload: Any = None,
    title: str = "",
    note: Sequence[str] = (),
) -> Figure | None:
    """Figure of a motion, or the file of one; a title in place of the arm's name, and lines below it. See `Motion.plot`."""
    dataset = motion_dataset(arm, motion, payload=payload)
    shown = [name for name in (*QUANTITIES, "tau", "voltage") if name in dataset]
    path = None if path is None else check_plot(path)
    described = describe(dataset, quantities=shown)
    described = replace(described, title=printable(title) or described.title, note="\n".join(map(printable, note)))
    return draw(described) if path is None else write_plot(described, path)


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
            raise ScenarioError(place=f"{path}: joints", value=names, expected=expected)
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

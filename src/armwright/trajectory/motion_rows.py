"""Rows of motions: as a dataset like that of a run, written to CSV or NetCDF files, and as a figure."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.model.payload import Payload
from armwright.output import check_destination, whole_file
from armwright.printable import printable
from armwright.results.csv_tables import joint_columns, write_table
from armwright.results.plot import check_plot, draw, write_plot
from armwright.results.plot_curves import describe
from armwright.results.recording import make_dataset
from armwright.results.run_file import write_netcdf
from armwright.trajectory.efforts import efforts

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from armwright.trajectory.motion import Motion

ENDINGS = (".csv", ".nc")
QUANTITIES = ("q", "qd", "qdd")
MOST_ROWS = 20_000_000
NEAR = 1e-3  # of a row's time: rows nearer to a break are left away for it


def motion_times(arm: Model, motion: Motion, rate: float) -> np.ndarray:
    """(k,) [s] times of rows: `rate` a second from the beginning, the breaks of the motion, and its end.

    Raises:
        ScenarioError: a motion of other joints, one that does not end, or too many rows.
    """
    if motion.n != arm.n:
        raise ScenarioError(f"a motion of {motion.n} joints", place=arm.name, expected=f"{arm.n}")
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
    distance = np.minimum(np.abs(even - breaks[place - 1]), np.abs(breaks[place] - even))
    return np.unique(np.concatenate([even[distance > NEAR / rate], breaks]))


def motion_dataset(
    arm: Model, motion: Motion, rate: float = 500.0, payload: Payload | Sequence[Payload] | None = None
) -> xr.Dataset:
    """Rows of a motion like those of a run; of a piecewise polynomial its pieces too. See `Motion.dataset`."""
    t = motion_times(arm, motion, rate)
    q, qd, qdd = motion.at(t)
    known = {
        ("tau" if name == "torque" else name): each.tau for name, each in efforts(arm, t, q, qd, qdd, payload).items()
    }
    dataset = make_dataset(arm, t, q, qd, np.zeros_like(q), qdd=qdd, **known, attrs={"title": "planned motion"})
    dataset = dataset.drop_vars("u")  # nothing is commanded yet
    polynomial = getattr(motion, "polynomial", None)
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
    t = motion_times(arm, motion, rate)
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

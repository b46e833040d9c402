"""Runs: the dataset of a simulation, with names, units and coordinates, and the file formats for it.

| ending   | what is written                                                              | read by                         |
|----------|------------------------------------------------------------------------------|---------------------------------|
| .nc      | the dataset as it is, NetCDF 4                                               | `load_run`, xarray, MATLAB, …   |
| .csv     | one row a lane and time, columns `q_joint1 [rad]`                            | pandas, MATLAB, spreadsheets    |
| .mat     | variables `t`, `q`, `units`, see `mat_file`                                  | MATLAB, Octave, scipy           |
| .mcap    | ROS 2 messages and JSON, see `mcap_file` (extra `logs`: mcap)                | Foxglove, PlotJuggler, Rerun, … |
| .parquet | the same columns, units in the fields' metadata too (extra `logs`: pyarrow)  | pandas, polars, DuckDB          |
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.entry import AnyRun, as_run
from armwright.errors import OutputError, Problem, RunError
from armwright.joint_kinds import KINDS
from armwright.model import Model
from armwright.model.joint_signals import LONG_NAMES, UNITS, command_unit, joint_units
from armwright.output import check_destination, whole_file
from armwright.results.csv_tables import joint_columns, write_table
from armwright.results.mat_file import write_mat
from armwright.results.mcap_file import write_mcap
from armwright.results.run_file import write_netcdf
from armwright.results.run_reader import first_line
from armwright.results.run_schema import A_RUN, check_run

if TYPE_CHECKING:
    import xarray as xr

ENDINGS = (".nc", ".csv", ".parquet", ".mcap", ".mat")
EXTRAS = {".parquet": ("Parquet", "pyarrow"), ".mcap": ("MCAP", "mcap")}  # ending → format, module of the extra `logs`
DIMENSIONS = ("lane", "time", "joint", "event")  # of a run, in order; the last where events were watched


def make_dataset(
    arm: Model,
    t: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    u: np.ndarray,
    *,
    qdd: np.ndarray | None = None,
    tau: np.ndarray | None = None,
    voltage: np.ndarray | None = None,
    current: np.ndarray | None = None,
    attrs: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """A run as a dataset with dimensions (time, joint) or (lane, time, joint).

    Args:
        arm: the arm that moved.   t: (k,) [s].
        q: (…, k, n) [rad | m].   qd: (…, k, n) [rad/s | m/s].   u: (…, k, n) [V | A | N m | N]; … is nothing or the lanes.
        qdd: (…, k, n) [rad/s² | m/s²].   tau: (…, k, n) [N m | N].   voltage: (…, k, n) [V].   current: (…, k, n) [A].
        attrs: of the whole run, texts and numbers; of a list of texts or notes each gets a line.
    Returns:
        run: coordinates time [s], joint (names), kind and command of each joint. Voltage and current are left out where
            the motors' constants are known of no joint, and NaN for joints without.
    """
    dims = ("lane", "time", "joint") if np.ndim(q) == 3 else ("time", "joint")
    arrays = {"q": q, "qd": qd, "qdd": qdd, "u": u, "tau": tau, "voltage": voltage, "current": current}
    known = {"voltage": _known(arm, "resistance", "torque_constant"), "current": _known(arm, "torque_constant")}
    variables = {}
    for name, values in arrays.items():
        if values is None or not np.any(known.get(name, True)):
            continue
        values = np.asarray(values, dtype=float)
        if name in known and not np.all(known[name]):
            values = np.where(known[name], values, np.nan)
        units = joint_units(arm, name)
        about = {"units": " | ".join(dict.fromkeys(units)), "long_name": LONG_NAMES[name]}
        variables[name] = (dims, values, about)
    time = ("time", np.asarray(t, dtype=float), {"units": "s", "long_name": "time"})
    lanes = np.shape(q)[0] if len(dims) == 3 else None
    return bare_dataset(arm, attrs or {}, lanes).assign_coords(time=time).assign(variables)


def bare_dataset(arm: Model, attrs: Mapping[str, Any], lanes: int | None) -> xr.Dataset:
    """A run without recorded rows: coordinates joint, kind, command and, where there are lanes, lane.

    Args:
        arm: the arm that moved.   attrs: as in `make_dataset`.   lanes: how many; None: a run without a lane axis.
    """
    import xarray as xr

    coordinates: dict[str, Any] = {
        "joint": ("joint", list(arm.names), {"long_name": "joint"}),
        "kind": ("joint", [body.kind.name for body in arm.coordinates], {"long_name": "kind of joint"}),
        "command": (
            "joint",
            [body.drive.command for body in arm.coordinates],
            {"long_name": "command that the drive takes"},
        ),
    }
    if lanes is not None:
        coordinates["lane"] = ("lane", np.arange(lanes), {"long_name": "lane: one simulation of many"})
    about: dict[str, Any] = {"robot": arm.name}
    if arm.description is not None and arm.description.title:
        about["title"] = arm.description.title
    return xr.Dataset({}, coordinates, {**about, **_storable(attrs)})


def _storable(attrs: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes that come back from a file as they were: NetCDF has no lists of texts, so each text or note gets a line."""
    return {key: "\n".join(map(str, value)) if _are_texts(value) else value for key, value in attrs.items()}


def _are_texts(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and all(isinstance(item, (str, Problem)) for item in value)


def _known(arm: Model, *constants: str) -> np.ndarray:
    """(n,) True if the robot file gives all those constants of the joint's motor."""
    return np.array([all(getattr(body.drive, name) is not None for name in constants) for body in arm.coordinates])


def in_order(run: xr.Dataset) -> xr.Dataset:
    """The run, or a selection of it, with dimensions in the order (time, joint) or (lane, time, joint).

    A time or a joint selected alone, `run.isel(joint=0)`, is a dimension again.

    Raises:
        RunError: no run: no dataset, one without the coordinates of a run, or one whose motion has further dimensions;
            those of single variables, such as the entries of a sensor's signal, stay behind.
    """
    check_run(run)
    if "time" not in run.coords:
        expected = "a run that recorded rows, which what = 'none' does not; `aw.statistics` has the results of reducers"
        raise RunError("no coordinate 'time'", expected=expected)
    if "joint" not in run.coords:
        raise RunError("no coordinate 'joint'", expected=A_RUN)
    for dim, coordinates in {"joint": ("joint", "kind", "command"), "time": ("time",)}.items():
        if dim not in run.dims:
            varying = [name for name, variable in run.variables.items() if name in LONG_NAMES or name in coordinates]
            varying += [name for name, variable in run.data_vars.items() if {"time", "joint"} & set(variable.dims)]
            run = run.assign({name: run[name].variable.expand_dims(dim) for name in dict.fromkeys(varying)})
    further = [str(dim) for name in LONG_NAMES if name in run for dim in run[name].dims if dim not in DIMENSIONS]
    if further:
        raise RunError(place="dimension", value=further[0], expected="those of a run, lane, time and joint")
    return run.transpose(*(dim for dim in DIMENSIONS if dim in run.dims), ...)


def wide(run: xr.Dataset) -> dict[str, np.ndarray]:
    """The run as one table: `lane` (where there are lanes), `t [s]`, then `q_joint1 [rad]` and so on.

    Returns:
        columns: header → (rows,), one row a lane and time, lanes one after the other;
            of a run that recorded no motion one row a lane, with the results of its reducers.
    Raises:
        RunError: no run.
    """
    check_run(run)
    if "joint" in run.dims and not {"time", *LONG_NAMES} & {*run.dims, *run.variables}:
        return _wide_reduced(run)
    run = in_order(run)
    lanes = run.sizes.get("lane", 1)
    times, joints = run["time"].values, [str(joint) for joint in run["joint"].values]
    columns = {"lane": np.repeat(run["lane"].values, len(times))} if "lane" in run.dims else {}
    columns["t [s]"] = np.tile(times, lanes)
    for name, variable in run.data_vars.items():
        if "joint" not in variable.dims or "time" not in variable.dims:
            continue
        rows = variable.values.reshape(-1, run.sizes["joint"])
        columns |= joint_columns(str(name), joints, run_units(run, str(name)), rows)
    return columns


def _wide_reduced(run: xr.Dataset) -> dict[str, np.ndarray]:
    """A run without recorded motion as one table: a row a lane, the results of each joint's reducers."""
    joints = [str(joint) for joint in run["joint"].values]
    columns = {"lane": run["lane"].values} if "lane" in run.dims else {}
    for name, variable in run.data_vars.items():
        if "joint" in variable.dims:
            rows = variable.transpose(..., "joint").values.reshape(-1, len(joints))
            columns |= joint_columns(str(name), joints, [str(variable.attrs.get("units", "-"))] * len(joints), rows)
    if not any(name != "lane" for name in columns):
        raise RunError("no coordinate 'time'", expected=A_RUN)
    return columns


def run_units(run: xr.Dataset, name: str) -> list[str]:
    """The unit of a variable for each joint; its attribute only lists the units that occur."""
    kinds = [KINDS[str(kind)].units for kind in run["kind"].values]
    commands = [str(command) for command in run["command"].values]
    units = {quantity: [pair[each.linear] for each in kinds] for quantity, pair in UNITS.items()}
    units["u"] = [command_unit(*each) for each in zip(commands, kinds, strict=True)]
    if name in units:
        return units[name]
    stated = str(run[name].attrs.get("units", "-"))
    occurring = set(stated.split(" | "))  # of q_measured and the like, on an arm with slides
    same = (each for each in units.values() if len(occurring) > 1 and set(each) == occurring)
    return next(same, [stated] * len(kinds))


def check_recording(path: str | os.PathLike[str]) -> Path:
    """The path, if a run can be saved there; to be called before a long simulation.

    Raises:
        OutputError: as `save`.
    """
    path = check_destination(path, ENDINGS)
    name, module = EXTRAS.get(path.suffix.lower(), ("", ""))
    if module and importlib.util.find_spec(module) is None:
        raise OutputError(f"{name} needs {module}, which is not installed: pip install armwright[logs]", file=path)
    return path


def save(run: AnyRun, path: str | os.PathLike[str]) -> None:
    """Writes a run in the format that the file's ending names: .nc, .csv, .parquet, .mcap or .mat; whole or not at all.

    Args:
        run: what `simulate` returned, or a part of it such as `run.isel(joint=0)`.
        path: the file; one that is there is replaced when the new one is complete.
    Raises:
        RunError: no run.
        OutputError: an unknown ending, a folder that is missing, no permission, a full disk, Parquet without pyarrow, MCAP
            without mcap.
    Example:
        >>> run = aw.simulate(aw.Scenario("two-link", 0.2, command=[0.0, 0.0]))
        >>> aw.save(run, "fall.nc")  # or fall.csv, fall.parquet
    """
    run = as_run(run)
    check_run(run)
    path = check_recording(path)
    with whole_file(path, ENDINGS) as temporary:
        try:
            _WRITERS[path.suffix.lower()](run, temporary)
        except (RuntimeError, ValueError, TypeError) as error:  # an attribute that the format cannot hold
            raise OutputError(f"cannot be written: {first_line(error)}", file=path) from error


def _write_csv(run: xr.Dataset, path: Path) -> None:
    with open(path, "w", encoding="utf-8", newline="") as file:
        write_table(None, wide(run), file)


def _write_mcap(run: xr.Dataset, path: Path) -> None:
    run = in_order(run)
    write_mcap(run, path, _all_units(run))


def _write_mat(run: xr.Dataset, path: Path) -> None:
    run = in_order(run) if "time" in run.coords and "joint" in run.coords else run
    write_mat(run, path, _all_units(run))


def _all_units(run: xr.Dataset) -> dict[str, list[str]]:
    """Units of every variable with joints, one for each joint."""
    return {str(name): run_units(run, str(name)) for name, each in run.data_vars.items() if "joint" in each.dims}


def _write_parquet(run: xr.Dataset, path: Path) -> None:
    import json

    import pyarrow
    import pyarrow.parquet

    columns = wide(run)
    fields = []
    for header, values in columns.items():
        unit = header.partition(" [")[2].removesuffix("]")
        about = {"unit": unit} if unit else None
        fields.append(pyarrow.field(header, pyarrow.from_numpy_dtype(values.dtype), metadata=about))
    remembered = {"armwright": json.dumps({str(key): value for key, value in run.attrs.items()}, default=str)}
    table = pyarrow.table(list(columns.values()), schema=pyarrow.schema(fields, metadata=remembered))
    pyarrow.parquet.write_table(table, path)


_WRITERS = {
    ".nc": write_netcdf,
    ".csv": _write_csv,
    ".parquet": _write_parquet,
    ".mcap": _write_mcap,
    ".mat": _write_mat,
}
